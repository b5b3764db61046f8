"""The list in README.md of which family draws which category; the README must equal `catalogue()`."""

from typing import get_args

from .families import Family, known_words, look_of, mounting_of

RELEASE_CATEGORIES = (
    "armchair", "backpack", "bag", "balustrade", "bar chair", "basket", "bath cabinet", "bath sink", "bath towel",
    "bathrobe", "bathroom cabinet", "bathroom counter", "bathroom towel", "bathtub", "bed", "bed sheet", "bed table",
    "bench", "bicycle", "blanket", "board", "book", "bookshelf", "box", "cabinet table", "calendar", "carpet",
    "chair", "chest drawer", "chest of drawers", "closet shelf", "cloth", "clothes", "clothes dryer",
    "clothes hanger rod", "clothes rack", "coffee machine", "coffee table", "computer", "computer chair",
    "computer desk", "container", "cooker", "couch", "countertop", "crib", "cushion", "decorative plant", "desk",
    "desk chair", "dining chair", "dining table", "dishwasher", "display cabinet", "drawer", "dresser",
    "electric box", "exercise bike", "fire extinguisher", "fireplace", "flower vase", "flowerpot", "folding chair",
    "footrest", "freezer", "furnace", "glass", "handbag", "handrail", "hanger", "hanging clothes", "heater",
    "iron board", "ironing board", "island", "kitchen appliance", "kitchen cabinet", "kitchen counter",
    "kitchen island", "kitchen lower cabinet", "kitchen shelf", "lamp", "lamp table", "mantle", "microwave",
    "mirror", "monitor", "nightstand", "office chair", "ottoman", "oven", "oven and stove", "parapet", "photo",
    "photo mount", "piano", "picture", "pillow", "plant", "plush toy", "rack", "radiator", "railing", "refrigerator",
    "refrigerator cabinet", "rug", "shelf", "shower", "shower cabin", "shower dial", "shower glass", "shower rail",
    "shower soap shelf", "shower tub", "sideboard", "sink", "sink cabinet", "sofa chair", "sofa seat", "sofa set",
    "spa bench", "speaker", "stair", "stairs railing", "statue", "stool", "stove", "table", "table lamp",
    "throw blanket", "toilet", "towel", "toy", "tv", "tv stand", "vase", "wardrobe", "washbasin", "washer-dryer",
    "washing machine", "window glass", "window shutter", "worktop",
)  # fmt: skip
"""All categories of goals in the released episodes."""
_HEADER = """# Furniture

Every object of a schematic or invented home is built from its category, size, finish and caption: `solids.add_piece`
puts the parts that `parts.parts_of` gives into the world. A family is one way of building; this list says which family
draws which category. "Also" are further words that the family answers to, in clutter and in invented homes. Sizes are
typical widths, heights and depths in metres, those of the first category where there are several. What no family
answers to is drawn as a cardboard box.

The list is made by `sim/homes/furniture/catalogue.py` from `families.py`; a test compares the two. To write it again:

    cd sim/homes/furniture
    python -c "from sim.homes.furniture.catalogue import catalogue; print(catalogue(), end='')" > README.md

| Family | Categories of the released episodes | Also | Usual size | Where |
|---|---|---|---|---|
"""
_PLACES = {"floor": "floor", "wall": "wall", "ceiling": "ceiling", "on": "on things"}


def catalogue() -> str:
    """The text of README.md: one row per family, in the families' order."""
    return _HEADER + "".join(_row(family) for family in get_args(Family))


def _row(family: Family) -> str:
    released = [category for category in RELEASE_CATEGORIES if look_of(category)[0] == family]
    words = [word for word in known_words() if look_of(word)[0] == family]
    also = [word for word in words if word not in released]
    first = (released or words)[0]
    size = " x ".join(f"{value:g}" for value in look_of(first)[1])
    places = sorted({_PLACES[mounting_of(word)] for word in (released or words)})
    return f"| {family} | {', '.join(released) or '-'} | {', '.join(also) or '-'} | {size} | {', '.join(places)} |\n"
