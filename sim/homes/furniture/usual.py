"""Finishes that are usual for a family of furniture; what a caption leaves out comes from here."""

from sim.homes.plan import Finish
from sim.words.finishes import Material, Rgb

from ...words.colours import COLOURS
from .families import Family

_WOOD = ("oak", "walnut", "wood", "pine", "cherry", "white", "maple", "teak")
_PAINTED = ("white", "oak", "wood", "ivory", "grey", "walnut")
_CLOTH = ("grey", "beige", "teal", "brown", "cream", "blue", "olive", "burgundy", "charcoal", "mustard")
_LINEN = ("white", "blue", "beige", "grey", "pink", "teal", "cream", "lavender")
_BRIGHT = ("red", "blue", "yellow", "green", "orange", "purple", "teal", "pink")
_WHITE = ("white",)
_MACHINE = ("white", "silver", "white", "black")
_POT = ("terracotta", "white", "grey", "blue", "cream")

_USUAL: tuple[tuple[str, Material, tuple[str, ...]], ...] = (
    # families, material, colours to choose from
    ("chair/stool/table/desk/bench/drawers/wardrobe/glass cabinet/shelf/wall shelf/rack", "wood", _WOOD),
    ("cabinet/piano/door/stair/railing", "wood", _WOOD),
    ("wall cabinet/counter/crib/bunk bed/window/shutter/mantle", "wood", _PAINTED),
    ("office chair/bar chair", "leather", ("black", "grey", "brown", "red", "charcoal")),
    ("armchair/sofa/ottoman", "fabric", _CLOTH),
    ("bed/blanket/towel/clothes", "fabric", _LINEN),
    ("pillow/curtain", "fabric", (*_LINEN, "mustard", "olive")),
    ("ironing board", "fabric", ("blue", "grey", "red", "teal")),
    ("flat", "carpet", ("red", "blue", "beige", "grey", "burgundy", "teal", "brown")),
    ("toilet/tub/sink", "ceramic", _WHITE),
    ("shower", "tile", ("white", "beige", "azure", "grey")),
    ("shower fitting/glass pane/dial/clothes rail/extractor", "metal", ("silver",)),
    ("refrigerator/oven/stove/dishwasher", "metal", _MACHINE),
    ("microwave/coffee machine/printer", "plastic", ("black", "silver", "white", "red")),
    ("washing machine/boiler/radiator/electric box/fan", "plastic", _WHITE),
    ("lamp/table lamp/ceiling lamp/wall lamp", "plastic", ("cream", "white", "yellow", "orange", "red", "beige")),
    ("plant/flowers/vase", "ceramic", (*_POT, "turquoise", "red")),
    ("picture/calendar", "picture", ("blue", "green", "orange", "red", "purple", "yellow", "teal", "brown")),
    ("mirror", "wood", ("gold", "walnut", "white", "black", "oak", "silver")),
    ("tv/monitor/laptop/speaker/telephone", "plastic", ("black",)),
    ("board", "plastic", ("white", "tan")),
    ("clock/bin/umbrella stand", "plastic", ("black", "silver", "white", "red", "blue")),
    ("fireplace/column", "stone", ("white", "ivory", "grey", "sand")),
    ("statue", "stone", ("white", "ivory", "bronze")),
    ("bicycle/exercise bike/suitcase/backpack/treadmill", "plastic", _BRIGHT),
    ("guitar/hanger", "plastic", ("oak", "cherry", "wood")),
    ("fire extinguisher", "plastic", ("red",)),
    ("book/cup/ball/bowl", "plastic", _BRIGHT),
    ("bottle", "plastic", ("olive", "green", "maroon")),
    ("kettle", "plastic", ("silver", "red", "black", "white")),
    ("shoes/bag", "plastic", ("brown", "black", "red", "tan", "navy")),
    ("basket", "wicker", ("bamboo", "tan", "caramel")),
    ("toy", "plastic", ("caramel", "brown", "tan", "pink", "grey")),
    ("candle", "plastic", ("ivory", "red", "white")),
    ("box", "paper", ("caramel",)),
)  # fmt: skip
_BY_FAMILY: dict[str, tuple[Material, tuple[str, ...]]] = {
    name: (material, colours) for names, material, colours in _USUAL for name in names.split("/")
}


def usual_finish(family: Family, digest: int) -> Finish:
    """One of the finishes that a family usually has; equal digests give equal finishes."""
    material, colours = _BY_FAMILY[family]
    rgb: Rgb = COLOURS[colours[digest % len(colours)]]
    if family in ("sofa", "armchair") and digest % 7 == 0:
        return Finish(material="leather", rgb=COLOURS["brown"])
    if family in ("refrigerator", "oven", "stove", "dishwasher") and rgb != COLOURS["silver"]:
        material = "plastic"  # enamel
    if family == "box":
        rgb = (190, 150, 104)
    return Finish(material=material, rgb=rgb)
