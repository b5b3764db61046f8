"""A storey seen from straight above, cut under its ceiling, with the names of its rooms and objects."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sim.copies.cut import storey_mesh
from sim.homes.plan import HomePlan, room_middle
from sim.mesh import Scene
from sim.plan_view.view import PlanView
from sim.render.raycast import SKY_RGB, Raycaster
from sim.types import Camera
from sim.walk.storeys import nearest_storey, same_storey

_ABOVE = 400.0
"""Height of the camera over the cut (metres): so far that walls do not lean."""
_BORDER = 0.3
"""Metres around the storey."""
_NAME_SIZE, _WORD_SIZE = 20, 12
"""Letters of rooms and of objects, pixels."""
_MIN_SHOWN = 30
"""Pixels from which an object is named."""
_PAPER = (255, 255, 255)
_INK = (30, 30, 36)


class _Name(NamedTuple):
    """Words at a place of the world."""

    text: str
    xz: tuple[float, float]


def storey_picture(scene: Scene, plan: HomePlan | None, floor_y: float, *, size: tuple[int, int]) -> Image.Image:
    """A storey from above, at most `size` = (width, height) pixels large, north (-z) up.

    Args:
        plan: Its plan, which names rooms; None = rooms have no names.
        floor_y: One of the scene's storey heights, metres.
    """
    mesh = storey_mesh(scene, floor_y)
    used = mesh.vertices[np.unique(mesh.faces)].astype(float)
    low, high = used.min(axis=0) - _BORDER, used.max(axis=0) + _BORDER
    scale = min(size[0] / (high[0] - low[0]), size[1] / (high[2] - low[2]))
    width, height = (max(16, int(scale * (high[axis] - low[axis]))) for axis in (0, 2))
    eye_y = float(high[1]) + _ABOVE
    depth = eye_y - floor_y
    camera = Camera(width, height, hfov_deg=math.degrees(2 * math.atan(width / 2 / (scale * depth))))
    middle = (low + high) / 2
    T_world_down = np.eye(4)
    T_world_down[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # picture right = +x, picture down = +z, ahead = -y
    T_world_down[:3, 3] = middle[0], eye_y, middle[2]
    frame = Raycaster(mesh).render(T_world_down, camera)
    rgb = np.where((frame.rgb == SKY_RGB).all(axis=2, keepdims=True), np.uint8(255), frame.rgb)
    picture = Image.fromarray(rgb)
    counts = np.bincount(
        frame.instance_ids.ravel(), minlength=1 + max((o.instance_id for o in scene.objects), default=0)
    )
    shown = sorted(
        (item for item in scene.objects if counts[item.instance_id] >= _MIN_SHOWN),
        key=lambda item: (-counts[item.instance_id], item.instance_id),
    )
    rooms = [] if plan is None else _room_names(plan, floor_y)
    words = [_Name(item.category, (item.centre[0], item.centre[2])) for item in shown]
    corner = (float(middle[0] - width / 2 / scale), float(middle[2] - height / 2 / scale))
    view = PlanView(corner, scale, width, height)
    _write(picture, view, rooms, words)
    return picture


def _room_names(plan: HomePlan, floor_y: float) -> list[_Name]:
    """Each room of the storey at a place well inside it."""
    index = int(nearest_storey(floor_y, [storey.floor_y for storey in plan.storeys]))
    if not same_storey(plan.storeys[index].floor_y, floor_y):
        return []
    rooms = [room for room in plan.rooms if room.storey == index]
    return [_Name(room.name, xz) for room in rooms if (xz := room_middle(room, plan)) is not None]


def _write(picture: Image.Image, view: PlanView, rooms: Sequence[_Name], words: Sequence[_Name]) -> None:
    """Rooms in large letters, then objects in small ones wherever nothing is written yet."""
    draw = ImageDraw.Draw(picture)
    taken: list[tuple[float, float, float, float]] = []
    for names, size, fill in ((rooms, _NAME_SIZE, _INK), (words, _WORD_SIZE, _PAPER)):
        font = ImageFont.load_default(size=size)
        for text, xz in names:
            right, down = view.pixels(xz).tolist()
            at = (right, down)
            low_x, low_y, high_x, high_y = draw.textbbox(at, text, font=font, anchor="mm")
            box = low_x - 3, low_y - 2, high_x + 3, high_y + 2
            if size == _WORD_SIZE and any(_overlap(box, other) for other in taken):
                continue
            taken.append(box)
            draw.rectangle(box, fill=fill, outline=_INK if fill == _INK else None)
            draw.text(at, text, font=font, anchor="mm", fill=_PAPER if fill == _INK else _INK)


def _overlap(box: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]
