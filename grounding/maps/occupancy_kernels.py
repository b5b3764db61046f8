"""Compiled loops over the pixels of a depth picture: which floor cells it shows as free, and which as blocked.

Coordinates are grid units as in sim/walk/grid_kernels.py: u = columns, v = rows; heights are metres above the floor.
"""

import math

import numpy as np

from sim.compiled import njit

FREE_HIT, BLOCKED_HIT = 1, 16
"""Hits that `mark` stores in a cell's byte: a flag for free, and a count of blocked hits up to 15 in the upper bits."""
_LEAST_BLOCKED = 2
"""Least number of points above a cell that block it; a single one may be noise."""
_MOST_BLOCKED = 240
_KNOWN_MOST = 12
_BENT, _ALIKE, _LEAST_ALIKE = 0.03, 0.03, 9
"""A sensor's pixel mixes two surfaces if inverse depth bends by this share near it; it is doubtful if fewer of the 25
pixels around it and itself have the same depth within this share."""
_BLOCKED_GAIN = 4
"""Votes that one view gives a blocked cell; as many clear views, and at most _KNOWN_MOST, make it free again."""


@njit(cache=True, nogil=True)
def without_mixed(depth, step):
    """Depth (H, W) for `mark` of a sensor's depth (H, W; metres, 0 = no return), whose edges mix two surfaces.

    Across a plane, inverse depth is linear: where it bends, and up to `step` pixels beside, nothing is measured. A
    pixel that few pixels around it resemble is negative: noise, or a floor seen at a flat angle. Pixels that are
    compared are `step` apart.
    """
    height, width = depth.shape
    out = np.where(depth > 0, depth, np.float32(np.nan))
    for r in range(height):
        for c in range(width):
            here = depth[r, c]
            if not here > 0:
                continue
            alike = 0
            for i in range(-2, 3):
                for j in range(-2, 3):
                    y, x = r + i * step, c + j * step
                    if 0 <= y < height and 0 <= x < width and abs(depth[y, x] - here) < _ALIKE * here:
                        alike += 1
            if alike < _LEAST_ALIKE:
                out[r, c] = -abs(out[r, c])  # nan stays nan
            if _is_bent(depth, r, c, 2 * step, 0) or _is_bent(depth, r, c, 0, 2 * step):
                for y in range(max(r - step, 0), min(r + step + 1, height)):
                    for x in range(max(c - step, 0), min(c + step + 1, width)):
                        out[y, x] = np.nan
    return out


@njit(cache=True, nogil=True)
def _is_bent(depth, r, c, down, right):
    """Whether inverse depth bends at a pixel, between the pixels this far to both sides."""
    height, width = depth.shape
    if r < down or c < right or r + down >= height or c + right >= width:
        return False
    before, here, after = depth[r - down, c - right], depth[r, c], depth[r + down, c + right]
    return before > 0 and after > 0 and abs(here / before + here / after - 2.0) > _BENT


