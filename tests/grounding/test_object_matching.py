"""Matching with the objects of an object map."""

from dataclasses import replace

import numpy as np
import pytest

from grounding.maps.home_map import ObjectInstance, ObjectMap
from grounding.methods.by_name import make_grounder
from sim.errors import AgentError

from .toy_maps import ToyEncoder, asks, toy_map, vector

ENCODER = ToyEncoder()
NAMES = ("object-phrase", "object-dual")
PHRASES = ("Mira owns a chair with a lamp", "Tom owns a sofa")


def thing(x: float, z: float, **weights: float) -> ObjectInstance:
    corners = np.array([[x - 0.25, 0.5, z - 0.25], [x + 0.25, 1.5, z + 0.25]], np.float32)
    return ObjectInstance(corners, vector(weights).astype(np.float32), "", 2.0)


def object_map(*things: ObjectInstance, encoder: str = "toy") -> ObjectMap:
    return ObjectMap(things, 0.5, encoder, ENCODER.dim, (1.0, 2.0), 0.1)


CHAIR, CHAIR_AND_LAMP, SOFA, BED = (
    thing(1.5, 1.0, chair=1.0),
    thing(1.25, 4.5, chair=0.8, lamp=1.0),
    thing(-2.5, 0.0, sofa=1.0),
    thing(6.0, 6.0, bed=1.0),
)


@pytest.mark.parametrize("name", NAMES)
def test_the_object_that_the_phrase_names_wins_with_its_centre_on_the_floor(name) -> None:
    answer = make_grounder(name, ENCODER).ground(
        object_map(CHAIR, CHAIR_AND_LAMP, SOFA, BED), asks("Find Mira's chair"), PHRASES
    )
    assert answer.candidates[0].position == (1.25, 0.5, 4.5)
    assert answer.candidates[1].position == (1.5, 0.5, 1.0)
    assert len(answer.candidates) == 3
    layers = answer.layers
    assert layers is not None
    assert (layers.phrases, layers.chosen) == (("a chair with a lamp", "a sofa"), 0)
    # the grid of the layers starts 1 m before x = -2.5 and z = 0.0; cells are (row of z, column of x)
    assert layers.rc.tolist() == [[2, 5], [5, 5], [1, 1], [7, 10]]
    assert layers.shape == (9, 12)
    assert layers.peaks[1, 0] == 2
    assert layers.on_grid(layers.final).shape == (9, 12)


def test_an_object_upstairs_is_answered_on_its_own_floor() -> None:
    upstairs = replace(CHAIR_AND_LAMP, points=CHAIR_AND_LAMP.points + np.float32([0, 3, 0]))
    memory = replace(object_map(CHAIR, upstairs, SOFA), upper_floors=(3.5,))
    answer = make_grounder("object-phrase", ENCODER).ground(memory, asks("Find Mira's chair"), PHRASES)
    assert [place.position for place in answer.candidates[:2]] == [(1.25, 3.5, 4.5), (1.5, 0.5, 1.0)]


def test_dual_leaves_an_object_that_two_phrases_want_to_the_phrase_that_has_no_other() -> None:
    memory = object_map(thing(0.0, 0.0, sofa=1.0, lamp=0.72), thing(4.0, 0.0, lamp=0.55, other=1.0))
    task, phrases = asks("Find Mira's lamp"), ("Mira owns a lamp", "Tom owns a sofa with a lamp")
    assert make_grounder("object-phrase", ENCODER).ground(memory, task, phrases).candidates[0].position[0] == 0.0
    assert make_grounder("object-dual", ENCODER).ground(memory, task, phrases).candidates[0].position[0] == 4.0


@pytest.mark.parametrize("name", NAMES)
def test_two_objects_in_one_cell_stay_two_answers_and_ties_go_to_the_first(name) -> None:
    memory = object_map(BED, thing(0.6, 0.6, chair=1.0), thing(0.4, 0.4, chair=1.0))
    answer = make_grounder(name, ENCODER).ground(memory, asks("Find Mira's chair"), ("Mira owns a chair",))
    assert [item.position[0] for item in answer.candidates[:2]] == pytest.approx([0.6, 0.4])
    assert answer.candidates[0].index == answer.candidates[1].index


@pytest.mark.parametrize("name", NAMES)
def test_without_a_phrase_of_the_owner_the_query_ranks_the_objects(name) -> None:
    answer = make_grounder(name, ENCODER).ground(
        object_map(CHAIR_AND_LAMP, SOFA, CHAIR), asks("Find Mira's chair"), ("Tom owns a bed",)
    )
    assert answer.candidates[0].position == (1.5, 0.5, 1.0)
    assert answer.layers is not None
    assert (answer.layers.phrases, answer.layers.chosen) == ((), -1)


@pytest.mark.parametrize("name", NAMES)
def test_a_map_without_objects_has_no_answer(name) -> None:
    assert make_grounder(name, ENCODER).ground(object_map(), asks("Find Mira's chair"), PHRASES).candidates == ()


def test_maps_of_the_wrong_kind_or_of_another_encoder_are_refused() -> None:
    grid, objects, task = toy_map({(1, 1): {"chair": 1.0}}), object_map(CHAIR), asks("Find Mira's chair")
    with pytest.raises(AgentError, match="'object-dual': got a grid map of 1 cells; expected a map of objects"):
        make_grounder("object-dual", ENCODER).ground(grid, task, PHRASES)
    for name in ("random", "center", "qs", "rpg", "dual", "joint"):
        with pytest.raises(AgentError, match=f"'{name}': got a map of 1 objects; expected a grid map"):
            make_grounder(name, ENCODER).ground(objects, task, PHRASES)
    with pytest.raises(AgentError, match="holds 6-d vectors of encoder 'strange'"):
        make_grounder("object-dual", ENCODER).ground(
            object_map(CHAIR, encoder="strange"), asks("Find Mira's chair"), PHRASES
        )
