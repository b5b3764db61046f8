"""The inside of a storey given as cells: open space grown to whole rooms, and the walls between them.

`layer_heights` and `floor_layers` turn runs into images; `storey_spaces` gives one `StoreySpace` per storey;
`are_apart` finds neighbouring places with a long way between them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.walk.storeys import nearest_storey

from ...cells import CellGrid, Cells, cells_from_runs
from ...images import distance_to, grown, nearest, parts_of
from ...plan import HomePlan, Storey
from .outlines import WallLines
from .surfaces import edges_where

_STAIR_GAP = 0.9
"""Cells farther than this from every storey's floor belong to a stair layer (metres)."""
SAME_FLOOR = 0.4
"""No wall stands between neighbouring cells whose heights differ by less (metres)."""
_STEP = 0.05
"""Cells that differ more from a storey's floor are no part of it where a flight goes on from them (metres)."""
_HEADROOM = 1.0
"""A storey may continue below other floor that is this much higher than its own (metres)."""
PAD = 24
"""Cells added on each side of the plan's grid, so that walls have room."""
BODY = 4.13
"""Cells up to this far from a place (cells) must be floor, or a map of the floor loses the place: Recast keeps 8 half
cells from walls, 2 per side step and 3 per diagonal, which is AGENT_RADIUS in whole cells and the offsets (4, 1)."""
_LEAST_BLOCK = 0.1
"""Blocks lower than this above the floor are floor (metres)."""

Image = NDArray[np.bool_]
Heights = NDArray[np.float64]


class StoreySpace(NamedTuple):
    """One storey on the padded grid; images are (rows, cols)."""

    inside: Image
    """Cells with floor: under the body of a robot, under a piece, or on a flight that touches the storey."""
    open: Image
    """Cells with floor or a low block: a room from wall to wall."""
    block: Heights
    """World height of the top of the low block on a cell, metres; nan where there is none."""
    walls: WallLines
    """Edges between floor, blocks and solid cells."""
    floor: Heights
    """Height of the floor, metres; outside, the height of the nearest floor; nan where there is none."""
    guessed: Image
    """Floor that the recovery guessed."""
    well: Image
    """Cells open down to the storey below, without floor here and without ceiling below."""


def layer_heights(cells: Cells, shape: tuple[int, int], storeys: tuple[Storey, ...]) -> Heights:
    """Heights of the cells as images, nan where there is none: (2 * S - 1, rows, cols).

    Layer 2 * k is storey k, layer 2 * k + 1 the stairs from there up. The highest cell of a column counts.
    """
    floors = np.array([storey.floor_y for storey in storeys])
    storey = nearest_storey(cells.y, floors)
    layer = 2 * storey
    above = cells.y - floors[storey]
    between = (np.abs(above) > _STAIR_GAP) & (cells.y > floors[0]) & (cells.y < floors[-1])
    layer = np.where(between, layer + np.where(above > 0, 1, -1), layer)
    heights = np.full((2 * len(storeys) - 1, *shape), -np.inf)
    np.maximum.at(heights, (layer, cells.rc[:, 0], cells.rc[:, 1]), cells.y)
    heights[np.isneginf(heights)] = np.nan
    return heights


def floor_layers(grid: CellGrid, storeys: tuple[Storey, ...]) -> Heights:
    """Layers of `layer_heights` with the floor under the robot's whole body, not only under its centre.

    The stair layers hold whole flights, from the first step to the last. Where a step and a floor would cover the same
    place, the nearer one does.
    """
    walkable = layer_heights(cells_from_runs(grid.walkable), grid.shape, storeys)
    walkable = _with_whole_flights(walkable, [storey.floor_y for storey in storeys])
    away = np.stack([distance_to(~np.isnan(layer)) for layer in walkable])
    floors = np.stack([grown(layer, BODY) for layer in walkable])
    for flight in range(1, len(floors), 2):
        for level in (flight - 1, flight + 1):
            clash = np.abs(floors[flight] - floors[level]) < _HEADROOM
            is_step = away[flight] <= away[level]
            floors[level][clash & is_step] = np.nan
            floors[flight][clash & ~is_step] = np.nan
    return floors


