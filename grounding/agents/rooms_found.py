"""The rooms and doors of a planned home that an exploration reached, found from the home's plan for the researcher.

HomePlan + floor of a storey -> `RoomMap` -> rooms missed, doors passed.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.homes.plan import HomePlan, Wall
from sim.types import GridSpec
from sim.walk.storeys import nearest_storey

from .coverage import VisibleFloor

SEEN_SHARE = 0.5
"""A room that was not entered counts as seen when this share of its visible floor was seen."""
MIN_CELLS = 40
"""Rooms with fewer visible floor cells (0.1 m2) are never counted as missed."""
_BESIDE = 0.05
"""A path goes through a door if it crosses the wall's middle line within the door's width plus this much on each side,
metres."""


class RoomMap:
    """The rooms of one storey on the cells of its floor."""

    def __init__(self, plan: HomePlan, floor: VisibleFloor) -> None:
        """Gives every free cell of the floor to a room: the one it is in, or the nearest."""
        storey = int(nearest_storey(floor.storey_y, [storey.floor_y for storey in plan.storeys]))
        self._floor = floor
        self._plan, self._storey = plan, storey
        self._names = [room.name for room in plan.rooms]
        self._rooms = _room_image(plan, storey, floor.grid)
        self._doors = _doors(plan, storey)

    @property
    def num_doors(self) -> int:
        """Doors of the plan's walls on this storey; in homes without walls, pairs of rooms that share a border."""
        return len(self._doors) if self._plan.walls else len(_borders(self._rooms, self._floor.reachable))

    def missed(self, seen: NDArray[np.bool_], path: NDArray[np.float64]) -> tuple[str, ...]:
        """Names of the rooms neither entered nor seen.

        Args:
            seen: (rows, cols) of the floor, from `CoverageTracker.seen`.
            path: (T, 3) places of the robot, world metres.
        """
        entered = set(self._rooms_on(path))
        found = []
        for number in np.unique(self._rooms[self._floor.visible]).tolist():
            cells = self._floor.visible & (self._rooms == number)
            if number >= 0 and number not in entered and cells.sum() >= MIN_CELLS and seen[cells].mean() < SEEN_SHARE:
                found.append(self._names[number])
        return tuple(found)

    def doors_passed(self, path: NDArray[np.float64]) -> int:
        """Number of doors that the path (T, 3) went through; in homes without walls, of pairs of rooms it went between.

        Each counts once.
        """
        if self._plan.walls:
            xz = path[:, [0, 2]]
            return sum(any(_crosses(door, a, b) for a, b in pairwise(xz)) for door in self._doors)
        return len({frozenset(pair) for pair in pairwise(self._rooms_on(path)) if pair[0] != pair[1]})

    def _rooms_on(self, path: NDArray[np.float64]) -> list[int]:
        """Rooms along a path, places off the grid left out."""
        rc = self._floor.grid.rc_from_xz(path[:, [0, 2]])
        rc = rc[self._floor.grid.contains(rc)]
        return [number for number in self._rooms[rc[:, 0], rc[:, 1]].tolist() if number >= 0]


def _room_image(plan: HomePlan, storey: int, grid: GridSpec) -> NDArray[np.int64]:
    """(rows, cols) index of the room of each cell or of the nearest cell that has one; -1 where no room is named."""
    image = np.full(grid.shape, -1, np.int64)
    rows, cols = np.indices(grid.shape)
    xz = grid.xz_from_rc(np.stack([rows, cols], axis=-1))
    for number, room in enumerate(plan.rooms):
        if room.storey != storey:
            continue
        if room.rect is not None:
            rect = room.rect
            x, z = xz[..., 0], xz[..., 1]
            image[(rect.x0 <= x) & (x <= rect.x1) & (rect.z0 <= z) & (z <= rect.z1)] = number
        elif plan.cells is not None:
            cells = [(run.row, run.col + k) for run in room.area for k in range(run.length)]
            rc = grid.rc_from_xz(plan.cells.grid.xz_from_rc(np.array(cells)))
            rc = rc[grid.contains(rc)]
            image[rc[:, 0], rc[:, 1]] = number
    if (image >= 0).any():
        _, (row, col) = ndimage.distance_transform_edt(image < 0, return_indices=True)  # type: ignore[misc]
        image = image[row, col]
    return image


def _borders(rooms: NDArray[np.int64], reachable: NDArray[np.bool_]) -> set[tuple[int, int]]:
    """Pairs of rooms that have reachable cells side by side."""
    found: set[tuple[int, int]] = set()
    for a, b in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        both = reachable[a] & reachable[b] & (rooms[a] != rooms[b])
        pairs = np.sort(np.stack([rooms[a][both], rooms[b][both]], axis=1), axis=1)
        found |= {(one, two) for one, two in pairs.tolist()}
    return found


def _doors(plan: HomePlan, storey: int) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Both ends (2,) xz of each door of the storey's walls."""
    return [
        _ends(wall, opening.offset, opening.width)
        for wall in plan.walls
        if wall.storey == storey
        for opening in wall.openings
        if opening.kind == "door"
    ]


def _ends(wall: Wall, offset: float, width: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    start, end = np.array(wall.start), np.array(wall.end)
    along = (end - start) / wall.length
    return start + (offset - width / 2 - _BESIDE) * along, start + (offset + width / 2 + _BESIDE) * along


def _crosses(door: Sequence[NDArray[np.float64]], a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether the segment from a to b (2,) crosses the door's segment."""

    def side(p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64]) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    one, two = door
    return side(one, two, a) * side(one, two, b) < 0 and side(a, b, one) * side(a, b, two) < 0
