"""The family, usual size and mounting of each category of objects.

Recovered, invented and cluttered homes place pieces by these; parts.py builds the pieces. README.md shows the table.
"""

from functools import lru_cache
from typing import Literal, NamedTuple

Vec = tuple[float, float, float]
Mounting = Literal["floor", "wall", "ceiling", "on"]
"""Stands on the floor, hangs on a wall, hangs from the ceiling, or lies on something else."""
Family = Literal[
    "chair", "office chair", "armchair", "sofa", "stool", "bar chair", "bench", "ottoman",
    "table", "desk", "counter", "ironing board",
    "cabinet", "drawers", "wardrobe", "wall cabinet", "glass cabinet", "shelf", "wall shelf", "rack", "clothes rail",
    "bed", "bunk bed", "crib", "pillow", "blanket",
    "toilet", "tub", "sink", "shower", "shower fitting", "glass pane",
    "refrigerator", "oven", "stove", "washing machine", "dishwasher", "microwave", "coffee machine", "boiler",
    "extractor", "lamp", "table lamp", "ceiling lamp", "wall lamp", "plant", "flowers", "vase",
    "flat", "curtain", "towel", "clothes",
    "picture", "mirror", "tv", "monitor", "laptop", "calendar", "clock", "board", "electric box", "shutter",
    "railing", "stair", "window", "door", "column", "panel", "fireplace", "mantle", "radiator", "fan",
    "piano", "bicycle", "exercise bike", "treadmill", "guitar", "fire extinguisher",
    "book", "bottle", "cup", "bowl", "kettle", "shoes", "box", "basket", "bin", "bag", "backpack", "toy", "ball",
    "speaker", "statue", "candle", "umbrella stand", "suitcase", "printer", "dial", "hanger", "telephone",
]  # fmt: skip


class Look(NamedTuple):
    """The usual look of a category."""

    family: Family
    size: Vec
    """Width, height, depth in metres."""
    mounting: Mounting = "floor"


