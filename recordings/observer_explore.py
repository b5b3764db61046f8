"""Streams an exploration of a home, live or done again: what the robot sees, its map growing, frontiers and way.

An exploration has no episode: nothing of a goal is in its recording.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from sim.homes.kind import scene_label
from sim.mesh import Scene
from sim.tasks.observers import Insight
from sim.tasks.run_files import Step
from sim.types import Camera, Observation, Pose

from . import paths
from .live import LiveRecording, LiveSink
from .live_episode import LiveEpisode
from .log_maps import storeys_of
from .log_scene import log_up
from .log_steps import Walker
from .log_text import NOTICE, plain_text
from .palette import RUN_COLORS


class ExplorationObserver:
    """Shows one exploration at a time in a recording of its own, on the researcher's side."""

    def __init__(
        self,
        scene: Scene,
        sink: LiveSink,
        *,
        who: str,
        seed: int,
        with_pixels: bool = False,
        camera: Camera = Camera(),  # noqa: B008 - frozen value
    ) -> None:
        """Nothing is written before the exploration begins.

        Args:
            scene: The home that is explored.
            sink: Where the recording goes.
            who: Name of the explorer; names the run's entities.
            seed: Of the exploration.
            with_pixels: Whether geometry, maps and pictures of a licensed scan are shown; other homes need no leave.
            camera: The robot's camera.
        """
        self._scene, self._sink, self._seed = scene, sink, seed
        self._may_show = scene.kind != "scan" or with_pixels
        self._walker = Walker(label=who, title=who, rgb=RUN_COLORS[0], camera=camera, is_timed=False, is_episode=False)
        self._running: tuple[LiveRecording, LiveEpisode] | None = None

    def on_reset(self, start: Pose, observation: Observation) -> None:
        """Opens the recording and shows the start; an exploration that was broken off ends as it is.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        self.close()
        (storey,) = storeys_of(np.array([start.position[1]]), self._scene.navigation).tolist()
        key = paths.ExplorationKey(self._scene.name, storey, self._seed)
        recording = self._sink.open(key)
        live = LiveEpisode(
            start,
            self._scene,
            recording,
            self._walker,
            goal=None,
            may_show=self._may_show,
            follows=self._sink.kind == "address",
        )
        self._running = (recording, live)
        stream, scene = recording.stream, self._scene
        stream.send_recording_name(f"{key} in {scene.label}")
        facts = {"scene": scene.name, "scene_kind": scene.kind, "scene_digest": scene.digest, "seed": self._seed}
        stream.send_property("exploration", rr.AnyValues(explorer=self._walker.title, **facts))
        log_up(stream)
        self._log_text([])
        live.start(observation)

    def on_step(self, step: Step, observation: Observation, insight: Insight | None) -> None:
        """Shows one step.

        Raises:
            AgentError: Parts of the insight do not fit together.
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        assert self._running is not None, "on_reset comes first"
        self._running[1].step(step, observation, insight)

    def on_end(self, figures: Sequence[tuple[str, str]]) -> None:
        """Shows the whole way and what came of it, and completes the recording.

        Args:
            figures: (what, how much) in words, such as why it stopped and how much of the home it saw.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        assert self._running is not None, "on_reset comes first"
        self._running[1].end()
        self._log_text(figures)
        self.close()

    def close(self) -> None:
        """Ends the recording as it is, if there is one.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        if self._running is not None:
            recording, live = self._running
            self._running = None
            live.close()
            recording.close()

    def _log_text(self, figures: Sequence[tuple[str, str]]) -> None:
        assert self._running is not None
        scene = self._scene
        rows = [f"| {plain_text(name)} | {plain_text(value)} |" for name, value in figures]
        parts = [
            f"**Exploration** by {plain_text(self._walker.title)}, seed {self._seed}. Nothing is looked for.",
            "\n".join(["| figure | value |", "|---|---|", *rows]) if rows else "",
            "Bright on the map: floor that was seen (researcher's side). The other map is what the robot thinks: green "
            "free, brown occupied; points are frontiers, the large one is where it goes.",
            f"{plain_text(scene.label)}, scene digest {scene.digest[:12]}",
            f"**{label}.**" if (label := scene_label(scene.kind)) else "",
            f"_{NOTICE}_" if scene.kind == "scan" and self._may_show else "",
        ]
        text = rr.TextDocument("\n\n".join(part for part in parts if part), media_type=rr.MediaType.MARKDOWN)
        self._running[0].stream.log(paths.TASK, text, static=True)
