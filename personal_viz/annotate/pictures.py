"""Pictures of an object from places that see it, with its outline: what an annotator writes about."""

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
SIZE = (320, 240)
"""Pixels of a picture."""
OUTLINE = (214, 0, 110)
_CAMERA = Camera(800, 600)
_APART = math.radians(35)
"""Directions of two pictures differ by this much where there is a choice."""
_AROUND = 2.4
"""A picture shows this many times the object's size, so that one sees what stands beside it."""
_LEAST = 0.3
"""A picture shows at least this share of the robot's view."""


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
    """A picture (240, 320, 3) from each pose, cut around the object, which is outlined where it is seen."""
    if not poses:
        return []
    frames = renderer.render_batch(np.stack([T_world_camera(pose, _CAMERA) for pose in poses]), _CAMERA)
    return [_cut(frame, _pixels_of(item, frame)) for frame in frames]


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


def _cut(frame: Frame, shows: NDArray[np.bool_]) -> NDArray[np.uint8]:
    height, width = shows.shape
    rgb = frame.rgb.copy()
    rgb[np.asarray(binary_dilation(shows, iterations=3), bool) & ~shows] = OUTLINE
    box = (0, 0, width, height)
    if shows.any():
        rows, cols = np.flatnonzero(shows.any(axis=1)), np.flatnonzero(shows.any(axis=0))
        tall, wide = rows[-1] - rows[0] + 1, cols[-1] - cols[0] + 1
        share = float(np.clip(_AROUND * max(tall / height, wide / width), _LEAST, 1.0))
        left = float(np.clip((cols[0] + cols[-1]) / 2 - share * width / 2, 0, (1 - share) * width))
        top = float(np.clip((rows[0] + rows[-1]) / 2 - share * height / 2, 0, (1 - share) * height))
        box = (left, top, left + share * width, top + share * height)
    return np.asarray(Image.fromarray(rgb).resize(SIZE, Image.Resampling.LANCZOS, box=box))
