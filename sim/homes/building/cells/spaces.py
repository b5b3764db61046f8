"""The inside of a storey given as cells: open space grown to whole rooms, and the walls between them.

`layer_heights` and `floor_layers` turn runs into images; `storey_spaces` gives one `StoreySpace` per storey;
`are_apart` finds neighbouring places with a long path between them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.compiled import njit
from sim.types import AGENT_RADIUS
from sim.walk.storeys import nearest_storey

from ...cells import CellGrid, Cells, cells_from_runs
from ...images import distance_to, grown, nearest, parts_of, widened
from ...plan import HomePlan, Storey
from .outlines import WallLines, without_bits
from .surfaces import edges_where

_STAIR_GAP = 0.9
"""Cells farther than this from every storey's floor belong to a stair layer (metres)."""
SAME_FLOOR = 0.4
"""No wall stands between neighbouring cells whose heights differ by less (metres)."""
_HEADROOM = 1.0
"""A storey may continue below other floor that is this much higher than its own (metres)."""
PAD = 24
"""Cells added on each side of the plan's grid, so that walls have room."""
_PITCH = 4
"""Walls keep to every _PITCH-th line of cells where possible, so that rooms get few corners."""
_THIN = 13
"""Solid blocks narrower than this many cells become thin walls, or floor where the path around them is short."""
_EASY = 5
"""Cells this near to walkable floor are drawn as floor; cells farther away are slightly raised."""
_BAND = 7
_MIN_RAISED = 60
"""Raised places with fewer cells, or nowhere as wide as _BAND, become floor."""

Image = NDArray[np.bool_]
Heights = NDArray[np.float64]


class StoreySpace(NamedTuple):
    """One storey on the padded grid; images are (rows, cols)."""

    inside: Image
    """Rooms, from wall to wall, with the flights that touch the storey."""
    walls: WallLines
    """Edges between cells where walls stand."""
    floor: Heights
    """Height of the floor, metres; outside, the height of the nearest floor; nan where there is none."""
    raised: Image
    """Cells inside where nobody walked; their floor is drawn a little higher and darker."""
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
    """Layers of `layer_heights` with the floor under the robot's whole body, not only under its centre."""
    walkable = layer_heights(cells_from_runs(grid.walkable), grid.shape, storeys)
    return np.stack([grown(layer, AGENT_RADIUS / grid.cell) for layer in walkable])


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
    return [
        _storey_space(plan, k, floors, ~np.isnan(plinth[2 * k]), guessed=~_known(plan, k))
        for k in range(len(plan.storeys))
    ]


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


def _storey_space(plan: HomePlan, k: int, floors: Heights, plinth: Image, *, guessed: Image) -> StoreySpace:
    storey, ceiling_y = plan.storeys[k], ceiling_heights(plan.storeys)[k]
    level = floors[2 * k]
    is_level = ~np.isnan(level)
    flights = np.zeros_like(plinth)
    for layer in (2 * k - 1, 2 * k + 1):
        if 0 <= layer < len(floors):
            flights |= ~np.isnan(floors[layer])
    for layer in range(2 * k + 2, len(floors), 2):  # the last steps of a flight belong to the storey above
        flights |= (floors[layer] >= storey.floor_y + _HEADROOM) & (floors[layer] < ceiling_y)
    seen = is_level | plinth | flights
    foreign = np.zeros_like(plinth)
    for layer in range(0, len(floors), 2):
        if layer != 2 * k:
            foreign |= (floors[layer] > storey.floor_y - 0.3) & (floors[layer] < storey.floor_y + _HEADROOM) & ~seen
    inside = _rooms_around(seen) & ~foreign
    if not seen.any():
        nothing = np.zeros_like(inside)
        return StoreySpace(nothing, WallLines.none(inside.shape), level, nothing, nothing, nothing)
    source = nearest(seen)
    walls = without_bits(_walls(inside, seen, foreign, source, floors))
    goes_down = k > 0 and not np.isnan(floors[2 * k - 1]).all()
    is_own = is_level | plinth
    if k > 0:
        is_own |= ~np.isnan(floors[2 * k + 1]) & np.isnan(floors[2 * k - 1]) if 2 * k + 1 < len(floors) else False
    well = inside & ~is_own[source] if goes_down else np.zeros_like(inside)
    everywhere = grown(level, np.inf)
    floor = np.where(foreign | well, np.nan, np.where(np.isnan(everywhere), storey.floor_y, everywhere))
    away = distance_to(is_level)
    raised = inside & ~flights & (away > _EASY) & ~_under_thin_things(plan, k)
    return StoreySpace(inside, walls, floor, _without_small(raised), guessed & (away <= _EASY) & inside, well)


def _rooms_around(seen: Image) -> Image:
    """Open space with a margin, on few straight lines, without narrow gaps and small islands."""
    wide = widened(seen, 1)
    starts = [(row, col) for row in range(_PITCH) for col in range(_PITCH)]
    best = _on_pitch(wide, *min(starts, key=lambda start: int(_blocks(wide, *start).sum())))
    solid = np.pad(~best, _THIN, constant_values=True).astype(np.uint8)
    for axis in (0, 1):  # a morphological opening with a square, one axis at a time
        solid = ndimage.minimum_filter1d(solid, _THIN, axis=axis)
    for axis in (0, 1):
        solid = ndimage.maximum_filter1d(solid, _THIN, axis=axis)
    return solid[_THIN:-_THIN, _THIN:-_THIN] == 0


