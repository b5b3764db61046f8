"""Finds the storey of views and points while a map grows, and keeps each storey's occupancy; both map builders use it.

Frames go in one by one and come out in batches once their storey is known; points go to the floors known at that time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import CAMERA_HEIGHT, STOREY_GAP, Frame
from sim.walk.storeys import BELOW_FLOOR, same_storey, storey_levels

from .home_map import HomeMemory, Memory, OccupancyGrid, StoreyMemory
from .occupancy import MAX_DEPTH, OccupancyMapper, measured

_LEVEL_RISE, _LEVEL_RUN = 0.1, 0.6
"""A robot is on a new storey once it has gone this far (metres) within this height; on stairs it rises 0.3 m."""
_MOST_HELD = 64
"""Largest number of frames that wait for their storey to be known; on longer stairs the newest height becomes one."""
_EYE_ABOVE_FLOOR = 0.1
"""A camera is at least this high (metres) above its storey's floor."""
_LAYER, _PLACE = 0.05, 0.1
"""Thickness of a layer of heights, and side of the squares that count its area as seen from above, metres."""
_CLEAR = (3, 6)
"""A square counts in a layer if the layers this far above it are empty there: walls have no squares."""
_LEAST_SHARE, _NOISE = 0.08, 0.15
"""The floor is the lowest layer of this share of the widest one's area, or a wider one at most this far above (metres):
noise lies beside the floor's own layer, stairs down and mirror images below it are small."""
_LOWEST_EYE, _HIGHEST_EYE = 0.1, 2.5
"""The floor is this far below the cameras, metres."""
_EVERY_PIXEL = 8


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Facts about the views of which a map is made."""

    floors: Sequence[float] | None = None
    """Heights of all storeys' floors, metres; None = found from the heights of the robot's feet: the first frame's
    height, and each level on which the robot moves about, STOREY_GAP or more from the known ones."""
    mount_height: float = CAMERA_HEIGHT
    """Height of the camera above the feet, metres; needed where `floors` is None."""
    centre_xz: tuple[float, float] | None = None
    """Middle of the occupancy grids and of a grid map, metres; None = the first camera's place, and the middle of the
    seen area. The map's own `centre_xz`, which grounders see, is always the middle of what was seen."""
    max_depth: float = MAX_DEPTH
    """Farther returns are not mapped, planar metres."""
    frame: str = "world"
    """Words that name the poses' frame."""
    batch: int = 8
    """Number of views that are encoded together."""

    def __post_init__(self) -> None:
        floors = self.floors
        if floors is not None and (not len(floors) or (np.diff(np.sort(floors)) < STOREY_GAP).any()):
            raise AgentError(
                f"map builder: floors are {list(floors)}; expected at least one, each {STOREY_GAP} m from the next. "
                "Give one height per storey, or leave floors out."
            )


class Storeys:
    """The storeys met so far: their floors, the waiting frames, and the free and blocked cells of each storey."""

    def __init__(self, options: ViewOptions) -> None:
        """Starts without views."""
        self.floors: list[float] = sorted(float(floor) for floor in options.floors or ())
        """Heights in metres, in the order in which the robot met them."""
        self.num_frames = 0
        """Number of frames that came out."""
        self._options = options
        self._centre_xz = options.centre_xz
        self._held: list[Frame] = []
        self._ready: list[Frame] = []
        self._mappers: dict[int, OccupancyMapper] = {}

    def take(self, frame: Frame) -> list[Frame]:
        """Adds a view; returns a batch of frames whose storeys are known, or [] until a batch is full."""
        self._held.append(frame)
        feet = float(frame.T_world_camera[1, 3]) - self._options.mount_height
        if not self.floors:
            self.floors.append(feet)
        is_known = self._options.floors is not None or any(same_storey(feet, floor) for floor in self.floors)
        if is_known or self._opens_storey():
            self._release()
        return self._out() if len(self._ready) >= self._options.batch else []

    def rest(self) -> list[Frame]:
        """All frames that have not come out yet; frames that wait on a stair go to the nearest storey below."""
        self._release()
        return self._out()

    def index_of(self, y: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N,) index into `floors` for each height (N,): that of the nearest floor below; -1 = under the home."""
        order = np.argsort(self.floors)
        ordered = np.asarray(self.floors)[order] - BELOW_FLOOR
        ordered[0] = self.floors[order[0]] - STOREY_GAP  # sunken parts of the lowest storey
        place = np.searchsorted(ordered, np.asarray(y), side="right") - 1
        return np.where(place >= 0, order[place], -1)

    def home(self, memory_of: Callable[[int], Memory]) -> HomeMemory:
        """The map of all frames that came out, lowest storey first; `memory_of` makes a storey's map by its index."""
        order = np.argsort(self.floors).tolist() if self.num_frames else []
        storeys = tuple(StoreyMemory(self.occupancy(index), memory_of(index)) for index in order)
        return HomeMemory(storeys, self._options.frame, self.num_frames)

    def occupancy(self, index: int) -> OccupancyGrid:
        """The occupancy of a storey's floor; all unknown where no camera was."""
        mapper = self._mapper(index, near=(0.0, 0.0))
        return OccupancyGrid(mapper.cells, mapper.grid)

    def _opens_storey(self) -> bool:
        """Whether the newest held frames are on a level of their own, which makes it a new storey."""
        places = np.array([frame.T_world_camera[:3, 3] for frame in self._held])
        is_off = np.abs(places[:, 1] - places[-1, 1]) > _LEVEL_RISE
        level = places[len(places) - int(np.argmax(is_off[::-1])) if is_off.any() else 0 :]
        run = np.hypot(*(level[:, [0, 2]] - level[-1, [0, 2]]).T).max()
        if run < _LEVEL_RUN and len(self._held) < _MOST_HELD:
            return False
        self.floors.append(float(np.median(level[:, 1])) - self._options.mount_height)
        return True

    def _release(self) -> None:
        """Releases the held frames and adds each to its storey's occupancy."""
        for frame in self._held:
            eye = float(frame.T_world_camera[1, 3])
            index = int(self.index_of(np.array([eye - _EYE_ABOVE_FLOOR - BELOW_FLOOR]))[0])
            x, z = frame.T_world_camera[[0, 2], 3].tolist()
            depth = frame.depth_m if frame.ids is not None else measured(frame.depth_m)
            self._mapper(max(index, 0), near=(x, z)).add(depth, frame.T_world_camera, frame.camera)
        self._ready += self._held
        self._held = []

    def _out(self) -> list[Frame]:
        out, self._ready = self._ready, []
        self.num_frames += len(out)
        return out

    def _mapper(self, index: int, *, near: tuple[float, float]) -> OccupancyMapper:
        if index not in self._mappers:
            if self._centre_xz is None:
                self._centre_xz = near
            x, z = (float(np.floor(value)) for value in self._centre_xz)
            floor_y = self.floors[index]
            self._mappers[index] = OccupancyMapper(centre_xz=(x, z), floor_y=floor_y, max_depth=self._options.max_depth)
        return self._mappers[index]


