"""A robot's own map of one storey while it walks: occupancy, where collisions were, and what a way costs.

Observation -> `FloorMemory.see` -> cells, weights. Frame: the episode's start (sim/frames.py).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grounding.occupancy import OccupancyMapper
from grounding.posed_frames import Intrinsics
from sim.errors import AgentError
from sim.frames import forward_from_yaw
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import FORWARD_STEP, GridSpec, Observation

CLEARANCE = 0.17
"""Middles of cells nearer to a blocked cell's middle are blocked for the robot's centre, metres: its radius of 0.18,
less what the cells' size may add."""
_NEAR_TIMES, _NEAR_FADES = 5.0, 0.35
"""Ways count 1 + _NEAR_TIMES * exp(-d / _NEAR_FADES) times their length where the next thing is d metres away: the
middle of the free floor is where others walked."""
_FLOOR_AROUND, _FLOOR_BIN = 0.3, 0.02
"""The floor is looked for so far below and above the feet, in bins of this height, metres."""
_FLOOR_FRAMES = 14
"""Views after which the floor's height is not changed any more: a look around and a bit."""
_BUMP_AHEAD, _BUMP_ASIDE = (0.05, 0.1), (-0.05, 0.0, 0.05)
"""A collision blocks the robot's centre so far ahead and aside, metres, but never where it has been."""
_BUMP_REACH, _BUMP_COST = 0.4, 0.4
"""Each collision adds so many actions to crossing each cell this near, metres: where a wall cannot be seen, a way round
becomes the better one before every place of it was tried."""
_STOOD_TIMES = 2.0
"""A way over cells where the robot has been counts so many times its length, however close things seem."""
_BLIND, _BLIND_TIMES = 1.5, 3.0
"""Unknown floor this near to the robot lies below its camera's view; a way over it counts so many times its length."""
_MARGIN = 8
"""Cells around what is known that plans include."""


class Bump(NamedTuple):
    """A collision."""

    xz: tuple[float, float]
    """Where the robot was."""
    yaw: float
    """Where it wanted to go, radians."""
    until: int
    """Step at which it no longer blocks anything."""


class Ground(NamedTuple):
    """The known part of the map, cut out, at one moment."""

    cells: NDArray[np.uint8]
    """(rows, cols) UNKNOWN, FREE or OCCUPIED."""
    assumed: NDArray[np.uint8]
    """(rows, cols) `cells` with what is unknown near the robot taken as free."""
    weights: NDArray[np.float64]
    """(rows, cols) actions to cross a cell; inf where the robot's centre cannot be, nan in things."""
    grid: GridSpec
    """Where they are, start frame."""


class FloorMemory:
    """What the robot has seen of the floor since the episode began."""

    def __init__(self, *, bump_steps: int) -> None:
        """Nothing.

        Args:
            bump_steps: For how many steps a collision blocks its place; for ever would seal doors.
        """
        self._bump_steps = bump_steps
        self._frames: list[tuple[NDArray[np.float32], NDArray[np.float64], Intrinsics]] = []
        self._heights = np.zeros(round(2 * _FLOOR_AROUND / _FLOOR_BIN))
        self._mapper = OccupancyMapper()
        self._ground: Ground | None = None
        self._stood: list[tuple[float, float]] = []
        self._bumps: tuple[Bump, ...] = ()
        self._step = 0
        self.xz = (0.0, 0.0)
        """Where the robot's middle is, metres, start frame."""
        self.yaw = 0.0
        """Where it looks, radians."""
        self.is_tilted = False
        """Whether the camera looks down or up."""

    def see(self, observation: Observation) -> None:
        """Adds what is sensed.

        Raises:
            AgentError: The observation has no depth.
        """
        if observation.depth_m is None:
            raise AgentError(
                f"step {observation.step}: the observation has no depth; expected some, a map grows from it. "
                "Run this agent with a renderer."
            )
        self._ground = None
        self.xz = (observation.gps[1], -observation.gps[0])
        self.yaw = observation.compass
        T = observation.T_start_camera
        self.is_tilted = abs(float(T[1, 2])) > 0.01
        self._stood.append(self.xz)
        view = (observation.depth_m, T, Intrinsics.of(observation.camera))
        if len(self._frames) < _FLOOR_FRAMES:
            self._frames.append(view)
            self._find_floor(view, feet_y=float(T[1, 3]) - observation.camera.mount_height)
        self._mapper.add(*view)
        self._mapper.stand(self.xz)
        if observation.collided:
            self._bumps = (*self._bumps, Bump(self.xz, self.yaw, observation.step + self._bump_steps))
        self._step = observation.step

    @property
    def bumps(self) -> tuple[Bump, ...]:
        """All collisions so far."""
        return self._bumps

    def forget_bumps(self) -> bool:
        """Lets collisions block nothing any more; they go on to make ways dearer. False where none blocked anything."""
        blocked = any(bump.until > self._step for bump in self._bumps)
        self._bumps = tuple(bump._replace(until=min(bump.until, self._step)) for bump in self._bumps)
        self._ground = None
        return blocked

    @property
    def floor_y(self) -> float:
        """Height of the floor, metres, start frame: most of what is seen near the feet's height lies there."""
        return self._mapper.floor_y

    @property
    def num_known(self) -> int:
        """Cells that are free or occupied."""
        return self._mapper.num_known

    @property
    def cells(self) -> NDArray[np.uint8]:
        """(rows, cols) of `grid`; a copy."""
        return self._mapper.cells

    @property
    def grid(self) -> GridSpec:
        """The whole map's."""
        return self._mapper.grid

    def cell_at(self, xz: tuple[float, float]) -> int:
        """UNKNOWN, FREE or OCCUPIED at a place."""
        return self._mapper.cell_at(xz)

    def ground(self) -> Ground:
        """What plans are made on now."""
        if self._ground is not None:
            return self._ground
        cells = self._mapper.cells
        rows, cols = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
        r0, c0 = max(rows[0] - _MARGIN, 0), max(cols[0] - _MARGIN, 0)
        cells = cells[r0 : rows[-1] + _MARGIN + 1, c0 : cols[-1] + _MARGIN + 1]
        whole = self._mapper.grid
        origin = (whole.origin_xz[0] + c0 * whole.cell, whole.origin_xz[1] + r0 * whole.cell)
        grid = GridSpec(origin, whole.cell, (cells.shape[0], cells.shape[1]))
        assumed = _with_blind_spot(cells, grid, self.xz)
        self._ground = Ground(
            cells, assumed, _weights(cells, assumed, grid, bumps=self._bumps, step=self._step, stood=self._stood), grid
        )
        return self._ground

    def _find_floor(self, view: tuple[NDArray[np.float32], NDArray[np.float64], Intrinsics], *, feet_y: float) -> None:
        """Counts the heights that a view shows near the feet; starts the map anew where the floor is elsewhere."""
        heights = _heights(*view)
        near = heights[np.abs(heights - feet_y) < _FLOOR_AROUND]
        start_low = -_FLOOR_AROUND  # the feet are at 0 at the start, and stay on the storey while this is counted
        bins = np.floor((near - start_low) / _FLOOR_BIN).astype(np.int64)
        self._heights += np.bincount(bins[(bins >= 0) & (bins < len(self._heights))], minlength=len(self._heights))
        if not self._heights.any():
            return
        floor_y = start_low + (int(self._heights.argmax()) + 0.5) * _FLOOR_BIN
        if abs(floor_y - self._mapper.floor_y) > _FLOOR_BIN:
            self._mapper = OccupancyMapper(floor_y=floor_y)
            for earlier in self._frames[:-1]:
                self._mapper.add(*earlier)
            for xz in self._stood:
                self._mapper.stand(xz)


