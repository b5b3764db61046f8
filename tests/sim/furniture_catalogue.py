"""The table of furniture families in sim/homes/furniture/README.md; running this module writes it again."""

from pathlib import Path
from typing import get_args

from sim.homes.furniture import families
from sim.homes.furniture.families import BY_WORDS, Family, look_of

README = Path(families.__file__).parent / "README.md"
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
WORDS = tuple(word for word, _ in BY_WORDS)
"""All words that name some family, in the table's order."""
_HEADER = """# Furniture

Every object of a schematic or invented home is built from its category, size, finish and caption: `add_piece`
puts the parts that `parts.parts_of` gives into the world. A family is one way of building; this list says which family
draws which category. "Also" lists further words for the family, used in clutter and in invented homes. Sizes are
typical widths, heights and depths in metres; if a row has several categories, the size is that of the first. An object
that no family matches is drawn as a cardboard box.

The list is made from `families.py`, and a test compares the two. To write it again, from the top of the repository:

    python -m tests.sim.furniture_catalogue

| Family | Categories of the released episodes | Also | Usual size | Where |
|---|---|---|---|---|
"""
_PLACES = {"floor": "floor", "wall": "wall", "ceiling": "ceiling", "on": "on things"}


def catalogue() -> str:
    """The text of README.md: one row per family, in the families' order."""
    return _HEADER + "".join(_row(family) for family in get_args(Family))


def _row(family: Family) -> str:
    released = [category for category in RELEASE_CATEGORIES if look_of(category).family == family]
    words = [word for word in WORDS if look_of(word).family == family]
    also = [word for word in words if word not in released]
    first = (released or words)[0]
    size = " x ".join(f"{value:g}" for value in look_of(first).size)
    places = sorted({_PLACES[look_of(word).mounting] for word in (released or words)})
    return f"| {family} | {', '.join(released) or '-'} | {', '.join(also) or '-'} | {size} | {', '.join(places)} |\n"


if __name__ == "__main__":
    README.write_text(catalogue(), encoding="utf-8")
