"""Finishes that are usually the same on all furniture (steel, ceramic, screens, leaves), and shades of a finish."""

import numpy as np

from sim.homes.plan import Finish
from sim.words.finishes import Rgb

from ...words.colours import tinted


def plastic(red: int, green: int, blue: int) -> Finish:
    """A smooth finish of one colour."""
    return Finish(material="plastic", rgb=(red, green, blue))


def fabric(red: int, green: int, blue: int) -> Finish:
    """Cloth of one colour."""
    return Finish(material="fabric", rgb=(red, green, blue))


STEEL = Finish(material="metal", rgb=(184, 188, 194))
DARK_METAL = Finish(material="metal", rgb=(70, 72, 78))
BLACK_METAL = Finish(material="metal", rgb=(38, 38, 42))
BRASS = Finish(material="metal", rgb=(190, 150, 72))
BLACK = plastic(34, 34, 38)
WHITE = plastic(240, 240, 238)
CERAMIC = Finish(material="ceramic", rgb=(245, 245, 242))
LINEN = fabric(246, 243, 234)
SCREEN = plastic(22, 26, 34)
SHEEN = plastic(74, 88, 108)
LIT_SCREEN = plastic(86, 148, 214)
PANE = plastic(190, 216, 234)
PANE_SHEEN = plastic(228, 240, 248)
MIRROR = plastic(196, 212, 220)
DARK_GLASS = plastic(40, 44, 52)
DARK_WOOD = Finish(material="wood", rgb=(88, 60, 40))
LIGHT_WOOD = Finish(material="wood", rgb=(190, 150, 102))
PAPER = plastic(248, 246, 240)
SOIL = plastic(72, 54, 42)
LEAF = plastic(66, 124, 58)
LIGHT_LEAF = plastic(104, 156, 78)
GLOW = plastic(255, 244, 214)
FIRE = plastic(240, 140, 40)
SOOT = plastic(30, 27, 26)
RED = plastic(200, 40, 36)
SPINES: tuple[Rgb, ...] = ((158, 58, 48), (54, 88, 136), (196, 160, 84), (74, 118, 78), (112, 78, 122), (60, 62, 70))
"""Colours of book covers."""


def shade(finish: Finish, factor: float) -> Finish:
    """A lighter (> 1) or darker (< 1) finish of the same material and pattern."""
    return finish.model_copy(
        update={"rgb": tinted(finish.rgb, factor), "rgb2": finish.rgb2 and tinted(finish.rgb2, factor)}
    )


def plain(finish: Finish, factor: float = 1.0) -> Finish:
    """A smooth shade of the finish's first colour, without a texture, which would cost an image per shade."""
    return Finish(material="plastic", rgb=tinted(finish.rgb, factor))


def bedding(rng: np.random.Generator) -> Finish:
    """A finish of bed linen, for beds whose given colour is the frame's."""
    tones = ((224, 220, 210), (120, 142, 170), (176, 150, 130), (150, 168, 150), (96, 104, 120))
    return fabric(*tones[int(rng.integers(len(tones)))])


def is_dark(finish: Finish) -> bool:
    """Whether light metal shows better on the finish than dark metal."""
    return sum(finish.rgb) < 330
