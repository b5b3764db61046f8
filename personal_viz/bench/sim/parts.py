"""Parts of the benchmark in processes of their own, so that one whose code is yet to be compiled can be ended in time.

`python -m personal_viz.bench.sim.parts compile`, `... navmesh FILE SEED` or
`... browser FACES CLICKS ...`, see `_main`.
"""

import contextlib
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sim.errors import SceneError
from sim.mesh import Scene
from sim.render.embree import EmbreeScene
from sim.render.raycast import Raycaster
from sim.types import Camera
from sim.walk.floor_grid import floor_grid_from_mesh

from .copies import BrowserFigures, browser_figures
from .raw_trace import RawTrace
from .scenes import bench_mesh
from .walking import camera_starts, env_steps_per_s, query_figures

_COMMAND = (sys.executable, "-m", "personal_viz.bench.sim.parts")


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Compiles rendering, questions to maps and steps in a second process, while this one makes the first scene.

    Their code lies in numba's cache afterwards. Costs a second or two where it lay there before. Nothing is measured
    meanwhile, and a failure is no error: this process then compiles, or fails, itself.
    """
    child = subprocess.Popen([*_COMMAND, "compile"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
        child.wait()
    finally:
        child.kill()
        child.wait()


def browser_part(
    *, faces: int, clicks: int, seed: int, textures: tuple[int, int], timeout_s: float
) -> BrowserFigures | None:
    """`browser_figures` of the lowest storey of a plain house; None where that takes longer than `timeout_s`.

    Args:
        faces: Triangles of the house.
        clicks: Rays.
        seed: Of house and rays.
        textures: Number and side.
        timeout_s: Elapsed seconds, inf = any.

    Raises:
        SceneError: The process failed.
    """
    printed = _output(["browser", *(str(value) for value in (faces, clicks, seed, *textures))], timeout_s)
    return None if printed is None else BrowserFigures.model_validate_json(printed)


def navmesh_path_us(path: Path, *, seed: int, timeout_s: float) -> float | None:
    """`path_us` on a .navmesh file; None where that takes longer than `timeout_s`.

    Raises:
        SceneError: The process failed.
    """
    printed = _output(["navmesh", str(path), str(seed)], timeout_s)
    return None if printed is None else float(printed)


def _output(arguments: list[str], timeout_s: float) -> str | None:
    """What a part prints; None where it had to be ended. Its temporary files are gone in both cases."""
    command, timeout = [*_COMMAND, *arguments], timeout_s if math.isfinite(timeout_s) else None
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as folder:
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=timeout, env={**os.environ, "TMPDIR": folder}
            )
        except subprocess.TimeoutExpired:
            return None
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["nothing on stderr"])[-1]
        raise SceneError(
            f"{arguments[0]} part of the benchmark: ended with code {done.returncode} ({last}); expected figures. "
            f"Run it by hand: {' '.join(command)}"
        )
    return done.stdout


def _compile() -> None:
    """Calls once what the first scene's figures need, in the order of need."""
    mesh, camera = bench_mesh(20_000, cluttered=False, texture_size=4, num_textures=2), Camera()
    raycaster, Ts = Raycaster(mesh, threads=1), np.eye(4)[None]
    raycaster.render(Ts[0], camera)
    raycaster.depth(Ts[0], camera)
    if raycaster.backend.name == "embree":
        RawTrace(EmbreeScene(mesh.vertices, mesh.faces), Ts, camera, width=raycaster.backend.packet_width).trace(0)
    for texture_filter in ("nearest", "mipmap"):
        Raycaster(mesh, texture_filter=texture_filter, threads=1).render(Ts[0], camera)
    navigation = floor_grid_from_mesh(mesh)
    camera_starts(navigation, 1, seed=0)
    query_figures(navigation, seed=0, goals=1)
    env_steps_per_s(navigation, None, camera=camera, num_steps=1, seed=0)


def _browser(faces: int, clicks: int, seed: int, num_textures: int, texture_size: int) -> BrowserFigures:
    mesh = bench_mesh(faces, cluttered=False, seed=seed, texture_size=texture_size, num_textures=num_textures)
    navigation = floor_grid_from_mesh(mesh)
    scene = Scene("house", "invented", mesh, (), navigation, "house")
    return browser_figures(scene, navigation.storey_heights[0], num_clicks=clicks, seed=seed)


def _main() -> None:
    part, *arguments = sys.argv[1:]
    if part == "compile":
        _compile()
    elif part == "navmesh":
        from sim.walk.navmesh import load_navmesh

        print(query_figures(load_navmesh(Path(arguments[0])), seed=int(arguments[1]), goals=8).path_us)
    else:
        print(_browser(*(int(value) for value in arguments)).model_dump_json())


if __name__ == "__main__":
    _main()
