"""Space of a home for one more thing: free floor off the paths that hides no captioned object; used for clutter.

Images are (rows, cols) of one storey's grid. spare_storeys.py makes them of plans.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import GridSpec

from ..plan import Furniture, Rect
from .spare_sight import Sights

Image = NDArray[np.bool_]
_SLACK = 0.004
"""Least distance between pieces (metres)."""
_RIM = 0.1
_DRAWS = 8
_SPOT, _BEFORE_WALL = 0.1, 0.15
"""Spacing of tried places along walls, and the distance before the wall at which their room is read (metres)."""


class WallFace(NamedTuple):
    """A straight piece of a wall as one room sees it."""

    start: tuple[float, float]
    end: tuple[float, float]
    """End of the face, world (x, z)."""
    out: tuple[float, float]
    """Unit vector into the room."""

    @property
    def length(self) -> float:
        """Length of the face, metres."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    def at(self, along: float, out: float) -> tuple[float, float]:
        """The place (x, z) at these distances from the start and from the wall, metres."""
        share = along / max(self.length, 1e-9)
        x = self.start[0] + (self.end[0] - self.start[0]) * share + self.out[0] * out
        z = self.start[1] + (self.end[1] - self.start[1]) * share + self.out[1] * out
        return x, z


class EmptyStorey(NamedTuple):
    """One storey before anything is added."""

    grid: GridSpec
    inside: Image
    """Cells of rooms, from wall to wall, without the walls between them."""
    walked: Image
    """Cells that the robot's body passes."""
    is_open: Image
    """Cells through which lines of sight pass."""
    floor_y: NDArray[np.float64]
    """Height of the floor, metres; nan where there is none."""
    room: NDArray[np.int64]
    """Index into the plan's rooms, -1 = none."""
    walls: tuple[WallFace, ...]
    ceiling_y: float
    places: NDArray[np.float64]
    """(N, 3) places where the robot can stand."""
    zones: NDArray[np.float64]
    """(Z, 6) boxes that stay free: doors and windows. Lowest, then highest corner."""


class SpareStorey:
    """One storey while things are added to it."""

    def __init__(self, storey: EmptyStorey, pieces: list[Furniture], seen: list[Furniture]) -> None:
        """Takes the space of the existing pieces.

        Args:
            storey: The empty storey.
            pieces: All standing, lying and hanging pieces.
            seen: Those of the pieces that must stay visible.
        """
        self.storey = storey
        self._boxes = np.array([piece.box for piece in pieces]).reshape(-1, 6)
        targets = np.array([piece.box for piece in seen]).reshape(-1, 6)
        self._sights = Sights(targets, storey.places, storey.is_open, storey.grid)
        self.free = storey.inside & ~storey.walked
        """(rows, cols) floor off the paths on which nothing stands; callers must not change it."""
        self.num_changes = 0
        """Number of changes of `free`."""
        for piece in pieces:
            self._occupy(piece)

    def take(self, piece: Furniture, *, on: Furniture | None = None, stands: bool = False) -> bool:
        """Whether a piece fits: over no other piece, across no path and no line of sight. If so, its space is taken.

        Args:
            piece: The piece with its place, before a wall of its room or on another piece.
            on: The piece on which it lies, and into whose box it may reach.
            stands: Whether it stands on the floor.
        """
        box = piece.box
        cells = self._cells(piece.rect)
        if cells is None or box[4] > self.storey.ceiling_y - 0.05:
            return False
        if stands and (self.storey.walked[cells].any() or not self._is_inside(piece.rect)):
            return False
        met = _meets(box, self._boxes)
        if on is not None:
            met &= (self._boxes != on.box).any(axis=1)
        if met.any() or _meets(box, self.storey.zones).any() or not self._sights.cut(box):
            return False
        self._boxes = np.concatenate([self._boxes, box[None]])
        if stands:
            self._occupy(piece)
        return True

    def _occupy(self, piece: Furniture) -> None:
        """Takes the floor below a piece, unless it hangs above."""
        cells = self._cells(piece.rect)
        if cells is not None and not piece.centre[1] - piece.size[1] / 2 > np.nanmax(self.storey.floor_y[cells]) + 0.3:
            self.free[cells] = False
            self.num_changes += 1

    def _is_inside(self, rect: Rect) -> bool:
        """Whether a rectangle is in its room; its rim may reach places of walls before they were straightened."""
        width = min(rect.x1 - rect.x0, rect.z1 - rect.z0)
        cells = self._cells(rect.grown(-min(_RIM, 0.3 * width)))
        return cells is not None and bool(self.storey.inside[cells].all())

    def floor_at(self, rect: Rect) -> float | None:
        """Height of the floor below a rectangle, metres; None where it is not level or has gaps."""
        cells = self._cells(rect)
        heights = np.array([np.nan]) if cells is None else self.storey.floor_y[cells]
        if np.isnan(heights).any() or np.ptp(heights) > 0.04:
            return None
        return float(heights.min())

    def _cells(self, rect: Rect) -> tuple[slice, slice] | None:
        """Rows and columns that a rectangle touches; None where it leaves the grid."""
        corners = np.array([[rect.x0, rect.z0], [rect.x1, rect.z1]]) + np.array([[_SLACK], [-_SLACK]])
        rc = self.storey.grid.rc_from_xz(corners)
        if not self.storey.grid.contains(rc).all():
            return None
        (row0, col0), (row1, col1) = rc.tolist()
        return slice(row0, max(row1, row0) + 1), slice(col0, max(col1, col0) + 1)


