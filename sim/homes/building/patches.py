"""Cuts quads into patches, small enough for light that is known only at their corners; between quads.py and light.py.

Parts of the house are cut along the lines of a lattice that is the same for all quads in a plane. Light is sampled at
the lattice and blended between its points, so that neighbours agree along their whole edge and no seam shows. Objects
are cut evenly, each quad by itself, and sampled at the patches' corners.
"""

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...mesh import FLAT, TriangleMesh
from ...scans.equal_rows import numbered

FLOOR_STEP = 0.125
"""Distance of lattice lines on floors, where furniture casts shadows (metres)."""
WALL_STEP = 0.375
"""Distance of lattice lines on other surfaces (metres)."""
_OBJECT_STEP = 0.4
"""Quads of objects are cut into parts of at most this length (metres)."""
_INSET = 0.02
"""Distance from a quad's edge at which light is sampled, so that things that touch the quad do not hide it (metres)."""
_THIN = 0.12
"""Quads of objects narrower than this have the same light across their width (metres)."""
_ALIGNED = 1e-5
"""Edges that deviate from an axis by at most this are parallel to it (metres)."""
_SAME_PLANE = 1e-3
_ONE = np.int64(1) << 20
_Number = TypeVar("_Number", bound=np.generic)


class Quads(NamedTuple):
    """All quads of a home."""

    corners: NDArray[np.float64]
    """(Q, 4, 3) metres, counter-clockwise from their front."""
    normals: NDArray[np.float64]
    """(Q, 4, 3) unit vectors."""
    instance: NDArray[np.int32]
    """(Q,) object id, 0 = part of the house."""


