"""Grounders that ask a chat model, with a model whose answers the test writes."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from grounding.agents.key_frames import key_views
from grounding.chat.protocol import NoAnswer, Part
from grounding.checks import check_grounder
from grounding.maps.home_map import Memory, ObjectInstance, ObjectMap, OccupancyGrid
from grounding.methods.by_name import make_grounder, takes_objects
from grounding.methods.chat_grounders import CHAT_METHODS, numbered_things, things_json
from grounding.methods.map_picture import numbered_map
from grounding.types import Grounding
from sim.errors import AgentError
from sim.types import Camera, Frame, GridSpec, Task

from .toy_maps import ToyEncoder, toy_map, vector

ENCODER = ToyEncoder()
TASK = Task("pog", "Mira owns the red chair. Tom owns the sofa.", ("Find Mira's chair",))


class Scripted:
    """A chat model that gives one answer and keeps the questions."""

    name = "scripted"

    def __init__(self, answer: str | Callable[[str], str]) -> None:
        self.answer = answer
        self.asked: list[tuple[str, list[Part]]] = []

    def ask(self, system: str, parts: Sequence[Part], *, is_json: bool = False) -> str:
        assert is_json
        self.asked.append((system, list(parts)))
        words = "\n".join(part for part in parts if isinstance(part, str))
        return self.answer if isinstance(self.answer, str) else self.answer(words)


def thing(x: float, z: float, caption: str, **weights: float) -> ObjectInstance:
    corners = np.array([[x - 0.25, 0.5, z - 0.5], [x + 0.25, 1.5, z + 0.5]], np.float32)
    return ObjectInstance(corners, vector(weights).astype(np.float32), caption, 2.0)


THINGS = ObjectMap(
    (
        thing(-1.0, 3.0, "blue chair", chair=1.0),
        thing(2.0, 0.0, "red chair", chair=0.8, lamp=1),
        thing(0.0, 1.0, "sofa", sofa=1.0),
    ),
    0.5, "toy", ENCODER.dim, (0.0, 0.0), 0.1,
)  # fmt: skip
FLOOR = OccupancyGrid(np.array([[1, 1, 2], [1, 0, 2]], np.uint8), GridSpec((-2.0, -1.0), 2.0, (2, 3)))


def frame(*, depth: float = 2.0, position: tuple[float, float, float] = (1.0, 1.38, 5.0)) -> Frame:
    """A view along -z (north) with the same depth in each pixel, 88 cm above the floor at 0.5 m."""
    T_world_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    T_world_camera[:3, 3] = position
    camera = Camera(width=40, height=30, measured=(20.0, 20.0, 20.0, 15.0))
    return Frame(np.zeros((30, 40, 3), np.uint8), np.full((30, 40), depth, np.float32), T_world_camera, camera)


class Home:
    """Floors and frames as a test gives them."""

    def __init__(self, *frames: Frame) -> None:
        self.frames = frames

    def floors(self, memory: Memory) -> Sequence[tuple[float, OccupancyGrid]]:
        return [(memory.floor_y, FLOOR)]

    def key_frames(self, memory: Memory) -> Sequence[Frame]:
        return self.frames


def ground(method: str, chat: Scripted, home: Home | None = None) -> Grounding:
    memory = THINGS if takes_objects(method) else toy_map({(0, 0): {"chair": 1.0}, (4, 4): {"sofa": 1.0}})
    return make_grounder(method, ENCODER, chat=chat, seen=home or Home(frame())).ground(memory, TASK, ())


@pytest.mark.parametrize("method", ["object-list-llm", "map-image-vlm"])
def test_the_named_things_are_answered_in_order_on_the_floor(method: str) -> None:
    chat = Scripted('<think>{2}</think>```json\n{"ids": [2, 1, 2, 9], "why": "red"}\n```')
    found = ground(method, chat)
    assert [each.position for each in found.candidates] == [(2.0, 0.5, 0.0), (-1.0, 0.5, 3.0)]
    assert not found.fell_back
    assert len(chat.asked) == 1


def test_the_list_holds_numbers_places_sizes_and_the_words_of_perception() -> None:
    chat = Scripted('{"ids": [1]}')
    ground("object-list-llm", chat)
    ((_, (question, things)),) = chat.asked
    assert question == "Description: Mira owns the red chair. Tom owns the sofa.\n\nQuery: Find Mira's chair"
    assert isinstance(things, str)
    assert json.loads(things)[1] == {
        "id": 2, "caption": "red chair", "x": 2.0, "z": 0.0, "height": 0.5, "size": [0.5, 1.0, 1.0],
    }  # fmt: skip


def test_the_map_shows_each_number_at_its_thing_above_the_floor() -> None:
    picture, view = numbered_map(numbered_things(THINGS), FLOOR)
    assert picture.shape == (view.height, view.width, 3)
    right, down = view.pixels((2.0, 0.0)).tolist()
    label = picture[int(down) - 6 : int(down) + 6, int(right) - 4 : int(right) + 4]
    assert (label == (255, 255, 210)).all(axis=2).any()
    assert (label == (0, 0, 0)).all(axis=2).any()
    assert tuple(picture[tuple(reversed(view.pixels((-1.0, 0.9)).astype(int).tolist()))]) == (255, 255, 255)
    assert tuple(picture[tuple(reversed(view.pixels((2.5, 2.0)).astype(int).tolist()))]) == (90, 90, 90)


def test_a_pixel_of_a_frame_is_lifted_by_its_depth_to_the_floor_below() -> None:
    chat = Scripted('{"places": [{"frame": 2, "x": 30, "y": 10}]}')
    found = ground("frames-vlm", chat, Home(frame(), frame(depth=3.0)))
    # 10.5 pixels right of the middle at 3 m: 3 * 10.5 / 20 = 1.575 m to the right of x = 1, 3 m north of z = 5
    assert found.candidates[0].position == pytest.approx((2.575, 0.5, 2.0))
    assert not found.fell_back
    ((_, parts),) = chat.asked
    words = [part for part in parts if isinstance(part, str)]
    assert words[1:] == ["Frame 1, 40 pixels wide and 30 high:", "Frame 2, 40 pixels wide and 30 high:"]


def test_a_pixel_without_depth_counts_by_the_nearest_with_depth() -> None:
    depth = np.full((30, 40), 2.0, np.float32)
    depth[8:13, 28:33] = 0
    view = frame()
    holed = Frame(view.rgb, depth, view.T_world_camera, view.camera)
    found = ground("frames-vlm", Scripted('{"places": [{"frame": 1, "x": 30, "y": 12}]}'), Home(holed))
    assert found.candidates[0].position == pytest.approx((2.05, 0.5, 3.0))


BAD = {
    "object-list-llm": [
        "", "no", '{"ids": []}', '{"ids": [0]}', '{"ids": [1, 4]}', '{"ids": [1', '{"ids": ["red"]}', '{"id": 1}',
    ],
    "map-image-vlm": ['{"ids": [4]}'],
    "frames-vlm": [
        '{"places": [{"frame": 0, "x": 1, "y": 1}]}', '{"places": [{"frame": 2, "x": 1, "y": 1}]}',
        '{"places": [{"frame": 1, "x": 41, "y": 1}]}', '{"places": [{"frame": 1, "x": -1, "y": 1}]}',
        '{"places": [{"frame": 1, "x": NaN, "y": 1}]}', '{"places": []}', '{"frame": 1}',
    ],
}  # fmt: skip


@pytest.mark.parametrize(("method", "answer"), [(method, answer) for method, all_ in BAD.items() for answer in all_])
def test_answers_that_cannot_be_used_leave_the_question_to_a_method_without_a_model(method: str, answer: str) -> None:
    found = ground(method, Scripted(answer))
    other = "object-phrase" if takes_objects(method) else "phrase"
    memory = THINGS if takes_objects(method) else toy_map({(0, 0): {"chair": 1.0}, (4, 4): {"sofa": 1.0}})
    by_rules = ("Mira owns the red chair", "Tom owns the sofa")
    assert found.fell_back
    assert found.candidates == make_grounder(other, ENCODER).ground(memory, TASK, by_rules).candidates


@pytest.mark.parametrize("method", CHAT_METHODS)
def test_chat_grounders_keep_the_contract(method: str) -> None:
    chat = Scripted('{"places": [{"frame": 1, "x": 9, "y": 9}]}' if method == "frames-vlm" else '{"ids": [1]}')
    assert check_grounder(lambda encoder: make_grounder(method, encoder, chat=chat, seen=Home(frame()))) == []


@pytest.mark.parametrize("method", CHAT_METHODS)
def test_a_model_without_an_answer_leaves_the_question_too(method: str) -> None:
    def silent(_: str) -> str:
        raise NoAnswer("HTTP 500")

    assert ground(method, Scripted(silent)).fell_back


@pytest.mark.parametrize("method", CHAT_METHODS)
def test_without_a_model_only_properties_are_told(method: str) -> None:
    grounder = make_grounder(method, ENCODER)
    assert not grounder.uses_phrases, "no phrase of the dataset reaches a model"
    with pytest.raises(AgentError, match="Give --llm-url and --llm-model"):
        grounder.ground(THINGS, TASK, ())


def test_a_map_without_words_is_refused() -> None:
    silent = ObjectMap((thing(0, 0, "", chair=1.0),), 0.5, "toy", ENCODER.dim, (0.0, 0.0), 0.1)
    with pytest.raises(AgentError, match="none of the map's 1 objects has a caption"):
        make_grounder("object-list-llm", ENCODER, chat=Scripted("")).ground(silent, TASK, ())


def test_key_views_are_those_that_add_most() -> None:
    """Views 0 and 1 are the same, view 3 looks at less, and view 2 at another place."""
    views = [frame(), frame(), frame(position=(9.0, 1.38, 5.0)), frame(depth=0.5), frame(depth=9.0)]
    assert key_views(views, most=2) == [0, 2]
    assert key_views(views, most=9) == [0, 2, 3], "views that add nothing, and far ones, are left out"


def test_things_of_several_storeys_name_their_own_and_their_height_above_its_floor() -> None:
    upstairs = replace(THINGS.objects[0], points=THINGS.objects[0].points + np.float32([0, 3, 0]))
    listed = json.loads(things_json(replace(THINGS, objects=(*THINGS.objects, upstairs), upper_floors=(3.5,))))
    assert [entry["storey"] for entry in listed] == [1, 1, 1, 2]
    assert listed[3]["height"] == listed[0]["height"]
    assert "storey" not in json.loads(things_json(THINGS))[0]
