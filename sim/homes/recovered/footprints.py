"""Estimates width, depth and direction of a recorded object from the places that see it.

View points of the release are within REACH of the object's box, but never inside it: both facts bound its size.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

REACH = 1.0
"""Largest planar distance from a view point to the object's box (metres; GOAT's view points, DATA_FORMAT.md)."""
STANDING_ROOM = 1.0
"""Nobody stands below what is lower than this above the floor (metres): AGENT_HEIGHT in whole voxels of a navmesh."""
_LATTICE = 0.25
_LARGEST, SMALLEST = 1.6, 0.6
"""Largest and smallest factor by which the places may change the usual width and depth."""
_CLEAR = 0.25
"""Distance of a box from places (metres): the body in whole cells, and one cell that a map of the box loses."""
_BEHIND = 0.1
"""Largest distance of a recorded centre from a box that places pushed back behind it (metres)."""
_THINNEST = 0.08
_FARTHEST, _STEP = 0.8, 0.05
"""Largest distance of a box's middle from a recorded centre that somebody walked over, and the raster of such middles
(metres)."""
_TINY = 1e-6
_BESIDE = 0.3
_SIDES = (0.0, math.pi / 2, math.pi, -math.pi / 2)

Points = NDArray[np.float64]


def _shifts() -> Points:
    """Distances (S, 2) of middles from a recorded centre, the least first."""
    steps = np.arange(-_FARTHEST, _FARTHEST + _STEP / 2, _STEP)
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    away = np.round(np.hypot(*shifts.T), 6)
    order = np.argsort(away, kind="stable")
    return shifts[order[away[order] <= _FARTHEST]]


_SHIFTS = _shifts()


class Footprint(NamedTuple):
    """The area of an object on the floor plane, around its recorded centre.

    The record's centre of a built-in thing (a dishwasher, a wardrobe) lies on its front: the scan shows no more of it.
    """

    yaw: float
    """Turn about +y in radians, a multiple of 90 degrees; at 0 the front faces +z."""
    bounds: Points
    """(2, 2) its lowest and its highest x and z, from the recorded centre (metres)."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and depth in its own axes, metres."""
        x, z = (self.bounds[1] - self.bounds[0]).tolist()
        return (z, x) if abs(math.sin(self.yaw)) > 0.5 else (x, z)

    @property
    def middle(self) -> tuple[float, float]:
        """x and z of its middle, from the recorded centre (metres)."""
        x, z = self.bounds.mean(axis=0).tolist()
        return x, z


def fitted_footprint(
    offsets: Points, others: Points, *, usual: tuple[float, float], blocked: Points, is_thin: bool = False
) -> Footprint:
    """The footprint whose front faces the view points and that fits them best.

    Args:
        offsets: (V, 2) view points along x and z from the object's centre.
        others: (N, 2) the other known places near the object, in the same form.
        usual: Usual width and depth of such objects.
        blocked: (B, 2) places where a robot's centre must stay free, in the same form.
        is_thin: Whether it hangs on a wall, so that only its front counts and its depth stays as usual.
    """
    distance = np.linalg.norm(offsets, axis=1)
    middle = (offsets / np.maximum(distance, 1e-6)[:, None]).mean(axis=0) if len(offsets) else np.zeros(2)
    best = (-math.inf, Footprint(0.0, around(np.array(usual) / 2)))
    for yaw in _SIDES:
        is_sideways = yaw in (_SIDES[1], _SIDES[3])
        half = np.array(usual[::-1] if is_sideways else usual) / 2
        front = np.array([math.sin(yaw), math.cos(yaw)])
        misfit = _misfit(half, offsets) + 0.5 * _lost(half, blocked)
        score = round(float(front @ middle) - (0.0 if is_thin else 2.0 * misfit), 6)
        if score > best[0]:
            stretched = _stretched(half, offsets, others)
            if is_thin:
                depth_axis = 0 if is_sideways else 1
                stretched[depth_axis] = half[depth_axis]
            best = (score, Footprint(yaw, kept_clear(stretched, blocked, least=SMALLEST * 2 * half)))
    return best[1]


def around(half: Points) -> Points:
    """The bounds (2, 2) of a box with these half extents (2,) and its middle at the recorded centre."""
    return np.stack([-half, half])


