"""What a caption says about colour, pattern and material, as a `Finish`; used by recover and arrange."""

from sim.scenes.plan import Finish, Rgb

COLOURS: dict[str, Rgb] = {
    "red": (178, 44, 40), "green": (66, 128, 70), "blue": (52, 92, 164), "yellow": (226, 186, 58),
    "orange": (222, 124, 44), "purple": (118, 72, 148), "pink": (226, 150, 170), "brown": (122, 82, 50),
    "beige": (214, 196, 162), "grey": (140, 142, 146), "gray": (140, 142, 146), "white": (236, 234, 228),
    "black": (44, 44, 48), "teal": (40, 132, 132), "turquoise": (64, 190, 184), "cream": (238, 226, 196),
    "silver": (186, 190, 196), "golden": (202, 160, 66), "gold": (202, 160, 66), "wooden": (156, 110, 66),
    "wood": (156, 110, 66), "oak": (184, 142, 90), "walnut": (98, 66, 44), "violet": (118, 72, 148),
}  # fmt: skip
"""sRGB of the colour (and wood) words that captions use."""


def rgb_from_text(text: str) -> Rgb | None:
    """The first colour word of a text as sRGB; None when it has none."""
    words = "".join(letter if letter.isalpha() else " " for letter in text.lower()).split()
    return next((COLOURS[word] for word in words if word in COLOURS), None)


def tinted(rgb: Rgb, factor: float) -> Rgb:
    """A lighter (> 1) or darker (< 1) colour."""
    red, green, blue = (max(0, min(255, round(value * factor))) for value in rgb)
    return (red, green, blue)


def finish_from_text(text: str, category: str) -> Finish:
    """The finish that a caption, or else a category, describes; what it leaves out is as usual for such things."""
    rgb = rgb_from_text(text) or rgb_from_text(category)
    return Finish(rgb=rgb or COLOURS["brown"])
