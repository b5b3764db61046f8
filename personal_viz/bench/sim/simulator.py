"""The simulator benchmark: scenes of several sizes, each measured in rendering, loading, walking and browser copies."""

import datetime
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim.frames import T_world_camera
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster, own_cores
from sim.tasks.provenance import git_commit, package_versions
from sim.types import Camera
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh

from .budget import Budget, since_process_start_s
from .copies import BrowserFigures
from .loading import LoadFigures, measured_loads
from .parts import browser_part, compiling, navmesh_path_us
from .rendering import render_figures
from .report import Machine, SimReport, SizeFigures, growth, size_name, targets
from .scenes import bench_mesh, write_bench_glb
from .walking import camera_starts, env_steps_per_s, navigation_figures

Progress = Callable[[str], None]
_MORE_PACKAGES = ("embreex", "llvmlite", "imagecodecs")
_GOLDEN_NAVMESH = Path(__file__).resolve().parents[4] / "shared" / "habitat-golden" / "dev_a.navmesh"
"""A .navmesh of Habitat beside a developer's checkout; without it the figure is left out."""
NOTES = (
    "Milliseconds of rendering: CPU time of all threads per 640 x 480 frame, one thread at work, medians over the same "
    "poses in rooms, the contestants measured in turn; two frames of each before are not counted. Nothing is cached "
    "between frames.",
    "Raw bound: Embree's coherent packets over the same tiles on rays that were filled before, on a tree made in the "
    "same way; it makes no rays and reads no hits. (Fetching rays takes 3-5 % longer than making "
    "them, so depth can come out below.) Open3D: `cast_rays` alone on rays that were filled before.",
    "Loading: fresh processes in turn, CPU time, the file in the page cache; imports (those of the JPEG decoders too, "
    "for both) and compiled code ready, nothing decoded before. Ours: GLB file to first frame. trimesh: `load_scene` "
    "and every texture decoded, no search tree, no frame; `load_scene` alone, which leaves JPEGs undecoded, stands "
    "beside it.",
    "Navigation: CPU time, the map built warm; path = `shortest_path` through Python with the goal's field at hand, "
    "field = the first question to a goal. Steps per second are elapsed time, one thread.",
)


class BenchSize(NamedTuple):
    """One scene of the benchmark."""

    faces: int
    cluttered: bool = False
    with_load: bool = True
    """Whether loading is measured, which takes some seconds a time."""
    with_variants: bool = True
    """Whether other texture filters and a smaller picture are measured."""
    with_browser: bool = False
    """Whether a browser copy is made."""
    need_s: float = 0.0
    """Elapsed seconds that it takes on the machine of SIM.md, asked only where there is a budget."""

    @property
    def name(self) -> str:
        """`100k`, `1M cluttered`."""
        return size_name(self.faces, self.cluttered)


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """What is measured and how often."""

    sizes: tuple[BenchSize, ...]
    left_out: tuple[str, ...] = ()
    """Names of sizes and parts that the full benchmark has and this one has not."""
    poses: int = 16
    rounds: int = 3
    load_repeats: int = 3
    env_steps: int = 200
    clicks: int = 20_000
    texture_size: int = 2048
    num_textures: int = 28
    seed: int = 0
    budget_s: float | None = None
    """Elapsed seconds since the process's start until the last part ends; what does not fit is left out. None = any."""


FULL = BenchSettings(
    tuple(
        BenchSize(faces, cluttered, with_browser=faces == 1_000_000)
        for cluttered in (False, True)
        for faces in (100_000, 500_000, 1_000_000, 2_000_000)
    )
)
QUICK = BenchSettings(
    (
        BenchSize(1_000_000, with_browser=True, need_s=13.0),
        BenchSize(1_000_000, True, with_load=False, with_variants=False, need_s=12.0),
        BenchSize(100_000, with_load=False, with_variants=False, need_s=5.0),
    ),
    left_out=(
        "500k",
        "2M",
        "100k cluttered",
        "500k cluttered",
        "2M cluttered",
        "loading and texture filters of 100k and 1M cluttered",
    ),
    poses=12,
    rounds=1,
    env_steps=60,
    clicks=10_000,
    budget_s=46.0,  # of 50: writing the table and the picture takes 2 s
)
_BROWSER_NEED_S, _NAVMESH_NEED_S = 9.0, 3.0
"""Elapsed seconds on the machine of SIM.md, compiled code at hand; where it is not, the part is ended in time."""


