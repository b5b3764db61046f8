"""The share of a storey that an exploration saw, measured with ground truth for the researcher.

Scene -> `VisibleFloor` (floor that can be seen); views -> `CoverageTracker` -> seen share. Agents never see this.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.compiled import njit
from sim.errors import SceneError
from sim.tasks.observers import UNKNOWN
from sim.types import AGENT_RADIUS, Camera, GridSpec
from sim.walk.navigation_map import NavigationMap
from sim.walk.storeys import nearest_storey

from ..maps.occupancy import MAX_DEPTH, OccupancyMapper

FLOOR_BAND = 0.3
"""Floor within this distance of the storey's typical height counts (metres): recorded heights lie up to 0.2 above the
floor, and a step is 0.17. Stairs and tops of beds do not count."""
SENSOR_RANGE = MAX_DEPTH
"""Range of the ideal sensor, metres."""
RAYS = 720
"""Rays of the ideal sensor at each place: 4.4 cm apart at SENSOR_RANGE, less than a cell."""
_SEE_PAST = AGENT_RADIUS - 0.03
"""Open floor reaches this far beyond the places of the robot's centre, metres: its radius, less a little to keep walls
closed."""


class VisibleFloor:
    """The free cells of a storey, and which of them an ideal sensor could see."""

    def __init__(self, navigation: NavigationMap, start: NDArray[np.float64]) -> None:
        """Computes the floor seen from all places that can be reached on foot from `start` (3,), world metres.

        Raises:
            SceneError: The start is not on any floor.
        """
        place = navigation.snap(start)
        heights = navigation.storey_heights
        if place is None or not len(heights):
            raise SceneError(
                f"navigation: no floor near the start {np.round(start, 2).tolist()}; expected a place to stand. "
                "Take one of start_on_storey."
            )
        self.storey_y = float(heights[nearest_storey(place[1], heights)])
        """Typical height of the storey's floor, metres."""
        top_down = navigation.top_down(self.storey_y)
        self.grid: GridSpec = top_down.grid
        """5 cm cells, world."""
        reach = math.hypot(*(np.array(self.grid.shape) * self.grid.cell)) + 1.0
        floor = navigation.points_within(np.array([[place[0], self.storey_y, place[2]]]), reach, max_dy=FLOOR_BAND)
        is_reachable = np.isfinite(navigation.distances(floor, place[None]))
        self.free = self._image(floor) & top_down.free
        """(rows, cols) all free cells of the storey: where the robot's centre can be, on its floor."""
        self.reachable = self._image(floor[is_reachable]) & top_down.free
        """(rows, cols) free cells that can be walked to from the start."""
        self.visible = self.reachable | _seen_from(self.reachable, self.free, self.grid.cell)
        """(rows, cols) free cells that an ideal sensor of SENSOR_RANGE sees from reachable ones (coverage 1)."""

    def _image(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        image = np.zeros(self.grid.shape, bool)
        rc = self.grid.rc_from_xz(points[:, [0, 2]])
        rc = rc[self.grid.contains(rc)]
        image[rc[:, 0], rc[:, 1]] = True
        return image


class CoverageTracker:
    """The share of a `VisibleFloor` that views have shown so far; it never falls."""

    def __init__(self, floor: VisibleFloor) -> None:
        """Starts with nothing seen of `floor`."""
        self._floor = floor
        rows, cols = np.nonzero(floor.visible)
        self._xz = floor.grid.xz_from_rc(np.stack([rows, cols], axis=1))
        middle = self._xz.mean(axis=0)
        self._mapper = OccupancyMapper(centre_xz=(float(middle[0]), float(middle[1])), floor_y=floor.storey_y)
        self._rc = self._mapper.grid.rc_from_xz(self._xz)

    def add(self, depth_m: NDArray[np.float32], T_world_camera: NDArray[np.float64], camera: Camera) -> None:
        """Adds the cells of one view: those with a depth return on them, and the robot's own footprint."""
        self._mapper.add(depth_m, T_world_camera, camera)
        self._mapper.stand((float(T_world_camera[0, 3]), float(T_world_camera[2, 3])))

    @property
    def coverage(self) -> float:
        """Seen share of the visible floor, 0 to 1."""
        return float(self._is_known().mean())

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(rows, cols) of the floor's grid: visible cells that were seen."""
        image = np.zeros(self._floor.grid.shape, bool)
        image[self._floor.visible] = self._is_known()
        return image

    def _is_known(self) -> NDArray[np.bool_]:
        return self._mapper.cells[self._rc[:, 0], self._rc[:, 1]] != UNKNOWN


def _seen_from(reachable: NDArray[np.bool_], free: NDArray[np.bool_], cell: float) -> NDArray[np.bool_]:
    """(rows, cols) free cells from which a ray over open floor meets a reachable cell within SENSOR_RANGE."""
    candidates = np.argwhere(free & ~reachable)
    radius = math.floor(_SEE_PAST / cell)
    disc = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1]) <= _SEE_PAST / cell
    is_open = ndimage.binary_dilation(free, structure=disc)
    found = np.zeros(free.shape, bool)
    hit = candidates[_meets(candidates, reachable, is_open, SENSOR_RANGE / cell, RAYS)]
    found[hit[:, 0], hit[:, 1]] = True
    return found


@njit(cache=True, nogil=True)
def _meets(candidates, reachable, is_open, reach, num_rays):
    """(N,) whether any of the rays from each cell (N, 2) meets a reachable cell over open ones."""
    found = np.zeros(len(candidates), np.bool_)
    rows, cols = is_open.shape
    for i in range(len(candidates)):
        for ray in range(num_rays):
            angle = 2 * math.pi * ray / num_rays
            dr, dc = math.sin(angle), math.cos(angle)
            for k in range(1, int(reach) + 1):
                r, c = round(candidates[i, 0] + k * dr), round(candidates[i, 1] + k * dc)
                if r < 0 or c < 0 or r >= rows or c >= cols or not is_open[r, c]:
                    break
                if reachable[r, c]:
                    found[i] = True
                    break
            if found[i]:
                break
    return found
