"""Recovers a schematic home from episode files: floor where the robot stood, open space where it looked, else wall.

Episode files -> HomePlan, kept on disk. Floor: walkable.py; objects: objects.py; rooms: rooms.py.
"""

import math
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.types import SPLITS, STOREY_GAP, Split
from sim.walk.storeys import same_storey

from ..cells import CELL, CellGrid, runs_from_cells
from ..plan import Furniture, HomePlan, Storey, floor_name, stored_plan
from .holders import holders
from .names import room_texts
from .objects import is_solid, recovered_pieces
from .open_space import block_cells
from .recorded import Recorded, recorded_facts
from .rooms import recovered_rooms
from .unhidden import unhidden
from .walkable import reached_places, walkable_cells

MARGIN = 2.0
"""Width of the empty border around the standing points (metres)."""
_SAME_HEIGHT = 0.15
_FEWEST = 10
"""Least number of points of a storey, unless it is the only one."""
_CEILING, _HIGHEST = 2.5, 3.4
_ABOVE_TOP = 0.05
_SLAB = 0.1
_BESIDE = 2.2
"""Storeys with a smaller height difference are side by side, as in a home on a slope (metres)."""


def recover_plan(dataset: PersonalDataset, scene: str, *, splits: tuple[Split, ...] = SPLITS) -> HomePlan:
    """The schematic home of a scene, from its episodes in the named splits of the dataset and of its evidence.

    The first call takes seconds, later ones milliseconds: plans are kept in the cache folder, by the content of the
    scene's files, those of the evidence too, and `HOMES_VERSION`.

    Raises:
        DatasetError: The scene is unknown, its files are damaged, or the evidence is of another home.
        SceneError: The files hold no place to stand.
    """
    dataset.require_scene(scene)
    named: tuple[Split, ...] = tuple(split for split in SPLITS if split in splits)
    digests = [edition.scene_digest(scene, splits=named) for edition in (dataset, *dataset.evidence)]
    return stored_plan(f"{scene} {','.join(named)} {' '.join(digests)}", lambda: _recovered(dataset, scene, named))


def _recovered(dataset: PersonalDataset, scene: str, splits: tuple[Split, ...]) -> HomePlan:
    recorded = recorded_facts(dataset, scene, splits=splits)
    if not len(recorded.standing):
        raise SceneError(
            f"{dataset.root}: scene {scene!r} has no original view point and no episode in {', '.join(splits)}; "
            "expected places to stand. Give --scenes-dir the folder of its scan."
        )
    storeys = _storeys(recorded)
    pieces, mountings = recovered_pieces(recorded, storeys)
    pieces = unhidden(pieces, recorded.goals)
    standing = [piece for piece in pieces if mountings[piece.name] == "floor"]
    storeys = _with_ceilings(storeys, standing)
    grid = _empty_grid(recorded.places)
    solid = [piece for piece in standing if is_solid(piece)]
    floor = walkable_cells(recorded, storeys, grid=grid, pieces=pieces, solid=solid)
    grid = grid.model_copy(update={"walkable": runs_from_cells(floor)})
    blocks = block_cells(recorded, pieces, mountings, storeys, grid=grid)
    grid = grid.model_copy(update={"plinth": runs_from_cells(blocks)})
    pieces += holders(pieces, mountings, storeys, grid=grid)
    found = recovered_rooms(room_texts(recorded.episodes), recorded.goals, storeys, grid=grid)
    furniture = tuple(
        piece.model_copy(update={"room": found.room_of[_nearest_goal(piece, pieces)]}) for piece in pieces
    )
    return HomePlan(
        name=scene,
        kind="schematic",
        storeys=storeys,
        rooms=found.rooms,
        furniture=furniture,
        cells=grid,
        sources=recorded.sources,
    )


def _nearest_goal(piece: Furniture, pieces: Sequence[Furniture]) -> str:
    """Name of the recorded object of a piece; for a support, of the nearest object."""
    own = [other for other in pieces if other.role == "captioned"]
    return min(own, key=lambda other: (math.dist(other.centre, piece.centre), other.name)).name


def _storeys(recorded: Recorded) -> tuple[Storey, ...]:
    """Storeys with floors at the most frequent heights of points, at least STOREY_GAP apart.

    Extra places count where the standing ones know of no storey.
    """
    found: list[float] = []
    for is_extra in (False, True):
        left = np.sort((reached_places(recorded, found) if is_extra else recorded.standing)[:, 1])
        for height in found:
            left = left[~same_storey(left, height)]
        while len(left):
            inside = np.searchsorted(left, left + _SAME_HEIGHT, side="right") - np.arange(len(left))
            first = int(inside.argmax())
            height = float(np.median(left[first : first + inside[first]]))
            if not found or inside[first] >= _FEWEST:
                found.append(height)
            left = left[~same_storey(left, height)]
    found.sort()
    labels = [_label(recorded, height, index) for index, height in enumerate(found)]
    return tuple(
        Storey(label=label if labels.count(label) == 1 else f"{label} at {height:.1f} m", floor_y=round(height, 2))
        for label, height in zip(labels, found, strict=True)
    )


def _with_ceilings(storeys: tuple[Storey, ...], standing: Sequence[Furniture]) -> tuple[Storey, ...]:
    """The storeys with ceilings above the pieces that stand there, but below the next storey."""
    found = []
    for k, storey in enumerate(storeys):
        tops = [piece.top_y - storey.floor_y for piece in standing if abs(piece.bottom_y - storey.floor_y) < 0.5]
        ceiling = min(max([_CEILING, *(top + _ABOVE_TOP for top in tops)]), _HIGHEST)
        gap = storeys[k + 1].floor_y - storey.floor_y if k + 1 < len(storeys) else math.inf
        if gap > _BESIDE:
            ceiling = min(ceiling, gap - _SLAB)
        found.append(storey.model_copy(update={"ceiling": round(ceiling, 2)}))
    return tuple(found)


def _label(recorded: Recorded, height: float, index: int) -> str:
    labels = Counter(g.floor_id for g in recorded.goals.values() if abs(g.floor_y - height) < STOREY_GAP / 2)
    label = labels.most_common(1)[0][0] if labels else str(index)
    return floor_name(int(label)) if re.fullmatch(r"-?[0-9]{1,2}", label) else f"floor {label}"


def _empty_grid(standing: NDArray[np.float64]) -> CellGrid:
    low = np.floor((standing[:, [0, 2]].min(axis=0) - MARGIN) / CELL) * CELL
    cols, rows = np.ceil((standing[:, [0, 2]].max(axis=0) + MARGIN - low) / CELL).astype(int)
    origin = (round(float(low[0]), 4), round(float(low[1]), 4))
    return CellGrid(origin_xz=origin, shape=(int(rows), int(cols)), walkable=())
