"""Rooms of a schematic home: every open cell belongs to the room of the nearest objects by walking distance.

Rooms in texts (names.py) and open cells (regions.py) -> `Room`s with names, areas and finishes. Neighbouring rooms
look different.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.episodes.schema import Goal
from sim.walk.storeys import nearest_storey
from sim.words.places import ROOM_KINDS, RoomKind

from ...words.colours import COLOURS
from ...words.finishes import Rgb
from ..building.cells.spaces import floor_layers, plinth_layers
from ..cells import AreaRun, CellGrid, runs_of
from ..plan import Finish, Room, Storey
from .names import RoomName, room_name, usual_room
from .regions import Seed, cell_graph, distance_at, groups_of, home_of, joined, settled, spread

_NEAR_NAMED = 2.5
"""An object without a text names a room only if it is farther than this from all that have one (metres, weighted)."""
_OAK = Finish(material="wood", rgb=(186, 146, 100), rgb2=(160, 120, 78))
_WALNUT = Finish(material="wood", rgb=(134, 96, 64), rgb2=(108, 74, 48))
_PINE = Finish(material="wood", rgb=(208, 172, 124), rgb2=(184, 146, 98))
_FLOORS: Mapping[RoomKind, tuple[Finish, ...]] = {
    "bathroom": (
        Finish(material="tile", pattern="checked", rgb=(206, 212, 214), rgb2=(170, 180, 186)),
        Finish(material="tile", rgb=(196, 190, 178), rgb2=(150, 144, 134)),
    ),
    "kitchen": (Finish(material="tile", rgb=(214, 200, 178), rgb2=(170, 154, 132)),),
    "laundry room": (Finish(material="tile", rgb=(190, 196, 200), rgb2=(140, 146, 152)),),
    "utility room": (Finish(material="tile", rgb=(176, 178, 176), rgb2=(130, 132, 132)),),
    "garage": (Finish(material="stone", rgb=(150, 150, 148)),),
    "entrance": (Finish(material="stone", rgb=(176, 168, 156)),),
    "bedroom": (
        Finish(material="carpet", rgb=(186, 176, 162)),
        _PINE,
        Finish(material="carpet", rgb=(150, 160, 172)),
        Finish(material="carpet", rgb=(172, 150, 140)),
    ),
    "closet": (Finish(material="carpet", rgb=(164, 156, 146)),),
    "living room": (_OAK, _WALNUT),
    "dining room": (_WALNUT, _OAK),
    "studio": (_WALNUT, Finish(material="carpet", rgb=(140, 146, 140))),
    "tv room": (Finish(material="carpet", rgb=(128, 124, 130)), _OAK),
    "game room": (_PINE, _OAK),
}
_OTHER_FLOORS = (_OAK, _PINE)
_PAINTS: tuple[Rgb, ...] = (
    (232, 226, 212), (206, 220, 226), (226, 210, 196), (208, 222, 200), (234, 224, 188), (220, 208, 224),
    (222, 198, 188), (196, 214, 212), (214, 214, 216), (236, 214, 206),
)  # fmt: skip
_TILED: tuple[RoomKind, ...] = ("bathroom", "laundry room")
_TOUCH = 8
"""Rooms this near to each other share a wall (cells)."""
_OF_FLOOR = re.compile(r"\b(\w+) (?:floor|carpet)")
_OF_WALL = re.compile(r"\b(\w+) (?:walls?|bedroom|bathroom|room)\b")


class RecoveredRooms(NamedTuple):
    """The rooms of a plan, and the room of each object."""

    rooms: tuple[Room, ...]
    room_of: dict[str, str]
    """Name of the room by `object_name`."""


class _Region(NamedTuple):
    """A room before it has a final name."""

    storey: int
    room: RoomName | None
    """Name of the room; None for the part of a storey without a name."""
    mask: NDArray[np.bool_]


class _Finishes(NamedTuple):
    """Materials of a room."""

    floor: Finish
    wall: Finish


def recovered_rooms(
    texts: Mapping[str, Counter[str]], goals: Mapping[str, Goal], storeys: Sequence[Storey], *, grid: CellGrid
) -> RecoveredRooms:
    """The rooms of a home; each open cell (walkable, under the robot's body, or plinth) is in a room of its storey.

    `texts` counts the rooms that texts give each object, by `object_name` (`room_texts`); `grid` has its walkable cells
    and plinths.
    """
    masks = open_cells(grid, storeys)
    floors = [storey.floor_y for storey in storeys]
    storey_of = {name: int(nearest_storey(goal.floor_y, floors)) for name, goal in goals.items()}
    regions: list[_Region] = []
    for k, mask in enumerate(masks):
        here = {name: goal for name, goal in sorted(goals.items()) if storey_of[name] == k}
        regions += _regions(k, mask, here, texts, grid)
    names = _names(regions, storeys)
    finishes = _room_finishes(
        [region.room for region in regions], [region.mask for region in regions], [region.storey for region in regions]
    )
    rooms = tuple(
        Room(name=name, storey=region.storey, area=_runs(region.mask), floor=finish.floor, wall=finish.wall)
        for name, region, finish in zip(names, regions, finishes, strict=True)
    )
    return RecoveredRooms(rooms, _rooms_of(goals, storey_of, regions, names, grid))


def open_cells(grid: CellGrid, storeys: Sequence[Storey]) -> NDArray[np.bool_]:
    """Mask (S, rows, cols) of each storey's floor and plinths; stairs belong to the storey from which they rise."""
    floors = floor_layers(grid, tuple(storeys))
    plinths = plinth_layers(grid, tuple(storeys))
    is_open = ~np.isnan(floors) | ~np.isnan(plinths)
    return np.stack([is_open[2 * k : 2 * k + 2].any(axis=0) for k in range(len(storeys))])


def _regions(
    storey: int,
    mask: NDArray[np.bool_],
    goals: Mapping[str, Goal],
    texts: Mapping[str, Counter[str]],
    grid: CellGrid,
) -> list[_Region]:
    """The rooms of one storey, the largest first, and the rest of the storey."""
    if not mask.any():
        return []
    graph = cell_graph(mask, grid.cell)
    named = [Seed(goal, room) for name, goal in goals.items() if (room := _room_of_texts(texts.get(name)))]
    distance, nearest = spread(graph, named, grid)
    guessed = [
        Seed(goal, RoomName(kind, kind, kind))
        for name, goal in goals.items()
        if name not in {seed.goal.object_name for seed in named}
        and (kind := usual_room(goal.object_category))
        and distance_at(goal, distance, grid) > _NEAR_NAMED
    ]
    seeds = named + guessed
    distance, nearest = spread(graph, seeds, grid)
    groups = groups_of(seeds, distance, nearest)
    labels = np.where(nearest >= 0, np.append(groups, -1)[nearest], -1)
    labels = settled(labels, distance, mask, num=len(seeds), cell=grid.cell)
    names = [_common_name([seed.room for seed, of in zip(seeds, groups, strict=True) if of == k]) for k in groups]
    into = joined(labels, [*names, None], goals.values(), grid)
    labels, groups = np.where(labels >= 0, into[labels], -1), into[groups]
    regions = []
    for group in np.unique(labels[mask]).tolist():
        room = _common_name([seed.room for seed, of in zip(seeds, groups, strict=True) if of == group])
        regions.append(_Region(storey, room, (labels == group) & mask))
    return sorted(regions, key=lambda region: (region.room is None, -int(region.mask.sum())))


def _room_of_texts(counted: Counter[str] | None) -> RoomName | None:
    """The room that most texts name; the first by name if counts are equal."""
    rooms = [(-count, text, room) for text, count in (counted or {}).items() if (room := room_name(text))]
    return min(rooms, key=lambda entry: entry[:2])[2] if rooms else None


def _common_name(rooms: Sequence[RoomName]) -> RoomName | None:
    if not rooms:
        return None
    return min(Counter(rooms).items(), key=lambda item: (-item[1], item[0].name == item[0].kind, item[0]))[0]


def _names(regions: Sequence[_Region], storeys: Sequence[Storey]) -> list[str]:
    """A name for each region, with a number where another region has the same name."""
    taken: set[str] = set()
    names = []
    for region in regions:
        plain = storeys[region.storey].label if region.room is None else region.room.name
        name, number = plain, 2
        while name in taken:
            name, number = f"{plain} {number}", number + 1
        taken.add(name)
        names.append(name)
    return names


def _runs(mask: NDArray[np.bool_]) -> tuple[AreaRun, ...]:
    """A mask (rows, cols) as runs, row by row."""
    rows, cols = np.nonzero(mask)
    firsts, lengths = runs_of(rows[:, None], cols)
    return tuple(
        AreaRun(row, col, length)
        for row, col, length in zip(rows[firsts].tolist(), cols[firsts].tolist(), lengths.tolist(), strict=True)
    )


def _rooms_of(
    goals: Mapping[str, Goal],
    storey_of: Mapping[str, int],
    regions: Sequence[_Region],
    names: Sequence[str],
    grid: CellGrid,
) -> dict[str, str]:
    """The room of each object: the one with most of the places that see it, else the largest of its storey."""
    label = np.full((max(storey_of.values(), default=0) + 1, *grid.shape), -1, np.int64)
    for index, region in enumerate(regions):
        if region.storey < len(label):
            label[region.storey][region.mask] = index
    found: dict[str, str] = {}
    for name, goal in sorted(goals.items()):
        first = next((k for k, region in enumerate(regions) if region.storey == storey_of[name]), 0)
        home, _ = home_of(goal, label[storey_of[name]], grid)
        found[name] = names[home if home >= 0 else first]
    return found


def _room_finishes(
    rooms: Sequence[RoomName | None], masks: Sequence[NDArray[np.bool_]], storeys: Sequence[int]
) -> list[_Finishes]:
    """Floors and walls of rooms (None = a room without name) with these cells (rows, cols), in order.

    Rooms of one storey that share a wall get different paint, and different floors where their kind has several.
    Colours in a text ("bathroom with blue floor") are used.
    """
    grown = [np.asarray(ndimage.binary_dilation(mask, iterations=_TOUCH), bool) for mask in masks]
    found: list[_Finishes] = []
    for index, room in enumerate(rooms):
        beside = [
            found[other]
            for other in range(index)
            if storeys[other] == storeys[index] and bool((grown[other] & grown[index]).any())
        ]
        found.append(_finishes(room, beside))
    return found


def _finishes(room: RoomName | None, beside: Sequence[_Finishes]) -> _Finishes:
    kind = None if room is None else room.kind
    floors = _OTHER_FLOORS if kind is None else _FLOORS.get(kind, _OTHER_FLOORS)
    used_floors = [other.floor for other in beside]
    floor = next((floor for floor in floors if floor not in used_floors), floors[0])
    # the first choice depends on the kind, so that rooms with equal choices do not all look alike
    offset = 0 if kind is None else 3 * ROOM_KINDS.index(kind)
    paints = [_PAINTS[(offset + step) % len(_PAINTS)] for step in range(len(_PAINTS))]
    used = [other.wall.rgb for other in beside]
    paint = next((paint for paint in paints if paint not in used), paints[0])
    wall = Finish(material="tile" if kind in _TILED else "plaster", rgb=paint)
    if room is None:
        return _Finishes(floor, wall)
    floor_rgb, wall_rgb = _named(_OF_FLOOR, room.text), _named(_OF_WALL, room.text)
    if floor_rgb is not None:
        floor = floor.model_copy(update={"rgb": floor_rgb, "rgb2": None})
    if wall_rgb is not None:
        wall = wall.model_copy(update={"rgb": _paler(wall_rgb)})
    return _Finishes(floor, wall)


def _named(pattern: re.Pattern[str], text: str) -> Rgb | None:
    """The colour that a text names before a word of the pattern, or None."""
    return next((COLOURS[word] for word in pattern.findall(text) if word in COLOURS), None)


def _paler(rgb: Rgb) -> Rgb:
    """The colour halfway to off-white, for the paint of a wall."""
    red, green, blue = ((value + 240) // 2 for value in rgb)
    return (red, green, blue)
