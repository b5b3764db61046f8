"""`phrase`, `dual` and their options on maps with answers computed by hand."""

import numpy as np
import pytest

from grounding.methods.baselines import QueryScoring
from grounding.methods.by_name import GrounderName, make_grounder
from grounding.methods.matching import MatchOptions, PhraseMatcher, dual_scores, smoothed
from grounding.types import Grounding
from sim.errors import AgentError

from .toy_maps import ToyEncoder, asks, toy_map, xz

ENCODER = ToyEncoder()
NAMES = ("phrase", "dual", "dual-smooth", "dual-smooth-point")
PHRASES = ("Mira owns a chair with a lamp in the hall", "Tom owns a sofa in the hall", "Tom owns a bed")
CELLS = {(1, 1): {"chair": 1.0}, (1, 6): {"chair": 0.8, "lamp": 1.0}, (4, 3): {"sofa": 1.0}, (6, 6): {"bed": 1.0}}


def spots(grounding: Grounding) -> list[tuple[float, float]]:
    return [(item.position[0], item.position[2]) for item in grounding.candidates]


def test_the_phrase_that_names_the_object_counts_more_than_the_query() -> None:
    memory, task = toy_map(CELLS), asks("Find Mira's chair")
    assert spots(QueryScoring(ENCODER).ground(memory, task, PHRASES))[0] == xz(1, 1)
    for name in NAMES:
        answer = make_grounder(name, ENCODER).ground(memory, task, PHRASES)
        assert spots(answer)[0] == pytest.approx(xz(1, 6)), name
        assert answer.layers is not None
        assert answer.layers.phrases[answer.layers.chosen] == "a chair with a lamp in the hall"
        assert answer.layers.similarity.shape == (3, 4)
        assert answer.candidates[0].position[1] == 0.5


def test_dual_scores_are_two_softmaxes_and_leave_a_cell_to_the_phrase_that_has_no_other() -> None:
    # the phrase of the lamp scores a little higher in cell 0 than in cell 1; the sofa has only cell 0
    cells = {(0, 0): {"sofa": 1.0, "lamp": 0.72}, (0, 4): {"lamp": 0.55, "other": 1.0}}
    phrases = ("Mira owns a lamp", "Tom owns a sofa with a lamp")
    memory, task = toy_map(cells), asks("Find Mira's lamp")
    assert spots(make_grounder("phrase", ENCODER).ground(memory, task, phrases))[0] == xz(0, 0)
    assert spots(make_grounder("dual", ENCODER).ground(memory, task, phrases))[0] == xz(0, 4)
    cosines = np.array([[np.log(2.0), 0.0], [0.0, np.log(3.0)]])
    # exp is [[2, 1], [1, 3]]; over cells [[2/3, 1/3], [1/4, 3/4]], over phrases [[2/3, 1/4], [1/3, 3/4]]
    expected = np.array([[4 / 9, 1 / 12], [1 / 12, 9 / 16]])
    np.testing.assert_allclose(np.exp(dual_scores(cosines, temperature=1.0)), expected)


def test_smoothing_keeps_flat_scores_and_isolated_cells_and_spreads_a_peak() -> None:
    rc = np.array([[0, 0], [0, 1], [9, 9]])
    np.testing.assert_allclose(smoothed(np.ones((1, 3)), rc, sigma=0.7), 1)
    weight = np.exp(-1 / (2 * 0.7**2))
    np.testing.assert_allclose(
        smoothed(np.array([[1.0, 0.0, 0.4]]), rc, sigma=0.7), [[1 / (1 + weight), weight / (1 + weight), 0.4]]
    )
    values = np.array([[1.0, 0.0, 0.4]])
    assert smoothed(values, rc, sigma=0.0) is values


def test_the_point_moves_towards_the_heavier_neighbour() -> None:
    cells = {
        (3, 3): {"chair": 1.0, "other": 0.1},
        (3, 4): {"chair": 1.0, "other": 0.5},
        (3, 2): {"chair": 0.3, "other": 1.0},
        (2, 3): {"other": 1.0},
    }
    grounder = PhraseMatcher(ENCODER, name="point", options=MatchOptions(beta=20.0))
    x, z = spots(grounder.ground(toy_map(cells), asks("Find Mira's chair"), ("Mira owns a chair",)))[0]
    assert xz(3, 3)[0] < x < xz(3, 3.5)[0]
    # two cells with cosines a and b: x moves by 1 / (1 + exp(20 (a - b))); the others hardly count
    a, b = 1 / np.hypot(1, 0.1), 1 / np.hypot(1, 0.5)
    assert x - xz(3, 3)[0] == pytest.approx(1 / (1 + np.exp(20 * (a - b))), abs=1e-3)
    assert z == pytest.approx(xz(3, 3)[1], abs=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_ties_go_to_the_first_cell(name) -> None:
    cells = {(5, 5): {"chair": 1.0}, (1, 6): {"chair": 1.0}, (1, 2): {"chair": 1.0}}
    answer = make_grounder(name, ENCODER).ground(toy_map(cells), asks("Find Mira's chair"), ("Mira owns a chair",))
    np.testing.assert_allclose(spots(answer), [xz(1, 2), xz(1, 6), xz(5, 5)])


@pytest.mark.parametrize("name", [*NAMES, "joint"])
@pytest.mark.parametrize(
    ("memory", "phrases"),
    [
        (toy_map(CELLS), PHRASES[::-1]),
        (toy_map(CELLS), (*PHRASES, *PHRASES)),
        (toy_map(CELLS, backwards=True), PHRASES),
        (toy_map(CELLS, shape=(20, 30), shift=7), PHRASES),
        (toy_map(CELLS), (*PHRASES, "Zoe owns a sofa in the hall")),
    ],
    ids=["phrases in another order", "phrases twice", "cells in another order", "larger empty map", "co-owner"],
)
def test_order_repetition_and_phrases_of_co_owners_change_nothing(name, memory, phrases) -> None:
    grounder, task = make_grounder(name, ENCODER), asks("Where is Mira's chair?")
    expected = spots(grounder.ground(toy_map(CELLS), task, PHRASES))
    np.testing.assert_allclose(spots(grounder.ground(memory, task, phrases)), expected, atol=1e-6)


@pytest.mark.parametrize("name", [*NAMES, "joint"])
@pytest.mark.parametrize("phrases", [(), ("Tom owns a sofa",)], ids=["no phrase", "none of the owner"])
def test_without_a_phrase_of_the_owner_the_answer_equals_that_of_qs(name, phrases) -> None:
    memory, task = toy_map(CELLS), asks("Find Mira's chair")
    answer = make_grounder(name, ENCODER).ground(memory, task, phrases)
    assert answer.candidates == QueryScoring(ENCODER).ground(memory, task, phrases).candidates


def test_negative_options_are_refused() -> None:
    with pytest.raises(AgentError, match="expected no negative value"):
        MatchOptions(sigma=-1.0)


@pytest.mark.parametrize(
    ("name", "frame"), [("rpg", "non-empty cells"), ("rpg-authors", "non-empty cells"), ("rpg-literal", "whole grid")]
)
def test_the_presets_of_rpg_are_chosen_by_name(name: GrounderName, frame: str) -> None:
    grounder = make_grounder(name, ENCODER)
    assert (grounder.name, grounder.frame) == (name, frame)
