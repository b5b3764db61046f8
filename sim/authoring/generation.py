"""Invented PersONAL datasets: a home from a seed, people who own things in it, and searches, in the release's format.

Plan -> scene -> goals with view points -> ownership graphs -> content files. Nothing here needs licensed data.
"""

import gzip
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim.authoring.semantics_writer import rooms_of_objects, semantic_files
from sim.copies.glb_writer import glb_from_mesh
from sim.errors import DatasetError
from sim.frames import glb_zup_from_world, quat_xyzw_from_yaw
from sim.homes.invented.plans import invented_plans
from sim.homes.invented.recipes import GROUPS, SMALL
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan, plan_bytes
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.types import SPLITS
from sim.walk.viewpoints import SeenFrom, view_points_around

from ..episodes.schema import AgentState, EpisodeRecord, Goal, SceneFile, ViewPoint, goals_key
from .captions import caption_of
from .searches import FurnishedHome, draw_search

EPISODES_PER_SPLIT = 8
MAX_EPISODES_PER_SPLIT = 300
CATEGORIES = tuple(
    sorted(
        {member.category for members in GROUPS.values() for member in members}
        | {small.category for things in SMALL.values() for small in things}
    )
)
"""All categories of invented homes; ids in the files are places in this list, in every split."""


def invent_dataset(out: Path, *, name: str, seed: int) -> None:
    """Writes one invented home with its scans, plan and episodes of all splits; other homes in `out` stay.

    The files of `dataset_files` are written below `out`. The same name and seed give the same bytes. No file is left
    half-written.

    Raises:
        SceneError: The seed gives no home.
        DatasetError: The home gives no episodes for a split, or a file cannot be written.
    """
    write_files(out, dataset_files(name, seed=seed))


def dataset_files(name: str, *, seed: int, episodes_per_split: int = EPISODES_PER_SPLIT) -> dict[str, bytes]:
    """A whole dataset of one invented home (`invent_plan`), with 1 to 300 episodes per split: path below the dataset's
    folder to content.

    `scenes/<name>.plan.json`; for `--scenes-dir <out>/scenes`, in HM3D's form (z-up), `scenes/<name>.glb`,
    `scenes/<name>.semantic.glb`, `scenes/<name>.semantic.txt` and Habitat's `scenes/<name>.stage_config.json`; and for
    each split `<split>/content/<name>.json.gz` and the index `<split>/<split>.json.gz`, the same for all homes.

    Raises:
        SceneError: The seed gives no home.
        DatasetError: The home gives no episodes for a split, or the number is out of range.
    """
    if not 1 <= episodes_per_split <= MAX_EPISODES_PER_SPLIT:
        raise DatasetError(
            f"invent: episodes_per_split is {episodes_per_split!r}; expected 1 to {MAX_EPISODES_PER_SPLIT}. "
            "Give another number."
        )
    scene, home = _home(name, seed)
    rng = np.random.default_rng([seed, 1 << 20])
    files = _scene_files(scene, home.plan)
    asked: set[str] = set()
    for split in SPLITS:
        episodes: list[EpisodeRecord] = []
        for index in range(episodes_per_split):
            episodes.append(draw_search(home, split, index, asked=asked, rng=rng))
            asked = asked.union(episodes[-1].object_names)
        files[f"{split}/content/{name}.json.gz"] = _packed(_scene_file(home, tuple(episodes)))
        files[f"{split}/{split}.json.gz"] = _packed(_index())
    return files


def write_files(out: Path, files: dict[str, bytes]) -> None:
    """Writes all files under temporary names, then renames them.

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
        raise DatasetError(f"{out}: cannot be written ({error}); expected a writable folder. Change --out.") from None


def _home(name: str, seed: int) -> tuple[Scene, FurnishedHome]:
    """The seed's first home in whose mesh every piece can be seen and reached, as the plan's boxes promise."""
    for plan in invented_plans(name, seed=seed):
        scene = scene_from_plan(plan)
        goals = _goals(scene, plan)
        if goals is not None:
            captions = {piece.name: caption_of(piece, plan) for piece in plan.furniture}
            assert len(set(captions.values())) == len(captions)
            return scene, FurnishedHome(plan, scene.navigation, goals, captions)
    raise AssertionError("invented_plans ends with an error")


def _goals(scene: Scene, plan: HomePlan) -> dict[str, Goal] | None:
    """All pieces with reachable places that see them; None where a piece has no such place."""
    renderer = Raycaster(scene.mesh)
    storeys = {room.name: room.storey for room in plan.rooms}
    goals: dict[str, Goal] = {}
    anchor: np.ndarray | None = None
    for item, piece in zip(scene.objects, plan.furniture, strict=True):
        seen = view_points_around(item, scene.mesh, navigation=scene.navigation, renderer=renderer)
        if not seen:
            return None
        places = np.array([point.position for point in seen])
        anchor = places[:1] if anchor is None else anchor
        walked = np.isfinite(scene.navigation.distances(places, anchor))
        level = np.abs(places[:, 1] - plan.storeys[storeys[piece.room]].floor_y) < 0.5
        points = tuple(_view_point(point) for point, keep in zip(seen, walked & level, strict=True) if keep)
        if not points:
            return None
        goals[piece.name] = Goal(
            position=piece.centre,
            object_id=int(piece.name.rpartition("_")[2]),
            object_name=piece.name,
            object_category=piece.category,
            floor_id=str(storeys[piece.room]),
            view_points=points,
        )
    return goals


def _view_point(seen: SeenFrom) -> ViewPoint:
    """The view point, rounded as in the release."""
    x, y, z = (round(value, 5) for value in seen.position)
    _, qy, _, qw = quat_xyzw_from_yaw(seen.yaw)
    state = AgentState(position=(x, y, z), rotation=(0.0, round(qy, 6), 0.0, round(qw, 6)))
    return ViewPoint(agent_state=state, iou=round(seen.visible_share, 5))


def _scene_files(scene: Scene, plan: HomePlan) -> dict[str, bytes]:
    name = plan.name
    semantics = semantic_files(scene.mesh, scene.objects, region_of=rooms_of_objects(plan))
    zup = glb_zup_from_world(scene.mesh.vertices).astype(np.float32)
    stage = {"render_asset": f"{name}.glb", "up": [0, 0, 1], "front": [0, 1, 0]}
    return {
        f"scenes/{name}.plan.json": plan_bytes(plan),
        f"scenes/{name}.stage_config.json": json.dumps(stage, indent=1).encode(),
        f"scenes/{name}.glb": glb_from_mesh(replace(scene.mesh, vertices=zup)),
        f"scenes/{name}.semantic.glb": semantics.glb,
        f"scenes/{name}.semantic.txt": semantics.txt,
    }


def _scene_file(home: FurnishedHome, episodes: tuple[EpisodeRecord, ...]) -> SceneFile:
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
