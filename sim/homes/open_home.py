"""Opens a scene by name: a scan on disk, the plan of an invented home, or the schematic home of a dataset's scene."""

import hashlib
import os
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sim.episodes.dataset import PersonalDataset
from sim.errors import NoFloorError, SceneError
from sim.frames import world_from_glb_zup
from sim.types import AGENT_HEIGHT, AGENT_RADIUS, ClutterLevel, SceneKind
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh

from ..mesh import Scene, SceneObject, TriangleMesh
from ..scans.hm3d import find_semantics, load_semantics
from ..scans.meshes import load_mesh
from ..scans.up_axis import HM3D_UP, Up, up_axis
from .building.house import mesh_from_plan
from .cells import cells_from_runs
from .clutter.plans import with_clutter
from .kind import scene_kind
from .plan import HomePlan, plan_bytes, plan_of, stored_plan
from .recovered.plans import recover_plan

if TYPE_CHECKING:
    from sim.walk.navmesh import NavMesh

SCAN_SUFFIXES = (".glb", ".basis.glb", ".gltf", ".ply", ".obj")
"""Suffixes of scan files, in the order in which they are tried."""


def open_scene(
    dataset: PersonalDataset,
    name: str,
    *,
    scenes_dir: Path | None = None,
    clutter: ClutterLevel = 0,
    labels: bool = False,
) -> Scene:
    """The scene of the dataset's episodes of `name`.

    Args:
        dataset: Its folder may hold `scenes/<name>.plan.json`, the plan of an invented home.
        name: Scene name, as in the content files.
        scenes_dir: Folder of scans; the file that `find_scan` finds in any folder below is loaded. Beside it,
            `<name>.semantic.glb` and `.semantic.txt` give the objects, and a `.navmesh` for a robot of our size gives
            the navigation map; without one the map is made from the mesh. Habitat's configuration files and HM3D's
            names say which axis is up (`up_axis`); z is up in invented homes and where episodes name HM3D. In others it
            is y, as glTF says, and a warning says so where z gives floor too. None = a plan, or a schematic home.
        clutter: Level of furniture without a caption that is added to a plan or schematic home (`with_clutter`).
        labels: Whether robots' pictures name the category of each object in view; vision agents can read that.

    Raises:
        DatasetError: The dataset has no such scene, or its episodes are damaged.
        SceneError: The scan, a file beside it or the plan is missing or damaged, the robot cannot walk in it, or
            clutter is requested for a scan.
        MissingDependencyError: The scan has Basis textures and the extra `basis` is not installed.
    """
    dataset.require_scene(name)
    if scenes_dir is not None:
        if clutter:
            raise SceneError(
                f"{scenes_dir}: found clutter level {clutter} for the scan of {name!r}; expected 0, since a scan "
                "shows its own. Leave out --clutter, or --scenes-dir to use the home made from its plan or episodes."
            )
        scan = find_scan(name, scenes_dir)
        up = said_up(dataset, name, scan, scenes_dir=scenes_dir)
        scene = _scan(scan, name, scene_kind(dataset, name, scenes_dir), up or "y")
        if up is None:
            _warn_of_doubt(scan, scene)
    else:
        scene = scene_from_plan(home_plan(dataset, name, clutter=clutter))
    return replace(scene, labels=True) if labels else scene


def open_scan(path: Path, *, up: Up | None = None) -> Scene:
    """A scan that needs no episodes; files beside it count as in `open_scene`.

    Args:
        path: A `.glb`, `.gltf`, `.ply` or `.obj` file.
        up: Its up axis; None = what Habitat's files in its folder and above, or HM3D's names, say, else y, with a
            warning where the file has floor with z up too.

    Raises:
        NoFloorError: The robot can stand nowhere in it.
        SceneError: The scan or a file beside it is missing or damaged.
        MissingDependencyError: As in `open_scene`.
    """
    said = up or up_axis(path, root=Path(path.anchor))
    scene = _scan(path, path.name.split(".")[0], "scan", said or "y")
    if said is None:
        _warn_of_doubt(path, scene)
    return scene