def floors_of_frames(frames: Sequence[Frame], *, mount_height: float | None = None) -> tuple[float, ...]:
    """Heights of the floors under the cameras of a recording whose poses are all known, ascending.

    Storeys are the levels at which many cameras are, at least STOREY_GAP apart.

    Args:
        frames: Some views of the recording, e.g. every tenth; at least one.
        mount_height: Height of the camera above the floor, metres; None = found from the depth below it: the floor is
            the lowest height at which surfaces have a large area as seen from above, however few pixels show it.

    Raises:
        AgentError: The mount height is unknown and no view shows anything below a camera.
    """
    eyes = np.array([frame.T_world_camera[1, 3] for frame in frames])
    levels = storey_levels(eyes, np.zeros(len(eyes), np.int32), None)
    if mount_height is not None:
        return tuple(level - mount_height for level in levels)
    floors: list[float] = []
    for level in levels:
        near = [frame for frame, eye in zip(frames, eyes, strict=True) if abs(eye - level) < STOREY_GAP / 2]
        floor = _floor_below(near)
        if not floors or not same_storey(floor, floors[-1]):
            floors.append(floor)
    return tuple(floors)


def _floor_below(frames: Sequence[Frame]) -> float:
    """Height of the floor below these cameras of one storey, metres."""
    points = np.concatenate([_points_below(frame) for frame in frames])
    if not len(points):
        raise AgentError(
            f"map builder: none of {len(frames)} views shows anything {_LOWEST_EYE} to {_HIGHEST_EYE} m below its "
            "camera; expected a floor. Give the camera's mount height, and check which axis points up."
        )
    lowest = points.min(axis=0)
    cells = ((points - lowest) / (_PLACE, _LAYER, _PLACE)).astype(np.int64)
    _, layers, rows = cells.max(axis=0) + 1
    places, place_of = np.unique(cells[:, 0] * rows + cells[:, 2], return_inverse=True)
    is_hit = np.zeros((len(places), layers + _CLEAR[1]), bool)
    is_hit[place_of, cells[:, 1]] = True
    is_covered = np.any([is_hit[:, up : layers + up] for up in range(_CLEAR[0], _CLEAR[1] + 1)], axis=0)
    is_top = is_hit[:, :layers] & ~is_covered
    areas = is_top.sum(axis=0)
    first = int(np.flatnonzero(areas >= _LEAST_SHARE * areas.max())[0])
    layer = first + int(areas[first : first + 1 + round(_NOISE / _LAYER)].argmax())
    floor = lowest[1] + (layer + 0.5) * _LAYER
    heights = points[is_top[place_of, cells[:, 1]], 1]
    for _ in range(3):
        floor = float(np.median(heights[np.abs(heights - floor) <= _LAYER]))
    return floor


def _points_below(frame: Frame) -> NDArray[np.float64]:
    """(N, 3) some points that a view shows below its camera, where a floor can be."""
    height, width = frame.depth_m.shape
    rows, cols = np.mgrid[_EVERY_PIXEL // 2 : height : _EVERY_PIXEL, _EVERY_PIXEL // 2 : width : _EVERY_PIXEL]
    rc = np.column_stack([rows.ravel(), cols.ravel()])
    points = points_at(frame, rc[frame.depth_m[rc[:, 0], rc[:, 1]] <= MAX_DEPTH])
    below = frame.T_world_camera[1, 3] - points[:, 1]
    return points[(below > _LOWEST_EYE) & (below < _HIGHEST_EYE)]


def points_at(frame: Frame, rc: NDArray[np.integer]) -> NDArray[np.float64]:
    """Map points (N, 3) that a view shows at pixels (N, 2), given as (row, column); nan where there is no return."""
    depth = frame.depth_m[rc[:, 0], rc[:, 1]].astype(np.float64)
    depth[~(depth > 0)] = np.nan
    fx, fy, cx, cy = frame.camera.lens
    right, down = (rc[:, 1] + 0.5 - cx) / fx, (rc[:, 0] + 0.5 - cy) / fy
    points_camera = np.column_stack([right * depth, down * depth, depth])
    return points_camera @ frame.T_world_camera[:3, :3].T + frame.T_world_camera[:3, 3]
