"""Estimates width, depth and direction of a recorded object from the places that see it.

View points of the release are within REACH of the object's box, but never inside it: both facts bound its size.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.types import CAMERA_HEIGHT

REACH = 1.0
"""Largest planar distance from a view point to the object's box (metres; GOAT's view points, DATA_FORMAT.md)."""
_LATTICE = 0.25
_LARGEST, _SMALLEST = 1.6, 0.6
"""Largest and smallest factor by which the places may change the usual width and depth."""
_CLEAR = 0.25
"""Distance of a box from places (metres): the body in whole cells, and one cell that a map of the box loses."""
_THINNEST = 0.04
_BESIDE = 0.3
_SIDES = (0.0, math.pi / 2, math.pi, -math.pi / 2)

Points = NDArray[np.float64]


class Footprint(NamedTuple):
    """The area of an object on the floor plane, around its recorded centre."""

    yaw: float
    """Turn about +y in radians, a multiple of 90 degrees; at 0 the front faces +z."""
    width: float
    depth: float


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
    best = (-math.inf, Footprint(0.0, *usual))
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
            x, z = (2 * clipped(stretched, blocked)).tolist()
            best = (score, Footprint(yaw, z, x) if is_sideways else Footprint(yaw, x, z))
    return best[1]


def clipped(half: Points, blocked: Points) -> Points:
    """The half extents (2,), shrunk until every place (B, 2) is _CLEAR away from the box, if it can be so thin."""
    half = half.copy()
    away = np.abs(blocked)
    away = away[(away < half + _CLEAR).all(axis=1)]
    for point in away[np.argsort(away.max(axis=1), kind="stable")]:
        if (point < half + _CLEAR).all():
            axes = np.flatnonzero(point - _CLEAR >= _THINNEST)
            choices = []
            for axis in axes if len(axes) else (0, 1):
                choices.append(half.copy())
                choices[-1][axis] = min(half[axis], max(_THINNEST, point[axis] - _CLEAR))
            half = max(choices, key=lambda choice: float(min(choice) + 0.1 * choice.sum()))
    return half


def in_the_way(places: Points, *, bottom: float, top: float) -> NDArray[np.bool_]:
    """Whether a robot's body at each place (N, 3) would meet a thing that reaches from `bottom` to `top`, (N,)."""
    return (places[:, 1] < top - 0.1) & (places[:, 1] + CAMERA_HEIGHT > bottom)


def _misfit(half: Points, offsets: Points) -> float:
    """Mean distance in metres by which view points are too far from a box to see it; 0 without view points."""
    if not len(offsets):
        return 0.0
    outside = np.linalg.norm(np.maximum(np.abs(offsets) - half, 0), axis=1)
    return float(np.maximum(outside - REACH, 0).mean())


def _lost(half: Points, blocked: Points) -> float:
    """Share of the box that places take away."""
    return 1 - float(np.prod(clipped(half, blocked)) / np.prod(half))


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
            found[axis] = max(_SMALLEST * half[axis], reach + _LATTICE / 2)
    return found
