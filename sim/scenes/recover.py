"""A schematic home from the episode files alone: where the robot stood is floor, where it looked is open, else wall.

Episode files -> HomePlan. Standing points are the original view points and the starts of all splits.
"""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Goal
from sim.errors import SceneError
from sim.frames import yaw_towards
from sim.types import AGENT_RADIUS, CAMERA_HEIGHT, STOREY_GAP

from .cell_mesh import floor_layers, grown
from .cells import CELL, CellGrid, Cells, runs_from_cells
from .furniture.appearance import COLOURS, rgb_from_text
from .furniture.families import look_of
from .plan import Finish, Furniture, HomePlan, Rect, Room, Storey
from .walkable import walkable_cells

MARGIN = 2.0
"""Empty border around the standing points (metres)."""
PLINTH = 0.25
_LOW_PLINTH = 0.02
_FLOOR_LABELS = {"0": "ground floor", "1": "first floor", "2": "second floor", "-1": "basement"}


class Recorded(NamedTuple):
    """What the episode files say about one scene."""

    standing: NDArray[np.float64]
    """(N, 3) places where the robot stood."""
    goals: dict[str, Goal]
    captions: dict[str, str]
    """First caption of each object that some episode asks for."""


def recover_plan(dataset: PersonalDataset, scene: str) -> HomePlan:
    """The schematic home of a scene, from its episodes in all splits.

    Raises:
        DatasetError: The scene is unknown or its files are damaged.
        SceneError: The files hold no place to stand.
    """
    recorded = recorded_facts(dataset, scene)
    if not len(recorded.standing):
        raise SceneError(
            f"{dataset.root}: scene {scene!r} has no original view point and no episode; expected places to stand. "
            "Give --scenes-dir the folder of its scan."
        )
    storeys = _storeys(recorded)
    grid = _empty_grid(recorded.standing)
    walkable = walkable_cells(recorded.standing, storeys, grid=grid)
    grid = grid.model_copy(update={"walkable": runs_from_cells(walkable)})
    furniture = tuple(_furniture(goal, recorded, storeys) for _, goal in sorted(recorded.goals.items()))
    grid = grid.model_copy(update={"plinth": runs_from_cells(_plinth_cells(recorded, furniture, grid, storeys))})
    rooms = tuple(
        Room(name=storey.label, storey=k, floor=Finish(rgb=_FLOOR_RGB[k % 3]), wall=Finish(rgb=_WALL_RGB[k % 3]))
        for k, storey in enumerate(storeys)
    )
    return HomePlan(name=scene, kind="schematic", storeys=storeys, rooms=rooms, furniture=furniture, cells=grid)


_FLOOR_RGB = ((176, 148, 116), (150, 156, 164), (160, 140, 130))
_WALL_RGB = ((218, 212, 200), (202, 214, 220), (220, 206, 210))


def recorded_facts(dataset: PersonalDataset, scene: str) -> Recorded:
    """Standing points (deduplicated), goals and captions of a scene.

    Raises:
        DatasetError: The scene is unknown or its files are damaged.
    """
    goals = dataset.goals(scene)
    standing = {point.agent_state.position for goal in goals.values() for point in goal.original_view_points}
    captions: dict[str, str] = {}
    for episode in dataset.episodes(scenes=(scene,)):
        standing.add(episode.record.start_position)
        for name, texts in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
            if texts:
                captions.setdefault(name, texts[0])
    points = np.array(sorted({tuple(round(value, 4) for value in point) for point in standing}), float)
    return Recorded(points.reshape(-1, 3), goals, captions)


