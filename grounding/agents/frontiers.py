"""Frontiers (Yamauchi): where known free floor meets the unknown, grouped, with the best place to look from.

Ground of a `FloorMemory` -> groups of unknown cells -> `Frontier`s with the cost of seeing them.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.tasks.observers import FREE, UNKNOWN
from sim.types import FORWARD_STEP, TURN_STEP, Camera

from .floor_memory import Ground
from .plan_kernels import best_views, spread_costs

_MIN_CELLS = 5
"""Smaller groups are too narrow to lead anywhere: a quarter of a metre."""
VIEW_RANGE = 4.0
"""Largest distance from which a frontier is looked at, metres, so that the space behind it is in the sensor's range."""
_NEARER, _LEEWAY = 0.5, 6.0
"""Each look without success multiplies VIEW_RANGE by this factor for the next look; the distance stays at least this
many cells above that of the nearest visible floor."""
LOOK_COST = 3.0
"""Cost of looking down and up again, in actions: two, and one for the view lost meanwhile."""
_PASSABLE = 2
"""A frontier lies within this many cells of a place where the robot's centre can be; others lead nowhere."""
_EDGE = 3.0
"""Safety margin, in cells, beyond the nearest floor in a picture's middle: towards its sides that floor is farther."""
_SMALL = 60.0
"""A frontier of this many cells is chosen only at half the cost of a long one, because more lies behind long ones."""
_HERE = 0.4
"""Places that cost fewer actions count as the robot's own place."""
_PER_GROUP = 12
"""Largest number of unknown cells per group for which viewing places are searched."""
_SOURCE_REACH = 0.25
"""A way may begin at free cells this near (metres): the robot may stand closer to things than plans allow."""


class Frontier(NamedTuple):
    """One frontier and the best way to see it."""

    cells_rc: NDArray[np.int64]
    """(K, 2) unknown cells of the frontier on the ground's grid."""
    middle_xz: tuple[float, float]
    """Middle of its cells, metres."""
    cost: float
    """Actions until it is seen, plus those already spent on it; inf if no known way leads to a place to look from."""
    place_xz: tuple[float, float]
    """The place to stand."""
    target_xz: tuple[float, float]
    """The unknown cell to look at."""


def reach_of(camera: Camera, cell: float, *, can_look: bool) -> tuple[float, float]:
    """Distances of the nearest visible floor, in cells: with the camera tilted (if `can_look`), and with it level."""
    half = math.atan(camera.height / 2 / camera.focal)
    nearest = [camera.mount_height / math.tan(half + tilt) for tilt in (TURN_STEP if can_look else 0.0, 0.0)]
    return nearest[0] / cell + _EDGE, nearest[1] / cell + _EDGE


def costs_from(ground: Ground, xz: tuple[float, float]) -> NDArray[np.float64]:
    """(rows, cols) actions to walk to each cell of the ground without turns; inf where no known way leads."""
    u, v = ground.grid.uv_from_xz(np.array(xz))
    rows, cols = ground.cells.shape
    reach = math.ceil(_SOURCE_REACH / ground.grid.cell)
    r0, c0 = max(int(v) - reach, 0), max(int(u) - reach, 0)
    near = np.ones((min(int(v) + reach + 1, rows) - r0, min(int(u) + reach + 1, cols) - c0))
    rc = np.argwhere(near) + np.array([r0, c0])
    away = np.hypot(rc[:, 0] + 0.5 - v, rc[:, 1] + 0.5 - u) * ground.grid.cell / FORWARD_STEP
    return spread_costs(ground.weights, rc, away)


def find_frontiers(
    ground: Ground,
    costs: NDArray[np.float64],
    *,
    banned: NDArray[np.bool_],
    failures: NDArray[np.uint8],
    spent: NDArray[np.float32],
    robot: tuple[float, float, float],
    is_tilted: bool,
    can_look: bool,
    camera: Camera,
) -> list[Frontier]:
    """All frontiers, cheapest for their size first; those that cannot be looked at come last, with cost inf.

    Args:
        ground: The known part of the map.
        costs: From `costs_from`.
        banned: (rows, cols) unknown cells to ignore.
        failures: (rows, cols) number of looks at each cell without success; the next look is from nearer.
        spent: (rows, cols) actions already spent on seeing each unknown cell.
        robot: The robot's x, z and yaw.
        is_tilted: Whether the camera looks down.
        can_look: Whether the camera may be tilted.
    """
    members = _groups(ground, costs, banned=banned)
    if not members:
        return []
    sampled = [cells[np.linspace(0, len(cells) - 1, min(len(cells), _PER_GROUP)).astype(int)] for cells in members]
    u, v = ground.grid.uv_from_xz(np.array(robot[:2]))
    targets, reach = np.concatenate(sampled), reach_of(camera, ground.grid.cell, can_look=can_look)
    farthest = VIEW_RANGE / ground.grid.cell * _NEARER ** failures[targets[:, 0], targets[:, 1]].astype(float)
    found = best_views(
        targets,
        np.maximum(farthest, reach[0 if can_look else 1] + _LEEWAY),
        np.repeat(np.arange(len(members)), [len(cells) for cells in sampled]),
        len(members),
        ground.assumed,
        costs,
        (float(u), float(v), robot[2]),
        reach,
        TURN_STEP,
        LOOK_COST,
        _HERE,
        is_tilted,
    )
    frontiers = [
        Frontier(
            cells,
            _xz(ground, cells.mean(axis=0)),
            float(cost) + float(spent[cells[:, 0], cells[:, 1]].mean()),
            _xz(ground, place),
            _xz(ground, target),
        )
        for cells, cost, place, target in zip(members, *found, strict=True)
    ]
    return sorted(frontiers, key=lambda frontier: frontier.cost * (1 + _SMALL / len(frontier.cells_rc)))


def _groups(ground: Ground, costs: NDArray[np.float64], *, banned: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Unknown cells (K, 2) beside free ones that the robot can reach, by connected group."""
    beside = ndimage.binary_dilation(ground.cells == FREE)  # 4-neighbours: not across a corner of a wall
    mask = beside & (ground.cells == UNKNOWN) & ~banned
    mask &= ndimage.binary_dilation(np.isfinite(costs), iterations=_PASSABLE)
    labels, count = ndimage.label(mask, structure=np.ones((3, 3)))  # type: ignore[misc]
    group = labels[mask] - 1
    order = np.argsort(group, kind="stable")
    members = np.split(np.argwhere(mask)[order], np.cumsum(np.bincount(group, minlength=count))[:-1])
    return [cells for cells in members if len(cells) >= _MIN_CELLS]


def _xz(ground: Ground, rc: NDArray) -> tuple[float, float]:
    x, z = ground.grid.xz_from_uv(np.asarray(rc, float)[::-1] + 0.5)
    return float(x), float(z)
