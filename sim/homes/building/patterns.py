"""Patterns of finishes, and paintings for picture frames: a landscape, a portrait or an abstract painting."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Pattern, Rgb
from .materials import Metres, Shape, noise

Weights = NDArray[np.float64]
"""(h, w) share of the second colour, 0 to 1."""
_REPEATS = 4
"""Number of squares, dots or stripes along a side of the image."""
_TILE = 0.3
_FLOWERS = (
    # middle as a share of the image, radius as well, petals, turn
    (0.20, 0.22, 0.150, 5, 0.3),
    (0.70, 0.14, 0.115, 6, 1.0),
    (0.52, 0.55, 0.160, 5, 2.0),
    (0.10, 0.68, 0.110, 6, 0.6),
    (0.86, 0.52, 0.125, 5, 1.7),
    (0.34, 0.88, 0.125, 5, 0.1),
    (0.76, 0.84, 0.140, 6, 2.6),
)


@lru_cache(maxsize=64)
def pattern_weights(pattern: Pattern, shape: Shape, metres: Metres, *, is_tiled: bool = False) -> Weights:
    """The share of the second colour in each texel of an image of this shape; all 0 for `plain`.

    The image covers `metres` (width, height); where `is_tiled`, squares are as large as the tiles.
    """
    y, x = ((np.arange(count) + 0.5) / count for count in shape)
    if is_tiled and pattern == "checked":
        counts = (round(length / _TILE / 2) * 2 for length in metres)
        across, down = (max(2, count) for count in counts)
        weights = (np.floor(y * down)[:, None] + np.floor(x * across)[None]) % 2
    elif pattern in _PATTERNS:
        weights = _PATTERNS[pattern](y[:, None] * np.ones(shape), x[None] * np.ones(shape), 1 / shape[1])
    else:
        weights = np.zeros(shape)
    weights.flags.writeable = False
    return weights


def _inside(distance: NDArray[np.float64], texel: float) -> Weights:
    """1 inside an outline, by distances from it (shares of the image, positive = inside), smooth over one texel."""
    return np.clip(distance / texel + 0.5, 0, 1)


def _band(at: NDArray[np.float64], middle: float, width: float, texel: float) -> Weights:
    """1 in a band of coordinates that repeat after 1."""
    away = np.abs((at - middle + 0.5) % 1 - 0.5)
    return _inside(width / 2 - away, texel)


def _striped(y: NDArray, x: NDArray, texel: float) -> Weights:
    """Wide and narrow stripes along v."""
    at = x * _REPEATS % 1
    return np.maximum(_band(at, 0.3, 0.42, texel * _REPEATS), _band(at, 0.76, 0.1, texel * _REPEATS))


def _plaid(y: NDArray, x: NDArray, texel: float) -> Weights:
    """Two sets of bands whose colours mix where they cross, with thin lines between."""

    def bands(at: NDArray) -> Weights:
        at = at * 2 % 1
        wide = _band(at, 0.25, 0.36, 2 * texel)
        thin = np.maximum(_band(at, 0.66, 0.045, 2 * texel), _band(at, 0.84, 0.045, 2 * texel))
        return np.maximum(wide, thin)

    return 0.5 * bands(x) + 0.5 * bands(y)


def _checked(y: NDArray, x: NDArray, texel: float) -> Weights:
    count = 2 * _REPEATS
    return (np.floor(y * count) + np.floor(x * count)) % 2


def _dotted(y: NDArray, x: NDArray, texel: float) -> Weights:
    """Rows of dots, every second row shifted."""
    distances = []
    for shift in (0.0, 0.5):
        dy, dx = (y * _REPEATS + shift) % 1 - 0.5, (x * _REPEATS + shift) % 1 - 0.5
        distances.append((0.25 - np.hypot(dx, dy)) / _REPEATS)
    return _inside(np.maximum(*distances), texel)


def _floral(y: NDArray, x: NDArray, texel: float) -> Weights:
    """Flowers with a pale centre, and leaves beside them."""
    weights = np.zeros_like(y)
    for cx, cy, radius, petals, turn in _FLOWERS:
        dy, dx = (y - cy + 0.5) % 1 - 0.5, (x - cx + 0.5) % 1 - 0.5
        away, angle = np.hypot(dx, dy), np.arctan2(dy, dx) + turn
        leaf_along, leaf_beside = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
        along = (np.abs(leaf_along) / radius - 1.0) / 0.45
        leaf = _inside(radius * (0.16 * (1 - along**2) - np.abs(leaf_beside) / radius), texel)
        weights = np.maximum(weights, 0.5 * leaf)
        petal = _inside(radius * (0.66 + 0.34 * np.cos(petals * angle)) - away, texel)
        weights = weights + petal * (1 - weights)
        between = 0.3 * petal * (away > 0.34 * radius) * (np.cos(petals * angle) < -0.35)
        heart = _inside(0.24 * radius - away, texel)
        weights = np.clip(weights - between - 0.85 * heart * weights, 0, 1)
    return weights


def _patterned(y: NDArray, x: NDArray, texel: float) -> Weights:
    """Nested diamonds with crosses between them."""
    at_y, at_x = y * 2 % 1 - 0.5, x * 2 % 1 - 0.5
    diamond = np.abs(at_x) + np.abs(at_y)
    rings = np.maximum(_inside(0.14 - diamond, 2 * texel), _inside(0.07 - np.abs(diamond - 0.33), 2 * texel))
    return np.maximum(rings, _inside(0.1 - np.abs(diamond - 0.88), 2 * texel) * 0.7)


_PATTERNS: dict[Pattern, Callable[[NDArray, NDArray, float], Weights]] = {
    "striped": _striped, "plaid": _plaid, "checked": _checked, "dotted": _dotted, "floral": _floral,
    "patterned": _patterned,
}  # fmt: skip


_SIDE = 128
_SKIN = np.array([214.0, 170.0, 140.0])
_INK = np.array([40.0, 36.0, 40.0])

_Image = NDArray[np.float64]


def painted(rgb: Rgb, rgb2: Rgb, *, seed: int) -> NDArray[np.uint8]:
    """A painting (h, w, 3), mainly of `rgb`; equal colours and seeds give equal paintings.

    The seed chooses the motif and the places of things in it.
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