def _storeys(recorded: Recorded) -> tuple[Storey, ...]:
    """Floors at the heights where most points are, at least STOREY_GAP apart."""
    left = np.sort(recorded.standing[:, 1])
    found: list[float] = []
    while len(left):
        inside = np.searchsorted(left, left + 0.15, side="right") - np.arange(len(left))
        first = int(inside.argmax())
        height = float(np.median(left[first : first + inside[first]]))
        if not found or inside[first] >= 10:
            found.append(height)
        left = left[np.abs(left - height) >= STOREY_GAP]
    found.sort()
    labels = [_label(recorded, height, index) for index, height in enumerate(found)]
    return tuple(
        Storey(label=label if labels.count(label) == 1 else f"{label} at {height:.1f} m", floor_y=round(height, 2))
        for label, height in zip(labels, found, strict=True)
    )


def _label(recorded: Recorded, height: float, index: int) -> str:
    labels = Counter(g.floor_id for g in recorded.goals.values() if abs(g.floor_y - height) < STOREY_GAP / 2)
    label = labels.most_common(1)[0][0] if labels else str(index)
    return _FLOOR_LABELS.get(label, f"floor {label}")


def _empty_grid(standing: NDArray[np.float64]) -> CellGrid:
    low = np.floor((standing[:, [0, 2]].min(axis=0) - MARGIN) / CELL) * CELL
    cols, rows = np.ceil((standing[:, [0, 2]].max(axis=0) + MARGIN - low) / CELL).astype(int)
    origin = (round(float(low[0]), 4), round(float(low[1]), 4))
    return CellGrid(origin_xz=origin, shape=(int(rows), int(cols)), walkable=())


def _furniture(goal: Goal, recorded: Recorded, storeys: tuple[Storey, ...]) -> Furniture:
    """A piece at the goal's recorded centre, with a size typical of its category that leaves standing points free."""
    family, (width, height, depth) = look_of(goal.object_category)
    x, y, z = goal.position
    seen_from = np.array([p.agent_state.position for p in goal.original_view_points or goal.view_points]).reshape(-1, 3)
    middle = seen_from.mean(axis=0) if len(seen_from) else np.array(goal.position)
    # fronts look along +z at yaw 0, while a robot looks along -z: facing the viewers is facing away from them, turned
    yaw = round((yaw_towards((x, z), (middle[0], middle[2])) + math.pi) / (math.pi / 2)) * (math.pi / 2)
    above_floor = y - goal.floor_y
    if family not in ("flat", "panel", "cloth", "box") and 0.3 * height < above_floor < 1.1 * height:
        height = 2 * above_floor  # it stands on the floor: the recorded centre tells its height
    sideways = round(yaw / (math.pi / 2)) % 2 == 1
    half = np.array([depth, width] if sideways else [width, depth]) / 2
    if family != "flat":
        half = _clipped(half, goal, recorded.standing, bottom=y - height / 2, top=y + height / 2)
    width, depth = (2 * half[::-1] if sideways else 2 * half).tolist()
    caption = recorded.captions.get(goal.object_name, "")
    storey = min(storeys, key=lambda storey: abs(storey.floor_y - goal.floor_y))
    if family == "flat":
        y = storey.floor_y + 0.012
    return Furniture(
        name=goal.object_name,
        category=goal.object_category,
        centre=(x, y, z),
        size=(width, height, depth),
        yaw=(yaw + math.pi) % (2 * math.pi) - math.pi,
        finish=Finish(rgb=rgb_from_text(caption) or rgb_from_text(goal.object_category) or _usual_rgb(goal)),
        caption=caption,
        room=storey.label,
    )


def _usual_rgb(goal: Goal) -> tuple[int, int, int]:
    """A colour for an object whose caption names none; differs between neighbours of one category."""
    if goal.object_category in ("tv", "monitor", "computer"):
        return COLOURS["black"]
    words = ("oak", "grey", "beige", "teal", "brown", "cream", "blue", "walnut")
    return COLOURS[words[goal.object_id % len(words)]]


