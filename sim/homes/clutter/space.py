"""Finds space in a home for one more thing: free floor off the paths, where it hides no captioned object.

Images are (rows, cols) of one storey's grid, made from the cells of schematic homes or the rooms of invented homes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.errors import SceneError
from sim.types import GridSpec

from ..building.cells.mesh import WALL
from ..building.cells.spaces import floor_layers, padded, plinth_layers
from ..building.cells.storeys import StoreyCells, StoreyLine, storeys_of_cells
from ..cells import cells_from_runs
from ..images import distance_to
from ..invented.free_space import ReachedFloor, walkable_floor
from ..invented.layouts import HALF_WALL
from ..plan import Furniture, HomePlan, Opening, Rect, Wall
from .sights import Sights

Image = NDArray[np.bool_]
_SLACK = 0.004
"""Least distance between pieces (metres)."""
_RIM = 0.1
_DRAWS = 8
_SPOT, _BEFORE_WALL = 0.1, 0.15
"""Spacing of tried places along walls, and the distance from the wall at which their room is looked up (metres)."""
_NEAR_STOREY = 1.3
"""Places on stairs up to this far above or below a storey's floor see into it (metres)."""
_BODY = 0.25
"""Distance that stays free around the places where the robot's centre can be in an invented home (metres)."""
_DOOR_DEPTH = 0.6
_WINDOW_DEPTH = 0.12
_LEAST_WALL = 0.4
_ROUNDING = 1e-6


class WallFace(NamedTuple):
    """A straight piece of a wall as one room sees it."""

    start: tuple[float, float]
    end: tuple[float, float]
    """Ends of the face, world (x, z)."""
    out: tuple[float, float]
    """Unit vector into the room."""

    @property
    def length(self) -> float:
        """Length of the face, metres."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))


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
        (x0, z0), (x1, z1), (out_x, out_z) = self.face
        share = self.along / max(self.face.length, 1e-9)
        return x0 + (x1 - x0) * share + out_x * out, z0 + (z1 - z0) * share + out_z * out


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
    """Height of the floor or of the top of a low block, metres; nan where there is neither."""
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
        """Takes the space of all pieces, standing, lying or hanging; those in `seen` must stay visible."""
        self.storey = storey
        self._boxes = np.array([piece.box for piece in pieces]).reshape(-1, 6)
        targets = np.array([piece.box for piece in seen]).reshape(-1, 6)
        self._sights = Sights(targets, storey.places, storey.is_open, storey.grid)
        self.free = storey.inside & ~storey.walked
        """Mask (rows, cols) of floor off the paths on which nothing stands; callers must not change it."""
        self.num_changes = 0
        """Number of changes of `free`."""
        for piece in pieces:
            self._occupy(piece)

    def take(self, piece: Furniture, *, on: Furniture | None = None, stands: bool = False) -> bool:
        """Takes the space of a piece if it blocks no piece, path or view; returns whether it does.

        Args:
            piece: The piece with its place, in front of a wall of its room or on another piece.
            on: The piece on which it lies; the two boxes may overlap.
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
        if cells is not None and not piece.bottom_y > np.nanmax(self.storey.floor_y[cells]) + 0.3:
            self.free[cells] = False
            self.num_changes += 1

    def _is_inside(self, rect: Rect) -> bool:
        """Whether a rectangle is in its room; its rim may overlap a wall, because drawn walls are straightened."""
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
        inner = rect.grown(-_SLACK)
        rc = self.storey.grid.rc_from_xz(np.array([[inner.x0, inner.z0], [inner.x1, inner.z1]]))
        return rect.cells(self.storey.grid, slack=_SLACK) if self.storey.grid.contains(rc).all() else None


class SpareRoom:
    """Random places in one room."""

    def __init__(self, storey: SpareStorey, number: int) -> None:
        """Finds the walls of the room with this index into the plan's rooms."""
        self.storey = storey
        empty = storey.storey
        self._mine = mine = (empty.room == number) & empty.inside
        self.area = float(mine.sum()) * empty.grid.cell**2
        """Area of the room, square metres."""
        self._away: tuple[int, NDArray[np.float64]] | None = None
        rows, cols = np.nonzero(mine)
        self._part = np.s_[rows.min(initial=0) : rows.max(initial=0) + 1, cols.min(initial=0) : cols.max(initial=0) + 1]
        spots = (WallSpot(face, float(at)) for face in empty.walls for at in np.arange(_SPOT / 2, face.length, _SPOT))
        self._spots = [spot for spot in spots if _holds(empty, mine, spot.at(_BEFORE_WALL))]

    @property
    def wall_length(self) -> float:
        """Total length of the room's walls, metres."""
        return _SPOT * len(self._spots)

    def wall_spot(self, width: float, rng: np.random.Generator, *, depth: float | None = None) -> WallSpot | None:
        """A random place for a thing of this width, between both ends of a wall; None where no draw fits.

        With `depth`, the floor must be free at half this distance in front of the wall.
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
            away = distance_to(~free)[1:-1, 1:-1] * self.storey.storey.grid.cell
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


def empty_storeys(plan: HomePlan) -> list[EmptyStorey]:
    """Every storey of a home without its furniture.

    Raises:
        SceneError: Some rooms of an invented home cannot be reached.
    """
    return _of_cells(plan) if plan.cells is not None else _of_rooms(plan)


def _of_cells(plan: HomePlan) -> list[EmptyStorey]:
    """Storeys of a schematic home: things may stand on its low blocks and where the robot's body never passes."""
    assert plan.cells is not None
    layers = padded(floor_layers(plan.cells, plan.storeys), np.nan)
    plinths = padded(plinth_layers(plan.cells, plan.storeys), np.nan)
    walkable = cells_from_runs(plan.cells.walkable)
    xz = plan.cells.grid.xz_from_rc(walkable.rc)
    places = np.stack([xz[:, 0], walkable.y, xz[:, 1]], axis=1)
    found = []
    for k, storey in enumerate(storeys_of_cells(plan, layers)):
        near = [layer for layer in (2 * k - 1, 2 * k, 2 * k + 1) if 0 <= layer < len(layers)]
        body = np.asarray(~np.isnan(layers[near]).all(axis=0))
        is_open = body | ~np.isnan(plinths[near]).all(axis=0)
        space = storey.space
        inside = space.open & ~space.well
        found.append(
            EmptyStorey(
                storey.grid,
                inside & ~_walls_across(storey),
                body,
                np.asarray(ndimage.binary_dilation(is_open), bool),
                np.where(np.isnan(space.block), space.floor, space.block),
                np.where(inside, storey.rooms, -1),
                tuple(face for line in storey.lines for face in _faces(storey.placed(line))),
                storey.ceiling_y,
                places[np.abs(places[:, 1] - storey.floor_y) < _NEAR_STOREY],
                np.zeros((0, 6)),
            )
        )
    return found


