"""Words about objects: captions for invented homes, ownership sentences, and which objects a query may confuse."""

import re

from sim.homes.plan import Furniture, HomePlan, Room

from ..episodes.checks_text import head_of
from ..words.english import with_article

_NEXT_TO, _NEAR = 0.35, 1.2
"""Gaps between two pieces that a caption calls "next to" and "near" (planar metres)."""
_NEAR_WINDOW = 0.7
_ABOVE = 0.6
"""A piece that begins this high above the floor and stands on nothing hangs on a wall (metres)."""
_TOUCH = 0.03


def caption_of(piece: Furniture, plan: HomePlan) -> str:
    """A person's words for the piece: size, colour, pattern, material, category, and where it is; no article.

    Everything in it is true in the plan. It never contains " in ", after which ownership sentences name the room.
    """
    others = [other for other in plan.furniture if other.room == piece.room and other.category != piece.category]
    places = [text for text in (_carried(piece, others), _hung(piece, others, plan)) if text][:1]
    used = " ".join(places)
    for text in (*_beside(piece, others), _at_window(piece, plan)):
        if text and len(places) < 2 and text.split(" the ", 1)[1] not in used:
            places.append(text)
            used = " ".join(places)
    if not places:
        places = ["located against the wall" if _is_at_wall(piece, plan) else "located with space all around it"]
    if len(places) == 2 and all(place.startswith("near ") for place in places):
        places[1] = places[1].removeprefix("near ")
    return f"{piece.caption or piece.category} {' and '.join(places)}"


def are_mixed_up(first: str, second: str) -> bool:
    """Whether a query for one category could mean the other: "chair" and "desk chair", or "armchair"."""
    short, long = sorted((first, second), key=len)
    return re.search(rf"\b{re.escape(short)}s?\b", long) is not None or long.endswith(short)


def names_category(category: str, phrase: str) -> bool:
    """Whether a phrase about another object could answer a query for the category: its head has that word."""
    return re.search(rf"\b{re.escape(category.lower())}s?\b", head_of(phrase.lower())) is not None


def ownership_sentence(owner: str, phrase: str, room: str) -> str:
    """The `extracted_summary` sentence of one edge."""
    return f"{owner} owns {with_article(phrase)} in the {room}"


def _called(piece: Furniture) -> str:
    return f"the {piece.caption or piece.category}"


def _carried(piece: Furniture, others: list[Furniture]) -> str:
    """ "on the oak desk"; for rugs, the thing that stands on them."""
    for other in others:
        is_inside = other.rect.holds(piece.centre[0], piece.centre[2])
        if is_inside and other.size[1] > 0.1 and other.bottom_y + 0.1 < piece.bottom_y <= other.top_y + _TOUCH:
            return f"on {_called(other)}"
    if piece.size[1] > 0.1:
        return ""
    upright = [o for o in others if o.size[1] > 0.1 and abs(o.bottom_y - piece.bottom_y) < 0.05]
    above = [o for o in upright if piece.rect.holds_rect(o.rect)]
    return f"located under {_called(min(above, key=lambda o: o.name))}" if above else ""


def _hung(piece: Furniture, others: list[Furniture], plan: HomePlan) -> str:
    """ "located above the red couch" for a piece that hangs on a wall."""
    if piece.bottom_y < plan.storeys[_room_of(piece, plan).storey].floor_y + _ABOVE:
        return ""
    below = [
        other
        for other in others
        if other.top_y <= piece.bottom_y
        and other.size[1] > 0.1
        and piece.rect.gap(other.rect) < 0.15
        and other.rect.grown(0.3).holds(piece.centre[0], piece.centre[2])
    ]
    return f"located above {_called(min(below, key=lambda o: (-o.size[1], o.name)))}" if below else ""


def _beside(piece: Furniture, others: list[Furniture]) -> list[str]:
    """ "next to the oak bookshelf", "near ...", nearest first; only for pieces of similar height."""
    found = []
    for other in others:
        overlap_y = (piece.size[1] + other.size[1]) / 2 - abs(piece.centre[1] - other.centre[1])
        gap = piece.rect.gap(other.rect)
        if 0 < gap <= _NEAR and overlap_y > -0.3 and other.size[1] > 0.1:
            found.append((gap, other.name, f"{'next to' if gap <= _NEXT_TO else 'near'} {_called(other)}"))
    return [text for _, _, text in sorted(found)]


def _at_window(piece: Furniture, plan: HomePlan) -> str:
    room = _room_of(piece, plan)
    for wall in plan.walls:
        for opening in wall.openings:
            if wall.storey != room.storey or opening.kind != "window" or room.rect is None:
                continue
            x, z = wall.middle_of(opening)
            pane = wall.floor_beside(opening, depth=0.0, margin=0.0)
            if room.rect.grown(0.01).holds(x, z) and piece.rect.gap(pane) <= _NEAR_WINDOW:
                return "near the window"
    return ""


def _room_of(piece: Furniture, plan: HomePlan) -> Room:
    return next(room for room in plan.rooms if room.name == piece.room)


def _is_at_wall(piece: Furniture, plan: HomePlan) -> bool:
    rects = [room.rect for room in plan.rooms if room.name == piece.room and room.rect is not None]
    return any(not rect.grown(-0.3).holds_rect(piece.rect) for rect in rects)
