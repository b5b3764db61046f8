"""Walks of agents through an invented home for the benchmark of agents, remembered so that they can be replayed.

`walked` -> `Walk`: observations, and eyes that remember what oracle perception answered to each, so that a replayed
step costs what the agent itself costs.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grounding.agents.explore import start_on_storey
from grounding.perception.by_name import EpisodeTruth, make_perception
from grounding.perception.protocol import Perception
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.agents import Agent
from sim.tasks.observers import Detection
from sim.tasks.pan import PanEnv
from sim.types import Camera, Frame, Observation, Pose, Task

PATCHES = (24, 24, 768)
"""Rows, columns and dimensions of a picture's patches (AGENTS.md, section 2)."""
SEED = 3
_NUM_PATCHED = 4
"""Number of different patches of pictures; their values do not change what a step costs."""


class RememberedEyes:
    """Oracle perception that answers the same again for a step that it has seen; patches are random unit vectors."""

    name, dim = "remembered", PATCHES[2]

    def __init__(self, oracle: Perception) -> None:
        """Remembers nothing yet."""
        self._oracle, self._step = oracle, 0
        self._known: dict[tuple[Any, ...], Any] = {}
        rng = np.random.default_rng(SEED)
        patches = rng.standard_normal((_NUM_PATCHED, *PATCHES), np.float32)
        self._patches = patches / np.linalg.norm(patches, axis=-1, keepdims=True)
        self._text = self._patches[0, 0, :1].copy()

    def perception(self) -> Perception:
        """These eyes as all parts of a perception."""
        return Perception(self.name, self.frame_of, self, self, self, self)

    def frame_of(self, observation: Observation) -> Frame:
        self._step = observation.step
        return self._once(("frame",), lambda: self._oracle.frame_of(observation))

    def score(self, frame: Frame, texts: Sequence[str]) -> NDArray[np.float32]:
        return self._once(("score",), lambda: self._oracle.scorer.score(frame, texts))

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        return self._patches[self._step % _NUM_PATCHED][None]

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        means = self.encode_patches(frames).mean(axis=(1, 2))
        return means / np.linalg.norm(means, axis=-1, keepdims=True)

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return self._text

    def set_query(self, text: str) -> None:
        self._oracle.detector.set_query(text)

    def detect(self, frame: Frame) -> list[Detection]:
        return self._once(("boxes",), lambda: self._oracle.detector.detect(frame))

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        return self._once(("mask", detection.box), lambda: self._oracle.segmenter.mask(frame, detection))

    def _once(self, what: tuple[Any, ...], ask: Callable[[], Any]) -> Any:
        key = (self._step, *what)
        if key not in self._known:
            self._known[key] = ask()
        return self._known[key]


class Walk(NamedTuple):
    """The walk of one agent."""

    task: Task
    camera: Camera
    observations: tuple[Observation, ...]
    eyes: RememberedEyes


def bench_home() -> tuple[Scene, Pose]:
    """An invented home of one storey, and a start in it."""
    scene = scene_from_plan(invent_plan("AgentBench", seed=SEED))
    return scene, start_on_storey(scene, scene.navigation.storey_heights[0], SEED)


def walked(
    make: Callable[[Perception], Agent], scene: Scene, start: Pose, target: str, *, camera: Camera, steps: int
) -> Walk:
    """Lets an agent that sees with a perception walk for some steps, or until it stops."""
    captions = {item.instance_id: item.category for item in scene.objects}
    eyes = RememberedEyes(make_perception("oracle:mild", truth=EpisodeTruth(scene, start, captions), seed=SEED))
    task = Task("pan", target, (f"Find the {target}",), max_steps=steps)
    env = PanEnv(start, scene.navigation, renderer=Raycaster(scene.mesh), camera=camera, max_steps=steps)
    agent = make(eyes.perception())
    agent.reset(task, camera, seed=SEED)
    observations = [env.reset()]
    while not env.is_over:
        action = agent.act(observations[-1])
        observations.append(env.step(action))
    return Walk(task, camera, tuple(observations[:-1]), eyes)