def _walls_across(storey: StoreyCells) -> Image:
    """Cells beside the walls between rooms."""
    ways = np.asarray(storey.space.walls.ways().any(axis=2))
    edges = np.asarray(ways[:-1, :-1] & ways[1:, 1:] | ways[1:, :-1] & ways[:-1, 1:], bool)
    inner = ndimage.binary_erosion(storey.space.open, iterations=2)
    return np.logical_and(edges, inner)


def _faces(wall: StoreyLine) -> list[WallFace]:
    """The sides of a straight wall that have a room beside them."""
    if wall.length < _LEAST_WALL:
        return []
    half = WALL / 2 if wall.has_left and wall.has_right else 0.0
    found = []
    for is_seen, out in ((wall.has_left, wall.left), (wall.has_right, -wall.left)):
        if is_seen:
            a, b = wall.start + out * half, wall.end + out * half
            found.append(WallFace((a[0], a[1]), (b[0], b[1]), (float(out[0]), float(out[1]))))
    return found


def _of_rooms(plan: HomePlan) -> list[EmptyStorey]:
    """Storeys of an invented home: things may stand only where the robot cannot go, so that no path changes."""
    floors = walkable_floor(plan)
    if floors is None:
        raise SceneError(
            f"plan {plan.name!r}: found rooms or stairs that cannot be reached; expected a path to all of them. "
            "Make the plan again with personal-viz invent."
        )
    return [_storey_of_rooms(plan, k, floor) for k, floor in enumerate(floors)]


def _storey_of_rooms(plan: HomePlan, k: int, ground: ReachedFloor) -> EmptyStorey:
    floor_y = plan.storeys[k].floor_y
    grid = ground.grid
    room = np.full(grid.shape, -1, np.int64)
    faces: list[WallFace] = []
    for number, item in enumerate(plan.rooms):
        if item.storey == k and item.rect is not None:
            inner = item.rect.grown(-HALF_WALL)
            room[inner.cells(grid, slack=_ROUNDING)] = number
            faces += _faces_of_rect(inner)
    is_open = room >= 0
    zones = []
    for wall in (wall for wall in plan.walls if wall.storey == k):
        for opening in wall.openings:
            zones.append(_zone(wall, opening, floor_y))
            if opening.kind == "door":
                is_open[wall.floor_beside(opening, depth=0.15, margin=0.05).cells(grid, slack=_ROUNDING)] = True
    for stair in plan.stairs:
        room[stair.rect.grown(0.1).cells(grid, slack=_ROUNDING)] = -1
    xz = ground.places()
    return EmptyStorey(
        grid,
        room >= 0,
        distance_to(ground.reached) * grid.cell <= _BODY,
        is_open,
        np.where(room >= 0, floor_y, np.nan),
        room,
        tuple(faces),
        floor_y + plan.storeys[k].ceiling,
        np.stack([xz[:, 0], np.full(len(xz), floor_y), xz[:, 1]], axis=1),
        np.array(zones).reshape(-1, 6),
    )


def _faces_of_rect(inner: Rect) -> list[WallFace]:
    x0, z0, x1, z1 = inner
    return [
        WallFace((x0, z0), (x1, z0), (0.0, 1.0)),
        WallFace((x0, z1), (x1, z1), (0.0, -1.0)),
        WallFace((x0, z0), (x0, z1), (1.0, 0.0)),
        WallFace((x1, z0), (x1, z1), (-1.0, 0.0)),
    ]


def _zone(wall: Wall, opening: Opening, floor_y: float) -> NDArray[np.float64]:
    """The box (6,) in front of an opening and behind it that stays free."""
    depth = _DOOR_DEPTH if opening.kind == "door" else wall.thickness / 2 + _WINDOW_DEPTH
    rect = wall.floor_beside(opening, depth=depth, margin=0.05)
    return np.array([rect.x0, floor_y + opening.sill - 0.05, rect.z0, rect.x1, floor_y + opening.top + 0.1, rect.z1])