_LOOKS: tuple[tuple[str, Look], ...] = (
    # words of categories, separated by slashes
    ("desk chair/office chair/computer chair/swivel chair", Look("office chair", (0.6, 1.0, 0.6))),
    ("armchair/sofa chair/sofa seat/recliner/lounge chair", Look("armchair", (0.85, 0.85, 0.85))),
    ("bar chair/bar stool/counter stool", Look("bar chair", (0.42, 1.0, 0.44))),
    ("stool", Look("stool", (0.4, 0.45, 0.4))),
    ("ottoman/footrest/pouf/puff/footstool", Look("ottoman", (0.55, 0.42, 0.55))),
    ("couch/sofa/sofa set/loveseat", Look("sofa", (1.95, 0.85, 0.9))),
    ("spa bench", Look("bench", (1.4, 0.5, 0.5))),
    ("bench", Look("bench", (1.2, 0.46, 0.4))),
    ("chair", Look("chair", (0.46, 0.92, 0.5))),
    ("table lamp/desk lamp/bedside lamp", Look("table lamp", (0.3, 0.5, 0.3), "on")),
    ("ceiling lamp/chandelier/pendant lamp/hanging lamp", Look("ceiling lamp", (0.45, 0.6, 0.45), "ceiling")),
    ("ceiling fan", Look("fan", (1.1, 0.35, 1.1), "ceiling")),
    ("wall lamp/sconce", Look("wall lamp", (0.22, 0.3, 0.2), "wall")),
    ("nightstand/bed table/lamp table/bedside table", Look("drawers", (0.48, 0.55, 0.42))),
    ("dining table", Look("table", (1.5, 0.75, 0.9))),
    ("coffee table", Look("table", (0.95, 0.42, 0.6))),
    ("side table/end table", Look("table", (0.5, 0.5, 0.5))),
    ("console table", Look("table", (1.1, 0.8, 0.38))),
    ("tv stand/cabinet table", Look("cabinet", (1.3, 0.55, 0.45))),
    ("sideboard/credenza", Look("cabinet", (1.4, 0.85, 0.45))),
    ("chest drawer/chest of drawers/dresser/chest", Look("drawers", (1.0, 0.85, 0.48))),
    ("drawer", Look("drawers", (0.6, 0.65, 0.45))),
    ("lamp", Look("lamp", (0.42, 1.55, 0.42))),
    ("bed sheet/blanket/throw blanket/throw", Look("blanket", (0.6, 0.25, 0.45), "on")),
    ("clothes rack/hanger rod/clothes rail", Look("clothes rail", (0.9, 1.5, 0.45))),
    ("bathrobe/robe/hanging clothes", Look("clothes", (0.6, 1.1, 0.25), "wall")),
    ("hanger", Look("hanger", (0.42, 0.3, 0.045), "wall")),
    ("clothes/coat/jacket", Look("clothes", (0.8, 1.0, 0.4), "wall")),
    ("bunk bed", Look("bunk bed", (1.0, 1.7, 2.0))),
    ("crib", Look("crib", (0.72, 0.95, 1.25))),
    ("bed", Look("bed", (1.55, 0.95, 2.05))),
    ("computer desk/desk/writing table", Look("desk", (1.3, 0.75, 0.65))),
    ("countertop/worktop", Look("counter", (1.4, 0.9, 0.6))),
    ("kitchen counter/kitchen island/island", Look("counter", (1.5, 0.9, 0.75))),
    ("bathroom counter/counter", Look("counter", (1.1, 0.85, 0.55))),
    ("ironing board/iron board", Look("ironing board", (1.2, 0.9, 0.36))),
    ("table", Look("table", (1.1, 0.74, 0.7))),
    ("refrigerator cabinet", Look("wardrobe", (0.75, 2.1, 0.65))),
    ("wardrobe/closet", Look("wardrobe", (1.3, 2.05, 0.6))),
    ("refrigerator/fridge/freezer", Look("refrigerator", (0.72, 1.8, 0.7))),
    ("washer-dryer/washer dryer/washing machine/washer/clothes dryer/dryer", Look("washing machine", (0.6, 0.87, 0.6))),
    ("dishwasher", Look("dishwasher", (0.6, 0.86, 0.6))),
    ("microwave", Look("microwave", (0.52, 0.3, 0.38), "on")),
    ("oven and stove/stove/cooker/hob", Look("stove", (0.65, 0.92, 0.62))),
    ("oven", Look("oven", (0.6, 0.62, 0.58))),
    ("extractor/range hood/cooker hood", Look("extractor", (0.6, 0.7, 0.45), "wall")),
    ("coffee machine/coffee maker/kitchen appliance/mixer/toaster", Look("coffee machine", (0.26, 0.36, 0.32), "on")),
    ("furnace/boiler/water heater", Look("boiler", (0.6, 1.4, 0.6))),
    ("radiator/heater", Look("radiator", (0.9, 0.6, 0.14))),
    ("fireplace", Look("fireplace", (1.35, 1.15, 0.45))),
    ("mantle/mantelpiece", Look("mantle", (1.4, 0.42, 0.26), "wall")),
    ("kitchen lower cabinet", Look("cabinet", (0.9, 0.88, 0.6))),
    ("bathroom cabinet/bath cabinet/sink cabinet/vanity", Look("cabinet", (0.85, 0.82, 0.5))),
    ("kitchen cabinet/wall cabinet", Look("wall cabinet", (0.95, 0.7, 0.38), "wall")),
    ("display cabinet/glass cabinet", Look("glass cabinet", (0.95, 1.75, 0.42))),
    ("cabinet/cupboard", Look("cabinet", (0.9, 1.2, 0.45))),
    ("kitchen shelf/closet shelf/wall shelf/shelf unit", Look("wall shelf", (0.9, 0.55, 0.28), "wall")),
    ("shower soap shelf", Look("shower fitting", (0.28, 0.3, 0.12), "wall")),
    ("bookshelf/bookcase", Look("shelf", (0.95, 1.9, 0.32))),
    ("shelf", Look("wall shelf", (0.95, 0.9, 0.3), "wall")),
    ("rack", Look("rack", (0.9, 0.95, 0.35))),
    ("tv/television", Look("tv", (1.1, 0.65, 0.09), "wall")),
    ("laptop", Look("laptop", (0.34, 0.24, 0.26), "on")),
    ("monitor/computer", Look("monitor", (0.58, 0.46, 0.2), "on")),
    ("mirror", Look("mirror", (0.65, 0.95, 0.04), "wall")),
    ("calendar", Look("calendar", (0.32, 0.5, 0.025), "wall")),
    ("clock", Look("clock", (0.32, 0.32, 0.05), "wall")),
    ("photo mount/photo/picture/painting/poster", Look("picture", (0.7, 0.55, 0.04), "wall")),
    ("electric box/fuse box", Look("electric box", (0.35, 0.5, 0.1), "wall")),
    ("board/whiteboard/blackboard", Look("board", (1.0, 0.75, 0.05), "wall")),
    ("window shutter/shutter/blind", Look("shutter", (0.9, 1.2, 0.07), "wall")),
    ("shower cabin/shower", Look("shower", (0.95, 2.05, 0.95))),
    ("shower tub", Look("tub", (1.0, 0.35, 0.9))),
    ("shower glass/glass door", Look("glass pane", (0.9, 1.9, 0.05))),
    ("shower dial", Look("dial", (0.22, 0.22, 0.12), "wall")),
    ("shower rail", Look("shower fitting", (0.28, 0.9, 0.22), "wall")),
    ("window glass/window", Look("window", (1.1, 1.25, 0.08), "wall")),
    ("door", Look("door", (0.9, 2.05, 0.08), "wall")),
    ("bath mat/doormat", Look("flat", (0.8, 0.016, 0.5))),
    ("rug/carpet/mat", Look("flat", (1.8, 0.016, 1.25))),
    ("flower vase/flowers/bouquet", Look("flowers", (0.32, 0.5, 0.32), "on")),
    ("flowerpot/flower pot/pot plant", Look("plant", (0.35, 0.5, 0.35), "on")),
    ("tree", Look("plant", (0.9, 1.7, 0.9))),
    ("plant/christmas tree", Look("plant", (0.6, 1.05, 0.6))),
    ("vase/urn/jar", Look("vase", (0.2, 0.4, 0.2), "on")),
    ("toilet", Look("toilet", (0.4, 0.78, 0.7))),
    ("bathtub/tub/jacuzzi", Look("tub", (1.65, 0.56, 0.78))),
    ("sink/washbasin/basin", Look("sink", (0.58, 0.3, 0.45), "wall")),
    ("curtain", Look("curtain", (1.5, 2.1, 0.14), "wall")),
    ("towel", Look("towel", (0.5, 0.75, 0.1), "wall")),
    ("cloth/tablecloth", Look("towel", (0.5, 0.6, 0.1), "wall")),
    ("pillow/cushion", Look("pillow", (0.5, 0.18, 0.4), "on")),
    ("stairs railing/stair railing/railing/balustrade/parapet/handrail/banister", Look("railing", (1.5, 0.95, 0.08))),
    ("stairs/stair/staircase", Look("stair", (1.0, 1.0, 1.4))),
    ("column/pillar", Look("column", (0.35, 2.4, 0.35))),
    ("wall panel", Look("panel", (0.9, 1.2, 0.03), "ceiling")),
    ("fan", Look("fan", (0.45, 1.1, 0.4))),
    ("piano", Look("piano", (1.45, 1.1, 0.62))),
    ("exercise bike/exercise machine/elliptical", Look("exercise bike", (0.55, 1.2, 1.05))),
    ("treadmill", Look("treadmill", (0.75, 1.3, 1.5))),
    ("bicycle/bike", Look("bicycle", (1.65, 1.0, 0.5))),
    ("guitar", Look("guitar", (0.38, 1.0, 0.12))),
    ("fire extinguisher", Look("fire extinguisher", (0.18, 0.5, 0.18), "wall")),
    ("book/books/magazine", Look("book", (0.26, 0.14, 0.2), "on")),
    ("wine bottle/bottle", Look("bottle", (0.09, 0.3, 0.09), "on")),
    ("cup/mug", Look("cup", (0.11, 0.1, 0.09), "on")),
    ("glass", Look("cup", (0.09, 0.16, 0.09), "on")),
    ("fruit bowl/bowl/plate/dish", Look("bowl", (0.28, 0.13, 0.28), "on")),
    ("kettle/teapot", Look("kettle", (0.24, 0.24, 0.18), "on")),
    ("shoe/slipper/boot", Look("shoes", (0.24, 0.12, 0.29))),
    ("laundry basket/basket", Look("basket", (0.4, 0.35, 0.32))),
    ("trash bin/trashcan/trash can/bin/bucket", Look("bin", (0.28, 0.4, 0.28))),
    ("backpack", Look("backpack", (0.34, 0.48, 0.22))),
    ("handbag/bag/purse", Look("bag", (0.38, 0.36, 0.16))),
    ("suitcase/luggage", Look("suitcase", (0.42, 0.66, 0.26))),
    ("plush toy/teddy bear/teddy/toy/doll", Look("toy", (0.32, 0.4, 0.28), "on")),
    ("ball", Look("ball", (0.24, 0.24, 0.24))),
    ("speaker/loudspeaker", Look("speaker", (0.24, 0.42, 0.26), "on")),
    ("statue/sculpture/bust/figurine", Look("statue", (0.24, 0.5, 0.2), "on")),
    ("candle/candlestick", Look("candle", (0.1, 0.26, 0.1), "on")),
    ("umbrella stand/umbrella", Look("umbrella stand", (0.26, 0.8, 0.26))),
    ("printer/scanner", Look("printer", (0.44, 0.25, 0.38), "on")),
    ("telephone/phone", Look("telephone", (0.2, 0.12, 0.2), "on")),
    ("container/organizer/crate", Look("box", (0.4, 0.32, 0.32))),
    ("box/chest", Look("box", (0.45, 0.35, 0.35))),
)  # fmt: skip
UNKNOWN = Look("box", (0.4, 0.4, 0.4))
"""Look of categories without a family of their own."""
BY_WORDS = tuple((name, look) for names, look in _LOOKS for name in names.split("/"))
"""Known words of categories with their look, in the order of the table."""


@lru_cache(maxsize=4096)
def look_of(category: str) -> Look:
    """The usual look of things of a category; things of unknown categories are boxes.

    The longest known words in the category count; of equally long words, the last ones. So a "sink cabinet" is a
    cabinet, and a "garden chair", which has no line of its own, is a chair.
    """
    padded = f" {category.lower().replace('-', ' ').replace('_', ' ')} "
    whole = [(len(name), at, look) for name, look in BY_WORDS for at in (_place_of_words(padded, name),) if at >= 0]
    if not whole:  # compounds: "flowerpots", "bathtubs"
        whole = [(len(name), padded.rfind(name), look) for name, look in BY_WORDS if len(name) > 3 and name in padded]
    return max(whole, key=lambda found: found[:2])[2] if whole else UNKNOWN


def _place_of_words(padded: str, name: str) -> int:
    """Place of the last occurrence of whole words in a text with spaces at both ends; -1 = none. Plurals count."""
    return max(padded.rfind(f" {name} "), padded.rfind(f" {name}s "), padded.rfind(f" {name}es "))
