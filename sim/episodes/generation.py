"""Invented PersONAL episodes: a home from a seed, people who own things in it, and searches, in the release's format.

Plan -> scene -> goals with view points -> ownership graphs -> content files. Nothing here needs licensed data.
"""

import gzip
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.errors import DatasetError
from sim.frames import quat_xyzw_from_yaw
from sim.scenes.arrange import GROUPS
from sim.scenes.invent import invent_plan
from sim.scenes.plan import Furniture, HomePlan, plan_bytes
from sim.scenes.scene import Scene
from sim.scenes.sources import scene_from_plan
from sim.types import SPLITS, Split
from sim.world.raycast import Raycaster
from sim.world.viewpoints import view_points_around

from .captions import OwnedItem, are_mixed_up, caption_of, ownership_sentence, queries_for, write_description
from .checks_geometry import GEODESIC_LIMITS
from .people import NAMES, Edge, draw_ownership
from .schema import AgentState, EpisodeInfo, EpisodeRecord, Goal, SceneFile, Vector3, ViewPoint, goals_key

EPISODES_PER_SPLIT = 6
CATEGORIES = tuple(sorted({member.category for members in GROUPS.values() for member in members}))
"""All that invented homes can hold; ids in the files are places in this list, in every split."""
_TRIES = 60
_STARTS = 256
_LEAST_WAY = 1.0
"""Starts this near the target or one of its view points are already there (planar metres)."""
_CONFIG = "invented home, no scene dataset config"


@dataclass(frozen=True, slots=True)
class _Home:
    """A home with what its episodes need."""

    scene: Scene
    plan: HomePlan
    goals: dict[str, Goal]
    """By `object_name`; pieces that can be seen from somewhere."""
    captions: dict[str, str]

    def piece(self, name: str) -> Furniture:
        return next(piece for piece in self.plan.furniture if piece.name == name)

    def storey_of(self, piece: Furniture) -> int:
        return next(room.storey for room in self.plan.rooms if room.name == piece.room)


def invent_dataset(out: Path, *, name: str, seed: int) -> None:
    """Writes one invented home's plan and episodes of all splits; other homes in `out` stay.

    Below `out`: `scenes/<name>.plan.json`, `<split>/content/<name>.json.gz` and the index `<split>/<split>.json.gz`.
    The same name and seed give the same bytes. Nothing is left half-written.

    Raises:
        SceneError: The seed gives no home.
        DatasetError: The home gives no episodes of some split, or a file cannot be written.
    """
    write_files(out, dataset_files(name, seed=seed))


def dataset_files(name: str, *, seed: int) -> dict[str, bytes]:
    """What `invent_dataset` writes: path below the dataset's folder to content.

    Raises:
        SceneError: The seed gives no home.
        DatasetError: The home gives no episodes of some split.
    """
    plan = invent_plan(name, seed=seed)
    home = _home(plan)
    rng = np.random.default_rng([seed, 1])
    files = {f"scenes/{name}.plan.json": plan_bytes(plan)}
    for split in SPLITS:
        episodes = tuple(_episode(home, split, index, rng) for index in range(EPISODES_PER_SPLIT))
        files[f"{split}/content/{name}.json.gz"] = _packed(_scene_file(home, episodes))
        files[f"{split}/{split}.json.gz"] = _packed(_index())
    return files


def write_files(out: Path, files: dict[str, bytes]) -> None:
    """Writes all files beside their places, then renames them.

    Raises:
        DatasetError: A file cannot be written.
    """
    staged: list[tuple[Path, Path]] = []
    try:
        for path, data in files.items():
            target = out / path
            target.parent.mkdir(parents=True, exist_ok=True)
            staged.append((target.with_name(target.name + ".part"), target))
            staged[-1][0].write_bytes(data)
        for beside, target in staged:
            os.replace(beside, target)
    except OSError as error:
        for beside, _ in staged:
            beside.unlink(missing_ok=True)
        raise DatasetError(f"{out}: cannot be written ({error}). Give --out a folder that you can write.") from None


def _home(plan: HomePlan) -> _Home:
    scene = scene_from_plan(plan)
    renderer = Raycaster(scene.mesh)
    goals: dict[str, Goal] = {}
    for item, piece in zip(scene.objects, plan.furniture, strict=True):
        seen = view_points_around(item, scene.mesh, navigation=scene.navigation, renderer=renderer)
        points = tuple(_view_point(point.position, point.yaw, share=point.visible_share) for point in seen)
        storey = next(room.storey for room in plan.rooms if room.name == piece.room)
        if points:
            goals[piece.name] = Goal(
                position=piece.centre,
                object_id=int(piece.name.rpartition("_")[2]),
                object_name=piece.name,
                object_category=piece.category,
                floor_id=str(storey),
                view_points=points,
            )
    captions = {piece.name: caption_of(piece, plan) for piece in plan.furniture}
    return _Home(scene, plan, goals, captions)


def _view_point(position: Vector3, yaw: float, *, share: float) -> ViewPoint:
    return ViewPoint(agent_state=AgentState(position=position, rotation=quat_xyzw_from_yaw(yaw)), iou=share)


