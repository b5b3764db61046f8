"""One browser that looks at a scan. viser's callbacks only put work on a queue; one thread does it in order."""

import base64
import html
import math
import queue
import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from sim.render.renderer import jpeg_bytes
from sim.tasks.pan import PanEnv
from sim.types import Action, Pose

from ..browse.layers import Walker, remove_nodes
from ..browse.panel_html import style_html
from ..study_app.home.surfaces import add_ball, look_from_above
from ..study_app.screens.pan import BUTTON_LABELS, HOTKEYS
from .shown import Point, ShownScan

PANEL_WIDTH = 430
"""Pixels of the panel."""
_BALL, _LABEL_UP = 0.06, 0.12
"""Radius of a point's ball, and height of its number over it (metres)."""
_RGB = (214, 0, 110)
_MOVES = tuple(action for action in BUTTON_LABELS if action is not Action.STOP)
_KEYS = (
    "window.addEventListener('keydown',e=>{if(e.repeat)e.stopImmediatePropagation()},true);"
    "document.documentElement.addEventListener('keydown',e=>{if(!e.target.closest('input,textarea'))e.stopPropagation()})"
)
"""Keys move the robot once per press, and not viser's camera, which would listen to them further out."""


class Visit:
    """State of one browser."""

    def __init__(self, client: viser.ClientHandle, shown: ShownScan) -> None:
        """Builds the panel, shows the lowest storey and starts to listen."""
        self._client, self._shown = client, shown
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._part = 0
        self._points: list[Point] = []
        self._home: list[Any] = []
        self._marks: list[Any] = []
        self._walker = Walker(client)
        self._env: PanEnv | None = None
        client.scene.configure_default_lights(True, cast_shadow=False)
        self._build()
        self._work.put(partial(self._show, 0))
        threading.Thread(target=self._obey, name=f"view {client.client_id}", daemon=True).start()

    def leave(self) -> None:
        """The browser is gone."""
        self._work.put(None)

    def _obey(self) -> None:
        """Does the work in order: a bug in one piece is shown and printed, and the next piece is done."""
        while (work := self._work.get()) is not None:
            try:
                work()
            except Exception:
                traceback.print_exc(file=sys.stderr)
                self._texts.content = _panel('<p class="warn">A bug: see the terminal.</p>')
            self._client.flush()

    def _build(self) -> None:
        gui, shown = self._client.gui, self._shown
        gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
        gui.set_panel_label(shown.name)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        gui.add_html(style_html())
        notes = "".join(f'<p class="warn">{html.escape(note)}</p>' for note in shown.notes)
        facts = f"{len(shown.mesh.faces):,} triangles, {len(shown.mesh.textures)} textures"
        gui.add_html(_panel(f"<h2>{html.escape(shown.name)}</h2><p>{facts}</p>{notes}"))
        if len(shown.parts) > 1:
            storeys = {f"Storey {index + 1}": index for index in range(len(shown.parts))}
            self._listen(gui.add_button_group("Storey", tuple(storeys)), lambda name: self._show(storeys.get(name, 0)))
        self._texts = gui.add_html("")
        self._listen(gui.add_button("Clear the points"), lambda _: self._clear())
        if shown.navigation is not None:
            self._picture = gui.add_html("")
            self._listen(gui.add_button("Put the robot at the last point"), lambda _: self._put_robot())
            for action in _MOVES:
                label, hint = BUTTON_LABELS[action]
                self._listen(gui.add_button(label, hint=hint), lambda _, action=action: self._move(action))
            for key, (_, action) in HOTKEYS.items():
                self._listen_to_key(key, action)
        gui.add_html(f'<img src="data:," style="display:none" alt="" onerror="{html.escape(_KEYS)}">')
        self._client.scene.on_click()(self._clicked)  # type: ignore[arg-type]  # viser awaits it

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        self._work.put(partial(self._point, event.ray_origin, event.ray_direction))

    def _listen(self, widget: Any, obey: Callable[[str], None]) -> None:
        @widget.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._work.put(partial(obey, str(event.target.value)))

    def _listen_to_key(self, key: str, action: Action) -> None:
        command = self._client.gui.add_command(BUTTON_LABELS[action][0], hotkey=key)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(_: object) -> None:
            self._work.put(partial(self._move, action))

    def _show(self, index: int) -> None:
        """Shows one storey from above, and puts the robot on it."""
        self._part, part = index, self._shown.parts[index]
        remove_nodes(self._home)
        self._home = [self._client.scene.add_glb("/scan", part.glb)]
        look_from_above(self._client.camera, part.low_xz, part.high_xz, part.floor_y)
        if self._shown.navigation is not None:
            place = self._shown.navigation.random_point(np.random.default_rng(0), storey_y=part.floor_y)
            self._start(place)
        self._draw_points()

    def _point(self, origin: tuple[float, float, float], direction: tuple[float, float, float]) -> None:
        point = self._shown.hit(self._part, origin, direction)
        if point is not None:
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
        self._texts.content = _panel(_points_html(self._points, self._shown))

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
        self._picture.content = _panel(
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


def _panel(content: str) -> str:
    return f'<div class="bw">{content}</div>'
