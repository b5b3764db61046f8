"""Furnishes one room of an invented home: which pieces, in which finish, and where, so that every path stays open."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .furniture.appearance import COLOURS
from .furniture.families import look_of
from .plan import Finish, Furniture, Material, Opening, Rect, Room, Wall

GAP = 0.65
"""Least distance between pieces that stand free of each other (metres); the robot needs 0.36."""
FRONT = 0.75
"""Free depth in front of a piece."""
_TRIES = 80
_HALF_WALL = 0.06
_TALL = 1.0


class Member(NamedTuple):
    """One piece of a group, in the group's frame: x along the wall, z from the wall into the room (metres)."""

    category: str
    x: float = 0.0
    z: float | None = None
    """Middle of the piece; None = its back against the wall."""
    turned: bool = False
    """Looks at the wall instead of into the room."""
    on: int | None = None
    """Index of the member that it stands on."""
    hangs_at: float | None = None
    """Height of its middle when it hangs on the wall."""


GROUPS: dict[str, tuple[Member, ...]] = {
    "sofa set": (
        Member("couch"), Member("rug", z=1.55), Member("coffee table", z=1.55), Member("vase", x=0.2, on=2),
    ),
    "tv set": (Member("tv stand"), Member("tv", on=0)),
    "armchair": (Member("armchair"),),
    "bookshelf": (Member("bookshelf"),),
    "lamp": (Member("lamp"),),
    "plant": (Member("plant"),),
    "bench": (Member("bench"),),
    "dresser": (Member("dresser"), Member("vase", x=0.25, on=0)),
    "wardrobe": (Member("wardrobe"),),
    "bed set": (
        Member("bed"), Member("nightstand", x=-1.05), Member("nightstand", x=1.05), Member("table lamp", on=1),
    ),
    "guest bed": (Member("bed"), Member("nightstand", x=1.05), Member("table lamp", on=1)),
    "desk set": (Member("desk"), Member("desk chair", z=0.95, turned=True), Member("table lamp", x=-0.4, on=0)),
    "computer desk": (Member("desk"), Member("desk chair", z=0.95, turned=True), Member("monitor", on=0)),
    "kitchen row": (Member("kitchen lower cabinet", x=-0.72), Member("stove"), Member("kitchen lower cabinet", x=0.72)),
    "refrigerator": (Member("refrigerator"),),
    "dining set": (
        Member("dining table", z=1.1), Member("chair", x=-0.4, z=0.35), Member("chair", x=0.4, z=1.85, turned=True),
        Member("chair", x=-0.4, z=1.85, turned=True), Member("vase", on=0),
    ),
    "breakfast table": (Member("table", z=0.33), Member("chair", z=0.95, turned=True)),
    "bathtub": (Member("bathtub"),),
    "toilet": (Member("toilet"),),
    "wash place": (Member("bathroom cabinet"), Member("mirror", hangs_at=1.35)),
    "washing machine": (Member("washing machine"),),
    "picture": (Member("picture", hangs_at=1.45),),
    "rug": (Member("rug", z=1.4),),
}  # fmt: skip
CENTRED = {"dining set"}
"""Groups that stand free in the room."""
RECIPES: dict[str, tuple[tuple[str, float], ...]] = {
    "entrance hall": (("bench", 0.7), ("picture", 1.0), ("plant", 0.6)),
    "upper hall": (("plant", 0.7), ("picture", 1.0)),
    "kitchen": (("kitchen row", 1.0), ("refrigerator", 1.0), ("breakfast table", 0.7)),
    "dining room": (("dining set", 1.0), ("picture", 0.7)),
    "living room": (
        ("sofa set", 1.0), ("tv set", 1.0), ("armchair", 1.0), ("armchair", 0.7), ("lamp", 0.7), ("picture", 1.0),
        ("bookshelf", 0.5),
    ),
    "study": (("desk set", 1.0), ("bookshelf", 1.0), ("armchair", 0.5)),
    "office": (("computer desk", 1.0), ("bookshelf", 0.7), ("picture", 0.7)),
    "playroom": (("armchair", 1.0), ("breakfast table", 1.0), ("rug", 1.0), ("picture", 0.6)),
    "main bedroom": (("bed set", 1.0), ("wardrobe", 1.0), ("picture", 0.7), ("armchair", 0.4)),
    "guest bedroom": (("guest bed", 1.0), ("dresser", 0.8), ("wardrobe", 0.5), ("picture", 0.5)),
    "bathroom": (("bathtub", 1.0), ("toilet", 1.0), ("wash place", 1.0), ("washing machine", 0.6)),
}  # fmt: skip
"""(group, chance) of each kind of room."""


class Look(NamedTuple):
    """What a piece looks like, in words and as a finish."""

    words: str
    finish: Finish


_MATERIALS: dict[str, Material] = {
    "fabric": "fabric", "velvet": "fabric", "wooden": "wood", "enamel": "metal", "ceramic": "ceramic",
    "painted": "picture", "framed": "picture", "woven": "carpet", "paper": "paper",
}  # fmt: skip


