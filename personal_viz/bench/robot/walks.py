"""Simulated recordings: somebody carries an RGB-D camera through an invented home, in one of several ways (`WAYS`).

The camera is tilted, rolled and swinging, at different heights and speeds. Depth has holes, noise that grows with
distance, and edges that are mixed with what lies behind them, as real sensors give it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from sim.errors import SceneError
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
_TURN_S = 0.5
"""Time (s) in which two thirds of a turn are made."""
_DESK_DISTANCE, _DESK_STEP = (0.7, 1.6), 0.4
"""Metres between somebody and the thing looked at, and how far they step to each side."""
NEAREST, _FARTHEST = 0.4, 5.0
"""Metres between which the sensor gives depth."""
_HOLES = 0.06
"""Share of a picture without depth besides."""
_EDGE_M, _EDGE_PIXELS = 0.05, 3
"""Where depth jumps by more (metres), it is the mean over so many pixels."""


@dataclass(frozen=True, slots=True)
class Carrying:
    """A way of carrying the camera. Pairs are the limits between which each walk draws a value."""

    heights: tuple[float, float] = (1.25, 1.59)
    """Camera above the floor, metres."""
    bob: float = 0.02
    """Largest rise and fall in a step, metres."""
    speeds: tuple[float, float] = (0.3, 0.9)
    """Metres a second."""
    tilts_deg: tuple[float, float] = (-35.0, -5.0)
    """Mean tilt."""
    sway_deg: float = 6.0
    """How far tilt sways, and roll half as far."""
    roll_deg: float = 0.0
    """Mean roll: 90 = a telephone held upright."""
    look_around_deg: float = 50.0
    """Largest angle at which the carrier looks aside."""
    place: Literal["storey", "home", "desk"] = "storey"
    """Where the carrier goes: through one storey, all storeys, or on a square metre, looking at one thing."""


HANDHELD = Carrying()
WAYS: dict[str, Carrying] = {
    "handheld": HANDHELD,
    "steep": Carrying(tilts_deg=(-60.0, 20.0), sway_deg=12.0),
    "portrait": Carrying(roll_deg=90.0),
    "robot": Carrying(heights=(0.4, 0.88), bob=0.0, tilts_deg=(0.0, 0.0), sway_deg=0.5, look_around_deg=0.0),
    "stairs": Carrying(speeds=(0.7, 1.2), place="home"),
    "desk": Carrying(speeds=(0.1, 0.3), sway_deg=10.0, look_around_deg=25.0, place="desk"),
    "desk_portrait": Carrying(speeds=(0.1, 0.3), sway_deg=10.0, roll_deg=90.0, look_around_deg=25.0, place="desk"),
}
"""Ways of carrying the camera by name."""


@dataclass(frozen=True, slots=True)
class Walk:
    """One recording, in the world frame of its home."""

    scene: Scene
    floor_y: float
    """Floor of the storey that is walked, or of one of them, world metres."""
    Ts_world_camera: NDArray[np.float64]
    """(N, 4, 4) poses of the camera, OpenCV axes."""
    seed: int

    def frames(self, *, with_ids: bool = False) -> Iterator[Frame]:
        """The pictures; the same walk gives the same bytes.

        Args:
            with_ids: Keep the simulator's ids, for perception by oracle; a real recording has none.
        """
        for _, frame in self.pairs():
            yield frame if with_ids else replace(frame, ids=None)

    def pairs(self) -> Iterator[tuple[Frame, Frame]]:
        """Each view with its true depth, and with the sensor's; both with the simulator's ids."""
        rng = np.random.default_rng([self.seed, 1])
        renderer = Raycaster(self.scene.mesh)
        for T in self.Ts_world_camera:
            true = renderer.render(T, CAMERA)
            yield true, replace(true, depth_m=_sensed(true.depth_m, rng))


def handheld_walk(seed: int, *, num_frames: int = 300, carrying: Carrying = HANDHELD) -> Walk:
    """A walk through the invented home of this seed.

    Raises:
        SceneError: The seed gives no home.
    """
    scene = scene_from_plan(invent_plan(f"walk{seed}", seed=seed))
    rng = np.random.default_rng([seed, 0])
    storeys = scene.navigation.storey_heights
    floor_y = float(storeys[rng.integers(len(storeys))])
    seconds = np.arange(num_frames) / RATE
    path_m = seconds * rng.uniform(*carrying.speeds)
    storey_y = None if carrying.place == "home" else floor_y
    looked_at = None
    if carrying.place == "desk":
        feet, looked_at = _at_desk(scene, floor_y, path_m, rng)
    else:
        feet = _carried_along(scene, storey_y, path_m, rng)
    ahead = np.gradient(feet, axis=0) if looked_at is None else looked_at - feet
    yaw = _turned(ahead, seconds, rng, look_around_deg=carrying.look_around_deg)
    tilts_deg = rng.uniform(*carrying.tilts_deg)
    if looked_at is not None:
        tilts_deg = np.degrees(np.arctan2(ahead[:, 1] - np.mean(carrying.heights), np.hypot(ahead[:, 0], ahead[:, 2])))
    tilt = np.radians(tilts_deg + _swaying(seconds, carrying.sway_deg, rng))
    roll = np.radians(carrying.roll_deg + rng.normal(0, 2) + _swaying(seconds, carrying.sway_deg / 2, rng))
    height = rng.uniform(*carrying.heights) + carrying.bob * np.sin(2 * np.pi * 1.8 * seconds)
    Ts = np.tile(np.eye(4), (num_frames, 1, 1))
    R_world_agent = Rotation.from_euler("YXZ", np.column_stack([yaw, tilt, roll])).as_matrix()
    Ts[:, :3, :3] = R_world_agent @ R_agent_camera
    Ts[:, :3, 3] = feet + height[:, None] * np.array([0.0, 1.0, 0.0])
    return Walk(scene, floor_y, Ts, seed)


def _carried_along(
    scene: Scene, storey_y: float | None, path_m: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """(N, 3) places after so many metres (N,) of walking from one random place to the next; None = of all storeys."""
    line = [scene.navigation.random_point(rng, storey_y=storey_y)]
    done = 0.0
    while done <= path_m[-1]:
        path = scene.navigation.shortest_path(line[-1], scene.navigation.random_point(rng, storey_y=storey_y)[None])
        if path is not None and len(path) > 1:
            line.extend(path[1:])
            done += float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    points = np.array(line)
    along = np.concatenate([[0.0], np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()])
    return np.column_stack([np.interp(path_m, along, column) for column in points.T])


def _at_desk(
    scene: Scene, floor_y: float, path_m: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) places within a step of one place before a random thing that stands on the floor, and its top (3,).

    Raises:
        SceneError: Nobody can stand before any thing of this storey.
    """
    standing = [
        thing
        for thing in scene.objects
        if abs(thing.centre[1] - thing.size[1] / 2 - floor_y) < 0.1 and 0.4 < thing.size[1] < 1.2
    ]
    for index in rng.permutation(len(standing)).tolist():
        x, y, z = standing[index].centre
        near, far = _DESK_DISTANCE
        places = scene.navigation.points_within(np.array([[x, floor_y, z]]), far, max_dy=0.3)
        places = places[np.hypot(places[:, 0] - x, places[:, 2] - z) >= near]
        if len(places):
            place = places[rng.integers(len(places))]
            swing = _DESK_STEP * np.sin(path_m[:, None] / _DESK_STEP * np.array([1.0, 0.7]) + rng.uniform(0, 6, 2))
            return place + swing @ np.eye(3)[[0, 2]], np.array([x, y + standing[index].size[1] / 2, z])
    raise SceneError(f"{scene.name}: nobody can stand before any of {len(standing)} things; expected one. Change seed.")