def open_unasked_scan(name: str, scenes_dir: Path) -> tuple[Scene, str]:
    """The scan of a scene that has no episodes yet, as `open_scene` opens it for episodes with the returned `scene_id`.

    The id is the path of the scan's file below `scenes_dir`, to which Habitat joins it.

    Raises:
        SceneError: As `open_scene`.
        MissingDependencyError: As `open_scene`.
    """
    scan = find_scan(name, scenes_dir)
    scene_id = scan.relative_to(scenes_dir).as_posix()
    up = up_axis(scan, root=scenes_dir) or (HM3D_UP if _names_hm3d(scene_id) else None)
    scene = _scan(scan, name, "scan", up or "y")
    if up is None:
        _warn_of_doubt(scan, scene)
    return scene, scene_id


def home_plan(dataset: PersonalDataset, name: str, *, clutter: ClutterLevel = 0) -> HomePlan:
    """The plan beside the episodes of `name`, or else the recovered plan; with clutter of seed 0.

    A plan with added clutter is kept in the cache folder, by its content and `HOMES_VERSION`.

    Raises:
        DatasetError: The dataset has no such scene.
        SceneError: The plan is damaged, has clutter of another level, or cannot be recovered.
    """
    plan = plan_of(dataset, name) or recover_plan(dataset, name)
    if clutter in (0, plan.clutter):
        return plan
    content = hashlib.sha256(plan_bytes(plan)).hexdigest()
    return stored_plan(f"clutter {clutter} {content}", lambda: with_clutter(plan, clutter, seed=0))


def scene_from_plan(plan: HomePlan) -> Scene:
    """A planned home with its mesh, objects and walkable places.

    Raises:
        NoFloorError: The robot can stand nowhere in it, or on less than 1 m2, as in Habitat.
    """
    mesh, objects = mesh_from_plan(plan)
    try:
        navigation = floor_grid_from_mesh(mesh)
    except NoFloorError:
        if plan.cells is None:
            raise
        floor = len(cells_from_runs(plan.cells.walkable).rc) * plan.cells.cell**2
        raise NoFloorError(
            f"home {plan.name!r}: its records make {floor:.2f} m2 of floor; expected at least 1 m2 in one piece. "
            "Add an edition with more episodes of it as evidence, or use the scan of the home (--scenes-dir)."
        ) from None
    digest = hashlib.sha256(mesh.digest().encode()).hexdigest()
    return Scene(
        name=plan.name,
        kind=plan.kind,
        mesh=mesh,
        objects=objects,
        navigation=navigation,
        digest=digest,
        clutter=plan.clutter,
        missing_storeys=plan.missing_storeys,
    )


def find_scan(name: str, scenes_dir: Path) -> Path:
    """The file of a scan, in any folder below `scenes_dir`, such as HM3D's `00800-<name>/<name>.basis.glb`.

    `<name>.glb` comes before `<name>.basis.glb`, which needs the extra `basis`; then come `.gltf`, `.ply` and `.obj`.
    Links to folders are followed, because Habitat's downloader makes such links. If several files match, the one
    reached through the fewest links counts, then the first by path. Links in the returned path are not resolved.

    Raises:
        SceneError: No folder below `scenes_dir` holds such a file.
    """
    order = {f"{name}{suffix}": place for place, suffix in enumerate(SCAN_SUFFIXES)}
    found = [(order[path.name], depth, path) for path, depth in _files_below(scenes_dir, set(order)) if path.exists()]
    if found:
        return min(found)[2]
    raise SceneError(
        f"{scenes_dir}: found no {name}.glb in any folder below; expected {scenes_dir}/**/{name}.glb "
        f"(or {', '.join(SCAN_SUFFIXES[1:])}). Give --scenes-dir the folder that holds the scans, or leave it out to "
        "use the schematic home."
    )


def navmeshes_beside(scan: Path, name: str) -> list[Path]:
    """The `.navmesh` files beside a scan, in the order in which they are tried, whatever robot they are made for."""
    named = (scan.with_suffix(".navmesh"), *(scan.with_name(f"{name}{end}") for end in (".navmesh", ".basis.navmesh")))
    return [path for path in dict.fromkeys(named) if path.is_file()]


