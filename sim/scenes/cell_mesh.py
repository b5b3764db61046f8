"""Floors, plinths, steps and walls of a home that is given as cells (schematic homes); used by recover and furnish."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.types import AGENT_RADIUS

from .cells import CellGrid, Cells, cells_from_runs
from .cut import CUT_HEIGHT
from .plan import Finish, HomePlan, Storey
from .quads import QuadBuilder

_STAIR_GAP = 0.9
"""Cells farther than this from every storey's floor belong to a stair layer (metres)."""
_SAME_FLOOR = 0.4
"""No wall stands between neighbouring cells whose heights differ by less (metres)."""
_PARAPET = 0.9
_FLAT = 0.17
"""Recorded heights this near a storey's floor are drawn as that floor (metres)."""
_PLINTH_RGB = (204, 160, 104)
_CAP_RGB = (70, 70, 76)
_TILE = 10  # cells per floor tile, for a pattern that shows motion

Heights = NDArray[np.float64]


def layer_heights(cells: Cells, shape: tuple[int, int], storeys: tuple[Storey, ...]) -> Heights:
    """Heights of the cells as images, nan where there is none: (2 * S - 1, rows, cols).

    Layer 2 * k is storey k, layer 2 * k + 1 the stairs from there up. The highest cell of a column counts.
    """
    floors = np.array([storey.floor_y for storey in storeys])
    nearest = np.abs(cells.y[:, None] - floors).argmin(axis=1)
    layer = 2 * nearest
    above = cells.y - floors[nearest]
    between = (np.abs(above) > _STAIR_GAP) & (cells.y > floors[0]) & (cells.y < floors[-1])
    layer = np.where(between, layer + np.where(above > 0, 1, -1), layer)
    heights = np.full((2 * len(storeys) - 1, *shape), -np.inf)
    np.maximum.at(heights, (layer, cells.rc[:, 0], cells.rc[:, 1]), cells.y)
    heights[np.isneginf(heights)] = np.nan
    return heights


def grown(heights: Heights, radius_cells: float) -> Heights:
    """One layer (rows, cols) with every gap within `radius_cells` filled from the nearest cell."""
    empty = np.isnan(heights)
    if empty.all():
        return heights
    distance, (rows, cols) = ndimage.distance_transform_edt(empty, return_indices=True)  # type: ignore[misc]
    return np.where(distance <= radius_cells, heights[rows, cols], np.nan)


def floor_layers(grid: CellGrid, storeys: tuple[Storey, ...]) -> Heights:
    """Layers of `layer_heights` with the floor under the robot's whole body, not only under its centre."""
    walkable = layer_heights(cells_from_runs(grid.walkable), grid.shape, storeys)
    return np.stack([grown(layer, AGENT_RADIUS / grid.cell) for layer in walkable])