def _heights(depth_m: NDArray[np.float32], T_map_camera: NDArray[np.float64], intrinsics: Intrinsics) -> NDArray:
    """(N,) heights of every fourth pixel's point that is within 4 m, metres."""
    depth = depth_m[2::4, 2::4]
    right = (np.arange(intrinsics.width)[2::4] + 0.5 - intrinsics.cx) / intrinsics.fx
    down = (np.arange(intrinsics.height)[2::4] + 0.5 - intrinsics.cy) / intrinsics.fy
    R = T_map_camera[:3, :3]
    heights = T_map_camera[1, 3] + depth * (R[1, 0] * right[None] + R[1, 1] * down[:, None] + R[1, 2])
    return heights[(depth > 0) & (depth < 4.0)]


def _with_blind_spot(cells: NDArray[np.uint8], grid: GridSpec, xz: tuple[float, float]) -> NDArray[np.uint8]:
    """The cells (rows, cols) with unknown ones within _BLIND of the robot free."""
    u, v = grid.uv_from_xz(np.array(xz))
    rows, cols = np.ogrid[: cells.shape[0], : cells.shape[1]]
    is_near = (rows + 0.5 - v) ** 2 + (cols + 0.5 - u) ** 2 < (_BLIND / grid.cell) ** 2
    return np.where(is_near & (cells == UNKNOWN), np.uint8(FREE), cells)


def _weights(
    cells: NDArray[np.uint8],
    assumed: NDArray[np.uint8],
    grid: GridSpec,
    *,
    bumps: Sequence[Bump],
    step: int,
    stood: Sequence[tuple[float, float]],
) -> NDArray[np.float64]:
    """(rows, cols) actions to cross each cell, more near things; inf or nan where the robot's centre cannot be."""
    is_occupied = cells == OCCUPIED
    away = np.asarray(ndimage.distance_transform_edt(~is_occupied)) if is_occupied.any() else np.full(cells.shape, 99.0)
    away = away * grid.cell
    factor = 1 + _NEAR_TIMES * np.exp(-away / _NEAR_FADES)
    factor[cells == UNKNOWN] *= _BLIND_TIMES
    factor[(away < CLEARANCE) | (assumed != FREE)] = np.inf
    factor[is_occupied] = np.nan
    extra = np.zeros(cells.shape)
    reach = round(_BUMP_REACH / grid.cell)
    for bump in bumps:
        ((r, c),) = grid.rc_from_xz(np.array([bump.xz]))
        extra[max(r - reach, 0) : r + reach + 1, max(c - reach, 0) : c + reach + 1] += _BUMP_COST
    factor += extra * (FORWARD_STEP / grid.cell)
    for bump in (bump for bump in bumps if bump.until > step):
        ahead, aside = forward_from_yaw(bump.yaw)[[0, 2]], forward_from_yaw(bump.yaw - math.pi / 2)[[0, 2]]
        places = [np.array(bump.xz) + a * ahead + b * aside for a in _BUMP_AHEAD for b in _BUMP_ASIDE]
        _set(factor, grid, np.array(places), np.nan)
    _set(factor, grid, np.array(stood), _STOOD_TIMES)
    return factor * (grid.cell / FORWARD_STEP)


def _set(image: NDArray[np.float64], grid: GridSpec, xz: NDArray[np.float64], value: float) -> None:
    """Writes a value where the places (N, 2) are on the image."""
    rc = grid.rc_from_xz(xz)
    rc = rc[grid.contains(rc)]
    image[rc[:, 0], rc[:, 1]] = value
