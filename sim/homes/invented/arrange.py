"""Furnishes one room of an invented home: chooses pieces, finishes and places, so that every path stays open."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..furniture.families import look_of
from ..plan import Furniture, Rect, Room
from .free_space import FRONT, Body, FreeSpace, Pane, bounds
from .looks import Look, described, looks_of
from .recipes import BY_WINDOWS, DISTANCES, FLAT, GROUPS, INSTEAD, RECIPES, SEATS, SIZED, SIZES, SMALL, Member, Small

_TRIES, _NEEDED_TRIES = 120, 500
"""Number of places tried for a group, and for a group that every room of the kind needs."""
_SMALL_TRIES = 20
_AT_WALL = (0.005, 0.005)
_SIDE_GAP = 0.02
"""Gap between pieces of a group that stand side by side at the wall (metres)."""
_HANG_GAP = 0.04
"""Gap between a hanging piece and the pieces of its group below it (metres)."""
_YAWS = (0.0, math.pi, math.pi / 2, -math.pi / 2)
"""Yaw of a piece with its back at the wall at -z, +z, -x, +x."""


class UsedLooks:
    """The used looks of a home; no two pieces of a category look alike."""

    def __init__(self) -> None:
        """Starts without used looks."""
        self._words: set[tuple[str, str]] = set()
        self._colours: set[tuple[str, str]] = set()

    def draw(self, category: str, rng: np.random.Generator) -> Look | None:
        """A look that no piece of the category has, if possible in a new colour; None when all looks are used."""
        free = [look for look in looks_of(category) if (category, look.words) not in self._words]
        fresh = [look for look in free if (category, look.colour) not in self._colours] or free
        if not fresh:
            return None
        look = fresh[int(rng.integers(len(fresh)))]
        self._words.add((category, look.words))
        self._colours.add((category, look.colour))
        return look


class _Piece(NamedTuple):
    """A piece before it is written into the plan."""

    category: str
    word: str
    """Word for the size: "small", "large" or ""."""
    size: tuple[float, float, float]
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    """Coordinates of the centre (x, y, z), metres; y counts from the room's floor."""
    yaw: float = 0.0

    @property
    def body(self) -> Body:
        is_turned = round(abs(math.sin(self.yaw))) == 1
        w, d = (self.size[2], self.size[0]) if is_turned else (self.size[0], self.size[2])
        rect = Rect(self.x - w / 2, self.z - d / 2, self.x + w / 2, self.z + d / 2)
        return Body(rect, self.y - self.size[1] / 2, self.y + self.size[1] / 2)


def furnish_room(
    room: Room, floor_y: float, *, space: FreeSpace, used: UsedLooks, rng: np.random.Generator
) -> list[Furniture]:
    """Pieces for a room by its kind (name); groups that find no place are left out.

    The pieces are named `<category>_0`; `invent` numbers them later. The room has a rectangle; `space` is filled and
    `used` looks are added here.
    """
    found: list[Furniture] = []
    placed: list[_Piece] = []
    for group, chance in RECIPES[room.name]:
        if rng.random() < chance:
            pieces = _placed_or_instead(group, space, tries=_NEEDED_TRIES if chance == 1 else _TRIES, rng=rng)
            placed += pieces
            found += _finished(pieces, room, floor_y, used, rng)
    for small in SMALL.get(room.name, ()):
        if rng.random() < small.chance:
            pieces = _placed_small(small, placed, rng)
            placed += pieces
            found += _finished(pieces, room, floor_y, used, rng)
    return found


def _finished(
    pieces: Sequence[_Piece], room: Room, floor_y: float, used: UsedLooks, rng: np.random.Generator
) -> list[Furniture]:
    """The pieces, each with a look of its own; pieces whose looks are all used are left out."""
    looks = [used.draw(piece.category, rng) for piece in pieces]
    return [
        Furniture(
            name=f"{piece.category}_0",
            category=piece.category,
            centre=(round(piece.x, 4), round(floor_y + piece.y, 4), round(piece.z, 4)),
            size=piece.size,
            yaw=piece.yaw,
            finish=look.finish,
            caption=described(piece.category, look.words, piece.word),
            room=room.name,
        )
        for piece, look in zip(pieces, looks, strict=True)
        if look is not None
    ]


