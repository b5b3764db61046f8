"""The check that users run on their own map builders, in a room whose every surface is known (room.py)."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sim.plugins import problems_of
from sim.tasks.observers import FREE, OCCUPIED
from sim.types import CAMERA_HEIGHT

from ..encoders.protocol import TextEncoder
from ..maps.arrays import arrays_of_storey
from ..maps.grid_map import MapBuilder
from ..maps.home_map import HomeMemory, Memory, ObjectMap, OccupancyGrid, StoreyMemory
from ..types import FeatureMap
from .answers import require
from .room import BOXES, ROOM, CheckView, check_views, is_free, is_solid

_NEAR = 0.1
"""Largest distance between a mapped place and the place that was seen, metres."""
_RIGHT_SHARE = 0.98
"""Share of the free and of the blocked cells that must be right; single cells on edges may be wrong."""
_SOME = 200
"""Least number of free, and of blocked, cells of 5 cm for a room of 30 m2."""
_DIFFERENT = 1e-3
"""Least difference between two numbers of unit vectors that counts; less is rounding."""
_EVERYWHERE = np.array([[-1e3, -1e3], [1e3, 1e3]])
_MOVED = np.array([[0.0, 0, 1, 3], [0, 1, 0, 0.5], [-1, 0, 0, -2], [0, 0, 0, 1]])
"""T_map_room of the second pass: a quarter turn to the left, then 3 m in x, half a metre up and -2 m in z."""


def check_map_builder(
    builder: MapBuilder | Callable[[TextEncoder], MapBuilder] | str, encoder: TextEncoder
) -> list[str]:
    """How a builder breaks the contract of `MapBuilder`, or puts things in the wrong place.

    The views show a room with a red and a blue box (`instance_ids` 1 and 2), then the same with everything turned and
    moved, then with the boxes' colours exchanged.

    Args:
        builder: The object, a factory, or its name as package.module:factory; the factory gets the encoder. It is made
            for cameras 0.88 m above the feet and without heights of floors.
        encoder: The encoder that it was made with; it must give each box a vector, and the two must differ.

    Returns:
        The first breach, here or in a second process; empty = the contract is kept.
    """
    return problems_of(
        builder,
        partial(_require_builder, encoder=encoder),
        methods=("reset", "add", "finish"),
        again=_stored,
        arguments=(encoder,),
        kind="map builder",
    )


def _stored(builder: MapBuilder) -> list[NDArray[np.floating]]:
    """The vectors of a map of the room."""
    return [_around(storey.memory, _EVERYWHERE) for storey in _built(builder, check_views()).storeys]


def _require_builder(builder: MapBuilder, *, encoder: TextEncoder) -> None:
    where = f"map builder {builder.name!r}"
    builder.reset()
    empty = builder.finish()
    require(empty.num_frames == 0, where, "frames without any view", empty.num_frames, "0")
    maps = []
    for T_map_room in (np.eye(4), _MOVED):
        views = check_views(T_map_room=T_map_room)
        builder.reset()
        for view in views:
            _add_unchanged(builder, view, where)
        home = builder.finish()
        require(home.num_frames == len(views), where, "frames", home.num_frames, f"{len(views)}")
        require(len(home.storeys) == 1, where, "storeys of a flat room", len(home.storeys), "1")
        _check_storey(home.storeys[0], views, T_map_room, encoder, where)
        maps.append(home)
    again = _built(builder, check_views())
    require(_same(again, maps[0]), where, "map of the same views after reset", "another one", "the same map")
    exchanged = _built(builder, check_views(exchanged=True))
    for low, high in BOXES.values():
        footprint = np.array([low, high])[:, [0, 2]]
        changed = _changes(maps[0].storeys[0].memory, exchanged.storeys[0].memory, footprint)
        expected = "other content when the boxes exchange their colours: check rows and columns"
        require(changed, where, f"content around {footprint.mean(axis=0).tolist()}", "the same", expected)


def _add_unchanged(builder: MapBuilder, view: CheckView, where: str) -> None:
    frame = view.frame
    before = frame.rgb.copy(), frame.depth_m.copy(), frame.T_world_camera.copy()
    builder.add(frame)
    after = frame.rgb, frame.depth_m, frame.T_world_camera
    same = all(np.array_equal(first, second) for first, second in zip(before, after, strict=True))
    require(same, where, "a view's arrays after add", "changed", "unchanged")


def _check_storey(
    storey: StoreyMemory, views: Sequence[CheckView], T_map_room: NDArray[np.float64], encoder: TextEncoder, where: str
) -> None:
    floor_y = float(T_map_room[1, 3])
    off = abs(storey.floor_y - floor_y)
    advice = f"{floor_y}, {CAMERA_HEIGHT} m under the cameras"
    require(off <= _NEAR, where, "height of the floor", round(storey.floor_y, 3), advice)
    memory = storey.memory
    space = memory.encoder, memory.dim
    require(space == (encoder.name, encoder.dim), where, "encoder", space, f"{(encoder.name, encoder.dim)}")
    _check_occupancy(storey.occupancy, T_map_room, where)
    seen = np.concatenate([view.points[::2, ::2].reshape(-1, 3) for view in views])
    if isinstance(memory, ObjectMap):
        _check_objects(memory, seen, where)
    else:
        _check_cells(memory, seen, where)


def _check_occupancy(occupancy: OccupancyGrid, T_map_room: NDArray[np.float64], where: str) -> None:
    T_room_map = np.linalg.inv(T_map_room)
    for value, what, test in ((FREE, "free", is_free), (OCCUPIED, "blocked", is_solid)):
        xz = occupancy.grid.xz_from_rc(np.argwhere(occupancy.cells == value))
        points = np.column_stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]]) @ T_room_map[:3, :3].T + T_room_map[:3, 3]
        require(len(xz) >= _SOME, where, f"number of {what} cells", len(xz), f"at least {_SOME} in a seen room")
        share = float(test(points[:, [0, 2]]).mean())
        what = f"share of {what} cells that are {what}"
        require(share >= _RIGHT_SHARE, where, what, round(share, 3), f"at least {_RIGHT_SHARE}: check yaw and axes")


def _check_cells(memory: FeatureMap, seen: NDArray[np.float64], where: str) -> None:
    expected = "at least one where the encoder says something"
    require(len(memory.rows) > 0, where, "number of cells", 0, expected)
    low = np.asarray(memory.grid.origin_xz) + memory.rc[:, ::-1] * memory.grid.cell - _NEAR
    high = low + memory.grid.cell + 2 * _NEAR
    for xz_low, xz_high, rc in zip(low, high, memory.rc.tolist(), strict=True):
        shows = ((seen[:, [0, 2]] >= xz_low) & (seen[:, [0, 2]] <= xz_high)).all(axis=1).any()
        require(bool(shows), where, "a stored cell", rc, "one in which a view shows something: check yaw and axes")
    require(bool((memory.weights > 0).all()), where, "least weight", float(memory.weights.min()), "above 0")


def _check_objects(memory: ObjectMap, seen: NDArray[np.float64], where: str) -> None:
    tree = KDTree(seen)
    for item in memory.objects:
        far = float(np.max(tree.query(item.points)[0]))
        name = f"distance of object {item.caption!r} from the nearest seen place"
        require(far <= _NEAR, where, name, round(far, 3), f"at most {_NEAR} m: check yaw and axes")
        length = float(np.linalg.norm(item.feature))
        require(abs(length - 1) <= 1e-3, where, "length of an object's feature", length, "1")
        floor = ROOM[1][0] - ROOM[0][0]
        size = max(high - low for low, high in zip(*item.box, strict=True))
        require(size <= floor + 2 * _NEAR, where, "size of an object", round(size, 2), "at most the room's")


def _built(builder: MapBuilder, views: Sequence[CheckView]) -> HomeMemory:
    builder.reset()
    for view in views:
        builder.add(view.frame)
    return builder.finish()


def _changes(first: Memory, second: Memory, footprint: NDArray[np.float64]) -> bool:
    """Whether two maps differ in a rectangle of the floor, (2, 2) lowest and highest xz."""
    one, other = _around(first, footprint), _around(second, footprint)
    return one.shape != other.shape or bool(np.abs(one - other).max(initial=0) > _DIFFERENT)


def _around(memory: Memory, footprint: NDArray[np.float64]) -> NDArray[np.floating]:
    """(N, E) the vectors of the cells, or of the objects, that touch a rectangle of the floor."""
    if isinstance(memory, ObjectMap):
        low = np.array([np.array(item.box[0])[[0, 2]] for item in memory.objects]).reshape(-1, 2)
        high = np.array([np.array(item.box[1])[[0, 2]] for item in memory.objects]).reshape(-1, 2)
        rows = np.array([item.feature for item in memory.objects]).reshape(-1, memory.dim)
    else:
        low = np.asarray(memory.grid.origin_xz) + memory.rc[:, ::-1] * memory.grid.cell
        high, rows = low + memory.grid.cell, memory.rows
    return rows[((low <= footprint[1]) & (high >= footprint[0])).all(axis=1)]


def _same(first: HomeMemory, second: HomeMemory) -> bool:
    one, other = ([arrays_of_storey(storey) for storey in home.storeys] for home in (first, second))
    return all(
        a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)
        for a, b in zip(one, other, strict=True)
    )