def _clipped(
    half: NDArray[np.float64], goal: Goal, standing: NDArray[np.float64], *, bottom: float, top: float
) -> NDArray[np.float64]:
    """Half extents (2,) along x and z, shrunk until every standing point is AGENT_RADIUS away from the box."""
    in_the_way = (standing[:, 1] < top - 0.1) & (standing[:, 1] + CAMERA_HEIGHT > bottom)
    away = np.abs(standing[in_the_way][:, [0, 2]] - np.array([goal.position[0], goal.position[2]]))
    away = away[(away < half + AGENT_RADIUS).all(axis=1)]
    half = half.copy()
    for point in away[np.argsort(away.max(axis=1), kind="stable")]:
        if (point < half + AGENT_RADIUS).all():
            choices = [half.copy(), half.copy()]
            for axis, choice in enumerate(choices):
                choice[axis] = max(0.04, point[axis] - AGENT_RADIUS)
            half = max(choices, key=lambda choice: float(min(choice) + 0.1 * choice.sum()))
    return half


def _plinth_cells(
    recorded: Recorded, furniture: tuple[Furniture, ...], grid: CellGrid, storeys: tuple[Storey, ...]
) -> Cells:
    """Open space along every original view ray and under objects, where no floor is: tops of low blocks."""
    spec = grid.grid
    floor_y = np.array([storey.floor_y for storey in storeys])
    is_open = np.zeros((len(storeys), *grid.shape), bool)
    is_low = np.zeros_like(is_open)
    for piece in furniture:
        goal = recorded.goals[piece.name]
        eyes = np.array([p.agent_state.position for p in goal.original_view_points]).reshape(-1, 3)
        k = int(np.abs(floor_y - goal.floor_y).argmin())
        if len(eyes):
            num = math.ceil(np.linalg.norm(eyes - goal.position, axis=1).max() / (CELL / 2)) + 1
            share = np.linspace(0, 1, num)[:, None, None]
            points = eyes * (1 - share) + np.array(goal.position) * share  # (S, V, 3)
            rc = spec.rc_from_xz(points[..., [0, 2]])
            sight = (eyes[:, 1] + CAMERA_HEIGHT) * (1 - share[..., 0]) + goal.position[1] * share[..., 0]
            low = sight - floor_y[k] < PLINTH + 0.15
            is_open[k, rc[..., 0], rc[..., 1]] = True
            is_low[k, rc[low][:, 0], rc[low][:, 1]] = True
        rows, cols = _footprint(piece, grid)
        is_open[k, rows, cols] = is_low[k, rows, cols] = True
    floors = floor_layers(grid, storeys)[::2]
    parts = []
    for k in range(len(storeys)):
        opened, low = (_dilated(mask[k]) for mask in (is_open, is_low))
        base = grown(floors[k], math.inf)
        rows, cols = np.nonzero(opened & np.isnan(floors[k]))
        # storeys whose floor is far (a void, a stair well) take their own floor, not a neighbour on the stairs
        y = np.where(np.abs(base[rows, cols] - floor_y[k]) < 0.6, base[rows, cols], floor_y[k])
        y = np.round(y / 0.05) * 0.05 + np.where(low[rows, cols], _LOW_PLINTH, PLINTH)
        parts.append((np.stack([rows, cols], axis=1), y))
    rc = np.concatenate([part[0] for part in parts])
    return Cells(rc, np.concatenate([part[1] for part in parts]), np.zeros(len(rc), bool))


def _dilated(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask and its four neighbours."""
    padded = np.pad(mask, 1)
    return mask | padded[2:, 1:-1] | padded[:-2, 1:-1] | padded[1:-1, 2:] | padded[1:-1, :-2]


def _footprint(piece: Furniture, grid: CellGrid) -> tuple[slice, slice]:
    """Rows and columns under a piece."""
    rect: Rect = piece.rect
    corners = np.array([[rect.x0, rect.z0], [rect.x1, rect.z1]])
    (row0, col0), (row1, col1) = np.clip(grid.grid.rc_from_xz(corners), 0, np.array(grid.shape) - 1)
    return slice(int(row0), int(row1) + 1), slice(int(col0), int(col1) + 1)
