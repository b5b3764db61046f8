"""Images of surfaces: `Finish` -> a small texture that repeats without a seam; read by quads.py.

A texture is the pattern's colours (patterns.py) times the material's detail (materials.py), shifted so
that its mean is the finish's colour. Everything follows from the finish alone.
"""

import hashlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Material, Pattern, Rgb
from ..plan import Finish
from .materials import Metres, Shape, detail_of
from .patterns import painted, pattern_weights

_SHEEN = np.float32(36)
"""Strength of detail on black (levels), where it would otherwise vanish."""
_WITH_DETAIL = np.float32(10), np.float32(245)
"""Darkest and lightest colours (levels) that leave room for detail."""
_STEEL_FROM = 90
"""Grey metal at least this light (levels) is brushed steel; darker or coloured metal is painted and smooth."""
_THROUGH_PAINT = np.float32(0.4)
"""Share of the grain that shows on painted wood."""
_PAINT = 24
"""Metal counts as coloured if its channels differ by more than this (levels)."""
_SIDES: dict[Material, tuple[int, int, float, float]] = {
    # width and height in pixels, width and height in metres, of plain material
    "wood": (128, 128, 0.9, 0.45),
    "fabric": (128, 128, 0.32, 0.32),
    "leather": (128, 128, 0.4, 0.4),
    "metal": (64, 64, 0.4, 0.2),
    "stone": (128, 128, 0.9, 0.9),
    "paper": (64, 64, 0.25, 0.25),
    "leaf": (128, 128, 0.4, 0.4),
    "wicker": (64, 64, 0.16, 0.16),
    "plaster": (128, 128, 1.6, 1.6),
    "tile": (256, 256, 1.2, 1.2),
    "carpet": (128, 128, 0.6, 0.6),
}
_FLOOR_SIDES: dict[Material, tuple[int, int, float, float]] = {
    "wood": (256, 256, 2.0, 1.0),
    "stone": (256, 256, 1.8, 1.8),
    "carpet": (256, 256, 1.2, 1.2),
}
_PATTERN_METRES: dict[Material, float] = {"carpet": 0.96, "plaster": 0.96, "tile": 1.2, "stone": 1.2}
_PATTERN_SIDE = 128
_USUAL_PATTERN_METRES = 0.48


@dataclass(frozen=True, slots=True)
class Texture:
    """An image, and the size of the surface that it covers."""

    image: NDArray[np.uint8]
    """(h, w, 3) sRGB, C-contiguous, read-only; repeats without a seam unless it is whole."""
    metres: tuple[float, float]
    """Width and height of the surface that the image covers."""
    rgb: tuple[float, float, float]
    """Mean colour of the image."""
    is_whole: bool = False
    """Whether the image covers each face once, whatever the face's size, as a painting does."""


def texture_of(finish: Finish, *, is_floor: bool = False) -> Texture | None:
    """The image of a surface seen from near; None = the surface is smooth and of one colour.

    Where people walk on it (`is_floor`), wood is laid in planks and stone in slabs.

    Returns:
        An image of 64 to 256 pixels a side. Its mean is the finish's colour; with a pattern it is between the finish's
        two colours.
    """
    is_laid = is_floor and (finish.material in _FLOOR_SIDES if finish.pattern == "plain" else finish.material != "tile")
    return _made(finish.material, finish.pattern, finish.rgb, second_colour(finish), is_laid)


@lru_cache(maxsize=1024)
def _made(material: Material, pattern: Pattern, rgb: Rgb, rgb2: Rgb, is_laid: bool) -> Texture | None:
    if material == "picture":
        seed = hashlib.sha256(f"{rgb} {rgb2} {pattern}".encode()).digest()[:8]
        return _texture(painted(rgb, rgb2, seed=int.from_bytes(seed, "little")), (1.0, 1.0), is_whole=True)
    if pattern == "plain" and _is_smooth(material, rgb):
        return None
    shape, metres = _size(material, is_plain=pattern == "plain", is_laid=is_laid)
    colour = np.broadcast_to(np.array(rgb, np.float32), (*shape, 3))
    if pattern != "plain":
        weights = pattern_weights(pattern, shape, metres, is_tiled=material == "tile")
        colour = colour + np.float32(weights[..., None]) * (np.array(rgb2, np.float32) - colour)
    colour = np.clip(colour, *_WITH_DETAIL)
    detail = detail_of(material, shape, metres, is_floor=is_laid and pattern == "plain")
    strength = _THROUGH_PAINT if material == "wood" and not is_laid and _is_painted(rgb) else np.float32(1)
    image = colour + strength * (detail - 1) * (np.float32(0.85) * colour + _SHEEN)
    return _texture(_with_mean(image, colour.mean(axis=(0, 1))), metres)


def second_colour(finish: Finish) -> Rgb:
    """The second colour of a pattern: the finish's own, or else a clearly darker or lighter shade."""
    if finish.rgb2 is not None:
        return finish.rgb2
    rgb = np.array(finish.rgb, float)
    shade = rgb * 0.5 if rgb @ (0.3, 0.59, 0.11) > 110 else rgb + 0.5 * (255 - rgb)
    red, green, blue = shade.round().astype(int).tolist()
    return (red, green, blue)


def _size(material: Material, *, is_plain: bool, is_laid: bool) -> tuple[Shape, Metres]:
    """Rows and columns of the image, and the width and height that it covers."""
    if is_plain or material == "tile":
        width, height, *metres = _FLOOR_SIDES[material] if is_laid else _SIDES[material]
        return (height, width), (metres[0], metres[1])
    metres = _PATTERN_METRES.get(material, _USUAL_PATTERN_METRES)
    side = 2 * _PATTERN_SIDE if is_laid else _PATTERN_SIDE
    return (side, side), (metres, metres)


def _is_smooth(material: Material, rgb: Rgb) -> bool:
    if material != "metal":
        return material not in _SIDES
    return min(rgb) < _STEEL_FROM or max(rgb) - min(rgb) > _PAINT


def _is_painted(rgb: Rgb) -> bool:
    """Whether wood has this colour only under paint: none of the browns from pale pine to walnut."""
    red, green, blue = rgb
    return not (red >= green >= blue and 16 <= red - blue <= 130 and green - blue >= 0.3 * (red - blue))


def _with_mean(image: NDArray[np.floating], mean: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The image as bytes with the mean `mean` (3,), even where bright texels are clipped."""
    shift = mean - image.mean(axis=(0, 1))
    for _ in range(8):
        error = mean - np.clip(image + shift, 0, 255).mean(axis=(0, 1))
        shift = shift + error
        if np.abs(error).max() < 0.5:
            break
    return np.clip(image + shift, 0, 255).round().astype(np.uint8)


def _texture(image: NDArray[np.uint8], metres: Metres, *, is_whole: bool = False) -> Texture:
    image = np.ascontiguousarray(image)
    image.flags.writeable = False
    red, green, blue = image.mean(axis=(0, 1)).tolist()
    return Texture(image, metres, (red, green, blue), is_whole)
