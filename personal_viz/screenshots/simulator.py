"""The simulator in one picture for the README: colour, depth and object ids of one view, and the map with a path."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.episodes.schema import Episode
from sim.frames import T_world_camera, yaw_towards
from sim.homes.renderers import raycaster_of
from sim.mesh import Scene
from sim.plan_view.axes import draw_free_floor
from sim.tasks.rules import success_region
from sim.types import STOREY_GAP, Camera, Pose


def draw_simulator(scene: Scene, episode: Episode, path: Path) -> None:
    """Writes what a robot near the end of an episode's shortest path sees, and the path on its storey's map."""
    way = scene.navigation.shortest_path(np.array(episode.start.position), success_region(episode, scene.navigation))
    assert way is not None, episode.key
    back = way[-2] - way[-1]
    x, y, z = (float(value) for value in way[-1] + min(1.5 / max(float(np.linalg.norm(back)), 1e-9), 2 / 3) * back)
    target = episode.targets[0].position
    pose = Pose((x, y, z), yaw_towards((x, z), (target[0], target[2])))
    frame = raycaster_of(scene).render(T_world_camera(pose, Camera()), Camera())
    figure = Figure(figsize=(15, 3.3), dpi=100, layout="constrained")
    colour, depth, ids, top_down = figure.subplots(1, 4)
    colour.imshow(frame.rgb)
    colour.set_title("colour")
    shown = depth.imshow(np.where(frame.depth_m > 0, frame.depth_m, np.nan), cmap="viridis")
    figure.colorbar(shown, ax=depth, shrink=0.8, label="metres")
    depth.set_title("planar depth")
    ids.imshow(np.where(frame.instance_ids > 0, frame.instance_ids % 20, np.nan), cmap="tab20", interpolation="nearest")
    ids.set_title("object ids")
    for axes in (colour, depth, ids):
        axes.set_axis_off()
    _draw_map(top_down, scene, way, pose)
    figure.suptitle(scene.label, fontsize=9)
    figure.savefig(path)


def _draw_map(axes: Axes, scene: Scene, way: np.ndarray, pose: Pose) -> None:
    storey_y = min(scene.navigation.storey_heights, key=lambda y: abs(y - pose.position[1]))
    free, grid, _ = scene.navigation.top_down(storey_y)
    draw_free_floor(axes, free, grid)
    here = np.abs(way[:, 1] - storey_y) < STOREY_GAP
    axes.plot(way[here, 0], way[here, 2], color="#d6006e", linewidth=2)
    axes.plot(pose.position[0], pose.position[2], marker="o", color="#1f5fa8")
    axes.set_title("free space and shortest path")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