def _files_below(root: Path, names: set[str]) -> Iterator[tuple[Path, int]]:
    """Files of these names in any folder below `root`, each with the number of links to folders that lead to it.

    Each folder is read once, even if several links lead to it; folders reached by fewer links come first.
    """
    seen = set[tuple[int, int]]()
    starts, depth = [str(root)], 0
    while starts:
        links: list[str] = []
        for start in starts:
            for folder, below, files in os.walk(start):
                status = os.stat(folder)
                if (status.st_dev, status.st_ino) in seen:
                    below.clear()
                    continue
                seen.add((status.st_dev, status.st_ino))
                below.sort()
                links += [path for name in below if os.path.islink(path := os.path.join(folder, name))]
                yield from ((Path(folder, name), depth) for name in names.intersection(files))
        starts, depth = links, depth + 1


def _scan(path: Path, name: str, kind: SceneKind, up: Up) -> Scene:
    mesh = load_mesh(path, up=up)
    objects: tuple[SceneObject, ...] = ()
    files = find_semantics(path, name)
    if files is not None:
        mesh, objects = load_semantics(*files, mesh, up=up)
    navmesh = _fitting_navmesh(path, name, mesh)
    if navmesh is not None:
        digest = hashlib.sha256(f"{mesh.digest()} {navmesh.digest}".encode()).hexdigest()
        return Scene(name, kind, mesh, objects, navmesh, digest)
    try:
        navigation = floor_grid_from_mesh(mesh)
    except SceneError as error:
        raise type(error)(f"{path}: {error}") from None
    return Scene(name, kind, mesh, objects, navigation, mesh.digest())


def said_up(dataset: PersonalDataset, name: str, scan: Path, *, scenes_dir: Path) -> Up | None:
    """The up axis of a scan by the files beside it, its name, its kind or its episodes; None where nothing says it.

    Raises:
        SceneError: A file of Habitat's is damaged, or two differ.
    """
    up = up_axis(scan, root=scenes_dir)
    if up is None and (scene_kind(dataset, name, scenes_dir) == "invented" or _is_in_hm3d(dataset, name)):
        return HM3D_UP
    return up


def _is_in_hm3d(dataset: PersonalDataset, name: str) -> bool:
    """Whether the scene's episodes name a file of HM3D."""
    first = next(dataset.episodes(scenes=(name,)), None)
    return first is not None and _names_hm3d(first.record.scene_id)


def _names_hm3d(scene_id: str) -> bool:
    return any(part.startswith("hm3d") for part in scene_id.split("/"))


def _warn_of_doubt(path: Path, scene: Scene) -> None:
    """Warns of a scan that nothing says to be y-up, if it has floor too where z is up; a navmesh leaves no doubt."""
    if not isinstance(scene.navigation, FloorGrid):
        return
    turned = replace(scene.mesh, vertices=world_from_glb_zup(scene.mesh.vertices))
    try:
        other = floor_grid_from_mesh(turned)
    except SceneError:
        return
    warnings.warn(
        f"{path}: read as y-up, as glTF is, it has {scene.navigation.area:.1f} m2 of floor; with z up {other.area:.1f} "
        f'm2. If it lies on its side, put {{"up": [0, 0, 1]}} in {path.name.split(".")[0]}.stage_config.json beside '
        "it; [0, 1, 0] there ends this warning.",
        stacklevel=3,
    )


def _fitting_navmesh(path: Path, name: str, mesh: TriangleMesh) -> "NavMesh | None":
    """The `.navmesh` beside a scan, if it is made for our robot; HM3D's own is for a taller and thinner robot."""
    from sim.walk.navmesh import load_navmesh

    for beside in navmeshes_beside(path, name):
        navmesh = load_navmesh(beside, mesh=mesh)
        if navmesh.fits(AGENT_RADIUS, AGENT_HEIGHT):
            return navmesh
    return None
