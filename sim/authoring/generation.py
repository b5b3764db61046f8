"""Invented PersONAL datasets: a home from a seed, people who own things in it, and searches, in the release's format.

Plan -> scene -> goals with view points -> ownership graphs -> content files. Nothing here needs licensed data.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim.authoring.semantics_writer import rooms_of_objects, semantic_files
from sim.copies.glb_writer import glb_from_mesh
from sim.errors import DatasetError
from sim.frames import glb_zup_from_world
from sim.homes.invented.plans import invented_plans
from sim.homes.invented.recipes import GROUPS, SMALL
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan, plan_bytes
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.types import SPLITS
from sim.walk.viewpoints import view_points_around

from ..episodes.schema import Goal
from .annotated import AnnotatedHome, Thing, view_point
from .captions import caption_of
from .content import content_file, index_file, packed
from .content import write_files as write_files
from .searches import MOST_EPISODES, Style, draw_searches

EPISODES_PER_SPLIT = 8
CATEGORIES = tuple(
    sorted(
        {member.category for members in GROUPS.values() for member in members}
        | {small.category for things in SMALL.values() for small in things}
    )
)
"""All categories of invented homes; ids in the files are places in this list, in every split."""
_CONFIG = "invented home, no scene dataset config"


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
    if not 1 <= episodes_per_split <= MOST_EPISODES:
        raise DatasetError(
            f"invent: episodes_per_split is {episodes_per_split!r}; expected 1 to {MOST_EPISODES}. Give another number."
        )
    scene, plan, home = _home(name, seed)
    files = _scene_files(scene, plan)
    rng = np.random.default_rng([seed, 1 << 20])
    drawn = draw_searches(home, dict.fromkeys(SPLITS, episodes_per_split), rng=rng, style=Style())
    for split, episodes in drawn.items():
        files[f"{split}/content/{name}.json.gz"] = packed(content_file(home, episodes, CATEGORIES))
        files[f"{split}/{split}.json.gz"] = packed(index_file(CATEGORIES))
    return files


def _home(name: str, seed: int) -> tuple[Scene, HomePlan, AnnotatedHome]:
    """The seed's first home in whose mesh every piece can be seen and reached, as the plan's boxes promise."""
    for plan in invented_plans(name, seed=seed):
        scene = scene_from_plan(plan)
        goals = _goals(scene, plan)
        if goals is not None:
            return scene, plan, _annotated(scene, plan, goals)
    raise AssertionError("invented_plans ends with an error")


def _annotated(scene: Scene, plan: HomePlan, goals: dict[str, Goal]) -> AnnotatedHome:
    captions = {piece.name: caption_of(piece, plan) for piece in plan.furniture}
    assert len(set(captions.values())) == len(captions)
    things = {
        piece.name: Thing(goals[piece.name], captions[piece.name], piece.room, (captions[piece.name], "", ""))
        for piece in plan.furniture
    }
    storeys = {str(number): storey.label for number, storey in enumerate(plan.storeys)}
    return AnnotatedHome(
        plan.name, f"invented/{plan.name}/{plan.name}.basis.glb", _CONFIG, scene.navigation, storeys, things
    )


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
        points = tuple(view_point(point) for point, keep in zip(seen, walked & level, strict=True) if keep)
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