def _finishes(colours: Sequence[str], words: Sequence[str]) -> tuple[Look, ...]:
    return tuple(
        Look(f"{c} {word}", Finish(material=_MATERIALS[word], rgb=COLOURS[c])) for word in words for c in colours
    )


_FABRIC = _finishes(("green", "red", "blue", "grey", "yellow", "purple", "teal", "beige"), ("fabric", "velvet"))
_WOODS = (
    *(Look(wood, Finish(material="wood", rgb=COLOURS[wood])) for wood in ("oak", "walnut")),
    *_finishes(("white", "black", "blue", "red", "green", "yellow", "grey"), ("wooden",)),
)
_ENAMEL = _finishes(("white", "silver", "red", "black", "cream"), ("enamel",))
_GLAZED = _finishes(("blue", "red", "white", "turquoise", "orange", "black"), ("ceramic",))
_PAINTED = _finishes(("blue", "red", "green", "orange", "purple", "yellow", "grey"), ("painted", "framed"))
_BY_FAMILY: dict[str, tuple[Look, ...]] = {
    "sofa": _FABRIC, "bed": _FABRIC, "flat": _finishes(("red", "blue", "green", "beige", "purple", "grey"), ("woven",)),
    "lamp": _finishes(("yellow", "white", "red", "green", "orange", "blue"), ("paper",)), "plant": _GLAZED,
    "toilet": _ENAMEL, "tub": _ENAMEL, "panel": _PAINTED,
}  # fmt: skip
_APPLIANCES = ("refrigerator", "stove", "washing machine")


def furnish_room(
    room: Room,
    floor_y: float,
    *,
    walls: Sequence[Wall],
    blocked: Sequence[Rect],
    taken: Sequence[Furniture],
    rng: np.random.Generator,
) -> list[Furniture]:
    """Pieces for a room by its kind (name); groups that find no place are left out.

    Args:
        room: A room with a rectangle.
        floor_y: Height of its floor, metres.
        walls: Walls of its storey, for doors and windows.
        blocked: Where nothing may stand (stairs and their ends).
        taken: Pieces of the home so far: names go on counting, and no finish repeats within a category.
        rng: Draws kinds, finishes and places.
    """
    assert room.rect is not None
    inner = room.rect.grown(-_HALF_WALL)
    doors = [_door_zone(wall, opening) for wall in walls for opening in wall.openings if opening.kind == "door"]
    panes = [_pane_zone(wall, opening) for wall in walls for opening in wall.openings if opening.kind == "window"]
    space = _Space(inner, [*blocked, *doors], [*panes, *doors], [], [])
    pieces: list[Furniture] = []
    for group, chance in RECIPES[room.name]:
        if rng.random() < chance:
            pieces += _placed_group(group, room, floor_y, space, [*taken, *pieces], rng)
    return pieces


class _Space(NamedTuple):
    """What is where in the room while it is being furnished."""

    inner: Rect
    keep_free: list[Rect]
    """Doors, stairs."""
    holes: list[Rect]
    """Windows and doors, where nothing tall or hanging may be."""
    bodies: list[Rect]
    fronts: list[Rect]


def _door_zone(wall: Wall, opening: Opening) -> Rect:
    """The way through a door, 1.1 m deep on both sides."""
    return _zone(wall, opening, depth=1.1, margin=0.15)


def _pane_zone(wall: Wall, opening: Opening) -> Rect:
    return _zone(wall, opening, depth=0.3, margin=0.1)


def _zone(wall: Wall, opening: Opening, *, depth: float, margin: float) -> Rect:
    share = opening.offset / wall.length
    x = wall.start[0] + (wall.end[0] - wall.start[0]) * share
    z = wall.start[1] + (wall.end[1] - wall.start[1]) * share
    half = opening.width / 2 + margin
    along_x = wall.start[1] == wall.end[1]
    return Rect(x - half, z - depth, x + half, z + depth) if along_x else Rect(x - depth, z - half, x + depth, z + half)


def _placed_group(
    group: str, room: Room, floor_y: float, space: _Space, taken: list[Furniture], rng: np.random.Generator
) -> list[Furniture]:
    """The group's pieces at a free place, which is then taken; nothing after _TRIES tries."""
    members = GROUPS[group]
    sizes = [_drawn_size(member, rng) for member in members]
    finishes = _drawn_finishes(members, taken, rng)
    for _ in range(_TRIES):
        pieces = _at_a_wall(group, members, sizes, finishes, room, floor_y, space, taken, rng)
        if _fits(group, pieces, space):
            return pieces
    return []


def _drawn_size(member: Member, rng: np.random.Generator) -> tuple[float, float, float]:
    width, height, depth = look_of(member.category)[1]
    factor = float(rng.uniform(0.94, 1.0))
    return (round(width * factor, 3), height, round(depth * factor, 3))


