"""The benchmark's house as boxes and ellipsoids: two furnished storeys of 14 x 8 m joined by a stair."""

import itertools
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

LENGTH, WIDTH = 14.0, 8.0
"""Outer size along x and z, metres."""
STOREY_HEIGHT = 2.88
"""Floor to floor: sixteen risers of 18 cm."""
_CEILING = STOREY_HEIGHT - 0.2
_WALL = 0.06
"""Half the thickness of a wall, metres."""
_CROSS_X = (4.5, 9.5)
"""Places along x of the walls between the rooms of one side, metres."""
_CORRIDOR_Z = (3.4, 4.6)
_RISER, _TREAD, _TREADS = 0.18, 0.22, 15
_STAIR_X, _STAIR_Z = 5.3, (6.7, 7.94)
_HOLE = (_STAIR_X, 6.6, _STAIR_X + _TREAD * _TREADS, WIDTH)
"""Opening of the upper floor over the stair: x, z, x, z."""
Point = tuple[float, float, float]


class Solid(NamedTuple):
    """An upright box, or the ellipsoid in it, between its lowest and highest corner (world metres)."""

    low: Point
    high: Point
    is_round: bool = False
    instance: int = 0
    """Object id, 0 = the building."""


class Opening(NamedTuple):
    """A door or window in a wall."""

    start: float
    end: float
    """Both ends along the wall, metres."""
    sill: float
    lintel: float
    """Both heights above the floor, metres."""


@dataclass(frozen=True, slots=True)
class Room:
    """A rectangle of floor with its door on the corridor's side."""

    x: tuple[float, float]
    z: tuple[float, float]
    floor_y: float
    is_north: bool
    """North rooms (z below the corridor) have their door at the z maximum."""

    @property
    def has_stair(self) -> bool:
        """Whether the stair, or the opening over it, is in this room."""
        return not self.is_north and self.x[0] == _CROSS_X[0]


def house_solids(rng: np.random.Generator) -> list[Solid]:
    """Walls with doorways and windows, floors, ceilings, a stair, and furniture in every room."""
    solids = [*_slabs(), *_stair(), *_walls(0.0), *_walls(STOREY_HEIGHT)]
    pieces = [piece for room in rooms() for piece in _furnished(room, rng)]
    return solids + [solid._replace(instance=k) for k, piece in enumerate(pieces, start=1) for solid in piece]


def rooms() -> list[Room]:
    """The six rooms of each storey; the middle ones in the south hold the stair and the opening over it."""
    ends = (_WALL, *_CROSS_X, LENGTH - _WALL)
    sides = ((_WALL, _CORRIDOR_Z[0]), (_CORRIDOR_Z[1], WIDTH - _WALL))
    return [
        Room(x, z, floor_y, z is sides[0])
        for floor_y in (0.0, STOREY_HEIGHT)
        for x in itertools.pairwise(ends)
        for z in sides
    ]


