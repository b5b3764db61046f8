"""The observer of agents and of people: each episode of one home into a recording of its own, while it happens."""

from dataclasses import dataclass

from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.observers import Insight
from sim.tasks.run_files import EpisodeRun, EpisodeStart, RunInfo, Step
from sim.types import Camera, Observation

from .live import LiveRecording, LiveSink
from .live_episode import LiveEpisode
from .log_goal import goal_region
from .log_record import log_record_end, log_record_start
from .log_run import Trace
from .log_scene import log_identity
from .log_steps import Walker
from .log_text import log_task
from .palette import RUN_COLORS
from .traces import short_name


class RerunObserver:
    """An `Observer` (sim/tasks/observers.py) of episodes in one home, on the researcher's side."""

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
        """Nothing is written before an episode begins.

        Args:
            scene: The home in which the episodes are run.
            sink: Where the recordings go.
            info: Who runs; entities and titles are named after it, as in replays.
            with_pixels: Whether geometry, maps and pictures of a licensed scan are shown; other homes need no leave.
            camera: The robot's camera.
            participant: Public code of the person who walks, None for agents.
        """
        self._scene = scene
        self._sink = sink
        self._info = info
        self._has_scan_pixels = scene.kind == "scan" and with_pixels
        self._may_show = scene.kind != "scan" or with_pixels
        self._participant = participant
        code = f"-{participant}" if participant else ""
        self._walker = Walker(
            label=f"{info.run_id}{code}",
            title=f"{short_name(info.who)}{code}",
            rgb=RUN_COLORS[0],
            camera=camera,
            is_timed=info.who_kind == "human",
        )
        self._running: tuple[Episode, LiveRecording, LiveEpisode] | None = None

    def on_reset(self, episode: Episode, observation: Observation) -> None:
        """Opens the episode's recording and shows its start; an episode that was broken off ends as it is.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        self.close()
        recording = self._sink.open(episode.key)
        stream, scene = recording.stream, self._scene
        live = LiveEpisode(
            episode.start,
            scene,
            recording,
            self._walker,
            goal=goal_region(episode, scene.navigation),
            may_show=self._may_show,
            follows=self._sink.kind == "address",
        )
        self._running = (episode, recording, live)
        log_identity(stream, episode, scene)
        log_record_start(stream, self._walker.label, self._info, self._start_of(episode))
        log_task(stream, episode, scene, [], has_scan_pixels=self._has_scan_pixels)
        live.start(observation)

    def on_step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        """Shows one step.

        Raises:
            AgentError: Parts of the insight do not fit together.
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        assert self._running is not None, "on_reset comes first"
        self._running[2].step(step, observation, insight)

    def on_end(self, run: EpisodeRun) -> None:
        """Shows the goal and the measures, and completes the recording.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        assert self._running is not None, "on_reset comes first"
        episode, recording, live = self._running
        label = self._walker.label
        live.end()
        if run.start != self._start_of(episode):
            log_record_start(recording.stream, label, self._info, run.start)
        log_record_end(recording.stream, label, run.end)
        trace = Trace(label, self._walker.title, self._walker.rgb, self._info, run)
        log_task(recording.stream, episode, self._scene, [trace], has_scan_pixels=self._has_scan_pixels)
        self.close()

    def close(self) -> None:
        """Ends the recording as it is, if there is one; a person may leave in mid-episode.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        if self._running is not None:
            _, recording, live = self._running
            self._running = None
            live.close()
            recording.close()

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
        """An observer of this scene."""
        info = RunInfo.model_validate_json(self.info_json)
        return RerunObserver(scene, self.sink, info, with_pixels=self.with_pixels)