def add_cells(builder: QuadBuilder, plan: HomePlan) -> None:
    """Adds floors, plinths, risers and walls of the plan's cells."""
    assert plan.cells is not None
    floor = floor_layers(plan.cells, plan.storeys)
    plinth = layer_heights(cells_from_runs(plan.cells.plinth), plan.cells.shape, plan.storeys)
    is_plinth = np.isnan(floor) & ~np.isnan(plinth)
    heights = np.where(is_plinth, plinth, floor)
    for layer, surface in enumerate(heights):
        storey = plan.storeys[layer // 2]
        room = next(room for room in plan.rooms if room.storey == layer // 2)
        level = np.where(np.abs(surface - storey.floor_y) < _FLAT, storey.floor_y, np.round(surface / 0.05) * 0.05)
        _add_tops(builder, plan.cells, level, is_plinth[layer], room.floor.rgb)
        _add_risers(builder, plan.cells, level, is_plinth[layer], room.floor.rgb)
        _add_walls(builder, plan.cells, level, heights, storey, room.wall.rgb, is_stair=layer % 2 == 1)


def _add_coloured(builder: QuadBuilder, quads: Heights, rgb: NDArray[np.floating]) -> None:
    """Quads (Q, 4, 3) with a colour each."""
    colours, which = np.unique(np.clip(rgb, 0, 255).round().astype(int), axis=0, return_inverse=True)
    for number, (red, green, blue) in enumerate(colours.tolist()):
        builder.add_quads(quads[which == number], Finish(rgb=(red, green, blue)))


def _merged(keys: NDArray[np.int64], along: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Merge entries with equal `keys` (N, K) and consecutive `along` (N,): (index of each first entry, lengths)."""
    order = np.lexsort((along, *keys.T[::-1]))
    keys, along = keys[order], along[order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(along) != 1) | (np.diff(keys, axis=0) != 0).any(axis=1)
    firsts = np.flatnonzero(new)
    return order[firsts], np.diff(np.append(firsts, len(order)))


def _add_tops(
    builder: QuadBuilder, grid: CellGrid, level: Heights, is_plinth: NDArray[np.bool_], floor_rgb: tuple[int, int, int]
) -> None:
    rows, cols = np.nonzero(~np.isnan(level))
    if not len(rows):
        return
    y_mm = np.round(level[rows, cols] * 1000).astype(np.int64)
    keys = np.stack([y_mm, is_plinth[rows, cols], cols // _TILE, rows // _TILE, rows], axis=1).astype(np.int64)
    first, width = _merged(keys, cols)
    # runs of one row become rectangles where the next row has the same run
    wide_keys = np.column_stack([keys[first][:, :4], cols[first], width])
    top, height = _merged(wide_keys, rows[first])
    pick = first[top]
    x0, z0 = _corner(grid, rows[pick], cols[pick])
    x1, z1 = x0 + width[top] * grid.cell, z0 + height * grid.cell
    y = y_mm[pick] / 1000
    quads = np.stack([np.stack(corner, axis=1) for corner in ((x0, y, z0), (x0, y, z1), (x1, y, z1), (x1, y, z0))], 1)
    checker = (rows[pick] // _TILE + cols[pick] // _TILE) % 2
    rgb = np.where(is_plinth[rows[pick], cols[pick], None], _PLINTH_RGB, floor_rgb) * (0.96 + 0.06 * checker[:, None])
    _add_coloured(builder, quads, rgb)


def _corner(grid: CellGrid, rows: NDArray, cols: NDArray) -> tuple[Heights, Heights]:
    return grid.origin_xz[0] + cols * grid.cell, grid.origin_xz[1] + rows * grid.cell


def _edges(level: Heights) -> list[tuple[int, int, Heights]]:
    """(row step, col step, level of the neighbour in that direction) for the four sides of every cell."""
    padded = np.pad(level, 1, constant_values=np.nan)
    rows, cols = level.shape
    steps = ((1, 0), (-1, 0), (0, 1), (0, -1))
    return [(dr, dc, padded[1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols]) for dr, dc in steps]


def _side_quads(
    grid: CellGrid, rows: NDArray, cols: NDArray, low: Heights, high: Heights, step: tuple[int, int]
) -> tuple[Heights, NDArray[np.int64]]:
    """Upright quads (Q, 4, 3) on the given side of cells, merged along the side, facing away from the cell."""
    along, across = (cols, rows) if step[0] else (rows, cols)
    keys = np.column_stack([np.round(low * 1000), np.round(high * 1000), across]).astype(np.int64)
    first, length = _merged(keys, along)
    x, z = _corner(grid, rows[first], cols[first])
    run = length * grid.cell
    if step[0]:
        z = z + (grid.cell if step[0] > 0 else 0.0)
        x_a, x_b, z_a, z_b = x, x + run, z, z
        flip = step[0] < 0
    else:
        x = x + (grid.cell if step[1] > 0 else 0.0)
        x_a, x_b, z_a, z_b = x, x, z, z + run
        flip = step[1] > 0
    if flip:
        x_a, x_b, z_a, z_b = x_b, x_a, z_b, z_a
    lo, hi = low[first], high[first]
    corners = ((x_a, lo, z_a), (x_b, lo, z_b), (x_b, hi, z_b), (x_a, hi, z_a))
    return np.stack([np.stack(corner, axis=1) for corner in corners], axis=1), first


def _add_risers(
    builder: QuadBuilder, grid: CellGrid, level: Heights, is_plinth: NDArray[np.bool_], floor_rgb: tuple[int, int, int]
) -> None:
    for dr, dc, neighbour in _edges(level):
        rows, cols = np.nonzero(level > neighbour + 0.001)
        if not len(rows):
            continue
        quads, first = _side_quads(grid, rows, cols, neighbour[rows, cols], level[rows, cols], (dr, dc))
        from_plinth = is_plinth[rows[first], cols[first], None]
        _add_coloured(builder, quads, np.where(from_plinth, np.array(_PLINTH_RGB) * 0.8, np.array(floor_rgb) * 0.85))


def _add_walls(
    builder: QuadBuilder,
    grid: CellGrid,
    level: Heights,
    heights: Heights,
    storey: Storey,
    wall_rgb: tuple[int, int, int],
    *,
    is_stair: bool,
) -> None:
    """Walls where a cell has no neighbour at its height in any layer; parapets along stairs."""
    neighbours = [_edges(layer) for layer in heights]
    for side, (dr, dc, beside) in enumerate(_edges(level)):
        near = np.zeros(level.shape, bool)
        ceiling = np.full(level.shape, np.inf)
        for layer_sides in neighbours:
            other = layer_sides[side][2]
            near |= np.abs(other - level) < _SAME_FLOOR
            ceiling = np.where(other > level + _SAME_FLOOR, np.fmin(ceiling, other), ceiling)
        rows, cols = np.nonzero(~np.isnan(level) & np.isnan(beside) & ~near)
        if not len(rows):
            continue
        y = level[rows, cols]
        if is_stair:
            top = np.minimum(y + _PARAPET, ceiling[rows, cols] - 0.05)
            fits = top > y
            rows, cols, y = rows[fits], cols[fits], y[fits]
            spans = [(y, top[fits])]
        else:
            cut = np.full(y.shape, storey.floor_y + CUT_HEIGHT)
            base = np.minimum(y + 0.08, cut)
            spans = [(y, base), (base, cut), (cut, cut - CUT_HEIGHT + storey.ceiling)]
        for part, (low, high) in enumerate(spans):
            if not len(rows):
                continue
            quads, first = _side_quads(grid, rows, cols, low, high, (dr, dc))
            quads = quads[:, [1, 0, 3, 2]]  # a wall looks towards the cell
            shade = _wall_tint(grid, rows[first], cols[first]) * (0.62 if part == 0 and not is_stair else 1.0)
            _add_coloured(builder, quads, np.array(wall_rgb) * shade)
            if part == 1:
                _add_caps(builder, grid, quads, (dr, dc))


def _wall_tint(grid: CellGrid, rows: NDArray, cols: NDArray) -> Heights:
    """(N, 3) factors that change slowly over the home, so that places differ."""
    x, z = cols * grid.cell, rows * grid.cell
    red, green, blue = np.sin(x * 0.9), np.sin(z * 0.8 + 2.0), np.sin((x + z) * 0.6 + 4.0)
    return 1 + 0.09 * np.round(np.stack([red, green, blue], axis=1) * 2) / 2


def _add_caps(builder: QuadBuilder, grid: CellGrid, quads: Heights, step: tuple[int, int]) -> None:
    """A dark rim on the wall just under the cut, which shows the wall from above."""
    outward = np.array([step[1], 0, step[0]]) * grid.cell
    inner = quads[:, [2, 3]] - [0, 0.005, 0]
    rim = np.concatenate([inner, inner[:, ::-1] + outward], axis=1)
    normal_y = np.cross(rim[:, 2] - rim[:, 0], rim[:, 3] - rim[:, 1])[:, 1]
    builder.add_quads(np.where((normal_y < 0)[:, None, None], rim[:, ::-1], rim), Finish(rgb=_CAP_RGB))
