"""Rooms of a home that is given as cells (schematic homes): floors, ceilings, straight walls, openings, stairs."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ....types import CUT_HEIGHT
from ....words.colours import tinted
from ...images import cells_of, neighbours, parts_of
from ...plan import Finish, HomePlan
from ..fittings import add_ceiling_lamp
from ..quads import QuadBuilder, floor_uv
from ..walls import CEILING_FINISH, WallPiece, add_wall_piece
from .flights import add_railings, add_steps, add_strings, flight_surface, stepped, with_whole_flights
from .openings import add_door_frames, add_windows, lamp_cells
from .outlines import Straight
from .spaces import floor_layers, padded
from .storeys import StoreyCells, storeys_of_cells
from .surfaces import level_quads, side_quads

WALL = 0.1
"""Thickness of walls between rooms (metres)."""
_SHELL = 0.14
"""Thickness of outer walls as seen from above (metres)."""
RAISED = 0.02
"""Height of raised floor, where no place was recorded (metres)."""
_LOW_BLOCK, _HIGH_BLOCK = 0.15, 1.3
"""Floor between these heights above the storey's is a flight, a platform, or the top of a bed or table (metres)."""
_LARGEST_BLOCK = 5.0
"""Largest area of the top of a bed or table; larger blocks are platforms (m2)."""
_LEVEL, _LEVEL_SHARE = 0.15, 0.7
"""In a flight, less than _LEVEL_SHARE of the cells lies within _LEVEL (metres) of the median height."""
_MIN_RUN = 10
"""Least length of a stretch of wall with a room's own colour (cells)."""

Numbers = NDArray[np.int64]


def add_cells(builder: QuadBuilder, plan: HomePlan) -> list[tuple[float, float, float]]:
    """Builds the plan's cells; returns the places of the ceiling lamps."""
    assert plan.cells is not None
    floors_y = [storey.floor_y for storey in plan.storeys]
    floors = with_whole_flights(padded(floor_layers(plan.cells, plan.storeys), np.nan), floors_y)
    storeys = storeys_of_cells(plan, floors)
    surfaces = _surfaces(plan, storeys, floors)
    lamps: list[tuple[float, float, float]] = []
    for k, storey in enumerate(storeys):
        _add_floor(builder, storey, surfaces[2 * k])
        ceiling = storey.ceiling_under(storeys[k + 1] if k + 1 < len(storeys) else None)
        _add_ceiling(builder, storey, ceiling)
        for line in storey.lines:
            _add_wall(builder, storey, line, surfaces[2 * k])
        add_windows(builder, storey)
        add_door_frames(builder, storey)
        _add_rim(builder, storey)
        lamps += [add_ceiling_lamp(builder, np.array([x, storey.ceiling_y, z])) for x, z in lamp_cells(storey, ceiling)]
    add_steps(builder, storeys[0].grid, surfaces)
    for k in range(len(storeys) - 1):
        add_strings(builder, storeys[k], surfaces, 2 * k + 1, walked=~np.isnan(floors[2 * k]))
    add_railings(builder, storeys, surfaces)
    return lamps


