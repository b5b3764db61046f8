"""Measures how one scan fits its episodes: files, axis, objects, places, lines of sight, path lengths, time, memory.

Dataset + scan -> `ScanCheck`: figures (no path, picture or text of the scan or the episodes) and the worst cases.
"""

import contextlib
import hashlib
import math
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import psutil
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from personal_viz.bench.harness import peak_mb
from personal_viz.bench.homes.held_out import Walk, path_ratios, recorded_walk, starts_on_floor
from personal_viz.bench.homes.sightlines import sights_of
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Goal
from sim.errors import PersonalVizError, SceneError
from sim.homes.kind import scene_kind
from sim.homes.open_home import find_scan, navmeshes_beside, open_scene, said_up
from sim.homes.recovered.recorded import original_places
from sim.mesh import Scene
from sim.types import EpisodeKey, SceneKind
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh
from sim.walk.navigation_map import NavigationMap
from sim.walk.navmesh import NavMesh, load_navmesh

MapName = Literal["navmesh", "grid"]
SAME_PLACE = 0.5
"""Largest distance of an object's centre in the scan from the recorded one (metres)."""
LEAST_PLAYABLE = 0.5
"""Least share of episodes with a path; a scan with less is another home, another version, or lies on its side."""
NUM_WORST = 3
"""Number of worst path lengths, and of worst centres, that are kept of a scan."""
_MODEL = ConfigDict(frozen=True, extra="forbid")


class MapFigures(BaseModel):
    """How one map of walkable places serves the episodes; shares are in [0, 1], null where nothing is counted."""

    model_config = _MODEL
    area_m2: float
    starts: float | None
    """Share of starts at which the robot can stand."""
    starts_near: float | None
    """Share of starts with a walkable place within 25 cm, on their storey."""
    view_points: float | None
    """Share of original view points at which the robot can stand."""
    paths: float | None
    """Share of episodes with a path from the start to `view_points[0]` of the target."""
    ratio_median: float | None
    """Median of our path length over the recorded one, over episodes with a path."""
    within_1: float | None
    """Share of episodes whose length is within 1 % of the recorded one; impossible records are left out."""
    within_5: float | None


class ScanFigures(BaseModel):
    """Figures of one scan; shares are in [0, 1], null where nothing is counted."""

    model_config = _MODEL
    kind: SceneKind = "scan"
    problem: str = ""
    """The reason why the scan cannot be used; empty = it can."""
    doubts: tuple[str, ...] = ()
    """What may be wrong with a scan that can be used."""
    file: str = ""
    """Name of the file, without its folder."""
    sha256: str = ""
    """Of the file."""
    digest: str = ""
    """`Scene.digest`: everything that distances and pictures depend on."""
    up: Literal["y", "z", ""] = ""
    """Axis that is up in the file; y where nothing says it."""
    triangles: int = 0
    textures: int = 0
    texture_mpx: float = 0.0
    """10^6 pixels of all textures."""
    objects: int = 0
    """Number of objects that the semantic files name and show."""
    goals: int = 0
    """Number of the episodes' goal objects."""
    goals_found: float | None = None
    """Share of goals whose `object_id` is an object of the scan, of the goal's category."""
    centres_near: float | None = None
    """Share of goals whose object has its centre within 0.5 m of the recorded one."""
    centre_median_m: float | None = None
    """Median distance of the two centres, over goals that are found."""
    goals_seen: float | None = None
    """Share of goals that at least one of their original view points sees."""
    views_seeing: float | None = None
    """Share of original view points from which the goal can be seen, standable or not."""
    episodes: int = 0
    impossible: int = 0
    """Episodes whose recorded length is below the straight line: it belongs to another place, and is not compared."""
    used: MapName | None = None
    """Map that this program walks on: the `.navmesh` if it is made for our robot, else our grid."""
    maps: dict[MapName, MapFigures] = {}
    """Figures on the shipped `.navmesh`, whatever robot it is made for, and on our grid of the mesh."""
    load_s: float = 0.0
    check_s: float = 0.0
    """Wall-clock seconds to open the scan, and to measure it."""
    peak_mb: float = 0.0
    """Largest resident memory meanwhile, 10^6 bytes."""


class WorstWalk(NamedTuple):
    """An episode whose length on the map that is used differs much from the recorded one."""

    key: EpisodeKey
    recorded: float
    """Metres."""
    ours: float
    """Metres; inf where there is no path."""
    path: NDArray[np.float64]
    """(K, 3) our path, or the two ends where there is none."""