def _drawn_piece(category: str, scale: tuple[float, float, float], rng: np.random.Generator) -> _Piece:
    """A piece of the usual size times the group's scale; categories in SIZED are sometimes small or large."""
    usual = SIZES.get(category) or look_of(category).size
    word, factor = "", float(rng.uniform(0.94, 1.0))
    if category in SIZED:
        word, factor = (("small", 0.72), ("", 1.0), ("", 1.0), ("large", 1.32))[int(rng.integers(4))]
    grows_up = category in SIZED and category != "rug"
    w, h, d = (usual[k] * scale[k] for k in range(3))
    size = (round(w * factor, 3), round(h * (factor if grows_up else 1.0), 3), round(d * factor, 3))
    return _Piece(category, word, size)


def _placed_or_instead(group: str, space: FreeSpace, *, tries: int, rng: np.random.Generator) -> list[_Piece]:
    """A group, or the smaller one that replaces it, at a free place, which is then taken; [] where neither fits."""
    choice: str | None = group
    while choice is not None:
        drawn = [_drawn_piece(member.category, member.scale, rng) for member in GROUPS[choice]]
        if choice in BY_WINDOWS:
            return _beside_a_window(GROUPS[choice][0], drawn[0], space, rng)
        for _ in range(tries):
            pieces = _at_a_wall(GROUPS[choice], drawn, space.inner, DISTANCES.get(choice, _AT_WALL), rng)
            if _take(choice, pieces, space):
                return pieces
        choice = INSTEAD.get(choice)
    return []


def _at_a_wall(
    members: Sequence[Member],
    pieces: Sequence[_Piece],
    inner: Rect,
    out: tuple[float, float],
    rng: np.random.Generator,
) -> list[_Piece]:
    """The group with its back at a random place of a random wall, or at its distance from the wall."""
    side = int(rng.integers(4))
    x = inner.x0 + float(rng.uniform(0, 1)) * (inner.x1 - inner.x0)
    z = inner.z0 + float(rng.uniform(0, 1)) * (inner.z1 - inner.z0)
    origin = ((x, inner.z0), (x, inner.z1), (inner.x0, z), (inner.x1, z))[side]
    yaw = _YAWS[side]
    cos, sin = round(math.cos(yaw)), round(math.sin(yaw))
    away = float(rng.uniform(*out))
    return [
        piece._replace(
            x=origin[0] + cos * local_x + sin * (local_z + away),
            y=y,
            z=origin[1] - sin * local_x + cos * (local_z + away),
            yaw=yaw + math.pi if member.turned else yaw,
        )
        for member, piece, (local_x, y, local_z) in zip(members, pieces, _in_frame(members, pieces), strict=True)
    ]


def _in_frame(members: Sequence[Member], pieces: Sequence[_Piece]) -> list[tuple[float, float, float]]:
    """Centres in the group's frame: x along the wall, y above the floor, z from the wall into the room (metres)."""
    sizes = [piece.size for piece in pieces]
    at_wall = [k for k, member in enumerate(members) if (member.before, member.behind, member.on) == (None, None, None)]
    standing = [k for k in at_wall if members[k].hangs_at is None]
    left = -sum(sizes[k][0] + _SIDE_GAP for k in standing) / 2
    found: dict[int, tuple[float, float, float]] = {}
    for k, (member, (w, h, d)) in enumerate(zip(members, sizes, strict=True)):
        base = next((index for index in (member.before, member.behind, member.on) if index is not None), None)
        if base is None:
            x = 0.0 if member.hangs_at is not None else left + (w + _SIDE_GAP) / 2
            left += 0.0 if member.hangs_at is not None else w + _SIDE_GAP
            top = max((found[i][1] + sizes[i][1] / 2 for i in found), default=0.0)  # a large mirror hangs higher
            y = h / 2 if member.hangs_at is None else max(member.hangs_at, top + _HANG_GAP + h / 2)
            found[k] = (x, y, d / 2)
            continue
        base_x, _, base_z = found[base]
        base_w, base_h, base_d = sizes[base]
        off = 0.0 if member.on is not None else base_d / 2 + member.gap + d / 2
        z = base_z - off if member.behind is not None else base_z + off
        found[k] = (base_x + member.x * base_w, h / 2 + (base_h if member.on is not None else 0.0), z)
    return [found[k] for k in range(len(members))]


