"""An invented home from a seed: two storeys with a hall each, a stair between them, rooms with doors, and furniture."""

from typing import NamedTuple

import numpy as np

from sim.errors import SceneError

from .arrange import furnish_room
from .plan import Finish, Furniture, HomePlan, Opening, Rect, Rgb, Room, Stair, Storey, Wall

DOOR_WIDTH = 0.95
MIN_PIECES, MAX_PIECES = 25, 40
_STOREY_HEIGHT = 2.8
_CEILING = 2.6
_NUM_STEPS = 16
"""Rise 0.175 m per step, under the robot's 0.2 m."""
_TREAD = 0.28
_STAIR_WIDTH = 1.0
_RAILING = 0.95
_ATTEMPTS = 40
_ROOM_COUNTS = ((2, 2, 2, 1), (2, 1, 2, 2), (2, 2, 1, 2), (2, 1, 2, 1), (2, 2, 1, 1))
"""Rooms north and south of the hall, ground floor then first floor."""
_LABELS = ("ground floor", "first floor")
_FLOORS: tuple[Rgb, ...] = ((176, 132, 88), (198, 176, 142), (150, 152, 156), (140, 96, 64), (186, 164, 150))
_WALLS: tuple[Rgb, ...] = (
    (226, 214, 188), (196, 212, 222), (208, 222, 196), (228, 202, 196), (214, 204, 226), (226, 224, 216),
    (236, 220, 176), (190, 214, 208), (222, 210, 202),
)  # fmt: skip


class _Layout(NamedTuple):
    """Rooms around one storey's hall; all rectangles are middle lines of walls."""

    hall: Rect
    north: tuple[Rect, ...]
    south: tuple[Rect, ...]


def invent_plan(name: str, *, seed: int) -> HomePlan:
    """A furnished home of two storeys with 8 or 9 rooms; the same name and seed give the same plan.

    Every pair of rooms is joined by openings of at least 0.9 m, and every floor-standing piece can be walked up to.

    Raises:
        SceneError: No arrangement was found (does not happen for seeds that were tried; another seed helps).
    """
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, attempt])
        plan = _drawn_plan(name, rng)
        if MIN_PIECES <= len(plan.furniture) <= MAX_PIECES:
            return plan
    raise SceneError(
        f"invented home {name!r}: seed {seed} gave no home with {MIN_PIECES} to {MAX_PIECES} pieces in {_ATTEMPTS} "
        "tries; expected one. Take another --seed."
    )


def _drawn_plan(name: str, rng: np.random.Generator) -> HomePlan:
    width = round(float(rng.uniform(8.8, 10.2)), 1)
    depths = [round(float(rng.uniform(3.2, 3.8)), 1) for _ in range(2)]
    hall = Rect(0.0, depths[0], width, depths[0] + 2.8)
    stair = _stair(hall)
    storeys = tuple(
        Storey(label=label, floor_y=k * _STOREY_HEIGHT, ceiling=_CEILING) for k, label in enumerate(_LABELS)
    )
    rooms: list[Room] = []
    walls: list[Wall] = []
    furniture: list[Furniture] = []
    counts = _ROOM_COUNTS[int(rng.integers(len(_ROOM_COUNTS)))]
    tints = rng.permutation(len(_WALLS))
    for k in range(len(storeys)):
        num_north, num_south = counts[2 * k : 2 * k + 2]
        layout = _layout(hall, depths, stair, num_north=num_north, num_south=num_south, rng=rng)
        names = _room_names(k, len(layout.north) + len(layout.south), rng)
        rects = (layout.hall, *layout.north, *layout.south)
        new_rooms = [
            Room(
                name=room_name,
                storey=k,
                rect=rect,
                floor=Finish(material="wood", rgb=_floor_rgb(room_name, rng)),
                wall=Finish(material="plaster", rgb=_WALLS[tints[(len(rooms) + i) % len(_WALLS)]]),
            )
            for i, (room_name, rect) in enumerate(zip(names, rects, strict=True))
        ]
        new_walls = _walls(k, layout, stair, rng)
        blocked = [stair.rect.grown(0.1)]
        for room in new_rooms:
            furniture += furnish_room(
                room, storeys[k].floor_y, walls=new_walls, blocked=blocked, taken=tuple(furniture), rng=rng
            )
        rooms += new_rooms
        walls += new_walls
    walls += _railings(stair)
    return HomePlan(
        name=name, kind="invented", storeys=storeys, rooms=tuple(rooms), walls=tuple(walls), stairs=(stair,),
        furniture=tuple(furniture),
    )  # fmt: skip


def _stair(hall: Rect) -> Stair:
    """A flight along the hall's north wall, with room to step on and off at both ends."""
    x0 = hall.x0 + 2.4
    rect = Rect(x0, hall.z0 + 0.06, round(x0 + _NUM_STEPS * _TREAD, 3), hall.z0 + 0.06 + _STAIR_WIDTH)
    return Stair(storey=0, rect=rect, towards="+x", num_steps=_NUM_STEPS)


