"""Finds the open space of a schematic home that is not walkable: blocks below lines of sight, floor below objects.

Recorded view points and recovered objects -> `CellGrid.plinth`, for `recover_plan`. All other space is wall.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import CAMERA_HEIGHT

from ..building.cells.spaces import floor_layers
from ..cells import CELL, CellGrid, Cells
from ..furniture.families import Mounting
from ..images import grown, parts_of
from ..plan import Furniture, Storey
from .holders import is_carried
from .recorded import Recorded, original_places

BLOCKS = (0.0, 0.45, 0.65)
"""Heights of blocks above the floor (metres): below the camera, and too high to step on; 0 is floor."""
_OVER_BLOCK = 0.05
"""Least height of a line of sight above a block (metres)."""
_UPPER = 0.35
"""Lines of sight end this share of the object's height above its centre."""
_BEHIND, _RIGHT_BEHIND = 0.2, 0.05
"""Depth of the wall behind a hanging object, without and inside other objects (metres)."""
_BUILT_IN = 0.2
"""An object with less depth is the front of a thing inside a wall, such as a wardrobe or a dishwasher (metres)."""
_SMALL_HOLE = 0.3
"""Isolated walls with less area than this (square metres) are only gaps between lines of sight; they are opened."""
_OWN_FLOOR = 0.6

Masks = NDArray[np.bool_]


class _Open(NamedTuple):
    """Cells by storey (S, rows, cols)."""

    least: NDArray[np.float64]
    """Height above the floor of the lowest line of sight over each cell; inf where there is none, metres."""
    below: Masks
    """Cells below an object."""
    wall: Masks
    """Cells right behind an object that hangs on a wall."""


def block_cells(
    recorded: Recorded,
    pieces: Sequence[Furniture],
    mountings: Mapping[str, Mounting],
    storeys: Sequence[Storey],
    *,
    grid: CellGrid,
) -> Cells:
    """Cells that are open but not walkable, with the heights of the blocks on them, or of the floor below objects.

    A piece that hangs on a wall, by its mounting, keeps a wall behind it where no line of sight passes, unless a
    standing piece carries it; `grid` has its walkable cells.
    """
    floor_y = np.array([storey.floor_y for storey in storeys])
    marks = _marks(recorded, pieces, mountings, floor_y, grid)
    floors = floor_layers(grid, tuple(storeys))[::2]
    parts = []
    for k in range(len(storeys)):
        is_floor = ~np.isnan(floors[k])
        least = ndimage.minimum_filter(marks.least[k], 3)
        seen = np.isfinite(least) & ~marks.wall[k]
        opened = seen | _dilated(marks.below[k]) & ~marks.wall[k]
        opened |= _small_holes(opened | is_floor, marks.wall[k])
        rows, cols = np.nonzero(opened & ~is_floor)
        base = grown(floors[k], math.inf)[rows, cols]
        # far from a storey's floor (a void, a stair well) the storey's height is used, not a neighbour on the stairs
        y = np.where(np.abs(base - floor_y[k]) < _OWN_FLOOR, base, floor_y[k])
        height = np.asarray(BLOCKS)[np.searchsorted(BLOCKS, np.maximum(least - _OVER_BLOCK, 0), side="right") - 1]
        height = np.where(_dilated(marks.below[k]), 0.0, height)[rows, cols]
        parts.append((np.stack([rows, cols], axis=1), np.round(y / 0.05) * 0.05 + height))
    rc = np.concatenate([part[0] for part in parts])
    return Cells(rc, np.concatenate([part[1] for part in parts]), np.zeros(len(rc), bool))


def _marks(
    recorded: Recorded,
    pieces: Sequence[Furniture],
    mountings: Mapping[str, Mounting],
    floor_y: NDArray[np.float64],
    grid: CellGrid,
) -> _Open:
    shape = (len(floor_y), *grid.shape)
    marks = _Open(np.full(shape, np.inf), np.zeros(shape, bool), np.zeros(shape, bool))
    taken, hung, held = np.zeros((3, *shape), bool)
    standing = [piece for piece in pieces if mountings[piece.name] == "floor"]
    for piece in pieces:
        goal = recorded.goals.get(piece.name)
        own_y = piece.bottom_y if goal is None else goal.floor_y
        k = int(np.abs(floor_y - own_y).argmin())
        if goal is not None:
            upper = np.array(goal.position) + np.array([0, _UPPER * piece.size[1], 0])
            _mark_sights(marks, k, original_places(goal), upper, floor_y[k], grid)
        mounting = mountings[piece.name]
        own = piece.rect.cells(grid.grid)
        if mounting in ("floor", "on"):
            marks.below[k][own] = True
        else:
            marks.least[k][own] = np.minimum(marks.least[k][own], piece.bottom_y - floor_y[k])
        if mounting == "wall" or (mounting == "floor" and piece.size[2] < _BUILT_IN):
            behind = piece.yaw + math.pi
            marks.wall[k][piece.rect.beside(behind, _BEHIND).cells(grid.grid)] = True
            hung[k][own] = True
            needs_wall = mounting == "wall" and not is_carried(piece, standing)
            held[k][piece.rect.beside(behind, _RIGHT_BEHIND).cells(grid.grid)] |= needs_wall
        taken[k][own] = True
    marks.wall[taken & ~held | hung | np.isfinite(marks.least)] = False
    return marks


def _mark_sights(
    marks: _Open, k: int, places: NDArray[np.float64], centre: NDArray[np.float64], floor_y: float, grid: CellGrid
) -> None:
    """Marks the cells below the lines from the camera at each place (V, 3) to a centre (3,)."""
    if not len(places):
        return
    num = math.ceil(np.linalg.norm(places - centre, axis=1).max() / (CELL / 2)) + 1
    share = np.linspace(0, 1, num)[:, None]
    eyes = places + np.array([0.0, CAMERA_HEIGHT, 0.0])
    points = eyes * (1 - share[..., None]) + centre * share[..., None]  # (num, V, 3)
    rc = grid.grid.rc_from_xz(points[..., [0, 2]])
    np.minimum.at(marks.least[k], (rc[..., 0], rc[..., 1]), points[..., 1] - floor_y)


def _dilated(mask: Masks) -> Masks:
    """The mask grown by the four neighbours of each cell."""
    return np.asarray(ndimage.binary_dilation(mask), bool)


def _small_holes(opened: Masks, wall: Masks) -> Masks:
    """Closed cells in small parts that touch neither the border nor a wall with a hanging object."""
    parts, _ = parts_of(~opened)
    keep = np.bincount(parts.ravel()) * CELL**2 >= _SMALL_HOLE
    for edge in (parts[0], parts[-1], parts[:, 0], parts[:, -1], parts[wall]):
        keep[edge] = True
    keep[0] = True
    return ~keep[parts]
