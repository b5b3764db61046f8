"""Renders the robots' pictures again from their poses, because run files hold no pictures."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from sim.frames import T_world_camera
from sim.render.raycast import own_cores
from sim.render.renderer import Renderer, jpeg_bytes
from sim.types import Camera, Pose

Way = Sequence[Pose]
PIXEL_BUDGET = 190_000_000
"""Largest number of pixels of all pictures in a recording, about 10 s of rendering on two cores: a person and an agent
of 500 steps fit at full size."""
VIEW_PIXELS = 12_000
"""Fixed cost of a view, as the number of pixels that take equally long to render."""
SIZES = ((4, 2), (4, 1), (3, 1), (2, 1))
"""Width and height of the pictures, in quarters of the camera's, of the runs shown at first and of the other runs; the
first pair that fits the budget is used, or else the last."""
_BATCH = 16
"""Number of views rendered at once, 3.4 MB each at 640 x 480; meanwhile the previous ones are encoded."""


def picture_cameras(ways: Sequence[Way], camera: Camera, *, is_shown: Sequence[bool]) -> list[Camera]:
    """A camera per run with the robot's field of view and no more pixels than the budget allows.

    Runs that are shown at first get the larger pictures.
    """
    cameras: list[Camera] = []
    for shown, others in SIZES:
        cameras = [_sized(camera, shown if is_large else others) for is_large in is_shown]
        views = {(view, pose) for way, view in zip(ways, cameras, strict=True) for pose in way}
        if sum(view.width * view.height + VIEW_PIXELS for view, _ in views) <= PIXEL_BUDGET:
            break
    return cameras


def rendered_jpegs(renderer: Renderer, ways: Sequence[Way], cameras: Sequence[Camera]) -> list[list[bytes]]:
    """JPEGs of each robot's view at each of its poses, through its camera.

    Equal poses with equal cameras are rendered once: starts, blocked steps, and ways that several runs share.
    """
    views = dict.fromkeys((camera, pose) for way, camera in zip(ways, cameras, strict=True) for pose in way)
    encoded: dict[tuple[Camera, Pose], Future[bytes]] = {}
    with ThreadPoolExecutor(own_cores(), thread_name_prefix="jpeg") as pool:
        for camera in dict.fromkeys(cameras):
            poses = [pose for view, pose in views if view == camera]
            for first in range(0, len(poses), _BATCH):
                batch = poses[first : first + _BATCH]
                frames = renderer.render_batch(np.array([T_world_camera(pose, camera) for pose in batch]), camera)
                for pose, frame in zip(batch, frames, strict=True):
                    encoded[camera, pose] = pool.submit(jpeg_bytes, frame.rgb)
    return [[encoded[camera, pose].result() for pose in way] for way, camera in zip(ways, cameras, strict=True)]


def _sized(camera: Camera, quarters: int) -> Camera:
    return replace(camera, width=camera.width * quarters // 4, height=camera.height * quarters // 4)
