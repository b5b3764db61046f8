"""GLB copies for browsers, read back by trimesh and by our own loader."""

import io
import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from personal_viz.bench.sim.scenes import bench_mesh
from sim.cache import VARIABLE
from sim.copies.browser_glb import MAX_BYTES, MAX_FACES, browser_glb, glb_from_mesh
from sim.copies.cut import storey_mesh
from sim.frames import T_world_camera
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.mesh import FLAT, VERTEX_COLOURS, Scene, TriangleMesh
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.types import Camera, Pose
from sim.walk.floor_grid import floor_grid_from_mesh

from .meshes import floor, joined, mesh_of, triangles


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_from_plan(invent_plan("Demo", seed=4))


@pytest.fixture(scope="module")
def scan() -> Scene:
    """A furnished and cluttered house with textures, like a scan."""
    mesh = bench_mesh(200_000, cluttered=True, texture_size=512, num_textures=12)
    return Scene("Bench", "scan", mesh, (), floor_grid_from_mesh(mesh), mesh.digest())


def header_of(data: bytes) -> dict:
    return json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])


def triangles_of(data: bytes) -> NDArray[np.float64]:
    """Triangles (F, 3, 3) as trimesh reads them."""
    loaded = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    return np.concatenate([mesh.vertices[mesh.faces] for mesh in loaded.geometry.values()])


def loaded(data: bytes, folder: Path, *, colours: Literal["linear", "srgb"] = "linear") -> TriangleMesh:
    (folder / "copy.glb").write_bytes(data)
    return load_glb(folder / "copy.glb", up="y", colours=colours)


