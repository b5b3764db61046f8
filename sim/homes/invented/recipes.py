"""Furniture for each kind of room in an invented home: groups of pieces, and small things on top of them."""

from typing import NamedTuple


class Member(NamedTuple):
    """One piece of a group; its place follows from the sizes of the pieces.

    Pieces at the wall stand side by side in the order of the group.
    """

    category: str
    x: float = 0.0
    """Offset along the wall from the middle of its `before`, `behind` or `on` member, as a share of that width."""
    before: int | None = None
    """Index of the member in front of which it stands."""
    behind: int | None = None
    """Index of the member behind which it stands, towards the wall."""
    gap: float = -0.1
    """Metres between the two members; a negative gap pushes one under the other."""
    turned: bool = False
    """Whether it faces the wall instead of the room."""
    on: int | None = None
    """Index of the member on which it stands."""
    hangs_at: float | None = None
    """Height of its middle when it hangs on the wall (metres)."""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Width, height and depth relative to the usual ones of its category."""


class Small(NamedTuple):
    """A small thing that lies on a piece of the room."""

    category: str
    supports: tuple[str, ...]
    """Categories of pieces on which the thing may lie, if the room has one."""
    chance: float


GROUPS: dict[str, tuple[Member, ...]] = {
    "sofa set": (
        Member("couch"), Member("rug", before=0, gap=-0.15, scale=(1.2, 1, 1.1)),
        Member("coffee table", before=0, gap=0.4),
    ),
    "small couch": (Member("couch", scale=(0.8, 1, 1)),),
    "tv set": (Member("tv stand"), Member("tv", on=0)),
    "armchair": (Member("armchair"),),
    "ottoman": (Member("ottoman"),),
    "bookshelf": (Member("bookshelf"),),
    "low shelf": (Member("shelf", scale=(1.0, 0.5, 1.0)),),
    "lamp": (Member("lamp"),),
    "plant": (Member("plant"),),
    "bench": (Member("bench"),),
    "dresser": (Member("dresser"),),
    "sideboard": (Member("sideboard"),),
    "wardrobe": (Member("wardrobe"),),
    "radiator": (Member("radiator"),),
    "bed set": (Member("nightstand"), Member("bed"), Member("nightstand")),
    "guest bed": (Member("bed", scale=(0.75, 1, 1)), Member("nightstand")),
    "single bed": (Member("bed", scale=(0.65, 1, 1)),),
    "desk set": (Member("desk"), Member("desk chair", before=0, turned=True)),
    "computer desk": (Member("desk"), Member("desk chair", before=0, turned=True), Member("monitor", on=0)),
    "kitchen row": (Member("kitchen lower cabinet"), Member("stove"), Member("kitchen lower cabinet")),
    "short kitchen row": (Member("kitchen lower cabinet"), Member("stove")),
    "refrigerator": (Member("refrigerator"),),
    "dining set": (
        Member("dining table"), Member("chair", x=-0.25, behind=0), Member("chair", x=0.25, behind=0),
        Member("chair", x=0.25, before=0, turned=True), Member("chair", x=-0.25, before=0, turned=True),
    ),
    "small dining set": (
        Member("dining table", scale=(0.8, 1, 0.85)), Member("chair", x=-0.25, before=0, turned=True),
        Member("chair", x=0.25, before=0, turned=True),
    ),
    "breakfast table": (
        Member("table"), Member("chair", x=-0.25, before=0, turned=True),
        Member("chair", x=0.25, before=0, turned=True),
    ),
    "play table": (
        Member("table", scale=(0.8, 0.75, 1)), Member("stool", x=-0.25, before=0, turned=True),
        Member("stool", x=0.25, before=0, turned=True),
    ),
    "chair": (Member("chair"),),
    "stool": (Member("stool"),),
    "bathtub": (Member("bathtub"),),
    "toilet": (Member("toilet"),),
    "wash place": (Member("bathroom cabinet"), Member("sink", on=0), Member("mirror", hangs_at=1.5)),
    "wash stand": (Member("bathroom cabinet"), Member("mirror", hangs_at=1.45)),
    "washing machine": (Member("washing machine"),),
    "clothes dryer": (Member("clothes dryer"),),
    "ironing board": (Member("ironing board"),),
    "basket": (Member("basket"),),
    "clothes rack": (Member("clothes rack"),),
    "toy": (Member("plush toy", scale=(1.0, 1.25, 1.0)),),
    "picture": (Member("picture", hangs_at=1.5),),
    "mirror": (Member("mirror", hangs_at=1.4),),
    "towel": (Member("towel", hangs_at=1.15),),
    "rug": (Member("rug"),),
    "curtain": (Member("curtain", hangs_at=1.35),),
}  # fmt: skip
DISTANCES: dict[str, tuple[float, float]] = {"dining set": (1.1, 2.0), "rug": (0.4, 1.6)}
"""Least and largest distance from a wall of groups that stand free in the room (metres)."""
BY_WINDOWS = {"curtain"}
"""Groups that hang beside a window."""
INSTEAD: dict[str, str] = {
    "sofa set": "small couch", "bed set": "guest bed", "guest bed": "single bed", "kitchen row": "short kitchen row",
    "dining set": "small dining set", "wash place": "wash stand",
}  # fmt: skip
"""The group that replaces a group for which there is no place."""
NEEDED: dict[str, tuple[str, ...]] = {
    "living room": ("couch",), "kitchen": ("stove", "refrigerator"), "dining room": ("dining table",),
    "main bedroom": ("bed",), "guest bedroom": ("bed",), "bathroom": ("toilet", "bathroom cabinet"), "study": ("desk",),
    "office": ("desk",), "laundry room": ("washing machine",), "library": ("bookshelf",),
    "dressing room": ("wardrobe",),
}  # fmt: skip
"""Categories that each kind of room must have."""

RECIPES: dict[str, tuple[tuple[str, float], ...]] = {
    "entrance hall": (
        ("bench", 0.7), ("dresser", 0.5), ("plant", 0.6), ("mirror", 0.6), ("picture", 1.0), ("picture", 0.5),
        ("rug", 0.4),
    ),
    "upper hall": (
        ("sideboard", 0.4), ("plant", 0.6), ("chair", 0.4), ("picture", 1.0), ("picture", 0.6), ("rug", 0.4),
    ),
    "corridor": (("plant", 0.4), ("picture", 1.0), ("picture", 0.5)),
    "upper corridor": (("plant", 0.4), ("picture", 1.0), ("mirror", 0.4)),
    "kitchen": (
        ("kitchen row", 1.0), ("refrigerator", 1.0), ("breakfast table", 0.8), ("stool", 0.3), ("towel", 0.6),
        ("picture", 0.5), ("curtain", 0.5), ("plant", 0.3), ("basket", 0.3),
    ),
    "dining room": (
        ("dining set", 1.0), ("sideboard", 0.8), ("plant", 0.5), ("lamp", 0.4), ("picture", 1.0), ("picture", 0.7),
        ("curtain", 0.6), ("rug", 0.3),
    ),
    "living room": (
        ("sofa set", 1.0), ("tv set", 1.0), ("armchair", 1.0), ("small couch", 0.4), ("bookshelf", 0.6),
        ("low shelf", 0.5), ("armchair", 0.7), ("lamp", 0.8), ("plant", 0.7), ("ottoman", 0.4), ("picture", 1.0),
        ("picture", 0.8), ("curtain", 0.8), ("radiator", 0.3),
    ),
    "study": (
        ("desk set", 1.0), ("bookshelf", 1.0), ("armchair", 0.6), ("low shelf", 0.5), ("lamp", 0.6), ("picture", 0.9),
        ("rug", 0.7), ("curtain", 0.5), ("plant", 0.4),
    ),
    "office": (
        ("computer desk", 1.0), ("bookshelf", 0.8), ("low shelf", 0.5), ("chair", 0.4), ("picture", 0.9), ("rug", 0.5),
        ("lamp", 0.5), ("curtain", 0.5), ("basket", 0.4),
    ),
    "library": (
        ("bookshelf", 1.0), ("bookshelf", 1.0), ("armchair", 1.0), ("armchair", 0.6), ("lamp", 0.9), ("low shelf", 0.8),
        ("rug", 0.8), ("ottoman", 0.4), ("picture", 0.8), ("curtain", 0.6),
    ),
    "playroom": (
        ("play table", 1.0), ("low shelf", 1.0), ("armchair", 0.7), ("rug", 1.0), ("toy", 0.8), ("toy", 0.5),
        ("picture", 0.9), ("curtain", 0.6), ("basket", 0.5), ("lamp", 0.3),
    ),
    "main bedroom": (
        ("bed set", 1.0), ("wardrobe", 1.0), ("dresser", 0.7), ("armchair", 0.4), ("rug", 0.8), ("mirror", 0.4),
        ("picture", 1.0), ("picture", 0.5), ("curtain", 0.8), ("plant", 0.3), ("ottoman", 0.3),
    ),
    "guest bedroom": (
        ("guest bed", 1.0), ("dresser", 0.8), ("wardrobe", 0.5), ("chair", 0.6), ("rug", 0.7), ("picture", 0.9),
        ("curtain", 0.7), ("lamp", 0.3),
    ),
    "dressing room": (
        ("wardrobe", 1.0), ("clothes rack", 0.8), ("ottoman", 0.7), ("mirror", 0.9), ("dresser", 0.5), ("rug", 0.7),
        ("picture", 0.4), ("basket", 0.4),
    ),
    "bathroom": (
        ("bathtub", 1.0), ("toilet", 1.0), ("wash place", 1.0), ("wash stand", 0.3), ("washing machine", 0.5),
        ("towel", 1.0), ("towel", 0.7), ("rug", 0.6), ("basket", 0.5), ("stool", 0.3),
    ),
    "laundry room": (
        ("washing machine", 1.0), ("clothes dryer", 0.8), ("ironing board", 0.8), ("low shelf", 0.6), ("basket", 0.9),
        ("towel", 0.7), ("stool", 0.3),
    ),
}  # fmt: skip
"""(group, chance) for each kind of room, in the order in which groups are placed."""

_TABLES = ("coffee table", "table", "dining table", "sideboard", "dresser", "shelf", "tv stand")
_COUNTERS = ("kitchen lower cabinet", "table", "sideboard")
_ON_TABLES = (
    Small("vase", _TABLES, 0.8), Small("book", _TABLES, 0.5), Small("bowl", _TABLES, 0.5),
    Small("photo", _TABLES, 0.4), Small("statue", _TABLES, 0.25),
)  # fmt: skip
_ON_COUCHES = (
    Small("cushion", ("couch",), 0.9), Small("cushion", ("armchair",), 0.5), Small("throw blanket", ("couch",), 0.4),
)  # fmt: skip
_IN_BEDROOMS = (
    Small("table lamp", ("nightstand",), 0.9), Small("table lamp", ("nightstand", "dresser"), 0.6),
    Small("throw blanket", ("bed",), 0.6), Small("cushion", ("bed",), 0.7), Small("book", ("nightstand",), 0.4),
    Small("vase", ("dresser",), 0.5), Small("photo", ("dresser",), 0.4), Small("box", ("dresser",), 0.3),
)  # fmt: skip
_AT_DESKS = (
    Small("table lamp", ("desk",), 0.9), Small("book", ("desk", "shelf"), 0.8), Small("vase", ("shelf",), 0.5),
    Small("photo", ("shelf", "desk"), 0.5), Small("speaker", ("shelf",), 0.4), Small("cushion", ("armchair",), 0.4),
    Small("statue", ("shelf",), 0.3),
)  # fmt: skip
SMALL: dict[str, tuple[Small, ...]] = {
    "living room": (*_ON_COUCHES, *_ON_TABLES, Small("table lamp", ("shelf", "sideboard", "tv stand"), 0.4)),
    "dining room": (
        Small("bowl", ("dining table",), 0.7), Small("vase", ("dining table", "sideboard"), 0.8),
        Small("table lamp", ("sideboard",), 0.5), Small("photo", ("sideboard",), 0.4),
    ),
    "kitchen": (
        Small("coffee machine", ("kitchen lower cabinet",), 0.7), Small("microwave", ("kitchen lower cabinet",), 0.5),
        Small("bowl", _COUNTERS, 0.8), Small("vase", ("table",), 0.5), Small("bowl", ("table",), 0.3),
    ),
    "study": _AT_DESKS,
    "office": _AT_DESKS,
    "library": (*_AT_DESKS, Small("book", ("shelf",), 0.6)),
    "playroom": (
        Small("plush toy", ("shelf", "armchair", "table"), 0.9), Small("book", ("table", "shelf"), 0.6),
        Small("box", ("shelf",), 0.6), Small("toy", ("table", "shelf"), 0.6), Small("cushion", ("armchair",), 0.5),
    ),
    "main bedroom": _IN_BEDROOMS,
    "guest bedroom": _IN_BEDROOMS,
    "dressing room": (
        Small("box", ("dresser",), 0.7), Small("bag", ("ottoman",), 0.5), Small("vase", ("dresser",), 0.4),
    ),
    "bathroom": (Small("decorative plant", ("washing machine", "bathroom cabinet"), 0.5),),
    "laundry room": (Small("box", ("shelf", "clothes dryer"), 0.7),),
    "entrance hall": (
        Small("vase", ("dresser",), 0.7), Small("bag", ("bench",), 0.5), Small("bowl", ("dresser",), 0.5),
    ),
    "upper hall": (Small("vase", ("sideboard",), 0.7), Small("table lamp", ("sideboard",), 0.5)),
}  # fmt: skip
"""Small things of each kind of room."""

SIZES: dict[str, tuple[float, float, float]] = {
    "book": (0.26, 0.07, 0.2), "bowl": (0.28, 0.11, 0.28), "photo": (0.2, 0.26, 0.05), "statue": (0.18, 0.36, 0.18),
    "speaker": (0.2, 0.32, 0.2), "box": (0.3, 0.2, 0.22), "toy": (0.26, 0.2, 0.2), "plush toy": (0.28, 0.34, 0.26),
    "bag": (0.34, 0.28, 0.2), "coffee machine": (0.26, 0.34, 0.3), "microwave": (0.46, 0.28, 0.34),
    "decorative plant": (0.24, 0.36, 0.24), "cushion": (0.42, 0.18, 0.34), "throw blanket": (0.8, 0.06, 0.5),
    "basket": (0.42, 0.42, 0.42), "curtain": (0.5, 1.7, 0.12), "clothes rack": (0.95, 1.5, 0.45),
    "towel": (0.45, 0.7, 0.08), "sink": (0.5, 0.16, 0.38),
}  # fmt: skip
"""Width, height, depth of small and hanging things; other things have their usual sizes (`look_of`)."""
SEATS: dict[str, float] = {"couch": 0.52, "armchair": 0.52, "bed": 0.66, "bench": 1.0, "ottoman": 1.0}
"""Height at which things lie on upholstery, as a share of its height; on all other pieces they lie on top."""
FLAT = {"rug"}
"""Pieces that people and robots walk over."""
SIZED = {"picture", "rug", "plant", "vase", "mirror"}
"""Categories with small, usual and large pieces."""
