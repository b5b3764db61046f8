"""Colour words of captions as sRGB, with shades ("dark red"), mixtures ("red-brown") and the usual misspellings."""

from sim.words.finishes import Material, Rgb

COLOURS: dict[str, Rgb] = {
    "red": (178, 44, 40), "green": (66, 128, 70), "blue": (52, 92, 164), "yellow": (226, 186, 58),
    "orange": (222, 124, 44), "purple": (118, 72, 148), "pink": (226, 150, 170), "brown": (122, 82, 50),
    "beige": (214, 196, 162), "grey": (140, 142, 146), "gray": (140, 142, 146), "white": (236, 234, 228),
    "black": (44, 44, 48), "teal": (40, 132, 132), "turquoise": (64, 190, 184), "cream": (238, 226, 196),
    "silver": (186, 190, 196), "golden": (202, 160, 66), "gold": (202, 160, 66), "wooden": (156, 110, 66),
    "wood": (156, 110, 66), "oak": (184, 142, 90), "walnut": (98, 66, 44), "violet": (118, 72, 148),
    "tan": (196, 164, 124), "khaki": (176, 164, 118), "ivory": (242, 236, 216), "navy": (36, 50, 96),
    "azure": (96, 166, 222), "cyan": (70, 186, 206), "aqua": (90, 200, 200), "olive": (118, 118, 58),
    "lime": (160, 204, 70), "mint": (170, 218, 190), "maroon": (112, 34, 40), "burgundy": (112, 30, 48),
    "crimson": (168, 28, 52), "scarlet": (204, 46, 36), "magenta": (190, 50, 130), "fuchsia": (206, 56, 140),
    "lilac": (190, 162, 210), "lavender": (188, 178, 220), "peach": (244, 196, 164), "salmon": (236, 148, 124),
    "coral": (236, 124, 100), "apricot": (244, 190, 140), "mustard": (204, 160, 52), "ochre": (194, 140, 62),
    "rust": (168, 82, 44), "terracotta": (190, 100, 70), "charcoal": (66, 68, 74), "taupe": (150, 136, 120),
    "chocolate": (84, 54, 38), "caramel": (184, 124, 70), "sand": (212, 190, 148), "indigo": (66, 62, 130),
    "bronze": (150, 108, 62), "copper": (184, 108, 66), "brass": (190, 150, 72), "blonde": (214, 182, 130),
    "pine": (212, 174, 118), "birch": (222, 198, 156), "maple": (208, 168, 116), "beech": (204, 162, 112),
    "cherry": (140, 70, 46), "mahogany": (108, 50, 36), "teak": (160, 104, 60), "ebony": (52, 42, 38),
    "bamboo": (206, 178, 112), "rosewood": (98, 48, 40),
}  # fmt: skip
"""sRGB of the colour (and wood) words that captions use."""
COLOUR_NAMES = frozenset({
    "red", "blue", "green", "yellow", "brown", "grey", "white", "golden", "purple", "black", "beige", "cream",
    "orange", "pink", "teal", "turquoise", "silver",
})  # fmt: skip
"""The colours that descriptions are compared by; other words for them are in synonyms.py."""
WOODS = frozenset(
    ["wooden", "wood", "oak", "walnut", "pine", "birch", "maple", "beech", "cherry", "mahogany", "teak", "ebony",
     "bamboo", "rosewood"]
)  # fmt: skip
"""Colour words that are kinds of wood; they say less about the colour than a plain colour word."""
OF_MATERIAL: dict[str, tuple[Material, Rgb]] = {
    "stainless": ("metal", (184, 188, 194)), "steel": ("metal", (184, 188, 194)), "chrome": ("metal", (196, 200, 206)),
    "aluminium": ("metal", (190, 194, 198)), "aluminum": ("metal", (190, 194, 198)),
    "metal": ("metal", (150, 152, 158)),
    "metallic": ("metal", (170, 174, 180)), "iron": ("metal", (54, 54, 58)), "granite": ("stone", (92, 90, 92)),
    "marble": ("stone", (226, 222, 216)), "stone": ("stone", (164, 158, 150)), "brick": ("stone", (158, 84, 64)),
    "bricks": ("stone", (158, 84, 64)), "concrete": ("stone", (166, 166, 164)), "cardboard": ("paper", (190, 150, 104)),
    "wicker": ("wicker", (190, 152, 102)), "rattan": ("wicker", (190, 152, 102)), "straw": ("wicker", (212, 180, 112)),
}  # fmt: skip
"""Materials that have a colour of their own; used where no colour is named."""
_SHADES = {"light": 0.45, "pale": 0.55, "pastel": 0.5, "bright": 0.12, "dark": -0.42, "deep": -0.3, "darker": -0.4}
"""Share of the way to white (positive) or black (negative)."""
_MISSPELT = {
    "brwon": "brown", "brow": "brown", "balck": "black", "blak": "black", "wite": "white", "withe": "white",
    "whit": "white", "whitw": "white", "awhite": "white", "greyish": "grey", "grayish": "grey", "gery": "grey",
    "rad": "red", "bule": "blue", "oragne": "orange", "yelow": "yellow", "woden": "wooden", "woooden": "wooden",
    "wodden": "wooden", "steal": "steel", "stainles": "stainless", "granit": "granite", "carboard": "cardboard",
    "stoned": "stone", "colour": "color", "coloured": "colored", "reddish": "red", "purplue": "purple",
    "brownish": "brown",
    "bluish": "blue", "blueish": "blue", "greenish": "green", "yellowish": "yellow", "pinkish": "pink",
    "whitish": "white", "blackish": "black", "purplish": "purple", "orangish": "orange", "silvery": "silver",
    "offwhite": "ivory", "greay": "grey", "beigh": "beige", "bage": "beige", "floreal": "floral", "stripped": "striped",
}  # fmt: skip


def corrected(word: str) -> str:
    """The word as the tables spell it."""
    return _MISSPELT.get(word, word)


def colours_in(words: list[str], *, with_woods: bool = True) -> list[Rgb]:
    """Colours of a phrase in order; "dark blue" is one colour, and so is "red-brown" (given as "red", "-", "brown")."""
    found: list[Rgb] = []
    shade = 0.0
    is_mixed = False
    for word in words:
        if word in _SHADES:
            shade = _SHADES[word]
        elif word in COLOURS and (with_woods or word not in WOODS):
            rgb = shaded(COLOURS[word], shade)
            if is_mixed and found:
                rgb = _mean(found.pop(), rgb)
            if rgb not in found:
                found.append(rgb)
            shade, is_mixed = 0.0, False
        else:
            is_mixed = word == "-" and bool(found)
            shade = shade if word in ("-", "color", "colored") else 0.0
    return found


def shaded(rgb: Rgb, share: float) -> Rgb:
    """A colour moved towards white (positive share) or black (negative)."""
    end = 255 if share > 0 else 0
    red, green, blue = (round(value + (end - value) * abs(share)) for value in rgb)
    return (red, green, blue)


def tinted(rgb: Rgb, factor: float) -> Rgb:
    """A lighter (> 1) or darker (< 1) colour."""
    red, green, blue = (max(0, min(255, round(value * factor))) for value in rgb)
    return (red, green, blue)


def _mean(a: Rgb, b: Rgb) -> Rgb:
    red, green, blue = ((x + y) // 2 for x, y in zip(a, b, strict=True))
    return (red, green, blue)
