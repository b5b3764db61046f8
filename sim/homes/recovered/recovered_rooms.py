"""Rooms of a schematic home: every open cell belongs to the room of the nearest objects by walking distance.

Room words of texts and open cells -> `Room`s with names, areas and finishes, for `recover`. Words: room_words.py.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Goal

from ..building.cell_spaces import floor_layers, layer_heights
from ..cells import AreaRun, CellGrid, cells_from_runs
from ..plan import Room, Storey
from .room_finishes import room_finishes
from .room_regions import Seed, cell_graph, distance_at, groups_of, places_of, settled, spread
from .room_words import RoomName, room_name, usual_room

_NEAR_NAMED = 2.5
"""An object without a text names a room only farther than this from all objects with one (metres, weighted)."""


class RecoveredRooms(NamedTuple):
    """The rooms of a plan, and the room of each object."""

    rooms: tuple[Room, ...]
    room_of: dict[str, str]
    """Name of the room by `object_name`."""


class _Region(NamedTuple):
    """A room before it has a final name."""

    storey: int
    room: RoomName | None
    """Name of the room; None for the part of a storey without a name."""
    mask: NDArray[np.bool_]


def recovered_rooms(
    texts: Mapping[str, Counter[str]], goals: Mapping[str, Goal], storeys: Sequence[Storey], *, grid: CellGrid
) -> RecoveredRooms:
    """The rooms of a home; each open cell (walkable, under the robot's body, or plinth) belongs to one of its storey.

    Args:
        texts: Counts of the rooms in which texts put each object, by `object_name` (`room_texts`).
        goals: All objects.
        storeys: Levels of the plan.
        grid: The grid with its walkable cells and plinths.
    """
    masks = open_cells(grid, storeys)
    floor_y = np.array([storey.floor_y for storey in storeys])
    storey_of = {name: int(np.abs(floor_y - goal.floor_y).argmin()) for name, goal in goals.items()}
    regions: list[_Region] = []
    for k, mask in enumerate(masks):
        here = {name: goal for name, goal in sorted(goals.items()) if storey_of[name] == k}
        regions += _regions(k, mask, here, texts, grid)
    names = _names(regions, storeys)
    finishes = room_finishes(
        [region.room for region in regions], [region.mask for region in regions], [region.storey for region in regions]
    )
    rooms = tuple(
        Room(name=name, storey=region.storey, area=_runs(region.mask), floor=finish.floor, wall=finish.wall)
        for name, region, finish in zip(names, regions, finishes, strict=True)
    )
    return RecoveredRooms(rooms, _rooms_of(goals, storey_of, regions, names, grid))


def open_cells(grid: CellGrid, storeys: Sequence[Storey]) -> NDArray[np.bool_]:
    """(S, rows, cols) cells where a storey has floor or plinth; stairs belong to the storey from which they rise."""
    floors = floor_layers(grid, tuple(storeys))
    plinths = layer_heights(cells_from_runs(grid.plinth), grid.shape, tuple(storeys))
    is_open = ~np.isnan(floors) | ~np.isnan(plinths)
    return np.stack([is_open[2 * k : 2 * k + 2].any(axis=0) for k in range(len(storeys))])


def _regions(
    storey: int,
    mask: NDArray[np.bool_],
    goals: Mapping[str, Goal],
    texts: Mapping[str, Counter[str]],
    grid: CellGrid,
) -> list[_Region]:
    """The rooms of one storey, the largest first, and the rest."""
    if not mask.any():
        return []
    graph = cell_graph(mask, grid.cell)
    named = [Seed(goal, room) for name, goal in goals.items() if (room := _room_of_texts(texts.get(name)))]
    distance, nearest = spread(graph, named, grid)
    guessed = [
        Seed(goal, RoomName(kind, kind, kind))
        for name, goal in goals.items()
        if name not in {seed.goal.object_name for seed in named}
        and (kind := usual_room(goal.object_category))
        and distance_at(goal, distance, grid) > _NEAR_NAMED
    ]
    seeds = named + guessed
    distance, nearest = spread(graph, seeds, grid)
    groups = groups_of(seeds, distance, nearest)
    labels = np.where(nearest >= 0, np.append(groups, -1)[nearest], -1)
    labels = settled(labels, distance, mask, num=len(seeds), cell=grid.cell)
    regions = []
    for group in np.unique(labels[mask]).tolist():
        room = _common_name([seed.room for seed, of in zip(seeds, groups, strict=True) if of == group])
        regions.append(_Region(storey, room, (labels == group) & mask))
    return sorted(regions, key=lambda region: (region.room is None, -int(region.mask.sum())))


def _room_of_texts(counted: Counter[str] | None) -> RoomName | None:
    """The room that most texts name; of equal counts the first by name."""
    rooms = [(-count, text, room) for text, count in (counted or {}).items() if (room := room_name(text))]
    return min(rooms, key=lambda entry: entry[:2])[2] if rooms else None


def _common_name(rooms: Sequence[RoomName]) -> RoomName | None:
    if not rooms:
        return None
    return min(Counter(rooms).items(), key=lambda item: (-item[1], item[0].name == item[0].kind, item[0]))[0]


def _names(regions: Sequence[_Region], storeys: Sequence[Storey]) -> list[str]:
    """A name for each region, with a number where another region has the same name."""
    taken: set[str] = set()
    names = []
    for region in regions:
        plain = storeys[region.storey].label if region.room is None else region.room.name
        name, number = plain, 2
        while name in taken:
            name, number = f"{plain} {number}", number + 1
        taken.add(name)
        names.append(name)
    return names


def _runs(mask: NDArray[np.bool_]) -> tuple[AreaRun, ...]:
    """A mask (rows, cols) as runs, row by row."""
    edges = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, firsts = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
    return tuple(
        AreaRun(row, col, end - col)
        for row, col, end in zip(rows.tolist(), firsts.tolist(), ends.tolist(), strict=True)
    )


def _rooms_of(
    goals: Mapping[str, Goal],
    storey_of: Mapping[str, int],
    regions: Sequence[_Region],
    names: Sequence[str],
    grid: CellGrid,
) -> dict[str, str]:
    """The room of each object: the one with most places that see it, else the largest of its storey."""
    label = np.full((max(storey_of.values(), default=0) + 1, *grid.shape), -1, np.int64)
    for index, region in enumerate(regions):
        if region.storey < len(label):
            label[region.storey][region.mask] = index
    found: dict[str, str] = {}
    for name, goal in sorted(goals.items()):
        points = np.concatenate([places_of(goal), np.array([goal.position])])[:, [0, 2]]
        rc = np.clip(grid.grid.rc_from_xz(points), 0, np.array(grid.shape) - 1)
        votes = Counter(index for index in label[storey_of[name], rc[:, 0], rc[:, 1]].tolist() if index >= 0)
        first = next((k for k, region in enumerate(regions) if region.storey == storey_of[name]), 0)
        found[name] = names[min(votes, key=lambda index: (-votes[index], index), default=first)]
    return found
