"""Names over the things and rooms of a home in one browser: none covers another, and no wall hides one.

viser draws labels of a fixed size at places of the world, over everything else, and knows nothing of other labels. So
the server lays them out for the browser's camera: a name that would cover another is moved beside its thing on the
screen, or left out until one comes closer. While the camera moves they are away; they come back when it rests.
"""

import asyncio
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
import viser.transforms
from numpy.typing import NDArray

from sim.homes.plan import HomePlan, room_middle
from sim.mesh import SceneObject
from sim.tasks.run_files import Vector3
from sim.walk.storeys import nearest_storey, same_storey

from .top_view import Box, free_place

REST_S = 0.15
"""A camera that has not moved for so long rests."""
LETTER_PX, LINE_PX, PADDING_PX = 7.0, 20.0, 10.0
"""Width of a letter, height of a label, and by how much it is wider than its letters, pixels. viser's em has 12."""
_RINGS = 3
"""A name is moved by fewer lines than this; further away nobody would know what it names."""
_OVER = 0.1
"""Height of a name over its object or floor (metres)."""
_NEAR = 0.1
"""Nothing nearer to the camera than this is named (metres)."""


@dataclass(frozen=True, slots=True)
class Name:
    """A name and its place, world metres."""

    text: str
    place: Vector3


NamesOf = Callable[[int, bool], Sequence[Name]]
"""(index of a storey, whether names on demand are wanted) -> the names to show, the most important ones first."""


def no_names(index: int, is_asked: bool) -> Sequence[Name]:
    """No names on any storey."""
    return ()


def names_of_objects(objects: Sequence[SceneObject]) -> list[Name]:
    """Categories over objects, the largest first; walls, floors and other parts of the building have none."""
    named = [item for item in objects if not item.is_building]
    named.sort(key=lambda item: (-item.size[0] * item.size[2], item.centre))
    above = [(item.centre[0], item.centre[1] + item.size[1] / 2 + _OVER, item.centre[2]) for item in named]
    return [Name(item.category, place) for item, place in zip(named, above, strict=True)]


def names_of_rooms(plan: HomePlan, heights: Sequence[float]) -> tuple[tuple[Name, ...], ...]:
    """Names of the rooms of each storey whose floor height (metres) is given, in the middle of each room."""
    found: list[list[Name]] = [[] for _ in heights]
    for room in plan.rooms:
        floor_y, xz = plan.storeys[room.storey].floor_y, room_middle(room, plan)
        index = int(nearest_storey(floor_y, heights))
        if xz is not None and same_storey(floor_y, heights[index]):
            found[index].append(Name(room.name[:1].upper() + room.name[1:], (xz[0], heights[index] + _OVER, xz[1])))
    return tuple(tuple(names) for names in found)


class HomeNames:
    """The names of one storey at a time; the participant's thread and viser's loop may both use them."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Shows nothing yet."""
        self._client = client
        self._lock = threading.RLock()
        """Held while labels change: viser refuses to change one that was removed."""
        self._root: Any = None
        self._labels: list[tuple[Name, Any]] = []
        self._marks: list[Name] = []
        self._move = 0
        """Number of the camera's last move."""

    def show(self, names: Sequence[Name]) -> None:
        """Shows these names in place of others; the first ones are the last to be left out."""
        with self._lock:
            self.remove()
            if not names:
                return
            self._root = self._client.scene.add_frame("/labels", show_axes=False)
            add = self._client.scene.add_label
            self._labels = [
                (name, add(f"/labels/{number}", name.text, position=name.place, anchor="center-center", visible=False))
                for number, name in enumerate(names)
            ]
            self._lay_out()

    def keep_free(self, marks: Sequence[Name]) -> None:
        """Keeps room for the labels of the participant's marks, which are drawn elsewhere."""
        with self._lock:
            if list(marks) != self._marks:
                self._marks = list(marks)
                self._lay_out()

    def remove(self) -> None:
        """Takes the names out of the browser."""
        with self._lock:
            if self._root is not None:
                self._root.remove()  # with all that stands on it
            self._root, self._labels = None, []

    async def camera_moved(self) -> None:
        """Takes the names away until the camera rests."""
        self._move += 1
        move = self._move
        with self._lock:
            if self._root is None:
                return
            if self._root.visible:
                self._root.visible = False
        await asyncio.sleep(REST_S)
        with self._lock:
            if move == self._move:
                self._lay_out()

    def _lay_out(self) -> None:
        """Moves every name to its place for the present camera; needs the lock."""
        if self._root is None:
            return
        camera = self._client.camera
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3] = viser.transforms.SO3(np.asarray(camera.wxyz, float)).as_matrix()
        T_world_camera[:3, 3] = camera.position
        window = (float(camera.image_width), float(camera.image_height))
        first = len(self._marks)
        names = [*self._marks, *(name for name, _ in self._labels)]
        places = laid_out(names, T_world_camera, window=window, fov=float(camera.fov))[first:]
        with self._client.atomic():
            for (_, label), place in zip(self._labels, places, strict=True):
                if place is not None and place != tuple(label.position):
                    label.position = place
                if label.visible != (place is not None):
                    label.visible = place is not None
            self._root.visible = True
        self._client.flush()


def laid_out(
    names: Sequence[Name], T_world_camera: NDArray[np.float64], *, window: tuple[float, float], fov: float
) -> list[Vector3 | None]:
    """Place of each name in the world, at which no label covers another in the window; None = there is no room for it.

    Args:
        names: The most important ones first.
        T_world_camera: Pose (4, 4) of the camera, OpenCV axes.
        window: Width and height, pixels.
        fov: Vertical field of view, radians.
    """
    width, height = window
    focal = height / 2 / math.tan(fov / 2)
    T_camera_world = np.linalg.inv(T_world_camera)
    taken: list[Box] = []
    places: list[Vector3 | None] = []
    for name in names:
        x, y, z = (T_camera_world @ [*name.place, 1.0])[:3].tolist()
        u, v = (width / 2 + focal * x / z, height / 2 + focal * y / z) if z > _NEAR else (math.inf, math.inf)
        found = None
        if 0 <= u <= width and 0 <= v <= height:
            half = (LETTER_PX * len(name.text) + PADDING_PX) / 2
            found = free_place((u - half, v - LINE_PX / 2, u + half, v + LINE_PX / 2), taken, rings=_RINGS)
        if found is None:
            places.append(None)
            continue
        box, du, dv = found
        taken.append(box)
        moved = T_world_camera @ [x + du * z / focal, y + dv * z / focal, z, 1.0]
        places.append((float(moved[0]), float(moved[1]), float(moved[2])) if (du, dv) != (0.0, 0.0) else name.place)
    return places
