"""Records explorations: while `explore` runs, or by repeating them from their file.

An exploration has no episode, so its recording holds no goal. `explore` sees depth alone; viewers also see colours,
from a second robot that takes the same steps. Files hold poses and actions. When an exploration is repeated, the
explorer gets the same views and must choose the same actions; from the first action that differs, its frontiers and its
own map are left out and only the way is shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from grounding.agents.explore import TASK, Exploration
from grounding.agents.frontier import MAX_STEPS, FrontierExplorer
from sim.errors import RecordingError
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.plan_view.storey import storeys_of
from sim.render.renderer import Renderer
from sim.tasks.agents import Agent
from sim.tasks.observers import Explains, Insight
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Step
from sim.types import Camera, Observation, Pose

from . import paths
from .episode import Walker
from .live_episode import LiveEpisode
from .scene import log_up, may_be_shown
from .sinks import LiveSink
from .texts import home_paragraphs, log_paragraphs, plain_text, table
from .traces import RUN_COLORS

EXPLORER = "frontier"
"""Name of the explorer in its entities."""


class ExplorationObserver:
    """Shows one exploration at a time, each in its own recording, to the researcher."""

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
        """Writes nothing before the exploration begins.

        Args:
            scene: The home that is explored.
            sink: Where the recording goes.
            who: Name of the explorer; names the run's entities.
            seed: Seed of the exploration.
            with_pixels: Whether geometry, maps and pictures of a licensed scan are shown; other homes are always shown.
            camera: The robot's camera.
        """
        self._scene, self._sink, self._seed = scene, sink, seed
        self._may_show = may_be_shown(scene, with_pixels=with_pixels)
        self._walker = Walker(label=who, title=who, rgb=RUN_COLORS[0], camera=camera, is_timed=False, is_episode=False)
        self._live: LiveEpisode | None = None

    def on_reset(self, start: Pose, observation: Observation) -> None:
        """Opens the recording and shows the start; closes the recording of an unfinished exploration as it is.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        self.close()
        (storey,) = storeys_of(np.array([start.position[1]]), self._scene.navigation).tolist()
        key = paths.ExplorationKey(self._scene.name, storey, self._seed)
        scene = self._scene
        live = self._live = LiveEpisode(start, scene, self._sink, key, self._walker, goal=None, may_show=self._may_show)
        stream = live.stream
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
        assert self._live is not None, "on_reset comes first"
        self._live.step(step, observation, insight)

    def on_end(self, figures: Sequence[tuple[str, str]]) -> None:
        """Shows the whole way and its results, and completes the recording.

        Args:
            figures: (name, value) of each result in words, such as why it stopped and how much of the home it saw.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        assert self._live is not None, "on_reset comes first"
        self._live.end()
        self._log_text(figures)
        self.close()

    def close(self) -> None:
        """Ends the recording as it is, if there is one.

        Raises:
            RecordingError: The recording cannot be written, or the viewer is gone.
        """
        if self._live is not None:
            live, self._live = self._live, None
            live.close()

    def _log_text(self, figures: Sequence[tuple[str, str]]) -> None:
        assert self._live is not None
        rows = [(plain_text(name), plain_text(value)) for name, value in figures]
        parts = [
            f"**Exploration** by {plain_text(self._walker.title)}, seed {self._seed}. Nothing is looked for.",
            table(("figure", "value"), rows) if rows else "",
            "Bright on the map: floor that was seen (researcher's side). The other map is what the robot thinks: green "
            "free, brown occupied; points are frontiers, the large one is where it goes.",
        ]
        log_paragraphs(self._live.stream, [*parts, *home_paragraphs(self._scene, may_show=self._may_show)])


class WatchedExploration:
    """Shows each step as the `on_step` of grounding's `explore`; after a failure the walk goes on without it."""

    def __init__(
        self, observer: ExplorationObserver, scene: Scene, start: Pose, *, camera: Camera, renderer: Renderer | None
    ) -> None:
        """Shows nothing yet.

        Args:
            observer: Shows the exploration.
            scene: The home.
            start: Where the exploration starts.
            camera: The robot's camera.
            renderer: Draws the robot's views in colours; None = no pictures.
        """
        self._observer: ExplorationObserver | None = observer
        self._env = PanEnv(start, scene.navigation, renderer=renderer, camera=camera, max_steps=MAX_STEPS + 1)
        self._start = start
        self.problem: RecordingError | None = None
        """The error that stopped the observer; None while there is none."""

    def __call__(self, step: Step | None, insight: Insight | None) -> None:
        """Shows the first view (step None) or a step."""
        if self._observer is None:
            return
        try:
            if step is None:
                self._observer.on_reset(self._start, self._env.reset())
            else:
                self._observer.on_step(step, self._env.step(step.action), insight)
        except RecordingError as error:
            self._observer, self.problem = None, error

    def end(self, exploration: Exploration) -> None:
        """Shows the results, and completes the recording.

        Raises:
            RecordingError: Some of the exploration could not be shown.
        """
        if self.problem is not None:
            raise self.problem
        if self._observer is not None:
            self._observer.on_end(exploration_figures(exploration))