def clutter_quads(num_quads: int, *, num_heaps: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Small slanted pieces (leaves, sticks, book covers) in heaps on furniture, at walls and below ceilings.

    The heaps keep their size; more pieces means smaller ones.

    Returns:
        (N, 4, 3) quads, heap by heap; no two share an edge.
    """
    found = rooms()
    room = [found[k] for k in rng.integers(len(found), size=num_heaps)]
    low = np.array([[r.x[0] + 0.3, r.floor_y, r.z[0] + 0.3] for r in room])
    high = np.array([[r.x[1] - 0.3, r.floor_y, r.z[1] - 0.3] for r in room])
    share = rng.random((num_heaps, 3))
    # Heaps hang above the robot's head, or lie lower near the outer wall, away from the stair: rooms stay walkable.
    has_stair = np.array([r.has_stair for r in room])
    high[has_stair, 2] = _STAIR_Z[0] - 0.5
    is_low = (rng.random(num_heaps) < 0.4) & ~has_stair
    is_north = np.array([r.is_north for r in room])
    share[is_low, 2] = np.where(is_north, 0.15 * share[:, 2], 1 - 0.15 * share[:, 2])[is_low]
    centre = low + share * (high - low)
    centre[:, 1] += np.where(is_low, rng.uniform(0.1, 1.2, num_heaps), rng.uniform(1.3, 2.4, num_heaps))
    heap = np.sort(rng.integers(num_heaps, size=num_quads))
    reach = rng.uniform(0.12, 0.3, num_heaps)[heap]
    middle = centre[heap] + _directions(num_quads, rng) * (reach * rng.random(num_quads) ** (1 / 3))[:, None]
    along = _directions(num_quads, rng)
    across = np.cross(along, _directions(num_quads, rng))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    # The pieces of a heap together cover about three times its cross section, however many they are.
    area = 3 * np.pi * reach**2 / max(num_quads / num_heaps, 1)
    thinness = rng.choice([1.5, 4.0, 25.0], size=num_quads)  # book covers, leaves, sticks
    length = np.sqrt(area * thinness)
    a, b = along * length[:, None] / 2, across * (length / thinness)[:, None] / 2
    return np.stack([middle - a - b, middle + a - b, middle + a + b, middle - a + b], axis=1)


def _directions(num: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(N, 3) random unit vectors."""
    vectors = rng.normal(size=(num, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _walls(floor_y: float) -> list[Solid]:
    """Outer walls with windows, two corridor walls with a door per room, four walls between rooms."""
    middles = [(a + b) / 2 for a, b in itertools.pairwise((0.0, *_CROSS_X, LENGTH))]
    doors = [Opening(m - 0.45, m + 0.45, 0.0, 2.05) for m in middles]
    windows = [Opening(m - 0.7, m + 0.7, 0.9, 2.1) for m in middles]
    end_windows = [Opening(1.2, 2.2, 0.9, 2.1), Opening(5.6, 6.4, 0.9, 2.1)]
    walls = [_wall("x", z, (0.0, LENGTH), windows, floor_y=floor_y) for z in (0.0, WIDTH)]
    walls += [_wall("z", x, (_WALL, WIDTH - _WALL), end_windows, floor_y=floor_y) for x in (0.0, LENGTH)]
    walls += [_wall("x", z, (_WALL, LENGTH - _WALL), doors, floor_y=floor_y) for z in _CORRIDOR_Z]
    for span in ((_WALL, _CORRIDOR_Z[0] - _WALL), (_CORRIDOR_Z[1] + _WALL, WIDTH - _WALL)):
        walls += [_wall("z", x, span, [], floor_y=floor_y) for x in _CROSS_X]
    return [solid for wall in walls for solid in wall]


def _wall(
    axis: Literal["x", "z"], at: float, span: tuple[float, float], openings: list[Opening], *, floor_y: float
) -> list[Solid]:
    """A wall along an axis with openings in ascending order."""

    def part(start: float, end: float, low: float, high: float) -> Solid:
        a, b = (start, at - _WALL), (end, at + _WALL)
        if axis == "z":
            a, b = a[::-1], b[::-1]
        return Solid((a[0], floor_y + low, a[1]), (b[0], floor_y + high, b[1]))

    solids = []
    start = span[0]
    for opening in openings:
        solids.append(part(start, opening.start, 0.0, _CEILING))
        solids.append(part(opening.start, opening.end, opening.lintel, _CEILING))
        if opening.sill > 0:
            solids.append(part(opening.start, opening.end, 0.0, opening.sill))
        start = opening.end
    return [*solids, part(start, span[1], 0.0, _CEILING)]


def _slabs() -> list[Solid]:
    """Floors and ceilings of both storeys; the upper floor is open over the stair."""
    x0, z0, x1, _ = _HOLE
    around = (((0, 0), (LENGTH, z0)), ((0, z0), (x0, WIDTH)), ((x1, z0), (LENGTH, WIDTH)))
    upper = [Solid((low[0], _CEILING, low[1]), (high[0], STOREY_HEIGHT, high[1])) for low, high in around]
    roof = Solid((0, STOREY_HEIGHT + _CEILING, 0), (LENGTH, 2 * STOREY_HEIGHT, WIDTH))
    return [Solid((0, -0.2, 0), (LENGTH, 0, WIDTH)), *upper, roof]


def _stair() -> list[Solid]:
    """A straight solid stair along x."""
    ends = [(_STAIR_X + k * _TREAD, (k + 1) * _RISER) for k in range(_TREADS)]
    return [Solid((x, 0, _STAIR_Z[0]), (x + _TREAD, y, _STAIR_Z[1])) for x, y in ends]


def _furnished(room: Room, rng: np.random.Generator) -> list[list[Solid]]:
    """Furniture of one room, each piece a list of solids; the path from the door stays free."""
    (x0, x1), (z0, z1) = room.x, room.z
    back_z, door_z, facing = (z0 + 0.1, z1 - 0.8, 1.0) if room.is_north else (z1 - 0.1, z0 + 0.8, -1.0)
    small = _cupboard(depth=0.5, width=0.7)
    at_back = [] if room.has_stair else [(piece, back_z) for piece in (_SHELF, _cupboard())]
    if rng.random() < 0.5:
        at_back.reverse()
    sides = itertools.cycle(((x0 + 0.1, 1.0), (x1 - 0.1, -1.0)))
    found = [
        _placed(piece, (x, room.floor_y, z), (to_middle, 1.0, facing))
        for (piece, z), (x, to_middle) in zip([*at_back, (small, door_z), (small, door_z)], sides, strict=False)
    ]
    if not room.has_stair:
        x, z = (x0 + x1) / 2, (z0 + z1) / 2
        found.append(_placed(_TABLE, (x - 0.7, room.floor_y, z - 0.45)))
        found.append(_placed(_LAMP, (x, room.floor_y + _CEILING, z)))
    return found


def _placed(piece: list[Solid], at: Point, direction: Point = (1.0, 1.0, 1.0)) -> list[Solid]:
    """A piece made in a corner at the origin, moved to `at` and mirrored where `direction` is negative."""
    found = []
    for solid in piece:
        ends = np.sort(np.array([solid.low, solid.high]) * direction, axis=0) + at
        low, high = ends.tolist()
        found.append(Solid(tuple(low), tuple(high), solid.is_round))
    return found


def _ball(centre: Point, radii: Point) -> Solid:
    low, high = np.subtract(centre, radii).tolist(), np.add(centre, radii).tolist()
    return Solid(tuple(low), tuple(high), True)


def _top_on_legs(width: float, depth: float, height: float) -> list[Solid]:
    """A board with four legs, in the corner at the origin."""
    legs = itertools.product((0.03, width - 0.08), (0.03, depth - 0.08))
    board = Solid((0, height - 0.035, 0), (width, height, depth))
    return [board, *(Solid((x, 0, z), (x + 0.05, height - 0.035, z + 0.05)) for x, z in legs)]


def _cupboard(*, depth: float = 0.55, width: float = 1.1) -> list[Solid]:
    return [
        Solid((0, 0.06, 0), (width, 1.0, depth)),
        Solid((-0.02, 1.0, -0.02), (width + 0.02, 1.04, depth + 0.02)),
        _ball((width * 0.3, 1.16, depth / 2), (0.09, 0.12, 0.09)),
        _ball((width * 0.7, 1.12, depth / 2), (0.14, 0.08, 0.14)),
    ]


_SHELF = [
    Solid((0, 0, 0), (0.03, 1.9, 0.32)),
    Solid((1.17, 0, 0), (1.2, 1.9, 0.32)),
    Solid((0.03, 0, 0), (1.17, 1.9, 0.02)),
    *(Solid((0.03, 0.1 + 0.34 * k, 0.02), (1.17, 0.125 + 0.34 * k, 0.32)) for k in range(6)),
    *(
        Solid(
            (0.06 + 0.12 * j, 0.125 + 0.34 * k, 0.04),
            (0.1 + 0.12 * j + 0.01 * (j % 4), 0.3 + 0.34 * k + 0.02 * (j * k % 5), 0.24),
        )
        for k, j in itertools.product(range(5), range(9))
    ),
]
"""With nine books on each board."""
_CHAIR = [*_top_on_legs(0.4, 0.4, 0.45), Solid((0, 0.45, 0.37), (0.4, 0.9, 0.4))]
_TABLE = [
    *_top_on_legs(1.4, 0.9, 0.75),
    _ball((0.7, 0.83, 0.45), (0.16, 0.07, 0.16)),
    *_placed(_CHAIR, (0.2, 0.0, 0.7)),
    *_placed(_CHAIR, (0.85, 0.0, 0.7)),
]
_LAMP = [Solid((-0.01, -0.5, -0.01), (0.01, 0, 0.01)), _ball((0, -0.6, 0), (0.18, 0.14, 0.18))]
