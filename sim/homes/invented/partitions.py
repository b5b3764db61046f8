"""Walls of one storey of an invented home: doors between rooms, windows outside, gaps where rooms are one space."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..plan import Opening, Rect, Stair, Wall
from .layouts import Layout

DOOR_WIDTH = 0.95
CEILING = 2.6
_RAILING = 0.95
_MARGIN = 0.25
"""Least distance of a door from the ends of the wall that two rooms share (metres)."""
_STUB, _SHORT_STUB = 0.3, 0.1
"""Length of the wall that remains at both ends where two rooms are one space, and where a corridor turns (metres)."""
_NEAR_STAIR = 1.0
_WINDOW, _NARROW_WINDOW = 1.3, 0.7


class Border(NamedTuple):
    """A straight piece of wall line with one room, or none, on either side."""

    is_along_x: bool
    at: float
    """z of a line along x, or x of a line along z."""
    span: tuple[float, float]
    rooms: tuple[int, ...]
    """Indices of the one or two rooms that meet here."""
    openings: tuple[Opening, ...] = ()
    """Doors and windows, with offsets from the line's origin."""


class Partition(NamedTuple):
    """The walls of a storey, and the gaps between rooms that are one space."""

    walls: tuple[Wall, ...]
    gaps: tuple[Rect, ...]
    """Lines without wall, as rectangles without width."""


def borders_of(rects: Sequence[Rect]) -> list[Border]:
    """All wall lines between rooms and around them, sorted, and cut where another room begins."""
    found: list[Border] = []
    for is_along_x in (True, False):
        # for each room: the coordinates of its two sides along the lines, then its range in their direction
        sides = [(r.z0, r.z1, r.x0, r.x1) if is_along_x else (r.x0, r.x1, r.z0, r.z1) for r in rects]
        for at in sorted({edge for low, high, _, _ in sides for edge in (low, high)}):
            touching = [k for k, side in enumerate(sides) if at in side[:2]]
            cuts = sorted({edge for k in touching for edge in sides[k][2:]})
            for a, b in itertools.pairwise(cuts):
                rooms = tuple(k for k in touching if sides[k][2] <= a and b <= sides[k][3])
                if rooms:
                    found.append(Border(is_along_x, at, (a, b), rooms))
    return found


def door_spans(border: Border, stair: Stair | None) -> list[tuple[float, float]]:
    """Spans of a border that can hold a door: clear of its ends and of the stair."""
    low, high = border.span[0] + _MARGIN, border.span[1] - _MARGIN
    spans = [(low, high)]
    if stair is not None:
        rect = stair.rect
        across, along = ((rect.z0, rect.z1), (rect.x0, rect.x1)) if border.is_along_x else (
            (rect.x0, rect.x1), (rect.z0, rect.z1)
        )  # fmt: skip
        if across[0] - _NEAR_STAIR < border.at < across[1] + _NEAR_STAIR:
            spans = [(low, min(high, along[0] - _MARGIN)), (max(low, along[1] + _MARGIN), high)]
    return [(a, b) for a, b in spans if b - a >= DOOR_WIDTH]


def draw_doors(layout: Layout, stair: Stair | None, rng: np.random.Generator) -> list[tuple[int, int]] | None:
    """Pairs of rooms with a door between them, so that every room can be reached; None where this is impossible."""
    borders = [border for border in borders_of(layout.rects) if len(border.rooms) == 2 and door_spans(border, stair)]
    pairs = {border.rooms for border in borders}
    joined = {layout.hubs[0]}
    doors: list[tuple[int, int]] = []
    while len(joined) < len(layout.rects):
        _spread(joined, layout.open_pairs)
        steps = sorted((a, b) for pair in pairs for a, b in (pair, pair[::-1]) if a in joined and b not in joined)
        if not steps:
            return doors if len(joined) == len(layout.rects) else None
        from_hubs = [step for step in steps if step[0] in layout.hubs]
        choices = from_hubs if from_hubs and not (layout.is_winding and rng.random() < 0.5) else steps
        step = choices[int(rng.integers(len(choices)))]
        doors.append(step)
        joined.add(step[1])
    if layout.is_winding and rng.random() < 0.5:  # a second path
        doors += _loop(doors, pairs, layout, rng)
    return doors


def _spread(joined: set[int], open_pairs: Sequence[tuple[int, int]]) -> None:
    for _ in open_pairs:
        for a, b in open_pairs:
            if a in joined or b in joined:
                joined.update((a, b))


def _loop(
    doors: list[tuple[int, int]], pairs: set[tuple[int, ...]], layout: Layout, rng: np.random.Generator
) -> list[tuple[int, int]]:
    """One more door, between rooms that already have several; a bathroom keeps its only door."""
    degree = [sum(k in door for door in doors) for k in range(len(layout.rects))]
    known = {frozenset(pair) for pair in (*doors, *layout.open_pairs)}
    choices = sorted((a, b) for a, b in pairs if frozenset((a, b)) not in known and degree[a] > 1 and degree[b] > 1)
    return [choices[int(rng.integers(len(choices)))]] if choices else []


