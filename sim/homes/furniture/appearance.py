"""The `Finish` that a caption describes by colour, pattern and material; the family's usual finish fills the gaps."""

import zlib

from sim.homes.plan import Finish
from sim.words.finishes import Material, Pattern, Rgb

from ...words.captions import OwnWords, own_words
from ...words.colours import COLOURS, OF_MATERIAL, WOODS, colours_in
from .families import Family, look_of

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
    ("panel", "plaster", _WHITE),
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
"""Usual finishes of each family, for colours and materials that a caption does not give."""
_MATERIAL_WORDS: tuple[tuple[Material, str], ...] = (
    ("wood", " ".join(sorted(WOODS))),
    ("fabric", "fabric cloth velvet wool woolen cotton linen fur"),
    ("leather", "leather suede"),
    ("ceramic", "ceramic porcelain enamel terracotta clay"),
    ("metal", "silver golden gold brass bronze copper"),
    ("glass", "glass"),
    ("plastic", "plastic"),
    ("paper", "paper"),
    ("tile", "tiled tiles"),
)
_MATERIALS: dict[str, Material] = {
    **{word: material for material, words in _MATERIAL_WORDS for word in words.split()},
    **{word: material for word, (material, _) in OF_MATERIAL.items()},
}
_PATTERN_WORDS: tuple[tuple[Pattern, str], ...] = (
    ("striped", "striped stripes stripe stripy lined lines"),
    ("plaid", "plaid tartan"),
    ("checked", "checkered checked chequered checkerboard squares"),
    ("floral", "floral flowery flowers flower flowered roses"),
    ("dotted", "dotted dots spotted polka"),
    ("patterned", "patterned pattern patterns geometric ornate chevron motif decorated zigzag persian oriental"),
    ("patterned", "colorful multicolored hexagonal circles drawings decoration decorations"),
)
_PATTERNS: dict[str, Pattern] = {word: pattern for pattern, words in _PATTERN_WORDS for word in words.split()}
_SOFT = ("fabric", "carpet", "leather")
_ONE_MATERIAL: dict[Family, Material] = {
    "flat": "carpet", "picture": "picture", "calendar": "picture", "curtain": "fabric", "towel": "fabric",
    "clothes": "fabric", "blanket": "fabric", "pillow": "fabric", "bed": "fabric", "fire extinguisher": "plastic",
    "toy": "fabric",
}  # fmt: skip
"""Families that have one material, whatever their captions say; wooden beds have their own branch."""
_CAN_BE_PATTERNED = (*_SOFT, "tile", "paper", "ceramic", "wicker")


def finish_from_text(text: str, category: str) -> Finish:
    """The finish that a caption describes; gaps are filled as usual for the category.

    The thing's own attributes count, not those of other things in the text: "white sofa with red pillows" and "the
    white sofa next to a red chair" are white.

    Args:
        text: A caption, or any English text; may be empty.
        category: The object's category; its words count where the text names no material or colour.
    """
    family = look_of(category).family
    digest = zlib.crc32(f"{category}|{text}|".encode())  # a different digest would change the colours of all homes
    usual = usual_finish(family, digest // 7)
    said = own_words(text, category)
    if family in ("picture", "calendar"):
        said = said._replace(parts=[])  # a frame is not part of the painting
    colours, is_of_part = _colours(said)
    material = _material(family, said, usual)
    pattern = _pattern(family, said, len(colours), material)
    if not colours:
        own = [OF_MATERIAL[word][1] for word in (*said.noun, *said.rest, *said.parts) if word in OF_MATERIAL]
        colours = own[:1] or [_usual_rgb(material, usual)]
    second = colours[1] if len(colours) > 1 else None
    if family == "bed" and is_of_part and material != "wood":
        pattern = "plain" if pattern == "patterned" else pattern
    return Finish(material=material, pattern=pattern, rgb=colours[0], rgb2=second)


def _colours(said: OwnWords) -> tuple[list[Rgb], bool]:
    """At most two colours, the more important first, and whether the first one is the colour of a part."""
    for with_woods in (False, True):
        for words in (said.noun, said.rest):
            found = colours_in(words, with_woods=with_woods)
            if found:
                return [*found, *(rgb for rgb in colours_in(said.parts) if rgb not in found)][:2], False
        found = colours_in(said.parts, with_woods=with_woods)
        if found:
            return found[:2], True
    return [], False


def _material(family: Family, said: OwnWords, usual: Finish) -> Material:
    """The first material that the caption names for the thing, if such things can be made of it."""
    named: list[Material] = [_MATERIALS[word] for word in (*said.noun, *said.rest) if word in _MATERIALS]
    if family == "bed" and "wood" in named and not colours_in(said.noun, with_woods=False):
        return "wood"
    if family in _ONE_MATERIAL:
        return _ONE_MATERIAL[family]
    if named:
        return named[0]
    part: list[Material] = [_MATERIALS[word] for word in said.parts if word in _MATERIALS]
    return part[0] if part and usual.material not in _SOFT else usual.material


def _pattern(family: Family, said: OwnWords, num_colours: int, material: Material) -> Pattern:
    if material not in _CAN_BE_PATTERNED or family in ("toilet", "tub", "sink"):
        return "plain"
    words = (*said.noun, *said.rest, *said.parts)
    ignored = {"flower", "flowers"} if family in ("plant", "flowers", "vase") else set()
    named: list[Pattern] = [_PATTERNS[word] for word in words if word in _PATTERNS and word not in ignored]
    if named:
        return min(named, key=lambda pattern: pattern == "patterned")  # "floral pattern" is floral
    return "patterned" if num_colours > 1 and material in ("fabric", "carpet") else "plain"


def _usual_rgb(material: Material, usual: Finish) -> Rgb:
    """The usual colour, unless the named material cannot have it."""
    if material == usual.material or material not in ("wood", "leather", "glass", "metal"):
        return usual.rgb
    return {"wood": COLOURS["wood"], "leather": COLOURS["brown"], "glass": (190, 214, 218), "metal": COLOURS["silver"]}[
        material
    ]


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
