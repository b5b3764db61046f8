"""The protocol of renderers, which sim/render/raycast.py implements, and pictures as JPEG. Light to import."""

from dataclasses import dataclass
from typing import Literal, Protocol

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from sim.types import Camera, Frame

JPEG_QUALITY = 80
"""Quality of pictures that participants and recordings show."""


@dataclass(frozen=True, slots=True)
class Hits:
    """The places where rays first met the scene."""

    range_m: NDArray[np.float64]
    """(N,) metres along the unit ray, inf where nothing was hit."""
    positions: NDArray[np.float64]
    """(N, 3) world metres, nan where nothing was hit."""
    face_ids: NDArray[np.int64]
    """(N,) face of the mesh, -1 where nothing was hit."""


@dataclass(frozen=True, slots=True)
class Backend:
    """The library that finds the first hits of rays, and why it was chosen."""

    name: Literal["embree", "open3d"]
    packet_width: int
    """Rays that are traced together: 16, 8 or 4; 1 with Open3D."""
    reason: str
    """One sentence."""


class Renderer(Protocol):
    """Renders views of one scene and casts rays into it."""

    def render(self, T_world_camera: NDArray[np.float64], camera: Camera) -> Frame:
        """RGB, planar depth and instance ids seen by a camera at (4, 4)."""
        ...

    def render_batch(self, Ts_world_camera: NDArray[np.float64], camera: Camera) -> list[Frame]:
        """`render` of each of the poses (B, 4, 4), in order; faster than one after the other."""
        ...

    def depth(self, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.float32]:
        """Only the depth of `render`, (H, W) planar metres, 0 where nothing was hit; it costs less than `render`."""
        ...

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """First hits of rays; both (N, 3), directions need not be unit length."""
        ...


def jpeg_bytes(rgb: NDArray[np.uint8]) -> bytes:
    """A picture (H, W, 3) as JPEG; the same picture gives the same bytes. It does not block other threads."""
    return bytes(imagecodecs.jpeg8_encode(rgb, level=JPEG_QUALITY, subsampling="420"))
