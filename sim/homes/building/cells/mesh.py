"""Rooms of a home that is given as cells (schematic homes): floors, ceilings, straight walls, openings, stairs."""

import numpy as np
from numpy.typing import NDArray

from ....types import CUT_HEIGHT
from ....words.colours import tinted
from ...images import cells_of, neighbours, widened
from ...plan import Finish, HomePlan, Room
from ..fittings import add_ceiling_lamp
from ..quads import QuadBuilder, floor_uv
from ..walls import CEILING_FINISH, WallPiece, add_wall_piece
from .flights import add_railings, add_steps, add_strings, flight_surface
from .openings import add_doorways, add_windows, lamp_cells
from .outlines import Straight
from .spaces import floor_layers, padded
from .storeys import StoreyCells, storeys_of_cells
from .surfaces import level_quads, side_quads

WALL = 0.1
"""Thickness of walls between rooms (metres)."""
_SEAM = 0.001
"""Tops of blocks end this far inside their cells, so that no cell of the map beside them is cut (metres)."""
_GROUND = 0.3
"""Depth of the ground under the lowest floor: 1.5 voxels of a map, so that floors lie inside a voxel (metres)."""
_BEYOND = 8
"""The ground reaches this far beyond the rooms: past the corners of outer walls (cells)."""
_SHELL = 0.14
"""Thickness of outer walls as seen from above (metres)."""
_MIN_RUN = 10
"""Least length of a stretch of wall with a room's own colour (cells)."""

Numbers = NDArray[np.int64]


def add_cells(builder: QuadBuilder, plan: HomePlan) -> list[tuple[float, float, float]]:
    """Builds the plan's cells; returns the places of the ceiling lamps."""
    assert plan.cells is not None
    floors = padded(floor_layers(plan.cells, plan.storeys), np.nan)
    storeys = storeys_of_cells(plan, floors)
    surfaces = _surfaces(plan, storeys, floors)
    _add_ground(builder, storeys)
    lamps: list[tuple[float, float, float]] = []
    for k, storey in enumerate(storeys):
        _add_floor(builder, storey, surfaces[2 * k])
        _add_blocks(builder, storey)
        ceiling = storey.ceiling_under(storeys[k + 1] if k + 1 < len(storeys) else None)
        _add_ceiling(builder, storey, ceiling)
        for line in storey.lines:
            _add_wall(builder, storey, line, surfaces[2 * k])
        add_windows(builder, storey)
        add_doorways(builder, storey)
        _add_rim(builder, storey)
        lamps += [add_ceiling_lamp(builder, np.array([x, storey.ceiling_y, z])) for x, z in lamp_cells(storey, ceiling)]
    add_steps(builder, storeys[0].grid, surfaces)
    for k in range(len(storeys) - 1):
        add_strings(builder, storeys[k], surfaces, 2 * k + 1, walked=~np.isnan(floors[2 * k]))
    add_railings(builder, storeys, surfaces)
    return lamps


def _add_ground(builder: QuadBuilder, storeys: list[StoreyCells]) -> None:
    """Adds the ground below the home, seen from below; it begins at a cell's side, so that a map has the same cells."""
    below = widened(np.logical_or.reduce([storey.space.open for storey in storeys]), _BEYOND)
    heights = np.where(below, storeys[0].floor_y - _GROUND, np.nan)
    quads, _ = level_quads(storeys[0].grid, heights, np.zeros(heights.shape, np.int64))
    builder.add_quads(quads[:, ::-1], CEILING_FINISH)


