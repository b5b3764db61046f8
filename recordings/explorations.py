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
_NO_LIMIT = 1 << 30
"""Steps of the second robot, which follows the first."""


class WatchedExploration:
    """Shows one exploration in its own recording, as the `on_step` of grounding's `explore`.

    If the recording fails, the walk goes on without it, and `end` raises the error.
    """

    def __init__(
        self,
        scene: Scene,
        sink: LiveSink,
        start: Pose,
        *,
        seed: int,
        with_pixels: bool = False,
        camera: Camera = Camera(),  # noqa: B008 - frozen value
    ) -> None:
        """Writes nothing before the first view.

        `with_pixels` says whether geometry, maps and pictures of a licensed scan are shown; other homes are always
        shown.
        """
        self._scene, self._sink, self._start, self._seed = scene, sink, start, seed
        self._may_show = may_be_shown(scene, with_pixels=with_pixels)
        renderer = renderer_of(scene) if self._may_show else None
        self._env = PanEnv(start, scene.navigation, renderer=renderer, camera=camera, max_steps=_NO_LIMIT)
        self._walker = Walker(EXPLORER, EXPLORER, RUN_COLORS[0], camera, is_timed=False, is_episode=False)
        self._live: LiveEpisode | None = None
        self.observation: Observation | None = None
        """The robot's newest view, without pixels where these may not be shown; None before the first."""
        self.problem: RecordingError | None = None
        """The error that stopped the recording; None while there is none."""

    def __call__(self, step: Step | None, insight: Insight | None) -> None:
        """Shows the first view (step None) or a step.

        Raises:
            AgentError: Parts of the insight do not fit together.
        """
        if self.problem is not None:
            return
        try:
            if step is None:
                self.observation = self._env.reset()
                self._live = self._opened(self.observation)
            else:
                assert self._live is not None, "the first view comes first"
                self.observation = self._env.step(step.action)
                self._live.step(step, self.observation, insight)
        except RecordingError as error:
            self.problem = error

    def end(self, exploration: Exploration, *, more: Sequence[tuple[str, str]] = ()) -> None:
        """Shows the whole way, the results and (name, value) of `more` of them, and completes the recording.

        Raises:
            RecordingError: Some of the exploration could not be shown.
        """
        if self.problem is not None:
            raise self.problem
        if self._live is not None:
            self._live.end()
            self._log_text(self._live, [*exploration_figures(exploration), *more])
            self._live.close()

    def _opened(self, observation: Observation) -> LiveEpisode:
        """The open recording, which shows the start."""
        scene, start = self._scene, self._start
        (storey,) = storeys_of(np.array([start.position[1]]), scene.navigation).tolist()
        key = paths.ExplorationKey(scene.name, storey, self._seed)
        live = LiveEpisode(start, scene, self._sink, key, self._walker, goal=None, may_show=self._may_show)
        live.stream.send_recording_name(f"{key} in {scene.label}")
        facts = {"scene": scene.name, "scene_kind": scene.kind, "scene_digest": scene.digest, "seed": self._seed}
        live.stream.send_property("exploration", rr.AnyValues(explorer=EXPLORER, **facts))
        log_up(live.stream)
        self._log_text(live, [])
        live.start(observation)
        return live

    def _log_text(self, live: LiveEpisode, figures: Sequence[tuple[str, str]]) -> None:
        rows = [(plain_text(name), plain_text(value)) for name, value in figures]
        parts = [
            f"**Exploration** by {plain_text(EXPLORER)}, seed {self._seed}. Nothing is looked for.",
            table(("figure", "value"), rows) if rows else "",
            "Bright on the map: floor that was seen (researcher's side). The other map is what the robot thinks: green "
            "free, brown occupied; points are frontiers, the large one is where it goes.",
        ]
        log_paragraphs(live.stream, [*parts, *home_paragraphs(self._scene, may_show=self._may_show)])


@dataclass(frozen=True, slots=True)
class ObserveExplorations:
    """Shows explorations in the place that `explore --rerun` names (a `Watch` of grounding.agents.exploration_jobs)."""

    sink: LiveSink
    with_pixels: bool = False

    def live(self, scene: Scene, start: Pose, *, seed: int, camera: Camera) -> WatchedExploration:
        """Returns an observer of an exploration that begins now."""
        return WatchedExploration(scene, self.sink, start, seed=seed, with_pixels=self.with_pixels, camera=camera)

    def again(self, scene: Scene, exploration: Exploration) -> None:
        """Repeats a stored exploration in a recording.

        Raises:
            RecordingError: It cannot be shown.
        """
        replay_exploration(exploration, scene, self.sink, with_pixels=self.with_pixels)


def replay_exploration(
    exploration: Exploration,
    scene: Scene,
    sink: LiveSink,
    *,
    with_pixels: bool = False,
    agent: Agent | None = None,
) -> int:
    """Walks a stored exploration again, into a recording.

    The explorer is asked again: `agent`, or one with the settings of the exploration. It is not asked where pixels of a
    licensed scan may not be shown (`with_pixels`).

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
    camera, seed, steps = exploration.camera, exploration.seed, exploration.steps
    watched = WatchedExploration(scene, sink, exploration.start, seed=seed, with_pixels=with_pixels, camera=camera)
    watched(None, None)
    can_ask, num_same = may_be_shown(scene, with_pixels=with_pixels), 0
    asked = (agent or _explorer_of(exploration)) if can_ask else None
    if asked is not None:
        asked.reset(TASK, camera, seed=seed)
    for step in steps:
        if watched.problem is not None:
            break
        assert watched.observation is not None
        asked = asked if asked is not None and asked.act(watched.observation) is step.action else None
        num_same += asked is not None
        watched(step, asked.insight() if isinstance(asked, Explains) else None)
    differs = can_ask and num_same < len(steps)
    text = f"chooses another action at step {num_same + 1}: nothing of it is shown from there"
    watched.end(exploration, more=[("explorer asked again", text)] if differs else [])
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
        figures.append(("rooms neither entered nor seen", ", ".join(exploration.rooms_missed) or "none"))
    return figures


def _explorer_of(exploration: Exploration) -> FrontierExplorer:
    """An explorer with the settings of the exploration, which should choose the same actions again."""
    steps = len(exploration.steps) if exploration.stop_reason == "steps" else MAX_STEPS
    return FrontierExplorer(max_steps=steps)