def kept_clear(half: Points, blocked: Points, *, least: Points) -> Points:
    """The bounds (2, 2) of a box with half extents (2,), changed until it is _CLEAR away from the places (B, 2).

    The box stays in the middle if that leaves the `least` extents (2,). Otherwise only the sides move that places are
    on, at most _BEHIND past the recorded centre, and an opposite side moves outwards. If this does not help, a box with
    the least extents is drawn as near to the centre as it is clear; if there is none, it is cut to what is left.
    """
    free = _free(around(np.maximum(half, least + _BEHIND)), blocked, least=least)
    in_the_middle = np.minimum(half, np.minimum(-free[0], free[1]))
    if (2 * in_the_middle > least - _TINY).all():
        return around(in_the_middle)
    if (free[1] - free[0] < least - _TINY).any() or _is_near(free, blocked).any():
        meets = np.all(np.abs(blocked - _SHIFTS[:, None]) < least / 2 + _CLEAR, axis=2)
        is_clear = ~np.any(meets, axis=1)
        if is_clear.any():
            return _SHIFTS[is_clear.argmax()] + around(least / 2)
    low, high = np.clip(free, -half, half)
    return moved_into(free, middle=(low + high) / 2, size=np.maximum(high - low, least))


def moved_into(outer: Points, *, middle: Points, size: Points) -> Points:
    """The bounds (2, 2) of a box of this size (2,), cut to `outer` (2, 2), as near to the middle (2,) as it fits."""
    size = np.minimum(size, outer[1] - outer[0])
    return np.clip(middle, outer[0] + size / 2, outer[1] - size / 2) + around(size / 2)


def _free(bounds: Points, blocked: Points, *, least: Points) -> Points:
    """The bounds (2, 2) with sides moved inwards until every place (B, 2) is _CLEAR away, or less than _THINNEST is
    left. Of the sides that a place can move, it moves the one that leaves more.
    """
    near = blocked[_is_near(bounds, blocked)]
    for place in near[np.argsort(np.abs(near).max(axis=1), kind="stable")]:
        if not _is_near(bounds, place):
            continue
        gap, side = np.abs(place) - _CLEAR, (place > 0).astype(int)
        axes = np.flatnonzero(gap >= -_BEHIND)
        choices = []
        for axis in axes if len(axes) else (int(gap.argmax()),):
            sign, opposite = 2 * side[axis] - 1, bounds[1 - side[axis], axis]
            moved = max(gap[axis], -_BEHIND, sign * opposite + _THINNEST)
            choices.append(bounds.copy())
            choices[-1][side[axis], axis] = sign * min(sign * bounds[side[axis], axis], moved)
        sizes = [choice[1] - choice[0] for choice in choices]
        bounds = choices[int(np.argmax([min((size / least).min(), 1.0) + 0.1 * size.sum() for size in sizes]))]
    return bounds


def _is_near(bounds: Points, places: Points) -> NDArray[np.bool_]:
    """Whether the places (..., 2) are less than _CLEAR away from a box, along x and along z."""
    return np.asarray(((places > bounds[0] - _CLEAR) & (places < bounds[1] + _CLEAR)).all(axis=-1))


def in_the_way(places: Points, *, bottom: float, top: float) -> NDArray[np.bool_]:
    """Whether a robot's body at each place (N, 3) would meet a thing that reaches from `bottom` to `top`, (N,)."""
    return (places[:, 1] < top - 0.1) & (places[:, 1] + STANDING_ROOM > bottom)


def _misfit(half: Points, offsets: Points) -> float:
    """Mean distance in metres by which view points are too far from a box to see it; 0 without view points."""
    if not len(offsets):
        return 0.0
    outside = np.linalg.norm(np.maximum(np.abs(offsets) - half, 0), axis=1)
    return float(np.maximum(outside - REACH, 0).mean())


def _lost(half: Points, blocked: Points) -> float:
    """Share of the box that places take away."""
    bounds = kept_clear(half, blocked, least=SMALLEST * 2 * half)
    return 1 - float(np.prod(bounds[1] - bounds[0]) / np.prod(2 * half))


def _stretched(half: Points, offsets: Points, others: Points) -> Points:
    """Half extents (2,) that put view points beside the box within REACH, and other places beside it outside REACH."""
    found = half.copy()
    for axis in (0, 1):
        beside = np.abs(offsets[np.abs(offsets[:, 1 - axis]) <= max(_BESIDE, half[1 - axis]), axis])
        if not len(beside):
            continue
        reach = beside.max() - REACH
        along = np.abs(others[np.abs(others[:, 1 - axis]) <= _BESIDE, axis])
        if reach > half[axis]:
            found[axis] = min(reach + _LATTICE / 4, _LARGEST * half[axis])
        elif np.any((along > reach + REACH + _LATTICE) & (along < half[axis] + REACH)):
            found[axis] = max(SMALLEST * half[axis], reach + _LATTICE / 2)
    return found