def _turned(
    ahead: NDArray[np.float64], seconds: NDArray[np.float64], rng: np.random.Generator, *, look_around_deg: float
) -> NDArray[np.float64]:
    """(N,) yaw, radians: along these directions (N, 3), smoothed, and looking aside now and then."""
    yaw = np.unwrap(np.arctan2(-ahead[:, 0], -ahead[:, 2]))
    smooth = ndimage.gaussian_filter1d(yaw, _TURN_S * RATE, mode="nearest")
    return smooth + np.radians(_swaying(seconds, look_around_deg, rng))


def _swaying(seconds: NDArray[np.float64], most: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(N,) a slow swing of several periods, at most `most` to each side."""
    periods, phases = rng.uniform(2, 12, 3), rng.uniform(0, 2 * np.pi, 3)
    return most * np.sin(2 * np.pi * seconds[:, None] / periods + phases).mean(axis=1)


def _sensed(depth_m: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Depth (H, W) as a sensor gives it; 0 = no return."""
    sharp = depth_m.astype(np.float64)
    low, high = (rank(sharp, size=_EDGE_PIXELS) for rank in (ndimage.minimum_filter, ndimage.maximum_filter))
    mixed = np.where(high - low > _EDGE_M, ndimage.uniform_filter(sharp, _EDGE_PIXELS), sharp)
    noise = 0.0012 + 0.0019 * (mixed - NEAREST) ** 2  # Nguyen, Izadi and Lovell 2012, for the Kinect
    seen = mixed + rng.normal(size=mixed.shape) * noise
    speckle = ndimage.gaussian_filter(rng.normal(size=mixed.shape), 6)
    is_hole = speckle < np.quantile(speckle, _HOLES)
    is_seen = (seen >= NEAREST) & (seen <= _FARTHEST) & (sharp > 0) & ~is_hole
    return np.where(is_seen, np.round(seen * 1000) / 1000, 0).astype(np.float32)