def _surfaces(plan: HomePlan, storeys: list[StoreyCells], floors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights of everything that is drawn as floor or step; its layers are those of `floors`."""
    found = np.full_like(floors, np.nan)
    for k, storey in enumerate(storeys):
        found[2 * k] = np.where(storey.covered, storey.space.floor, np.nan)
        if 2 * k + 1 < len(floors):
            found[2 * k + 1] = flight_surface(floors[2 * k + 1])
    return found


def _add_floor(builder: QuadBuilder, storey: StoreyCells, surface: NDArray[np.float64]) -> None:
    """Adds the floor, each room in its finish; lighter where floor is guessed."""
    space = storey.space
    quads, kinds = level_quads(storey.grid, surface, storey.rooms * 2 + space.guessed)
    for kind in np.unique(kinds).tolist():
        floor = storey.room(kind // 2).floor
        factor = (1.0, 1.1)[kind % 2]
        mine = quads[kinds == kind]
        uv = floor_uv(mine, is_deep=_is_deep(storey, kind // 2))
        builder.add_quads(mine, floor.model_copy(update={"rgb": tinted(floor.rgb, factor)}), uv=uv)


def _add_blocks(builder: QuadBuilder, storey: StoreyCells) -> None:
    """Adds the tops of low blocks; their fronts are walls that end there."""
    quads, kinds = level_quads(storey.grid, storey.space.block, storey.rooms)
    quads += np.array([(_SEAM, 0, _SEAM), (_SEAM, 0, -_SEAM), (-_SEAM, 0, -_SEAM), (-_SEAM, 0, _SEAM)])
    for number in np.unique(kinds).tolist():
        builder.add_quads(quads[kinds == number], _front(storey.room(number)))


def _front(room: Room) -> Finish:
    """Finish of the blocks of a room."""
    return Finish(material="wood", rgb=tinted(room.floor.rgb, 0.8))


def _is_deep(storey: StoreyCells, room: int) -> bool:
    """Whether a room is longer along z than along x."""
    rows, cols = np.nonzero((storey.rooms == room) & storey.space.inside)
    return len(rows) > 0 and float(np.ptp(rows)) > float(np.ptp(cols))


def _add_ceiling(builder: QuadBuilder, storey: StoreyCells, covered: NDArray[np.bool_]) -> None:
    """Adds one level ceiling, seen from below."""
    heights = np.where(covered, storey.ceiling_y, np.nan)
    quads, _ = level_quads(storey.grid, heights, np.zeros(heights.shape, np.int64))
    builder.add_quads(quads[:, ::-1], CEILING_FINISH)


def _add_rim(builder: QuadBuilder, storey: StoreyCells) -> None:
    """Adds the cut through floor and ceiling around the well, where no wall stands."""
    if storey.ceiling_below is None:
        return
    well, inside = storey.space.well, storey.space.inside
    floors = neighbours(np.where(inside, storey.space.floor, np.nan))
    for (step, beside), (_, floor_beside) in zip(neighbours(well), floors, strict=True):
        cells = cells_of(well & ~beside & ~np.isnan(floor_beside))
        if len(cells[0]):
            high = np.fmin(floor_beside[cells], storey.floor_y)
            low = np.minimum(storey.ceiling_below, high)
            quads, _ = side_quads(storey.grid, cells, (low, high), step)
            builder.add_quads(quads[:, ::-1], CEILING_FINISH)


def _add_wall(builder: QuadBuilder, storey: StoreyCells, line: Straight, surface: NDArray[np.float64]) -> None:
    """Adds one straight wall, with a piece for each room and each height of a block along it.

    Between floor and a low block it is the front of the block; between a block and solid cells it begins at the top.
    """
    sides = [tuple(side.T) for side in (line.left, line.right)]
    is_floor, is_open = (
        [2 * np.count_nonzero(image[side]) >= len(side[0]) for side in sides]
        for image in (storey.space.inside, storey.space.open)
    )
    if not any(is_open):
        return
    is_front = any(is_floor) and all(is_open) and not all(is_floor)
    shown = is_floor if any(is_floor) else is_open
    thickness = [
        WALL / 2 if all(is_floor) else 0.0 if here or is_front else _shell(storey, line, side)
        for here, side in zip(shown, (1, -1), strict=True)
    ]
    block = np.fmax(*(storey.space.block[side] for side in sides))
    block_mm = np.where(np.isnan(block), 0, block * 1000).astype(np.int64)
    rooms = [storey.rooms[side] for side in sides]
    for low, high in _runs(np.stack([*rooms, block_mm])):
        middle = (low + high) // 2
        bottom, skirting = _foot(storey, line, slice(low, high), surface)
        top = storey.ceiling_y
        if is_front:
            top, skirting = float(block_mm[middle]) / 1000, False
        elif not any(is_floor):
            bottom, skirting = float(block_mm[middle]) / 1000, False
        beside = [storey.room(int(side[middle])) for side in rooms]
        left, right = (
            None if not here else _front(room) if is_front else room.wall
            for here, room in zip(shown, beside, strict=True)
        )
        piece = WallPiece(
            *_corners(storey, line, (low / len(block_mm), high / len(block_mm)), thickness),
            bottom=bottom,
            top=top,
            left=left,
            right=right,
            skirting=skirting,
            rims=(storey.floor_y + CUT_HEIGHT - 0.004,) if top > storey.floor_y + CUT_HEIGHT else (),
            ends=(line.is_free[0] and low == 0, line.is_free[1] and high == len(block_mm)),
        )
        add_wall_piece(builder, piece)


def _shell(storey: StoreyCells, line: Straight, side: int) -> float:
    """Thickness (metres) of an outer wall to its left (1) or right (-1): less where there is a room right behind it."""
    shares = np.array([[0.05], [0.25], [0.5], [0.75], [0.95]])
    for thickness in (_SHELL, WALL / 2):
        behind = line.at(shares) + line.miter_at(shares) * (side * thickness / storey.grid.cell)
        if not storey.space.open[tuple(np.floor(behind).astype(np.int64).T)].any():
            return thickness
    return 0.0


def _foot(storey: StoreyCells, line: Straight, part: slice, surface: NDArray[np.float64]) -> tuple[float, bool]:
    """World height at which a part of a wall begins, and whether it stands on level floor."""
    beside = tuple(np.concatenate([line.left[part], line.right[part]]).T)
    if storey.space.well[beside].any() and storey.ceiling_below is not None:
        return min(storey.ceiling_below, storey.floor_y), False  # down to where the walls of the storey below end
    floors = surface[beside]
    floors = floors[~np.isnan(floors)]
    lowest = float(floors.min()) if len(floors) else storey.floor_y
    if len(floors) and float(np.ptp(floors)) < 0.1 and lowest <= storey.floor_y + 0.5:
        return lowest, True
    return min(lowest, storey.floor_y), False


def _corners(
    storey: StoreyCells, line: Straight, shares: tuple[float, float], thickness: list[float]
) -> list[NDArray[np.float64]]:
    """World corners, in the order of `WallPiece`, of a part of a wall this thick to its left and right (metres)."""
    offsets = (thickness[0] / storey.grid.cell, -thickness[1] / storey.grid.cell)
    return [storey.xz(line.at(share) + line.miter_at(share) * by) for by in offsets for share in shares]


def _runs(keys: Numbers) -> list[tuple[int, int]]:
    """Stretches of equal keys (K, N) along N; short ones join the one before."""
    if keys.shape[1] < 2 * _MIN_RUN:
        return [(0, keys.shape[1])]
    cuts = [0]
    for place in (np.flatnonzero((np.diff(keys) != 0).any(axis=0)) + 1).tolist():
        if place - cuts[-1] >= _MIN_RUN and keys.shape[1] - place >= _MIN_RUN:
            cuts.append(place)
    return list(zip(cuts, [*cuts[1:], keys.shape[1]], strict=True))
