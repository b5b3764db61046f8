"""Logs one running episode or exploration: gathers rows and sends them together, because each call of Rerun costs."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.frames import T_world_agent, T_world_camera
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap, storey_map, storeys_of
from sim.render.raycast import own_cores
from sim.render.renderer import jpeg_bytes
from sim.tasks.fog import SeenArea
from sim.tasks.observers import Insight
from sim.tasks.run_files import Step
from sim.types import Observation, Pose
from sim.walk.storeys import same_storey

from . import paths
from .blueprints import live_blueprint
from .episode import (
    CENTRE_DISTANCE,
    DEPTH_FACTOR,
    DEPTH_PER_METRE,
    GOAL_DISTANCE,
    SEEN_M2,
    Row,
    Walker,
    log_figures,
    log_map_styles,
    log_plot_style,
    log_rows,
    log_styles,
    log_whole_way,
    next_row,
    set_moment,
)
from .insight import Place, log_insight, log_insight_maps, log_insight_styles, require_fits
from .maps import Resampler, seen_png
from .scene import GoalRegion, log_goal, log_storeys
from .sinks import LiveSink

SEND_S = 0.1
"""Longest time for which steps are gathered; people and most agents take longer per step, so theirs go at once."""
MAP_EVERY = 5
"""Growing maps are sent every n-th step, n being this number."""


@dataclass(slots=True)
class _Storey:
    """One storey that is shown, and the part of it that the robot has seen."""

    map: StoreyMap
    seen: SeenArea
    resampler: Resampler
    num_seen: int = -1
    """Cells that the last picture showed as seen."""


class LiveEpisode:
    """Logs one episode or exploration step by step into its own recording.

    Every method raises RecordingError where the recording cannot be written.
    """

    def __init__(
        self,
        start: Pose,
        scene: Scene,
        sink: LiveSink,
        key: paths.RecordingKey,
        walker: Walker,
        *,
        goal: GoalRegion | None,
        may_show: bool,
    ) -> None:
        """Opens the recording; nothing is logged before `start`.

        Args:
            goal: The truth of the episode: distances to it are shown from the start, the goal itself at the end. None
                for explorations, which have no goal.
            may_show: Whether geometry, maps and pictures of this home may be shown.
        """
        self._start = start
        self._scene = scene
        self._recording = sink.open(key)
        self.stream = self._recording.stream
        """The open recording, for anything else that belongs in it."""
        self._walker = walker
        self._may_show = may_show
        self._follows = sink.kind == "address"
        self._goal = goal
        self._T_world_start = T_world_agent(start)
        self._storeys: dict[int, _Storey] = {}
        self._has_depth = False
        self._explains = False
        self._shown: frozenset[str] = frozenset()
        self._unsent: list[Row] = []
        self._way: list[tuple[tuple[float, float, float], int]] = []  # feet and storeys
        self._sent_at = 0.0
        self._encoder = ThreadPoolExecutor(own_cores(), thread_name_prefix="jpeg")

    def start(self, observation: Observation) -> None:
        """Logs the home and the first moment."""
        self._has_depth = self._may_show and observation.depth_m is not None
        log_styles(self.stream, self._walker, with_depth=self._has_depth)
        rgb = self._walker.rgb
        lighter = (255 - (255 - rgb[0]) // 2, 255 - (255 - rgb[1]) // 2, 255 - (255 - rgb[2]) // 2)
        plotted = [(CENTRE_DISTANCE, "to its centre", rgb), (GOAL_DISTANCE, "to walk", lighter)]
        for name, words, color in plotted if self._walker.is_episode else [(SEEN_M2, "free floor seen", rgb)]:
            log_plot_style(self.stream, self._walker, name, words=words, rgb=color)
        self._add(self._start, None, observation)
        self._send()

    def step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        """Logs one step; the agent's insight belongs to the moment before it.

        Raises:
            AgentError: Parts of the insight do not fit together.
        """
        if insight is not None:
            require_fits(insight)
            self._explain(insight, with_maps=self._last.number % MAP_EVERY == 0)
        self._add(step.pose, step, observation)
        if time.monotonic() - self._sent_at >= SEND_S:
            self._send(waits=False)

    def end(self) -> None:
        """Logs the rows not sent yet, the whole way and the goal."""
        if self._storeys:
            self._log_seen(self._storeys[self._last.storey])
        if self._goal is not None:
            for index in sorted(set(self._goal.storeys.tolist())):
                self._show_storey(index)
        self._send()
        maps = self._maps
        positions, floors = (np.array(column) for column in zip(*self._way, strict=True))
        log_whole_way(self.stream, self._walker, positions, floors, maps)
        if self._goal is not None:
            set_moment(self.stream, self._walker, self._last)
            log_goal(self.stream, self._goal, maps)
            self.stream.reset_time()

    @property
    def _maps(self) -> list[StoreyMap]:
        """The maps of the storeys shown, from the lowest."""
        return [self._storeys[index].map for index in sorted(self._storeys)]

    def _add(self, pose: Pose, step: Step | None, observation: Observation) -> None:
        """Gathers one moment."""
        (index,) = storeys_of(np.array([pose.position[1]]), self._scene.navigation).tolist()
        storey = self._show_storey(index)
        before = None if step is None else self._last
        jpeg = depth_mm = None
        if before is not None and before.pose == pose:  # a blocked step or STOP: the view is the same
            jpeg, depth_mm = before.jpeg, before.depth_mm
        elif self._may_show:
            if observation.rgb is not None:
                jpeg = self._encoder.submit(jpeg_bytes, observation.rgb)
            if self._has_depth and observation.depth_m is not None:
                depth_mm = self._encoder.submit(_quarter, observation.depth_m)
            storey.seen.see(T_world_camera(pose, self._walker.camera), self._walker.camera, observation.depth_m)
        self._last = next_row(before, pose, index, step, jpeg=jpeg, depth_mm=depth_mm)
        self._unsent.append(self._last)
        self._way.append((pose.position, index))
        if self._last.number % MAP_EVERY == 0:
            self._log_seen(storey)

    def close(self) -> None:
        """Logs the rows not sent yet, even of an unfinished episode, and ends the recording."""
        self._send()
        self._encoder.shutdown()
        self._recording.close()

    def _send(self, *, waits: bool = True) -> None:
        """Logs the gathered rows and flushes.

        Without `waits`, rows from the first whose picture is not encoded yet stay for the next call, unless that is the
        first of all.
        """
        count = len(self._unsent)
        if not waits:
            encoded = takewhile(lambda row: row.jpeg is None or row.jpeg.done(), self._unsent)
            count = len(list(encoded)) or count
        rows, self._unsent = self._unsent[:count], self._unsent[count:]
        if rows:
            log_rows(self.stream, self._walker, rows, self._maps)
            if self._goal is not None:
                positions = np.array([row.pose.position for row in rows])
                apart = self._goal.apart(positions)
                log_figures(self.stream, self._walker, rows, CENTRE_DISTANCE, apart.min(axis=1))
                log_figures(self.stream, self._walker, rows, GOAL_DISTANCE, self._left(self._goal, positions, apart))
        self._recording.flush()
        self._sent_at = time.monotonic()

    def _left(
        self, goal: GoalRegion, positions: NDArray[np.float64], apart: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) metres to walk to the nearest place where STOP succeeds (DTG of rule `paper`); inf if there is no way.

        `apart` is `goal.apart(positions)`.
        """
        if not len(goal.places):
            return np.full(len(positions), np.inf)
        left = self._scene.navigation.distances(positions, goal.places)
        there = same_storey(positions[:, None, 1], goal.floors_y) & (apart <= goal.radii)  # (N, M)
        return np.where(there.any(axis=1), 0.0, left)

    def _show_storey(self, index: int) -> _Storey:
        """Returns the storey, and shows it from now on."""
        if index not in self._storeys:
            shown = storey_map(self._scene.navigation, index)
            resampler = Resampler(self._T_world_start, shown.grid)
            self._storeys[index] = _Storey(shown, SeenArea(shown.free, shown.grid), resampler)
            if self._may_show:
                log_storeys(self.stream, self._scene, [shown])
            log_map_styles(self.stream, self._walker, shown)
            if self._explains:
                log_insight_styles(self.stream, self._walker.label, shown)
            self._lay_out()
        return self._storeys[index]

    def _lay_out(self) -> None:
        blueprint = live_blueprint(
            self._walker,
            self._maps,
            explains=self._explains and self._may_show,
            with_depth=self._has_depth,
            follows=self._follows,
        )
        self._recording.lay_out(blueprint)

    def _log_seen(self, storey: _Storey) -> None:
        """Logs the map of the seen floor, if it has grown since the last one."""
        if not self._may_show:
            return
        seen = storey.seen.cells
        if (count := int(np.count_nonzero(seen))) == storey.num_seen:
            return
        storey.num_seen = count
        set_moment(self.stream, self._walker, self._last)
        picture = rr.EncodedImage(contents=seen_png(storey.map.free, seen), media_type="image/png", draw_order=0.0)
        self.stream.log(self._walker.entity("map", storey.map.name, "seen"), picture)
        if not self._walker.is_episode:
            self.stream.log(self._walker.entity(SEEN_M2), rr.Scalars(self._seen_m2()))
        self.stream.reset_time()

    def _seen_m2(self) -> float:
        """Square metres of free floor seen so far."""
        shown = self._storeys.values()
        return sum(float((one.seen.cells & one.map.free).sum()) * one.map.grid.cell**2 for one in shown)

    def _explain(self, insight: Insight, *, with_maps: bool) -> None:
        if not self._explains:
            self._explains = True
            for shown in self._maps:
                log_insight_styles(self.stream, self._walker.label, shown)
            self._lay_out()
        storey = self._storeys[self._last.storey]
        place = Place(self._T_world_start, self._last.pose.position[1], storey.map, storey.resampler)
        set_moment(self.stream, self._walker, self._last)
        self._shown = log_insight(self.stream, self._walker, insight, place, shown=self._shown)
        if with_maps and self._may_show:
            log_insight_maps(self.stream, self._walker.label, insight, place)
        self.stream.reset_time()


def _quarter(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Every DEPTH_FACTOR-th pixel in millimetres."""
    few = depth_m[DEPTH_FACTOR // 2 :: DEPTH_FACTOR, DEPTH_FACTOR // 2 :: DEPTH_FACTOR]
    deepest = np.float32(np.iinfo(np.uint16).max / DEPTH_PER_METRE)
    return (np.minimum(few, deepest) * np.float32(DEPTH_PER_METRE)).astype(np.uint16)
