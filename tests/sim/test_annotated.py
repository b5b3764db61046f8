"""Homes made of annotations: boxes become goals, and objects that no episode can ask for are left out with a reason."""

import numpy as np
import pytest

from sim.authoring.annotated import home_from_annotations, phrase_of
from sim.authoring.annotations import AnnotatedObject, Box
from sim.authoring.searches import Style, draw_searches, storeys_for
from sim.errors import DatasetError
from sim.mesh import Scene
from sim.types import SPLITS
from sim.walk.floor_grid import floor_grid_from_mesh

from .meshes import box, floor, mesh_of

CRATE = (0.4, 0.5, 0.4)


def crate(number: int, x: float, z: float, **changes: object) -> AnnotatedObject:
    colour = ("red", "blue", "green", "white", "black", "brown", "pink")[number % 7]
    values = {
        "id": number,
        "category": ("crate", "stool", "desk", "lamp", "basket", "shelf", "bench")[number % 7],
        "captions": (f"A {colour} thing of wood.",),
        "room": "hall",
        "box": Box(centre=(x, 0.25, z), size=CRATE),
    }
    return AnnotatedObject.model_validate({**values, **changes})


@pytest.fixture(scope="module")
def hall() -> Scene:
    """A hall of 14 x 4 m with a crate every 2 m."""
    crates = [quad for x in range(1, 14, 2) for quad in box((x - 0.2, 0.0, 1.8), (x + 0.2, 0.5, 2.2))]
    mesh = mesh_of(floor(0, 0, 14, 4), *crates)
    return Scene("Hall", "scan", mesh, (), floor_grid_from_mesh(mesh), mesh.digest())


def crates() -> list[AnnotatedObject]:
    return [crate(number, 2 * number - 1, 2.0) for number in range(1, 8)]


def test_boxes_become_goals_with_view_points_and_words(hall: Scene) -> None:
    home = home_from_annotations(hall, crates(), scene_id="scans/Hall.glb")
    assert list(home.things) == ["stool_1", "desk_2", "lamp_3", "basket_4", "shelf_5", "bench_6", "crate_7"]
    assert home.left_out == ()
    assert home.storeys == {"0": "ground floor"}
    thing = home.things["stool_1"]
    assert (thing.phrase, thing.room, thing.captions) == (
        "blue thing of wood",
        "hall",
        ("A blue thing of wood.", "", ""),
    )
    assert thing.goal.position == (1.0, 0.25, 2.0)
    places = np.array([point.agent_state.position for point in thing.goal.original_view_points])
    assert len(places) > 8
    assert np.hypot(*(places - thing.goal.position)[:, [0, 2]].T).max() <= 1.0


def test_objects_without_words_or_places_are_left_out_with_the_reason(hall: Scene) -> None:
    objects = [
        crate(1, 1, 2, captions=()),
        crate(2, 3, 2, room=""),
        crate(3, 30, 2),
        crate(4, 7, 2),
        crate(11, 9, 2, captions=("a black thing of wood",)),
        crate(5, 11, 2, storey=1),
        crate(6, 13, 2, captions=("NOTE: ask Bo",)),
    ]
    home = home_from_annotations(hall, objects, scene_id="Hall.glb")
    assert home.left_out == (
        "stool_1 has no caption yet",
        "desk_2 has no room yet",
        "lamp_3 is seen from no place that a robot can reach",
        "basket_4 has the words of another object",
        "basket_11 has the words of another object",
        "bench_6 has a note as its caption",
    )
    assert list(home.things) == ["shelf_5"]


def test_an_object_on_another_floor_than_it_says_is_left_out() -> None:
    ground = [quad for x in (1, 3, 5) for quad in box((x - 0.2, 0.0, 1.8), (x + 0.2, 0.5, 2.2))]
    above = [quad for x in (1, 3) for quad in box((x - 0.2, 3.0, 1.8), (x + 0.2, 3.5, 2.2))]
    levels = [floor(0, 0, 6, 4, y=height) for height in (0.0, 3.0, 5.8)]  # ground, first floor, roof
    mesh = mesh_of(*levels, *ground, *above)
    scene = Scene("Two", "scan", mesh, (), floor_grid_from_mesh(mesh), mesh.digest())
    upstairs = [
        crate(number, x, 2, storey=1, box=Box(centre=(x, 3.25, 2), size=CRATE)) for number, x in ((4, 1), (5, 3))
    ]
    objects = [crate(1, 1, 2), crate(2, 3, 2), crate(3, 5, 2, storey=1), *upstairs]
    home = home_from_annotations(scene, objects, scene_id="Two.glb")
    assert home.left_out == ("lamp_3 is said to be on storey 1, but is on the floor of 0",)
    assert home.storeys == {"0": "ground floor", "1": "first floor"}


def test_all_splits_are_drawn_in_a_hall_and_too_few_objects_name_the_rule(hall: Scene) -> None:
    home = home_from_annotations(hall, crates(), scene_id="Hall.glb")
    drawn = draw_searches(home, dict.fromkeys(SPLITS, 2), rng=np.random.default_rng(0), style=Style(starts="released"))
    assert [len(drawn[split]) for split in SPLITS] == [2, 2, 2]
    assert {record.scene_id for records in drawn.values() for record in records} == {"Hall.glb"}
    few = home_from_annotations(hall, crates()[:4], scene_id="Hall.glb")
    assert storeys_for(few, "medium") == ["0"]
    with pytest.raises(
        DatasetError, match=r"split 'hard' cannot be made, ground floor: every object is owned: found 4"
    ):
        storeys_for(few, "hard")
    with pytest.raises(DatasetError, match=r"301 episodes of split 'easy'; expected 0 to 300"):
        draw_searches(home, {"easy": 301}, rng=np.random.default_rng(0), style=Style())


@pytest.mark.parametrize(
    ("caption", "phrase"),
    [
        ("A red lamp near the door.", "red lamp near the door"),
        ("red lamp", "red lamp"),
        ("The wooden chair. It is near the window!", "wooden chair, it is near the window"),
        ("TV on the wall.", "TV on the wall"),
        ("An oak desk; the lamp on it is red", "oak desk, the lamp on it is red"),
    ],
)
def test_captions_become_phrases(caption: str, phrase: str) -> None:
    assert phrase_of(caption) == phrase
