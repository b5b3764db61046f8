"""Which family draws a category of objects, and how large such a thing usually is; used by recover and arrange."""

from typing import Literal

Family = Literal[
    "table",
    "seat",
    "sofa",
    "bed",
    "cabinet",
    "shelf",
    "lamp",
    "panel",
    "plant",
    "flat",
    "toilet",
    "tub",
    "cloth",
    "box",
]
Vec = tuple[float, float, float]

_LOOKS: tuple[tuple[str, Family, Vec], ...] = (
    # words of a category, its family, typical width, height, depth in metres; the first line that fits counts
    ("nightstand/bed table/lamp table", "cabinet", (0.45, 0.55, 0.4)),
    ("dining table", "table", (1.5, 0.75, 0.9)),
    ("coffee table", "table", (0.9, 0.42, 0.55)),
    ("tv stand/cabinet table/chest/drawer/dresser/sideboard", "cabinet", (1.0, 0.7, 0.45)),
    ("desk chair/office chair/computer chair", "seat", (0.52, 0.95, 0.52)),
    ("armchair/sofa chair", "sofa", (0.85, 0.85, 0.8)),
    ("bar chair/stool/ottoman/footrest", "table", (0.42, 0.45, 0.42)),
    ("chair", "seat", (0.46, 0.9, 0.46)),
    ("couch/sofa", "sofa", (1.9, 0.8, 0.85)),
    ("table lamp", "lamp", (0.26, 0.45, 0.26)),
    ("lamp", "lamp", (0.36, 1.4, 0.36)),
    ("bed sheet/blanket/bathrobe/clothes rack", "cloth", (0.7, 0.5, 0.4)),
    ("crib/bed", "bed", (1.5, 0.75, 2.0)),
    ("desk/table/worktop/countertop/counter/island", "table", (1.2, 0.75, 0.6)),
    ("bench", "table", (1.1, 0.45, 0.4)),
    ("refrigerator cabinet/wardrobe", "cabinet", (1.1, 2.0, 0.6)),
    ("refrigerator/freezer", "cabinet", (0.65, 1.75, 0.65)),
    ("washer/washing/dryer/dishwasher/oven/stove/cooker/kitchen appliance/furnace", "cabinet", (0.6, 0.86, 0.6)),
    ("kitchen lower cabinet/bathroom cabinet/bath cabinet/sink cabinet", "cabinet", (0.8, 0.8, 0.45)),
    ("kitchen cabinet", "cabinet", (0.9, 0.7, 0.4)),
    ("display cabinet/cabinet", "cabinet", (0.9, 1.5, 0.4)),
    ("kitchen shelf/closet shelf/shower soap shelf/rack", "shelf", (0.7, 0.5, 0.25)),
    ("shelf", "shelf", (0.9, 1.7, 0.3)),
    ("iron board/ironing board", "table", (1.1, 0.85, 0.35)),
    ("tv", "panel", (1.0, 0.6, 0.07)),
    ("monitor/computer", "panel", (0.55, 0.4, 0.1)),
    ("mirror", "panel", (0.6, 0.9, 0.04)),
    ("picture/photo/calendar/board/electric box", "panel", (0.6, 0.5, 0.04)),
    ("window/shower glass/shower cabin", "panel", (0.9, 1.2, 0.05)),
    ("rug/carpet", "flat", (1.6, 0.016, 1.1)),
    ("plant/flowerpot", "plant", (0.45, 0.9, 0.45)),
    ("vase", "plant", (0.2, 0.4, 0.2)),
    ("toilet", "toilet", (0.4, 0.75, 0.65)),
    ("bathtub/tub/spa bench", "tub", (1.6, 0.55, 0.75)),
    ("sink/washbasin", "tub", (0.55, 0.2, 0.42)),
    ("towel/cloth/clothes/hanger/curtain", "cloth", (0.45, 0.7, 0.12)),
    ("pillow/cushion", "box", (0.5, 0.2, 0.35)),
    ("radiator/heater", "cabinet", (0.8, 0.6, 0.14)),
    ("fireplace", "cabinet", (1.2, 1.1, 0.4)),
    ("piano", "cabinet", (1.4, 1.05, 0.6)),
    ("railing/balustrade/parapet/handrail", "box", (1.2, 0.9, 0.08)),
    ("stair", "box", (0.9, 0.9, 1.2)),
    ("bicycle/bike", "box", (1.2, 0.9, 0.35)),
    ("book", "box", (0.26, 0.07, 0.2)),
    ("microwave", "cabinet", (0.5, 0.3, 0.36)),
)  # fmt: skip
_DEFAULT: tuple[Family, Vec] = ("box", (0.4, 0.4, 0.4))


def look_of(category: str) -> tuple[Family, Vec]:
    """Family and typical (width, height, depth) of a category; unknown ones are a 0.4 m box."""
    padded = f" {category.replace('-', ' ')} "
    for names, family, size in _LOOKS:
        if any(f" {name} " in padded or f" {name}s " in padded for name in names.split("/")):
            return family, size
    for names, family, size in _LOOKS:  # compounds: "flowerpots", "bathtubs", "plush toy"
        if any(name in category for name in names.split("/")):
            return family, size
    return _DEFAULT
