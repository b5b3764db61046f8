"""All names of the program that the release tests use; when a module moves, only this file changes.

Most answers come from the command line. Python names are used only for answers that no verb prints: the objects,
distances and depth of a home. A recording is read with Rerun's own reader.
"""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.frames import T_world_camera
from sim.homes.open_home import open_scene
from sim.homes.renderers import renderer_of
from sim.mesh import Scene
from sim.types import Camera, Pose

CAMERA = Camera(width=64, height=48)
"""Camera of the depth pictures: the paper's field of view, a tenth of its pixels."""


def personal_viz(*arguments: str | Path) -> str:
    """Output of the command; if it fails, the assertion shows what it printed."""
    command = [sys.executable, "-m", "personal_viz", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "COLUMNS": "200"})
    assert done.returncode == 0, f"{' '.join(command[2:])} ended with {done.returncode}:\n{done.stderr}{done.stdout}"
    return done.stdout


@dataclass(frozen=True, slots=True)
class Home:
    """One opened home, seen through the interfaces that agents use."""

    scene: Scene

    @property
    def objects(self) -> dict[str, tuple[list[float], list[float]]]:
        """(centre, size along the world's axes) of each object by name, metres."""
        return {thing.name: ([*map(float, thing.centre)], [*map(float, thing.size)]) for thing in self.scene.objects}

    @property
    def storey_heights(self) -> tuple[float, ...]:
        """Floor heights of the storeys, world metres, ascending."""
        return self.scene.navigation.storey_heights

    def area(self, storey_y: float) -> float:
        """Walkable area of the storey at this height, square metres."""
        seen = self.scene.navigation.top_down(storey_y)
        return float(seen.free.sum()) * seen.grid.cell**2

    def place(self, rng: np.random.Generator) -> list[float]:
        """A random walkable point, world metres."""
        return [round(float(value), 4) for value in self.scene.navigation.random_point(rng)]

    def distance(self, start: list[float], goal: list[float]) -> float:
        """Geodesic metres; inf without a path."""
        return float(self.scene.navigation.distances(np.array([start]), np.array([goal]))[0])

    def depths(self, poses: list[tuple[list[float], float]]) -> list[NDArray[np.float32]]:
        """(H, W) planar depth in metres from each (position of the feet, yaw in radians), 0 = no return."""
        renderer = renderer_of(self.scene)
        at = [T_world_camera(Pose((x, y, z), yaw), CAMERA) for (x, y, z), yaw in poses]
        return [renderer.render(T, CAMERA).depth_m for T in at]


def open_home(dataset: Path, name: str) -> Home:
    """A home of the dataset without its scan: by its plan, or recovered from the episodes."""
    return Home(open_scene(PersonalDataset(dataset), name))


def recording_rows(rrd: Path) -> dict[str, dict[str, int]]:
    """Number of rows of each component by entity; static ones are listed apart, as `ENTITY (static)`."""
    from rerun.chunk import RrdReader

    reader = RrdReader(str(rrd))
    (store,) = reader.recordings()
    found: dict[str, dict[str, int]] = {}
    for chunk in reader.stream(store=store):
        rows = found.setdefault(chunk.entity_path + (" (static)" if chunk.is_static else ""), {})
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if not name.startswith("rerun."):
                rows[name] = rows.get(name, 0) + batch.num_rows - batch.column(name).null_count
    return {entity: dict(sorted(rows.items())) for entity, rows in sorted(found.items())}
