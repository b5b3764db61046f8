"""A robot's own map of one storey while it walks: occupancy, places of collisions, and costs of ways.

Observation -> `FloorMemory.see` -> cells, weights. Frame: the episode's start (sim/frames.py).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grounding.maps.occupancy import OccupancyMapper
from sim.errors import AgentError
from sim.frames import forward_from_yaw
from sim.homes.images import widened
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import FORWARD_STEP, Camera, GridSpec, Observation

from .plan_kernels import weigh

CLEARANCE = 0.17
"""The robot's centre cannot enter cells whose middles are nearer than this to a blocked cell's middle, metres: its
radius of 0.18, less a little for the size of the cells."""
_TIGHT_CLEARANCE, _THIN_TIMES = 0.02, 30.0
"""Clearance (metres) of a robot that found no other way. Ways over thin things are then allowed at this many times
their length, because a thin wall on the map may not exist."""
_NEAR_TIMES, _NEAR_FADES = 5.0, 0.35
"""Ways count 1 + _NEAR_TIMES * exp(-d / _NEAR_FADES) times their length where the nearest thing is d metres away:
people walk in the middle of the free floor."""
_TIGHT, _TIGHT_TIMES = 0.215, 30.0
"""Ways nearer to a thing than this (metres) count up to so many more times their length, the nearer the more: a walk
keeps a body's radius in whole cells from things, so that a robot that plans nearer collides."""
_FLOOR_AROUND, _FLOOR_BIN = 0.3, 0.02
"""The floor is searched up to this far below and above the feet, in bins of this height, metres."""
_FLOOR_FRAMES = 14
"""Number of views after which the floor's height is fixed: a full look around and a little more."""
_BUMP_STEPS = 300
"""Steps for which a collision blocks its place; blocking it forever would seal doors."""
_BUMP_AHEAD, _BUMP_ASIDE = (0.03, 0.07), (0.0,)
"""A collision blocks the robot's centre this far ahead and aside (metres), but never where it has been."""
_BUMP_FORE, _BUMP_REACH, _BUMP_TIMES, _BUMP_MOST = 0.2, 0.15, 2.0, 12.0
"""Each collision raises the cost of ways near a place ahead of it: distance ahead and width of the bell curve (metres),
factor, and the largest factor of all collisions together. The way round an invisible wall thus becomes cheaper before
the robot has tried every place along the wall, and the narrow way beside the wall stays open."""
_TRAIL_TIMES, _BESIDE_TIMES = 1.0, 2.5
"""Ways over cells that the robot has crossed, and over cells beside them, count at most this many times their length,
however close things seem."""
_TRAIL_STEP = 0.01
"""The robot's way is followed in steps of this length, metres."""
_BLIND, _BLIND_TIMES = 1.5, 3.0
"""Unknown floor this near (metres) to the robot is below its camera's view; ways over it count this many times their
length."""
_COSTS = (_NEAR_TIMES, _NEAR_FADES, _BLIND_TIMES, _TIGHT, _TIGHT_TIMES)
_COLUMNS = 160
"""Wider pictures are thinned to about this many columns. That still covers every cell of 5 cm at 5 m, and large and
small cameras make the same map."""
_MARGIN = 8
"""Plans include this many cells around the known ones."""


class Bump(NamedTuple):
    """A collision."""

    xz: tuple[float, float]
    """The robot's place, metres."""
    yaw: float
    """The robot's heading, radians."""
    until: int
    """Step at which it no longer blocks anything."""


class Ground(NamedTuple):
    """The known part of the map at one moment, cut out of the whole grid."""

    cells: NDArray[np.uint8]
    """(rows, cols) UNKNOWN, FREE or OCCUPIED."""
    assumed: NDArray[np.uint8]
    """(rows, cols) like `cells`, but unknown cells near the robot count as free."""
    weights: NDArray[np.float64]
    """(rows, cols) actions to cross a cell; inf where the robot's centre cannot be, nan in things."""
    grid: GridSpec
    """Grid of the cells, start frame."""


