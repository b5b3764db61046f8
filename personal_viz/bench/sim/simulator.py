"""The simulator benchmark: rendering, loading, walking and browser copies of scenes of several sizes; homes."""

import math
import tempfile
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim.frames import T_world_camera
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster, own_cores
from sim.types import Camera
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh

from ..harness import Findings, Plan, Progress, Target, Values, since_process_start_s
from .children import compiling, in_child, measured_loads
from .homes import home_figures
from .rendering import render_figures
from .scenes import bench_mesh, write_bench_glb
from .walking import camera_starts, env_steps_per_s, navigation_figures

_MORE_PACKAGES = ("embreex", "llvmlite", "imagecodecs")
PLAN = Plan(
    targets={
        "sizes.1M.open3d_over_rgbd": Target(2.8, at_least=True),
        "sizes.1M.rgbd_over_raw": Target(1.7, goal="1.5"),
        "sizes.1M cluttered.rgbd_over_raw": Target(3.5),
        "sizes.1M.depth_over_raw": Target(1.15, goal="1.1"),
        "sizes.1M.load_over_trimesh": Target(1.0),
        "sizes.1M.rss_mb": Target(800.0),
        "sizes.1M.build_s": Target(0.5),
        "sizes.1M.path_us": Target(50.0),
        "sizes.1M.field_ms": Target(30.0),
        "homes.recovered.build_s": Target(1.0),
        "browser.1M.faces": Target(300_000.0),
        "browser.1M.megabytes": Target(15.0),
        "browser.1M.click_p99_mm": Target(20.0),
        "browser.2M cluttered.build_s": Target(90.0),
        "browser.2M soup.build_s": Target(90.0),
    },
    references={
        "rgbd_ms": "open3d_rays_ms",
        "depth_ms": "raw_ms",
        "open3d_rays_ms": "raw_ms",
        "rgbd_256_ms": "raw_256_ms",
        "wall_rgbd_1_ms": "wall_open3d_rays_1_ms",
        "wall_rgbd_ms": "wall_open3d_rays_ms",
        "load_s": "trimesh_s",
        "load_wall_s": "trimesh_wall_s",
        "rss_mb": "trimesh_rss_mb",
    },
    units={
        **dict.fromkeys(("raw_ms", "depth_ms", "rgbd_ms", "open3d_rays_ms"), "core-ms"),
        **dict.fromkeys(("raw_256_ms", "rgbd_256_ms", "field_ms"), "core-ms"),
        **dict.fromkeys(("build_s", "load_s", "trimesh_s", "plan_s", "build_most_s"), "core-s"),
        "path_us": "core-us",
    },
)
"""Targets of SIM.md, section 5; most are for a million triangles."""
NOTES = (
    "Milliseconds of rendering: CPU time of all threads per 640 x 480 frame, one thread at work, medians over the same "
    "poses in rooms, the renderers measured in turn, each after two frames that are not counted. Nothing is cached "
    "between frames.",
    "Raw bound: Embree's coherent packets over the same tiles on prefilled rays, on a tree made in the same way; it "
    "makes no rays and reads no hits. (Fetching rays takes 3-5 % longer than making them, so depth alone may be faster "
    "than this bound.) Open3D: `cast_rays` alone on prefilled rays.",
    "Loading: fresh processes in turn, CPU time, the file in the page cache; imports (those of the JPEG decoders too, "
    "for both) and compiled code ready, nothing decoded before. Ours: GLB file to first frame. trimesh: `load_scene` "
    "and every texture decoded, no search tree, no frame.",
    "Navigation: CPU time, compiled code ready; path = one `shortest_path` call from Python with the goal's field "
    "ready, field = the first query for a goal. Steps per second are elapsed time, one thread.",
    "Recovered homes: CPU time; plan = recovered from episodes with an empty cache, build = from a kept plan to the "
    "mesh with its light and navigation map.",
)
_INSTRUCTIONS = {16: "AVX-512", 8: "AVX or AVX2", 4: "SSE"}
"""The vector instructions of Embree by the width of its packets; Open3D's Embree picks the same ones."""
_LOAD_FIGURES = ("load_s", "load_wall_s", "rss_mb", "trimesh_s", "trimesh_wall_s", "trimesh_rss_mb")
"""Figures of `measured_loads`; None if loading is left out."""


