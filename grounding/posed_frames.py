"""What maps are built from: pictures with depth, a pose and intrinsics, from the simulator or from a real robot.

The `map` frame is the frame that a map is built in: y up, metres, as the world (sim/frames.py); for homes of the
simulator it is the world, for a robot's recording whatever its poses refer to, turned y-up.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.types import Camera


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole without distortion; pixel centres are at +0.5, row 0 is the top."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    """All four in pixels."""

    @classmethod
    def of(cls, camera: Camera) -> "Intrinsics":
        """Those of a camera of the simulator."""
        focal = camera.focal
        return cls(camera.width, camera.height, focal, focal, camera.width / 2, camera.height / 2)


@dataclass(frozen=True, slots=True)
class PosedFrame:
    """One view with everything that a map builder needs."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth_m: NDArray[np.float32]
    """(H, W) planar metres, 0 = no return."""
    T_map_camera: NDArray[np.float64]
    """(4, 4) camera (OpenCV axes) in the map frame."""
    intrinsics: Intrinsics
    instance_ids: NDArray[np.int32] | None = None
    """(H, W) object ids of the simulator, 0 = none. Ground truth: only `oracle-perception` encoders read it, which say
    so in their name; None for frames of a real robot."""

    def __post_init__(self) -> None:
        size = (self.intrinsics.height, self.intrinsics.width)
        assert self.rgb.shape == (*size, 3), self.rgb.shape
        assert self.depth_m.shape == size, self.depth_m.shape
        assert self.T_map_camera.shape == (4, 4), self.T_map_camera.shape
        assert self.instance_ids is None or self.instance_ids.shape == size, "instance ids of another size"
