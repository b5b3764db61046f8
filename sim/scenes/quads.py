"""Collects coloured rectangles and boxes, and makes a TriangleMesh of them with soft light baked into the colours."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .plan import Finish
from .scene import TriangleMesh

_LIGHT = np.array([0.35, 0.8, 0.25])  # not along any axis, so that the walls of a room differ
_UNIT_BOX = np.array(
    [
        [[-1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]],  # top
        [[-1, -1, -1], [1, -1, -1], [1, -1, 1], [-1, -1, 1]],  # bottom
        [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],  # +z
        [[1, -1, -1], [-1, -1, -1], [-1, 1, -1], [1, 1, -1]],  # -z
        [[1, -1, 1], [1, -1, -1], [1, 1, -1], [1, 1, 1]],  # +x
        [[-1, -1, -1], [-1, -1, 1], [-1, 1, 1], [-1, 1, -1]],  # -x
    ],
    float,
)  # (6, 4, 3), counter-clockwise from outside
_DRUM_SIDES = 10
_UP = np.array([0.0, 1.0, 0.0])


class QuadBuilder:
    """Grows a mesh of quads; every add takes world metres and a finish."""

    def __init__(self) -> None:
        self._corners: list[NDArray[np.float64]] = []
        self._rgb: list[NDArray[np.float64]] = []
        self._instance: list[NDArray[np.int32]] = []

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
            corners: (N, 4, 3) world metres, counter-clockwise from their front.
            finish: Of all of them.
            uv: (N, 4, 2) places on the finish in metres; None = laid on from the side that the quad faces, by world
                coordinates, so that neighbours in one plane fit together.
            normals: (N, 3) unit vectors that light the quads instead of their own normals.
            instance: Object id, 0 = none.
        """
        quads = np.asarray(corners, np.float64).reshape(-1, 4, 3)
        if normals is None:
            crossed = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
            normals = crossed / np.maximum(np.linalg.norm(crossed, axis=1, keepdims=True), 1e-12)
        shade = 0.82 + 0.22 * np.asarray(normals, float) @ _LIGHT
        self._corners.append(quads)
        self._rgb.append(np.array(finish.rgb, float) * shade[:, None])
        self._instance.append(np.full(len(quads), instance, np.int32))

    def add_box(
        self,
        centre: ArrayLike,
        size: ArrayLike,
        *,
        finish: Finish,
        yaw: float = 0.0,
        is_round: bool = False,
        instance: int = 0,
    ) -> None:
        """A box (or an upright drum) with its centre and its extents (3,) along its own axes, turned by `yaw`."""
        corners = _drum() if is_round else _UNIT_BOX
        local = corners * np.asarray(size, float) / 2
        cos, sin = np.cos(yaw), np.sin(yaw)
        turned = local @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T
        self.add_quads(turned + np.asarray(centre, float), finish, instance=instance)

    def mesh(self) -> TriangleMesh:
        """Everything added so far; two triangles per quad, colours shaded by direction."""
        corners = np.concatenate(self._corners)
        num = len(corners)
        rgb = np.clip(np.concatenate(self._rgb), 0, 255).round().astype(np.uint8)
        first = np.arange(num, dtype=np.int32)[:, None] * 4
        faces = (
            np.stack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], axis=1).reshape(-1, 3).astype(np.int32)
        )
        return TriangleMesh(
            corners.reshape(-1, 3).astype(np.float32),
            faces,
            np.repeat(rgb, 2, axis=0),
            np.repeat(np.concatenate(self._instance), 2),
            np.full(2 * num, -1, np.int16),
            np.zeros((2 * num, 3, 2), np.float32),
        )


def _drum() -> NDArray[np.float64]:
    """Sides and lids of an upright drum in the box [-1, 1]^3; (S + 2 * (S / 2 - 1), 4, 3)."""
    angle = -np.arange(_DRUM_SIDES + 1) * 2 * np.pi / _DRUM_SIDES
    ring = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    top, bottom = ring + _UP, ring - _UP
    sides = np.stack([bottom[:-1], bottom[1:], top[1:], top[:-1]], axis=1)
    fan = [[0, k, k + 1, k + 2] for k in range(1, _DRUM_SIDES - 2, 2)]
    return np.concatenate([sides, top[fan], bottom[fan][:, ::-1]])
