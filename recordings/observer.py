"""Observers of agents and of people, which record each episode of one home while it happens."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap, storey_map, storeys_of
from sim.tasks.observers import Insight
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun, EpisodeStart, RunInfo, Step, Vector3
from sim.types import Camera, Observation

from . import paths
from .blueprints import MARK_RAY, MARKS, trial_blueprint
from .episode import ANSWER_STEP, Walker, log_answer
from .live_episode import LiveEpisode
from .read import log_record_answer, log_record_end, log_record_start
from .scene import POINT, goal_region, log_goal, log_identity, log_storeys, may_be_shown
from .sinks import LiveRecording, LiveSink
from .texts import log_task
from .traces import RUN_COLORS, Rgb, Trace, names_of, rgba_u32

MARK_RGB: Rgb = (240, 228, 66)
"""Colour of marks before the answer."""
MARK = 0.08
"""Radius of a mark in the home, metres."""


class RerunObserver:
    """An `Observer` (sim/tasks/observers.py) that shows the episodes of one home to the researcher.

    Every method raises RecordingError where the recording cannot be written, or the viewer is gone.
    """

    def __init__(
        self,
        scene: Scene,
        sink: LiveSink,
        info: RunInfo,
        *,
        with_pixels: bool = False,
        camera: Camera = Camera(),  # noqa: B008 - frozen value
        participant: str | None = None,
    ) -> None:
        """Writes nothing before an episode begins.

        Args:
            info: The run's facts; entities and titles are named after them, as in replays.
            with_pixels: Whether geometry, maps and pictures of a licensed scan are shown; other homes are always shown.
            participant: Public code of the person who walks; None for agents.
        """
        self._scene = scene
        self._sink = sink
        self._info = info
        self._may_show = may_be_shown(scene, with_pixels=with_pixels)
        self._participant = participant
        label, title = names_of(info, participant)
        self._walker = Walker(label, title, RUN_COLORS[0], camera, is_timed=info.who_kind == "human")
        self._running: tuple[Episode, LiveEpisode] | None = None

    def on_reset(self, episode: Episode, observation: Observation) -> None:
        """Opens the episode's recording and shows its start; closes the recording of an unfinished episode as it is."""
        self.close()
        scene, goal = self._scene, goal_region(episode, self._scene.navigation)
        live = LiveEpisode(
            episode.start, scene, self._sink, episode.key, self._walker, goal=goal, may_show=self._may_show
        )
        self._running = (episode, live)
        log_identity(live.stream, episode.key, scene)
        log_record_start(live.stream, self._walker.label, self._info, self._start_of(episode))
        log_task(live.stream, episode, scene, [], may_show=self._may_show, edition=self._info.edition)
        live.start(observation)

    def on_step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        """Shows one step.

        Raises:
            AgentError: Parts of the insight do not fit together.
        """
        assert self._running is not None, "on_reset comes first"
        self._running[1].step(step, observation, insight)

    def on_end(self, run: EpisodeRun) -> None:
        """Shows the goal and the measures, and completes the recording."""
        assert self._running is not None, "on_reset comes first"
        episode, live = self._running
        walker = self._walker
        live.end()
        if run.start != self._start_of(episode):
            log_record_start(live.stream, walker.label, self._info, run.start)
        log_record_end(live.stream, walker.label, run.end)
        trace = Trace(walker.label, walker.title, walker.rgb, self._info, run)
        log_task(live.stream, episode, self._scene, [trace], may_show=self._may_show, edition=self._info.edition)
        self.close()

    def close(self) -> None:
        """Ends the recording as it is, if there is one; a person may leave in the middle of an episode."""
        if self._running is not None:
            _, live = self._running
            self._running = None
            live.close()

    def _start_of(self, episode: Episode) -> EpisodeStart:
        start, key = episode.start, episode.key
        return EpisodeStart(
            split=key.split,
            scene=key.scene,
            episode_id=key.episode_id,
            position=start.position,
            yaw=start.yaw,
            participant=self._participant,
        )


@dataclass(frozen=True, slots=True)
class ObserveRuns:
    """Makes the observer of a scene's episodes; small and comparable, so that jobs for worker processes can hold it."""

    sink: LiveSink
    info_json: str
    """The run's `RunInfo` as JSON."""
    with_pixels: bool = False

    def __call__(self, scene: Scene) -> RerunObserver:
        """Returns an observer of this scene."""
        info = RunInfo.model_validate_json(self.info_json)
        return RerunObserver(scene, self.sink, info, with_pixels=self.with_pixels)


