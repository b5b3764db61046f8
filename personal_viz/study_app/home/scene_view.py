"""A home in a participant's 3-D view: one cut storey at a time, labels on plain homes, and the participant's mark."""

import functools
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import viser

from sim.copies.browser_glb import browser_glb
from sim.copies.cut import storey_cut
from sim.mesh import Scene
from sim.tasks.run_files import Vector3

from .top_view import TopView, top_views

MARK_COLOR = (214, 0, 110)
VIEW_ANGLE = math.radians(55)
"""Elevation from which a storey is first shown."""


class StoreyCopies:
    """The browser copies of one scene's storeys, made once and shared by all participants of a worker."""

    def __init__(self, scene: Scene) -> None:
        """Makes every copy, or reads it from the cache.

        Raises:
            SceneError: A storey has no faces.
        """
        self.scene = scene
        self.storeys = scene.navigation.storey_heights
        self.cuts = tuple(storey_cut(scene, floor_y) for floor_y in self.storeys)
        with ThreadPoolExecutor() as pool:
            self.glbs = tuple(pool.map(lambda floor_y: browser_glb(scene, floor_y), self.storeys))

    @functools.cached_property
    def maps(self) -> tuple[TopView, ...]:
        """Each storey from above, made or read at the first access; the first time on a machine takes some seconds.

        Raises:
            SceneError: A storey has no faces.
        """
        return top_views(self.scene)

    def middle(self, index: int) -> tuple[float, float]:
        """World (x, z) of the walkable place of a storey that is nearest to the mean of them all."""
        top_down = self.scene.navigation.top_down(self.storeys[index])
        xz = top_down.grid.xz_from_rc(np.argwhere(top_down.free))
        x, z = xz[np.linalg.norm(xz - xz.mean(axis=0), axis=1).argmin()]
        return float(x), float(z)


class SceneView:
    """The scene in one browser."""

    advice = "Drag to turn, scroll to zoom, right-drag to move."
    is_map = False

    def __init__(self, client: viser.ClientHandle, copies: StoreyCopies) -> None:
        """Shows nothing yet; light is off because the copies carry theirs."""
        self._client = client
        self._copies = copies
        self._nodes: list = []
        self._mark: list = []
        client.scene.configure_default_lights(True, cast_shadow=False)

    def show_storey(self, index: int, *, move_camera: bool = True) -> None:
        """Shows one storey and, unless told otherwise, looks at all of it from above."""
        self.remove()
        scene = self._copies.scene
        self._nodes.append(self._client.scene.add_glb("/home", self._copies.glbs[index]))
        floor_y = self._copies.storeys[index]
        if scene.kind != "scan":
            self._label_objects(index)
        if move_camera:
            self._look_at_storey(floor_y)
        self._client.flush()

    def show_mark(self, position: Vector3) -> None:
        """Puts the participant's mark where the click met the home."""
        for node in self._mark:
            node.remove()
        self._mark = [self._client.scene.add_icosphere("/mark", radius=0.12, color=MARK_COLOR, position=position)]
        self._client.scene.add_label("/mark/label", "your mark", position=(0.0, 0.3, 0.0))  # goes with its parent
        self._client.flush()

    def remove(self) -> None:
        """Removes home, labels and mark."""
        for node in (*self._nodes, *self._mark):
            node.remove()
        self._nodes, self._mark = [], []

    def _label_objects(self, index: int) -> None:
        """Adds category names over the objects of a storey; homes made of boxes cannot be read without them.

        Nodes are numbered from one end of the home to the other, because instance numbers would identify the objects.
        """
        bottom_y, top_y = self._copies.cuts[index]
        items = [item for item in self._copies.scene.objects if bottom_y <= item.centre[1] <= top_y]
        for number, item in enumerate(sorted(items, key=lambda item: item.centre)):
            x, y, z = item.centre
            label = self._client.scene.add_label(
                f"/labels/{number}", item.category, position=(x, y + item.size[1] / 2 + 0.1, z)
            )
            self._nodes.append(label)

    def _look_at_storey(self, floor_y: float) -> None:
        top_down = self._copies.scene.navigation.top_down(floor_y)
        xz = top_down.grid.xz_from_rc(np.argwhere(top_down.free))
        low, high = xz.min(axis=0), xz.max(axis=0)
        x, z = (low + high) / 2
        centre = np.array([x, floor_y, z])
        distance = 0.62 * float(np.linalg.norm(high - low)) + 2.0
        offset = distance * np.array([0.0, math.sin(VIEW_ANGLE), math.cos(VIEW_ANGLE)])
        camera = self._client.camera
        with self._client.atomic():
            camera.up_direction = (0.0, 1.0, 0.0)
            camera.position = centre + offset
            camera.look_at = centre