def rays_from_above(mesh: TriangleMesh, num: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origins and directions (num, 3) of rays to places of a storey from 3 to 9 m away, at least 25 degrees steep."""
    rng = np.random.default_rng(8)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    places = low + rng.random((num, 3)) * (high - low)
    elevation, azimuth = rng.uniform(np.radians(25), np.pi / 2, num), rng.uniform(0, 2 * np.pi, num)
    towards = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.sin(elevation), np.cos(elevation) * np.sin(azimuth)], axis=1
    )
    return places + towards * rng.uniform(3, 9, (num, 1)), -towards


def test_trimesh_reads_back_the_same_mesh(scene: Scene) -> None:
    storey = storey_mesh(scene, 0.0)
    kinds = storey.face_texture.astype(int)
    order = np.argsort(np.where(kinds == FLAT, -3, kinds), kind="stable")  # one primitive each, flat colours first
    np.testing.assert_array_equal(triangles_of(glb_from_mesh(storey)), storey.vertices[storey.faces[order]])


@pytest.mark.slow
def test_the_same_storey_gives_the_same_bytes_and_stays_small(scene: Scene, monkeypatch, tmp_path: Path) -> None:
    data = browser_glb(scene, 2.8)
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert data == browser_glb(scene, 2.8), "made again, not read from the cache"
    assert [path.read_bytes() for path in tmp_path.rglob("*.glb")] == [data]
    assert data != browser_glb(scene, 0.0)
    assert len(data) < 6_000_000
    assert len(triangles_of(data)) <= MAX_FACES


@pytest.mark.slow
def test_a_copy_is_made_once(scene: Scene, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    browser_glb(scene, 0.0)
    (path,) = tmp_path.rglob("*.glb")
    path.write_bytes(b"kept")
    assert browser_glb(scene, 0.0) == b"kept"
    assert browser_glb(replace(scene, digest="another"), 0.0) != b"kept"
    assert browser_glb(replace(scene, kind="scan"), 0.0) != b"kept", "scans are cut higher"


def test_the_copy_of_a_planned_home_looks_like_the_home(scene: Scene, tmp_path: Path) -> None:
    assert scene.mesh.vertex_rgb is not None
    assert (scene.mesh.face_texture >= 0).any()
    full = storey_mesh(scene, 0.0)
    copy = loaded(browser_glb(scene, 0.0), tmp_path, colours="srgb")
    camera, rng = Camera(160, 120), np.random.default_rng(5)
    apart = []
    for _ in range(6):
        x, y, z = scene.navigation.random_point(rng, storey_y=0.0).tolist()
        view = T_world_camera(Pose((x, y, z), float(rng.uniform(0, 6)), -0.2), camera)
        one, other = (Raycaster(mesh, texture_filter="mipmap").render(view, camera) for mesh in (full, copy))
        apart.append(np.abs(one.rgb.astype(int) - other.rgb).mean())
    assert np.mean(apart) < 4
    assert len(copy.faces) < len(full.faces), "flat, evenly lit surfaces need few triangles"


def flat_coloured(scene: Scene) -> Scene:
    """The scene with one flat colour per object."""
    instance = scene.mesh.face_instance
    rgb = np.stack([instance % 250, instance * 7 % 250, instance * 13 % 250], axis=1).astype(np.uint8)
    flat = np.full(len(instance), FLAT, np.int16)
    mesh = replace(scene.mesh, face_rgb=rgb, face_texture=flat, textures=(), vertex_rgb=None)
    return replace(scene, mesh=mesh, digest=mesh.digest())


def test_flat_colours_come_back_unlit_and_exact(scene: Scene, tmp_path: Path) -> None:
    scene = flat_coloured(scene)
    data = browser_glb(scene, 0.0)
    header = header_of(data)
    assert header["extensionsUsed"] == ["KHR_materials_unlit"]
    assert all("KHR_materials_unlit" in material["extensions"] for material in header["materials"])
    full, copy = storey_mesh(scene, 0.0), loaded(data, tmp_path)
    origins, directions = rays_from_above(full, 4000)
    wanted, found = (Raycaster(mesh).cast(origins, directions) for mesh in (full, copy))
    hit = np.isfinite(wanted.range_m)
    apart = np.abs(found.range_m[hit] - wanted.range_m[hit])
    assert np.quantile(apart, 0.99) < 1e-3
    image, uv = copy.textures[0], copy.face_uv[found.face_ids[hit], 0]
    pixels = image[(uv[:, 1] * image.shape[0]).astype(int), (uv[:, 0] * image.shape[1]).astype(int)]
    same = (pixels == full.face_rgb[wanted.face_ids[hit]]).all(axis=1)
    assert same.mean() > 0.99, "the rest: edges where walls meet, with two faces at one place"


@pytest.mark.slow
def test_the_copy_of_a_scan_keeps_places_and_colours(scan: Scene, tmp_path: Path) -> None:
    floor_y = scan.navigation.storey_heights[0]
    data = browser_glb(scan, floor_y)
    header = header_of(data)
    assert len(header["images"]) <= 4
    assert {image["mimeType"] for image in header["images"]} == {"image/jpeg"}
    full, copy = storey_mesh(scan, floor_y), loaded(data, tmp_path)
    assert len(copy.faces) < 0.95 * len(full.faces)
    assert max(max(image.shape) for image in copy.textures) <= 1024
    origins, directions = rays_from_above(full, 20_000)
    wanted, found = (Raycaster(mesh).cast(origins, directions) for mesh in (full, copy))
    meets = np.isfinite(wanted.range_m) | np.isfinite(found.range_m)
    with np.errstate(invalid="ignore"):
        apart = np.abs(wanted.range_m - found.range_m)[meets]
    assert np.quantile(apart, 0.99) <= 0.02
    near = np.flatnonzero(meets)[apart < 0.01]
    seen = [
        colours_at(mesh, hits.face_ids[near], hits.positions[near]) for mesh, hits in ((full, wanted), (copy, found))
    ]
    assert np.median(np.abs(seen[0] - seen[1]).mean(axis=1)) < 14, "noise down to single texels is smoothed"
    assert np.abs((seen[0] - seen[1]).mean(axis=0)).max() < 2


def colours_at(mesh: TriangleMesh, faces: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nearest texels (N, 3) at points (N, 3) on faces (N,)."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[faces]].astype(float), 1, 0)
    normal = np.cross(b - a, c - a)
    size = np.maximum((normal**2).sum(axis=1), 1e-20)
    s = (np.cross(points - a, c - a) * normal).sum(axis=1) / size
    t = (np.cross(b - a, points - a) * normal).sum(axis=1) / size
    uv = (np.stack([1 - s - t, s, t], axis=1)[..., None] * mesh.face_uv[faces]).sum(axis=1)
    colours = np.empty((len(faces), 3))
    for texture in np.unique(mesh.face_texture[faces]):
        here = mesh.face_texture[faces] == texture
        image = mesh.textures[texture]
        col, row = (np.clip(uv[here], 0, 0.9999) * image.shape[1::-1]).astype(int).T
        colours[here] = image[row, col]
    return colours


@pytest.mark.slow
def test_loose_triangles_do_not_exceed_faces_and_bytes() -> None:
    num, ground = 320_000, mesh_of(floor(0, 0, 4, 4))
    spread = np.random.default_rng(3).normal(0, 0.02, (num, 3, 3))
    soup = joined(ground, triangles(np.random.default_rng(2).uniform(0, 1.5, (num, 1, 3)) + spread))
    data = browser_glb(Scene("Soup", "scan", soup, (), floor_grid_from_mesh(ground), "soup"), 0.0)
    assert 0.9 * MAX_BYTES < len(data) <= MAX_BYTES
    assert len(triangles_of(data)) <= MAX_FACES


def test_vertex_colours_are_written_as_linear_light_and_for_rerun_as_srgb() -> None:
    mesh = mesh_of(floor(0, 0, 4, 4))
    rgb = np.array([[0, 0, 0], [255, 128, 10], [255, 128, 10], [255, 255, 255]], np.uint8)
    mesh = replace(mesh, face_texture=np.full(2, VERTEX_COLOURS, np.int16), vertex_rgb=rgb)
    scene = Scene("Colours", "scan", mesh, (), floor_grid_from_mesh(mesh), mesh.digest())
    found = []
    for srgb in (False, True):
        data = browser_glb(scene, 0.0, srgb_colours=srgb)
        header = header_of(data)
        (primitive,) = header["meshes"][0]["primitives"]
        accessor = header["accessors"][primitive["attributes"]["COLOR_0"]]
        assert (accessor["componentType"], accessor["type"], accessor["normalized"]) == (5123, "VEC4", True)
        view = header["bufferViews"][accessor["bufferView"]]
        start = 20 + struct.unpack("<I", data[12:16])[0] + 8 + view["byteOffset"]
        found.append(np.frombuffer(data, "<u2", 4 * accessor["count"], start).reshape(-1, 4) / 0xFFFF)
    assert len(found[0]) == 4, "corners of one colour are shared"
    # linear light of sRGB 128 and 10 (IEC 61966-2-1)
    np.testing.assert_allclose(np.unique(found[0][:, 1]), [0, 0.215861, 1], atol=2e-5)
    np.testing.assert_allclose(np.unique(found[0][:, 2]), [0, 0.003035, 1], atol=2e-5)
    np.testing.assert_allclose(np.unique(found[1][:, 1]), [0, 128 / 255, 1], atol=2e-5)
    assert (found[0][:, 3] == 1).all()


@pytest.mark.parametrize("srgb", [False, True])
def test_light_on_textures_is_written_as_linear_light_and_for_rerun_as_srgb(srgb: bool) -> None:
    image = np.full((8, 8, 3), 200, np.uint8)
    mesh = mesh_of(floor(0, 0, 4, 4), floor(4, 0, 8, 4), floor(8, 0, 9, 1), textures=(image, image + 9), texture=0)
    rgb = np.full((12, 3), 255, np.uint8)
    rgb[:4] = [[255, 255, 255], [128, 128, 128], [128, 128, 128], [51, 51, 51]]
    textures = np.array([0, 0, 1, 1, FLAT, FLAT], np.int16)
    header, values = colours_in(glb_from_mesh(replace(mesh, vertex_rgb=rgb, face_texture=textures), srgb_colours=srgb))
    attributes = [primitive["attributes"] for primitive in header["meshes"][0]["primitives"]]
    assert [sorted(names) for names in attributes] == [
        ["POSITION", "TEXCOORD_0"],
        ["COLOR_0", "POSITION", "TEXCOORD_0"],
        ["POSITION", "TEXCOORD_0"],
    ], "faces in full light need no colours"
    # linear light of sRGB 51 and 128 is 0.0331 and 0.2159 (IEC 61966-2-1)
    wanted = [51, 128, 128, 255] if srgb else [8, 55, 55, 255]
    assert sorted(values[:, 0].tolist()) == wanted
    assert (values[:, 3] == 255).all()


def test_light_on_textures_looks_the_same_in_the_copy(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    smooth = np.kron(rng.integers(60, 256, (4, 4, 3)), np.ones((16, 16, 1))).astype(np.uint8)
    mesh = mesh_of(floor(-1, -1, 0, 1), floor(0, -1, 1, 1), textures=(smooth,), texture=0)
    lit = replace(mesh, face_uv=mesh.face_uv * 3, vertex_rgb=rng.integers(90, 256, (8, 3)).astype(np.uint8))
    copy = loaded(glb_from_mesh(lit), tmp_path, colours="srgb")
    shown = replace(copy, textures=(smooth,))  # without the losses of JPEG
    camera = Camera(120, 120, 90.0, 0.0)
    view = T_world_camera(Pose((0.0, 0.9, 0.0), 0.0, -np.pi / 2), camera)
    frames = [Raycaster(each).render(view, camera).rgb.astype(int) for each in (lit, shown, copy)]
    assert np.abs(frames[1] - frames[0]).max() <= 2
    assert np.abs(frames[2] - frames[0]).mean() <= 2


def colours_in(data: bytes) -> tuple[dict, NDArray[np.uint8]]:
    """The header, and the values (N, 4) of the only accessor with vertex colours."""
    header = header_of(data)
    used = [primitive["attributes"].get("COLOR_0") for primitive in header["meshes"][0]["primitives"]]
    (accessor,) = (header["accessors"][index] for index in used if index is not None)
    assert (accessor["componentType"], accessor["type"], accessor["normalized"]) == (5121, "VEC4", True)
    view = header["bufferViews"][accessor["bufferView"]]
    start = 20 + struct.unpack("<I", data[12:16])[0] + 8 + view["byteOffset"]
    return header, np.frombuffer(data, np.uint8, 4 * accessor["count"], start).reshape(-1, 4)


def test_textures_are_downsized_and_keep_their_coordinates() -> None:
    big = np.zeros((2048, 1024, 3), np.uint8)
    big[:, 512:] = 255
    mesh = mesh_of(floor(0, 0, 2, 2), textures=(big,), texture=0)
    mixed = replace(mesh, face_texture=np.array([0, -1], np.int16))
    read = trimesh.load_scene(io.BytesIO(glb_from_mesh(mixed)), file_type="glb", process=False)
    images: list[Image.Image] = [part.visual.material.baseColorTexture for part in read.geometry.values()]
    assert sorted(image.size for image in images) == [(1, 1), (512, 1024)]
    assert triangles_of(glb_from_mesh(mixed)).shape == (2, 3, 3)


def test_a_mesh_with_more_colours_than_a_palette_holds_keeps_all_faces() -> None:
    count = 70_000
    colours = np.arange(count, dtype=np.int64)[:, None] >> np.array([16, 8, 0]) & 0xFF
    many = triangles(np.tile(np.eye(3), (count, 1, 1)), face_rgb=colours.astype(np.uint8))
    assert triangles_of(glb_from_mesh(many)).shape == (count, 3, 3)
