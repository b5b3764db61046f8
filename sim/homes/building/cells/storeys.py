"""One storey of a home given as cells: its walls and rooms on the padded grid, from which the other modules build."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec

from ...images import grown, nearest, parts_of, widened
from ...plan import HomePlan, Room
from .outlines import Straight, WallLines, straight_lines
from .spaces import PAD, StoreySpace, ceiling_heights, storey_spaces
from .surfaces import edges_where

Numbers = NDArray[np.int64]
_BORDER = 7.0
"""Corners of a border between rooms lie at most this far from its straight line (cells)."""


class StoreyLine(NamedTuple):
    """A straight wall or border of a storey in the world; points and directions are (x, z), metres."""

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    """Ends of the line, (2,) each."""
    has_left: bool
    has_right: bool
    """Whether the inside is on its left and on its right, seen from above from start to end."""

    @property
    def length(self) -> float:
        """Length in metres."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def along(self) -> NDArray[np.float64]:
        """Unit vector (2,) from start to end."""
        return (self.end - self.start) / self.length

    @property
    def left(self) -> NDArray[np.float64]:
        """Unit vector (2,) to the left."""
        x, z = self.along
        return np.array([z, -x])


class StoreyCells(NamedTuple):
    """One storey, before its parts are built."""

    plan: HomePlan
    index: int
    grid: GridSpec
    """Place of the padded images."""
    space: StoreySpace
    lines: list[Straight]
    """The straightened walls of the space."""
    covered: NDArray[np.bool_]
    """(rows, cols) cells of floor between the straightened walls and a little under them."""
    block: NDArray[np.float64]
    """(rows, cols) world height of the top of the low block on a cell, nan where there is none, metres."""
    rooms: Numbers
    """Index (rows, cols) of the nearest of the plan's rooms; borders between rooms are straight."""
    borders: list[Straight]
    """Borders between rooms where no wall stands."""
    ceiling_y: float
    ceiling_below: float | None
    """World height of the ceiling of the storey below."""

    @property
    def floor_y(self) -> float:
        """World height of the storey's floor."""
        return self.plan.storeys[self.index].floor_y

    def room(self, number: int) -> Room:
        """One of the plan's rooms."""
        return self.plan.rooms[number]

    @property
    def open(self) -> NDArray[np.bool_]:
        """(rows, cols) cells of floor and of blocks."""
        return self.covered | ~np.isnan(self.block)

    def ceiling_under(self, above: "StoreyCells | None") -> NDArray[np.bool_]:
        """Mask (rows, cols) of the storey's ceiling, which is open where a flight goes up to the storey above."""
        if above is None:
            return self.open
        reaches = above.space.inside & (above.space.floor < self.ceiling_y + 0.05)
        return self.open & ~above.space.well & ~reaches

    def placed(self, line: Straight) -> StoreyLine:
        """One of its walls or borders in the world."""
        has_left, has_right = (
            bool(2 * np.count_nonzero(self.space.open[tuple(side.T)]) >= len(side)) for side in (line.left, line.right)
        )
        return StoreyLine(self.xz(line.start), self.xz(line.end), has_left, has_right)

    def xz(self, rc: NDArray[np.float64]) -> NDArray[np.float64]:
        """World (x, z) of corners (row, col); (..., 2)."""
        return np.asarray(self.grid.origin_xz) + np.asarray(rc, float)[..., ::-1] * self.grid.cell


