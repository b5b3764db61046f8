"""POG: point at the object. `PogScene` intersects a person's click with the cut storey that the browser shows.

It also draws that storey, for browsers that do not get a copy of it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sim.copies.cut import storey_mesh
from sim.mesh import Scene, TriangleMesh
from sim.render.renderer import Renderer
from sim.types import Camera


class PogScene:
    """The cut storeys of one scene, each with a renderer that finds the point under a click."""

    def __init__(self, scene: Scene, *, make_renderer: Callable[[TriangleMesh], Renderer]) -> None:
        """Cuts every storey once; `make_renderer` builds a renderer of a mesh, such as `sim.render.raycast.Raycaster`.

        Raises:
            SceneError: A storey has no faces.
        """
        self.storeys = scene.navigation.storey_heights
        self._renderers = [make_renderer(storey_mesh(scene, floor_y)) for floor_y in self.storeys]

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