def _layout(
    hall: Rect, depths: list[float], stair: Stair, *, num_north: int, num_south: int, rng: np.random.Generator
) -> _Layout:
    """One or two rooms on each side of the hall; north rooms split where both keep a door beside the stair."""
    z_north, z_south = hall.z0 - depths[0], hall.z1 + depths[1]
    middle = round(float(rng.uniform(stair.rect.x0 + 1.4, stair.rect.x0 + 3.0)), 1)
    north = (Rect(hall.x0, z_north, middle, hall.z0), Rect(middle, z_north, hall.x1, hall.z0))
    if num_north == 1:
        north = (Rect(hall.x0, z_north, hall.x1, hall.z0),)
    split = round(float(rng.uniform(hall.x1 * 0.42, hall.x1 * 0.58)), 1)
    south = (Rect(hall.x0, hall.z1, split, z_south), Rect(split, hall.z1, hall.x1, z_south))
    if num_south == 1:
        south = (Rect(hall.x0, hall.z1, hall.x1, z_south),)
    return _Layout(hall, north, south)


def _room_names(storey: int, num: int, rng: np.random.Generator) -> list[str]:
    """The hall's name and `num` others, all with a recipe; the last ones are for the south side's larger rooms."""
    if storey == 0:
        pool = ["kitchen", "dining room", "living room", "study"] if num == 4 else ["kitchen", "study", "living room"]
        return ["entrance hall", *pool]
    pool = ["bathroom", "guest bedroom", "main bedroom", str(rng.choice(["playroom", "office"]))]
    return ["upper hall", *pool[:num]]


def _floor_rgb(name: str, rng: np.random.Generator) -> Rgb:
    if name in ("kitchen", "bathroom"):
        return (170, 178, 184)
    return _FLOORS[int(rng.integers(len(_FLOORS)))]


def _walls(storey: int, layout: _Layout, stair: Stair, rng: np.random.Generator) -> list[Wall]:
    """Outer walls with windows, and inner walls with a door from every room to the hall."""
    hall = layout.hall
    z0, z1 = layout.north[0].z0, layout.south[0].z1
    found = [
        _wall(storey, (hall.x0, z0), (hall.x1, z0), _windows([(rect.x0, rect.x1) for rect in layout.north])),
        _wall(storey, (hall.x0, z1), (hall.x1, z1), _windows([(rect.x0, rect.x1) for rect in layout.south])),
        _wall(storey, (hall.x0, z0), (hall.x0, z1), _windows([(0.0, hall.z0 - z0)])),
        _wall(storey, (hall.x1, z0), (hall.x1, z1), _windows([(hall.z1 - z0, z1 - z0)])),
    ]
    before = (hall.x0 + 0.2, stair.rect.x0 - 0.35)
    after = (stair.rect.x1 + 0.35, hall.x1 - 0.2)
    # one room gets one of the two places beside the stair
    spans = (before, after) if len(layout.north) == 2 else (before if rng.random() < 0.5 else after,)
    north = [_door(*span, rng) for span in spans]
    found.append(_wall(storey, (hall.x0, hall.z0), (hall.x1, hall.z0), north))
    south = [_door(rect.x0 + 0.3, rect.x1 - 0.3, rng) for rect in layout.south]
    found.append(_wall(storey, (hall.x0, hall.z1), (hall.x1, hall.z1), south))
    for rects in (layout.north, layout.south):
        found += [_wall(storey, (rect.x0, rect.z0), (rect.x0, rect.z1), []) for rect in rects[1:]]
    return found


def _wall(storey: int, start: tuple[float, float], end: tuple[float, float], openings: list[Opening]) -> Wall:
    return Wall(storey=storey, start=start, end=end, height=_CEILING, openings=tuple(openings))


def _door(low: float, high: float, rng: np.random.Generator) -> Opening:
    """A door anywhere between two offsets along the wall."""
    half = DOOR_WIDTH / 2
    return Opening(kind="door", offset=round(float(rng.uniform(low + half, high - half)), 2), width=DOOR_WIDTH)


def _windows(spans: list[tuple[float, float]]) -> list[Opening]:
    """One window in the middle of each span of a wall."""
    return [Opening(kind="window", offset=round((a + b) / 2, 2), width=1.3, sill=0.9, top=2.1) for a, b in spans]


def _railings(stair: Stair) -> list[Wall]:
    """Railings on the upper storey around the hole: along its open side and at its low end."""
    rect = stair.rect
    z, x = rect.z1 + 0.03, rect.x0 - 0.03
    sides = (((rect.x0, z), (rect.x1, z)), ((x, rect.z0), (x, rect.z1)))
    return [
        Wall(storey=stair.storey + 1, start=start, end=end, height=_RAILING, thickness=0.06) for start, end in sides
    ]
