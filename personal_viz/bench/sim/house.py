"""The benchmark's house as patches: two furnished storeys of 14 x 8 m joined by a stair; `scenes` makes it a mesh."""

import itertools
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

Side = Literal["top", "bottom", "left", "right", "front", "back"]
_UNIT_SIDES: dict[Side, list[list[int]]] = {
    "top": [[-1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]],
    "bottom": [[-1, -1, 1], [-1, -1, -1], [1, -1, -1], [1, -1, 1]],
    "left": [[-1, -1, -1], [-1, -1, 1], [-1, 1, 1], [-1, 1, -1]],
    "right": [[1, -1, 1], [1, -1, -1], [1, 1, -1], [1, 1, 1]],
    "front": [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    "back": [[1, -1, -1], [-1, -1, -1], [-1, 1, -1], [1, 1, -1]],
}
"""Corners on [-1, 1]^3, counter-clockwise from outside; front = +z, right = +x."""
_UPRIGHT: tuple[Side, ...] = ("left", "right", "front", "back")
_ALL: tuple[Side, ...] = ("top", "bottom", *_UPRIGHT)


class Patch(NamedTuple):
    """One smooth piece of surface, to be divided into triangles."""

    corners: NDArray[np.float64]
    """(4, 3) world metres, counter-clockwise from the front."""
    ball: NDArray[np.float64] | None
    """(2, 3) centre and radii of the ellipsoid onto which the points are pushed; None = they stay on the quad."""
    instance: int
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


def house_patches(rng: np.random.Generator) -> list[Patch]:
    """Walls with doorways and windows, floors, ceilings, a stair, and furniture in every room."""
    patches = _stair()
    for floor_y in (0.0, STOREY_HEIGHT):
        patches += _walls(floor_y)
    patches += _slabs()
    instance = 1
    for room in rooms():
        for found in _furnished(room, rng):
            patches += [patch._replace(instance=instance) for patch in found]
            instance += 1
    return patches


def rooms() -> list[Room]:
    """All six rooms of both storeys; the middle one in the south holds the stair."""
    ends = (_WALL, *_CROSS_X, LENGTH - _WALL)
    found = []
    for floor_y in (0.0, STOREY_HEIGHT):
        for x0, x1 in itertools.pairwise(ends):
            found.append(Room((x0, x1), (_WALL, _CORRIDOR_Z[0]), floor_y, True))
            found.append(Room((x0, x1), (_CORRIDOR_Z[1], WIDTH - _WALL), floor_y, False))
    return found


def box(low: ArrayLike, high: ArrayLike, *, sides: tuple[Side, ...] = _ALL) -> list[Patch]:
    """The named sides of an upright box, given by its lowest and highest corner, metres."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    return [Patch((low + high) / 2 + np.array(_UNIT_SIDES[side]) * (high - low) / 2, None, 0) for side in sides]


def ellipsoid(centre: ArrayLike, radii: ArrayLike) -> list[Patch]:
    """An ellipsoid as six patches of a cube that are pushed onto it."""
    ball = np.stack([np.asarray(centre, float), np.asarray(radii, float)])
    return [Patch(ball[0] + np.array(corners) * ball[1], ball, 0) for corners in _UNIT_SIDES.values()]


def clutter_quads(num_quads: int, *, num_objects: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Small slanted pieces (leaves, sticks, book covers) in heaps on furniture, at walls and below ceilings.

    The heaps keep their size; more quads means smaller ones.

    Returns:
        (N, 4, 3) quads, heap by heap; no two share an edge.
    """
    found = rooms()
    room = [found[k] for k in rng.integers(len(found), size=num_objects)]
    low = np.array([[r.x[0] + 0.3, r.floor_y, r.z[0] + 0.3] for r in room])
    high = np.array([[r.x[1] - 0.3, r.floor_y, r.z[1] - 0.3] for r in room])
    share = rng.random((num_objects, 3))
    # Heaps hang above the robot's head, or lie lower near the outer wall, away from the stair: rooms stay walkable.
    has_stair = np.array([r.has_stair for r in room])
    high[has_stair, 2] = _STAIR_Z[0] - 0.5
    is_low = (rng.random(num_objects) < 0.4) & ~has_stair
    wall = np.array([0.0 if r.is_north else 1.0 for r in room])
    share[is_low, 2] = np.where(wall, 1 - 0.15 * share[:, 2], 0.15 * share[:, 2])[is_low]
    centre = low + share * (high - low)
    centre[:, 1] += np.where(is_low, rng.uniform(0.1, 1.2, num_objects), rng.uniform(1.3, 2.4, num_objects))
    owner = np.sort(rng.integers(num_objects, size=num_quads))
    reach = rng.uniform(0.12, 0.3, num_objects)[owner]
    offset = rng.normal(size=(num_quads, 3))
    offset *= (reach * rng.random(num_quads) ** (1 / 3) / np.linalg.norm(offset, axis=1))[:, None]
    along = rng.normal(size=(num_quads, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, rng.normal(size=(num_quads, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    # The pieces of a heap together cover about three times its cross section, however many they are.
    area = 3 * np.pi * reach**2 / np.maximum(num_quads / num_objects, 1)
    thinness = rng.choice([1.5, 4.0, 25.0], size=num_quads)  # book covers, leaves, sticks
    length = np.sqrt(area * thinness)
    middle = centre[owner] + offset
    a, b = along * length[:, None] / 2, across * (length / thinness)[:, None] / 2
    return np.stack([middle - a - b, middle + a - b, middle + a + b, middle - a + b], axis=1)


def _walls(floor_y: float) -> list[Patch]:
    """Outer walls (seen from inside), two corridor walls with a door per room, four walls between rooms."""
    patches: list[Patch] = []
    ends = (0.0, *_CROSS_X, LENGTH)
    middles = [(a + b) / 2 for a, b in itertools.pairwise(ends)]
    doors = [Opening(m - 0.45, m + 0.45, 0.0, 2.05) for m in middles]
    windows = [Opening(m - 0.7, m + 0.7, 0.9, 2.1) for m in middles]
    patches += _wall("x", 0.0, (0.0, LENGTH), windows, floor_y=floor_y, outer="back")
    patches += _wall("x", WIDTH, (0.0, LENGTH), windows, floor_y=floor_y, outer="front")
    end_windows = [Opening(1.2, 2.2, 0.9, 2.1), Opening(5.6, 6.4, 0.9, 2.1)]
    patches += _wall("z", 0.0, (0.0, WIDTH), end_windows, floor_y=floor_y, outer="left")
    patches += _wall("z", LENGTH, (0.0, WIDTH), end_windows, floor_y=floor_y, outer="right")
    for z in _CORRIDOR_Z:
        patches += _wall("x", z, (_WALL, LENGTH - _WALL), doors, floor_y=floor_y)
    for x in _CROSS_X:
        patches += _wall("z", x, (_WALL, _CORRIDOR_Z[0] - _WALL), [], floor_y=floor_y)
        patches += _wall("z", x, (_CORRIDOR_Z[1] + _WALL, WIDTH - _WALL), [], floor_y=floor_y)
    return patches


def _wall(
    axis: Literal["x", "z"],
    at: float,
    span: tuple[float, float],
    openings: list[Opening],
    *,
    floor_y: float,
    outer: Side | None = None,
) -> list[Patch]:
    """A wall along an axis with openings in ascending order, without its `outer` side, which faces outdoors."""
    inner: tuple[Side, ...] = tuple(side for side in _UPRIGHT if side != outer)

    def part(start: float, end: float, low: float, high: float, more: tuple[Side, ...]) -> list[Patch]:
        a, b = (start, at - _WALL), (end, at + _WALL)
        if axis == "z":
            a, b = a[::-1], b[::-1]
        return box((a[0], floor_y + low, a[1]), (b[0], floor_y + high, b[1]), sides=inner + more)

    patches: list[Patch] = []
    start = span[0]
    for opening in openings:
        patches += part(start, opening.start, 0.0, _CEILING, ())
        patches += part(opening.start, opening.end, opening.lintel, _CEILING, ("bottom",))
        if opening.sill > 0:
            patches += part(opening.start, opening.end, 0.0, opening.sill, ("top",))
        start = opening.end
    return patches + part(start, span[1], 0.0, _CEILING, ())


def _slabs() -> list[Patch]:
    """Floors and ceilings of both storeys; the upper floor is open over the stair."""
    x0, z0, x1, _ = _HOLE
    patches = box((0, -0.2, 0), (LENGTH, 0, WIDTH), sides=("top",))
    for low, high in (((0, 0), (LENGTH, z0)), ((0, z0), (x0, WIDTH)), ((x1, z0), (LENGTH, WIDTH))):
        patches += box((low[0], _CEILING, low[1]), (high[0], STOREY_HEIGHT, high[1]), sides=("top", "bottom"))
    rim = box((x0, _CEILING, z0), (x1, STOREY_HEIGHT, WIDTH - _WALL), sides=_UPRIGHT)
    patches += [patch._replace(corners=patch.corners[::-1]) for patch in rim]
    return patches + box((0, STOREY_HEIGHT + _CEILING, 0), (LENGTH, 2 * STOREY_HEIGHT, WIDTH), sides=("bottom",))


def _stair() -> list[Patch]:
    """A straight solid stair along x."""
    patches: list[Patch] = []
    for k in range(_TREADS):
        x, y = _STAIR_X + k * _TREAD, (k + 1) * _RISER
        patches += box((x, 0, _STAIR_Z[0]), (x + _TREAD, y, _STAIR_Z[1]), sides=("top", "back"))
        patches += box((x, y - _RISER, _STAIR_Z[0]), (x + _TREAD, y, _STAIR_Z[1]), sides=("left",))
    return patches


def _furnished(room: Room, rng: np.random.Generator) -> list[list[Patch]]:
    """Furniture of one room, each piece a list of patches; the way from the door stays free."""
    (x0, x1), (z0, z1) = room.x, room.z
    makers = [_bed, _sofa, _shelf, _cupboard, _desk]
    order = rng.permutation(len(makers))
    deep = 0.1 if room.is_north else -0.1
    back_z, door_z = (z0, z1) if room.is_north else (z1, z0)
    corners = [] if room.has_stair else [(x0 + 0.1, 1, back_z), (x1 - 0.1, -1, back_z)]
    corners += [(x0 + 0.1, 1, door_z - 9 * deep), (x1 - 0.1, -1, door_z - 9 * deep)]
    found = []
    for (x, to_middle, z), k in zip(corners, order, strict=False):
        near = z + deep
        local = makers[k]()
        direction = np.array([to_middle, 1.0, 1.0 if room.is_north else -1.0])
        if z not in (z0, z1):
            local = _cupboard(depth=0.5, width=0.7)
        found.append(_placed(local, np.array([x, room.floor_y, near]), direction))
    if not room.has_stair:
        middle = np.array([(x0 + x1) / 2 - 0.7, room.floor_y, (z0 + z1) / 2 - 0.45])
        found.append(_placed(_table(), middle, np.ones(3)))
        lamp = np.array([(x0 + x1) / 2, room.floor_y + _CEILING, (z0 + z1) / 2])
        found.append(_placed(_lamp(), lamp, np.ones(3)))
    return found


def _placed(patches: list[Patch], at: NDArray[np.float64], direction: NDArray[np.float64]) -> list[Patch]:
    """Patches made in a corner at the origin, moved to `at` and mirrored where `direction` (3,) is negative."""
    mirrored = np.prod(direction) < 0
    placed = []
    for corners, ball, instance in patches:
        moved = at + corners * direction
        if ball is not None:
            ball = np.stack([at + ball[0] * direction, ball[1]])
        placed.append(Patch(moved[::-1] if mirrored else moved, ball, instance))
    return placed


def _bed() -> list[Patch]:
    patches = box((0, 0.08, 0), (1.0, 0.3, 1.5)) + box((0.02, 0.3, 0.02), (0.98, 0.48, 1.48))
    return patches + box((0, 0, -0.06), (1.0, 0.9, 0)) + ellipsoid((0.5, 0.52, 0.3), (0.35, 0.1, 0.2))


def _sofa() -> list[Patch]:
    patches = box((0, 0.1, 0), (1.5, 0.42, 0.8)) + box((0, 0.42, 0), (1.5, 0.85, 0.2))
    patches += box((0, 0.42, 0.2), (0.15, 0.6, 0.8)) + box((1.35, 0.42, 0.2), (1.5, 0.6, 0.8))
    return patches + [p for x in (0.45, 1.0) for p in ellipsoid((x, 0.6, 0.32), (0.22, 0.2, 0.1))]


def _shelf() -> list[Patch]:
    patches = box((0, 0, 0), (0.03, 1.9, 0.32)) + box((1.17, 0, 0), (1.2, 1.9, 0.32))
    patches += box((0.03, 0, 0), (1.17, 1.9, 0.02), sides=("front",))
    for k in range(6):
        y = 0.1 + 0.34 * k
        patches += box((0.03, y, 0.02), (1.17, y + 0.025, 0.32))
        for j in range(9 if k < 5 else 0):
            x = 0.06 + 0.12 * j
            patches += box((x, y + 0.025, 0.04), (x + 0.04 + 0.01 * (j % 4), y + 0.2 + 0.02 * (j * k % 5), 0.24))
    return patches


def _cupboard(*, depth: float = 0.55, width: float = 1.1) -> list[Patch]:
    patches = box((0, 0.06, 0), (width, 1.0, depth)) + box((-0.02, 1.0, -0.02), (width + 0.02, 1.04, depth + 0.02))
    patches += ellipsoid((width * 0.3, 1.16, depth / 2), (0.09, 0.12, 0.09))
    return patches + ellipsoid((width * 0.7, 1.12, depth / 2), (0.14, 0.08, 0.14))


def _desk() -> list[Patch]:
    patches = _top_on_legs(1.3, 0.65, 0.74) + box((0.5, 0.76, 0.1), (1.0, 1.08, 0.13))
    return patches + box((0.72, 0.74, 0.06), (0.78, 0.8, 0.1)) + box((0.55, 0.76, 0.3), (0.95, 0.78, 0.44))


def _table() -> list[Patch]:
    patches = _top_on_legs(1.4, 0.9, 0.75) + ellipsoid((0.7, 0.83, 0.45), (0.16, 0.07, 0.16))
    for x in (0.2, 0.85):
        chair = _top_on_legs(0.4, 0.4, 0.45) + box((0, 0.45, 0.37), (0.4, 0.9, 0.4))
        patches += _placed(chair, np.array([x, 0.0, 0.7]), np.ones(3))
    return patches


def _lamp() -> list[Patch]:
    return box((-0.01, -0.5, -0.01), (0.01, 0, 0.01)) + ellipsoid((0, -0.6, 0), (0.18, 0.14, 0.18))


def _top_on_legs(width: float, depth: float, height: float) -> list[Patch]:
    """A board with four legs, in the corner at the origin."""
    patches = box((0, height - 0.035, 0), (width, height, depth))
    for x in (0.03, width - 0.08):
        for z in (0.03, depth - 0.08):
            patches += box((x, 0, z), (x + 0.05, height - 0.035, z + 0.05), sides=_UPRIGHT)
    return patches
