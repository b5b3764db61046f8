"""Shows a POG trial while it happens: the storey that a person looks at, each mark, the answer, then the goal.

Time is seconds since the trial's start: marks have no steps. The answer is also at the step of replays' answers.
"""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn

from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.run_files import Answer, ClickRay, RunInfo, Vector3

from . import paths
from .blueprints import BACKGROUND, home_eye
from .live import LiveRecording, LiveSink
from .log_goal import goal_region, log_goal
from .log_maps import POINT, StoreyMap, log_answer_on_map, log_map_picture, storey_map, storeys_of
from .log_record import log_record_answer
from .log_run import ANSWER_STEP, Rgb, Trace, log_answer, rgba_u32
from .log_scene import log_identity, log_scene
from .log_text import log_task
from .palette import RUN_COLORS

MARK_RGB: Rgb = (240, 228, 66)
"""Of marks before the answer."""
MARK = 0.08
"""Radius of a mark in the home, metres."""
MARKS, MARK_RAY, ACTIONS = "marks", "mark_ray", "actions"
"""Entities below a run."""


class _Live:
    """One running trial."""

    def __init__(self, episode: Episode, recording: LiveRecording) -> None:
        self.episode = episode
        self.recording = recording
        self.stream = recording.stream
        self.maps: dict[int, StoreyMap] = {}


