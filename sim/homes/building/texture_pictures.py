"""Paintings for picture frames: a landscape, a portrait or an abstract painting in the colours of the finish."""

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Rgb
from .texture_materials import noise

_SIDE = 128
_SKIN = np.array([214.0, 170.0, 140.0])
_INK = np.array([40.0, 36.0, 40.0])

_Image = NDArray[np.float64]


def painted(rgb: Rgb, rgb2: Rgb, *, seed: int) -> NDArray[np.uint8]:
    """A painting (h, w, 3); the same colours and seed give the same one.

    Args:
        rgb: Its main colour.
        rgb2: Its other colour.
        seed: Chooses the motif, and where things are.
    """
    rng = np.random.default_rng(seed)
    paint = (_landscape, _portrait, _abstract)[seed % 3]
    image = paint(rng, np.array(rgb, float), np.array(rgb2, float))
    strokes = noise(rng, (_SIDE, _SIDE), (1.0, 3.0))[..., None]
    return np.clip(image * (1 + 0.03 * strokes), 0, 255).round().astype(np.uint8)


def _grid() -> tuple[_Image, _Image]:
    """Coordinates (h, w) from 0 to 1, down and across."""
    at = (np.arange(_SIDE) + 0.5) / _SIDE
    return at[:, None] * np.ones((_SIDE, _SIDE)), at[None] * np.ones((_SIDE, _SIDE))


def _over(image: _Image, distance: _Image, colour: _Image, opacity: float = 1.0) -> _Image:
    """The image with a colour laid over where the distance (shares of a side) is positive."""
    share = opacity * np.clip(distance * _SIDE + 0.5, 0, 1)[..., None]
    return image + share * (colour - image)


def _towards(colour: _Image, other: float, share: float) -> _Image:
    return colour + share * (other - colour)


def _landscape(rng: np.random.Generator, rgb: _Image, rgb2: _Image) -> _Image:
    """Sky with a sun, two ranges of hills, and land."""
    y, x = _grid()
    sky = _towards(rgb, 255, 0.62)
    image = sky + (_towards(rgb, 255, 0.25) - sky) * np.clip(1 - 1.6 * y, 0, 1)[..., None]
    sun_x, sun_y = rng.uniform(0.2, 0.8), rng.uniform(0.14, 0.26)
    image = _over(image, 0.075 - np.hypot(x - sun_x, y - sun_y), np.array([252.0, 232.0, 170.0]))
    for level, shade in ((0.42, 0.15), (0.56, -0.25)):
        phase, waves = rng.uniform(0, 6.3, 3), rng.uniform(0.5, 1.6, 3)
        ridge = level + sum(
            0.05 * np.sin(2 * np.pi * w * x * (k + 1) + p) / (k + 1)
            for k, (w, p) in enumerate(zip(waves, phase, strict=True))
        )
        colour = _towards(rgb, 255, shade) if shade > 0 else rgb * (1 + shade)
        image = _over(image, y - ridge, colour)
    image = _over(image, y - 0.72 - 0.04 * np.sin(5 * x + rng.uniform(0, 6)), rgb2)
    for _ in range(4):  # trees
        at, low, size = rng.uniform(0.08, 0.92), rng.uniform(0.74, 0.92), rng.uniform(0.05, 0.09)
        image = _over(image, 0.008 - np.maximum(np.abs(x - at), np.abs(y - low) - size), rgb2 * 0.4)
        image = _over(image, size - np.hypot(x - at, (y - low + 1.5 * size) * 0.8), rgb2 * 0.6)
    return image


def _portrait(rng: np.random.Generator, rgb: _Image, rgb2: _Image) -> _Image:
    """Head and shoulders before a plain background."""
    y, x = _grid()
    image = rgb * (1.1 - 0.45 * np.hypot(x - 0.5, y - 0.4))[..., None]
    middle = 0.5 + rng.uniform(-0.05, 0.05)
    hair = rng.uniform(0.25, 0.8) * np.array([150.0, 100.0, 60.0])
    image = _over(image, 1 - np.hypot((x - middle) / 0.22, (y - 0.42) / 0.30), hair)
    image = _over(image, 1 - np.hypot((x - middle) / 0.42, (y - 1.08) / 0.40), rgb2)
    image = _over(image, 0.07 - np.maximum(np.abs(x - middle), np.abs(y - 0.66)), _SKIN * 0.86)
    image = _over(image, 1 - np.hypot((x - middle) / 0.155, (y - 0.44) / 0.21), _SKIN)
    for side in (-1, 1):
        image = _over(image, 0.018 - np.hypot(x - middle - side * 0.06, (y - 0.42) * 1.4), _INK)
    image = _over(image, 0.012 - np.maximum(np.abs(x - middle) - 0.035, np.abs(y - 0.55)), np.array([168.0, 80, 76]))
    return _over(image, 1 - np.hypot((x - middle) / 0.17, (y - 0.27) / 0.085), hair)


def _abstract(rng: np.random.Generator, rgb: _Image, rgb2: _Image) -> _Image:
    """Discs, blocks and lines over each other."""
    y, x = _grid()
    image = np.broadcast_to(_towards(rgb, 255, 0.45), (_SIDE, _SIDE, 3))
    colours = (rgb, rgb2, rgb * 0.55, _towards(rgb2, 255, 0.35), np.roll(rgb, 1), _INK)
    for index in range(9):
        cx, cy = rng.uniform(0.1, 0.9, 2)
        size, angle = rng.uniform(0.1, 0.27), rng.uniform(0, np.pi)
        along, beside = (
            np.cos(angle) * (x - cx) + np.sin(angle) * (y - cy),
            np.cos(angle) * (y - cy) - np.sin(angle) * (x - cx),
        )
        disc = size - np.hypot(along, beside)
        block = size - np.maximum(np.abs(along), 1.7 * np.abs(beside))
        line = 0.012 - np.abs(beside)
        image = _over(image, (disc, block, line)[index % 3], colours[index % len(colours)], 0.88)
    return image
