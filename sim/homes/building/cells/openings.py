"""Windows, doorways and ceiling lamps of a home given as cells: decoration that blocks no path and no view."""

import numpy as np
from numpy.typing import NDArray

from ...images import cells_of, distance_to, widened
from ...plan import Rect
from ..fittings import add_strip, add_window
from ..quads import QuadBuilder, spot_on_wall
from ..walls import WallPiece, add_wall_piece
from .storeys import StoreyCells, StoreyLine

_WINDOW = (1.2, 1.0)
_SILL = 1.24
"""Height of a window above the floor (metres): the sill's board stands out into the room, and a map of the mesh needs
1.2 m below it, the body in whole voxels and a floor that lies anywhere inside a voxel."""
_WINDOW_EVERY = 2.8
_MIN_WALL = 1.7
_OUTSIDE = (0.3, 0.6, 0.9, 1.2)
"""A wall is an outer wall if no place at these distances behind it is inside the storey (metres)."""
_DOOR = (0.6, 1.5)
"""Narrowest and widest gap between rooms that is a doorway (metres)."""
_DOOR_TOP = 2.05
_WALL_DEPTH = 0.1
"""Thickness of the wall over a doorway (metres)."""
_INTO_WALL = 0.02
"""Length by which it reaches into the walls beside it (metres); more would show on their other side."""
_STRIP_CLIMB = 0.05
_LAMP_EVERY = 2.6
_MAX_LAMPS = 4
_MIN_LAMP_ROOM = 0.45
"""Least distance of a lamp from every wall (metres)."""

Points = NDArray[np.float64]


def add_windows(builder: QuadBuilder, storey: StoreyCells) -> None:
    """Adds windows to long outer walls where no furniture stands in front of them."""
    for line in storey.lines:
        wall = storey.placed(line)
        if (wall.has_left and wall.has_right) or wall.length < _MIN_WALL:
            continue
        out = wall.left * (1 if wall.has_left else -1)
        count = max(1, int(wall.length / _WINDOW_EVERY))
        for k in range(count):
            middle = wall.start + (wall.end - wall.start) * (k + 0.5) / count
            sill = _floor_at(storey, middle + out * 0.15) + _SILL
            fits = sill + _WINDOW[1] + 0.1 < storey.ceiling_y
            if fits and _is_outer(storey, middle, wall.along, out) and not _is_taken(storey, middle, wall.along, out):
                add_window(builder, spot_on_wall(middle, out, sill), _WINDOW)


def _floor_at(storey: StoreyCells, xz: Points) -> float:
    row, col = storey.grid.rc_from_xz(xz)
    height = float(storey.space.floor[row, col])
    return storey.floor_y if np.isnan(height) else height


def _is_outer(storey: StoreyCells, middle: Points, along: Points, out: Points) -> bool:
    """Whether nothing of the storey lies behind the wall over the window's width."""
    points = np.array([middle + along * a - out * d for a in (-0.6, 0.0, 0.6) for d in _OUTSIDE])
    rc = storey.grid.rc_from_xz(points)
    known = storey.grid.contains(rc)
    before = storey.grid.rc_from_xz(np.array([middle + along * a + out * 0.12 for a in (-0.6, 0.0, 0.6)]))
    return not storey.space.inside[tuple(rc[known].T)].any() and bool(storey.space.inside[tuple(before.T)].all())


def _is_taken(storey: StoreyCells, middle: Points, along: Points, out: Points) -> bool:
    """Whether something stands or hangs where the window would be."""
    reach = np.abs(along) * (_WINDOW[0] / 2 + 0.15) + np.abs(out) * 0.3
    zone = Rect(*(middle - reach).tolist(), *(middle + reach).tolist())
    low, high = storey.floor_y + _SILL - 0.05, storey.floor_y + _SILL + _WINDOW[1]
    return any(
        piece.rect.overlaps(zone) and piece.top_y > low and piece.bottom_y < high for piece in storey.plan.furniture
    )


