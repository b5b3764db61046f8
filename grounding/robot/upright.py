"""Finds which way is up in a recording whose frame may be turned in any way, from its depth and its cameras' poses.

Depth + poses -> patches of surface -> axes to which many patches are square -> two readings of each -> the likeliest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import logsumexp

from sim.errors import SceneError
from sim.types import Frame

AXES = ("x", "-x", "y", "-y", "z", "-z")
"""Names of axes that `--up` takes besides `auto` and three numbers."""
CERTAIN = 0.95
"""Least confidence of a reading; with less, the user has to name the axis."""
_FARTHEST = 5.0
"""Depth beyond this is too noisy for normals, planar metres."""
_WIDTH = 320
"""Pictures are thinned to about this many columns; a patch is 1/64 of them wide."""
_CURVED = 0.012
"""A patch is flat if inverse depth across it bends by less than this share."""
_GRAZING = 0.15
"""Smallest cosine between a patch and the ray to it."""
_PATCH = 0.1
"""Patches nearer to each other than this (metres) and turned alike count once, however often they were seen."""
_MUCH = 40.0
"""Surfaces of less area (square metres) say less: a bed seen from near fills the view as a floor does."""
_FACING, _APART = np.cos(np.radians(8.0)), np.cos(np.radians(20.0))
"""A patch is square to an axis within the first angle; axes lie farther apart than the second."""
_MOST_AXES, _LEAST_SHARE = 6, 0.02
_LAYER = 0.05
"""Thickness of a layer of a height histogram, metres."""
_LEAST_DROP, _WIDE, _LEAST_FLOOR = 0.2, 0.15, 0.005
"""The floor is this far below the highest camera (metres), and has these shares of the widest layer and of all area."""
_SPHERE = 400
"""Number of directions at which up is imagined where no surface says so."""
_UNSEEN = -3.0
"""Log likelihood that no floor was seen."""


class Reading(NamedTuple):
    """One answer to which way is up."""

    up: NDArray[np.float64]
    """(3,) unit vector in the frames' own frame."""
    confidence: float
    """Probability among all readings, in [0, 1]."""


class _Surface(NamedTuple):
    """Patches of equal area."""

    points: NDArray[np.float64]
    """(N, 3) metres."""
    normals: NDArray[np.float64]
    """(N, 3) unit vectors towards the camera."""


def up_from_text(text: str) -> NDArray[np.float64] | None:
    """(3,) unit vector that a value of `--up` names: an axis, or `x,y,z`; None = `auto`.

    Raises:
        SceneError: The text is none of these.
    """
    if text == "auto":
        return None
    if text in AXES:
        return np.eye(3)["xyz".index(text[-1])] * (-1.0 if text[0] == "-" else 1.0)
    try:
        up = np.array([float(word) for word in text.split(",")])
    except ValueError:
        up = np.zeros(0)
    if up.shape != (3,) or not np.isfinite(up).all() or not np.linalg.norm(up) > 0:
        raise SceneError(
            f"--up is {text!r}; expected auto, one of {', '.join(AXES)}, or three numbers such as 0,-0.98,0.17. "
            "Correct it, or leave it out to find the axis from the depth."
        )
    return up / np.linalg.norm(up)


def T_map_recording(up: NDArray[np.floating]) -> NDArray[np.float64]:
    """(4, 4) smallest rotation that turns this direction (3,) of a recording to +y; about x where it is -y."""
    x, y, z = np.asarray(up, np.float64) / np.linalg.norm(up)
    T = np.eye(4)
    if y < -1 + 1e-12:
        T[1, 1] = T[2, 2] = -1.0
        return T
    T[:3, :3] = [
        [1 - x * x / (1 + y), -x, -x * z / (1 + y)],
        [x, y, z],
        [-x * z / (1 + y), -z, 1 - z * z / (1 + y)],
    ]
    return T


def find_up(frames: Sequence[Frame]) -> Reading:
    """Which way is up in these frames' own frame.

    Args:
        frames: Some views of a recording (40 to 60, spread over it) in one frame, turned in any way.

    Raises:
        SceneError: No reading is certain enough; the message names the two likeliest.
    """
    found = up_readings(frames)
    if found and found[0].confidence >= CERTAIN:
        return found[0]
    named = " or ".join(f"{_text(one.up)} (confidence {one.confidence:.2f})" for one in found[:2])
    raise SceneError(
        f"--up auto: {len(frames)} views show {named or 'no flat surface'}; expected one direction with a confidence "
        f"of {CERTAIN:g} or more. Name the axis that points up, e.g. --up {_text(found[0].up) if found else 'z'}."
    )


