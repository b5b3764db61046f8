"""Views of different rooms that show much of a home, and crops of single objects.

Scene + renderer -> poses and pictures for the contact sheet (personal_viz/contact_sheet/sheet.py).
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim.frames import T_world_camera
from sim.mesh import Scene, SceneObject
from sim.render.renderer import Renderer
from sim.types import Camera, Frame, Pose
from sim.walk.viewpoints import view_points_around

CROP_SIDE = 256
MIN_PIXELS = 150
"""Objects that fill less of a 640 x 480 view are not cut out."""
_LOOK = Camera(64, 48)
"""For trying many poses."""
_TRIAL = Camera(160, 120)
"""For trying the view points of one object."""
_SPACING = 0.75
"""One place is tried per square of this side (metres)."""
_MAX_PLACES = 120
"""Places tried per storey."""
_NUM_YAWS = 12
_NOTICED = 12
"""Pixels of _LOOK from which an object counts as shown."""
_TOO_NEAR = 1.0
"""Anything nearer to the camera than this hides the room (metres)."""
_LARGEST = 0.15
"""An object that fills more of the picture hides others."""
_DEEP = 1.5
"""A view of a room is at least this deep in the middle (median, metres)."""
_DEEP_ENOUGH = 3.5
"""Deeper views are no better (metres)."""
_MARGIN = 1.5
"""Side of a crop over the side of the object in it, where the object is large."""
_TRIED_PER_CATEGORY = 3
_TRIED_PER_OBJECT = 24
"""View points tried per object."""
_LEAST_SHOWN = 10
"""Fewer pixels of _TRIAL show hardly anything of an object."""
_LITTLE_HIDDEN = 0.85
"""Views that show this share of what the best one shows are compared."""


@dataclass(frozen=True, slots=True)
class View:
    """One first-person view of a room."""

    pose: Pose
    room: str
    """Name of the room that it mostly shows; empty where rooms have no names."""
    objects: tuple[str, ...]
    """Categories in view, those with most pixels first."""
    score: float


@dataclass(frozen=True, slots=True)
class Crop:
    """One object cut out of a first-person view."""

    item: SceneObject
    rgb: NDArray[np.uint8]
    """(CROP_SIDE, CROP_SIDE, 3)."""


def room_views(scene: Scene, renderer: Renderer, *, rooms: Mapping[int, str], count: int) -> list[View]:
    """The best views of `count` different rooms; more than one of a room where there are fewer rooms.

    A good view shows many objects, is deep, and has nothing right before the camera. There are fewer where the home has
    no more places to stand.
    """
    views = [view for floor_y in scene.navigation.storey_heights for view in _views(scene, renderer, rooms, floor_y)]
    views.sort(key=lambda view: (-view.score, view.pose.position, view.pose.yaw))
    chosen: list[View] = []
    while len(chosen) < count and views:
        seen = Counter(view.room for view in chosen)
        shown = {name for view in chosen for name in view.objects}
        best = min(views, key=lambda view: (seen[view.room], -view.score - 0.5 * len(set(view.objects) - shown)))
        chosen.append(best)
        views = [view for view in views if _apart(view.pose, best.pose)]
    return chosen


def object_crop(item: SceneObject, scene: Scene, renderer: Renderer) -> tuple[int, Crop] | None:
    """An object cut out of the 640 x 480 view from its best view point, with its number of pixels there.

    Of the views that little hides, the best one is cut by the fewest sides of the picture, and large. The crop is
    CROP_SIDE pixels of that view, or the whole object scaled down where it is larger. None where no place to stand
    shows the object well.
    """
    camera = Camera()
    found = view_points_around(item, scene.mesh, navigation=scene.navigation, renderer=renderer, camera=camera)
    clear = [seen for seen in found if seen.visible_share >= _LITTLE_HIDDEN * found[0].visible_share]
    poses = [Pose(seen.position, seen.yaw, seen.tilt) for seen in clear[:_TRIED_PER_OBJECT]]
    if not poses:
        return None
    trials = renderer.render_batch(np.stack([T_world_camera(pose, _TRIAL) for pose in poses]), _TRIAL)
    masks = [frame.instance_ids == item.instance_id for frame in trials]
    best = min(range(len(poses)), key=lambda number: view_faults(masks[number]))
    frame = renderer.render(T_world_camera(poses[best], camera), camera)
    pixels = int((frame.instance_ids == item.instance_id).sum())
    return (pixels, Crop(item, _cut_out(frame, item.instance_id))) if pixels >= MIN_PIXELS else None


def view_faults(shown: NDArray[np.bool_]) -> tuple[bool, int, int]:
    """What is wrong with a view of an object (pixels: rows, cols): hardly there, number of sides that cut it, small."""
    sides, count = (shown[0], shown[-1], shown[:, 0], shown[:, -1]), int(shown.sum())
    return count < _LEAST_SHOWN, sum(bool(side.any()) for side in sides), -count


def category_crops(scene: Scene, renderer: Renderer) -> list[Crop]:
    """One crop of each category that a view point shows, by category; the clearest of its first few objects."""
    found: list[Crop] = []
    for category in sorted({item.category for item in scene.objects}):
        items = [item for item in scene.objects if item.category == category][:_TRIED_PER_CATEGORY]
        crops = [crop for item in items if (crop := object_crop(item, scene, renderer)) is not None]
        if crops:
            found.append(max(crops, key=lambda crop: crop[0])[1])
    return found


def _views(scene: Scene, renderer: Renderer, rooms: Mapping[int, str], floor_y: float) -> list[View]:
    """A view in each direction from places all over a storey, without those that show a wall."""
    categories = {item.instance_id: item.category for item in scene.objects}
    yaws = np.arange(_NUM_YAWS) * 2 * np.pi / _NUM_YAWS
    poses = [Pose(place, float(yaw)) for place in _places(scene, floor_y) for yaw in yaws]
    frames = renderer.render_batch(np.stack([T_world_camera(pose, _LOOK) for pose in poses]), _LOOK) if poses else []
    found = []
    for pose, frame in zip(poses, frames, strict=True):
        near = (frame.depth_m > 0) & (frame.depth_m < _TOO_NEAR)
        if float(np.median(frame.depth_m)) < _DEEP:
            continue
        counts = np.bincount(frame.instance_ids.ravel())
        ids = [index for index in np.argsort(-counts, kind="stable") if index in categories and counts[index]]
        noticed = [index for index in ids if counts[index] >= _NOTICED]
        if not noticed and categories:
            continue
        names = tuple(dict.fromkeys(categories[index] for index in noticed))
        shares = counts[ids] / frame.instance_ids.size
        deep = float(np.median(frame.depth_m))
        score = 0.6 * len(names) + 1.2 * min(deep, _DEEP_ENOUGH) + 2 * min(0.5, float(shares.sum()))
        score -= 12 * float(near.mean()) + 8 * max(0.0, float(shares.max(initial=0)) - _LARGEST)
        found.append(View(pose, _main_room(ids, counts, rooms), names, score))
    return found


def _main_room(ids: Sequence[int], counts: NDArray[np.int64], rooms: Mapping[int, str]) -> str:
    """The room to which most of what is seen belongs."""
    pixels = Counter[str]()
    for index in ids:
        pixels[rooms.get(index, "")] += int(counts[index])
    return max(sorted(pixels), key=lambda name: pixels[name]) if pixels else ""


def _places(scene: Scene, floor_y: float) -> list[tuple[float, float, float]]:
    """Places to stand, one per square of _SPACING, at most _MAX_PLACES of them."""
    free, grid, _ = scene.navigation.top_down(floor_y)
    rc = np.argwhere(free)
    if not len(rc):
        return []
    xz = grid.xz_from_rc(rc)
    squares = np.floor(xz / _SPACING)
    off = np.abs(xz / _SPACING - squares - 0.5).max(axis=1)
    order = np.lexsort((off, *squares.T))
    _, first = np.unique(squares[order], axis=0, return_index=True)
    kept = xz[order[first]]
    kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), _MAX_PLACES)).round().astype(int)]
    snapped = [scene.navigation.snap(np.array([x, floor_y, z])) for x, z in kept]
    return [(float(at[0]), float(at[1]), float(at[2])) for at in snapped if at is not None]


def _apart(pose: Pose, other: Pose) -> bool:
    """Whether two views show different things: from places 1.5 m apart, or in opposite directions."""
    away = np.hypot(pose.position[0] - other.position[0], pose.position[2] - other.position[2])
    turn = abs((pose.yaw - other.yaw + np.pi) % (2 * np.pi) - np.pi)
    return bool(away > 1.5 or abs(pose.position[1] - other.position[1]) > 1.0 or turn > 2 * np.pi / 3)


def _cut_out(frame: Frame, instance_id: int) -> NDArray[np.uint8]:
    """A square around an object's pixels, inside the picture, as (CROP_SIDE, CROP_SIDE, 3)."""
    rows, cols = np.nonzero(frame.instance_ids == instance_id)
    height, width = frame.instance_ids.shape
    largest = max(np.ptp(rows), np.ptp(cols)) + 1
    side = int(min(height, max(CROP_SIDE, _MARGIN * largest)))
    top = int(np.clip((rows.min() + rows.max() + 1 - side) // 2, 0, height - side))
    left = int(np.clip((cols.min() + cols.max() + 1 - side) // 2, 0, width - side))
    square = Image.fromarray(frame.rgb[top : top + side, left : left + side])
    return np.asarray(square.resize((CROP_SIDE, CROP_SIDE), Image.Resampling.LANCZOS))
