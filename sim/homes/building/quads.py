"""Collects quads of shapes and pieces of furniture, and makes a textured TriangleMesh of them with soft baked light."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...mesh import VERTEX_COLOURS, TriangleMesh
from ..furniture.parts import parts_of
from ..furniture.shapes import Shape, merged
from ..plan import Finish, Furniture
from .light import baked_light
from .patches import Patches, Quads, bare_mesh, patches_of
from .textures import Texture, texture_of

_UP = np.array([0.0, 1.0, 0.0])
_IS_FLOOR = 0.9
"""A quad of the house is a floor if the y of its normal is at least this."""


class _Batch(NamedTuple):
    """The quads of one call."""

    corners: NDArray[np.float64]
    normals: NDArray[np.float64] | None
    """(N, 4, 3), of any length; None = the quads are flat."""
    uv: NDArray[np.float64] | None
    """(N, 4, 2) metres; None = the finish is laid on from the side that each quad faces."""
    finish: Finish
    instance: int


class QuadBuilder:
    """Grows a mesh of quads; every add takes world metres and a finish."""

    def __init__(self) -> None:
        self._batches: list[_Batch] = []

    def add_quads(
        self,
        corners: ArrayLike,
        finish: Finish,
        *,
        uv: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        instance: int = 0,
    ) -> None:
        """Adds quads of one finish.

        Args:
            corners: (N, 4, 3) world metres, counter-clockwise from their front. Two equal corners make a triangle.
            finish: The finish of all these quads.
            uv: (N, 4, 2) places on the finish in metres, u to the right and v down, wood's grain along u; None = the
                finish is laid on from the side that the quad faces, by world coordinates, so that neighbours in one
                plane fit together. A picture is fitted to each quad, and `uv` only says how it is turned.
            normals: Outward vectors (N, 3), or (N, 4, 3) per corner, that light the quads of objects instead of the
                quads' own normals, for rounded solids.
            instance: Object id, 0 = none: floors, walls and other parts of the house.
        """
        quads = np.asarray(corners, np.float64).reshape(-1, 4, 3)
        if not len(quads):
            return
        places = None if uv is None else np.asarray(uv, np.float64).reshape(-1, 4, 2)
        smooth = None
        if normals is not None and instance != 0:
            given = np.asarray(normals, np.float64)
            smooth = np.broadcast_to(given.reshape(len(given), -1, 3), quads.shape)
        self._batches.append(_Batch(quads, smooth, places, finish, instance))

    def mesh(self, *, lamps: Sequence[tuple[float, float, float]] = ()) -> TriangleMesh:
        """Everything added so far as triangles with one texture per finish, and light; surfaces that face a bulb of
        `lamps` (world places) nearby are lighter and warmer.

        Returns:
            Large quads are split where light changes. `vertex_rgb` is the light on textured faces and the lit colour
            of the others; `face_rgb` is the lit mean colour of all faces.
        """
        batches, quads = self._batches, self._quads()
        counts = [len(batch.corners) for batch in batches]
        uv = _planar_uv(quads.corners)
        for batch, end in zip(batches, np.cumsum(counts), strict=True):
            if batch.uv is not None:
                uv[end - len(batch.corners) : end] = batch.uv
        is_floor = (quads.instance == 0) & (quads.normals[:, 0, 1] > _IS_FLOOR)
        looks = list(dict.fromkeys(batch.finish for batch in batches))
        number = {finish: index for index, finish in enumerate(looks)}
        look = _surfaces(looks, np.repeat([number[batch.finish] for batch in batches], counts), uv, is_floor)
        patches = patches_of(quads)
        light = patches.interpolated(baked_light(quads.corners, patches, lamps=lamps))
        return _triangles(quads, look, patches, light)

    def bare_mesh(self) -> TriangleMesh:
        """Everything added so far as triangles with object ids, without looks and light."""
        quads = self._quads()
        return bare_mesh(quads.corners, quads.instance)

    def _quads(self) -> Quads:
        """Everything added so far; normals are the given ones, or else the quads' own."""
        corners = np.concatenate([batch.corners for batch in self._batches])
        instance = np.concatenate([np.full(len(batch.corners), batch.instance, np.int32) for batch in self._batches])
        normals = np.repeat(_crossed(corners)[:, None], 4, axis=1)
        first = 0
        for batch in self._batches:
            if batch.normals is not None:
                normals[first : first + len(batch.corners)] = batch.normals
            first += len(batch.corners)
        lengths = np.linalg.norm(normals, axis=2, keepdims=True)
        normals = np.where(lengths > 1e-12, normals / np.maximum(lengths, 1e-12), _UP)
        return Quads(corners, normals, instance)


