"""Floors and walls by the kind of room, so that neighbouring rooms look different; for recovered_rooms.py."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...words.finishes import Rgb
from ..furniture.appearance import COLOURS
from ..plan import Finish
from .room_words import ROOM_KINDS, RoomKind, RoomName

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
"""Rooms this near each other share a wall (cells)."""
_OF_FLOOR = re.compile(r"\b(\w+) (?:floor|carpet)")
_OF_WALL = re.compile(r"\b(\w+) (?:walls?|bedroom|bathroom|room)\b")


class RoomFinishes(NamedTuple):
    """Materials of a room."""

    floor: Finish
    wall: Finish


def room_finishes(
    rooms: Sequence[RoomName | None], masks: Sequence[NDArray[np.bool_]], storeys: Sequence[int]
) -> list[RoomFinishes]:
    """Floors and walls of rooms (None = a room without name) with these cells (rows, cols), in order.

    Rooms of one storey that share a wall get different paint, and different floors where their kind has several.
    Colours in a text ("bathroom with blue floor") are used.
    """
    grown = [np.asarray(ndimage.binary_dilation(mask, iterations=_TOUCH), bool) for mask in masks]
    found: list[RoomFinishes] = []
    for index, room in enumerate(rooms):
        beside = [
            found[other]
            for other in range(index)
            if storeys[other] == storeys[index] and bool((grown[other] & grown[index]).any())
        ]
        found.append(_finishes(room, beside))
    return found


def _finishes(room: RoomName | None, beside: Sequence[RoomFinishes]) -> RoomFinishes:
    kind = None if room is None else room.kind
    floors = _OTHER_FLOORS if kind is None else _FLOORS.get(kind, _OTHER_FLOORS)
    used_floors = [other.floor for other in beside]
    floor = next((floor for floor in floors if floor not in used_floors), floors[0])
    # another first choice for each kind, so that equal plans of rooms do not all look alike
    offset = 0 if kind is None else 3 * ROOM_KINDS.index(kind)
    paints = [_PAINTS[(offset + step) % len(_PAINTS)] for step in range(len(_PAINTS))]
    used = [other.wall.rgb for other in beside]
    paint = next((paint for paint in paints if paint not in used), paints[0])
    wall = Finish(material="tile" if kind in _TILED else "plaster", rgb=paint)
    if room is None:
        return RoomFinishes(floor, wall)
    floor_rgb, wall_rgb = _named(_OF_FLOOR, room.text), _named(_OF_WALL, room.text)
    if floor_rgb is not None:
        floor = floor.model_copy(update={"rgb": floor_rgb, "rgb2": None})
    if wall_rgb is not None:
        wall = wall.model_copy(update={"rgb": _paler(wall_rgb)})
    return RoomFinishes(floor, wall)


def _named(pattern: re.Pattern[str], text: str) -> Rgb | None:
    """The colour that a text names before a word of the pattern."""
    return next((COLOURS[word] for word in pattern.findall(text) if word in COLOURS), None)


def _paler(rgb: Rgb) -> Rgb:
    """A wall's paint: half way to white."""
    red, green, blue = ((value + 240) // 2 for value in rgb)
    return (red, green, blue)