class WallSpot(NamedTuple):
    """A place at a wall."""

    face: WallFace
    along: float
    """Distance from the face's start, metres."""

    @property
    def yaw(self) -> float:
        """Yaw of a piece with its back to the wall."""
        return float(np.arctan2(self.face.out[0], self.face.out[1]))

    def at(self, out: float) -> tuple[float, float]:
        """The place (x, z) at this distance from the wall, metres."""
        return self.face.at(self.along, out)


class SpareRoom:
    """Random places in one room."""

    def __init__(self, storey: SpareStorey, number: int) -> None:
        """Finds the room's walls.

        Args:
            storey: The room's storey.
            number: Index into the plan's rooms.
        """
        self.storey = storey
        empty = storey.storey
        self._mine = mine = (empty.room == number) & empty.inside
        self.area = float(mine.sum()) * empty.grid.cell**2
        """Area of the room, square metres."""
        self._away: tuple[int, NDArray[np.float64]] | None = None
        rows, cols = np.nonzero(mine)
        self._part = np.s_[rows.min(initial=0) : rows.max(initial=0) + 1, cols.min(initial=0) : cols.max(initial=0) + 1]
        self._spots = [
            WallSpot(face, float(along))
            for face in empty.walls
            for along in np.arange(_SPOT / 2, face.length, _SPOT)
            if _holds(empty, mine, face.at(float(along), _BEFORE_WALL))
        ]

    @property
    def wall_length(self) -> float:
        """Total length of the room's walls, metres."""
        return _SPOT * len(self._spots)

    def wall_spot(self, width: float, rng: np.random.Generator, *, depth: float | None = None) -> WallSpot | None:
        """A random place for a thing of this width, between both ends of a wall; None where no draw fits.

        With `depth`, the floor must be free at half this distance before the wall.
        """
        for pick in rng.integers(len(self._spots), size=_DRAWS).tolist() if self._spots else ():
            spot = self._spots[pick]
            if width / 2 <= spot.along <= spot.face.length - width / 2:
                empty = self.storey.storey
                if depth is None or _holds(empty, self.storey.free, spot.at(depth / 2 + 0.02)):
                    return spot
        return None

    def floor_spot(self, radius: float, rng: np.random.Generator) -> tuple[float, float] | None:
        """(x, z) of a random place with this radius of free floor around it; None where there is none."""
        if self._away is None or self._away[0] != self.storey.num_changes:
            free = np.pad((self.storey.free & self._mine)[self._part], 1)
            away = np.asarray(ndimage.distance_transform_edt(free))[1:-1, 1:-1] * self.storey.storey.grid.cell
            self._away = self.storey.num_changes, away
        found = np.argwhere(self._away[1] >= radius)
        if not len(found):
            return None
        first = np.array([self._part[0].start, self._part[1].start])
        x, z = self.storey.storey.grid.xz_from_rc(found[int(rng.integers(len(found)))] + first).tolist()
        return x, z


def _holds(storey: EmptyStorey, mine: Image, place: tuple[float, float]) -> bool:
    rc = storey.grid.rc_from_xz(np.array(place))
    return bool(storey.grid.contains(rc)) and bool(mine[tuple(rc)])


def _meets(box: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether each of the boxes overlaps the given box."""
    return np.asarray(((boxes[:, :3] < box[3:] - _SLACK) & (boxes[:, 3:] > box[:3] + _SLACK)).all(axis=1))