class Spot(NamedTuple):
    """A right-handed frame at the place of a thing; on a wall, x runs along the wall, y up, and z out of the wall."""

    origin: NDArray[np.float64]
    """(3,) world metres."""
    yaw: float
    """Turn in radians about +y; at 0 the axes are the world's."""

    def world(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """World place (3,) of a point (3,) in the spot's frame."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        x, y, z = point
        return self.origin + np.array([cos * x + sin * z, y, -sin * x + cos * z])


def spot_on_wall(start: NDArray[np.float64], out: NDArray[np.float64], y: float) -> Spot:
    """A spot at height `y` over (x, z) `start`, whose z looks along the level direction `out`; both (2,)."""
    return Spot(np.array([start[0], y, start[1]]), float(np.arctan2(out[0], out[1])))


def add_shapes(builder: QuadBuilder, spot: Spot, finish: Finish, *shapes: Shape, instance: int = 0) -> None:
    """Adds shapes of the spot's own frame, all of one finish."""
    placed = merged(shapes).turned("y", spot.yaw)
    builder.add_quads(placed.corners + spot.origin, finish, uv=placed.uv, normals=placed.normals, instance=instance)


def add_piece(builder: QuadBuilder, piece: Furniture, *, instance: int) -> None:
    """Adds a piece with this object id at its place: its middle at `piece.centre`, its front turned from +z by
    `piece.yaw`.
    """
    by_finish: dict[Finish, list[Shape]] = {}
    for part in parts_of(piece):
        by_finish.setdefault(part.finish, []).append(part.shape)
    spot = Spot(np.array(piece.centre) - [0.0, piece.size[1] / 2, 0.0], piece.yaw)
    for finish, shapes in by_finish.items():
        add_shapes(builder, spot, finish, *shapes, instance=instance)


def floor_uv(quads: NDArray[np.floating], *, is_deep: bool) -> NDArray[np.floating]:
    """Places (N, 4, 2) on a floor in world metres; its planks run along z where the room is deep, else along x."""
    return quads[..., [2, 0]] if is_deep else quads[..., [0, 2]]


class _Surfaces(NamedTuple):
    """The look of each quad, before it is lit."""

    texture: NDArray[np.int16]
    """(Q,) index into `images`, or VERTEX_COLOURS."""
    uv: NDArray[np.float64]
    """(Q, 4, 2) in shares of the image."""
    rgb: NDArray[np.float64]
    """(Q, 3) mean colour."""
    images: tuple[NDArray[np.uint8], ...]


def _surfaces(
    finishes: list[Finish], which: NDArray[np.int64], uv: NDArray[np.float64], is_floor: NDArray[np.bool_]
) -> _Surfaces:
    """The look of each quad, with one image for each finish that has one, and another where people walk on it.

    Args:
        finishes: All finishes.
        which: (Q,) index of each quad's finish.
        uv: (Q, 4, 2) metres; changed into shares of the image.
        is_floor: (Q,) whether people walk on the quad.
    """
    images: list[NDArray[np.uint8]] = []
    numbers: dict[int, int] = {}
    texture, rgb = np.full(len(which), VERTEX_COLOURS, np.int16), np.empty((len(which), 3))
    order = np.argsort(2 * which + is_floor, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff((2 * which + is_floor)[order])) + 1)
    for group in groups:
        finish = finishes[which[group[0]]]
        found = texture_of(finish, is_floor=bool(is_floor[group[0]]))
        rgb[group] = finish.rgb if found is None else found.rgb
        if found is None:
            continue
        number = numbers.setdefault(id(found), len(images))
        if number == len(images):
            images.append(found.image)
        texture[group], uv[group] = number, _shares(uv[group], found)
    return _Surfaces(texture, uv, rgb, tuple(images))


def _shares(uv: NDArray[np.float64], texture: Texture) -> NDArray[np.float64]:
    """Places (N, 4, 2) in metres as shares of the image."""
    if not texture.is_whole:
        return uv / texture.metres
    low, high = uv.min(axis=1, keepdims=True), uv.max(axis=1, keepdims=True)
    return (uv - low) / np.maximum(high - low, 1e-9)


def _triangles(quads: Quads, look: _Surfaces, patches: Patches, light: NDArray[np.float64]) -> TriangleMesh:
    """Two triangles per patch, cut along the diagonal on which light changes less; light is (P, 4, 3)."""
    num, of = len(patches.quad), patches.quad
    rgb = np.where((look.texture[of] == VERTEX_COLOURS)[:, None, None], look.rgb[of][:, None], 255.0) * light
    grey = light.sum(axis=2)
    is_turned = np.abs(grey[:, 0] - grey[:, 2]) > np.abs(grey[:, 1] - grey[:, 3])
    split = np.where(is_turned[:, None], [0, 1, 3, 1, 2, 3], [0, 1, 2, 0, 2, 3])  # (P, 6)
    faces = (split + 4 * np.arange(num)[:, None]).reshape(-1, 3).astype(np.int32)
    vertices = patches.corners.reshape(-1, 3).astype(np.float32)
    uv = patches.blended(look.uv).reshape(-1, 2).astype(np.float32)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    keep = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9
    faces, patch = faces[keep], np.repeat(np.arange(num), 2)[keep]
    face_texture = look.texture[of][patch]
    lit = look.rgb[of][patch] * light.mean(axis=1)[patch]
    return TriangleMesh(
        vertices,
        faces,
        _bytes(lit),
        quads.instance[of][patch],
        face_texture,
        np.where((face_texture >= 0)[:, None, None], uv[faces], np.float32(0)),
        look.images,
        _bytes(rgb.reshape(-1, 3)),
    )


def _bytes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.clip(values, 0, 255).round().astype(np.uint8)


def _crossed(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normals (N, 3) of quads, as long as twice the quads' area."""
    return np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])


def _planar_uv(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (N, 4, 2) in metres to the right and down on each quad, seen along the axis that it faces most."""
    normal = _crossed(quads)
    axis = np.abs(np.round(normal, 12)).argmax(axis=1)
    sign = np.where(normal[np.arange(len(quads)), axis] < 0, -1.0, 1.0)[:, None]
    x, y, z = np.moveaxis(quads, 2, 0)  # (N, 4) each
    right = np.select([(axis == 0)[:, None], (axis == 1)[:, None]], [-sign * z, x], sign * x)
    down = np.where((axis == 1)[:, None], sign * z, -y)
    return np.stack([right, down], axis=2)