class AnswerObserver:
    """Streams each POG trial of one home into a recording of its own."""

    def __init__(
        self,
        scene: Scene,
        sink: LiveSink,
        info: RunInfo,
        *,
        with_pixels: bool = False,
        participant: str | None = None,
    ) -> None:
        """Nothing is written before a trial begins.

        Args:
            scene: The home that is shown.
            sink: Where recordings go.
            info: Who answers; `run_id` names the run's entities, as in replays.
            with_pixels: Whether geometry and maps of a licensed scan are shown; other homes need no leave.
            participant: Public code of the person.
        """
        code = f"-{participant}" if participant else ""
        self._scene, self._sink, self._info = scene, sink, info
        self._label, self._title, self._rgb = f"{info.run_id}{code}", f"{info.who}{code}", RUN_COLORS[0]
        self._may_show = scene.kind != "scan" or with_pixels
        self._live: _Live | None = None

    def on_reset(self, episode: Episode) -> None:
        """Opens the trial's recording and shows the lowest storey, as people are shown first.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        self._live = None  # a broken-off one ends here
        live = self._live = _Live(episode, self._sink.open(episode.key))
        log_identity(live.stream, episode, self._scene)
        self._log_task(live, [])
        self._show_storey(live, 0)
        live.recording.flush()

    def on_storey(self, floor_y: float, t_s: float) -> None:
        """Shows which storey is looked at. Raises as `on_reset`."""
        live = self._running()
        index = self._storey_of(floor_y)
        self._show_storey(live, index)
        self._say(live, t_s, f"looks at storey {index + 1}")
        live.recording.flush()

    def on_click(self, ray: ClickRay, hit: Vector3 | None, t_s: float) -> None:
        """Shows the new mark and how the person pointed at it. Raises as `on_reset`."""
        live = self._running()
        self._say(live, t_s, "clicks beside the home" if hit is None else "marks ({:.2f}, {:.2f}, {:.2f})".format(*hit))
        if hit is not None:
            index = self._storey_of(ray.storey_y)
            self._show_storey(live, index)
            self._log_mark(live, ray, hit, live.maps[index])
        live.stream.reset_time()
        live.recording.flush()

    def on_end(self, answer: Answer) -> None:
        """Shows the answer, the goal and the measures, and ends the recording. Raises as `on_reset`."""
        live = self._running()
        stream = live.stream
        trace = Trace(self._label, self._title, self._rgb, self._info, answer)
        goal = goal_region(live.episode, self._scene.navigation)
        floors = storeys_of(trace.positions[:, 1], self._scene.navigation)
        for index in sorted({*goal.storeys.tolist(), *floors.tolist()}):
            self._show_storey(live, index)
        maps = [live.maps[index] for index in sorted(live.maps)]
        log_answer(stream, trace)
        for storey in maps:
            log_answer_on_map(stream, trace, storey, on_storey=floors == storey.index)
        self._log_task(live, [trace])
        stream.reset_time()
        stream.set_time(paths.STEP, sequence=ANSWER_STEP + 1)
        if answer.t_s is not None:
            stream.set_time(paths.TIME_S, duration=answer.t_s)
        log_goal(stream, goal, maps)
        stream.reset_time()
        log_record_answer(stream, self._label, self._info, answer)
        self._live = None
        live.recording.close()

    def _running(self) -> _Live:
        assert self._live is not None, "on_reset comes first"
        return self._live

    def _storey_of(self, floor_y: float) -> int:
        return int(storeys_of(np.array([floor_y]), self._scene.navigation)[0])

    def _log_task(self, live: _Live, traces: list[Trace]) -> None:
        has_scan_pixels = self._scene.kind == "scan" and self._may_show
        log_task(live.stream, live.episode, self._scene, traces, has_scan_pixels=has_scan_pixels)

    def _show_storey(self, live: _Live, index: int) -> None:
        """Logs a storey's home and map once, and lays it out beside those before."""
        if index in live.maps:
            return
        storey = live.maps[index] = storey_map(self._scene.navigation, index)
        if self._may_show:
            log_scene(live.stream, self._scene, storeys=[index])
            log_map_picture(live.stream, storey)
        maps = [live.maps[number] for number in sorted(live.maps)]
        live.recording.lay_out(self._blueprint(maps))

    def _say(self, live: _Live, t_s: float, text: str) -> None:
        """Sets the time to `t_s` and writes a line of the log."""
        live.stream.reset_time()
        live.stream.set_time(paths.TIME_S, duration=t_s)
        line = rr.TextLog(f"{self._title}: {text}", color=rgba_u32(self._rgb))
        live.stream.log(paths.run_path(self._label, ACTIONS), line)

    def _log_mark(self, live: _Live, ray: ClickRay, hit: Vector3, storey: StoreyMap) -> None:
        stream = live.stream
        stream.log(paths.run_path(self._label, MARKS), rr.Points3D([hit], colors=[MARK_RGB], radii=MARK))
        line = rr.LineStrips3D([[ray.camera_position, hit]], colors=[MARK_RGB], radii=MARK / 8)
        stream.log(paths.run_path(self._label, MARK_RAY), line)
        spot = rr.Points2D(storey.pixels(np.array([hit])), colors=[MARK_RGB], radii=POINT, draw_order=44.0)
        stream.log(paths.run_path(self._label, "map", storey.part, MARKS), spot)

    def _blueprint(self, maps: list[StoreyMap]) -> rrb.Blueprint:
        """Home and map of each storey that was looked at; log and task below."""
        homes = [self._home_view(storey) for storey in maps]
        plans = [self._map_view(storey) for storey in maps]
        columns = rrb.TextLogColumns(text_log_columns=[TextLogColumn("Body")])
        log = rrb.TextLogView(origin=paths.run_path(self._label, ACTIONS), name="Actions", columns=columns)
        task = rrb.TextDocumentView(origin=paths.TASK, name="Task and results")
        follows = self._sink.kind == "address"
        return rrb.Blueprint(
            rrb.Vertical(
                rrb.Horizontal(rrb.Tabs(*homes), rrb.Tabs(*plans), column_shares=[6, 5]),
                rrb.Horizontal(log, task, column_shares=[3, 4]),
                row_shares=[2, 1],
            ),
            rrb.TimePanel(state="collapsed", timeline=paths.TIME_S, play_state="following" if follows else "paused"),
            rrb.BlueprintPanel(state="hidden"),
            rrb.SelectionPanel(state="hidden"),
            auto_views=False,
            auto_layout=False,
        )

    def _home_view(self, storey: StoreyMap) -> rrb.View:
        rows, cols = storey.grid.shape
        eye = home_eye(storey, extent=max(rows, cols / 1.5) * storey.grid.cell)
        shown = [paths.run_path(self._label, name) for name in (MARKS, MARK_RAY, "candidates", "click_ray")]
        return rrb.Spatial3DView(
            origin="/",
            contents=[f"{paths.MESH}/{storey.part}/**", f"{paths.GOAL}/**", f"- {paths.GOAL}/map/**", *shown],
            name=f"Home, storey {storey.index + 1}",
            background=BACKGROUND,
            line_grid=False,
            eye_controls=eye,
        )

    def _map_view(self, storey: StoreyMap) -> rrb.View:
        below = paths.run_path(self._label, "map", storey.part)
        return rrb.Spatial2DView(
            origin=storey.entity,
            contents=[f"{storey.entity}/**", f"{paths.GOAL}/map/{storey.part}/**", f"{below}/**"],
            name=f"Map, storey {storey.index + 1}",
            background=BACKGROUND,
        )