def _take(group: str, pieces: Sequence[_Piece], space: FreeSpace) -> bool:
    """Takes the group's space in the room if it is free; returns whether it is."""
    if GROUPS[group][0].hangs_at is not None:
        return space.take_wall(pieces[0].body)
    solid = [piece.body for piece in pieces if piece.category not in FLAT]
    if not solid:
        return space.take_flat(pieces[0].body.rect)
    if not all(space.inner.holds_rect(piece.body.rect) for piece in pieces):
        return False
    whole = bounds([body.rect for body in solid])
    # the robot reaches the group over this floor
    front = whole.grown(FRONT) if group in DISTANCES else whole.beside(pieces[0].yaw, FRONT)
    return space.take_floor(solid, front)


def _beside_a_window(member: Member, drawn: _Piece, space: FreeSpace, rng: np.random.Generator) -> list[_Piece]:
    """A curtain at the left or right of a window of the room; [] where none fits."""
    choices = [(pane, side) for pane in space.windows for side in (-1, 1)]
    for k in rng.permutation(len(choices)):
        pane, side = choices[int(k)]
        piece = _hung_beside(member, drawn, pane, side, space.inner)
        if space.take_wall(piece.body, beside_window=True):
            return [piece]
    return []


def _hung_beside(member: Member, piece: _Piece, pane: Pane, side: int, inner: Rect) -> _Piece:
    x, z = pane.middle
    off = side * (pane.width / 2 + piece.size[0] / 2 - 0.12)
    depth = piece.size[2] / 2 + 0.005
    sides = {
        0: (abs(z - inner.z0), (x + off, inner.z0 + depth)), 1: (abs(z - inner.z1), (x + off, inner.z1 - depth)),
        2: (abs(x - inner.x0), (inner.x0 + depth, z + off)), 3: (abs(x - inner.x1), (inner.x1 - depth, z + off)),
    }  # fmt: skip
    nearest = min(sides, key=lambda k: sides[k][0])
    (at_x, at_z) = sides[nearest][1]
    assert member.hangs_at is not None
    return piece._replace(x=at_x, y=member.hangs_at, z=at_z, yaw=_YAWS[nearest])


def _placed_small(small: Small, placed: Sequence[_Piece], rng: np.random.Generator) -> list[_Piece]:
    """The thing on a random suitable piece of the room with free space; [] when there is none."""
    drawn = _drawn_piece(small.category, (1.0, 1.0, 1.0), rng)
    supports = [piece for piece in placed if piece.category in small.supports]
    others = [piece.body for piece in placed if piece.category not in SEATS and piece.y - piece.size[1] / 2 > 0.05]
    for _ in range(_SMALL_TRIES if supports else 0):
        piece = _on_top(drawn, supports[int(rng.integers(len(supports)))], rng)
        if piece is not None and not any(_meet(piece.body, other) for other in others):
            return [piece]
    return []


def _on_top(piece: _Piece, below: _Piece, rng: np.random.Generator) -> _Piece | None:
    """The thing at a random place on the piece below, with its yaw; None when the thing is too large."""
    category, size = piece.category, piece.size
    upholstery = below.category in SEATS and SEATS[below.category] < 1
    side = 0.18 if upholstery and below.category != "bed" else 0.03
    room_x, room_z = below.size[0] / 2 - side - size[0] / 2, below.size[2] / 2 - 0.03 - size[2] / 2
    if room_x < 0 or room_z < 0:
        return None
    local_x, local_z = float(rng.uniform(-room_x, room_x)), float(rng.uniform(-room_z, room_z))
    if category == "cushion":  # leans at the back of the piece or at the pillows
        local_z = -0.12 * below.size[2] if below.category == "bed" else -0.02
    if category == "throw blanket":
        local_z = room_z if below.category == "bed" else max(-room_z, 0.05)
    cos, sin = round(math.cos(below.yaw)), round(math.sin(below.yaw))
    y = below.y - below.size[1] / 2 + below.size[1] * SEATS.get(below.category, 1.0) + size[1] / 2
    x, z = below.x + cos * local_x + sin * local_z, below.z - sin * local_x + cos * local_z
    return piece._replace(x=x, y=y, z=z, yaw=below.yaw)


def _meet(first: Body, second: Body) -> bool:
    return first.rect.grown(0.02).overlaps(second.rect) and first.low < second.high and second.low < first.high