def up_readings(frames: Sequence[Frame]) -> list[Reading]:
    """All readings with their probabilities, the likeliest first; what is missing to 1 is that none of them is right.

    Each axis to which many flat patches are square gives two readings. A reading is likelier if the camera is held as
    people and robots do, turns about the axis and moves across it, and if a wide floor is below it with nothing under
    it, on which things stand. Where surfaces do not show the axis that fits the cameras best, all are less likely.
    """
    surface = _surface(frames)
    axes = _axes(surface)
    if not axes:
        return []
    Ts = np.array([frame.T_world_camera for frame in frames])
    ups = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    weight = np.clip(len(surface.points) * _PATCH**2 / _MUCH, 0.4, 1.0)
    scores = [_cameras_fit(Ts, up) + weight * _surfaces_fit(surface, Ts[:, :3, 3] @ up, up) for up in ups]
    elsewhere = [up for up in _directions(_SPHERE) if max(abs(up @ axis) for axis in axes) < np.cos(np.radians(30.0))]
    unseen = max((_cameras_fit(Ts, up) for up in elsewhere), default=-np.inf) + _UNSEEN
    shares = np.exp(np.array(scores) - logsumexp([*scores, unseen]))
    return [Reading(ups[index], float(shares[index])) for index in np.argsort(-shares)]


def _cameras_fit(Ts: NDArray[np.float64], up: NDArray[np.float64]) -> float:
    """Log likelihood of the cameras (N, 4, 4) if this is up, against cameras that are held in the usual way."""
    ups_camera = Ts[:, :3, :3].transpose(0, 2, 1) @ up
    mean = ups_camera.mean(axis=0)
    steadiness = np.linalg.norm(mean)
    x, y, z = mean / max(steadiness, 1e-9)
    tilt_deg, roll_deg = np.degrees(np.arcsin(np.clip(z, -1, 1))), np.degrees(np.arctan2(x, -y))
    rolls = sum(
        share * np.exp(-0.5 * (((roll_deg - usual + 180) % 360 - 180) / 15) ** 2)
        for usual, share in ((0, 0.75), (90, 0.12), (-90, 0.12), (180, 0.002))
    )
    turned_deg = np.degrees(np.sqrt(-2 * np.log(np.clip(steadiness, 1e-9, 1.0))))
    rise = float(np.std(Ts[:, :3, 3] @ up))
    return (
        float(np.log(rolls + 0.002))
        + _bell((tilt_deg + 15) / 25, least=-4)
        + _bell(turned_deg / 20, least=-5)
        + _bell(rise / 0.25, least=-2)
    )


def _surfaces_fit(surface: _Surface, eyes: NDArray[np.float64], up: NDArray[np.float64]) -> float:
    """Log likelihood of the surfaces if this is up, against a home seen from its rooms.

    Args:
        eyes: (M,) heights of the cameras.
    """
    heights, facing = surface.points @ up, surface.normals @ up
    is_above, is_under = facing > _FACING, facing < -_FACING  # as seen: floors and table tops, ceilings
    low = heights.min() - _LAYER
    layer = ((heights - low) / _LAYER).astype(np.int64)
    levels = np.bincount(layer[is_above | is_under]) / (is_above | is_under).sum()
    sharp = max(float(np.log(2 * (levels**2).sum())), -3.0)
    counts = np.bincount(layer[is_above], minlength=layer.max() + 2)
    wide = ndimage.convolve1d(counts, np.ones(3, np.int64), mode="constant")
    middles = low + (np.arange(len(wide)) + 0.5) * _LAYER
    wide[middles > eyes.max() - _LEAST_DROP] = 0
    if wide.max() < _LEAST_FLOOR * len(heights):
        return sharp + _UNSEEN
    floors = np.flatnonzero(wide >= _WIDE * wide.max())
    lowest = int(floors[0] + wide[floors[0] : floors[0] + 3].argmax())
    under = np.where(middles[floors] < eyes[:, None] - _LEAST_DROP, middles[floors], middles[lowest])
    drop = float(np.median(eyes - under.max(axis=1)))
    is_higher = heights > middles[lowest] + 0.15
    ceiling = np.quantile(heights[is_under], 0.98) if is_under.any() else np.inf
    standing, hanging = (is_above & is_higher).mean(), (is_under & is_higher & (heights < ceiling - 0.3)).mean()
    return (
        sharp
        + float(np.clip(np.log(10 * wide[lowest] / len(heights)), _UNSEEN, 1))
        + _bell(max(drop - 1.7, 0.3 - drop, 0) / 0.3, least=-4)
        + max(-float((heights < middles[lowest] - 0.15).mean()) / 0.03, -4.0)
        + float(np.clip(np.log((standing + 0.003) / (hanging + 0.003)), -2, 2))
    )


def _bell(off: float, *, least: float) -> float:
    """Log of a bell curve so many standard deviations off, at least `least`: one odd fact must not decide alone."""
    return max(-0.5 * float(off) ** 2, least)