class _Made(NamedTuple):
    """The scene of one size."""

    mesh: TriangleMesh
    navigation: FloorGrid


class _Run:
    """What is left of a run's time, and what was left out for want of it."""

    def __init__(self, settings: BenchSettings, progress: Progress) -> None:
        self.budget = Budget(settings.budget_s)
        self.left_out = list(settings.left_out)
        self.pace = 1.0
        """How much slower this machine is than that of SIM.md, or how busy."""
        self._progress = progress

    def begins(self, what: str, need_s: float) -> bool:
        """Whether a part fits into the time left; otherwise it is named as left out."""
        if self.budget.has(need_s * self.pace):
            self._progress(what)
            return True
        self.leave_out(what)
        return False

    def leave_out(self, what: str) -> None:
        """Names a part as left out."""
        self._progress(f"{what}: left out, no time left")
        self.left_out.append(f"{what} (no time left)")


def run_benchmark(settings: BenchSettings, *, quick: bool, progress: Progress) -> SimReport:
    """Measures the first size, the browser copies, the other sizes and a navmesh, the most important first.

    Args:
        settings: What to measure.
        quick: Written into the report.
        progress: Told what is being measured, one line at a time.

    Raises:
        SceneError: A process that measures a part failed.
    """
    started, run = time.perf_counter(), _Run(settings, progress)
    sizes, copies = _sizes_and_copies(settings, run, progress)
    sizes = dict(sorted(sizes.items(), key=lambda item: (item[1].cluttered, item[1].faces)))
    path_us = _navmesh_path_us(settings.seed, run)
    return SimReport(
        quick=quick,
        sizes=sizes,
        left_out=tuple(run.left_out),
        browser=copies,
        navmesh_path_us=path_us,
        growth=growth(tuple(sizes.values())),
        targets=targets(sizes, copies),
        machine=machine(),
        notes=NOTES,
        created_utc=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        git_commit=git_commit(),
        seconds=time.perf_counter() - started if settings.budget_s is None else since_process_start_s(),
    )


def _sizes_and_copies(
    settings: BenchSettings, run: _Run, progress: Progress
) -> tuple[dict[str, SizeFigures], dict[str, BrowserFigures]]:
    """The first size, then what has a copy, then the others, as far as there is time."""
    first, *others = settings.sizes
    sizes: dict[str, SizeFigures] = {}
    copies: dict[str, BrowserFigures] = {}
    if run.begins(first.name, 0.0):  # an empty budget alone leaves it out
        progress(f"{first.name}: making the scene")
        with compiling():
            made = _made(first, settings)
        sizes[first.name] = _size_figures(first, made, settings, run, progress)
        del made
    for size in [size for size in settings.sizes if size.with_browser]:
        name = f"browser copy of {size.name}"
        if run.begins(name, _BROWSER_NEED_S):
            copy = _browser_copy(size, settings, run.budget.left_s)
            if copy is None:
                run.leave_out(name)
            else:
                copies[size.name] = copy
    for size in others:
        if run.begins(size.name, size.need_s):
            progress(f"{size.name}: making the scene")
            sizes[size.name] = _size_figures(size, _made(size, settings), settings, run, progress)
    return sizes, copies


def machine() -> Machine:
    """This processor, what the renderer chose on it, and the packages."""
    backend = Raycaster(bench_mesh(1, cluttered=False, texture_size=4, num_textures=1)).backend
    versions = package_versions()
    for name in _MORE_PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return Machine(
        cpu=_cpu_model(),
        cores=own_cores(),
        backend=backend.name,
        packet_width=backend.packet_width,
        backend_reason=backend.reason,
        python=platform.python_version(),
        versions=versions,
    )


