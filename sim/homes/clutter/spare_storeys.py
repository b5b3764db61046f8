"""The spare space of planned homes: from the cells of schematic homes, from the rooms of invented homes."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.errors import SceneError
from sim.types import GridSpec

from ..building.cell_mesh import WALL
from ..building.cell_spaces import floor_layers, layer_heights, padded
from ..building.outlines import Straight
from ..building.storey_cells import StoreyCells, storeys_of_cells
from ..cells import cells_from_runs
from ..invented.clearance import CELL as GROUND_CELL
from ..invented.clearance import Ground, walkable_ground
from ..plan import HomePlan, Opening, Rect, Wall
from .spare_space import EmptyStorey, Image, WallFace

_NEAR_STOREY = 1.3
"""Places on stairs up to this far above or below a storey's floor see into it (metres)."""
_BODY = 0.25
"""Distance kept free around the places where the robot's centre can be in an invented home (metres)."""
_DOOR_DEPTH = 0.6
_WINDOW_DEPTH = 0.12
_LEAST_WALL = 0.4


def spare_storeys(plan: HomePlan) -> list[EmptyStorey]:
    """Every storey of a home without its furniture.

    Raises:
        SceneError: Some rooms of an invented home cannot be reached.
    """
    return _of_cells(plan) if plan.cells is not None else _of_rooms(plan)


def _of_cells(plan: HomePlan) -> list[EmptyStorey]:
    """Storeys of a schematic home: things may stand in its open space where the robot's body never passes."""
    assert plan.cells is not None
    layers = padded(floor_layers(plan.cells, plan.storeys), np.nan)
    plinths = padded(layer_heights(cells_from_runs(plan.cells.plinth), plan.cells.shape, plan.storeys), np.nan)
    walkable = cells_from_runs(plan.cells.walkable)
    xz = plan.cells.grid.xz_from_rc(walkable.rc)
    places = np.stack([xz[:, 0], walkable.y, xz[:, 1]], axis=1)
    found = []
    for k, storey in enumerate(storeys_of_cells(plan, layers)):
        near = [layer for layer in (2 * k - 1, 2 * k, 2 * k + 1) if 0 <= layer < len(layers)]
        body = np.asarray(~np.isnan(layers[near]).all(axis=0))
        is_open = body | ~np.isnan(plinths[near]).all(axis=0)
        inside = storey.space.inside & ~storey.space.well
        raised = np.where(storey.space.raised, 0.02, 0.0)
        found.append(
            EmptyStorey(
                storey.grid,
                inside & ~_walls_across(storey),
                body,
                np.asarray(ndimage.binary_dilation(is_open), bool),
                storey.space.floor + raised,
                np.where(inside, storey.rooms, -1),
                tuple(face for line in storey.lines for face in _faces(storey, line)),
                storey.ceiling_y,
                places[np.abs(places[:, 1] - storey.floor_y) < _NEAR_STOREY],
                np.zeros((0, 6)),
            )
        )
    return found


def _walls_across(storey: StoreyCells) -> Image:
    """Cells beside walls within the inside."""
    ways = np.asarray(storey.space.walls.ways().any(axis=2))
    edges = np.asarray(ways[:-1, :-1] & ways[1:, 1:] | ways[1:, :-1] & ways[:-1, 1:], bool)
    inner = ndimage.binary_erosion(storey.space.inside, iterations=2)
    return np.logical_and(edges, inner)


def _faces(storey: StoreyCells, line: Straight) -> list[WallFace]:
    """Both sides of a straight wall, where a room is beside them."""
    inside = storey.space.inside
    start, end = storey.xz(line.start), storey.xz(line.end)
    length = float(np.hypot(*(end - start)))
    if length < _LEAST_WALL:
        return []
    along = (end - start) / length
    is_left, is_right = (inside[tuple(side.T)].mean() >= 0.5 for side in (line.left, line.right))
    half = WALL / 2 if is_left and is_right else 0.0
    left = np.array([along[1], -along[0]])
    found = []
    for is_seen, out in ((is_left, left), (is_right, -left)):
        if is_seen:
            a, b = start + out * half, end + out * half
            found.append(WallFace((a[0], a[1]), (b[0], b[1]), (float(out[0]), float(out[1]))))
    return found


