"""Pictures of an object from places that see it, cut around it and with its outline: what an annotator writes about.

The first look of a robot finds the object; the second one is turned to it and narrower, so nothing is enlarged.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import binary_dilation

from grounding.maps.storeys import points_at
from sim.authoring.findable import pose_towards
from sim.episodes.schema import Goal
from sim.frames import T_world_camera
from sim.mesh import SceneObject, TriangleMesh
from sim.render.renderer import Renderer
from sim.types import Camera, Frame, Pose
from sim.walk.navigation_map import NavigationMap
from sim.walk.object_surface import is_in_box
from sim.walk.viewpoints import view_points_around

NUM_PICTURES = 4
SIZE = (400, 300)
"""Pixels of a picture."""
OUTLINE = (214, 0, 110)
_FIRST_LOOK = Camera(320, 240)
_CLOSER_PIXELS = (640, 480)
"""Pixels of a closer look, before it is smoothed to SIZE."""
_OUTLINE_PIXELS = 3
_APART = math.radians(35)
"""Directions of two pictures differ by this much where there is a choice."""
_AROUND = 2.4
"""A picture shows this many times the object's size, so that one sees what stands beside it."""
_NARROWEST_DEG, _WIDEST_DEG = 30.0, 95.0
"""Fields of view: three times closer than the robot sees, or a little wider, where it is close to something large."""


def found_sights(
    item: SceneObject, mesh: TriangleMesh, *, navigation: NavigationMap, renderer: Renderer
) -> tuple[Pose, ...]:
    """Up to NUM_PICTURES poses that see the object best, from different sides; () where no place sees it."""
    seen = view_points_around(item, mesh, navigation=navigation, renderer=renderer)
    return _spread([Pose(place.position, place.yaw, place.tilt) for place in seen])


def recorded_sights(goal: Goal, centre: tuple[float, float, float]) -> tuple[Pose, ...]:
    """Up to NUM_PICTURES poses at a goal's recorded view points, best `iou` first, that look at the object's centre."""
    points = sorted(goal.original_view_points or goal.view_points, key=lambda point: -(point.iou or 0.0))
    return _spread([pose_towards(point.agent_state.position, centre) for point in points])


def pictures_of(item: SceneObject, poses: Sequence[Pose], *, renderer: Renderer) -> list[NDArray[np.uint8]]:
    """A picture (300, 400, 3) from each pose, turned to the object, which is outlined where it is seen."""
    if not poses:
        return []
    looks = renderer.render_batch(np.stack([T_world_camera(pose, _FIRST_LOOK) for pose in poses]), _FIRST_LOOK)
    pictures = []
    for pose, look in zip(poses, looks, strict=True):
        turned, camera = _closer(pose, _rays_to(item, look))
        pictures.append(_outlined(item, renderer.render(T_world_camera(turned, camera), camera)))
    return pictures


def _spread(poses: Sequence[Pose]) -> tuple[Pose, ...]:
    """The first pose, then the next ones that look in another direction; where these are too few, the rest in order."""
    kept: list[Pose] = []
    for pose in poses:
        if all(abs(math.remainder(pose.yaw - other.yaw, 2 * math.pi)) >= _APART for other in kept):
            kept.append(pose)
    kept += [pose for pose in poses if pose not in kept]
    return tuple(kept[:NUM_PICTURES])


def _pixels_of(item: SceneObject, frame: Frame) -> NDArray[np.bool_]:
    """(H, W) pixels that show the object."""
    if item.instance_id:
        return frame.instance_ids == item.instance_id
    rows, cols = np.indices(frame.depth_m.shape)
    places = points_at(frame, np.column_stack([rows.ravel(), cols.ravel()]))
    return is_in_box(places, centre=item.centre, size=item.size).reshape(frame.depth_m.shape)


def _rays_to(item: SceneObject, look: Frame) -> NDArray[np.float64]:
    """(N, 3) world directions of the pixels that show the object, or of its box's corners where none does."""
    rows, cols = np.nonzero(_pixels_of(item, look))
    if not len(rows):
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return np.asarray(item.centre) + corners * item.size - look.T_world_camera[:3, 3]
    fx, fy, cx, cy = look.camera.lens
    rays_camera = np.column_stack([(cols + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy, np.ones(len(rows))])
    return rays_camera @ look.T_world_camera[:3, :3].T


def _closer(pose: Pose, rays: NDArray[np.float64]) -> tuple[Pose, Camera]:
    """The robot turned to the middle of these directions, and the camera that shows _AROUND times their extent."""
    yaws, rises = np.arctan2(-rays[:, 0], -rays[:, 2]), np.arctan2(rays[:, 1], np.hypot(rays[:, 0], rays[:, 2]))
    off = np.remainder(yaws - pose.yaw + math.pi, 2 * math.pi) - math.pi
    turned = Pose(pose.position, pose.yaw + float(off.min() + off.max()) / 2, float(rises.min() + rises.max()) / 2)
    width, height = _CLOSER_PIXELS
    right, down, ahead = (rays @ T_world_camera(turned, _FIRST_LOOK)[:3, :3]).T
    half = float(np.max(np.maximum(np.abs(right), np.abs(down) * width / height) / np.maximum(ahead, 1e-6)))
    hfov_deg = math.degrees(2 * math.atan(_AROUND * half))
    return turned, Camera(width, height, float(np.clip(hfov_deg, _NARROWEST_DEG, _WIDEST_DEG)))


def _outlined(item: SceneObject, frame: Frame) -> NDArray[np.uint8]:
    shows = _pixels_of(item, frame)
    rgb = frame.rgb.copy()
    rgb[np.asarray(binary_dilation(shows, iterations=_OUTLINE_PIXELS), bool) & ~shows] = OUTLINE
    return np.asarray(Image.fromarray(rgb).resize(SIZE, Image.Resampling.LANCZOS))
