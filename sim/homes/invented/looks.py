"""Looks of pieces in invented homes: words for a caption, with the finish that shows them."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from ...words.colours import COLOURS
from ...words.english import with_article
from ...words.finishes import Material, Pattern
from ..plan import Finish


class Look(NamedTuple):
    """One possible look of a category of pieces."""

    words: str
    """Words for a caption: "red and white striped fabric"."""
    colour: str
    """The main colour, a key of COLOURS."""
    finish: Finish


def described(category: str, words: str, size: str = "") -> str:
    """A piece of this look and size ("" = usual) in words, no article: "small plant with a blue ceramic pot"."""
    if category in ("lamp", "table lamp"):
        text = f"{category} with {with_article(words)} shade"
    elif category in ("plant", "decorative plant"):
        text = f"{category} with {with_article(words)} pot"
    elif category == "bed":
        text = f"bed with {with_article(words)} cover"
    else:
        text = f"{words} {category}"
    return f"{size} {text}" if size else text


_BRIGHT = ("red", "green", "blue", "yellow", "purple", "teal", "orange", "pink")
_CALM = ("grey", "beige", "brown", "black", "white")
_WITH_WHITE = ("red", "green", "blue", "yellow", "grey", "purple")


def _plain(colours: Sequence[str], word: str, material: Material) -> list[Look]:
    return [Look(f"{c} {word}".strip(), c, Finish(material=material, rgb=COLOURS[c])) for c in colours]


def _patterned(colours: Sequence[str], second: str, pattern: Pattern, word: str, material: Material) -> list[Look]:
    return [
        Look(
            f"{c} and {second} {pattern} {word}".strip(),
            c,
            Finish(material=material, pattern=pattern, rgb=COLOURS[c], rgb2=COLOURS[second]),
        )
        for c in colours
    ]


_STUFFS = [
    *_plain((*_BRIGHT, "grey", "beige"), "fabric", "fabric"),
    *_plain(("green", "red", "blue", "purple", "teal", "pink"), "velvet", "fabric"),
    *_patterned(("red", "blue", "green", "grey"), "white", "striped", "fabric", "fabric"),
    *_patterned(("red", "blue", "green"), "beige", "plaid", "fabric", "fabric"),
    *_patterned(("yellow", "purple", "teal", "pink"), "white", "floral", "fabric", "fabric"),
]
_SEATS = [*_STUFFS, *_plain(("black", "brown", "red", "beige", "white"), "leather", "leather")]
_CLOTHS = [
    *_plain((*_BRIGHT, "grey", "beige", "white", "brown"), "", "fabric"),
    *_patterned(_WITH_WHITE, "white", "striped", "", "fabric"),
    *_patterned(("red", "blue", "green", "orange"), "beige", "plaid", "", "fabric"),
    *_patterned(("yellow", "purple", "teal", "pink"), "white", "floral", "", "fabric"),
    *_patterned(("blue", "red"), "white", "dotted", "", "fabric"),
]
_RUGS = [
    *_plain(("red", "blue", "green", "grey", "beige", "purple", "orange", "teal"), "woven", "carpet"),
    *_patterned(("red", "blue", "green", "grey"), "white", "striped", "woven", "carpet"),
    *_patterned(("red", "blue", "brown", "orange"), "beige", "patterned", "woven", "carpet"),
    *_patterned(("purple", "teal", "green"), "beige", "floral", "woven", "carpet"),
    *_patterned(("black", "blue"), "white", "checked", "woven", "carpet"),
]
_WOODS = [
    *(Look(w, w, Finish(material="wood", rgb=COLOURS[w])) for w in ("oak", "walnut")),
    *_plain(("white", "black", "blue", "red", "green", "yellow", "grey", "teal", "orange", "pink"), "wooden", "wood"),
]
_ENAMEL = _plain(("white", "silver", "red", "black", "cream", "blue", "green"), "enamel", "metal")
_METAL = _plain(("silver", "black", "white", "red", "blue", "green", "golden", "yellow"), "metal", "metal")
_GLAZED = [
    *_plain((*_BRIGHT, "white", "black", "brown"), "ceramic", "ceramic"),
    *_patterned(("blue", "green", "red"), "white", "striped", "ceramic", "ceramic"),
    *_patterned(("orange", "teal", "purple"), "white", "dotted", "ceramic", "ceramic"),
]
_GLASS = _plain(("green", "blue", "red", "purple"), "glass", "glass")
_PICTURES = [
    *_plain((*_BRIGHT, "grey", "black"), "abstract", "picture"),
    *(
        Look(f"{a} and {b} abstract", a, Finish(material="picture", rgb=COLOURS[a], rgb2=COLOURS[b]))
        for a, b in (
            ("red", "yellow"), ("blue", "orange"), ("green", "beige"), ("purple", "green"), ("teal", "pink"),
            ("black", "white"), ("yellow", "blue"), ("orange", "purple"), ("grey", "red"), ("pink", "teal"),
        )
    ),
]  # fmt: skip
_SHADES = [
    *_plain(("white", "yellow", "red", "green", "orange", "blue", "purple", "pink", "teal"), "paper", "paper"),
    *_patterned(("red", "blue", "green"), "white", "striped", "fabric", "fabric"),
]
_PAPER = _plain((*_BRIGHT, *_CALM), "", "paper")
_WICKER = _plain(("brown", "white", "black", "beige"), "wicker", "wicker")
_PLUSH = _plain(("brown", "pink", "grey", "yellow", "blue", "green"), "", "fabric")
_SCREENS = _plain(("black", "white", "silver", "grey"), "", "plastic")
_FRAMES = [*_WOODS[:4], *_plain(("golden", "silver"), "metal", "metal")]

_APPLIANCES = ("refrigerator", "stove", "washing machine", "clothes dryer", "microwave", "coffee machine", "radiator")
_OF: dict[str, Sequence[Look]] = {
    **dict.fromkeys(("couch", "armchair", "ottoman"), _SEATS),
    **dict.fromkeys(("bed", "cushion", "throw blanket", "towel", "curtain"), _CLOTHS),
    **dict.fromkeys(("lamp", "table lamp"), _SHADES),
    **dict.fromkeys(("plant", "decorative plant"), _GLAZED),
    **dict.fromkeys((*_APPLIANCES, "bathtub"), _ENAMEL),
    **dict.fromkeys(("tv", "monitor", "speaker"), _SCREENS),
    **dict.fromkeys(("mirror", "photo"), _FRAMES),
    **dict.fromkeys(("ironing board", "clothes rack"), _METAL),
    **dict.fromkeys(("book", "box"), _PAPER),
    **dict.fromkeys(("toilet", "sink"), _plain(("white", "black", "cream", "grey"), "ceramic", "ceramic")),
    "rug": _RUGS,
    "chair": [*_WOODS, *_SEATS],
    "desk chair": [*_SEATS, *_WOODS],
    "stool": [*_WOODS, *_METAL],
    "picture": _PICTURES,
    "bowl": [*_GLAZED, *_WOODS[:2], *_GLASS],
    "vase": [*_GLAZED, *_GLASS],
    "statue": _plain(("white", "black", "golden", "green"), "stone", "stone"),
    "basket": _WICKER,
    "plush toy": _PLUSH,
    "toy": _WOODS[2:],
    "bag": [*_CLOTHS[:10], *_SEATS[-5:]],
}
"""Looks of the categories that are not plain wood."""


@cache
def looks_of(category: str) -> tuple[Look, ...]:
    """All possible looks of a category; wood is the default."""
    return tuple(_OF.get(category, _WOODS))
