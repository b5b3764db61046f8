"""Geometry of oracle maps and the vectors of their cells."""

from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.maps.oracle_map import OracleHome, objects_map, oracle_home
from grounding.types import map_from_cells
from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.types import GridSpec

from .small_homes import HOMES, Thing, write_scene

WORDS = HashedWords()


def unit_sum(*texts: str) -> np.ndarray:
    total = WORDS.encode_texts(texts).sum(axis=0)
    return total / np.linalg.norm(total)


@pytest.fixture(scope="module")
def home(small_root: Path) -> OracleHome:
    return oracle_home(PersonalDataset(small_root), "HomeOne")


def test_the_grid_its_cells_and_their_vectors_equal_those_computed_by_hand(home: OracleHome) -> None:
    # HomeOne: x from 2.25 (table) to 10.0 (a view point of sofa_3), z from 1.75 (its other view point) to 7.75
    assert home.centre_xz == (6.125, 4.75)
    assert home.grid == GridSpec((-19.0, -21.0), 1.0, (50, 50))
    ground = objects_map(home, WORDS, floor_id="0")
    # lamp_4 and sofa_3 share the cell at x = 9-10, z = 2-3; the table is at (2.25, 7.75), sofa_2 at (5.5, 7.5)
    assert ground.rc.tolist() == [[23, 28], [28, 21], [28, 24]]
    assert ground.weights.tolist() == [2, 1, 1]
    assert ground.points_from_rc(ground.rc[1:2]).tolist() == [[2.5, 0.0, 7.5]]
    np.testing.assert_allclose(ground.rows[0], unit_sum("small yellow leather sofa", "lamp"), atol=1e-6)
    np.testing.assert_allclose(ground.rows[1], unit_sum("low oak table with a green bowl"), atol=1e-6)
    assert ground.encoder == "hashed-words-768"


def test_the_map_of_a_storey_holds_its_objects_and_the_merged_map_the_floor_of_each_cell(home: OracleHome) -> None:
    upper = objects_map(home, WORDS, floor_id="1")
    assert upper.rc.tolist() == [[23, 25], [28, 21]]
    assert upper.floor_y == 3.0
    assert upper.points_from_rc(upper.rc)[:, 1].tolist() == [3.0, 3.0]
    merged = objects_map(home, WORDS, floor_id=None)
    assert merged.rc.tolist() == [[23, 25], [23, 28], [28, 21], [28, 24]]
    # the table (ground floor) and the bed (upper floor) share a cell; on a tie the lower floor counts
    assert merged.cell_y.tolist() == [3.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(
        merged.rows[2], unit_sum("low oak table with a green bowl", "wide bed with a purple blanket"), atol=1e-6
    )


def test_an_unknown_storey_and_a_home_larger_than_the_grid_are_refused(home: OracleHome, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"HomeOne: found no object with floor_id '7'; expected one of \['0', '1'\]"):
        objects_map(home, WORDS, floor_id="7")
    far = Thing("barn_9", (60.0, 1.0, 2.0), "0", 0.0, "red barn", "Ada")
    write_scene(tmp_path, "easy", "HomeOne", (*HOMES["HomeOne"], far))
    with pytest.raises(SceneError, match=r"scene 'HomeOne' is 58\.2 x 6\.5 m; expected at most 49 x 49 m"):
        oracle_home(PersonalDataset(tmp_path), "HomeOne")


def test_the_dense_view_is_zero_in_empty_cells(small_root: Path) -> None:
    ground = objects_map(oracle_home(PersonalDataset(small_root), "HomeTwo"), WORDS, floor_id="0")
    dense = ground.dense()
    assert dense.shape == (50, 50, 768)
    assert int(np.any(dense != 0, axis=2).sum()) == 3
    np.testing.assert_array_equal(dense[tuple(ground.rc[1])], ground.rows[1])


def test_cells_in_any_order_are_stored_row_by_row_without_zero_vectors() -> None:
    memory = map_from_cells(
        np.array([[0.0, 2.0], [3.0, 4.0], [0.0, 0.0]]),
        np.array([[1, 0], [0, 2], [0, 1]]),
        grid=GridSpec((0.0, 0.0), 1.0, (2, 3)),
        floor_y=0.5,
        encoder="test",
    )
    assert memory.rc.tolist() == [[0, 2], [1, 0]]
    np.testing.assert_allclose(memory.rows, [[0.6, 0.8], [0.0, 1.0]])
    assert memory.flat_index.tolist() == [2, 3]
    assert memory.centre_xz == (1.5, 1.0)
    assert not memory.rows.flags.writeable
