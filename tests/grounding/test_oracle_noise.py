"""Variants of oracle maps: the effect of each option, statistics and seeds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.maps.oracle_map import OracleHome, objects_map, oracle_home
from grounding.maps.oracle_noise import OracleVariant, noisy, other_texts, variant_map
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, SceneError

WORDS = HashedWords()


@pytest.fixture(scope="module")
def homes(small_root: Path) -> tuple[OracleHome, OracleHome]:
    dataset = PersonalDataset(small_root)
    return oracle_home(dataset, "HomeOne"), oracle_home(dataset, "HomeTwo")


def test_a_plain_variant_equals_the_objects_map_of_one_storey_and_clutter_needs_other_homes(homes) -> None:
    plain = objects_map(homes[1], WORDS, floor_id="0")
    same = variant_map(homes[1], WORDS, floor_id="0", variant=OracleVariant())
    np.testing.assert_array_equal(plain.rows, same.rows)
    np.testing.assert_array_equal(plain.weights, same.weights)
    home = homes[0]
    assert {label for label, _ in home.stands} == {"0", "1"}
    assert all(place[1] == {"0": 0.0, "1": 3.0}[label] for label, place in home.stands)
    upper = variant_map(home, WORDS, floor_id="1", variant=OracleVariant(blur=0.5))
    assert set(upper.cell_y.tolist()) == {3.0}
    with pytest.raises(SceneError, match="HomeTwo: found no object of another home; expected some"):
        variant_map(homes[1], WORDS, floor_id="0", variant=OracleVariant(clutter=True))


def test_blur_of_any_width_fills_exactly_the_cells_with_an_object_or_a_view_point(homes) -> None:
    # HomeTwo: objects in the cells at x, z = -3.5, -1.5; 1.5, -1.5; 0.5, 4.5; view points at x + 0.5 and at z - 0.75
    home = homes[1]
    blurred = variant_map(home, WORDS, floor_id="0", variant=OracleVariant(blur=0.5))
    spots = {(-3.5, -1.5), (1.5, -1.5), (0.5, 4.5), (-2.5, -1.5), (2.5, -1.5), (1.5, 4.5)}
    spots |= {(-3.5, -2.5), (1.5, -2.5), (0.5, 3.5)}
    assert {tuple(xz) for xz in home.grid.xz_from_rc(blurred.rc).tolist()} == spots
    assert set(blurred.cell_y.tolist()) == {0.0}
    blurred = variant_map(homes[1], WORDS, floor_id="0", variant=OracleVariant(blur=0.01))
    assert len(blurred.rows) == 9


def test_a_blurred_cell_is_the_unit_sum_with_gaussian_weights(homes) -> None:
    home = homes[1]
    blurred = variant_map(home, WORDS, floor_id="0", variant=OracleVariant(blur=2.0))
    index = int(np.flatnonzero((blurred.rc == home.grid.rc_from_xz(np.array([1.5, -1.5]))).all(axis=1))[0])
    vectors = WORDS.encode_texts([item.text for item in home.objects])
    places = [(item.position[0], item.position[2]) for item in home.objects]
    weights = [np.exp(-((x - 1.5) ** 2 + (z + 1.5) ** 2) / 8) for x, z in places]
    expected = weights @ vectors
    np.testing.assert_allclose(blurred.rows[index], expected / np.linalg.norm(expected), atol=1e-5)


def test_noise_has_the_stated_deviation_of_the_cosine() -> None:
    rng = np.random.default_rng(5)
    size, c = 64, 0.1
    rows = np.zeros((20_000, size))
    rows[:, 0] = 7.0
    worse = noisy(rows, c, rng)
    np.testing.assert_allclose(np.linalg.norm(worse, axis=1), 1)
    # unit(v + c sqrt(E) n) is v with an error of deviation c in every direction, divided by about sqrt(1 + c^2 E)
    length = np.sqrt(1 + c**2 * size)
    assert worse[:, 1].std() * length == pytest.approx(c, rel=0.03)
    assert worse[:, 0].mean() * length == pytest.approx(1, rel=0.03)
    np.testing.assert_allclose(noisy(rows, 0.0, rng)[:, 0], 1)


def test_clutter_fills_every_observed_cell_without_an_object_with_texts_of_other_homes(homes) -> None:
    first, second = homes
    texts = other_texts(homes, "HomeTwo")
    assert texts == tuple(item.text for item in first.objects)
    cluttered = variant_map(second, WORDS, floor_id="0", variant=OracleVariant(clutter=True), clutter_texts=texts)
    plain = objects_map(second, WORDS, floor_id="0")
    own = [(cluttered.rc == rc).all(axis=1).argmax() for rc in plain.rc]
    assert len(cluttered.rows) == 9
    np.testing.assert_allclose(cluttered.rows[own], plain.rows, atol=1e-6)
    cosines = np.delete(cluttered.rows, own, axis=0) @ WORDS.encode_texts(texts).T
    np.testing.assert_allclose(cosines.max(axis=1), 1, atol=1e-5)


def test_the_seed_decides_the_map(homes) -> None:
    variant = OracleVariant(blur=0.5, object_noise=0.1, cell_noise=0.1, clutter=True, seed=3)
    texts = other_texts(homes, "HomeOne")

    def rows(variant: OracleVariant, floor_id: str | None = "0") -> np.ndarray:
        return variant_map(homes[0], WORDS, floor_id=floor_id, variant=variant, clutter_texts=texts).rows

    first = rows(variant)
    rows(variant, "1")
    np.testing.assert_array_equal(first, rows(variant))
    assert not np.allclose(first, rows(replace(variant, seed=4)))
    assert not np.allclose(first, rows(replace(variant, cell_noise=0.0)))


def test_the_noise_of_an_object_is_the_same_on_the_merged_map(homes) -> None:
    variant = OracleVariant(object_noise=0.2, seed=1)
    storey = variant_map(homes[0], WORDS, floor_id="0", variant=variant)
    merged = variant_map(homes[0], WORDS, floor_id=None, variant=variant)
    sofa = homes[0].grid.rc_from_xz(np.array([5.5, 7.5]))  # alone in its cell on both maps
    at = [int((memory.rc == sofa).all(axis=1).argmax()) for memory in (storey, merged)]
    np.testing.assert_allclose(storey.rows[at[0]], merged.rows[at[1]], atol=1e-6)


@pytest.mark.parametrize("field", ["blur", "object_noise", "cell_noise"])
@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf")])
def test_impossible_values_are_refused(field: str, value: float) -> None:
    with pytest.raises(AgentError, match="expected blur and noise of at least 0"):
        replace(OracleVariant(), **{field: value})