def storeys_of_cells(plan: HomePlan, floors: NDArray[np.float64]) -> list[StoreyCells]:
    """Every storey of a home with cells; `floors` are its padded `floor_layers`."""
    assert plan.cells is not None
    spaces, ceilings = storey_spaces(plan, floors), ceiling_heights(plan.storeys)
    cell = plan.cells.cell
    origin = (plan.cells.origin_xz[0] - PAD * cell, plan.cells.origin_xz[1] - PAD * cell)
    rows_cols = floors.shape[1], floors.shape[2]
    grid = GridSpec(origin, cell, rows_cols)
    found = []
    for k, space in enumerate(spaces):
        lines = straight_lines(space.walls, clear=space.inside)
        at_wall = drawn(lines, rows_cols)
        covered = between(space.inside, at_wall)
        is_block = ~np.isnan(space.block)
        block = (
            np.where(between(is_block, at_wall) & ~covered, grown(space.block, np.inf), np.nan)
            if is_block.any()
            else space.block
        )
        rooms = _rooms(plan, k)
        flights = [~np.isnan(floors[layer]) for layer in (2 * k - 1, 2 * k + 1) if 0 <= layer < len(floors)]
        floor = space.inside & ~np.any(flights, axis=0) if flights else space.inside
        borders = straight_lines(_open_borders(floor, space.walls, rooms), tolerance=_BORDER)
        rooms = _with_straight_borders(rooms, space, at_wall | drawn(borders, rows_cols))
        below = ceilings[k - 1] if k else None
        found.append(StoreyCells(plan, k, grid, space, lines, covered, block, rooms, borders, ceilings[k], below))
    return found


def between(inside: NDArray[np.bool_], at_wall: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The inside between straightened walls, and the cells that these touch (`at_wall`)."""
    near = widened(inside, 4) & ~at_wall
    parts, count = parts_of(near)
    share = np.bincount(parts.ravel(), inside.ravel(), count + 1) / np.maximum(np.bincount(parts.ravel()), 1)
    share[0] = 0
    return (share >= 0.5)[parts] | at_wall


def drawn(lines: list[Straight], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask (rows, cols) of the cells that lines touch."""
    found = np.zeros(shape, bool)
    if not lines:
        return found
    points = [np.linspace(line.start, line.end, max(2, int(line.length * 3))) for line in lines]
    row, col = np.floor(np.concatenate(points)).astype(int).T
    for dr, dc in ((0, 0), (-1, 0), (0, -1), (-1, -1)):
        found[row + dr, col + dc] = True
    return found


def _open_borders(floor: NDArray[np.bool_], walls: WallLines, rooms: Numbers) -> WallLines:
    """Edges between the floors of two rooms where no wall stands."""
    blocked = (walls.across[1:-1], walls.along[:, 1:-1])

    def is_border(a: tuple[slice, slice], b: tuple[slice, slice], axis: int) -> NDArray[np.bool_]:
        return floor[a] & floor[b] & (rooms[a] != rooms[b]) & ~blocked[axis]

    return edges_where(is_border)


def _with_straight_borders(rooms: Numbers, space: StoreySpace, at_line: NDArray[np.bool_]) -> Numbers:
    """The rooms, with every part between walls and borders (`at_line`) given to the room that holds most of it."""
    if not space.inside.any():
        return rooms
    parts, count = parts_of(space.inside & ~at_line)
    most = np.full(count + 1, -1)
    held = np.zeros(count + 1, np.int64)
    for number in np.unique(rooms[space.inside]).tolist():
        size = np.bincount(parts[(rooms == number) & (parts > 0)], minlength=count + 1)
        most, held = np.where(size > held, number, most), np.maximum(size, held)
    found = most[parts]
    nowhere = found < 0
    if nowhere.all():
        return rooms
    return found[nearest(~nowhere)]


def _rooms(plan: HomePlan, k: int) -> Numbers:
    """Index (rows, cols) of the room of each padded cell, or of the nearest cell that belongs to a room."""
    assert plan.cells is not None
    image = np.full(plan.cells.shape, -1, np.int64)
    own = [number for number, room in enumerate(plan.rooms) if room.storey == k]
    for number in own:
        for run in plan.rooms[number].area:
            image[run.row, run.col : run.col + run.length] = number
    image = np.pad(image, PAD, constant_values=-1)
    if (image < 0).all():
        return np.full(image.shape, own[0] if own else 0)
    return image[nearest(image >= 0)]
