"""Open a scene by name: a scan on disk, the plan of an invented home, or the schematic home of a dataset's scene."""

import hashlib
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.types import SceneKind
from sim.world.floor_grid import FloorGrid, floor_grid_from_mesh

from .furnish import mesh_from_plan
from .glb import load_glb
from .kind import plan_of, scene_kind
from .plan import HomePlan, cells_from_runs
from .recover import recover_plan
from .scene import Scene
from .walkable import PLAN_CLIMB


def open_scene(dataset: PersonalDataset, name: str, *, scenes_dir: Path | None = None) -> Scene:
    """The scene that the dataset's episodes of `name` take place in.

    Args:
        dataset: Its folder may hold `scenes/<name>.plan.json`, the plan of an invented home.
        name: Scene name, as in the content files.
        scenes_dir: Folder of scans; `<scenes_dir>/**/<name>.glb` is loaded. None = a plan, or else a schematic home.

    Raises:
        DatasetError: The dataset has no such scene.
        SceneError: The scan or the plan is missing, damaged, or cannot be walked in.
    """
    dataset.require_scene(name)
    if scenes_dir is not None:
        return _scan(find_scan(name, scenes_dir), name, scene_kind(dataset, name, scenes_dir))
    return scene_from_plan(plan_of(dataset, name) or recover_plan(dataset, name))


def scene_from_plan(plan: HomePlan) -> Scene:
    """A planned home with its mesh, objects and walkable places.

    Raises:
        SceneError: The robot can stand nowhere in it.
    """
    mesh, objects = mesh_from_plan(plan)
    digest = hashlib.sha256(mesh.digest().encode())
    if plan.cells is None:
        navigation = floor_grid_from_mesh(mesh)
    else:
        cells = cells_from_runs(plan.cells.walkable)
        navigation = FloorGrid.from_cells(cells.rc, cells.y, grid=plan.cells.grid, max_climb=PLAN_CLIMB)
        digest.update(navigation.digest.encode())
    return Scene(plan.name, plan.kind, mesh, objects, navigation, digest.hexdigest())


def find_scan(name: str, scenes_dir: Path) -> Path:
    """The file of a scan.

    Raises:
        SceneError: No folder below `scenes_dir` holds `<name>.glb`.
    """
    found = sorted(scenes_dir.glob(f"**/{name}.glb"))
    if not found:
        basis = sorted(scenes_dir.glob(f"**/{name}.basis.glb"))
        also = f"; found only {basis[0]}, whose Basis textures are not supported yet" if basis else ""
        raise SceneError(
            f"{scenes_dir}: found no {name}.glb in any folder below{also}; expected {scenes_dir}/**/{name}.glb. "
            "Give --scenes-dir the folder that holds the scans, or leave it out to use the schematic home."
        )
    return found[0]


def _scan(path: Path, name: str, kind: SceneKind) -> Scene:
    mesh = load_glb(path)
    try:
        navigation = floor_grid_from_mesh(mesh)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    return Scene(name, kind, mesh, (), navigation, mesh.digest())