def _surface(frames: Sequence[Frame]) -> _Surface:
    """The flat patches that the views show."""
    parts = [_patches(frame) for frame in frames]
    points, normals = (np.concatenate([part[index] for part in parts]) for index in (0, 1))
    cells = np.column_stack([np.floor(points / _PATCH), np.round(1.5 * normals)]).astype(np.int64)
    if not len(cells):
        return _Surface(points, normals)
    cells -= cells.min(axis=0)
    flat = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, of_cell, counts = np.unique(flat, return_inverse=True, return_counts=True)
    points, normals = (
        np.column_stack([np.bincount(of_cell, column) for column in values.T]) / counts[:, None]
        for values in (points, normals)
    )
    return _Surface(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _patches(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (N, 3) and normals (N, 3) of the flat patches of one view, in the frame of its pose.

    Inverse depth is linear across a plane: 1/z = n . (x, y, 1) for rays (x, y, 1), so its slopes give the normal n.
    """
    thin = max(1, round(frame.camera.width / _WIDTH))
    depth = frame.depth_m[::thin, ::thin].astype(np.float64)
    height, width = depth.shape
    reach = max(2, width // 64)
    if min(height, width) <= 2 * reach:
        return np.zeros((0, 3)), np.zeros((0, 3))
    is_known = (depth > 0) & (depth <= _FARTHEST)
    inverse = ndimage.uniform_filter(np.where(is_known, 1 / np.where(is_known, depth, 1), 0), reach)
    inverse[ndimage.minimum_filter(is_known, reach) == 0] = np.nan
    rows, cols = np.mgrid[reach : height - reach : 4, reach : width - reach : 4].reshape(2, -1)
    middle, left, right = (inverse[rows, cols + shift] for shift in (0, -reach, reach))
    above, below = inverse[rows - reach, cols], inverse[rows + reach, cols]
    fx, fy, cx, cy = (value / thin for value in frame.camera.lens)
    x, y = (cols + 0.5 / thin - cx) / fx, (rows + 0.5 / thin - cy) / fy
    slope_x, slope_y = (right - left) / (2 * reach) * fx, (below - above) / (2 * reach) * fy
    normals = -np.column_stack([slope_x, slope_y, middle - slope_x * x - slope_y * y])
    rays = np.column_stack([x, y, np.ones_like(x)])
    lengths = np.linalg.norm(normals, axis=1)
    is_flat = np.maximum(abs(left + right - 2 * middle), abs(above + below - 2 * middle)) < _CURVED * middle
    is_flat &= middle > _GRAZING * lengths * np.linalg.norm(rays, axis=1)
    R, t = frame.T_world_camera[:3, :3], frame.T_world_camera[:3, 3]
    points_camera = rays[is_flat] / middle[is_flat, None]
    return points_camera @ R.T + t, (normals[is_flat] / lengths[is_flat, None]) @ R.T


def _axes(surface: _Surface) -> list[NDArray[np.float64]]:
    """Unit vectors (3,) to which many patches are square, the most frequent first; signs mean nothing."""
    axes: list[NDArray[np.float64]] = []
    normals = surface.normals
    left = np.ones(len(normals), bool)
    while len(axes) < _MOST_AXES and left.sum() > _LEAST_SHARE * len(normals):
        rest = normals[left]
        tried = rest[:: max(1, len(rest) // 300)]
        counts = (np.abs(rest @ tried.T) > _FACING).sum(axis=0)
        if counts.max() < _LEAST_SHARE * len(normals):
            break
        axis = tried[counts.argmax()]
        for _ in range(3):
            near = normals[np.abs(normals @ axis) > _FACING]
            axis = np.linalg.eigh(near.T @ near)[1][:, -1]
        axes.append(_squared(axis, surface))
        left &= np.abs(normals @ axis) < _APART
    return axes


def _squared(axis: NDArray[np.float64], surface: _Surface) -> NDArray[np.float64]:
    """The axis to which layers of patches are square: least squares over the points of all full layers together."""
    first = axis
    for thickness in (_LAYER, _LAYER, _LAYER / 2, _LAYER / 4):
        points = surface.points[np.abs(surface.normals @ axis) > _FACING]
        heights = points @ axis
        layer = ((heights - heights.min()) / _LAYER).astype(np.int64)
        counts = np.bincount(layer)
        is_peak = (counts == ndimage.maximum_filter1d(counts, 3)) & (counts > max(5, 0.05 * counts.max()))
        scatter = np.zeros((3, 3))
        for peak in np.flatnonzero(is_peak):
            middle = np.median(heights[np.abs(layer - peak) <= 1])
            of_layer = points[np.abs(heights - middle) < thickness]
            if len(of_layer) > 2:  # a median between two sheets may have nothing near it
                off = of_layer - of_layer.mean(axis=0)
                scatter += off.T @ off
        found = np.linalg.eigh(scatter)[1][:, 0]
        if abs(found @ first) < _FACING:
            return axis
        axis = found * np.sign(found @ axis)
    return axis


def _directions(count: int) -> NDArray[np.float64]:
    """(N, 3) unit vectors spread evenly over the sphere (Fibonacci's lattice)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    around = np.sqrt(1 - z * z)
    return np.column_stack([around * np.cos(angle), around * np.sin(angle), z])


def _text(up: NDArray[np.float64]) -> str:
    """The direction as `--up` takes it: an axis's name where it is within a degree, else three numbers."""
    largest = int(np.abs(up).argmax())
    if abs(up[largest]) > np.cos(np.radians(1.0)):
        return f"{'-' if up[largest] < 0 else ''}{'xyz'[largest]}"
    return ",".join(f"{value:.3f}" for value in up + 0.0)
