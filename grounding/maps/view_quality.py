"""Places of a view's patches and the trust in each; pure functions of depth and pose.

The weights follow OneMap (distance) and VLFM (bearing), BASELINES.md sections 1 and 2.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.types import Camera, Frame

from .storeys import points_at

NEAR = 0.1
"""Nearer returns are the robot itself, metres."""
_SAMPLES = 6
"""Number of sampled pixels along each side of a patch."""
_EDGE, _EDGE_SHARE = 0.1, 0.05
"""A pixel shows the patch's surface when its depth is within this many metres plus this share of the median depth."""
_LEAST_PURE = 0.25
"""A patch with a smaller share on one surface is not used."""
_BEST_DISTANCE, _DISTANCE_SPREAD = 1.0, 1.5
"""OneMap's defaults, metres: most trusted at 1 m, 0.26 at 4 m."""
_EDGE_OF_VIEW = 0.25
"""VLFM's confidence at the left and right edge of a view; 1 in its middle."""


class Patches(NamedTuple):
    """The patches of one view, row by row."""

    points: NDArray[np.float64]
    """(h*w, 3) map point at each patch's median depth; nan for a patch without depth."""
    weights: NDArray[np.float64]
    """(h*w,) in [0, 1]; 0 where the patch is not used."""


def patches_of(frame: Frame, shape: tuple[int, int], *, max_depth: float) -> Patches:
    """Places and weights of the patches that tile a view evenly.

    A patch is placed at the pixel that has the median of its depths, so that it lies on a surface. It weighs more the
    nearer it is to 1 m, and the more of it shows that one surface.

    Args:
        shape: Rows and columns (h, w) of patches.
        max_depth: Farther returns count as none, planar metres.
    """
    pixels = patch_pixels(frame.camera, shape)  # (P, S, 2)
    depth = frame.depth_m[pixels[..., 0], pixels[..., 1]]
    is_valid = (depth >= NEAR) & (depth <= max_depth)
    known = np.where(is_valid, depth, np.float32(np.inf))
    order = np.argsort(known, axis=1)
    middle = order[np.arange(len(order)), np.maximum(is_valid.sum(axis=1) - 1, 0) // 2]
    chosen = np.arange(len(order)), middle
    median = known[chosen].astype(np.float64)
    with np.errstate(invalid="ignore"):
        is_surface = np.abs(known - median[:, None]) <= _EDGE + _EDGE_SHARE * median[:, None]
    purity = np.where(is_surface & is_valid, 1.0, 0.0).mean(axis=1)
    weights = np.where(purity >= _LEAST_PURE, purity * distance_weight(median), 0.0)
    points = points_at(frame, pixels[chosen])
    points[weights == 0] = np.nan
    return Patches(points, weights)


def patch_pixels(camera: Camera, shape: tuple[int, int]) -> NDArray[np.int64]:
    """(h*w, S, 2) row and column of pixels spread evenly over each of (h, w) patches."""
    sides = []
    for count, pixels in zip(shape, (camera.height, camera.width), strict=True):
        at = (np.arange(count * _SAMPLES) + 0.5) / _SAMPLES / count * pixels
        sides.append(np.floor(at).astype(np.int64).reshape(count, _SAMPLES))
    rows, cols = sides
    both = np.broadcast_arrays(rows[:, None, :, None], cols[None, :, None, :])
    return np.stack(both, axis=-1).reshape(shape[0] * shape[1], _SAMPLES * _SAMPLES, 2)


def distance_weight(depth_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N,) OneMap's trust in returns at these depths (N,); 1 at 1 m, .86 at 2 m, .26 at 4 m, 0 at inf."""
    return np.exp(-(((depth_m - _BEST_DISTANCE) / _DISTANCE_SPREAD) ** 2) / 3)


def bearing_weight(columns: NDArray[np.floating], camera: Camera) -> NDArray[np.float64]:
    """(N,) VLFM's trust in a whole view at these pixel columns (N,); 1 in the middle, .25 at the edges."""
    half = np.arctan(camera.width / 2 / camera.focal)
    share = np.arctan((columns - camera.width / 2) / camera.focal) / half
    return _EDGE_OF_VIEW + (1 - _EDGE_OF_VIEW) * np.cos(share * np.pi / 2) ** 2
