"""Measures how one scan fits its episodes: files, axis, objects, places, lines of sight, path lengths, time, memory.

Dataset + scan -> `ScanCheck`: figures, hashes and one-line reasons (no folder, picture or episode) and the worst cases.
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
from personal_viz.printed import one_line
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
LEAST = 0.5
"""A scan with a smaller share of starts on its floor, of paths, or of centres near, is no scan of the home."""
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
    """Share of compared episodes (see `impossible`) with a path from the start to `view_points[0]` of the target."""
    ratio_median: float | None
    """Median of our path length over the recorded one, over those with a path."""
    within_1: float | None
    """Share of compared episodes whose length is within 1 % of the recorded one."""
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
    sha256: dict[str, str] = {}
    """Of the file, its semantic files and each `.navmesh`, by name."""
    digest: str = ""
    """`Scene.digest`: everything that distances and pictures depend on."""
    up: Literal["y", "z"] | None = None
    """Axis that is up in the file; y where nothing says it."""
    triangles: int | None = None
    textures: int | None = None
    texture_mpx: float | None = None
    """10^6 pixels of all textures."""
    objects: int | None = None
    """Number of objects that the semantic files name and show."""
    goals: int | None = None
    """Number of the episodes' goal objects."""
    goals_found: float | None = None
    """Share of goals whose `object_id` is an object of the scan with the goal's `object_name`."""
    centres_near: float | None = None
    """Share of goals whose object has its centre within 0.5 m of the recorded one."""
    centre_median_m: float | None = None
    """Median distance of the two centres, over goals that are found."""
    goals_seen: float | None = None
    """Share of goals that at least one of their original view points sees."""
    views_seeing: float | None = None
    """Share of original view points from which the goal can be seen, standable or not."""
    episodes: int | None = None
    impossible: int | None = None
    """Episodes whose recorded length is 0 or below the straight line; they are not compared."""
    used: MapName | None = None
    """Map that this program walks on: the `.navmesh` if it is made for our robot, else our grid."""
    maps: dict[MapName, MapFigures] = {}
    """Figures on the shipped `.navmesh`, whatever robot it is made for, and on our grid of the mesh."""
    load_s: float | None = None
    check_s: float | None = None
    """Wall-clock seconds to open the scan, and to measure it."""
    peak_mb: float | None = None
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
    """Opens the scan of a scene and measures it; where this fails, `figures.problem` has the reason."""
    scenes_dir = scenes_dir.resolve()
    found: dict[str, object] = {}
    try:
        return _measured(dataset, name, scenes_dir, found)
    except PersonalVizError as error:
        return ScanCheck(name, ScanFigures.model_validate(found | {"problem": _without_folder(error, scenes_dir)}))


def _measured(dataset: PersonalDataset, name: str, scenes_dir: Path, found: dict[str, object]) -> ScanCheck:
    """The check of a scan; `found` is filled with figures as they become known."""
    found["kind"] = scene_kind(dataset, name, scenes_dir)
    walks = [recorded_walk(episode) for episode in dataset.episodes(scenes=(name,))]
    goals = dataset.goals(name)
    found |= {"episodes": len(walks), "goals": len(goals)}
    scan = find_scan(name, scenes_dir)
    semantics = [scan.with_name(f"{name}.semantic{end}") for end in (".glb", ".txt")]
    files = [path for path in (scan, *semantics, *navmeshes_beside(scan, name)) if path.is_file()]
    found |= {"file": scan.name, "sha256": {path.name: _sha256(path) for path in files}}
    found["up"] = said_up(dataset, name, scan, scenes_dir=scenes_dir) or "y"
    begin_peak()
    began = time.perf_counter()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene = open_scene(dataset, name, scenes_dir=scenes_dir)
    opened = time.perf_counter()
    compared = [walk for walk in walks if walk.recorded > max(0.0, math.dist(walk.start, walk.end) - 1e-3)]
    maps = _maps_of(scene, scan)
    ratios = {kind: path_ratios(compared, navigation) for kind, navigation in maps.items()}
    used: MapName = "grid" if isinstance(scene.navigation, FloorGrid) else "navmesh"
    centres = _centres(scene, goals)
    found |= _object_figures(scene, goals, centres)
    found |= {
        "digest": scene.digest,
        "triangles": len(scene.mesh.faces),
        "textures": len(scene.mesh.textures),
        "texture_mpx": round(sum(image.shape[0] * image.shape[1] for image in scene.mesh.textures) / 1e6, 1),
        "impossible": len(walks) - len(compared),
        "used": used,
        "maps": {kind: _map_figures(navigation, ratios[kind], walks, goals) for kind, navigation in maps.items()},
        "load_s": round(opened - began, 1),
        "check_s": round(time.perf_counter() - opened, 1),
        "peak_mb": round(peak_mb(psutil.Process())),
    }
    figures = ScanFigures.model_validate(found)
    doubts = [_without_folder(one.message, scenes_dir) for one in said if issubclass(one.category, UserWarning)]
    figures = figures.model_copy(update={"problem": _problem(figures), "doubts": (*doubts, *_doubts(figures))})
    apart = sorted((one for one in centres if one.apart > SAME_PLACE), key=lambda one: -one.apart)
    worst = _worst_walks(compared, ratios[used], scene.navigation)
    return ScanCheck(name, figures, worst, tuple(apart[:NUM_WORST]), scene.navigation)


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


