"""Names of the rooms of an invented home, and the materials of their floors and walls."""

from collections.abc import Sequence

import numpy as np

from ...words.finishes import Rgb
from ..plan import Finish, Rect

_SPACE: dict[str, float] = {
    "living room": 9, "main bedroom": 7, "dining room": 6, "playroom": 6, "kitchen": 5.5, "guest bedroom": 5,
    "library": 5, "study": 4, "office": 4, "dressing room": 3, "laundry room": 2.5, "bathroom": 2,
}  # fmt: skip
"""Rank of each kind of room by its usual size."""
_NEEDED = {
    (1, 0): ("living room", "kitchen", "main bedroom", "bathroom"),
    (2, 0): ("living room", "kitchen"),
    (2, 1): ("main bedroom", "bathroom"),
}
"""Rooms that every home has, by (number of storeys, storey)."""
_FURTHER = {
    (1, 0): ("guest bedroom", "study", "dining room", "laundry room", "office", "playroom"),
    (2, 0): ("dining room", "study", "library", "laundry room"),
    (2, 1): ("guest bedroom", "office", "playroom", "dressing room"),
}
_HALLS = {(1, 0): "entrance hall", (2, 0): "entrance hall", (2, 1): "upper hall"}
_LEAVES = ("bathroom", "laundry room", "dressing room")
"""Kinds of rooms that lead to no other room."""
_LARGEST_LEAF = 18.0
"""Largest area of a room that leads to no other room, square metres."""

_PALE: tuple[Rgb, ...] = (
    (226, 214, 188), (190, 208, 222), (200, 218, 186), (230, 198, 190), (212, 200, 226), (226, 224, 216),
    (238, 220, 166), (180, 212, 204), (222, 206, 190), (206, 206, 210),
)  # fmt: skip
_BOLD: tuple[Rgb, ...] = ((176, 200, 160), (150, 182, 206), (216, 170, 150), (222, 196, 120), (186, 170, 206))
_PLANKS: tuple[Rgb, ...] = ((176, 132, 88), (150, 106, 70), (196, 160, 112), (112, 80, 58))
_CARPETS: tuple[Rgb, ...] = ((150, 152, 160), (186, 164, 140), (118, 132, 154), (150, 128, 112), (132, 150, 128))
_TILES: tuple[Rgb, ...] = ((206, 210, 212), (176, 196, 204), (220, 212, 196), (150, 160, 166), (188, 206, 190))


def draw_names(
    given: Sequence[str], rects: Sequence[Rect], degrees: Sequence[int], *, storey: tuple[int, int],
    rng: np.random.Generator,
) -> list[str] | None:  # fmt: skip
    """Different names for all rooms of a storey; None if they do not fit, such as when no room can be a bathroom.

    Args:
        given: Names from the layout: "hall" becomes the storey's hall, "" is a room without name.
        rects: The rooms, for their sizes.
        degrees: Number of doors and gaps of each room; bathrooms and similar rooms have one.
        storey: (number of storeys of the home, index of this one).
        rng: Draws the rooms beyond those that every home has.
    """
    names = [_HALLS[storey] if name == "hall" else name for name in given]
    if "upper" in _HALLS[storey]:
        names = ["upper corridor" if name == "corridor" else name for name in names]
    free = [k for k, name in enumerate(names) if not name]
    needed = [name for name in _NEEDED[storey] if name not in names]
    further = [name for name in rng.permutation(_FURTHER[storey]).tolist() if name not in names]
    wanted = [*needed, *further][: len(free)]
    if len(wanted) < len(free) or len(needed) > len(free):
        return None
    area = {k: (rects[k].x1 - rects[k].x0) * (rects[k].z1 - rects[k].z0) * rng.uniform(0.85, 1.15) for k in free}
    ends = sorted((k for k in free if degrees[k] == 1), key=area.__getitem__)
    leaves = sorted((name for name in wanted if name in _LEAVES), key=_SPACE.__getitem__)
    if len(leaves) > len(ends):
        return None
    for k, name in zip(ends, leaves, strict=False):
        names[k] = name
        if area[k] > _LARGEST_LEAF:
            return None
    rest = sorted((k for k in free if not names[k]), key=area.__getitem__)
    for k, name in zip(rest, sorted(set(wanted) - set(leaves), key=_SPACE.__getitem__), strict=True):
        names[k] = name
    return names


def draw_finishes(names: Sequence[str], rng: np.random.Generator) -> list[tuple[Finish, Finish]]:
    """Finishes (floor, wall) of each room: wood, carpet or tile by its kind, and walls of different colours."""
    tints = rng.permutation(len(_PALE))
    return [(_floor(name, rng), _wall(name, _PALE[tints[k % len(_PALE)]], rng)) for k, name in enumerate(names)]


def _floor(name: str, rng: np.random.Generator) -> Finish:
    if name in ("bathroom", "kitchen", "laundry room"):
        rgb = _one(_TILES, rng)
        if rng.random() < 0.35:
            return Finish(material="tile", pattern="checked", rgb=rgb, rgb2=(96, 104, 112))
        return Finish(material="tile", rgb=rgb)
    is_soft = name in ("main bedroom", "guest bedroom", "dressing room", "playroom", "library")
    if is_soft and rng.random() < 0.6:
        return Finish(material="carpet", rgb=_one(_CARPETS, rng))
    return Finish(material="wood", rgb=_one(_PLANKS, rng))


def _wall(name: str, pale: Rgb, rng: np.random.Generator) -> Finish:
    if name == "bathroom":
        return Finish(material="tile", rgb=_one(((214, 226, 230), (196, 216, 222), (226, 222, 210)), rng))
    if "bedroom" in name or name in ("playroom", "dining room"):
        draw = rng.random()
        if draw < 0.25:
            return Finish(material="paper", pattern="striped", rgb=pale)
        if draw < 0.4:
            return Finish(material="paper", pattern="floral", rgb=pale)
    if name in ("living room", "study", "library", "office") and rng.random() < 0.4:
        return Finish(material="plaster", rgb=_one(_BOLD, rng))
    return Finish(material="plaster", rgb=pale)


def _one(choices: Sequence[Rgb], rng: np.random.Generator) -> Rgb:
    return choices[int(rng.integers(len(choices)))]
