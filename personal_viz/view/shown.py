"""A scan that is ready to be looked at: its browser copies, and what a click meets.

A file -> `ShownScan`. A scan in which the robot can stand nowhere is shown whole, for looking and pointing.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.copies.browser_glb import whole_glb
from sim.errors import NoFloorError
from sim.frames import T_world_camera
from sim.homes.open_home import open_scan
from sim.mesh import Scene, SceneObject, TriangleMesh
from sim.render.raycast import Raycaster
from sim.scans.meshes import load_mesh
from sim.scans.up_axis import Up, up_axis
from sim.tasks.pog import PogScene
from sim.types import Camera, Pose
from sim.walk.navigation_map import NavigationMap

from ..study_app.home.surfaces import StoreyCopies

Point = tuple[float, float, float]
"""World metres, y up."""


class Part(NamedTuple):
    """What a browser shows at once: a storey, cut below its ceiling, or a whole scan without floor."""

    glb: bytes
    floor_y: float
    top_y: float
    low_xz: tuple[float, float]
    high_xz: tuple[float, float]
    """Bounds of its floor, or of all of it, world metres."""


@dataclass(frozen=True, slots=True)
class ShownScan:
    """A scan, opened."""

    name: str
    mesh: TriangleMesh
    parts: tuple[Part, ...]
    """Its storeys from below, at least one part."""
    hit: Callable[[int, Sequence[float], Sequence[float]], Point | None]
    """The place where a ray (origin, direction) first meets a part; None where it meets nothing."""
    caster: Raycaster
    navigation: NavigationMap | None
    """None where the robot can stand nowhere."""
    objects: tuple[SceneObject, ...] = ()
    """Those of its semantics."""
    notes: tuple[str, ...] = ()
    """What a person should know of it, one sentence each."""

    def picture(self, pose: Pose) -> NDArray[np.uint8]:
        """Colours (H, W, 3) that the robot sees there."""
        return self.caster.render(T_world_camera(pose, Camera()), Camera()).rgb

    def walk(self, start: Point, end: Point) -> float | None:
        """Metres on foot between the places to stand that are nearest to two points; None where there is no way."""
        if self.navigation is None:
            return None
        ends = [self.navigation.snap(np.array(point)) for point in (start, end)]
        if ends[0] is None or ends[1] is None:
            return None
        metres = float(self.navigation.distances(ends[0][None], ends[1][None])[0])
        return metres if np.isfinite(metres) else None


def open_shown(path: Path, *, up: Up | None = None) -> ShownScan:
    """Opens a scan with its browser copies, made once and then read from the cache.

    Raises:
        SceneError: The file is missing or damaged.
        MissingDependencyError: It needs an extra that is not installed.
    """
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            scene = open_scan(path, up=up)
        except NoFloorError as error:
            return _without_floor(path, up=up, why=str(error))
    notes = tuple(str(one.message) for one in said if issubclass(one.category, UserWarning))
    return _with_floor(scene, notes=notes)


def _with_floor(scene: Scene, *, notes: tuple[str, ...]) -> ShownScan:
    copies, cuts = StoreyCopies(scene), PogScene(scene, make_renderer=Raycaster)
    parts = []
    for index, floor_y in enumerate(copies.storeys):
        xz = copies.walkable_xz(index)
        parts.append(
            Part(copies.glbs[index], floor_y, copies.cuts[index].top_y, _pair(xz.min(axis=0)), _pair(xz.max(axis=0)))
        )
    caster = Raycaster(scene.mesh)
    return ShownScan(scene.name, scene.mesh, tuple(parts), cuts.hit, caster, scene.navigation, scene.objects, notes)


def _without_floor(path: Path, *, up: Up | None, why: str) -> ShownScan:
    mesh = load_mesh(path, up=up or up_axis(path, root=Path(path.anchor)) or "y")
    caster = Raycaster(mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)

    def hit(_: int, origin: Sequence[float], direction: Sequence[float]) -> Point | None:
        hits = caster.cast(np.array([origin], float), np.array([direction], float))
        x, y, z = hits.positions[0].tolist()
        return (x, y, z) if np.isfinite(hits.range_m[0]) else None

    part = Part(whole_glb(mesh), float(low[1]), float(high[1]), _pair(low[[0, 2]]), _pair(high[[0, 2]]))
    note = f"It opens for looking and pointing only: {why}"
    return ShownScan(path.name.split(".")[0], mesh, (part,), hit, caster, None, notes=(note,))


def _pair(values: NDArray[np.floating]) -> tuple[float, float]:
    x, z = values.tolist()
    return x, z