class Patches(NamedTuple):
    """Parts of quads, and the places where their light is sampled."""

    quad: NDArray[np.int64]
    """(P,) index of the quad of each patch."""
    shares: NDArray[np.float64]
    """(P, 4, 2) place of the patch's corners along the first and the second edge of its quad, 0 to 1."""
    corners: NDArray[np.float64]
    """(P, 4, 3) metres."""
    sample: NDArray[np.int64]
    """(P, 4) samples that the patch's light is blended from."""
    weights: NDArray[np.float64]
    """(P, 4, 4) share of each sample (last axis) in each corner."""
    points: NDArray[np.float64]
    """(S, 3) places of the samples."""
    normals: NDArray[np.float64]
    """(S, 3) directions in which the samples look."""

    def interpolated(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (S, K) of samples at the corners of patches, (P, 4, K)."""
        return np.einsum("pcs,psk->pck", self.weights, values[self.sample])

    def blended(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (Q, 4, K) of quads' corners at the corners of patches, (P, 4, K)."""
        return _bilinear(values[self.quad], self.shares)


class _Part(NamedTuple):
    """Patches of some of the quads, before equal samples are joined."""

    quad: NDArray[np.int64]
    shares: NDArray[np.float64]
    corners: NDArray[np.float64]
    weights: NDArray[np.float64]
    points: NDArray[np.float64]
    """(P, 4, 3) places, one per sample of a patch."""
    normals: NDArray[np.float64]


def patches_of(quads: Quads) -> Patches:
    """The patches of quads, those of the house first; the same quads give the same patches."""
    in_lattice = (quads.instance == 0) & _is_aligned(quads.corners)
    parts = [_lattice_part(quads, np.flatnonzero(in_lattice)), _object_part(quads, np.flatnonzero(~in_lattice))]
    quad, shares, corners, weights, points, normals = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    first, number = _distinct(points, normals)
    return Patches(
        quad, shares, corners, number.reshape(-1, 4).astype(np.int64), weights,
        points.reshape(-1, 3)[first], normals.reshape(-1, 3)[first],
    )  # fmt: skip


def bare_mesh(corners: NDArray[np.float64], instance: NDArray[np.int32] | None = None) -> TriangleMesh:
    """A mesh of two triangles per quad (Q, 4, 3), in order, without looks; `instance` (Q,) holds object ids."""
    num = len(corners)
    faces = (np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(num)[:, None, None]).reshape(-1, 3).astype(np.int32)
    return TriangleMesh(
        corners.reshape(-1, 3).astype(np.float32),
        faces,
        np.zeros((2 * num, 3), np.uint8),
        np.zeros(2 * num, np.int32) if instance is None else np.repeat(instance, 2),
        np.full(2 * num, FLAT, np.int16),
        np.zeros((2 * num, 3, 2), np.float32),
    )


def _is_aligned(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each quad is a rectangle whose edges are parallel to two axes, (Q,)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    closes = np.abs(corners[:, 0] + second - corners[:, 3]).max(axis=1) < _ALIGNED
    along = [(np.abs(edge) > _ALIGNED).sum(axis=1) == 1 for edge in (first, second)]
    return closes & along[0] & along[1] & (np.abs(first).argmax(axis=1) != np.abs(second).argmax(axis=1))


def _counted(rows: NDArray[np.int64], cols: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """The quad, row and column of each cell, for one grid of `rows` x `cols` (Q,) cells per quad."""
    number = rows * cols
    quad = np.repeat(np.arange(len(rows)), number)
    at = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    return quad, at // cols[quad], at % cols[quad]


def _at_corners(first: NDArray[_Number], second: NDArray[_Number]) -> NDArray[_Number]:
    """Coordinates (P, 4, 2) of patches' corners, from ranges (P, 2) along the two edges of their quads."""
    return np.stack([first[:, [0, 1, 1, 0]], second[:, [0, 0, 1, 1]]], axis=2)


def _bilinear(values: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (P, C, K) at places (P, C, 2), blended from values (P, 4, K) at quads' corners."""
    return np.einsum("pcq,pqk->pck", _corner_weights(shares), values)


def _corner_weights(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share (P, C, 4) of each corner of a quad in places (P, C, 2) on it."""
    s, t = shares[..., 0], shares[..., 1]
    return np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=2)


def _object_part(quads: Quads, chosen: NDArray[np.int64]) -> _Part:
    """Quads cut evenly; quads that share a corner and its normal share its sample."""
    corners = quads.corners[chosen]
    lengths = []
    for a, b, c, d in ((0, 1, 3, 2), (1, 2, 0, 3)):
        pair = np.linalg.norm(corners[:, [b, d]] - corners[:, [a, c]], axis=2)
        lengths.append(pair.max(axis=1))
    step = np.where(quads.instance[chosen] == 0, WALL_STEP, _OBJECT_STEP)
    rows, cols = (np.maximum(1, np.ceil(length / step - 0.3)).astype(np.int64) for length in lengths)
    quad, row, col = _counted(rows, cols)
    ranges = [(k[:, None] + [0, 1]) / count[quad][:, None] for k, count in ((row, rows), (col, cols))]
    shares = _at_corners(ranges[0], ranges[1])
    inset = [np.where(length < _THIN, 0.5, np.minimum(0.5, _INSET / np.maximum(length, 1e-9))) for length in lengths]
    least = np.stack(inset, axis=1)[quad][:, None]
    inside = _bilinear(corners[quad], np.clip(shares, least, 1 - least))
    patch_corners, normals = _bilinear(corners[quad], shares), _bilinear(quads.normals[chosen][quad], shares)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    _, number = _distinct(patch_corners, normals)
    count = np.bincount(number)
    mean = np.stack([np.bincount(number, axis) / count for axis in inside.reshape(-1, 3).T], axis=1)
    weights = np.broadcast_to(np.eye(4), (len(quad), 4, 4))
    return _Part(chosen[quad], shares, patch_corners, weights, mean[number].reshape(-1, 4, 3), normals)


def _distinct(points: NDArray[np.float64], normals: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Numbers equal places with equal normals (P, 4, 3): index of the first of each, and each place's number, flat."""
    return numbered(np.concatenate([points * 1e4, normals * 100], axis=2).round().astype(np.int32).reshape(-1, 6))


def _lattice_part(quads: Quads, chosen: NDArray[np.int64]) -> _Part:
    """Quads cut at lattice lines; a patch's samples are the four lattice points around it."""
    corners = quads.corners[chosen]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]], axis=1)  # (Q, 2, 3)
    axes = np.abs(edges).argmax(axis=2)  # (Q, 2)
    normals = np.cross(edges[:, 0], edges[:, 1])
    across = np.abs(normals).argmax(axis=1)
    each = np.arange(len(chosen))
    sign = np.sign(normals[each, across])
    step = np.where((across == 1) & (sign > 0), FLOOR_STEP, WALL_STEP)
    begin = np.take_along_axis(corners[:, 0], axes, axis=1)  # (Q, 2)
    end = np.take_along_axis(corners[:, 2], axes, axis=1)
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    first = np.floor(low / step[:, None] + 1e-4).astype(np.int64)
    count = np.maximum(1, np.ceil(high / step[:, None] - 1e-4).astype(np.int64) - first)
    quad, row, col = _counted(count[:, 0], count[:, 1])
    cell = first[quad] + np.stack([row, col], axis=1)  # (P, 2) along the quad's two edges
    lines = np.stack([cell, cell + 1], axis=2).astype(np.float64) * step[quad][:, None, None]  # (P, 2, 2)
    limits = np.clip(lines, low[quad][..., None], high[quad][..., None])
    is_back = (end < begin)[quad][..., None]
    limits = np.where(is_back, limits[..., ::-1], limits)
    shares = (limits - begin[quad][..., None]) / (end - begin)[quad][..., None]
    placed = _at_corners(limits[:, 0], limits[:, 1])  # (P, 4, 2) metres along the two axes
    patch_corners = np.repeat(corners[quad][:, :1], 4, axis=1)
    np.put_along_axis(patch_corners, np.repeat(axes[quad][:, None], 4, axis=1), placed, axis=2)
    at = np.clip(placed / step[quad][:, None, None] - cell[:, None], 0, 1)
    weights = _corner_weights(at)
    plane = np.stack(
        [across, sign.astype(np.int64), np.round(corners[each, 0, across] / _SAME_PLANE).astype(np.int64)], 1
    )
    points = _lattice_points(np.unique(plane, axis=0, return_inverse=True)[1], axes, low, high, quad, cell, lines)
    sampled = np.repeat(corners[quad][:, :1], 4, axis=1)
    np.put_along_axis(sampled, np.repeat(axes[quad][:, None], 4, axis=1), points, axis=2)
    unit = np.zeros((len(chosen), 3))
    unit[each, across] = sign
    return _Part(
        chosen[quad], _at_corners(shares[:, 0], shares[:, 1]), patch_corners, weights, sampled,
        np.repeat(unit[quad][:, None], 4, axis=1),
    )  # fmt: skip


def _lattice_points(
    plane: NDArray[np.int64],
    axes: NDArray[np.int64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    quad: NDArray[np.int64],
    cell: NDArray[np.int64],
    lines: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Places (P, 4, 2), along the quad's two edges, of the samples for the four lattice points around each patch.

    A lattice point outside the surface moves to the nearest place inside one of the quads that use it; all of them use
    the same place.
    """
    index = _at_corners(cell[:, :1] + np.array([0, 1]), cell[:, 1:] + np.array([0, 1]))  # (P, 4, 2)
    wanted = _at_corners(lines[:, 0], lines[:, 1])
    inset = np.minimum(_INSET, (high - low) / 4)
    possible = np.clip(wanted, (low + inset)[quad][:, None], (high - inset)[quad][:, None])
    swapped = (axes[:, 0] > axes[:, 1])[quad][:, None, None]
    index, possible_xyz = (np.where(swapped, array[..., ::-1], array) for array in (index, possible))
    key = ((plane[quad][:, None] * _ONE + index[..., 0] + _ONE // 2) * _ONE + index[..., 1] + _ONE // 2).ravel()
    away = np.round(np.abs(possible - wanted).sum(axis=2).ravel() * 1e6)
    flat = possible_xyz.reshape(-1, 2)
    order = np.lexsort((flat[:, 1], flat[:, 0], away, key))
    is_first = np.diff(key[order], prepend=key[order[:1]] - 1) != 0
    best = np.empty(len(key), np.int64)
    best[order] = order[is_first][np.cumsum(is_first) - 1]
    chosen = flat[best].reshape(possible.shape)
    return np.where(swapped, chosen[..., ::-1], chosen)
