"""Guessed floor beside things that nobody could reach: the real robot stood on top of a bed, where ours cannot.

Floor cells of a home -> strips from them, for walkable.py.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sim.episodes.schema import Goal
from sim.types import RELAXED_RADIUS, STOREY_GAP, SUCCESS_RADIUS
from sim.walk.floor_grid import FloorGrid
from sim.walk.storeys import nearest_storey

from ..cells import CELL, CellGrid, Cells
from ..plan import Furniture
from .corridors import PLAN_CLIMB
from .flights import shortest_run, stepped_strip
from .recorded import Recorded, original_places

APART = 0.25
"""Distance that a place keeps from furniture: the body in whole cells, and one cell that a map loses (metres)."""
NEAR_ENOUGH = SUCCESS_RADIUS - CELL
"""A guessed place this near to a thing's centre wins an episode, even if the map loses a cell (metres)."""
_BESIDE = 0.6
"""Places less than this above or below the foot of a piece are beside it (metres)."""
_SHARES = (0.2, 0.4, 0.6, 0.8)
"""Places of a straight way at which it must be free of furniture, as shares of its length."""

Points = NDArray[np.float64]


def approaches(
    cells: Cells, recorded: Recorded, solid: Sequence[Furniture], floors_y: list[float], *, grid: CellGrid
) -> list[Cells]:
    """Strips to the goals that nobody could reach from the floor on which recorded paths end.

    Each is the shortest straight way from that floor to a place that is near enough to the goal's centre and free of
    `solid` pieces. A goal without such a way has none.
    """
    floor = FloorGrid.from_cells(cells.rc, cells.y, grid=grid.grid, max_climb=PLAN_CLIMB)
    ends = {floor.island(np.array(end)) for record in recorded.lengths for end in (record.start, record.end)}
    reached = cells.chosen(np.isin(floor.islands, [end for end in ends if end is not None]))
    places = np.insert(grid.grid.xz_from_rc(reached.rc), 1, reached.y, axis=1)
    found = []
    for goal in recorded.goals.values():
        floor_y = floors_y[int(nearest_storey(np.array([goal.floor_y]), floors_y)[0])]
        level = places[np.abs(places[:, 1] - floor_y) < STOREY_GAP]
        radius = SUCCESS_RADIUS if came_near(goal) else RELAXED_RADIUS
        if len(level) and _planar(level, goal).min() > radius:
            way = _shortest_way(level, goal, floor_y, radius - CELL, solid, grid=grid)
            if way is not None:
                found.append(stepped_strip(*way, grid=grid))
    return found


def is_beside(places: Points, solid: Sequence[Furniture]) -> NDArray[np.bool_]:
    """Whether a robot's body at the places (N, 3) would meet a piece, (N,)."""
    found = np.zeros(len(places), bool)
    for piece in solid:
        x0, z0, x1, z1 = piece.rect.grown(APART)
        inside = (places[:, 0] > x0) & (places[:, 0] < x1) & (places[:, 2] > z0) & (places[:, 2] < z1)
        found |= inside & (np.abs(places[:, 1] - piece.bottom_y) < _BESIDE)
    return found


def came_near(goal: Goal) -> bool:
    """Whether the real robot stood within SUCCESS_RADIUS of a goal, seen from above, if only on top of it."""
    return bool((_planar(original_places(goal), goal) <= SUCCESS_RADIUS).any())


def _planar(places: Points, goal: Goal) -> Points:
    """Distances (N,) of places (N, 3) from a goal's centre, seen from above."""
    return np.hypot(places[:, 0] - goal.position[0], places[:, 2] - goal.position[2])


def _shortest_way(
    floor: Points, goal: Goal, floor_y: float, radius: float, solid: Sequence[Furniture], *, grid: CellGrid
) -> tuple[Points, Points] | None:
    """The two nearest places (3,): one of the floor (N, 3), one free and within `radius` of the goal; None = no way."""
    spec = grid.grid
    reach = int(radius / CELL) + 1
    side = np.arange(-reach, reach + 1)
    around = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    rc = spec.rc_from_xz(np.array([goal.position[0], goal.position[2]])) + around
    near = np.insert(spec.xz_from_rc(rc[spec.contains(rc)]), 1, floor_y, axis=1)
    near = near[_planar(near, goal) <= radius]
    near = near[~is_beside(near, solid)]
    if not len(near):
        return None
    away, start = KDTree(floor[:, [0, 2]]).query(near[:, [0, 2]])
    is_free = away >= shortest_run(floor[start, 1] - near[:, 1])
    for share in _SHARES:
        is_free &= ~is_beside(floor[start] * (1 - share) + near * share, solid)
    if not is_free.any():
        return None
    best = int(np.where(is_free, away, np.inf).argmin())
    return floor[np.asarray(start)[best]], near[best]