def _without_folder(said: object, scenes_dir: Path) -> str:
    """The text on one line, without the folder of the scans, which nobody else needs to know."""
    return one_line(str(said)).replace(f"{scenes_dir}/", "").replace(str(scenes_dir), "the folder of the scans")


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


def _map_figures(
    navigation: NavMesh | FloorGrid, ratios: NDArray[np.float64], walks: Sequence[Walk], goals: dict[str, Goal]
) -> MapFigures:
    starts = [walk.start for walk in walks]
    views = np.concatenate([original_places(goal) for goal in goals.values()] or [np.zeros((0, 3))])
    has_path = np.isfinite(ratios)
    off = np.abs(ratios - 1)
    return MapFigures(
        area_m2=round(navigation.area, 1),
        starts=_share([navigation.is_navigable(np.array(start)) for start in starts]),
        starts_near=_share(starts_on_floor(starts, navigation)),
        view_points=_share([navigation.is_navigable(place) for place in views]),
        paths=_share(has_path),
        ratio_median=_rounded(float(np.median(ratios[has_path]))) if has_path.any() else None,
        within_1=_share(off <= 0.01),
        within_5=_share(off <= 0.05),
    )


def _centres(scene: Scene, goals: dict[str, Goal]) -> list[WorstCentre]:
    """The recorded and the found centre of every goal whose id and name the scan has."""
    items = {item.instance_id: item for item in scene.objects}
    return [
        WorstCentre(name, goal.position, item.centre)
        for name, goal in goals.items()
        if (item := items.get(goal.object_id)) is not None and item.name == name
    ]


def _object_figures(scene: Scene, goals: dict[str, Goal], centres: Sequence[WorstCentre]) -> dict[str, object]:
    found: dict[str, object] = {"objects": len(scene.objects)}
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


def _worst_walks(
    walks: Sequence[Walk], ratios: NDArray[np.float64], navigation: NavigationMap
) -> tuple[WorstWalk, ...]:
    """The walks that are more than 5 % off, the worst first; those without a path come before all."""
    off = np.abs(np.log(np.maximum(ratios, 1e-6)))
    found = []
    for index in (index for index in np.argsort(-off, kind="stable")[:NUM_WORST] if off[index] > 0.05):
        walk = walks[index]
        path = navigation.shortest_path(np.array(walk.start), np.array([walk.end]))
        ends = np.array([walk.start, walk.end]) if path is None else path
        found.append(WorstWalk(walk.key, walk.recorded, float(ratios[index]) * walk.recorded, ends))
    return tuple(found)


def _problem(found: ScanFigures) -> str:
    """The reason why an opened scan cannot be used; empty = it can."""
    walked = found.maps[found.used] if found.used else None
    if (
        walked is not None
        and min(share for share in (walked.starts_near, walked.paths, 1.0) if share is not None) < LEAST
    ):
        return (
            f"{found.file}: {walked.starts_near or 0:.0%} of the starts are on its floor, {walked.paths or 0:.0%} of "
            "the episodes have a path; expected nearly all. It is another home, another version, or lies on its side: "
            "compare it with HM3D v0.2."
        )
    if found.centres_near is not None and found.centres_near < LEAST:
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
    within = found.maps[found.used].within_5 if found.used else None
    if within is not None and within < LEAST:
        said.append(
            f"{within:.0%} of the path lengths are within 5 % of the recorded ones: is it the same home, unturned?"
        )
    return said


def _share(values: Sequence[bool] | NDArray[np.bool_]) -> float | None:
    return _rounded(float(np.mean(values))) if len(values) else None


def _rounded(value: float) -> float:
    return round(value, 4)
