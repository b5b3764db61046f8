"""Differences between two objects of one category that the description mentions and our home shows.

`Described` + two pieces of a plan -> cues in words. Used by findable.py.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sim.homes.furniture.appearance import finish_from_text
from sim.homes.plan import Finish, Furniture, HomePlan, Room
from sim.words.finishes import Rgb

from ..copies.glb_writer import linear_from_srgb
from ..episodes.described import Described, content_words, names_category

DELTA_E = 15.0
"""Least CIE76 difference of two colours that people call different at a glance."""
_ROOM_DELTA_E = 8.0
"""The same for two rooms' walls or floors, which are large."""
_SAID_DELTA_E = 35.0
"""A finish farther than this from the colour that the text names does not show it."""
_LARGER = 1.25
"""A thing this many times as large as another looks larger."""
_NEAR = 2.0
"""Most free metres between two things that are near each other."""
_OVER = 0.3
"""Most free metres between two things of which one is on, over or under the other."""
_CLEARLY = (1.3, 0.5)
"""A similar object must be farther from the thing by this factor, and by this many metres more."""


def cues(
    said: Described | None, it: Furniture, other: Furniture, plan: HomePlan, noticed: Sequence[Furniture]
) -> Iterator[str]:
    """Words about `it` that are true in our home and not true of `other`."""
    if said is None:
        return
    yield from (f"colour {word}" for word in said.colours if _shows_colour(word, it, other))
    for name, found, others in (
        *(("pattern", value, other.finish.pattern) for value in said.patterns if it.finish.pattern == value),
        *(("material", value, other.finish.material) for value in said.materials if it.finish.material == value),
    ):
        if found != others:
            yield f"{name} {found}"
    yield from (f"size {word}" for word in said.sizes if _looks(word, it, other))
    is_said = said.room is not None and bool(content_words(it.room) & content_words(said.room))
    if is_said and it.room != other.room and _rooms_differ(it.room, other.room, plan):
        yield f"room {it.room}"
    for words, reach in ((said.upon, _OVER), (said.beside | said.upon, _NEAR)):
        yield from _beside(words, reach, it, other, plan, noticed)


def storey_of_piece(piece: Furniture, plan: HomePlan) -> int:
    """Index of the highest storey whose floor is not above the piece's middle."""
    floors = [storey.floor_y for storey in plan.storeys]
    return max((index for index, floor_y in enumerate(floors) if floor_y <= piece.centre[1] + 0.2), default=0)


def delta_e(first: Rgb, second: Rgb) -> float:
    """CIE76 difference of two sRGB colours."""
    return float(np.linalg.norm(_lab(first) - _lab(second)))


def _beside(
    words: frozenset[str],
    reach: float,
    it: Furniture,
    other: Furniture,
    plan: HomePlan,
    noticed: Sequence[Furniture],
) -> Iterator[str]:
    """Categories of things that are near `it`, as the text says, and clearly farther from `other`."""
    storey = storey_of_piece(it, plan)
    things = [
        piece for piece in plan.furniture if piece.category != it.category and storey_of_piece(piece, plan) == storey
    ]
    for category in sorted({thing.category for thing in things}):
        if not names_category(words, category):
            continue
        same = [thing for thing in things if thing.category == category]
        near = [thing for thing in same if it.rect.gap(thing.rect) <= reach and thing in noticed]
        least = _CLEARLY[0] * min((it.rect.gap(thing.rect) for thing in near), default=math.inf) + _CLEARLY[1]
        if min(other.rect.gap(thing.rect) for thing in same) > least:
            yield f"beside {category}"


def _shows_colour(words: str, it: Furniture, other: Furniture) -> bool:
    """Whether `it` shows the named colour and the other one clearly less."""
    named = finish_from_text(f"{words} {it.category}", it.category).rgb
    theirs = _colours(other.finish)
    shown = min(_colours(it.finish), key=lambda rgb: delta_e(rgb, named))
    off = delta_e(shown, named)
    gap = min(delta_e(shown, rgb) for rgb in theirs)
    return off <= _SAID_DELTA_E and gap > DELTA_E and off < min(delta_e(rgb, named) for rgb in theirs)


def _colours(finish: Finish) -> list[Rgb]:
    return [finish.rgb] if finish.rgb2 is None or finish.pattern == "plain" else [finish.rgb, finish.rgb2]


def _looks(word: str, it: Furniture, other: Furniture) -> bool:
    """Whether `it` is larger (or smaller) than `other`, as the word says."""
    mine, theirs = _extent(word, it), _extent(word, other)
    return mine >= _LARGER * theirs if word in ("large", "tall", "long") else theirs >= _LARGER * mine


def _extent(word: str, piece: Furniture) -> float:
    """Height, length, or the side of a cube of the same volume (metres)."""
    width, height, depth = piece.size
    if word in ("tall", "low"):
        return height
    return max(width, depth) if word in ("long", "short") else (width * height * depth) ** (1 / 3)


def _rooms_differ(name: str, other: str, plan: HomePlan) -> bool:
    """Whether two rooms of the plan look different: another kind of room, or other walls or floor."""
    rooms = {room.name: room for room in plan.rooms}
    if name not in rooms or other not in rooms:
        return False
    return _kind(rooms[name]) != _kind(rooms[other]) or any(
        first.pattern != second.pattern
        or first.material != second.material
        or delta_e(first.rgb, second.rgb) > _ROOM_DELTA_E
        for first, second in ((rooms[name].floor, rooms[other].floor), (rooms[name].wall, rooms[other].wall))
    )


def _kind(room: Room) -> frozenset[str]:
    """A room's name without the numbers and letters that distinguish rooms of one kind."""
    return frozenset(word for word in content_words(room.name) if len(word) > 1)


def _lab(rgb: Rgb) -> NDArray[np.float64]:
    """CIE L*a*b* (D65) of an sRGB colour."""
    xyz = _XYZ_FROM_RGB @ linear_from_srgb(np.array(rgb)) / _WHITE
    root = np.where(xyz > 216 / 24389, np.cbrt(xyz), (xyz * 24389 / 27 + 16) / 116)
    return np.array([116 * root[1] - 16, 500 * (root[0] - root[1]), 200 * (root[1] - root[2])])


_XYZ_FROM_RGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
_WHITE = np.array([0.9505, 1.0, 1.089])
