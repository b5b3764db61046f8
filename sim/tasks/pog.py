"""POG: point at the object. `PogScene` intersects a person's click with the cut storey that the browser shows.

It also draws that storey, for browsers that do not get a copy of it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sim.copies.cut import storey_cut, storey_mesh
from sim.mesh import Scene, SceneObject, TriangleMesh
from sim.render.renderer import Renderer
from sim.types import Camera

_ONE_RAY = Camera(width=1, height=1, hfov_deg=1.0)
"""A picture of one pixel, which sees what a ray through its middle meets."""


class PogScene:
    """The cut storeys of one scene, each with a renderer that finds the point under a click."""

    def __init__(self, scene: Scene, *, make_renderer: Callable[[TriangleMesh], Renderer]) -> None:
        """Cuts every storey once; `make_renderer` builds a renderer of a mesh, such as `sim.render.raycast.Raycaster`.

        Raises:
            SceneError: A storey has no faces.
        """
        self.storeys = scene.navigation.storey_heights
        self._renderers = [make_renderer(storey_mesh(scene, floor_y)) for floor_y in self.storeys]
        self._cuts = [storey_cut(scene, floor_y) for floor_y in self.storeys]
        self._objects = {item.instance_id: item for item in scene.objects if item.instance_id}

    def picture(self, storey: int, T_world_camera: NDArray[np.float64], camera: Camera) -> NDArray[np.uint8]:
        """The storey with this index as a camera (4, 4; OpenCV axes) sees it, cut as for `hit`, on white: (H, W, 3)."""
        frame = self._renderers[storey].render(T_world_camera, camera)
        return np.where(frame.depth_m[..., None] > 0, frame.rgb, np.uint8(255))

    def hit(
        self, storey: int, origin: Sequence[float], direction: Sequence[float]
    ) -> tuple[float, float, float] | None:
        """World point at which a ray (origin in metres, direction of any length) first meets the storey with this index
        into `storeys`; None when it meets nothing.
        """
        hits = self._renderers[storey].cast(np.array([origin], float), np.array([direction], float))
        if not np.isfinite(hits.range_m[0]):
            return None
        x, y, z = hits.positions[0]
        return (float(x), float(y), float(z))

    def object_at(self, storey: int, origin: Sequence[float], direction: Sequence[float]) -> SceneObject | None:
        """The object that a ray, as for `hit`, meets first; None where it meets nothing, or what is no object."""
        forward = np.array(direction, float)
        length = float(np.linalg.norm(forward))
        if not np.isfinite([*origin, length]).all() or length == 0:
            return None
        T_world_ray = np.eye(4)
        T_world_ray[:3, 2] = forward / length
        T_world_ray[:3, 0] = np.linalg.svd(T_world_ray[None, :3, 2])[2][1]  # any direction at a right angle to it
        T_world_ray[:3, 1] = np.cross(T_world_ray[:3, 2], T_world_ray[:3, 0])
        T_world_ray[:3, 3] = origin
        seen = self._renderers[storey].render(T_world_ray, _ONE_RAY).instance_ids
        return self._objects.get(int(seen[0, 0]))

    def middle_of(self, storey: int, item: SceneObject) -> tuple[float, float, float]:
        """The middle of an object's box (world metres), no higher or lower than the storey is shown."""
        x, y, z = item.centre
        bottom_y, top_y = self._cuts[storey]
        return (x, min(max(y, bottom_y), top_y), z)