class BenchSize(NamedTuple):
    """One scene of the benchmark."""

    faces: int
    cluttered: bool = False
    with_load: bool = True
    """Whether loading is measured, which takes some seconds each time."""
    with_browser: bool = False
    """Whether a browser copy is made."""
    need_s: float = 0.0
    """Elapsed seconds that it takes on the machine of SIM.md; used only with a budget."""

    @property
    def name(self) -> str:
        """The scene's name, such as `100k` or `1M cluttered`."""
        number = f"{self.faces / 1e6:g}M" if self.faces >= 1_000_000 else f"{self.faces / 1e3:g}k"
        return f"{number} cluttered" if self.cluttered else number


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """Sizes to measure, and numbers of repetitions."""

    sizes: tuple[BenchSize, ...]
    left_out: tuple[str, ...] = ()
    """Names of sizes and parts of the full benchmark that this one leaves out."""
    poses: int = 16
    rounds: int = 3
    load_repeats: int = 3
    env_steps: int = 200
    clicks: int = 20_000
    soup: int = 0
    """Triangles of a soup of which a browser copy is made; 0 = none."""
    with_homes: bool = True
    """Whether all recovered homes are built, which takes minutes."""
    texture_size: int = 2048
    num_textures: int = 28
    seed: int = 0
    budget_s: float | None = None
    """Seconds from the process's start to the last part's end; parts that do not fit are left out. None = no limit."""


FULL = BenchSettings(
    tuple(
        BenchSize(faces, cluttered, with_browser=faces == 1_000_000 or (cluttered and faces == 2_000_000))
        for cluttered in (False, True)
        for faces in (100_000, 500_000, 1_000_000, 2_000_000)
    ),
    soup=2_000_000,
)
QUICK = BenchSettings(
    (
        BenchSize(1_000_000, with_browser=True, need_s=13.0),
        BenchSize(1_000_000, True, with_load=False, need_s=12.0),
        BenchSize(100_000, with_load=False, need_s=5.0),
    ),
    left_out=(
        "500k",
        "2M",
        "100k cluttered",
        "500k cluttered",
        "2M cluttered",
        "2M soup",
        "loading of 100k and 1M cluttered",
        "recovered homes",
    ),
    poses=12,
    rounds=1,
    env_steps=60,
    clicks=10_000,
    with_homes=False,
    budget_s=46.0,  # of 50: writing the table and the picture takes 2 s
)
_BROWSER_NEED_S = 9.0
"""Elapsed seconds on the machine of SIM.md with compiled code in the cache; without it, the part is ended in time."""


class _Run:
    """The time left of a run, and the parts left out for lack of it."""

    def __init__(self, settings: BenchSettings, progress: Progress) -> None:
        """Counts from the process's start: imports and compiling count too."""
        budget_s = math.inf if settings.budget_s is None else settings.budget_s
        self._end_s = time.perf_counter() + budget_s - since_process_start_s()
        self.left_out = list(settings.left_out)
        self.pace = 1.0
        """Factor by which this machine is slower than that of SIM.md, or busier."""
        self.progress = progress

    @property
    def left_s(self) -> float:
        """Seconds left, never below 0; inf without a limit."""
        return max(self._end_s - time.perf_counter(), 0.0)

    def begins(self, what: str, need_s: float) -> bool:
        """Whether a part fits into the time left; otherwise names it as left out."""
        if 0 < self.left_s >= need_s * self.pace:
            self.progress(what)
            return True
        self.leave_out(what)
        return False

    def leave_out(self, what: str) -> None:
        """Names a part as left out."""
        self.progress(f"{what}: left out, no time left")
        self.left_out.append(f"{what} (no time left)")


def measure(settings: BenchSettings, progress: Progress) -> Findings:
    """Measures the first size, the browser copies and the other sizes, the most important first.

    Args:
        settings: What to measure.
        progress: Gets a line about the current work.

    Returns:
        Values: `sizes` by name (`1M cluttered`), `homes` that are recovered, and `browser` copies by the size's name.

    Raises:
        SceneError: A process that measures a part failed.
    """
    run = _Run(settings, progress)
    backend = Raycaster(bench_mesh(1, cluttered=False, texture_size=4, num_textures=1)).backend
    sizes, copies = _sizes_and_copies(settings, run)
    homes: dict[str, Values] = {}
    if settings.with_homes and run.begins("recovered homes", 0.0):
        homes["recovered"] = home_figures()
    sizes = dict(sorted(sizes.items(), key=lambda item: (item[1]["cluttered"], item[1]["faces"])))
    return Findings(
        {"sizes": sizes, "homes": homes, "browser": copies},
        notes=(*NOTES, f"Renderer: {backend.reason}"),
        left_out=run.left_out,
        versions={
            "renderer": f"{backend.name}, packets of {backend.packet_width}",
            "instructions": _INSTRUCTIONS.get(backend.packet_width, "unknown"),
            **_more_versions(),
        },
        seconds=None if settings.budget_s is None else since_process_start_s(),
    )


