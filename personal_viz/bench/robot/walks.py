"""Simulated recordings: somebody carries an RGB-D camera through an invented home.

The camera is 1.25 to 1.59 m above the floor, tilted, rolled and swinging, at different speeds. Depth has holes, noise
that grows with distance, and edges that are mixed with what lies behind them, as real sensors give it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from sim.frames import R_agent_camera
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.types import Camera, Frame

CAMERA = Camera(320, 240, 62.7)
"""Half the resolution of a Kinect, and its field of view."""
RATE = 10.0
"""Pictures a second."""
_HEIGHTS, _SPEEDS = (1.25, 1.59), (0.3, 0.9)
"""Metres above the floor, metres a second."""
_TILTS, _SWAY = (-35.0, -5.0), 6.0
"""Mean tilt of a walk, and how far tilt and roll sway; degrees."""
_LOOK_AROUND, _TURN_S = 50.0, 0.5
"""The largest angle (degrees) at which the carrier looks aside; time (s) in which two thirds of a turn are made."""
_NEAREST, _FARTHEST = 0.4, 5.0
"""Metres between which the sensor gives depth."""
_HOLES = 0.06
"""Share of a picture without depth besides."""
_EDGE_M, _EDGE_PIXELS = 0.05, 3
"""Where depth jumps by more (metres), it is the mean over so many pixels."""


@dataclass(frozen=True, slots=True)
class Walk:
    """One recording, in the world frame of its home."""

    scene: Scene
    floor_y: float
    """Floor of the storey that is walked, world metres."""
    Ts_world_camera: NDArray[np.float64]
    """(N, 4, 4) poses of the camera, OpenCV axes."""
    seed: int

    def frames(self, *, with_ids: bool = False) -> Iterator[Frame]:
        """The pictures; the same walk gives the same bytes.

        Args:
            with_ids: Keep the simulator's ids, for perception by oracle; a real recording has none.
        """
        rng = np.random.default_rng([self.seed, 1])
        renderer = Raycaster(self.scene.mesh)
        for T in self.Ts_world_camera:
            frame = renderer.render(T, CAMERA)
            frame = replace(frame, depth_m=_sensed(frame.depth_m, rng))
            yield frame if with_ids else replace(frame, ids=None)


def handheld_walk(seed: int, *, num_frames: int = 300) -> Walk:
    """A walk through one storey of the invented home of this seed.

    Raises:
        SceneError: The seed gives no home.
    """
    scene = scene_from_plan(invent_plan(f"walk{seed}", seed=seed))
    rng = np.random.default_rng([seed, 0])
    storeys = scene.navigation.storey_heights
    floor_y = float(storeys[rng.integers(len(storeys))])
    seconds = np.arange(num_frames) / RATE
    feet = _carried_along(scene, floor_y, seconds * rng.uniform(*_SPEEDS), rng)
    yaw = _turned(feet, seconds, rng)
    tilt = np.radians(rng.uniform(*_TILTS) + _swaying(seconds, _SWAY, rng))
    roll = np.radians(rng.normal(0, 2) + _swaying(seconds, _SWAY / 2, rng))
    height = rng.uniform(*_HEIGHTS) + 0.02 * np.sin(2 * np.pi * 1.8 * seconds)
    Ts = np.tile(np.eye(4), (num_frames, 1, 1))
    R_world_agent = Rotation.from_euler("YXZ", np.column_stack([yaw, tilt, roll])).as_matrix()
    Ts[:, :3, :3] = R_world_agent @ R_agent_camera
    Ts[:, :3, 3] = feet + height[:, None] * np.array([0.0, 1.0, 0.0])
    return Walk(scene, floor_y, Ts, seed)


def _carried_along(
    scene: Scene, floor_y: float, path_m: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """(N, 3) places after so many metres (N,) of walking from one random place of a storey to the next."""
    line = [scene.navigation.random_point(rng, storey_y=floor_y)]
    done = 0.0
    while done <= path_m[-1]:
        path = scene.navigation.shortest_path(line[-1], scene.navigation.random_point(rng, storey_y=floor_y)[None])
        if path is not None and len(path) > 1:
            line.extend(path[1:])
            done += float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    points = np.array(line)
    along = np.concatenate([[0.0], np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()])
    return np.column_stack([np.interp(path_m, along, column) for column in points.T])


def _turned(feet: NDArray[np.float64], seconds: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """(N,) yaw, radians: along the path, smoothed, and looking aside now and then."""
    ahead = np.gradient(feet, axis=0)
    yaw = np.unwrap(np.arctan2(-ahead[:, 0], -ahead[:, 2]))
    smooth = ndimage.gaussian_filter1d(yaw, _TURN_S * RATE, mode="nearest")
    return smooth + np.radians(_swaying(seconds, _LOOK_AROUND, rng))


def _swaying(seconds: NDArray[np.float64], most: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(N,) a slow swing of several periods, at most `most` to each side."""
    periods, phases = rng.uniform(2, 12, 3), rng.uniform(0, 2 * np.pi, 3)
    return most * np.sin(2 * np.pi * seconds[:, None] / periods + phases).mean(axis=1)


def _sensed(depth_m: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Depth (H, W) as a sensor gives it; 0 = no return."""
    sharp = depth_m.astype(np.float64)
    low, high = (rank(sharp, size=_EDGE_PIXELS) for rank in (ndimage.minimum_filter, ndimage.maximum_filter))
    mixed = np.where(high - low > _EDGE_M, ndimage.uniform_filter(sharp, _EDGE_PIXELS), sharp)
    noise = 0.0012 + 0.0019 * (mixed - _NEAREST) ** 2  # Nguyen, Izadi and Lovell 2012, for the Kinect
    seen = mixed + rng.normal(size=mixed.shape) * noise
    speckle = ndimage.gaussian_filter(rng.normal(size=mixed.shape), 6)
    is_hole = speckle < np.quantile(speckle, _HOLES)
    is_seen = (seen >= _NEAREST) & (seen <= _FARTHEST) & (sharp > 0) & ~is_hole
    return np.where(is_seen, np.round(seen * 1000) / 1000, 0).astype(np.float32)
