"""What robots saw, rendered again from their poses: run files hold no pictures."""

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
"""Most pixels of all pictures of a recording, about 10 s of rendering on two cores: a person and an agent of 500 steps
fit with full size."""
VIEW_PIXELS = 12_000
"""What a view costs beside its pixels, as if it had so many more."""
SIZES = ((4, 2), (4, 1), (3, 1), (2, 1))
"""Width and height of the pictures of runs that are shown at first, and of the others, in quarters of the camera's;
the first that fits the budget is taken, or else the last."""
_BATCH = 16
"""Views rendered at once, 3.4 MB each at 640 x 480; while they are made the ones before are encoded."""


def picture_cameras(ways: Sequence[Way], camera: Camera, *, is_shown: Sequence[bool]) -> list[Camera]:
    """A camera per run that sees what the robot's did, with no more pixels than the budget allows.

    Args:
        ways: Poses of each run.
        camera: The robots' camera.
        is_shown: Which runs are shown at first; they get the larger pictures.
    """
    cameras: list[Camera] = []
    for shown, others in SIZES:
        cameras = [_sized(camera, shown if is_large else others) for is_large in is_shown]
        views = {(view, pose) for way, view in zip(ways, cameras, strict=True) for pose in way}
        if sum(view.width * view.height + VIEW_PIXELS for view, _ in views) <= PIXEL_BUDGET:
            break
    return cameras


def rendered_jpegs(renderer: Renderer, ways: Sequence[Way], cameras: Sequence[Camera]) -> list[list[bytes]]:
    """JPEGs of what each of several robots saw at each of its poses, through its camera.

    Equal poses seen through equal cameras are rendered once: starts, blocked steps, ways that several runs took.
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
