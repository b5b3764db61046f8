"""Embree from its wheel: the self-test that decides, the fallback without it, and the freeing of scenes."""

import copy
import gc
import importlib.metadata
import importlib.util
import os
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from sim.errors import MissingDependencyError
from sim.frames import T_world_camera
from sim.render import embree
from sim.render.raycast import Raycaster, chosen_backend
from sim.types import Camera, Pose
from tests.sim.meshes import box, mesh_of

ROOM = mesh_of(*box((-2.0, -1.0, -2.0), (2.0, 2.0, 2.0), rgb=(10, 20, 30)))


@pytest.fixture
def undecided():
    """Clears the cached choice of a backend before and after the test."""
    caches = (embree.library, embree.self_test, chosen_backend)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


@pytest.fixture
def usable():
    try:
        embree.self_test()
    except MissingDependencyError as error:
        pytest.skip(str(error))


def has_avx(name: str) -> bool:
    return name in Path("/proc/cpuinfo").read_text()


@pytest.mark.skipif(sys.platform != "linux", reason="the processor's features are read from /proc/cpuinfo")
def test_the_widest_packets_of_this_processor_are_chosen(usable):
    backend = chosen_backend()
    expected = 16 if has_avx("avx512vl") else 8 if has_avx("avx2") else 4
    assert (backend.name, backend.packet_width) == ("embree", expected)
    assert backend.reason == f"Embree 40400 passed its self-test with packets of {expected} rays."
    assert Raycaster(ROOM).backend == backend


def sees_the_room(raycaster: Raycaster) -> bool:
    camera = Camera(64, 48)
    frame = raycaster.render(T_world_camera(Pose((0, -0.88, 0), 0.0), camera), camera)
    return bool(np.allclose(frame.depth_m[20:28], 2.0, atol=1e-5) and (frame.rgb == (10, 20, 30)).all())


VERSION = importlib.metadata.version


def not_installed(name):
    if name != "embreex":
        return VERSION(name)
    raise importlib.metadata.PackageNotFoundError(name)


def test_without_the_wheel_open3d_renders_after_one_warning(monkeypatch, undecided):
    monkeypatch.setattr(importlib.metadata, "version", not_installed)
    with pytest.warns(RuntimeWarning, match="rendered by Open3D, .* slower.*embreex is not installed") as caught:
        first, second = Raycaster(ROOM), Raycaster(ROOM)
    assert len(caught) == 1
    assert first.backend == second.backend
    assert (first.backend.name, first.backend.packet_width) == ("open3d", 1)
    assert "pip install embreex==4.4.0.post1" in first.backend.reason
    assert sees_the_room(first)


def test_another_version_of_the_wheel_is_not_loaded(monkeypatch, undecided):
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "5.0.0")
    monkeypatch.setattr(embree.ctypes, "CDLL", lambda path: pytest.fail("the library was loaded"))
    with pytest.raises(MissingDependencyError, match=r"embreex 5\.0\.0 is installed; expected 4\.4\.0\.post1"):
        embree.self_test()


def test_a_wheel_without_the_library_is_refused(monkeypatch, undecided, tmp_path):
    (tmp_path / "embreex").mkdir()
    spec = importlib.util.spec_from_file_location("embreex", tmp_path / "embreex" / "__init__.py")
    monkeypatch.setattr(importlib.metadata, "version", lambda name: embree.WHEEL)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec)
    with pytest.raises(MissingDependencyError, match=r"embreex\.libs holds no libembree4"):
        embree.self_test()


@pytest.mark.parametrize("name", ["a text file", "another library"])
def test_a_library_that_is_not_embree_is_refused(monkeypatch, undecided, tmp_path, name):
    path = tmp_path / "libembree4.so"
    path.write_text("not a library")
    if name == "another library":
        other = next(iter(Path(np.__file__).parent.rglob("*.so")))
        path = other
    monkeypatch.setattr(embree, "library_path", lambda: path)
    with pytest.raises(MissingDependencyError, match=r"cannot be used: .*expected Embree 40400"):
        embree.self_test()