class WorstCentre(NamedTuple):
    """A goal whose object lies elsewhere in the scan."""

    name: str
    """`object_name`."""
    recorded: tuple[float, float, float]
    found: tuple[float, float, float]

    @property
    def apart(self) -> float:
        """Metres between the two."""
        return math.dist(self.recorded, self.found)


class ScanCheck(NamedTuple):
    """All that `check-scans` says of one scan."""

    name: str
    figures: ScanFigures
    walks: tuple[WorstWalk, ...] = ()
    centres: tuple[WorstCentre, ...] = ()
    navigation: NavigationMap | None = None
    """The map that is used; None where the scan cannot be opened."""


def check_scan(dataset: PersonalDataset, name: str, *, scenes_dir: Path) -> ScanCheck:
    """Opens the scan of a scene and measures it; a scan that cannot be used has its reason in `figures.problem`.

    Raises:
        DatasetError: The scene's episodes are damaged.
    """
    dataset.require_scene(name)
    walks = [recorded_walk(episode) for episode in dataset.episodes(scenes=(name,))]
    begin_peak()
    began = time.perf_counter()
    found: dict[str, object] = {"episodes": len(walks), "kind": scene_kind(dataset, name, scenes_dir)}
    try:
        scan = find_scan(name, scenes_dir)
        found |= {"file": scan.name, "sha256": _sha256(scan)}
        found |= {"up": said_up(dataset, name, scan, scenes_dir=scenes_dir) or "y"}
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            scene = open_scene(dataset, name, scenes_dir=scenes_dir)
    except PersonalVizError as error:
        return ScanCheck(name, ScanFigures.model_validate(found | {"problem": _without_folder(str(error), scenes_dir)}))
    found |= {"load_s": round(time.perf_counter() - began, 1)}
    began = time.perf_counter()
    goals = dataset.goals(name)
    maps = _maps_of(scene, scan)
    figures = {kind: _map_figures(navigation, walks, goals) for kind, navigation in maps.items()}
    centres = _centres(scene, goals)
    found |= _object_figures(scene, goals, centres)
    found |= {
        "digest": scene.digest,
        "triangles": len(scene.mesh.faces),
        "textures": len(scene.mesh.textures),
        "texture_mpx": round(sum(image.shape[0] * image.shape[1] for image in scene.mesh.textures) / 1e6, 1),
        "impossible": sum(_is_impossible(walk) for walk in walks),
        "used": "grid" if isinstance(scene.navigation, FloorGrid) else "navmesh",
        "maps": figures,
    }
    checked = ScanFigures.model_validate(found)
    checked = checked.model_copy(
        update={
            "problem": _problem(checked),
            "doubts": (*(_without_folder(str(one.message), scenes_dir) for one in said), *_doubts(checked)),
            "check_s": round(time.perf_counter() - began, 1),
            "peak_mb": round(peak_mb(psutil.Process()), 0),
        }
    )
    worst = sorted((one for one in centres if one.apart > SAME_PLACE), key=lambda one: -one.apart)[:NUM_WORST]
    return ScanCheck(name, checked, _worst_walks(walks, scene.navigation), tuple(worst), scene.navigation)


def begin_peak() -> None:
    """Lets the peak of this process's memory begin anew, where the system can (Linux)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def _sha256(path: Path) -> str:
    """sha256 of a file; empty where it cannot be read, which `open_scene` says better."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def _without_folder(text: str, scenes_dir: Path) -> str:
    """The text without the folder of the scans, which nobody else needs to know."""
    return text.replace(f"{scenes_dir}/", "").replace(str(scenes_dir), "--scenes-dir")


def _maps_of(scene: Scene, scan: Path) -> dict[MapName, NavMesh | FloorGrid]:
    """The shipped map, if there is one, and the grid of the mesh, if it has a place to stand."""
    found: dict[MapName, NavMesh | FloorGrid] = {}
    used = scene.navigation
    if isinstance(used, NavMesh):
        found["navmesh"] = used
    elif shipped := navmeshes_beside(scan, scene.name):
        found["navmesh"] = load_navmesh(shipped[0], mesh=scene.mesh)
    with contextlib.suppress(SceneError):
        found["grid"] = used if isinstance(used, FloorGrid) else floor_grid_from_mesh(scene.mesh)
    return found


