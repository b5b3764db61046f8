"""VLFM's agent in homes: it looks around, explores by value, walks to a detected thing and stops there."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.explore import start_on_storey
from grounding.agents.vlfm.agent import Values, VlfmAgent
from grounding.perception.protocol import Perception
from sim.errors import AgentError
from sim.frames import T_world_camera, planar_distance
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene, SceneObject
from sim.render.raycast import Raycaster
from sim.tasks.observers import Detection
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera, Frame, Observation, Pose, Task

from ..sim import plans
from .two_rooms import two_room_scene

CAMERA = Camera(320, 240)
START = Pose((1.0, 0.0, 1.0), yaw=0.5)
TASK = Task("pan", "Ada owns a small cup.", ("Find Ada's cup",))
NEVER = 999


class IdsOfTarget:
    """Sees the target by its id: one box around its pixels; the picture fits the text the better, the more are seen."""

    def __init__(self, env: PanEnv, scene: Scene, target: int) -> None:
        self._env, self._renderer, self._target = env, Raycaster(scene.mesh), target
        self.queries: list[str] = []
        self.texts: list[str] = []

    def frame_of(self, observation: Observation) -> Frame:
        frame = self._renderer.render(T_world_camera(self._env.pose, observation.camera), observation.camera)
        return dataclasses.replace(frame, T_world_camera=observation.T_start_camera)

    def score(self, frame: Frame, texts: Sequence[str]) -> NDArray[np.float32]:
        self.texts = list(texts)
        return np.full(len(texts), (frame.instance_ids == self._target).mean() - 0.5, np.float32)

    def set_query(self, text: str) -> None:
        self.queries.append(text)

    def detect(self, frame: Frame) -> list[Detection]:
        rows, cols = np.nonzero(frame.instance_ids == self._target)
        if not len(rows):
            return []
        box = (float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1))
        return [Detection("cup", box, 0.9)]

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        return frame.instance_ids == self._target

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        raise AssertionError("VLFM needs no patches")

    @property
    def perception(self) -> Perception:
        return Perception("ids", self.frame_of, self, self, self, self)  # type: ignore[arg-type]  # no encoder


Walk = tuple[list[Action], PanEnv, VlfmAgent, IdsOfTarget]


def walked(
    scene: Scene,
    target: int,
    *,
    start: Pose = START,
    max_steps: int = 500,
    values: Values = "pictures",
) -> Walk:
    env = PanEnv(start, scene.navigation, renderer=Raycaster(scene.mesh), camera=CAMERA, max_steps=max_steps)
    eyes = IdsOfTarget(env, scene, target)
    agent = VlfmAgent(eyes.perception, lambda task: "small|tiny cup", values=values)
    agent.reset(dataclasses.replace(TASK, max_steps=max_steps), CAMERA, seed=0)
    observation, actions = env.reset(), []
    while not env.is_over:
        actions.append(agent.act(observation))
        observation = env.step(actions[-1])
    if env.end_reason == "stop":
        _require_reason_to_stop(agent, observation)
    return actions, env, agent, eyes


def _require_reason_to_stop(agent: VlfmAgent, observation: Observation) -> None:
    """STOP only with points of the target whose middle is at most 1.5 m away, or when no frontier can be reached."""
    shown = agent.insight()
    if "none of which can be reached" in shown.note:
        return
    assert shown.candidates is not None
    assert shown.goal is not None
    assert len(shown.candidates) > 0
    x, _, z = shown.goal
    assert math.dist((observation.gps[1], -observation.gps[0]), (x, z)) <= 1.5


def thing_in_east_room() -> tuple[Scene, SceneObject]:
    scene = scene_from_plan(plans.two_rooms(plans.piece("cup_1", (6.5, 0.4, 3.0), (0.2, 0.8, 0.2)), name="CupHome"))
    (cup,) = (item for item in scene.objects if item.name == "cup_1")
    return scene, cup


def test_it_turns_left_twelve_times_then_finds_a_thing_in_the_next_room_and_stops_beside_it() -> None:
    scene, cup = thing_in_east_room()
    actions, env, agent, eyes = walked(scene, cup.instance_id)
    assert actions[:12] == [Action.LEFT] * 12
    assert actions[12:24] != [Action.LEFT] * 12
    assert (env.end_reason, actions[-1]) == ("stop", Action.STOP)
    away = [planar_distance(pose.position, cup.centre) for pose in env.poses[:-1]]
    assert away[-1] < 0.8 < min(away[:-1]), "STOP as soon as the cup is within reach"
    assert eyes.queries == ["small|tiny cup"]
    assert eyes.texts == ["Seems like there is a small/tiny cup ahead."]
    shown = agent.insight()
    assert shown.goal is not None
    assert shown.candidates is not None
    assert shown.similarity is not None
    assert 0 < len(shown.candidates) <= 100
    assert "m away" in shown.note
    at = env.pose.position
    assert math.dist((agent.insight().goal or (0, 0, 0))[::2], start_xz(at)) < 0.9
    assert np.nanmax(shown.similarity) < 0, "cosines may all be negative"


def test_the_control_by_distance_compares_no_picture_with_the_text_and_finds_the_thing_by_the_same_detector() -> None:
    scene, cup = thing_in_east_room()
    actions, env, agent, eyes = walked(scene, cup.instance_id, values="distance")
    assert actions[:12] == [Action.LEFT] * 12
    assert (env.end_reason, eyes.texts) == ("stop", [])
    assert planar_distance(env.pose.position, cup.centre) < 1.0
    similarity = agent.insight().similarity
    assert similarity is not None
    assert np.isnan(similarity).all()


def start_xz(position: tuple[float, float, float]) -> tuple[float, float]:
    """(x, z) of a world position in the start frame."""
    dx, dz = position[0] - START.position[0], position[2] - START.position[2]
    cos, sin = math.cos(START.yaw), math.sin(START.yaw)
    return dx * cos - dz * sin, dx * sin + dz * cos


def test_without_a_detection_it_explores_both_rooms_and_stops_when_no_frontier_is_left() -> None:
    actions, env, agent, _ = walked(two_room_scene(), NEVER)
    assert actions[-1] is Action.STOP
    assert len(actions) < 500
    assert max(pose.position[0] for pose in env.poses) > 4.5, "it has been in the east room"
    assert "none of which can be reached" in agent.insight().note
    similarity = agent.insight().similarity
    assert similarity is not None
    assert np.nanmin(similarity) == pytest.approx(-0.5), "frontiers of equal value: exploration alone"
    assert np.nanmax(similarity) == pytest.approx(-0.5)


def test_a_thing_seen_while_looking_around_does_not_end_the_look() -> None:
    scene = scene_from_plan(plans.two_rooms(plans.piece("cup_1", (3.0, 0.4, 2.6), (0.4, 0.8, 0.4)), name="NearCup"))
    (cup,) = (item for item in scene.objects if item.name == "cup_1")
    actions, env, _, _ = walked(scene, cup.instance_id, max_steps=60)
    assert actions[:12] == [Action.LEFT] * 12
    assert actions[-1] is Action.STOP
    assert len(actions) < 40
    assert planar_distance(env.pose.position, cup.centre) < 1.2


def test_the_end_of_the_steps_ends_the_episode_without_an_error() -> None:
    actions, env, _, _ = walked(two_room_scene(), NEVER, max_steps=20)
    assert (len(actions), env.end_reason) == (20, "steps")


def test_a_view_without_pictures_is_refused() -> None:
    scene = two_room_scene()
    env = PanEnv(START, scene.navigation, renderer=None, camera=CAMERA)
    agent = VlfmAgent(IdsOfTarget(env, scene, NEVER).perception, lambda task: "cup")
    agent.reset(TASK, CAMERA, seed=0)
    with pytest.raises(AgentError, match="has no picture; expected colours and depth"):
        agent.act(env.reset())


@pytest.mark.slow
def test_it_finds_a_thing_in_an_invented_home() -> None:
    scene = scene_from_plan(invent_plan("Invented3", seed=3))
    start = start_on_storey(scene, scene.navigation.storey_heights[0], 0)
    fitting = [item for item in scene.objects if 0.3 < max(item.size[0], item.size[2]) < 0.7 and item.size[1] > 0.4]
    thing = sorted(fitting, key=lambda item: item.name)[2]
    actions, env, _, _ = walked(scene, thing.instance_id, start=start)
    assert 12 < len(actions) < 500
    assert env.end_reason == "stop"
    assert planar_distance(env.pose.position, thing.centre) <= 1.0
