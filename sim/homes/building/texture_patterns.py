"""Patterns of two colours: where each shows; every pattern repeats without a seam and is known from 3 m away."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Pattern
from .texture_materials import Metres, Shape

Weights = NDArray[np.float64]
"""(h, w) share of the second colour, 0 to 1."""
_REPEATS = 4
"""Squares, dots and stripes along a side of the image."""
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
    """How much of the second colour each texel has; all 0 for `plain`.

    Args:
        pattern: Its kind.
        shape: Rows and columns of the image.
        metres: Width and height that the image covers.
        is_tiled: Whether squares must be as large as tiles.
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
    """1 where a distance from an outline (shares of the image, positive = inside) is inside, smooth over one texel."""
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
    """Flowers with a heart, and leaves beside them."""
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
    """Diamonds inside each other with a cross between."""
    at_y, at_x = y * 2 % 1 - 0.5, x * 2 % 1 - 0.5
    diamond = np.abs(at_x) + np.abs(at_y)
    rings = np.maximum(_inside(0.14 - diamond, 2 * texel), _inside(0.07 - np.abs(diamond - 0.33), 2 * texel))
    return np.maximum(rings, _inside(0.1 - np.abs(diamond - 0.88), 2 * texel) * 0.7)


_PATTERNS: dict[Pattern, Callable[[NDArray, NDArray, float], Weights]] = {
    "striped": _striped, "plaid": _plaid, "checked": _checked, "dotted": _dotted, "floral": _floral,
    "patterned": _patterned,
}  # fmt: skip