def _map_figures(navigation: NavMesh | FloorGrid, walks: Sequence[Walk], goals: dict[str, Goal]) -> MapFigures:
    starts = [walk.start for walk in walks]
    views = np.concatenate([original_places(goal) for goal in goals.values()] or [np.zeros((0, 3))])
    possible = [walk for walk in walks if not _is_impossible(walk)]
    ratios = path_ratios(possible, navigation)
    finite = ratios[np.isfinite(ratios)]
    off = np.abs(ratios - 1)
    return MapFigures(
        area_m2=round(navigation.area, 1),
        starts=_share([navigation.is_navigable(np.array(start)) for start in starts]),
        starts_near=_share(starts_on_floor(starts, navigation)),
        view_points=_share([navigation.is_navigable(place) for place in views]),
        paths=_share(np.isfinite(path_ratios(walks, navigation))),
        ratio_median=round(float(np.median(finite)), 4) if len(finite) else None,
        within_1=_share(off <= 0.01),
        within_5=_share(off <= 0.05),
    )


def _is_impossible(walk: Walk) -> bool:
    """Whether the recorded length is below the straight line, as in 12 of the release's 2,000 episodes."""
    return walk.recorded < math.dist(walk.start, walk.end) - 1e-3


def _centres(scene: Scene, goals: dict[str, Goal]) -> list[WorstCentre]:
    """The recorded and the found centre of every goal whose id and category the scan has."""
    items = {item.instance_id: item for item in scene.objects}
    return [
        WorstCentre(name, goal.position, item.centre)
        for name, goal in goals.items()
        if (item := items.get(goal.object_id)) is not None and item.category == goal.object_category
    ]


def _object_figures(scene: Scene, goals: dict[str, Goal], centres: Sequence[WorstCentre]) -> dict[str, object]:
    found: dict[str, object] = {"objects": len(scene.objects), "goals": len(goals)}
    if not scene.objects or not goals:
        return found
    apart = [one.apart for one in centres]
    sights = sights_of(scene, goals).values()
    return found | {
        "goals_found": _rounded(len(centres) / len(goals)),
        "centres_near": _rounded(sum(away <= SAME_PLACE for away in apart) / len(goals)),
        "centre_median_m": round(float(np.median(apart)), 3) if apart else None,
        "goals_seen": _share([bool((one.visible_share > 0).any()) for one in sights if len(one.visible_share)]),
        "views_seeing": _share(np.concatenate([one.visible_share > 0 for one in sights])),
    }


def _worst_walks(walks: Sequence[Walk], navigation: NavigationMap) -> tuple[WorstWalk, ...]:
    """The possible walks that are more than 5 % off, the worst first; those without a path come before all."""
    possible = [walk for walk in walks if not _is_impossible(walk) and walk.recorded > 0]
    ratios = path_ratios(possible, navigation)
    off = np.abs(np.log(np.maximum(ratios, 1e-6)))
    worst = [index for index in np.argsort(-off, kind="stable")[:NUM_WORST] if off[index] > 0.05]
    found = []
    for walk, ratio in ((possible[index], float(ratios[index])) for index in worst):
        path = navigation.shortest_path(np.array(walk.start), np.array([walk.end]))
        ends = np.array([walk.start, walk.end]) if path is None else path
        found.append(WorstWalk(walk.key, walk.recorded, ratio * walk.recorded, ends))
    return tuple(found)


def _problem(found: ScanFigures) -> str:
    """The reason why an opened scan cannot be used; empty = it can."""
    paths = found.maps[found.used].paths if found.used else None
    if paths is not None and paths < LEAST_PLAYABLE:
        return (
            f"{found.file}: {paths:.0%} of the episodes have a path from their start to a view point; expected nearly "
            "all. It is another home, another version of the scan, or lies on its side: compare it with HM3D v0.2."
        )
    if found.objects and found.centres_near is not None and found.centres_near < LEAST_PLAYABLE:
        return (
            f"{found.file}: {found.centres_near:.0%} of the episodes' objects are within {SAME_PLACE} m of their "
            "recorded centres; expected nearly all. Its semantic files are of another scan or version: copy all files "
            "again from HM3D v0.2."
        )
    return ""


def _doubts(found: ScanFigures) -> list[str]:
    said = []
    if not found.objects:
        said.append("no semantic files: objects, and what view points see, are not checked")
    if "navmesh" not in found.maps:
        said.append("no .navmesh beside it: only our own grid is checked")
    if "grid" not in found.maps:
        said.append("our grid has no place to stand")
    return said


def _share(values: Sequence[bool] | NDArray[np.bool_]) -> float | None:
    return _rounded(float(np.mean(values))) if len(values) else None


def _rounded(value: float) -> float:
    return round(value, 4)