def test_a_library_of_another_version_is_refused(monkeypatch, undecided, usable):
    monkeypatch.setattr(embree, "VERSION", 40500)
    embree.self_test.cache_clear()
    with pytest.raises(MissingDependencyError, match=r"Embree 40400 .* was found; expected 40500"):
        embree.self_test()


def test_a_wrong_answer_in_the_self_test_is_refused(monkeypatch, undecided, usable):
    class Shifted(embree.EmbreeScene):
        def __init__(self, vertices, faces):
            super().__init__(vertices + 0.1, faces)

    monkeypatch.setattr(embree, "EmbreeScene", Shifted)
    embree.self_test.cache_clear()
    with pytest.raises(MissingDependencyError, match=r"self-test gave .* expected"):
        embree.self_test()


def test_asking_for_embree_fails_if_it_cannot_be_used(monkeypatch, undecided):
    monkeypatch.setattr(importlib.metadata, "version", not_installed)
    with pytest.raises(MissingDependencyError, match="embreex is not installed"):
        Raycaster(ROOM, backend="embree")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Raycaster(ROOM, backend="open3d").backend.reason == "It was asked for."


@pytest.mark.parametrize("width", embree.WIDTHS)
def test_packets_have_the_layout_of_embree(width):
    packet = embree.new_packet(width)
    assert packet.ctypes.data % 64 == 0
    assert packet.itemsize % 64 == 0
    fields = packet.dtype.fields or {}
    offsets = {name: place[1] // (4 * width) for name, place in fields.items()}
    # RTCRay: 12 rows, RTCHit: 5 floats, then primID, geomID (Embree 4, rtcore_ray.h).
    expected = {"org_x": 0, "tnear": 3, "dir_x": 4, "time": 7, "tfar": 8, "mask": 9, "ng_x": 12, "u": 15, "prim": 17}
    assert {name: offsets[name] for name in expected} == expected
    assert (packet["geom"] == embree.INVALID).all()


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_scenes_are_freed_with_their_raycaster(usable):
    grid = np.stack(np.meshgrid(np.arange(200.0), np.arange(200.0)), -1).reshape(-1, 2)
    vertices = np.insert(grid, 1, 0.0, axis=1)
    corner = (np.arange(199)[:, None] * 200 + np.arange(199)).ravel()
    faces = np.stack([corner, corner + 1, corner + 201], 1)
    for _ in range(3):
        embree.EmbreeScene(vertices, faces)
    gc.collect()
    before = resident_mb()
    for _ in range(20):  # 8 MB each
        embree.EmbreeScene(vertices, faces)
    gc.collect()
    assert resident_mb() - before < 60


@pytest.mark.parametrize("send", [pickle.dumps, copy.copy, copy.deepcopy])
def test_addresses_never_leave_their_process_nor_outlive_their_scene(usable, send):
    scene = embree.EmbreeScene(ROOM.vertices, ROOM.faces)
    with pytest.raises(TypeError, match=r"was about to be pickled or copied; expected .* Make a Raycaster"):
        send(scene)
    with pytest.raises(TypeError, match="Make a Raycaster"):
        pickle.dumps(Raycaster(ROOM, threads=1))


@pytest.mark.slow
def test_another_process_sees_the_same_bytes_without_compiling_again(usable):
    program = (
        "import hashlib\n"
        "from sim.frames import T_world_camera\n"
        "from sim.types import Camera, Pose\n"
        "from tests.sim.test_embree import ROOM\n"
        "from sim.render.raycast import Raycaster\n"
        "from sim.render.raycast_kernels import render_rows\n"
        "frame = Raycaster(ROOM).render(T_world_camera(Pose((0, 0, 0), 0.4), Camera()), Camera())\n"
        "digest = hashlib.sha256(frame.rgb.tobytes() + frame.depth_m.tobytes()).hexdigest()\n"
        "print(digest, sum(render_rows.stats.cache_misses.values()))\n"
    )
    runs = [
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120)
        for _ in range(2)
    ]
    (one, _), (other, misses) = (run.stdout.split() for run in runs)
    assert one == other
    assert misses == "0"