def _sizes_and_copies(settings: BenchSettings, run: _Run) -> tuple[dict[str, Values], dict[str, Values]]:
    """Figures of the first size, then of the browser copies, then of the other sizes, while there is time."""
    first, *others = settings.sizes
    sizes: dict[str, Values] = {}
    copies: dict[str, Values] = {}
    if run.begins(first.name, 0.0):  # only an empty budget leaves it out
        with compiling():
            made = _made(first, settings)
        sizes[first.name] = _size_figures(first, made, settings, run)
        del made
    for size in [size for size in settings.sizes if size.with_browser]:
        name = f"browser copy of {size.name}"
        if run.begins(name, _BROWSER_NEED_S):
            house = (size.faces, settings.clicks, settings.seed, settings.num_textures, settings.texture_size)
            copy = in_child("browser", *house, "cluttered" if size.cluttered else "", timeout_s=run.left_s)
            if copy is None:
                run.leave_out(name)
            else:
                copies[size.name] = copy
    name = f"{BenchSize(settings.soup).name} soup"
    if settings.soup and run.begins(f"browser copy of {name}", _BROWSER_NEED_S):
        copy = in_child("soup", settings.soup, settings.seed, timeout_s=run.left_s)
        if copy is None:
            run.leave_out(f"browser copy of {name}")
        else:
            copies[name] = copy
    for size in others:
        if run.begins(size.name, size.need_s):
            sizes[size.name] = _size_figures(size, _made(size, settings), settings, run)
    return sizes, copies


def _size_figures(size: BenchSize, made: tuple[TriangleMesh, FloorGrid], settings: BenchSettings, run: _Run) -> Values:
    mesh, navigation = made
    camera, seed, began = Camera(), settings.seed, time.perf_counter()
    run.progress(f"{size.name}: rendering")
    poses = camera_starts(navigation, settings.poses, seed=seed)
    Ts_world_camera = np.stack([T_world_camera(pose, camera) for pose in poses])
    drawn = render_figures(mesh, Ts_world_camera, threads=own_cores(), rounds=settings.rounds)
    run.progress(f"{size.name}: navigation and environment")
    walked = navigation_figures(mesh, navigation, seed=seed)
    raycaster, steps = Raycaster(mesh, threads=1), settings.env_steps
    steps_per_s = env_steps_per_s(navigation, raycaster, camera=camera, num_steps=steps, seed=seed)
    if size.need_s:
        run.pace = max(1.0, (time.perf_counter() - began) / size.need_s)
    loaded: dict[str, float | None] = dict.fromkeys(_LOAD_FIGURES)
    if size.with_load:
        loaded |= _loads(size, mesh, settings, run)
    return {
        "faces": len(mesh.faces),
        "cluttered": size.cluttered,
        **drawn,
        "rgbd_over_raw": _ratio(drawn["rgbd_ms"], drawn["raw_ms"]),
        "depth_over_raw": _ratio(drawn["depth_ms"], drawn["raw_ms"]),
        "open3d_over_rgbd": _ratio(drawn["open3d_rays_ms"], drawn["rgbd_ms"]),
        **loaded,
        "load_over_trimesh": _ratio(loaded["load_s"], loaded["trimesh_s"]),
        "load_wall_over_trimesh": _ratio(loaded["load_wall_s"], loaded["trimesh_wall_s"]),
        **walked,
        "env_steps_per_s": steps_per_s,
    }


def _made(size: BenchSize, settings: BenchSettings) -> tuple[TriangleMesh, FloorGrid]:
    mesh = bench_mesh(
        size.faces,
        cluttered=size.cluttered,
        seed=settings.seed,
        texture_size=settings.texture_size,
        num_textures=settings.num_textures,
    )
    return mesh, floor_grid_from_mesh(mesh)


def _loads(size: BenchSize, mesh: TriangleMesh, settings: BenchSettings, run: _Run) -> dict[str, float]:
    """`measured_loads` of the mesh as a GLB file, repeated as long as there is still time for a browser copy."""
    run.progress(f"{size.name}: loading in fresh processes")
    reserve_s = _BROWSER_NEED_S * run.pace if size.with_browser else 0.0
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as folder:
        path = Path(folder) / "house.glb"
        write_bench_glb(path, mesh)
        return measured_loads(
            path, repeats=settings.load_repeats, has_time=lambda need_s: run.left_s >= need_s + reserve_s
        )


def _ratio(value: float | None, reference: float | None) -> float | None:
    return None if value is None or reference is None else value / reference


def _more_versions() -> dict[str, str]:
    found = {}
    for name in _MORE_PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
