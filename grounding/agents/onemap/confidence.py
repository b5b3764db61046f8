"""OneMap's observation confidence: how much a pixel's feature counts on the map.

Depth -> confidence of each pixel -> `projection`. Pixels about 1 m away count most, those at edges of depth little.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

BEST_DISTANCE, SPREAD = 1.0, 1.5
"""Confidence is exp(-((d - BEST_DISTANCE) / SPREAD)^2 / 3) at d metres (OneMap's code)."""
EDGE_GAIN = 0.2
"""Confidence is multiplied by 1 - tanh(EDGE_GAIN * gradient) at edges of depth (OneMap's code)."""
REACH = 5
"""Nearer things and edges spread this many pixels to each side: a window of 11 x 11 (OneMap's code)."""


def observation_confidence(
    depth_m: NDArray[np.float32], lens: tuple[float, float, float, float]
) -> NDArray[np.float32]:
    """(H, W) confidence in [0, 1] of the pixels of a view, 0 where there is no return.

    The gradient is that of the least depth around each pixel, per picture width and height in units of the focal
    lengths, as in OneMap's code. There, no return counts as the farthest depth of the picture.

    Args:
        depth_m: (H, W) planar metres, 0 = no return.
        lens: (fx, fy, cx, cy) pixels.
    """
    height, width = depth_m.shape
    is_seen = np.isfinite(depth_m) & (depth_m > 0)
    if not is_seen.any():
        return np.zeros(depth_m.shape, np.float32)
    depth = np.where(is_seen, depth_m, depth_m.max(where=is_seen, initial=0.0)).astype(np.float32)
    slope = _squared_slope(_spread(depth, np.minimum), np.float32(width / lens[0]), np.float32(height / lens[1]))
    steepest = np.sqrt(_spread(slope, np.maximum))
    away = (depth - np.float32(BEST_DISTANCE)) / np.float32(SPREAD)
    found = (1 - np.tanh(np.float32(EDGE_GAIN) * steepest)) * np.exp(away * away * np.float32(-1 / 3))
    return np.where(is_seen, found, np.float32(0))


def _spread(
    image: NDArray[np.float32], better: Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]
) -> NDArray[np.float32]:
    """(H, W) the best value in the window around each pixel, where `better` gives that of two."""
    window = 2 * REACH + 1
    wide = np.pad(image, REACH, mode="edge")
    for along_columns in (False, True):
        size = 1  # of the window that each pixel stands for
        while size < window:
            shift = min(size, window - size)
            size += shift
            wide = better(wide[:, :-shift], wide[:, shift:]) if along_columns else better(wide[:-shift], wide[shift:])
    return wide


@njit(cache=True, nogil=True)
def _squared_slope(image, right_scale, down_scale):
    """(H, W) squared length of the scaled gradient, by central differences, one-sided at the border (`np.gradient`)."""
    height, width = image.shape
    found = np.empty_like(image)
    half = np.float32(0.5)
    for r in range(height):
        above, below = max(r - 1, 0), min(r + 1, height - 1)
        down_share = down_scale / np.float32(below - above)
        for c in range(1, width - 1):
            down = (image[below, c] - image[above, c]) * down_share
            right = (image[r, c + 1] - image[r, c - 1]) * (half * right_scale)
            found[r, c] = down * down + right * right
        for c, before, after in ((0, 0, 1), (width - 1, width - 2, width - 1)):
            down = (image[below, c] - image[above, c]) * down_share
            right = (image[r, after] - image[r, before]) * right_scale
            found[r, c] = down * down + right * right
    return found