class AnswerObserver:
    """Shows POG trials: the storey that a person looks at, each mark, the answer, then the goal.

    Time is seconds since the trial's start, because marks have no steps. The answer has the same step as in replays.
    Every method raises RecordingError where the recording cannot be written, or the viewer is gone.
    """

    def __init__(
        self,
        scene: Scene,
        sink: LiveSink,
        info: RunInfo,
        *,
        with_pixels: bool = False,
        participant: str | None = None,
    ) -> None:
        """Writes nothing before a trial begins; the arguments are those of RerunObserver."""
        self._scene, self._sink, self._info = scene, sink, info
        self._label, self._title = names_of(info, participant)
        self._rgb = RUN_COLORS[0]
        self._may_show = may_be_shown(scene, with_pixels=with_pixels)
        self._running: tuple[Episode, LiveRecording] | None = None
        self._maps: dict[int, StoreyMap] = {}

    def on_reset(self, episode: Episode) -> None:
        """Opens the trial's recording and shows the lowest storey, which people see first."""
        self._running = None  # an unfinished trial ends here
        recording = self._sink.open(episode.key)
        self._running, self._maps = (episode, recording), {}
        log_identity(recording.stream, episode.key, self._scene)
        log_task(recording.stream, episode, self._scene, [], may_show=self._may_show, edition=self._info.edition)
        self._show_storey(0)
        recording.flush()

    def on_storey(self, floor_y: float, t_s: float) -> None:
        """Shows which storey the person looks at."""
        index = self._storey_of(floor_y)
        self._show_storey(index)
        self._say(t_s, f"looks at storey {index + 1}")
        self._recording.flush()

    def on_click(self, ray: ClickRay, hit: Vector3 | None, t_s: float) -> None:
        """Shows the new mark and how the person pointed at it."""
        self._say(t_s, "clicks beside the home" if hit is None else "marks ({:.2f}, {:.2f}, {:.2f})".format(*hit))
        if hit is not None:
            index = self._storey_of(ray.storey_y)
            self._show_storey(index)
            self._log_mark(ray, hit, self._maps[index])
        self._recording.stream.reset_time()
        self._recording.flush()

    def on_end(self, answer: Answer) -> None:
        """Shows the answer, the goal and the measures, and ends the recording."""
        assert self._running is not None, "on_reset comes first"
        episode, recording = self._running
        stream, navigation = recording.stream, self._scene.navigation
        trace = Trace(self._label, self._title, self._rgb, self._info, answer)
        goal = goal_region(episode, navigation)
        for index in sorted({*goal.storeys.tolist(), *storeys_of(trace.positions[:, 1], navigation).tolist()}):
            self._show_storey(index)
        maps = [self._maps[index] for index in sorted(self._maps)]
        log_answer(stream, trace, maps, navigation)
        log_task(stream, episode, self._scene, [trace], may_show=self._may_show, edition=self._info.edition)
        stream.set_time(paths.STEP, sequence=ANSWER_STEP + 1)
        if answer.t_s is not None:
            stream.set_time(paths.TIME_S, duration=answer.t_s)
        log_goal(stream, goal, maps)
        stream.reset_time()
        log_record_answer(stream, self._label, self._info, answer)
        self._running = None
        recording.close()

    @property
    def _recording(self) -> LiveRecording:
        assert self._running is not None, "on_reset comes first"
        return self._running[1]

    def _storey_of(self, floor_y: float) -> int:
        return int(storeys_of(np.array([floor_y]), self._scene.navigation)[0])

    def _show_storey(self, index: int) -> None:
        """Logs a storey's home and map once, and adds it to the layout."""
        if index in self._maps:
            return
        storey = self._maps[index] = storey_map(self._scene.navigation, index)
        if self._may_show:
            log_storeys(self._recording.stream, self._scene, [storey])
        maps = [self._maps[number] for number in sorted(self._maps)]
        self._recording.lay_out(trial_blueprint(self._label, maps, follows=self._sink.kind == "address"))

    def _say(self, t_s: float, text: str) -> None:
        """Sets the time to `t_s` and writes a line of the log."""
        stream = self._recording.stream
        stream.reset_time()
        stream.set_time(paths.TIME_S, duration=t_s)
        line = rr.TextLog(f"{self._title}: {text}", color=rgba_u32(self._rgb))
        stream.log(paths.run_path(self._label, "actions"), line)

    def _log_mark(self, ray: ClickRay, hit: Vector3, storey: StoreyMap) -> None:
        stream = self._recording.stream
        stream.log(paths.run_path(self._label, MARKS), rr.Points3D([hit], colors=[MARK_RGB], radii=MARK))
        line = rr.LineStrips3D([[ray.camera_position, hit]], colors=[MARK_RGB], radii=MARK / 8)
        stream.log(paths.run_path(self._label, MARK_RAY), line)
        spot = rr.Points2D(storey.pixels(np.array([hit])), colors=[MARK_RGB], radii=POINT, draw_order=44.0)
        stream.log(paths.run_path(self._label, "map", storey.name, MARKS), spot)
