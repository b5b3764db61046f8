"""One browser that looks at a scan: points, distances, and a robot that walks."""

import base64
import html
import math
import sys
from functools import partial
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from human_study.texts.catalogue import ENGLISH, catalogue_of
from sim.render.renderer import jpeg_bytes
from sim.tasks.pan import PanEnv
from sim.types import PAPER6, Action, Pose

from ..browse.layers import Walker, remove_nodes
from ..study_app.home.surfaces import add_ball
from ..study_app.screens.pan import HOTKEYS
from .shown import Point, ShownScan
from .stage import Ray, StoreyView, WorkQueue, free_keys, open_panel, panel_html

PANEL_WIDTH = 430
"""Pixels of the panel."""
_BALL, _LABEL_UP = 0.06, 0.12
"""Radius of a point's ball, and height of its number over it (metres)."""
_RGB = (214, 0, 110)
_MOVES = tuple(action for action in PAPER6 if action is not Action.STOP)


class Visit:
    """State of one browser."""

    def __init__(self, client: viser.ClientHandle, shown: ShownScan) -> None:
        """Builds the panel, shows the lowest storey and starts to listen."""
        self._client, self._shown = client, shown
        self._work = WorkQueue(client, self._warn)
        self._view = StoreyView(client, shown, self._work)
        self._points: list[Point] = []
        self._marks: list[Any] = []
        self._walker = Walker(client)
        self._env: PanEnv | None = None
        self._build()
        self._work.put(partial(self._show, 0))

    def leave(self) -> None:
        """The browser is gone."""
        self._work.end()

    def _warn(self, line: str) -> None:
        self._texts.content = panel_html(f'<p class="warn">{html.escape(line)}</p>')

    def _build(self) -> None:
        gui, shown, work = self._client.gui, self._shown, self._work
        open_panel(gui, shown.name, PANEL_WIDTH)
        notes = "".join(f'<p class="warn">{html.escape(note)}</p>' for note in shown.notes)
        facts = f"{len(shown.mesh.faces):,} triangles, {len(shown.mesh.textures)} textures"
        gui.add_html(panel_html(f"<h2>{html.escape(shown.name)}</h2><p>{facts}</p>{notes}"))
        self._view.add_buttons(self._show)
        self._texts = gui.add_html("")
        work.listen(gui.add_button("Clear the points"), lambda _: self._clear())
        if shown.navigation is not None:
            self._picture = gui.add_html("")
            work.listen(gui.add_button("Put the robot at the last point"), lambda _: self._put_robot())
            words = catalogue_of(ENGLISH)
            for action in _MOVES:
                label, hint = words(f"pan.{action.value}"), words(f"pan.{action.value}_keys")
                work.listen(gui.add_button(label, hint=hint), lambda _, action=action: self._move(action))
            for key, (_, action) in HOTKEYS.items():
                work.listen_to_key(words(f"pan.{action.value}"), key, partial(self._move, action))
        free_keys(gui)
        self._view.listen_to_clicks(self._point)

    def _show(self, index: int) -> None:
        """Shows one storey from above, and puts the robot on it."""
        self._view.show(index)
        if self._shown.navigation is not None:
            floor_y = self._view.part.floor_y
            place = self._shown.navigation.random_point(np.random.default_rng(0), storey_y=floor_y)
            self._start(place)
        self._draw_points()

    def _point(self, point: Point, _: Ray) -> None:
        self._points.append(point)
        self._draw_points()

    def _clear(self) -> None:
        self._points.clear()
        self._draw_points()

    def _draw_points(self) -> None:
        """Numbers the points in the scan, joins them by lines, and lists their places and distances."""
        remove_nodes(self._marks)
        scene = self._client.scene
        for number, (x, y, z) in enumerate(self._points, start=1):
            self._marks.append(add_ball(self._client, f"/points/{number}", _BALL, (x, y, z)))
            self._marks.append(scene.add_label(f"/numbers/{number}", str(number), position=(x, y + _LABEL_UP, z)))
        if len(self._points) > 1:
            ends = np.array([self._points[:-1], self._points[1:]], np.float32).transpose(1, 0, 2)
            self._marks.append(scene.add_line_segments("/lines", ends, _RGB, thickness=3.0, thickness_units="screen"))
        self._texts.content = panel_html(_points_html(self._points, self._shown))

    def _put_robot(self) -> None:
        navigation = self._shown.navigation
        place = navigation.snap(np.array(self._points[-1])) if navigation is not None and self._points else None
        if place is not None:
            self._start(place)

    def _start(self, place: NDArray[np.float64]) -> None:
        assert self._shown.navigation is not None, "no robot without floor"
        x, y, z = place.tolist()
        self._env = PanEnv(Pose((x, y, z), 0.0), self._shown.navigation, renderer=None, max_steps=sys.maxsize)
        self._draw_robot()

    def _move(self, action: Action) -> None:
        assert self._env is not None, "no robot without floor"
        self._env.move(action)
        self._draw_robot()

    def _draw_robot(self) -> None:
        assert self._env is not None, "no robot without floor"
        pose = self._env.pose
        self._walker.show(pose, _RGB)
        data = base64.b64encode(jpeg_bytes(self._shown.picture(pose))).decode()
        steps = self._env.steps
        bumped = "; blocked" if steps and steps[-1].collided else ""
        x, y, z = pose.position
        turned = math.degrees(pose.yaw) % 360
        where = f"step {len(steps)}{bumped}: x {x:.2f}, y {y:.2f}, z {z:.2f} m, turned {turned:.0f}°"
        self._picture.content = panel_html(
            f'<img src="data:image/jpeg;base64,{data}" alt="What the robot sees" style="width:100%">'
            f'<p class="robot">{where}</p>'
        )


def _points_html(points: list[Point], shown: ShownScan) -> str:
    """A table of the points: places, and from the one before the straight way, the way seen from above and on foot."""
    if not points:
        return "<p>Click the scan to read a place and to measure from point to point.</p>"
    rows = []
    for number, point in enumerate(points, start=1):
        x, y, z = point
        ways = ["", "", ""]
        if number > 1:
            before = points[number - 2]
            on_foot = shown.walk(before, point)
            planar = math.hypot(x - before[0], z - before[2])
            ways = [f"{math.dist(before, point):.2f}", f"{planar:.2f}", "-" if on_foot is None else f"{on_foot:.2f}"]
        cells = [str(number), f"{x:.2f}", f"{y:.2f}", f"{z:.2f}", *ways]
        rows.append(f"<tr>{''.join(f'<td class=n>{cell}</td>' for cell in cells)}</tr>")
    heads = ("", "x", "y", "z", "straight", "planar", "on foot")
    head = "".join(f"<th class=n>{name}</th>" for name in heads)
    return f"<table class=points><tr>{head}</tr>{''.join(rows)}</table><p class=dim>Metres, y up, as in Habitat.</p>"