class FloorMemory:
    """The floor that the robot has seen since the episode began, or since the map did that it carries."""

    def __init__(self, *, start_y: float = 0.0) -> None:
        """Starts empty; the feet are at height `start_y` (metres) now."""
        self.start_y = start_y
        """Height of the feet at the start, metres."""
        self._frames: list[tuple[NDArray[np.float32], NDArray[np.float64], Camera]] = []
        self._is_floor_sure = False
        self._heights = np.zeros(round(2 * _FLOOR_AROUND / _FLOOR_BIN))
        self._mapper = OccupancyMapper(floor_y=start_y)
        self._ground: Ground | None = None
        self._stood: list[tuple[float, float]] = []
        shape = self._mapper.grid.shape
        self._trail = np.zeros(shape, bool)
        self._touched = np.zeros(shape, np.float32)  # added to the weights of ways near collisions
        self._bumps: tuple[Bump, ...] = ()
        self._step = 0
        self._clearance = CLEARANCE
        self._is_elsewhere = False
        self.xz = (0.0, 0.0)
        """The robot's middle, metres, start frame."""
        self.yaw = 0.0
        """The robot's heading, radians."""
        self.is_tilted = False
        """Whether the camera looks down or up."""

    def see(self, observation: Observation) -> None:
        """Adds an observation.

        Raises:
            AgentError: The observation has no depth.
        """
        if observation.depth_m is None:
            raise AgentError(
                f"step {observation.step}: the observation has no depth; expected depth, from which the map is made. "
                "Run this agent with a renderer."
            )
        self._ground = None
        self.xz = (observation.gps[1], -observation.gps[0])
        self.yaw = observation.compass
        T = observation.T_start_camera
        self.is_tilted = abs(float(T[1, 2])) > 0.01
        self._follow(self._stood[-1] if self._stood and not self._is_elsewhere else self.xz, self.xz)
        self._is_elsewhere = False
        self._stood.append(self.xz)
        view = _thinned(observation.depth_m, T, observation.camera)
        if not self._is_floor_sure and len(self._frames) < _FLOOR_FRAMES:
            self._frames.append(view)
            self._find_floor(view, feet_y=float(T[1, 3]) - observation.camera.mount_height)
        self._mapper.add(*view)
        self._mapper.stand(self.xz)
        if observation.collided:
            self._bumps = (*self._bumps, Bump(self.xz, self.yaw, observation.step + _BUMP_STEPS))
            ahead = np.array(self.xz) + _BUMP_FORE * forward_from_yaw(self.yaw)[[0, 2]]
            self.avoid((float(ahead[0]), float(ahead[1])))
        self._step = observation.step

    def carry(self) -> None:
        """Says that the robot does not walk to the place of its next observation, so it leaves no trail to there."""
        self._is_elsewhere = True

    def forget_floor(self) -> None:
        """Forgets all but the obstacles and the floor's height: free cells, collisions and the robot's way."""
        self._mapper.forget_free()
        self._is_floor_sure = True
        self._frames, self._stood, self._bumps, self._ground = [], [], (), None
        self._trail[:], self._touched[:] = False, 0
        self._clearance = CLEARANCE

    @property
    def bumps(self) -> tuple[Bump, ...]:
        """All collisions so far."""
        return self._bumps

    def forget_bumps(self) -> bool:
        """Stops collisions from blocking, though they still raise costs; returns False if none was blocking."""
        blocked = any(bump.until > self._step for bump in self._bumps)
        self._bumps = tuple(bump._replace(until=min(bump.until, self._step)) for bump in self._bumps)
        self._ground = None
        return blocked

    def squeeze(self) -> bool:
        """Lets plans pass close to things, and over thin ones, until `relax`; returns False if they already do."""
        is_wide = self._clearance == CLEARANCE
        self._clearance, self._ground = _TIGHT_CLEARANCE, None
        return is_wide

    def relax(self) -> None:
        """Makes plans keep their distance from things again."""
        self._clearance, self._ground = CLEARANCE, None

    @property
    def floor_y(self) -> float:
        """Height of the floor, metres, start frame: the most frequent height seen, the nearer to the feet the more."""
        return self._mapper.floor_y

    @property
    def num_known(self) -> int:
        """Number of cells that are free or occupied."""
        return self._mapper.num_known

    @property
    def num_free(self) -> int:
        """Number of cells that are free."""
        return self._mapper.num_free

    @property
    def cells(self) -> NDArray[np.uint8]:
        """(rows, cols) cells of `grid`; a copy."""
        return self._mapper.cells

    @property
    def grid(self) -> GridSpec:
        """The grid of the whole map."""
        return self._mapper.grid

    def cell_at(self, xz: tuple[float, float]) -> int:
        """UNKNOWN, FREE or OCCUPIED at a place."""
        return self._mapper.cell_at(xz)

    def ground(self) -> Ground:
        """The part of the map that plans use now."""
        if self._ground is not None:
            return self._ground
        whole = self._mapper.grid
        r0, r1, c0, c1 = self._mapper.known_box
        part = np.s_[max(r0 - _MARGIN, 0) : r1 + _MARGIN + 1, max(c0 - _MARGIN, 0) : c1 + _MARGIN + 1]
        cells = self._mapper.cells_of(part)
        origin = (whole.origin_xz[0] + part[1].start * whole.cell, whole.origin_xz[1] + part[0].start * whole.cell)
        grid = GridSpec(origin, whole.cell, (cells.shape[0], cells.shape[1]))
        assumed = _with_blind_spot(cells, grid, self.xz)
        blocking = [bump for bump in self._bumps if bump.until > self._step]
        weights = _weights(
            cells,
            assumed,
            grid,
            clearance=self._clearance,
            touched=self._touched[part],
            trail=self._trail[part],
            bumps=blocking,
        )
        self._ground = Ground(cells, assumed, weights, grid)
        return self._ground

    def _follow(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Records that the robot's middle moved from one place to another: nothing stands between them."""
        count = math.ceil(math.dist(start, end) / _TRAIL_STEP) + 1
        _set(self._trail, self._mapper.grid, np.linspace(start, end, count), True)

    def avoid(self, xz: tuple[float, float]) -> None:
        """Raises the cost of ways near a place where the robot collided or made no progress."""
        grid = self._mapper.grid
        ((row, col),) = grid.rc_from_xz(np.array([xz]))
        reach = math.ceil(2 * _BUMP_REACH / grid.cell)
        part = np.s_[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
        rows, cols = np.ogrid[part]
        away = ((rows - row) ** 2 + (cols - col) ** 2) * (grid.cell / _BUMP_REACH) ** 2
        if self._touched[part].shape == away.shape:
            self._touched[part] = np.minimum(self._touched[part] + _BUMP_TIMES * np.exp(-away), _BUMP_MOST)

    def _find_floor(self, view: tuple[NDArray[np.float32], NDArray[np.float64], Camera], *, feet_y: float) -> None:
        """Counts the heights that a view shows near the feet; rebuilds the map if the floor has another height."""
        heights = _heights(*view)
        near = heights[np.abs(heights - feet_y) < _FLOOR_AROUND]
        start_low = self.start_y - _FLOOR_AROUND  # the feet stay on the storey while this is counted
        bins = np.floor((near - start_low) / _FLOOR_BIN).astype(np.int64)
        self._heights += np.bincount(bins[(bins >= 0) & (bins < len(self._heights))], minlength=len(self._heights))
        if not self._heights.any():
            return
        middles = start_low + (np.arange(len(self._heights)) + 0.5) * _FLOOR_BIN
        nearness = (
            1 - np.abs(middles - self.start_y) / _FLOOR_AROUND
        )  # a seat or a step may fill more of the picture than the floor
        floor_y = float(middles[(self._heights * nearness).argmax()])
        if abs(floor_y - self._mapper.floor_y) > _FLOOR_BIN:
            self._mapper = OccupancyMapper(floor_y=floor_y)
            for earlier in self._frames[:-1]:
                self._mapper.add(*earlier)
            for xz in self._stood:
                self._mapper.stand(xz)


def _thinned(
    depth_m: NDArray[np.float32], T_map_camera: NDArray[np.float64], camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.float64], Camera]:
    """The view with only every k-th row and column of pixels, so that _COLUMNS or a few more are left."""
    k = max(camera.width // _COLUMNS, 1)
    first = k // 2
    depth = np.ascontiguousarray(depth_m[first::k, first::k])
    fx, fy, *middle = camera.lens
    cx, cy = ((centre - first - 0.5) / k + 0.5 for centre in middle)
    height, width = depth.shape
    return depth, T_map_camera, Camera.of_lens(width, height, fx=fx / k, fy=fy / k, cx=cx, cy=cy)


def _heights(depth_m: NDArray[np.float32], T_map_camera: NDArray[np.float64], camera: Camera) -> NDArray:
    """(N,) heights of every fourth pixel's point that is within 4 m, metres."""
    depth = depth_m[2::4, 2::4]
    fx, fy, cx, cy = camera.lens
    right = (np.arange(camera.width)[2::4] + 0.5 - cx) / fx
    down = (np.arange(camera.height)[2::4] + 0.5 - cy) / fy
    R = T_map_camera[:3, :3]
    heights = T_map_camera[1, 3] + depth * (R[1, 0] * right[None] + R[1, 1] * down[:, None] + R[1, 2])
    return heights[np.logical_and(depth > 0, depth < 4.0)]


def _with_blind_spot(cells: NDArray[np.uint8], grid: GridSpec, xz: tuple[float, float]) -> NDArray[np.uint8]:
    """(rows, cols) the cells, with unknown ones within _BLIND of the robot marked free."""
    u, v = grid.uv_from_xz(np.array(xz))
    rows, cols = np.ogrid[: cells.shape[0], : cells.shape[1]]
    is_near = (rows + 0.5 - v) ** 2 + (cols + 0.5 - u) ** 2 < (_BLIND / grid.cell) ** 2
    return np.where(is_near & (cells == UNKNOWN), np.uint8(FREE), cells)


def _weights(
    cells: NDArray[np.uint8],
    assumed: NDArray[np.uint8],
    grid: GridSpec,
    *,
    clearance: float,
    touched: NDArray[np.float32],
    trail: NDArray[np.bool_],
    bumps: Sequence[Bump],
) -> NDArray[np.float64]:
    """(rows, cols) actions to cross each cell, more near things; inf or nan where the robot's centre cannot be."""
    factor: NDArray[np.float64] = weigh(cells, assumed, grid.cell, clearance, _COSTS)
    if clearance < CLEARANCE:
        is_thing = cells == OCCUPIED
        is_thick = np.asarray(ndimage.binary_opening(is_thing, structure=np.ones((3, 3))), bool)
        factor[is_thing & ~is_thick] = _THIN_TIMES
    factor = factor + touched
    beside = widened(trail, 1)
    factor[beside & (factor > _BESIDE_TIMES) & (factor < np.inf)] = _BESIDE_TIMES
    for bump in bumps:
        ahead, aside = forward_from_yaw(bump.yaw)[[0, 2]], forward_from_yaw(bump.yaw - math.pi / 2)[[0, 2]]
        places = [np.array(bump.xz) + a * ahead + b * aside for a in _BUMP_AHEAD for b in _BUMP_ASIDE]
        _set(factor, grid, np.array(places), np.nan)
    factor[trail] = _TRAIL_TIMES
    return factor * (grid.cell / FORWARD_STEP)


def _set(image: NDArray, grid: GridSpec, xz: NDArray[np.float64], value: float) -> None:
    """Writes a value into the image at those places (N, 2) that lie on it."""
    rc = grid.rc_from_xz(xz)
    rc = rc[grid.contains(rc)]
    image[rc[:, 0], rc[:, 1]] = value
