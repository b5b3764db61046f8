"""Runs parts of the benchmark in fresh processes, to measure a fresh start and to end a part that takes too long.

`python -m personal_viz.bench.sim.children NAME ARGUMENTS` prints a part's figures as JSON; PARTS names them.
"""

import contextlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from sim.errors import SceneError

_COMMAND = (sys.executable, "-m", "personal_viz.bench.sim.children")
_LOAD_TIMEOUT_S = 300.0


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Compiles rendering, map queries and steps in a second process, while this one makes the first scene.

    Afterwards their code is in numba's cache; if it already was, this costs a second or two. Nothing is measured
    meanwhile, and a failure is not an error: this process then compiles, or fails, itself.
    """
    child = subprocess.Popen([*_COMMAND, "compile"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
        child.wait()
    finally:
        child.kill()
        child.wait()


def in_child(part: str, *arguments: object, timeout_s: float = math.inf) -> dict[str, float] | None:
    """The figures of a part; None if it had to be ended. Its temporary files are removed in both cases.

    Raises:
        SceneError: The process failed.
    """
    command = [*_COMMAND, part, *map(str, arguments)]
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as folder:
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=timeout_s if math.isfinite(timeout_s) else None,
                env={**os.environ, "TMPDIR": folder},
            )
        except subprocess.TimeoutExpired:
            return None
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["nothing on stderr"])[-1]
        raise SceneError(
            f"{part} part of the benchmark: ended with code {done.returncode} ({last}); expected figures. "
            f"Run it by hand: {' '.join(command)}"
        )
    return json.loads(done.stdout)


def measured_loads(
    path: Path, *, repeats: int, has_time: Callable[[float], bool] = lambda need_s: True
) -> dict[str, float]:
    """Times of loading a GLB file with our code and with trimesh: medians over fresh processes that load it in turn.

    Imports, even of JPEG decoders, and compiled code are ready before the clock starts; nothing is decoded yet.

    Args:
        path: GLB file.
        repeats: Number of processes of each kind.
        has_time: Called before each pair except the first, with the seconds that the previous pair took; False ends the
            series.

    Returns:
        `load_s`, `load_wall_s`: CPU and elapsed seconds from file to first frame; `rss_mb`: resident memory of the
        whole process afterwards, MB of 10^6 bytes. With `trimesh_`: the same for `load_scene` with all textures
        decoded, without a frame.

    Raises:
        SceneError: A process failed.
    """
    runs: list[dict[str, float]] = []
    need_s = 0.0
    while len(runs) < repeats and (not runs or has_time(need_s)):
        before = time.perf_counter()
        ours, theirs = (in_child(part, path, timeout_s=_LOAD_TIMEOUT_S) for part in ("load", "trimesh"))
        if ours is None or theirs is None:
            raise SceneError(f"{path}: not loaded in {_LOAD_TIMEOUT_S:g} s; expected seconds. Stop other programs.")
        runs.append(ours | theirs)
        need_s = time.perf_counter() - before
    return {name: float(np.median([run[name] for run in runs])) for name in runs[0]}


def _compile() -> dict[str, float]:
    """Calls once, in order of use, everything that the first scene's figures need."""
    from sim.render.embree import EmbreeScene
    from sim.render.raycast import Raycaster
    from sim.types import Camera
    from sim.walk.floor_grid import floor_grid_from_mesh

    from .rendering import RawTrace
    from .scenes import bench_mesh
    from .walking import camera_starts, env_steps_per_s, query_figures

    mesh, camera = bench_mesh(20_000, cluttered=False, texture_size=4, num_textures=2), Camera()
    raycaster, Ts = Raycaster(mesh, threads=1), np.eye(4)[None]
    raycaster.render(Ts[0], camera)
    raycaster.depth(Ts[0], camera)
    if raycaster.backend.name == "embree":
        RawTrace(EmbreeScene(mesh.vertices, mesh.faces), Ts, camera, width=raycaster.backend.packet_width).trace(0)
    navigation = floor_grid_from_mesh(mesh)
    camera_starts(navigation, 1, seed=0)
    query_figures(navigation, seed=0, goals=1)
    env_steps_per_s(navigation, None, camera=camera, num_steps=1, seed=0)
    return {}


def _load(path: str) -> dict[str, float]:
    """Figures of our loader up to the first frame."""
    import imagecodecs

    from sim.frames import T_world_camera
    from sim.render.raycast import Raycaster
    from sim.scans.glb import load_glb
    from sim.types import Camera, Pose

    from .scenes import bench_mesh

    camera, pose = Camera(), Pose((2.2, 0.0, 1.8), 0.5)
    T = T_world_camera(pose, camera)
    decoder = imagecodecs.jpeg8_decode  # imagecodecs imports a codec when it is first named
    assert callable(decoder)
    Raycaster(bench_mesh(1, cluttered=False, texture_size=4, num_textures=1)).render(T, camera)  # fetches compiled code
    wall, core = time.perf_counter(), time.process_time()
    mesh = load_glb(Path(path))
    raycaster = Raycaster(mesh)
    raycaster.render(T, camera)
    return {**_spent("load_", wall, core), "rss_mb": _resident_mb()}


def _load_trimesh(path: str) -> dict[str, float]:
    """Figures of trimesh's scene with every texture decoded once."""
    import PIL.JpegImagePlugin  # Pillow would import its decoder with the first file
    import trimesh

    wall, core = time.perf_counter(), time.process_time()
    scene = trimesh.load_scene(path)
    for geometry in scene.geometry.values():
        image: PIL.JpegImagePlugin.JpegImageFile = geometry.visual.material.baseColorTexture  # pyright: ignore
        image.load()
    return {**_spent("trimesh_", wall, core), "trimesh_rss_mb": _resident_mb()}


def _spent(name: str, wall: float, core: float) -> dict[str, float]:
    return {f"{name}s": time.process_time() - core, f"{name}wall_s": time.perf_counter() - wall}


def _resident_mb() -> float:
    """Resident memory of this process while everything that a user would keep is alive, MB of 10^6 bytes."""
    return psutil.Process().memory_info().rss / 1e6


def _browser(
    faces: str, clicks: str, seed: str, num_textures: str, texture_size: str, cluttered: str = ""
) -> dict[str, float]:
    from sim.mesh import Scene
    from sim.walk.floor_grid import floor_grid_from_mesh

    from .copies import browser_figures
    from .scenes import bench_mesh

    mesh = bench_mesh(
        int(faces),
        cluttered=cluttered == "cluttered",
        seed=int(seed),
        texture_size=int(texture_size),
        num_textures=int(num_textures),
    )
    navigation = floor_grid_from_mesh(mesh)
    scene = Scene("house", "invented", mesh, (), navigation, "house")
    return browser_figures(scene, navigation.storey_heights[0], num_clicks=int(clicks), seed=int(seed))


def _soup(faces: str, seed: str) -> dict[str, float]:
    from .copies import soup_figures

    return soup_figures(int(faces), seed=int(seed))


PARTS: dict[str, Callable[..., dict[str, Any]]] = {
    "compile": _compile,
    "load": _load,
    "trimesh": _load_trimesh,
    "browser": _browser,
    "soup": _soup,
}

if __name__ == "__main__":
    print(json.dumps(PARTS[sys.argv[1]](*sys.argv[2:])))
