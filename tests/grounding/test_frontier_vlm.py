"""The agent with a judge: a scripted chat model, or geometry, chooses among frontiers and things in two small rooms."""

import dataclasses
import json
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from grounding.agents.floor_memory import Ground
from grounding.agents.frontier_vlm.agent import JudgedFrontierAgent
from grounding.agents.frontier_vlm.chat_judge import ChatJudge
from grounding.agents.frontier_vlm.choices import Choices, GeometryJudge, Judge
from grounding.agents.frontier_vlm.things import Thing
from grounding.agents.frontiers import Frontier
from grounding.agents.seeking import FULL_TURN
from grounding.chat.protocol import NoAnswer, Part
from grounding.perception.protocol import Perception
from sim.errors import AgentError
from sim.frames import T_world_camera, planar_distance
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.tasks.observers import FREE, Detection
from sim.tasks.pan import PanEnv
from sim.types import Action, Camera, Frame, GridSpec, Observation, Pose, Task

from ..sim import plans

CAMERA = Camera(160, 120)
START = Pose((1.0, 0.0, 1.0), yaw=0.5)
TASK = Task("pan", "Ada owns a small cup. Tom owns a tall cup.", ("Find Ada's cup",))
NUM_QUESTIONS = 3
"""Questions of the walk to the small cup."""


class CupsById:
    """Sees cups by their ids, each with its score."""

    def __init__(self, env: PanEnv, scene: Scene, scores: dict[str, float]) -> None:
        self._env, self._renderer = env, Raycaster(scene.mesh)
        self._scores = {item.instance_id: scores[item.name] for item in scene.objects if item.name in scores}

    def frame_of(self, observation: Observation) -> Frame:
        frame = self._renderer.render(T_world_camera(self._env.pose, observation.camera), observation.camera)
        return dataclasses.replace(frame, T_world_camera=observation.T_start_camera)

    def set_query(self, text: str) -> None:
        assert text == "small cup"

    def detect(self, frame: Frame) -> list[Detection]:
        found = []
        for number, score in self._scores.items():
            rows, cols = np.nonzero(frame.instance_ids == number)
            if len(rows):
                box = (float(cols.min()), float(rows.min()), float(cols.max() + 1), float(rows.max() + 1))
                found.append(Detection("cup", box, score))
        return found

    def mask(self, frame: Frame, detection: Detection) -> NDArray[np.bool_]:
        (number,) = (number for number, score in self._scores.items() if score == detection.score)
        return frame.instance_ids == number


class ScriptedChat:
    """A `Chat` that answers by a function of the question, and keeps the questions."""

    name = "scripted"

    def __init__(self, answer: Callable[[str], str]) -> None:
        self._answer = answer
        self.questions: list[tuple[str, list[Part]]] = []

    def ask(self, system: str, parts: Sequence[Part], *, is_json: bool = False) -> str:
        self.questions.append((system, list(parts)))
        return self._answer(words_of(parts))


class Walk(NamedTuple):
    actions: list[Action]
    env: PanEnv
    agent: JudgedFrontierAgent
    notes: list[str]


def words_of(parts: Sequence[Part]) -> str:
    return "\n".join(part for part in parts if isinstance(part, str))


@lru_cache(maxsize=1)
def home() -> Scene:
    """A tall cup beside the door in the first room, and a small cup in the other room."""
    tall = plans.piece("tall_1", (3.2, 0.5, 3.4), (0.3, 1.0, 0.3))
    small = plans.piece("small_1", (5.2, 0.4, 0.8), (0.2, 0.8, 0.2))
    return scene_from_plan(plans.two_rooms(tall, small, name="TwoCups"))


def walked(
    judge: Callable[[], Judge], scores: dict[str, float], *, scene: Scene | None = None, max_steps: int = 300
) -> Walk:
    scene = scene or home()
    env = PanEnv(START, scene.navigation, renderer=Raycaster(scene.mesh), camera=CAMERA, max_steps=max_steps)
    eyes = CupsById(env, scene, scores)
    perception = Perception("ids", eyes.frame_of, eyes, eyes, eyes, eyes)  # type: ignore[arg-type]  # no encoder
    agent = JudgedFrontierAgent(perception, lambda task: "small cup", judge=judge)
    agent.reset(TASK, CAMERA, seed=0)
    observation, actions, notes = env.reset(), [], []
    while not env.is_over:
        actions.append(agent.act(observation))
        notes.append(agent.insight().note)
        observation = env.step(actions[-1])
    return Walk(actions, env, agent, notes)


