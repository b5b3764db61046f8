"""The two things that participants look at and point at in 3-D: a home, one cut storey at a time, and its map.

The map is a storey's picture from above on the storey's floor, so a click is a place. The browser sends the ray of a
click. The place is the point where the ray meets the floor's plane, exact to the rounding of the browser's numbers, at
any zoom, pixel density or camera angle.
"""

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np
import viser
from numpy.typing import NDArray

from human_study.trial.commands import Click
from human_study.trial.views import Mark, MarkedObject
from sim.copies.browser_glb import browser_glb
from sim.copies.cut import storey_cut
from sim.mesh import Scene, SceneObject
from sim.tasks.run_files import ClickRay, Vector3

from .looks import BOX_CORNERS, FIT, FirstLook, look_from_above, place_camera, window_aspect
from .names import HomeNames, Name, NamesOf, no_names
from .top_view import MARGIN, STRIP, TopView, top_views

MARK_COLOR = (214, 0, 110)
JPEG_QUALITY = 90
_BALL = 0.12
"""Radius of a mark in the home (metres)."""
_LABEL = 0.3
"""Height of a mark's label over its ball (metres)."""
_DOT = 0.05
"""Radius of the dot where the click met an object (metres)."""
_OUTLINE = 0.03
"""Thickness of the lines around a marked object (metres)."""
_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
"""The edges of a box as pairs of BOX_CORNERS."""
_ABOVE = 0.02
"""Height of the mark over the map (metres)."""
_QUAT_WXYZ_LYING = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Turns viser's upright pictures (right = x, down = y) onto the floor: right = +x, down = +z."""