def build_partition(
    layout: Layout,
    names: Sequence[str],
    doors: Sequence[tuple[int, int]],
    *,
    storey: int,
    stair: Stair | None,
    rng: np.random.Generator,
) -> Partition:
    """The storey's walls, with a door between each of these pairs of rooms; bathrooms have narrow windows, and nothing
    opens beside the stair.
    """
    wanted = {frozenset(door) for door in doors}
    is_open = {frozenset(pair) for pair in layout.open_pairs}
    solids: list[Border] = []
    gaps: list[Rect] = []
    for border in borders_of(layout.rects):
        a, b = border.span
        meeting = frozenset(border.rooms)
        if meeting in is_open:
            stub = _STUB if b - a >= 2.0 else _SHORT_STUB
            solids += [border._replace(span=span) for span in ((a, a + stub), (b - stub, b))]
            gaps.append(_line(border, a + stub, b - stub))
            continue
        openings: list[Opening] = []
        if len(border.rooms) == 1:
            openings = _windows(border, names[border.rooms[0]], stair)
        elif meeting in wanted and (spans := door_spans(border, stair)):
            wanted.discard(meeting)
            low, high = spans[int(rng.integers(len(spans)))]
            openings = [_door(low, high, rng)]
        solids.append(border._replace(openings=tuple(openings)))
    assert not wanted, wanted
    return Partition(tuple(_joined_walls(solids, storey)), tuple(gaps))


def railings(stair: Stair, walls: Sequence[Wall]) -> list[Wall]:
    """Railings on the upper storey around the hole: along its open sides and at its low end."""
    rect, out = stair.rect, 0.03
    sides = {
        "-x": ((rect.x0 - out, rect.z0), (rect.x0 - out, rect.z1)),
        "+x": ((rect.x1 + out, rect.z0), (rect.x1 + out, rect.z1)),
        "-z": ((rect.x0, rect.z0 - out), (rect.x1, rect.z0 - out)),
        "+z": ((rect.x0, rect.z1 + out), (rect.x1, rect.z1 + out)),
    }
    return [
        Wall(storey=stair.storey + 1, start=_rounded(start), end=_rounded(end), height=_RAILING, thickness=0.06)
        for side, (start, end) in sides.items()
        if side != stair.towards and not any(_lies_along(start, end, wall) for wall in walls)
    ]


def _lies_along(start: tuple[float, float], end: tuple[float, float], wall: Wall) -> bool:
    """Whether a wall of full height is within a few centimetres of the whole line."""
    rect = wall.line.grown(0.1)
    return rect.holds(*start) and rect.holds(*end)


def _rounded(point: tuple[float, float]) -> tuple[float, float]:
    return (round(point[0], 3), round(point[1], 3))


def _line(border: Border, a: float, b: float) -> Rect:
    return Rect(a, border.at, b, border.at) if border.is_along_x else Rect(border.at, a, border.at, b)


def _door(low: float, high: float, rng: np.random.Generator) -> Opening:
    """A door anywhere between two offsets."""
    half = DOOR_WIDTH / 2
    return Opening(kind="door", offset=round(float(rng.uniform(low + half, high - half)), 2), width=DOOR_WIDTH)


def _windows(border: Border, name: str, stair: Stair | None) -> list[Opening]:
    """One or two windows in an outer wall, none beside the stair."""
    a, b = border.span
    width = _NARROW_WINDOW if name in ("bathroom", "laundry room", "dressing room") else _WINDOW
    num = 2 if b - a >= 4.6 and width == _WINDOW else 1 if b - a >= width + 0.8 else 0
    found: list[Opening] = []
    for k in range(num):
        middle = round(a + (b - a) * (k + 0.5) / num, 2)
        pane = _line(border, middle - width / 2, middle + width / 2).grown(0.5)
        if stair is None or not pane.overlaps(stair.rect):
            found.append(Opening(kind="window", offset=middle, width=width, sill=0.9, top=2.1))
    return found


def _joined_walls(solids: Sequence[Border], storey: int) -> list[Wall]:
    """The walls, with pieces that continue each other joined into one."""
    joined: list[Border] = []
    for solid in solids:
        last = joined[-1] if joined else None
        if last is not None and last[:2] == solid[:2] and abs(last.span[1] - solid.span[0]) < 1e-9:
            span = (last.span[0], solid.span[1])
            joined[-1] = last._replace(span=span, openings=(*last.openings, *solid.openings))
        else:
            joined.append(solid)
    found: list[Wall] = []
    for is_along_x, at, (low, high), _, openings in joined:
        ends = ((low, at), (high, at)) if is_along_x else ((at, low), (at, high))
        start, end = map(_rounded, ends)
        own = tuple(one.model_copy(update={"offset": round(one.offset - low, 3)}) for one in openings)
        found.append(Wall(storey=storey, start=start, end=end, height=CEILING, openings=own))
    return found
