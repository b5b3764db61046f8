"""Memories of homes: the storey near a height, and all storeys merged into one."""

import numpy as np
import pytest

from grounding.maps.home_map import HomeMemory, ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory, merged_storeys
from grounding.types import FeatureMap, map_from_cells
from sim.errors import AgentError
from sim.types import GridSpec

GRID = GridSpec((0.0, 0.0), 1.0, (2, 3))
FLOOR = OccupancyGrid(np.zeros((4, 4), np.uint8), GridSpec((0.0, 0.0), 0.05, (4, 4)))


def storey(floor_y: float, cells: dict[tuple[int, int], tuple[list[float], float]]) -> StoreyMemory:
    features = map_from_cells(
        np.array([vector for vector, _ in cells.values()]),
        np.array(list(cells)),
        grid=GRID,
        floor_y=floor_y,
        encoder="test",
        weights=np.array([weight for _, weight in cells.values()]),
    )
    return StoreyMemory(FLOOR, features)


TWO = HomeMemory(
    (storey(0.0, {(0, 1): ([1, 0], 3.0), (1, 2): ([0, 1], 1.0)}), storey(3.0, {(0, 1): ([0, 1], 1.0)})), "world", 7
)


def test_the_storey_near_a_height_has_the_nearest_floor_and_an_empty_memory_has_none() -> None:
    assert TWO.storey_near(1.4).floor_y == 0.0
    assert TWO.storey_near(1.6).floor_y == 3.0
    with pytest.raises(AgentError, match="map: has no storey"):
        HomeMemory((), "world", 0).storey_near(0.0)


def test_cells_above_each_other_merge_by_weight_at_the_height_of_the_heaviest() -> None:
    merged = merged_storeys(TWO)
    assert isinstance(merged, FeatureMap)
    assert merged.rc.tolist() == [[0, 1], [1, 2]]
    np.testing.assert_allclose(merged.rows[0], np.array([3, 1]) / np.sqrt(10), atol=1e-6)
    assert merged.weights.tolist() == [4.0, 1.0]
    assert merged.cell_y.tolist() == [0.0, 0.0]  # the height of the storey with the largest weight
    above = HomeMemory(
        (storey(0.0, {(0, 1): ([1, 0], 1.0)}), storey(3.0, {(0, 1): ([0, 1], 2.0), (0, 0): ([1, 0], 1.0)})), "world", 1
    )
    merged = merged_storeys(above)
    assert isinstance(merged, FeatureMap)
    assert dict(zip(map(tuple, merged.rc.tolist()), merged.cell_y.tolist(), strict=True)) == {(0, 0): 3.0, (0, 1): 3.0}


def test_a_merged_object_map_holds_the_objects_of_all_storeys() -> None:
    def one(y: float, caption: str) -> StoreyMemory:
        points = np.array([[0, y, 0], [2, y + 1, 4]], np.float32)
        item = ObjectInstance(points, np.array([1, 0], np.float32), caption, 1.0)
        return StoreyMemory(FLOOR, ObjectMap((item,), y, "test", 2, (0.0, 0.0), 0.2))

    merged = merged_storeys(HomeMemory((one(0.0, "low"), one(3.0, "high")), "world", 2))
    assert isinstance(merged, ObjectMap)
    assert [item.caption for item in merged.objects] == ["low", "high"]
    assert merged.objects[1].centre == (1.0, 3.5, 2.0)
    assert merged.storeys.tolist() == [0, 1]
    assert merged.places.tolist() == [[1.0, 0.0, 2.0], [1.0, 3.0, 2.0]], "each on the floor of its own storey"