def _size_figures(size: BenchSize, made: _Made, settings: BenchSettings, run: _Run, progress: Progress) -> SizeFigures:
    mesh, navigation = made
    camera, seed, began = Camera(), settings.seed, time.perf_counter()
    progress(f"{size.name}: rendering")
    poses = camera_starts(navigation, settings.poses, seed=seed)
    Ts_world_camera = np.stack([T_world_camera(pose, camera) for pose in poses])
    drawn = render_figures(
        mesh, Ts_world_camera, threads=own_cores(), rounds=settings.rounds, with_variants=size.with_variants
    )
    progress(f"{size.name}: navigation and environment")
    walked = navigation_figures(mesh, navigation, seed=seed)
    raycaster, steps = Raycaster(mesh, threads=1), settings.env_steps
    steps_per_s = env_steps_per_s(navigation, raycaster, camera=camera, num_steps=steps, seed=seed)
    steps_only_per_s = env_steps_per_s(navigation, None, camera=camera, num_steps=10 * steps, seed=seed)
    if size.need_s:
        run.pace = max(1.0, (time.perf_counter() - began) / size.need_s)
    ours, trimesh = _loads(size, mesh, settings, run, progress) if size.with_load else (None, None)
    return SizeFigures(
        faces=len(mesh.faces),
        cluttered=size.cluttered,
        rgbd_over_raw=drawn.raw_ms and drawn.rgbd_ms / drawn.raw_ms,
        depth_over_raw=drawn.raw_ms and drawn.depth_ms / drawn.raw_ms,
        open3d_over_rgbd=drawn.open3d_rays_ms / drawn.rgbd_ms,
        load_over_trimesh=ours and trimesh and ours.core_s / trimesh.core_s,
        load_over_trimesh_undecoded=ours and trimesh and ours.core_s / trimesh.parse_core_s,
        load_wall_over_trimesh=ours and trimesh and ours.wall_s / trimesh.wall_s,
        rss_mb=ours and ours.rss_mb,
        env_steps_per_s=steps_per_s,
        env_steps_per_s_without_rendering=steps_only_per_s,
        load=ours,
        trimesh=trimesh,
        **drawn.model_dump(),
        **walked.model_dump(),
    )


def _made(size: BenchSize, settings: BenchSettings) -> _Made:
    mesh = bench_mesh(
        size.faces,
        cluttered=size.cluttered,
        seed=settings.seed,
        texture_size=settings.texture_size,
        num_textures=settings.num_textures,
    )
    return _Made(mesh, floor_grid_from_mesh(mesh))


def _loads(
    size: BenchSize, mesh: TriangleMesh, settings: BenchSettings, run: _Run, progress: Progress
) -> tuple[LoadFigures, LoadFigures]:
    """Loading of the mesh as a GLB file: ours and trimesh's; repeated while that leaves time for a browser copy."""
    progress(f"{size.name}: loading in fresh processes")
    reserve_s = _BROWSER_NEED_S * run.pace if size.with_browser else 0.0
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as folder:
        path = Path(folder) / "house.glb"
        write_bench_glb(path, mesh)
        return measured_loads(
            path, repeats=settings.load_repeats, has_time=lambda need_s: run.budget.has(need_s + reserve_s)
        )


def _browser_copy(size: BenchSize, settings: BenchSettings, timeout_s: float) -> BrowserFigures | None:
    return browser_part(
        faces=size.faces,
        clicks=settings.clicks,
        seed=settings.seed,
        textures=(settings.num_textures, settings.texture_size),
        timeout_s=timeout_s,
    )


def _navmesh_path_us(seed: int, run: _Run) -> float | None:
    """`path_us` on a navmesh of Habitat, None where there is none, or no time left."""
    name = "path on a .navmesh"
    if not _GOLDEN_NAVMESH.is_file() or not run.begins(name, _NAVMESH_NEED_S):
        return None
    path_us = navmesh_path_us(_GOLDEN_NAVMESH, seed=seed, timeout_s=run.budget.left_s)
    if path_us is None:
        run.leave_out(name)
    return path_us


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()