def add_doorways(builder: QuadBuilder, storey: StoreyCells) -> None:
    """Adds the wall over a doorway where two rooms meet in a gap between walls, and a strip on every border's floor.

    Doorways have no frame: it would take places from the robot, whose body just fits where a record proves a passage.
    """
    at_wall = widened(storey.space.walls.corners(), 2)
    for line in storey.borders:
        width = line.length * storey.grid.cell
        start, end = (tuple(np.rint(point).astype(int)) for point in (line.start, line.end))
        is_gap = all(line.is_free) and bool(at_wall[start] and at_wall[end])
        if is_gap and _DOOR[0] <= width <= _DOOR[1]:
            _add_doorway(builder, storey, storey.placed(line))
        _add_strip(builder, storey, storey.placed(line))


def _add_doorway(builder: QuadBuilder, storey: StoreyCells, line: StoreyLine) -> None:
    """Adds the wall over a gap between rooms."""
    middle = (line.start + line.end) / 2
    top = _floor_at(storey, middle) + _DOOR_TOP
    if top + 0.15 > storey.ceiling_y:
        return
    ends = [line.start - line.along * _INTO_WALL, line.end + line.along * _INTO_WALL]
    beside = [storey.rooms[tuple(storey.grid.rc_from_xz(middle + line.left * by))] for by in (0.2, -0.2)]
    finishes = [storey.room(int(number)).wall for number in beside]
    corners = [p + line.left * by for by in (_WALL_DEPTH / 2, -_WALL_DEPTH / 2) for p in ends]
    add_wall_piece(
        builder,
        WallPiece(
            *corners, bottom=top, top=storey.ceiling_y, left=finishes[0], right=finishes[1], skirting=False,
            has_underside=True,
        ),
    )  # fmt: skip


def _add_strip(builder: QuadBuilder, storey: StoreyCells, line: StoreyLine) -> None:
    """Adds a flat strip over the border of two floors, where it is level."""
    rc = storey.grid.rc_from_xz(np.linspace(line.start, line.end, max(2, int(line.length / storey.grid.cell))))
    heights = storey.space.floor[tuple(rc.T)]
    numbers = np.unique(storey.rooms[tuple(rc.T)]).tolist()
    is_one_floor = all(storey.room(number).floor == storey.room(numbers[0]).floor for number in numbers)
    if np.isnan(heights).any() or np.ptp(heights) > _STRIP_CLIMB or is_one_floor:
        return
    spot = spot_on_wall((line.start + line.end) / 2, line.left, float(np.median(heights)))
    add_strip(builder, spot, line.length)


def lamp_cells(storey: StoreyCells, ceiling: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """World (x, z) of lamps below a ceiling (rows, cols): one in the middle of every room, more in large rooms."""
    found = []
    space = storey.space
    corners = space.walls.corners()
    near_wall = corners[:-1, :-1] | corners[1:, :-1] | corners[:-1, 1:] | corners[1:, 1:]
    free = space.inside & ~space.well & ceiling & ~near_wall
    for number in sorted(set(np.unique(storey.rooms[space.inside]).tolist())):
        mine = free & (storey.rooms == number)
        if not mine.any():
            continue
        (first, last), (left, right) = ((int(at.min()), int(at.max())) for at in cells_of(mine))
        away = distance_to(~mine[first - 1 : last + 2, left - 1 : right + 2]) * storey.grid.cell
        reach = int(_LAMP_EVERY / storey.grid.cell)
        for _ in range(_MAX_LAMPS):
            row, col = divmod(int(away.argmax()), away.shape[1])
            if away[row, col] < _MIN_LAMP_ROOM:
                break
            x, z = storey.grid.xz_from_rc(np.array([first - 1 + row, left - 1 + col])).tolist()
            found.append((x, z))
            away[max(0, row - reach) : row + reach + 1, max(0, col - reach) : col + reach + 1] = 0
    return found
