"""Lengths and shapes of paths on a floor grid, compared with exact shortest paths."""

import itertools

import numpy as np
import pytest

from sim.walk.floor_grid import floor_grid_from_mesh
from tests.sim.grids import CELL, at, cluttered_home, grid_of

Box = tuple[float, float, float, float]


def exact_distance(a: np.ndarray, b: np.ndarray, boxes: list[Box]) -> float:
    """Length of the shortest path from a to b (x, z) around boxes (x0, z0, x1, z1), by Dijkstra over their corners."""
    corners = [(x, z) for x0, z0, x1, z1 in boxes for x in (x0, x1) for z in (z0, z1)]
    points = np.array([a, b, *corners])
    count = len(points)
    away = np.full((count, count), np.inf)
    for i in range(count):
        for j in range(i):
            if not any(crosses(points[i], points[j], box) for box in boxes):
                away[i, j] = away[j, i] = np.hypot(*(points[i] - points[j]))
    best = np.full(count, np.inf)
    best[0] = 0.0
    left = set(range(count))
    while left:
        here = min(left, key=lambda k: best[k])
        left.remove(here)
        best = np.minimum(best, best[here] + away[here])
    return float(best[1])


def crosses(a: np.ndarray, b: np.ndarray, box: Box) -> bool:
    """Whether a segment passes through the inside of a box (Liang-Barsky clipping)."""
    enter, leave = 0.0, 1.0
    for axis in range(2):
        low, high = box[axis] + 1e-9, box[axis + 2] - 1e-9
        way = b[axis] - a[axis]
        if abs(way) < 1e-12:
            if not low < a[axis] < high:
                return False
            continue
        t0, t1 = sorted(((low - a[axis]) / way, (high - a[axis]) / way))
        enter, leave = max(enter, t0), min(leave, t1)
    return leave - enter > 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_distances_exceed_the_exact_shortest_path_around_boxes_by_far_less_than_a_percent(seed):
    rng = np.random.default_rng(seed)
    boxes: list[Box] = []
    for x, z, width, depth in rng.integers((5, 5, 3, 3), (60, 60, 18, 18), (40, 4)) * CELL:
        one = (float(x), float(z), float(x + width), float(z + depth))
        if all(
            one[0] > b[2] + CELL or b[0] > one[2] + CELL or one[1] > b[3] + CELL or b[1] > one[3] + CELL for b in boxes
        ):
            boxes.append(one)  # apart from all others, so that no path uses a gap of zero width
    grid = grid_of(lambda x, z: ~np.any([(x > b[0]) & (z > b[1]) & (x < b[2]) & (z < b[3]) for b in boxes], axis=0))
    island = np.bincount(grid.islands).argmax()
    points = [point for point in (grid.random_point(rng) for _ in range(30)) if grid.island(point) == island]
    pairs = list(zip(points[::2], points[1::2], strict=False))
    exact = np.array([exact_distance(a[[0, 2]], b[[0, 2]], boxes) for a, b in pairs])
    found = np.array([grid.distances(a[None], b[None])[0] for a, b in pairs])
    assert len(pairs) >= 10
    excess = found / exact - 1
    assert excess.min() > -1e-6, "no path is shorter than the shortest"
    assert excess.mean() < 0.003
    assert excess.max() < 0.02


def test_paths_along_a_slanted_wall_and_around_an_inner_corner_have_the_lengths_computed_by_hand():
    # A slanted wall from z = 1 + x / 3 to 1.4 + x / 3 ends at x = 3; the path leads around that end.
    slanted = grid_of(lambda x, z: (z < 1 + x / 3) | (x > 3) | (z > 1.4 + x / 3))
    foot, behind = at(0.3, 1.0), at(0.3, 1.6)
    shortest = np.hypot(2.7, 1.0) + 0.4 + np.hypot(2.7, 0.8)
    found = slanted.distances(foot[None], behind[None])[0]
    assert found == pytest.approx(shortest, rel=0.012), "the grid draws the wall in steps of 5 cm"
    corridor = grid_of(lambda x, z: (z < 0.5) | (x > 3.5))
    found = corridor.distances(at(0.5, 0.25)[None], at(3.75, 3.5)[None])[0]
    assert found == pytest.approx(np.hypot(3.0, 0.25) + np.hypot(0.25, 3.0), rel=1e-4)


def test_walking_along_a_path_step_by_step_never_collides():
    grid = floor_grid_from_mesh(cluttered_home())
    rng = np.random.default_rng(3)
    walked = 0
    for _ in range(25):
        start, goal = (grid.random_point(rng) for _ in range(2))
        path = grid.shortest_path(start, goal[None])
        for here, corner in itertools.pairwise(path) if path is not None else ():
            while np.hypot(*(corner - here)[[0, 2]]) > 1e-9:
                way = (corner - here) * (1, 0, 1)
                wanted = here + way * min(1.0, 0.25 / np.linalg.norm(way))
                result = grid.step(here, wanted)
                assert not result.collided
                here = np.array(result.position)
                np.testing.assert_allclose(here[[0, 2]], wanted[[0, 2]], atol=1e-7)
                walked += 1
    assert walked > 200