def _of_rooms(plan: HomePlan) -> list[EmptyStorey]:
    """Storeys of an invented home: things may stand where the robot cannot go, so that all ways stay unchanged."""
    ground = walkable_ground(plan)
    if ground is None:
        raise SceneError(
            f"plan {plan.name!r}: found rooms or stairs that cannot be walked to; expected a way to all of them. "
            "Make the plan again with personal-viz invent."
        )
    return [_storey_of_rooms(plan, k, floor) for k, floor in enumerate(ground)]


def _storey_of_rooms(plan: HomePlan, k: int, ground: Ground) -> EmptyStorey:
    floor_y = plan.storeys[k].floor_y
    grid = GridSpec(ground.origin, GROUND_CELL, (ground.reached.shape[0], ground.reached.shape[1]))
    room = np.full(grid.shape, -1, np.int64)
    faces: list[WallFace] = []
    for number, item in enumerate(plan.rooms):
        if item.storey == k and item.rect is not None:
            inner = item.rect.grown(-0.06)
            room[_cells(inner, grid)] = number
            faces += _faces_of_rect(inner)
    is_open = room >= 0
    zones = []
    for wall in (wall for wall in plan.walls if wall.storey == k):
        for opening in wall.openings:
            zones.append(_zone(wall, opening, floor_y))
            if opening.kind == "door":
                is_open[_cells(wall.floor_beside(opening, depth=0.15, margin=0.05), grid)] = True
    for stair in plan.stairs:
        room[_cells(stair.rect.grown(0.1), grid)] = -1
    away: NDArray[np.float64] = np.asarray(ndimage.distance_transform_edt(~ground.reached), float)
    xz = ground.places()
    return EmptyStorey(
        grid,
        room >= 0,
        away * grid.cell <= _BODY,
        is_open,
        np.where(room >= 0, floor_y, np.nan),
        room,
        tuple(faces),
        floor_y + plan.storeys[k].ceiling,
        np.stack([xz[:, 0], np.full(len(xz), floor_y), xz[:, 1]], axis=1),
        np.array(zones).reshape(-1, 6),
    )


def _faces_of_rect(inner: Rect) -> list[WallFace]:
    x0, z0, x1, z1 = inner
    return [
        WallFace((x0, z0), (x1, z0), (0.0, 1.0)),
        WallFace((x0, z1), (x1, z1), (0.0, -1.0)),
        WallFace((x0, z0), (x0, z1), (1.0, 0.0)),
        WallFace((x1, z0), (x1, z1), (-1.0, 0.0)),
    ]


def _zone(wall: Wall, opening: Opening, floor_y: float) -> NDArray[np.float64]:
    """(6,) the box before and behind an opening that stays free."""
    depth = _DOOR_DEPTH if opening.kind == "door" else wall.thickness / 2 + _WINDOW_DEPTH
    rect = wall.floor_beside(opening, depth=depth, margin=0.05)
    return np.array([rect.x0, floor_y + opening.sill - 0.05, rect.z0, rect.x1, floor_y + opening.top + 0.1, rect.z1])


def _cells(rect: Rect, grid: GridSpec) -> tuple[slice, slice]:
    """Rows and columns whose cells a rectangle touches."""
    rc = grid.rc_from_xz(np.array([[rect.x0 + 1e-6, rect.z0 + 1e-6], [rect.x1 - 1e-6, rect.z1 - 1e-6]]))
    (row0, col0), (row1, col1) = np.clip(rc, 0, np.array(grid.shape) - 1).tolist()
    return slice(row0, row1 + 1), slice(col0, col1 + 1)