@lru_cache(maxsize=1)
def walk_to_the_small_cup() -> tuple[ScriptedChat, Walk]:
    chat = ScriptedChat(best_snapshot_or_first_frontier)
    return chat, walked(lambda: ChatJudge(chat), {"tall_1": 0.95, "small_1": 0.9})


def centre_of(name: str) -> tuple[float, float, float]:
    (thing,) = (item for item in home().objects if item.name == name)
    return thing.centre


def best_snapshot_or_first_frontier(words: str) -> str:
    """The snapshot of score 0.90 if there is one."""
    found = re.search(r"Snapshot S(\d+), .* score 0\.90", words)
    return json.dumps({"snapshot": int(found[1])}) if found else '{"frontier": 1}'


def test_the_model_passes_by_the_wrong_cup_and_the_agent_stops_within_a_metre_of_the_right_one() -> None:
    chat, walk = walk_to_the_small_cup()
    assert walk.actions[:FULL_TURN] == [Action.LEFT] * FULL_TURN
    assert (walk.env.end_reason, walk.actions[-1]) == ("stop", Action.STOP)
    assert planar_distance(walk.env.pose.position, centre_of("small_1")) <= 1.0
    shown = walk.agent.insight()
    assert shown.candidate_scores == pytest.approx((0.95, 0.9))
    assert shown.frontiers is not None
    assert 1 <= len(shown.frontiers) <= 8
    assert shown.candidates is not None
    assert shown.goal == pytest.approx(tuple(shown.candidates[1]), abs=0.2)
    assert walk.notes[-1] == f"snapshot 2 of 2 by scripted ({len(chat.questions)} asked, 0 unusable)"


def test_the_model_is_asked_on_arrival_and_when_the_choices_change_and_the_same_run_asks_the_same() -> None:
    (chat, walk), again = walk_to_the_small_cup(), ScriptedChat(best_snapshot_or_first_frontier)
    assert walked(lambda: ChatJudge(again), {"tall_1": 0.95, "small_1": 0.9}).actions == walk.actions
    assert [words_of(parts) for _, parts in again.questions] == [words_of(parts) for _, parts in chat.questions]
    assert len(chat.questions) == NUM_QUESTIONS
    first_with_both = next(index for index, (_, parts) in enumerate(chat.questions) if "S2" in words_of(parts))
    assert first_with_both == NUM_QUESTIONS - 1, "a new thing is asked about at once, and then it is walked to"


def test_a_question_holds_the_task_a_map_and_pictures_of_the_choices() -> None:
    chat, _ = walk_to_the_small_cup()
    for _, parts in chat.questions:
        words = words_of(parts)
        assert words.startswith(f"Description: {TASK.description}\n\nQuery: {TASK.queries[0]}\n\nMap")
        pictures = [part for part in parts if not isinstance(part, str)]
        assert all(min(picture.shape[:2]) >= 64 and picture.shape[2:] == (3,) for picture in pictures)
        assert max(pictures[0].shape) == 512
        known = [TASK.description, TASK.queries[0], "Map of what is known so far:"]
        rest = [line for line in words.split("\n") if line and not any(text in line for text in known)]
        assert len(pictures) == 1 + len([line for line in rest if line.endswith(":")])
        forms = r"Frontier F\d, [\d.]+ m away(:|; no picture shows it\.)"
        forms += r"|Snapshot S\d, [\d.]+ m away, detected in \d+ pictures?, score \d\.\d\d:"
        assert [line for line in rest if not re.fullmatch(forms, line)] == [], "nothing of the episode or the home"