@dataclass(frozen=True, slots=True)
class ObserveExplorations:
    """Shows explorations in the place that `explore --rerun` names (a `Watch` of grounding.agents.exploration_jobs)."""

    sink: LiveSink
    with_pixels: bool = False

    def live(self, scene: Scene, start: Pose, *, seed: int, camera: Camera) -> WatchedExploration:
        """Returns an observer of an exploration that begins now."""
        observer = self._observer(scene, seed, camera)
        return WatchedExploration(observer, scene, start, camera=camera, renderer=self._renderer(scene))

    def again(self, scene: Scene, exploration: Exploration) -> None:
        """Repeats a stored exploration in a recording.

        Raises:
            RecordingError: It cannot be shown.
        """
        observer = self._observer(scene, exploration.seed, exploration.camera)
        agent, renderer = explorer_of(exploration), self._renderer(scene)
        replay_exploration(exploration, observer, scene=scene, renderer=renderer, agent=agent)

    def _observer(self, scene: Scene, seed: int, camera: Camera) -> ExplorationObserver:
        return ExplorationObserver(
            scene, self.sink, who=EXPLORER, seed=seed, with_pixels=self.with_pixels, camera=camera
        )

    def _renderer(self, scene: Scene) -> Renderer | None:
        return renderer_of(scene) if may_be_shown(scene, with_pixels=self.with_pixels) else None


def explorer_of(exploration: Exploration) -> FrontierExplorer:
    """An explorer with the settings of the exploration, which should choose the same actions again."""
    steps = len(exploration.steps) if exploration.stop_reason == "steps" else MAX_STEPS
    return FrontierExplorer(max_steps=steps)


def replay_exploration(
    exploration: Exploration,
    observer: ExplorationObserver,
    *,
    scene: Scene,
    renderer: Renderer | None,
    agent: Agent | None,
) -> int:
    """Walks an exploration again for an observer.

    Args:
        exploration: From its file.
        observer: Shows the exploration; it must have the same camera.
        scene: The home in which it was made.
        renderer: Draws the robot's views; None = no pictures, and no explorer is asked.
        agent: The explorer (`explorer_of`); None = only the way is shown.

    Returns:
        Number of first steps on which the explorer chose the same action; all steps if nothing has changed since.

    Raises:
        RecordingError: The home is a different one, or the recording cannot be written.
        AgentError: Parts of the explorer's insight do not fit together.
    """
    if (scene.name, scene.digest) != (exploration.scene, exploration.scene_digest):
        raise RecordingError(
            f"exploration: made in {exploration.scene} ({exploration.scene_digest[:12]}), found {scene.name} "
            f"({scene.digest[:12]}); expected the same home. Explore again, or open the home it was made in."
        )
    steps, camera = exploration.steps, exploration.camera
    env = PanEnv(exploration.start, scene.navigation, renderer=renderer, camera=camera, max_steps=len(steps) + 1)
    observation = env.reset()
    asked = agent if renderer is not None else None
    has_asked, num_same = asked is not None, 0
    if asked is not None:
        asked.reset(TASK, camera, seed=exploration.seed)
    observer.on_reset(exploration.start, observation)
    for step in steps:
        asked = asked if asked is not None and asked.act(observation) is step.action else None
        num_same += asked is not None
        observation = env.step(step.action)
        observer.on_step(step, observation, asked.insight() if isinstance(asked, Explains) else None)
    figures = exploration_figures(exploration)
    if has_asked and num_same < len(steps):
        text = f"chooses another action at step {num_same + 1}: nothing of it is shown from there"
        figures.append(("explorer asked again", text))
    observer.on_end(figures)
    return num_same


def exploration_figures(exploration: Exploration) -> list[tuple[str, str]]:
    """(name, value) of the results that are shown at an exploration's end."""
    figures = [
        ("stop reason", exploration.stop_reason),
        ("steps", str(len(exploration.steps))),
        ("floor seen", f"{100 * exploration.coverage[-1]:.1f} % of {exploration.area_m2:.1f} m²"),
    ]
    if exploration.num_doors is not None:
        figures.append(("doors passed", f"{exploration.doors_passed} of {exploration.num_doors}"))
    if exploration.rooms_missed is not None:
        figures.append(("rooms neither entered nor seen", _listed(exploration.rooms_missed)))
    return figures


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