def _with_whole_flights(heights: Heights, floors_y: list[float]) -> Heights:
    """Layers in which flights also hold their first and last steps, which lie near a storey's floor."""
    found = heights.copy()
    for layer in range(1, len(heights), 2):
        flight = ~np.isnan(heights[layer])
        low = heights[layer - 1] > floors_y[layer // 2] + _STEP
        high = heights[layer + 1] < floors_y[layer // 2 + 1] - _STEP
        parts, _ = parts_of(flight | low | high, diagonal=True)
        touched = np.bincount(parts.ravel(), flight.ravel()) > 0
        touched[0] = False
        whole = touched[parts]
        steps = np.where(flight, heights[layer], np.where(high, heights[layer + 1], heights[layer - 1]))
        found[layer] = np.where(whole, steps, np.nan)
        found[layer - 1][whole & low] = np.nan
        found[layer + 1][whole & high] = np.nan
    return found


def plinth_layers(grid: CellGrid, storeys: tuple[Storey, ...]) -> Heights:
    """Layers of `layer_heights` of open cells that are not walkable."""
    return layer_heights(cells_from_runs(grid.plinth), grid.shape, storeys)


def padded(image: NDArray, value: float = 0) -> NDArray:
    """The image with PAD more cells on each side of its last two axes."""
    return np.pad(image, [(0, 0)] * (image.ndim - 2) + [(PAD, PAD), (PAD, PAD)], constant_values=value)


def ceiling_heights(storeys: tuple[Storey, ...]) -> list[float]:
    """World height of every storey's ceiling: under the next storey's floor."""
    found = []
    for k, storey in enumerate(storeys):
        above = storeys[k + 1].floor_y - 0.12 if k + 1 < len(storeys) else np.inf
        found.append(min(storey.floor_y + storey.ceiling, max(above, storey.floor_y + 1.4)))
    return found


def storey_spaces(plan: HomePlan, floors: Heights) -> list[StoreySpace]:
    """The inside of every storey of a home with cells; `floors` are its padded `floor_layers`."""
    assert plan.cells is not None
    plinth = padded(plinth_layers(plan.cells, plan.storeys), np.nan)
    return [_storey_space(plan, k, floors, plinth[2 * k], guessed=~_known(plan, k)) for k in range(len(plan.storeys))]


def _known(plan: HomePlan, k: int) -> Image:
    """Padded image of places whose nearest walkable cell of the storey was recorded, not guessed."""
    assert plan.cells is not None
    cells = cells_from_runs(plan.cells.walkable)
    shape, storeys = plan.cells.shape, plan.storeys
    every = padded(layer_heights(cells, shape, storeys)[2 * k], np.nan)
    sure = layer_heights(cells.chosen(~cells.guessed), shape, storeys)[2 * k]
    known = ~np.isnan(padded(sure, np.nan))
    if np.isnan(every).all():
        return np.ones_like(known)
    return known[nearest(~np.isnan(every))]


def _storey_space(plan: HomePlan, k: int, floors: Heights, plinth: Heights, *, guessed: Image) -> StoreySpace:
    storey, ceiling_y = plan.storeys[k], ceiling_heights(plan.storeys)[k]
    level = floors[2 * k]
    is_level = ~np.isnan(level)
    flights = np.zeros_like(is_level)
    for layer in (2 * k - 1, 2 * k + 1):
        if 0 <= layer < len(floors):
            flights |= ~np.isnan(floors[layer])
    for layer in range(2 * k + 2, len(floors), 2):  # the last steps of a flight belong to the storey above
        flights |= (floors[layer] >= storey.floor_y + _HEADROOM) & (floors[layer] < ceiling_y)
    seen = is_level | flights
    everywhere = grown(level, np.inf) if is_level.any() else np.full(level.shape, storey.floor_y)
    ground = (plinth < everywhere + _LEAST_BLOCK) & ~flights
    block = np.where(seen | ground, np.nan, plinth)
    seen |= ground
    foreign = np.zeros_like(is_level)
    for layer in range(0, len(floors), 2):
        if layer != 2 * k:
            foreign |= (floors[layer] > storey.floor_y - 0.3) & (floors[layer] < storey.floor_y + _HEADROOM) & ~seen
    inside = seen & ~foreign
    block[foreign] = np.nan
    if not seen.any():
        nothing = np.zeros_like(inside)
        return StoreySpace(nothing, ~np.isnan(block), block, WallLines.none(inside.shape), level, nothing, nothing)
    source = nearest(seen)
    walls = _walls(inside, ~np.isnan(block), foreign, source, floors)
    goes_down = k > 0 and not np.isnan(floors[2 * k - 1]).all()
    is_own = is_level | ground
    if k > 0:
        is_own |= ~np.isnan(floors[2 * k + 1]) & np.isnan(floors[2 * k - 1]) if 2 * k + 1 < len(floors) else False
    well = inside & ~is_own[source] if goes_down else np.zeros_like(inside)
    floor = np.where(foreign | well, np.nan, everywhere)
    return StoreySpace(inside, inside | ~np.isnan(block), block, walls, floor, guessed & is_level, well)


def _walls(
    inside: Image, block: Image, foreign: Image, source: tuple[NDArray[np.int64], NDArray[np.int64]], floors: Heights
) -> WallLines:
    """Edges between floor, blocks and solid cells, but for those to level floor of another storey."""
    rc = np.stack(source, axis=-1)
    kind = np.where(inside, 1, np.where(block, 2, 0))

    def stands(a: tuple[slice, slice], b: tuple[slice, slice], _: int) -> Image:
        wall = kind[a] != kind[b]
        passage = wall & (foreign[a] | foreign[b])
        wall[passage] = ~_are_level(floors, rc[a][passage], rc[b][passage])
        return wall

    return edges_where(stands)


def _are_level(floors: Heights, rc_a: NDArray[np.int64], rc_b: NDArray[np.int64]) -> Image:
    """Whether the floors nearest to each pair of cells are one step apart at most, on any layer, (N,)."""
    first, second = floors[:, rc_a[:, 0], rc_a[:, 1]], floors[:, rc_b[:, 0], rc_b[:, 1]]
    return np.asarray((np.abs(first[:, None] - second[None]) < SAME_FLOOR).any(axis=(0, 1)), bool)