def _surfaces(plan: HomePlan, storeys: list[StoreyCells], floors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights of everything that is drawn as floor or step; its layers are those of `floors`."""
    found = np.full_like(floors, np.nan)
    for k, storey in enumerate(storeys):
        floor = np.where(_on_furniture(storey), storey.floor_y, storey.space.floor)
        height = stepped(floor, storey.floor_y) + RAISED * storey.space.raised
        found[2 * k] = np.where(storey.covered, height, np.nan)
        if 2 * k + 1 < len(floors):
            found[2 * k + 1] = flight_surface(floors[2 * k + 1], storey.floor_y)
    return found


def _on_furniture(storey: StoreyCells) -> NDArray[np.bool_]:
    """Mask (rows, cols) of places that were recorded on top of a bed or table; no block of floor is drawn there."""
    above = np.nan_to_num(storey.space.floor - storey.floor_y)
    parts, count = parts_of(storey.covered & (above > _LOW_BLOCK) & (above < _HIGH_BLOCK))
    middle = np.append(0.0, ndimage.median(above, parts, np.arange(1, count + 1)))[parts]
    cells, level = (
        np.bincount(parts.ravel(), weights, count + 1) for weights in (None, (np.abs(above - middle) < _LEVEL).ravel())
    )
    largest = np.full(count + 1, _LARGEST_BLOCK)
    largest[parts[_under_pieces(storey)]] *= 3  # two beds and the things between them
    is_block = (cells * storey.grid.cell**2 < largest) & (level > _LEVEL_SHARE * cells)
    is_block[0] = False
    return is_block[parts]


def _under_pieces(storey: StoreyCells) -> tuple[Numbers, Numbers]:
    """Rows and columns of the cells under the middles of the pieces that stand on the storey's floor."""
    pieces = [piece.centre[::2] for piece in storey.plan.furniture if abs(piece.bottom_y - storey.floor_y) < _LOW_BLOCK]
    rows, cols = storey.grid.rc_from_xz(np.array(pieces).reshape(-1, 2)).T
    return rows, cols


def _add_floor(builder: QuadBuilder, storey: StoreyCells, surface: NDArray[np.float64]) -> None:
    """Adds the floor, each room in its finish; darker where no place was recorded, lighter where floor is guessed."""
    space = storey.space
    shade = np.where(space.raised, 1, np.where(space.guessed, 2, 0))
    quads, kinds = level_quads(storey.grid, surface, storey.rooms * 3 + shade)
    for kind in np.unique(kinds).tolist():
        floor = storey.room(kind // 3).floor
        factor = (1.0, 0.86, 1.1)[kind % 3]
        mine = quads[kinds == kind]
        uv = floor_uv(mine, is_deep=_is_deep(storey, kind // 3))
        builder.add_quads(mine, floor.model_copy(update={"rgb": tinted(floor.rgb, factor)}), uv=uv)
    _add_raised_edges(builder, storey, surface)


def _add_raised_edges(builder: QuadBuilder, storey: StoreyCells, surface: NDArray[np.float64]) -> None:
    """Adds the low upright edges of raised floor."""
    for step, beside in neighbours(surface):
        cells = cells_of(storey.space.raised & (np.abs(surface - beside - RAISED) < 1e-6))
        if len(cells[0]):
            quads, first = side_quads(storey.grid, cells, (beside[cells], surface[cells]), step)
            rooms = storey.rooms[cells][first]
            for number in np.unique(rooms).tolist():
                floor = storey.room(number).floor
                builder.add_quads(quads[rooms == number], Finish(material=floor.material, rgb=tinted(floor.rgb, 0.8)))


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
    """Adds one straight wall, with a piece for each room along it."""
    rooms = storey.rooms
    left, right = tuple(line.left.T), tuple(line.right.T)
    _, _, is_left, is_right = storey.placed(line)
    if not is_left and not is_right:
        return
    half = WALL / 2 / storey.grid.cell
    left_by = half if is_right and is_left else 0.0 if is_left else _SHELL / storey.grid.cell
    right_by = half if is_right and is_left else 0.0 if is_right else _SHELL / storey.grid.cell
    keys = rooms[left] * len(storey.plan.rooms) + rooms[right]
    for low, high in _runs(keys):
        a, b = low / len(keys), high / len(keys)
        ends, miters = [line.at(share) for share in (a, b)], [line.miter_at(share) for share in (a, b)]
        corners = [storey.xz(p + m * by) for by in (left_by, -right_by) for p, m in zip(ends, miters, strict=True)]
        beside = tuple(np.concatenate([line.left[low:high], line.right[low:high]]).T)
        floors = surface[beside]
        floors = floors[~np.isnan(floors)]
        bottom = float(floors.min()) if len(floors) else storey.floor_y
        is_level = len(floors) > 0 and float(np.ptp(floors)) < 0.1 and bottom <= storey.floor_y + 0.5
        if storey.space.well[beside].any() and storey.ceiling_below is not None:
            is_level, bottom = False, storey.ceiling_below  # down to where the walls of the storey below end
        middle = (low + high) // 2
        add_wall_piece(
            builder,
            WallPiece(
                *corners,
                bottom=min(bottom, storey.floor_y) if not is_level else bottom,
                top=storey.ceiling_y,
                left=storey.room(int(rooms[left][middle])).wall if is_left else None,
                right=storey.room(int(rooms[right][middle])).wall if is_right else None,
                skirting=is_level,
                rims=(storey.floor_y + CUT_HEIGHT - 0.004,) if storey.ceiling_y > storey.floor_y + CUT_HEIGHT else (),
                ends=(line.is_free[0] and low == 0, line.is_free[1] and high == len(keys)),
            ),
        )


def _runs(keys: Numbers) -> list[tuple[int, int]]:
    """Stretches of equal keys; short ones join the one before."""
    cuts = [0]
    for place in (np.flatnonzero(np.diff(keys)) + 1).tolist():
        if place - cuts[-1] >= _MIN_RUN and len(keys) - place >= _MIN_RUN:
            cuts.append(place)
    return list(zip(cuts, [*cuts[1:], len(keys)], strict=True))
