"""`joint` on maps with answers computed by hand, and its steps one by one."""

import numpy as np
import pytest

from grounding.methods.by_name import make_grounder
from grounding.methods.joint import JointMatcher, JointOptions, background, contrasted, household_texts, standard_scores
from grounding.types import Grounding

from .toy_maps import ORIGIN, ToyEncoder, asks, toy_map, xz

ENCODER = ToyEncoder()
GROUNDER = make_grounder("joint", ENCODER)
PHRASES = ("Mira owns a chair with a lamp in the hall", "Tom owns a sofa in the study", "Tom owns a bed in the den")
PLAIN = {(row, col): {"other": 1.0} for row in range(8) for col in range(8)}
CELLS = {
    **PLAIN,
    (1, 1): {"chair": 1.0},
    (1, 6): {"chair": 0.8, "lamp": 1.0},
    (4, 3): {"sofa": 1.0},
    (6, 6): {"bed": 1.0},
}


def spots(grounding: Grounding) -> np.ndarray:
    return np.array([(item.position[0], item.position[2]) for item in grounding.candidates])


def test_the_object_that_the_phrase_names_is_found_not_the_one_most_like_the_query() -> None:
    answer = GROUNDER.ground(toy_map(CELLS), asks("Find Mira's chair"), PHRASES)
    assert np.linalg.norm(spots(answer)[0] - xz(1, 6)) < 0.1
    assert answer.candidates[0].position[1] == 0.5
    layers = answer.layers
    assert layers is not None
    assert (layers.rc[int(np.argmax(layers.final))] == (1, 6)).all()
    assert layers.rc[layers.peaks[layers.phrases.index("a sofa in the study"), 0]].tolist() == [4, 3]


def test_an_object_across_two_cells_is_found_between_them_and_an_area_beats_a_single_cell() -> None:
    cells = {**PLAIN, (3, 3): {"chair": 1.0, "other": 0.6}, (3, 4): {"chair": 1.0, "other": 0.6}}
    answer = GROUNDER.ground(toy_map(cells), asks("Find Mira's chair"), ("Mira owns a chair",))
    assert np.linalg.norm(spots(answer)[0] - xz(3, 3.5)) < 0.35
    around = {(row, col): {"chair": 0.5, "other": 1.0} for row in (4, 5, 6) for col in (4, 5, 6)}
    cells = {**PLAIN, (1, 1): {"chair": 1.0, "other": 0.3}, **around, (5, 5): {"chair": 1.0, "other": 0.3}}
    answer = GROUNDER.ground(toy_map(cells), asks("Find Mira's chair"), ("Mira owns a chair",))
    assert np.linalg.norm(spots(answer)[0] - xz(5, 5)) < 0.1


def test_the_one_of_two_equal_places_that_is_near_an_object_of_the_same_room_wins() -> None:
    cells = {**PLAIN, (1, 1): {"chair": 1.0}, (6, 6): {"chair": 1.0}, (6, 4): {"sofa": 1.0}}
    task = asks("Find Mira's chair")
    for room, expected in {"hall": xz(6, 6), "den": xz(1, 1)}.items():
        phrases = ("Mira owns a chair in the hall", f"Tom owns a sofa in the {room}")
        first = spots(GROUNDER.ground(toy_map(cells), task, phrases))[0]
        assert np.linalg.norm(first - expected) < 0.4, room
    doubtful = JointMatcher(ENCODER, options=JointOptions(room_doubt=1.0))
    phrases = ("Mira owns a chair in the hall", "Tom owns a sofa in the hall")
    assert np.linalg.norm(spots(doubtful.ground(toy_map(cells), task, phrases))[0] - xz(1, 1)) < 0.1


def test_scores_are_probabilities_best_first_and_places_are_apart() -> None:
    answer = GROUNDER.ground(toy_map(CELLS), asks("Find Mira's chair"), PHRASES)
    scores = [item.score for item in answer.candidates]
    assert len(scores) == 3
    assert scores == sorted(scores, reverse=True)
    assert 0.5 < scores[0] <= 1
    assert sum(scores) <= 1 + 1e-9
    between = np.linalg.norm(spots(answer)[:, None] - spots(answer)[None], axis=2)
    assert (between[np.triu_indices(3, 1)] > 0.5).all()


def test_answers_are_at_the_middle_of_a_single_cell_and_of_an_area_of_fine_cells() -> None:
    answer = GROUNDER.ground(toy_map({(2, 5): {"sofa": 1.0}}), asks("Find Mira's chair"), ("Mira owns a chair",))
    np.testing.assert_allclose(spots(answer)[0], xz(2, 5))
    assert (answer.candidates[0].row, answer.candidates[0].col) == (2, 5)
    cells = {(row, col): {"other": 1.0} for row in range(16) for col in range(16)}
    patch = {(row, col): {"chair": 1.0, "other": 0.2} for row in (9, 10, 11) for col in (4, 5, 6)}
    memory = toy_map({**cells, **patch}, shape=(16, 16), cell=0.25)
    x, z = spots(GROUNDER.ground(memory, asks("Find Mira's chair"), ("Mira owns a chair",)))[0]
    assert (x, z) == pytest.approx((ORIGIN[0] + 5.5 * 0.25, ORIGIN[1] + 10.5 * 0.25), abs=0.26)


def test_contrast_background_and_standard_scores_equal_those_computed_by_hand() -> None:
    inverse = background(np.empty((0, 3)), weight=10.0, ridge=1e-6)
    freed = contrasted(np.array([[0.6, 0.8, 0.0], [1.0, 0.0, 0.0]]), inverse)
    np.testing.assert_allclose(freed[0] / np.linalg.norm(freed[0]), [0.0, 1.0, 0.0], atol=1e-5)
    # ridge 2: v alone gives v / 2; with one other text o: (2 I + o o')^-1 v = (v - o (o.v) / 3) / 2
    inverse = background(np.empty((0, 3)), weight=10.0, ridge=2.0)
    np.testing.assert_allclose(contrasted(np.array([[0.6, 0.8, 0.0]]), inverse), [[0.3, 0.4, 0.0]])
    np.testing.assert_allclose(contrasted(np.array([[0.6, 0.8, 0.0], [1.0, 0, 0]]), inverse)[0], [0.2, 0.4, 0.0])
    texts = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    np.testing.assert_allclose(background(texts, weight=4.0, ridge=1.0), np.eye(2) / 3)
    np.testing.assert_allclose(standard_scores(np.array([[3.0, 3.0], [1.0, 3.0]])), [[0.0, 0.0], [-1.0, 1.0]])


def test_household_texts_are_distinct_and_always_the_same() -> None:
    texts = household_texts()
    assert len(texts) == len(set(texts)) == 444
    assert texts == household_texts()
    assert "armchair" in texts