def _drawn_finishes(members: Sequence[Member], taken: list[Furniture], rng: np.random.Generator) -> list[Look]:
    """One finish per member; none twice within a category of the home while there are others."""
    used = {(piece.category, piece.caption) for piece in taken}
    found: list[Look] = []
    for member in members:
        family = look_of(member.category)[0]
        choices = _ENAMEL if member.category in _APPLIANCES else _BY_FAMILY.get(family, _WOODS)
        free = [choice for choice in choices if (member.category, _caption(choice, member.category)) not in used]
        finish = (free or choices)[int(rng.integers(len(free or choices)))]
        used.add((member.category, _caption(finish, member.category)))
        found.append(finish)
    return found


def _caption(finish: Look, category: str) -> str:
    if category == "plant":
        return f"plant with a {finish.words} pot"
    return f"{finish.words} {category}"


def _at_a_wall(
    group: str,
    members: Sequence[Member],
    sizes: list[tuple[float, float, float]],
    finishes: list[Look],
    room: Room,
    floor_y: float,
    space: _Space,
    taken: list[Furniture],
    rng: np.random.Generator,
) -> list[Furniture]:
    """The group with its back at a random place of a random wall (or somewhere in the room)."""
    inner = space.inner
    side = int(rng.integers(4))
    yaw = (0.0, math.pi, math.pi / 2, -math.pi / 2)[side]
    along = float(rng.uniform(0, 1))
    out = float(rng.uniform(0.4, 1.2)) if group in CENTRED else 0.005
    x0 = (inner.x0 + along * (inner.x1 - inner.x0), inner.x0)[side // 2]
    z0 = (inner.z0, inner.z0 + along * (inner.z1 - inner.z0))[side // 2]
    origin = ((x0, z0), (x0, inner.z1), (x0, z0), (inner.x1, z0))[side]
    cos, sin = round(math.cos(yaw)), round(math.sin(yaw))
    pieces: list[Furniture] = []
    for member, size, finish in zip(members, sizes, finishes, strict=True):
        local_x, local_z = member.x, out + (size[2] / 2 if member.z is None else member.z)
        y = floor_y + size[1] / 2 if member.hangs_at is None else floor_y + member.hangs_at
        if member.on is not None:
            below = members[member.on]
            local_x += below.x
            local_z = out + (sizes[member.on][2] / 2 if below.z is None else below.z)
            y = floor_y + sizes[member.on][1] + size[1] / 2
        x, z = origin[0] + cos * local_x + sin * local_z, origin[1] - sin * local_x + cos * local_z
        pieces.append(
            Furniture(
                name=f"{member.category}_{len(taken) + len(pieces) + 1}",
                category=member.category,
                centre=(round(x, 4), round(y, 4), round(z, 4)),
                size=size,
                yaw=yaw + math.pi if member.turned else yaw,
                finish=finish.finish,
                caption=_caption(finish, member.category),
                room=room.name,
            )
        )
    return pieces


def _fits(group: str, pieces: list[Furniture], space: _Space) -> bool:
    """Whether the group stands free in the room; if so its place is noted in `space`."""
    hanging = all(GROUPS[group][k].hangs_at is not None for k in range(len(pieces)))
    solid = [piece for piece in pieces if look_of(piece.category)[0] != "flat"]
    whole = _bounds([piece.rect for piece in (solid or pieces)])
    if not all(space.inner.holds_rect(piece.rect) for piece in pieces):
        return False
    is_tall = hanging or any(piece.centre[1] + piece.size[1] / 2 - _floor_of(pieces) > _TALL for piece in pieces)
    if is_tall and any(whole.grown(0.05).overlaps(hole) for hole in space.holes):
        return False
    if hanging:
        if any(whole.grown(0.1).overlaps(body) for body in space.bodies):
            return False
        space.bodies.append(whole)
        return True
    if not solid:  # a rug: one walks over it
        return not any(whole.overlaps(zone) for zone in (*space.keep_free, *space.bodies))
    front = whole.grown(GAP) if group in CENTRED else _front(pieces[0], whole)
    if not space.inner.grown(0.01).holds_rect(front):
        return False
    near = whole.grown(GAP)
    if any(near.overlaps(body) for body in space.bodies) or any(whole.overlaps(free) for free in space.fronts):
        return False
    if any(whole.overlaps(zone) for zone in space.keep_free) or any(front.overlaps(body) for body in space.bodies):
        return False
    space.bodies.append(whole)
    space.fronts.append(front)
    return True


def _floor_of(pieces: list[Furniture]) -> float:
    return min(piece.centre[1] - piece.size[1] / 2 for piece in pieces)


def _bounds(rects: list[Rect]) -> Rect:
    x0, z0, x1, z1 = zip(*rects, strict=True)
    return Rect(min(x0), min(z0), max(x1), max(z1))


def _front(anchor: Furniture, whole: Rect) -> Rect:
    """The strip before a group that stays free so that one can walk up to it."""
    dx, dz = round(math.sin(anchor.yaw)), round(math.cos(anchor.yaw))
    return Rect(
        whole.x1 if dx > 0 else whole.x0 - FRONT * (dx < 0),
        whole.z1 if dz > 0 else whole.z0 - FRONT * (dz < 0),
        whole.x1 + FRONT * (dx > 0) if dx >= 0 else whole.x0,
        whole.z1 + FRONT * (dz > 0) if dz >= 0 else whole.z0,
    )