def _episode(home: _Home, split: Split, index: int, rng: np.random.Generator) -> EpisodeRecord:
    """One search; storeys take turns.

    Raises:
        DatasetError: No graph or no start was found in _TRIES tries.
    """
    storey = index % len(home.plan.storeys)
    names = [name for name in home.goals if home.storey_of(home.piece(name)) == storey]
    for _ in range(_TRIES):
        items = [names[k] for k in rng.permutation(len(names))]
        categories = [home.piece(name).category for name in items]
        conflicts = np.array([[are_mixed_up(a, b) for b in categories] for a in categories]).reshape(-1, len(items))
        edges = draw_ownership(split, conflicts, rng=rng)
        asked = edges[int(rng.integers(len(edges)))]
        start = _start(home, home.goals[items[asked.item]], split, rng)
        if start is not None:
            return _record(home, split, index, items, edges, asked, start, rng)
    raise DatasetError(
        f"invented home {home.plan.name!r}: split {split!r} has no target with a start at a distance in "
        f"{GEODESIC_LIMITS[split]} m, {_TRIES} tries; expected one. Take another --seed."
    )


def _start(home: _Home, goal: Goal, split: Split, rng: np.random.Generator) -> tuple[Vector3, float, float] | None:
    """(position, yaw, geodesic metres to the first view point) in the split's window, on the goal's storey."""
    navigation = home.scene.navigation
    points = np.array([navigation.random_point(rng, storey_y=goal.floor_y) for _ in range(_STARTS)])
    distances = navigation.distances(points, np.array([goal.view_points[0].agent_state.position]))
    low, high = GEODESIC_LIMITS[split]
    level = np.abs(points[:, 1] - goal.floor_y) < 0.1
    places = np.array([goal.position, *(point.agent_state.position for point in goal.view_points)])[:, [0, 2]]
    near = (np.linalg.norm(points[:, None, [0, 2]] - places, axis=2) <= _LEAST_WAY).any(axis=1)
    fits = np.flatnonzero((distances > low + 0.01) & (distances < high - 0.01) & level & ~near)
    if not len(fits):
        return None
    x, y, z = (float(value) for value in points[fits[0]])
    return (x, y, z), float(rng.uniform(-np.pi, np.pi)), float(distances[fits[0]])


def _record(
    home: _Home,
    split: Split,
    index: int,
    items: list[str],
    edges: list[Edge],
    asked: Edge,
    start: tuple[Vector3, float, float],
    rng: np.random.Generator,
) -> EpisodeRecord:
    people = [str(name) for name in rng.choice(NAMES, size=max(edge.person for edge in edges) + 1, replace=False)]
    goal = home.goals[items[asked.item]]
    position, yaw, geodesic = start
    scene = home.plan.name
    return EpisodeRecord(
        episode_id=str(_first_id(scene) + SPLITS.index(split) * EPISODES_PER_SPLIT + index),
        scene_id=f"invented/{scene}/{scene}.basis.glb",
        scene_dataset_config=_CONFIG,
        object_category=goal.object_category,
        object_id=goal.object_name,
        description=(home.captions[goal.object_name], "", ""),
        owner=people[asked.person],
        floor_id=goal.floor_id,
        summary=_summary(home, goal, items, edges, people, rng),
        extracted_summary=tuple(
            ownership_sentence(people[e.person], home.captions[items[e.item]], home.piece(items[e.item]).room)
            for e in edges
        ),
        query=queries_for(people[asked.person], goal.object_category),
        start_position=position,
        start_rotation=quat_xyzw_from_yaw(yaw),
        info=EpisodeInfo(
            geodesic_distance=geodesic,
            euclidean_distance=float(np.hypot(position[0] - goal.position[0], position[2] - goal.position[2])),
            closest_goal_object_id=goal.object_id,
        ),
    )


def _summary(
    home: _Home, goal: Goal, items: list[str], edges: list[Edge], people: list[str], rng: np.random.Generator
) -> str:
    owned = []
    for item in sorted({edge.item for edge in edges}):
        owners = tuple(people[edge.person] for edge in edges if edge.item == item)
        owned.append(OwnedItem(home.captions[items[item]], home.piece(items[item]).room, owners))
    floor = home.plan.storeys[int(goal.floor_id)].label
    return write_description(owned, floor=floor, rng=rng)


def _first_id(scene: str) -> int:
    """Episode ids of different homes do not meet: validators want them unique in a split."""
    return int(hashlib.sha256(scene.encode()).hexdigest()[:6], 16) * 100


def _scene_file(home: _Home, episodes: tuple[EpisodeRecord, ...]) -> SceneFile:
    by_category: dict[str, list[Goal]] = {}
    for goal in home.goals.values():
        by_category.setdefault(goals_key(home.plan.name, goal.object_category), []).append(goal)
    return _index().model_copy(
        update={
            "goals_by_category": {key: tuple(goals) for key, goals in sorted(by_category.items())},
            "episodes": episodes,
        }
    )


def _index() -> SceneFile:
    ids = {category: number for number, category in enumerate(CATEGORIES)}
    return SceneFile(
        goals_by_category={},
        episodes=(),
        category_to_task_category_id=ids,
        category_to_scene_annotation_category_id=ids,
    )


def _packed(content: SceneFile) -> bytes:
    """Compressed JSON without a time stamp, so that the same content gives the same bytes."""
    return gzip.compress((content.model_dump_json(by_alias=True, indent=2) + "\n").encode(), mtime=0)