class StoreyCopies:
    """The browser copies of one scene's storeys, made once and shared by all browsers of a process."""

    def __init__(self, scene: Scene, names: Sequence[str] = ()) -> None:
        """Cuts every storey; `glbs` makes the copies.

        Args:
            names: Name of each storey on its map (`top_views`).

        Raises:
            SceneError: A storey has no faces.
        """
        self.scene, self._names = scene, names
        self.storeys = scene.navigation.storey_heights
        self.cuts = tuple(storey_cut(scene, floor_y) for floor_y in self.storeys)

    @functools.cached_property
    def glbs(self) -> tuple[bytes, ...]:
        """Each storey as a GLB file, made or read from the cache at the first access.

        Raises:
            SceneError: A storey has no faces.
        """
        with ThreadPoolExecutor() as pool:
            return tuple(pool.map(lambda floor_y: browser_glb(self.scene, floor_y), self.storeys))

    @functools.cached_property
    def maps(self) -> tuple[TopView, ...]:
        """Each storey from above, made or read at the first access; the first time on a machine takes some seconds.

        Raises:
            SceneError: A storey has no faces.
        """
        return top_views(self.scene, self._names)

    def objects(self, index: int) -> list[SceneObject]:
        """The objects of a storey, in the order of the scene."""
        bottom_y, top_y = self.cuts[index]
        return [item for item in self.scene.objects if bottom_y <= item.centre[1] <= top_y]

    def walkable_xz(self, index: int) -> NDArray[np.float64]:
        """World (x, z) of the walkable places of a storey, (N, 2)."""
        free, grid, _ = self.scene.navigation.top_down(self.storeys[index])
        return grid.xz_from_rc(np.argwhere(free))

    @functools.cached_property
    def extent_xz(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World (x, z) of the lowest and highest corner around the walkable places of all storeys, with a margin."""
        xz = np.concatenate([self.walkable_xz(index) for index in range(len(self.storeys))])
        return xz.min(axis=0) - MARGIN, xz.max(axis=0) + MARGIN

    def middle(self, index: int) -> tuple[float, float]:
        """World (x, z) of the walkable place of a storey that is nearest to the mean of them all."""
        xz = self.walkable_xz(index)
        x, z = xz[np.linalg.norm(xz - xz.mean(axis=0), axis=1).argmin()]
        return float(x), float(z)


class Surface(ABC):
    """A storey at a time in one browser, and a mark on it."""

    is_map: ClassVar[bool]
    """Whether it is a picture from above."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Shows nothing yet."""
        self._client = client
        self._nodes: list[Any] = []
        self._marks: list[Any] = []
        self._index = 0
        self._floor_y: float | None = None
        """Floor height of the shown storey; None before the first one."""
        self._first_look: FirstLook | None = None

    def show_storey(self, index: int) -> None:
        """Shows one storey, without a mark.

        At first the camera looks at the whole home from above; afterwards it goes up or down with the storeys.
        """
        self.remove()
        floor_y, before = self._floor(index), self._floor_y
        self._index, self._floor_y = index, floor_y
        camera = self._client.camera
        if before is None:
            self._first_look = FirstLook(camera, lambda: self._look_at_home(self._index))
        elif before != floor_y:
            target = np.asarray(camera.look_at, float)
            offset = np.asarray(camera.position, float) - target
            place_camera(camera, target + np.array([0.0, floor_y - before, 0.0]), offset)
        self._show(index)
        self._client.flush()

    @abstractmethod
    def _floor(self, index: int) -> float:
        """Floor height of a storey, metres."""

    @abstractmethod
    def _look_at_home(self, index: int) -> None:
        """Looks at all of a storey, from so far that no other storey reaches out of the window."""

    @abstractmethod
    def _show(self, index: int) -> None:
        """Shows a storey."""

    async def camera_moved(self, camera: viser.CameraHandle) -> None:
        """Hears of each change of the browser's camera; a window of another shape gets its own first look."""
        if self._first_look is not None and self._first_look.renew():
            self._client.flush()

    def show_marks(self, marks: Sequence[tuple[Mark, str]]) -> None:
        """Shows the participant's marks with their labels in place of older ones.

        The object of a mark is outlined, with a dot at the click. The dot moves with every nudge, also while the mark
        stays in the middle of the same object.
        """
        self.hide_marks()
        for number, (mark, label) in enumerate(marks):
            at = f"/mark{number}"
            if mark.item is None:
                self._marks += self._mark_at(at, mark.point, label)
                continue
            x, y, z = mark.hit
            self._marks += self._mark_on(at, mark.point, label, mark.item)
            self._marks.append(add_ball(self._client, f"{at}/hit", _DOT, (x, y + (_ABOVE if self.is_map else 0.0), z)))
        self._client.flush()

    def hide_marks(self) -> None:
        """Takes all marks away."""
        for node in self._marks:
            node.remove()
        self._marks = []

    def remove(self) -> None:
        """Takes everything out of the browser."""
        self.hide_marks()
        for node in self._nodes:
            node.remove()
        self._nodes = []

    @abstractmethod
    def _mark_at(self, at: str, position: Vector3, label: str) -> list[Any]:
        """The nodes of a mark at a point, below the name `at`."""

    @abstractmethod
    def _mark_on(self, at: str, position: Vector3, label: str, item: MarkedObject) -> list[Any]:
        """The nodes of a mark in the middle of an object, with the object's outline."""

    def _outline(self, at: str, segments: NDArray[np.float64]) -> Any:
        """Lines (N, 2, 3) of a mark's colour, world metres."""
        lines = segments.astype(np.float32)
        return self._client.scene.add_line_segments(f"{at}/outline", lines, MARK_COLOR, thickness=_OUTLINE)


class HomeSurface(Surface):
    """A home with the names of its things and rooms, as far as the study shows them."""

    is_map = False

    def __init__(self, client: viser.ClientHandle, copies: StoreyCopies, names_of: NamesOf = no_names) -> None:
        """Shows nothing yet; light is off because the homes carry theirs."""
        super().__init__(client)
        self._copies, self._names_of = copies, names_of
        self._names, self._asks_names = HomeNames(client), False
        client.scene.configure_default_lights(True, cast_shadow=False)

    async def camera_moved(self, camera: viser.CameraHandle) -> None:
        """Lays out the names anew."""
        await super().camera_moved(camera)
        await self._names.camera_moved()

    def ask_names(self, *, is_asked: bool) -> None:
        """Shows the names that are shown on demand, or takes them away."""
        if is_asked != self._asks_names:
            self._asks_names = is_asked
            self._names.show(self._names_of(self._index, is_asked))

    def remove(self) -> None:
        """Takes everything out of the browser."""
        super().remove()
        self._names.remove()

    def show_marks(self, marks: Sequence[tuple[Mark, str]]) -> None:
        """Shows the participant's marks; the names in the home keep their labels free."""
        super().show_marks(marks)
        self._names.keep_free([_label_of(mark, label) for mark, label in marks])

    def _show(self, index: int) -> None:
        self._show_home(index)
        self._names.show(self._names_of(index, self._asks_names))

    @abstractmethod
    def _show_home(self, index: int) -> None:
        """Shows the storey itself."""

    def _mark_at(self, at: str, position: Vector3, label: str) -> list[Any]:
        ball = add_ball(self._client, f"{at}/ball", _BALL, position)
        add_label = self._client.scene.add_label
        # goes with its parent
        add_label(f"{at}/ball/label", label, position=(0.0, _LABEL, 0.0), anchor="center-center")
        return [ball]

    def _mark_on(self, at: str, position: Vector3, label: str, item: MarkedObject) -> list[Any]:
        marked = self._mark_at(at, _ball_on(position, item), label)
        return [self._outline(at, box_edges(item.centre, item.size)), *marked]

    def _floor(self, index: int) -> float:
        return self._copies.storeys[index]

    def _look_at_home(self, index: int) -> None:
        low_xz, high_xz = self._copies.extent_xz
        floor_y, top_y = self._copies.storeys[index], self._copies.cuts[index].top_y
        low, high = np.insert(low_xz, 1, floor_y), np.insert(high_xz, 1, top_y)
        look_from_above(self._client.camera, low, high)


class SceneView(HomeSurface):
    """A home whose copies the browser has and draws."""

    def _show_home(self, index: int) -> None:
        self._nodes.append(self._client.scene.add_glb("/home", self._copies.glbs[index]))


class MapView(Surface):
    """The maps of a home."""

    is_map = True

    def __init__(self, client: viser.ClientHandle, maps: tuple[TopView, ...]) -> None:
        """Shows nothing yet."""
        super().__init__(client)
        self._maps = maps

    def _floor(self, index: int) -> float:
        return self._maps[index].floor_y

    def _look_at_home(self, index: int) -> None:
        """Looks straight down; the pictures of all storeys have the same ground."""
        centre, (width, height) = self._ground(index)
        camera = self._client.camera
        distance = FIT * max(height, width / window_aspect(camera)) / 2 / math.tan(camera.fov / 2)
        place_camera(camera, centre, (0.0, distance, 0.0), up=(0.0, 0.0, -1.0))

    def _ground(self, index: int) -> tuple[Vector3, tuple[float, float]]:
        """Middle of a storey's picture, strip included, and its sides along x and z, world metres."""
        view = self._maps[index]
        rows, cols = view.grid.shape
        width, height = cols * view.grid.cell, (rows + STRIP) * view.grid.cell
        x, z = view.grid.origin_xz
        return (x + width / 2, view.floor_y, z + height / 2), (width, height)

    def _show(self, index: int) -> None:
        centre, sides = self._ground(index)
        picture = self._client.scene.add_image(
            "/map",
            self._maps[index].rgb(),
            *sides,
            format="jpeg",
            jpeg_quality=JPEG_QUALITY,
            cast_shadow=False,
            receive_shadow=False,
            wxyz=_QUAT_WXYZ_LYING,
            position=centre,
        )
        self._nodes.append(picture)

    def _mark_at(self, at: str, position: Vector3, label: str) -> list[Any]:
        """A ring with a dot, large enough to see, small enough to aim."""
        x, y, z = position
        ring = np.array([[math.cos(a), 0.0, math.sin(a)] for a in np.linspace(0, 2 * math.pi, 49)]) * 0.3
        segments = np.stack([ring[:-1], ring[1:]], axis=1) + np.array([x, y + _ABOVE, z])
        return [
            self._client.scene.add_line_segments(f"{at}/ring", segments, MARK_COLOR, thickness=0.05),
            add_ball(self._client, f"{at}/dot", 0.06, (x, y + _ABOVE, z)),
            self._client.scene.add_label(f"{at}/label", label, position=(x, y + 0.05, z - 0.45)),
        ]

    def _mark_on(self, at: str, position: Vector3, label: str, item: MarkedObject) -> list[Any]:
        """The outline of the object from above, and a dot in its middle, on the floor."""
        x, _, z = position
        y = (self._floor_y or 0.0) + _ABOVE
        edges = box_edges(item.centre, item.size)[:4] * np.array([1.0, 0.0, 1.0]) + np.array([0.0, y, 0.0])
        return [
            self._outline(at, edges),
            add_ball(self._client, f"{at}/dot", 0.06, (x, y, z)),
            self._client.scene.add_label(f"{at}/label", label, position=(x, y + 0.05, z - item.size[2] / 2 - 0.15)),
        ]


def _ball_on(position: Vector3, item: MarkedObject) -> Vector3:
    """The place of a mark's ball on the object's box, because in it nobody would see it."""
    return (position[0], item.centre[1] + item.size[1] / 2 + _BALL, position[2])


def _label_of(mark: Mark, label: str) -> Name:
    """A mark's label with its place in the home."""
    x, y, z = mark.point if mark.item is None else _ball_on(mark.point, mark.item)
    return Name(label, (x, y + _LABEL, z))


def box_edges(
    centre: Sequence[float] | NDArray[np.floating], size: Sequence[float] | NDArray[np.floating]
) -> NDArray[np.float64]:
    """The 12 edges (12, 2, 3) of an upright box; the first four are those of its bottom."""
    corners = np.asarray(centre, float) + BOX_CORNERS * np.asarray(size, float) / 2
    return corners[np.array(_EDGES)]


def add_ball(client: viser.ClientHandle, name: str, radius: float, position: Vector3) -> Any:
    """A ball of a mark's colour. viser's standard material keeps a computer without GPU busy for five seconds."""
    return client.scene.add_icosphere(
        name, radius, MARK_COLOR, material="toon5", cast_shadow=False, receive_shadow=False, position=position
    )


def map_click(view: TopView, ray: ClickRay) -> Click:
    """The click of a ray on a storey's picture: the hit is the place of its pixel, on the storey's floor.

    Args:
        view: The picture of the shown storey.
        ray: The ray from the browser; its `storey_y` must be the storey's.

    Returns:
        A click that hit nothing where the ray goes past the picture, or to the strip below it.
    """
    assert ray.storey_y == view.floor_y, (ray.storey_y, view.floor_y)
    down = ray.origin[1] - view.floor_y
    if ray.direction[1] * down >= 0:
        return Click(ray, None)
    t = -down / ray.direction[1]
    pixel = view.pixel_at((ray.origin[0] + t * ray.direction[0], ray.origin[2] + t * ray.direction[2]))
    return Click(ray, None if pixel is None else pixel.point(view.floor_y), pixel)