def _blocks(image: Image, row: int, col: int) -> Image:
    """Mask of the blocks of _PITCH by _PITCH cells that an image touches; blocks begin `row`, `col` cells early."""
    after = [(-(size + first)) % _PITCH for size, first in zip(image.shape, (row, col), strict=True)]
    wide = np.pad(image, ((row, after[0]), (col, after[1])))
    blocks = wide.reshape(wide.shape[0] // _PITCH, _PITCH, wide.shape[1] // _PITCH, _PITCH)
    return np.asarray(blocks.any(axis=(1, 3)), bool)


def _on_pitch(image: Image, row: int, col: int) -> Image:
    """All cells of the blocks that an image touches."""
    rows, cols = image.shape
    blocks = _blocks(image, row, col)
    return blocks.repeat(_PITCH, axis=0).repeat(_PITCH, axis=1)[row : row + rows, col : col + cols]


def _walls(
    inside: Image, seen: Image, foreign: Image, source: tuple[NDArray[np.int64], NDArray[np.int64]], floors: Heights
) -> WallLines:
    """Walls around the inside, and within it between neighbouring places with a long path from one to the other."""
    rc = np.stack(source, axis=-1)

    def stands(a: tuple[slice, slice], b: tuple[slice, slice], _: int) -> Image:
        wall = inside[a] != inside[b]
        unsure = inside[a] & inside[b] & ~(seen[a] & seen[b]) & (np.abs(rc[a] - rc[b]).sum(axis=-1) > 2)
        wall[unsure] = are_apart(seen, rc[a][unsure], rc[b][unsure])
        passage = wall & (foreign[a] | foreign[b])
        wall[passage] = ~_are_level(floors, rc[a][passage], rc[b][passage])
        return wall

    return edges_where(stands)


def _are_level(floors: Heights, rc_a: NDArray[np.int64], rc_b: NDArray[np.int64]) -> Image:
    """Whether the floors at each pair of cells differ by less than SAME_FLOOR, on any two layers, (N,)."""
    first, second = floors[:, rc_a[:, 0], rc_a[:, 1]], floors[:, rc_b[:, 0], rc_b[:, 1]]
    return np.asarray((np.abs(first[:, None] - second[None]) < SAME_FLOOR).any(axis=(0, 1)), bool)


def _under_thin_things(plan: HomePlan, k: int) -> Image:
    """Mask of cells under rugs, which raised floor would hide."""
    assert plan.cells is not None
    image = np.zeros(plan.cells.shape, bool)
    storey = plan.storeys[k]
    for piece in plan.furniture:
        if piece.size[1] < 0.06 and abs(piece.centre[1] - storey.floor_y) < 0.3:
            image[piece.rect.cells(plan.cells.grid)] = True
    return padded(image)


def _without_small(image: Image) -> Image:
    image = np.asarray(ndimage.binary_opening(image, np.ones((_BAND, _BAND), bool)), bool)
    parts, _ = parts_of(image)
    large = np.bincount(parts.ravel()) >= _MIN_RAISED
    large[0] = False
    return large[parts]


_DETOUR = 1.5
_SLACK = 3
"""Places are apart when the path between them is longer than _DETOUR times the straight line plus _SLACK cells."""


def are_apart(free: NDArray[np.bool_], rc_a: NDArray[np.int64], rc_b: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the path from each a to its b through free cells is long or does not exist.

    Args:
        free: (rows, cols) cells that a path may use, in steps along four directions.
        rc_a: (N, 2) free cells.
        rc_b: (N, 2) free cells.

    Returns:
        One value per pair, (N,).
    """
    if not len(rc_a):
        return np.zeros(0, bool)
    pairs, which = np.unique(np.concatenate([rc_a, rc_b], axis=1), axis=0, return_inverse=True)
    return _apart(free, pairs)[which.reshape(-1)]


@njit(cache=True, nogil=True)
def _apart(free, pairs):
    rows, cols = free.shape
    found = np.ones(len(pairs), np.bool_)
    seen = np.full((rows, cols), -1, np.int64)
    queue = np.empty((rows * cols, 3), np.int32)
    for n in range(len(pairs)):
        r0, c0, r1, c1 = pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3]
        limit = int(_DETOUR * (abs(r0 - r1) + abs(c0 - c1))) + _SLACK
        queue[0, 0], queue[0, 1], queue[0, 2] = r0, c0, 0
        seen[r0, c0] = n
        first, last = 0, 1
        while first < last and found[n]:
            r, c, steps = queue[first, 0], queue[first, 1], queue[first, 2]
            first += 1
            if r == r1 and c == c1:
                found[n] = False
            for side in range(4):
                rr = r + (side == 0) - (side == 1)
                cc = c + (side == 2) - (side == 3)
                if rr < 0 or cc < 0 or rr >= rows or cc >= cols or not free[rr, cc] or seen[rr, cc] == n:
                    continue
                if steps + 1 + abs(rr - r1) + abs(cc - c1) <= limit:
                    seen[rr, cc] = n
                    queue[last, 0], queue[last, 1], queue[last, 2] = rr, cc, steps + 1
                    last += 1
    return found
