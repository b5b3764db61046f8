"""Loading a GLB file in a process of its own, so that time and memory are those of a fresh start.

`python -m personal_viz.bench.sim.loading ours|trimesh FILE` prints one JSON line; the benchmark starts it. Both loaders
have their libraries, JPEG decoders among them, imported before the clock starts, and neither has decoded anything.
"""

import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.errors import SceneError

Loader = Literal["ours", "trimesh"]
_TIMEOUT_S = 300


class LoadFigures(BaseModel):
    """What one loader needed for one file; imports, those of decoders too, and compiled code were ready before."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    core_s: float
    """CPU seconds. Ours: file to first frame. trimesh: `load_scene` and all textures decoded, no frame."""
    wall_s: float
    """The same, elapsed."""
    parse_core_s: float
    """CPU seconds of the first part. Ours: `load_glb`. trimesh: `load_scene` alone, which leaves JPEGs undecoded."""
    rss_mb: float
    """Resident memory of the whole process afterwards, MB of 10^6 bytes."""
    peak_mb: float
    """Largest resident memory until then, imports included."""
    processes: int = 1
    """Of how many fresh processes the figures are the medians."""


class _Loaded(NamedTuple):
    kept: object
    """All that a user of the loader would keep, alive while memory is read."""
    core_s: float
    wall_s: float
    parse_core_s: float


def measured_loads(
    path: Path, *, repeats: int, has_time: Callable[[float], bool] = lambda need_s: True
) -> tuple[LoadFigures, LoadFigures]:
    """Medians of ours and of trimesh's over fresh processes that load the file in turn.

    Args:
        path: GLB file.
        repeats: Processes of each.
        has_time: Asked before each pair but the first, with the seconds that the one before took; False ends them.

    Raises:
        SceneError: A process failed.
    """
    runs: list[tuple[LoadFigures, LoadFigures]] = []
    need_s = 0.0
    while len(runs) < repeats and (not runs or has_time(need_s)):
        before = time.perf_counter()
        runs.append((_in_child(path, "ours"), _in_child(path, "trimesh")))
        need_s = time.perf_counter() - before
    ours, theirs = zip(*runs, strict=True)
    return _medians(ours), _medians(theirs)


def _medians(runs: tuple[LoadFigures, ...]) -> LoadFigures:
    names = LoadFigures.model_fields.keys() - {"processes"}
    medians = {name: float(np.median([getattr(run, name) for run in runs])) for name in names}
    return LoadFigures(**medians, processes=len(runs))


def _in_child(path: Path, loader: Loader) -> LoadFigures:
    command = [sys.executable, "-m", "personal_viz.bench.sim.loading", loader, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["nothing on stderr"])[-1]
        raise SceneError(
            f"{path}: loading with {loader} ended with code {done.returncode} ({last}); expected one line of figures. "
            f"Run it by hand: {' '.join(command)}"
        )
    return LoadFigures.model_validate_json(done.stdout)


def _load_ours(path: Path) -> _Loaded:
    """Our way to the first frame."""
    import imagecodecs

    from sim.frames import T_world_camera
    from sim.homes.building.quads import QuadBuilder
    from sim.homes.plan import Finish
    from sim.render.raycast import Raycaster
    from sim.scans.glb import load_glb
    from sim.types import Camera, Pose

    camera, pose = Camera(), Pose((2.2, 0.0, 1.8), 0.5)
    T = T_world_camera(pose, camera)
    decoder = imagecodecs.jpeg8_decode  # imagecodecs imports a codec when it is first named
    assert callable(decoder)
    warm_up = QuadBuilder()
    warm_up.add_box((0, 0, 0), (1, 1, 1), finish=Finish(rgb=(128, 128, 128)))
    Raycaster(warm_up.mesh()).render(T, camera)  # fetches compiled code from numba's cache
    wall, core = time.perf_counter(), time.process_time()
    mesh = load_glb(path)
    parsed = time.process_time() - core
    raycaster = Raycaster(mesh)
    raycaster.render(T, camera)
    return _Loaded((mesh, raycaster), time.process_time() - core, time.perf_counter() - wall, parsed)


def _load_trimesh(path: Path) -> _Loaded:
    """trimesh's scene with every texture decoded once."""
    import PIL.JpegImagePlugin  # Pillow would import its decoder with the first file
    import trimesh

    wall, core = time.perf_counter(), time.process_time()
    scene = trimesh.load_scene(path)
    parsed = time.process_time() - core
    for geometry in scene.geometry.values():
        image: PIL.JpegImagePlugin.JpegImageFile = geometry.visual.material.baseColorTexture  # pyright: ignore
        image.load()
    return _Loaded(scene, time.process_time() - core, time.perf_counter() - wall, parsed)


def _memory_mb(field: str) -> float:
    """VmRSS or VmHWM of this process in MB of 10^6 bytes."""
    status = Path("/proc/self/status")
    if not status.exists():  # not Linux: only the peak is known
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    found = re.search(rf"^{field}:\s+(\d+) kB", status.read_text(), re.MULTILINE)
    assert found is not None, field
    return int(found[1]) * 1024 / 1e6


def _main() -> None:
    loader, path = sys.argv[1], Path(sys.argv[2])
    loaded = (_load_ours if loader == "ours" else _load_trimesh)(path)
    rss_mb = _memory_mb("VmRSS")
    figures = LoadFigures(
        core_s=loaded.core_s,
        wall_s=loaded.wall_s,
        parse_core_s=loaded.parse_core_s,
        rss_mb=rss_mb,
        peak_mb=max(_memory_mb("VmHWM"), rss_mb),  # VmHWM is updated lazily and may stand a little below VmRSS
    )
    print(figures.model_dump_json())


if __name__ == "__main__":
    _main()
