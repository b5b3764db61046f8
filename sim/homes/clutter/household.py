"""Usual things in homes besides captioned ones, by kind of room, with sizes and colours; used for clutter."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..furniture.appearance import finish_from_text
from ..furniture.families import Family, look_of
from ..plan import Finish


class Household(NamedTuple):
    """Usual categories in one kind of room; a category listed more often is drawn more often."""

    at_walls: tuple[str, ...]
    """Furniture with its back to a wall."""
    hung: tuple[str, ...]
    """Things on walls, at eye level or above."""
    on_tops: tuple[str, ...]
    """Things on tables, cabinets and counters."""
    on_floor: tuple[str, ...]
    """Things in corners and along walls."""


_SHELVES = ("picture", "picture", "wall shelf", "clock")
_STAND = ("box", "basket", "trash bin", "bag", "plant")
HOUSEHOLDS: Mapping[str, Household] = {
    "bathroom": Household(
        ("cabinet", "laundry basket", "stool"), ("towel", "towel", "picture", "wall shelf", "robe"),
        ("bottle", "bottle", "cup", "vase", "box", "candle", "decorative plant"),
        ("laundry basket", "trash bin", "slipper", "stool"),
    ),
    "kitchen": Household(
        ("kitchen lower cabinet", "side table", "stool"), ("clock", "picture", "kitchen shelf", "calendar", "towel"),
        ("bowl", "cup", "cup", "bottle", "bottle", "kettle", "fruit bowl", "jar", "plate", "coffee machine", "toaster"),
        ("trash bin", "box", "basket", "stool", "crate"),
    ),
    "dining room": Household(
        ("sideboard", "chair", "display cabinet", "chair"), ("picture", "picture", "clock", "mirror", "wall lamp"),
        ("cup", "plate", "bowl", "candle", "vase", "bottle", "glass", "fruit bowl"), ("plant", "basket", "box"),
    ),
    "bedroom": Household(
        ("dresser", "chair", "nightstand", "bookshelf"), ("picture", "picture", "mirror", "wall shelf", "robe"),
        ("book", "cup", "bottle", "table lamp", "photo", "box", "candle", "clock", "plush toy", "vase"),
        ("shoe", "shoe", "slipper", "bag", "box", "basket", "suitcase", "plush toy", "backpack"),
    ),
    "living room": Household(
        ("bookshelf", "side table", "armchair", "sideboard", "speaker", "console table"),
        ("picture", "picture", "picture", "clock", "wall shelf", "wall lamp"),
        ("book", "book", "vase", "bowl", "photo", "candle", "cup", "statue", "glass", "decorative plant", "speaker"),
        ("plant", "basket", "box", "toy", "bag", "ottoman"),
    ),
    "office": Household(
        ("bookshelf", "cabinet", "drawer", "chair"), ("picture", "board", "calendar", "clock", "wall shelf"),
        ("book", "book", "cup", "laptop", "box", "telephone", "desk lamp", "photo", "printer", "bottle"),
        ("box", "box", "trash bin", "backpack", "bag", "plant"),
    ),
    "laundry room": Household(
        ("cabinet", "rack", "laundry basket"), ("wall shelf", "hanger", "clothes", "calendar"),
        ("bottle", "bottle", "box", "basket", "bowl"), ("laundry basket", "bucket", "box", "crate", "trash bin"),
    ),
    "garage": Household(
        ("rack", "cabinet", "table"), ("wall shelf", "board", "electric box", "clock"),
        ("box", "bottle", "jar", "book", "bucket"), ("box", "box", "crate", "suitcase", "bucket", "ball", "bag"),
    ),
    "closet": Household(
        ("dresser", "rack", "clothes rack"), ("clothes", "clothes", "hanger", "mirror", "wall shelf"),
        ("box", "bag", "book", "candle"), ("shoe", "shoe", "shoe", "box", "bag", "suitcase", "basket"),
    ),
    "playroom": Household(
        ("bookshelf", "armchair", "cabinet"), ("picture", "picture", "board", "wall shelf"),
        ("toy", "book", "plush toy", "ball", "cup", "box"), ("toy", "plush toy", "ball", "box", "basket", "ottoman"),
    ),
    "hallway": Household(
        ("console table", "bench", "cabinet", "umbrella stand"), ("picture", "picture", "mirror", "clothes", "clock"),
        ("vase", "bowl", "photo", "book", "decorative plant", "candle"),
        ("shoe", "shoe", "shoe", "bag", "plant", "umbrella stand", "box"),
    ),
    "room": Household(
        ("cabinet", "chair", "bookshelf"), _SHELVES, ("book", "vase", "bowl", "cup", "photo", "box"), _STAND,
    ),
}  # fmt: skip
"""Usual things by kind of room; `room` is for rooms of no known kind."""
_KIND_WORDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("bathroom", ("bath", "toilet", "shower", "restroom")),
    ("laundry room", ("laundry", "utility", "washing")),
    ("closet", ("closet", "dressing", "wardrobe")),
    ("garage", ("garage", "attic", "storage", "basement", "cellar")),
    ("kitchen", ("kitchen", "pantry", "bar")),
    ("dining room", ("dining", "breakfast")),
    ("bedroom", ("bed", "nursery", "child", "guest")),
    ("playroom", ("game", "play", "gym", "fitness")),
    ("office", ("office", "study", "studio", "library", "work")),
    ("living room", ("living", "lounge", "family", "tv", "relax", "sitting")),
    ("hallway", ("hall", "corridor", "entrance", "foyer", "stair", "landing", "doorway")),
)
"""Kinds of rooms, each with beginnings of words that mean it; the first match counts."""
ON_UPHOLSTERY: Mapping[Family, tuple[str, ...]] = {
    "sofa": ("cushion", "cushion", "cushion", "throw blanket", "plush toy", "book"),
    "armchair": ("cushion", "throw blanket", "book"),
    "bed": ("cushion", "cushion", "plush toy", "book", "throw blanket"),
    "bench": ("cushion", "bag", "box", "book"),
}
"""Things on seats and beds, by family of the piece."""
SEAT_HEIGHTS: Mapping[Family, float] = {"sofa": 0.5, "armchair": 0.5, "bed": 0.62, "bench": 1.0}
"""Height at which things lie on a family's pieces, as a share of the pieces' height."""
TOP_FAMILIES: tuple[Family, ...] = (
    "table", "desk", "counter", "cabinet", "drawers", "wardrobe", "washing machine", "piano", "fireplace", "mantle",
)  # fmt: skip
"""Families whose pieces have a level top at their full height."""
ONCE = frozenset(
    ["clock", "calendar", "board", "electric box", "printer", "telephone", "kettle", "coffee machine", "toaster", "tv"]
)
"""Categories with at most one thing in a room."""
UNMOVED: tuple[Family, ...] = (
    "stair", "railing", "window", "door", "column", "panel", "fireplace", "mantle", "shower", "shower fitting",
    "glass pane", "shutter", "radiator", "tub", "toilet", "sink", "bunk bed", "fan", "ceiling lamp", "electric box",
    "dial", "boiler", "extractor", "counter", "curtain",
)  # fmt: skip
"""Families that are part of the house or its pipes, of which clutter adds no piece."""

_WOODS = ("oak", "walnut", "white", "black", "wooden", "grey", "brown")
_CLOTHS = ("red", "blue", "green", "yellow", "grey", "beige", "purple", "teal", "orange", "pink", "white", "brown")
_HARD = ("white", "black", "silver", "red", "blue", "grey", "cream")
_SOFT_FAMILIES: tuple[Family, ...] = (
    "pillow", "blanket", "towel", "clothes", "curtain", "sofa", "armchair", "ottoman", "toy", "bag", "backpack",
    "shoes", "flat", "suitcase", "picture", "book", "vase", "cup", "bowl", "ball", "bottle", "box", "candle", "basket",
)  # fmt: skip
_MACHINES: tuple[Family, ...] = (
    "coffee machine", "kettle", "laptop", "monitor", "tv", "printer", "telephone", "speaker", "microwave", "clock",
    "refrigerator", "oven", "stove", "washing machine", "dishwasher", "bin", "lamp", "table lamp", "wall lamp",
)  # fmt: skip
_SIZES: Mapping[str, tuple[float, float, float]] = {
    "photo": (0.16, 0.2, 0.04), "cushion": (0.4, 0.16, 0.3), "throw blanket": (0.5, 0.08, 0.4),
    "book": (0.22, 0.06, 0.16), "decorative plant": (0.18, 0.28, 0.18),
    "vase": (0.14, 0.28, 0.14), "statue": (0.14, 0.3, 0.12), "box": (0.26, 0.18, 0.2), "toaster": (0.3, 0.2, 0.18),
    "clock": (0.28, 0.28, 0.05), "plush toy": (0.22, 0.28, 0.2), "toy": (0.2, 0.16, 0.16), "bucket": (0.26, 0.28, 0.26),
    "speaker": (0.16, 0.26, 0.18), "jar": (0.12, 0.2, 0.12), "plate": (0.24, 0.05, 0.24), "candle": (0.08, 0.2, 0.08),
    "picture": (0.5, 0.4, 0.03), "mirror": (0.5, 0.7, 0.03), "fruit bowl": (0.26, 0.13, 0.26),
    "laundry basket": (0.38, 0.42, 0.3), "side table": (0.42, 0.5, 0.42), "kitchen shelf": (0.7, 0.4, 0.22),
    "wall shelf": (0.7, 0.35, 0.2), "clothes": (0.4, 0.8, 0.16), "towel": (0.4, 0.6, 0.06), "rack": (0.7, 0.9, 0.3),
}  # fmt: skip
"""Usual sizes of things that are smaller as clutter than with a caption; others have the sizes of `look_of`."""


def household_of(room_name: str) -> Household:
    """Usual things in a room of this name; if its words name several kinds, the first kind in the table counts."""
    words = room_name.lower().replace("-", " ").split()
    for kind, beginnings in _KIND_WORDS:
        if any(word.startswith(beginning) for word in words for beginning in beginnings):
            return HOUSEHOLDS[kind]
    return HOUSEHOLDS["room"]


def drawn_size(category: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """Width, height, depth of a thing of the category in metres, a little larger or smaller than usual."""
    usual = _SIZES.get(category) or look_of(category).size
    scale = rng.uniform(0.82, 1.12, 3)
    if look_of(category).mounting == "floor" and category not in _SIZES:
        scale = np.full(3, rng.uniform(0.85, 1.05))
    w, h, d = (round(max(0.02, float(value)), 3) for value in np.array(usual) * scale)
    return (w, h, d)


def drawn_finish(category: str, rng: np.random.Generator) -> Finish:
    """A usual finish of the category in a random colour."""
    family = look_of(category).family
    words = _CLOTHS if family in _SOFT_FAMILIES else _HARD if family in _MACHINES else _WOODS
    return finish_from_text(f"{words[int(rng.integers(len(words)))]} {category}", category)