def test_a_question_shows_the_first_eight_of_ten_frontiers() -> None:
    """A map, a view towards each frontier 2 m ahead, and eight things: 17 pictures."""
    chat, grid = ScriptedChat(lambda words: '{"frontier": 8}'), GridSpec((-5.0, -5.0), 0.1, (100, 100))
    places = [(-0.85 + 0.2 * number, -1.95) for number in range(10)]
    frontiers = tuple(
        Frontier(grid.rc_from_xz(np.array([xz])), xz, float(cost), xz, xz) for cost, xz in enumerate(places)
    )
    crop, free = np.zeros((96, 96, 3), np.uint8), np.full(grid.shape, FREE, np.uint8)
    things = tuple(Thing(number, "cup", (0.0, 0.5, -1.0), 0.9, 2, crop) for number in range(8))
    ground = Ground(free, free, np.ones(grid.shape), grid)
    judge, picture = ChatJudge(chat), np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    T = T_world_camera(Pose((0.0, 0.0, 0.0), 0.0), CAMERA)
    judge.see(Frame(picture, np.full(picture.shape[:2], 5.0, np.float32), T, CAMERA))
    verdict = judge.choose(Choices(TASK, frontiers, things, ground, (0.0, 0.0, 0.0), 0.0))
    ((_, parts),) = chat.questions
    assert re.findall(r"^(?:Frontier|Snapshot) (\w+)", words_of(parts), re.MULTILINE) == [
        *("F1", "F2", "F3", "F4", "F5", "F6", "F7", "F8"),
        *("S1", "S2", "S3", "S4", "S5", "S6", "S7", "S8"),
    ]
    assert len([part for part in parts if not isinstance(part, str)]) == 17
    assert verdict.chosen is frontiers[7]


def test_a_question_shows_the_eight_things_of_nine_with_the_highest_scores() -> None:
    scores = {f"cup_{number}": 0.9 + 0.01 * number for number in range(1, 10)}
    cups = [plans.piece(name, (0.4 * k, 0.4, 3.4), (0.2, 0.8, 0.2)) for k, name in enumerate(scores, start=1)]
    chat = ScriptedChat(lambda words: '{"snapshot": 1}')
    scene = scene_from_plan(plans.two_rooms(*cups, name="NineCups"))
    walked(lambda: ChatJudge(chat), scores, scene=scene, max_steps=FULL_TURN + 1)
    ((_, parts),) = chat.questions
    shown = re.findall(r"^Snapshot S\d, .* score (\d\.\d\d):", words_of(parts), re.MULTILINE)
    assert shown == ["0.99", "0.98", "0.97", "0.96", "0.95", "0.94", "0.93", "0.92"]


@pytest.mark.parametrize("answer", ['{"frontier": 99}', '{"frontier": 1, "snapshot": 1}'])
def test_an_unusable_answer_leaves_the_choice_to_geometry_and_is_counted(answer: str) -> None:
    chat, judges = ScriptedChat(lambda words: answer), []

    def new_judge() -> ChatJudge:
        judges.append(ChatJudge(chat))
        return judges[-1]

    walk = walked(new_judge, {"small_1": 0.9})
    assert walk.actions == walked(GeometryJudge, {"small_1": 0.9}).actions
    (judge,) = judges
    assert judge.num_asked == len(chat.questions) == len(judge.unusable) > 0
    assert f"({judge.num_asked} asked, {judge.num_asked} unusable)" in walk.notes[-1]


def test_a_server_that_does_not_answer_leaves_the_choice_to_geometry() -> None:
    def fail(words: str) -> str:
        raise NoAnswer("HTTP 500")

    walk = walked(lambda: ChatJudge(ScriptedChat(fail)), {"small_1": 0.9})
    assert walk.env.end_reason == "stop"
    assert planar_distance(walk.env.pose.position, centre_of("small_1")) <= 1.0


def test_geometry_walks_to_the_thing_of_the_highest_score() -> None:
    walk = walked(GeometryJudge, {"tall_1": 0.95, "small_1": 0.9})
    assert planar_distance(walk.env.pose.position, centre_of("tall_1")) <= 1.0
    assert walk.notes[-1].startswith("the thing of the highest score, 0.95")


def test_without_a_thing_geometry_sees_both_rooms_and_stops_when_nothing_is_left() -> None:
    nearest = walked(lambda: GeometryJudge("nearest"), {})
    assert nearest.env.end_reason == "stop"
    assert max(pose.position[0] for pose in nearest.env.poses) > 3.5
    assert any(note.startswith("the nearest frontier") for note in nearest.notes)
    assert nearest.notes[-1] == "nothing is left to choose"


def test_a_view_without_pictures_is_refused() -> None:
    env = PanEnv(START, home().navigation, renderer=None, camera=CAMERA)
    eyes = CupsById(env, home(), {})
    perception = Perception("ids", eyes.frame_of, eyes, eyes, eyes, eyes)  # type: ignore[arg-type]  # no encoder
    agent = JudgedFrontierAgent(perception, lambda task: "small cup", judge=GeometryJudge)
    agent.reset(TASK, CAMERA, seed=0)
    with pytest.raises(AgentError, match="has no picture; expected colours and depth"):
        agent.act(env.reset())