@njit(cache=True, nogil=True)
def mark(depth, R, u0, v0, y0, focal, scale, band, max_depth, hits):
    """Counts hits (rows, cols) uint8 of one view; returns the box (row0, row1, col0, col1) that they lie in.

    Args:
        depth: (H, W) planar metres, 0 = no return, nan = not measured, which says nothing; negative = as far, but
            doubtful, which can show floor and blocks nothing.
        R: (3, 3) camera (OpenCV axes) in the map.
        u0: Camera's column on the grid, with fraction.
        v0: The camera's row.
        y0: The camera's height above the floor, metres.
        focal: (fx, fy, cx, cy) pixels.
        scale: Cells per metre.
        band: (lowest floor, highest floor, highest obstacle) metres.
        max_depth: Metres; farther returns count as not seen.
        hits: Filled here; must be zero outside the boxes that earlier calls returned.
    """
    fx, fy, cx, cy = focal
    low, high, top = band
    height, width = depth.shape
    rows, cols = hits.shape
    box = np.array([rows, -1, cols, -1])
    below_u, below_v = np.full(width, np.nan), np.full(width, np.nan)
    right = (np.arange(width) + 0.5 - cx) / fx
    right_u, right_y, right_v = R[0, 0] * right, R[1, 0] * right, R[2, 0] * right
    for r in range(height - 1, -1, -1):
        down = (r + 0.5 - cy) / fy
        left_u, left_v = np.nan, np.nan
        for c in range(width):
            along_u = (right_u[c] + R[0, 1] * down + R[0, 2]) * scale
            along_y = right_y[c] + R[1, 1] * down + R[1, 2]
            along_v = (right_v[c] + R[2, 1] * down + R[2, 2]) * scale
            found = depth[r, c]
            if math.isnan(found):
                below_u[c], below_v[c], left_u, left_v = np.nan, np.nan, np.nan, np.nan
                continue
            is_doubtful = found < 0
            found = abs(found)
            reach = found if 0 < found <= max_depth else max_depth
            y = y0 + reach * along_y
            u, v = u0 + reach * along_u, v0 + reach * along_v
            is_floor = reach == found and low <= y <= high
            if is_doubtful and not is_floor:
                below_u[c], below_v[c], left_u, left_v = np.nan, np.nan, np.nan, np.nan
                continue
            if y < low and y0 > low:
                share = (low - y0) / along_y
                _put(hits, box, v0 + share * along_v, u0 + share * along_u, BLOCKED_HIT)
            if is_floor:
                _put(hits, box, v, u, FREE_HIT)
                _fill(hits, box, below_v[c], below_u[c], v, u)
                _fill(hits, box, left_v, left_u, v, u)
                below_u[c], below_v[c], left_u, left_v = u, v, u, v
            else:
                below_u[c], below_v[c], left_u, left_v = np.nan, np.nan, np.nan, np.nan
                if reach == found and high < y <= top:
                    _put(hits, box, v, u, BLOCKED_HIT)
    return box


@njit(cache=True, nogil=True)
def _put(hits, box, v, u, what):
    """Adds one hit if (v, u) is on the grid."""
    r, c = math.floor(v), math.floor(u)
    if r < 0 or c < 0 or r >= hits.shape[0] or c >= hits.shape[1]:
        return
    if hits[r, c] == 0:
        box[0], box[1] = min(box[0], r), max(box[1], r)
        box[2], box[3] = min(box[2], c), max(box[3], c)
    if what == FREE_HIT:
        hits[r, c] |= FREE_HIT
    elif hits[r, c] < _MOST_BLOCKED:
        hits[r, c] += BLOCKED_HIT


@njit(cache=True, nogil=True)
def _fill(hits, box, from_v, from_u, v, u):
    """Adds free hits between two neighbouring pixels that both show the floor; none if the first is nan."""
    gap = max(abs(v - from_v), abs(u - from_u))
    if not gap > 1.0:
        return
    count = math.ceil(gap)
    for k in range(1, count):
        share = k / count
        _put(hits, box, from_v + share * (v - from_v), from_u + share * (u - from_u), FREE_HIT)


@njit(cache=True, nogil=True)
def vote(hits, box, votes):
    """Adds a view's hits in its box to the votes (rows, cols) int8 of all views, and clears them; blocked wins."""
    for r in range(box[0], box[1] + 1):
        for c in range(box[2], box[3] + 1):
            hit = hits[r, c]
            if hit == 0:
                continue
            hits[r, c] = 0
            before = votes[r, c]
            if hit // BLOCKED_HIT >= _LEAST_BLOCKED:
                votes[r, c] = min(max(before, 0) + _BLOCKED_GAIN, _KNOWN_MOST)
            elif hit % BLOCKED_HIT:
                votes[r, c] = -1 if before in (0, 1) else max(before - 1, -_KNOWN_MOST)
