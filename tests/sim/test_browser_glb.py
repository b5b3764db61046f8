"""GLB copies for browsers, read back by trimesh and by our own loader."""

import io
import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sim.errors import SceneError
from sim.scenes.browser_glb import browser_glb, glb_from_mesh
from sim.scenes.glb import load_glb
from sim.scenes.invent import invent_plan
from sim.scenes.scene import Scene, cut_storey
from sim.scenes.sources import scene_from_plan

from .meshes import floor, mesh_of


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_from_plan(invent_plan("Demo", seed=4))


def triangles_of(data: bytes) -> np.ndarray:
    """(F, 3, 3) as trimesh reads them."""
    loaded = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    return np.concatenate([mesh.vertices[mesh.faces] for mesh in loaded.geometry.values()])


def test_trimesh_reads_back_the_cut_storeys_triangles(scene: Scene) -> None:
    storey = cut_storey(scene.mesh, 0.0)
    np.testing.assert_array_equal(triangles_of(browser_glb(scene, 0.0)), storey.vertices[storey.faces])


def test_the_same_storey_gives_the_same_bytes_and_stays_small(scene: Scene) -> None:
    data = browser_glb(scene, 2.8)
    assert data == browser_glb(scene, 2.8)
    assert data != browser_glb(scene, 0.0)
    assert len(data) < 500_000


def test_flat_colours_come_back_unlit_and_exact(scene: Scene, tmp_path: Path) -> None:
    data = browser_glb(scene, 0.0)
    header = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    assert header["extensionsUsed"] == ["KHR_materials_unlit"]
    assert all("KHR_materials_unlit" in material["extensions"] for material in header["materials"])
    (tmp_path / "storey.glb").write_bytes(data)
    loaded = load_glb(tmp_path / "storey.glb", up="y")
    image = loaded.textures[0]
    uv = loaded.face_uv[:, 0]
    pixels = image[(uv[:, 1] * image.shape[0]).astype(int), (uv[:, 0] * image.shape[1]).astype(int)]
    np.testing.assert_array_equal(pixels, cut_storey(scene.mesh, 0.0).face_rgb)


def test_textures_are_downsized_and_keep_their_coordinates() -> None:
    big = np.zeros((2048, 1024, 3), np.uint8)
    big[:, 512:] = 255
    mesh = mesh_of(floor(0, 0, 2, 2), textures=(big,), texture=0)
    mixed = replace(mesh, face_texture=np.array([0, -1], np.int16))
    loaded = trimesh.load_scene(io.BytesIO(glb_from_mesh(mixed)), file_type="glb", process=False)
    images = [part.visual.material.baseColorTexture for part in loaded.geometry.values()]
    assert sorted(image.size for image in images) == [(1, 1), (512, 1024)]
    assert triangles_of(glb_from_mesh(mixed)).shape == (2, 3, 3)


def test_more_colours_than_a_palette_holds_are_thinned() -> None:
    count = 70_000
    mesh = mesh_of(floor(0, 0, 1, 1))
    colours = np.arange(count, dtype=np.int64)[:, None] >> np.array([16, 8, 0]) & 0xFF
    many = replace(
        mesh,
        faces=np.repeat(mesh.faces[:1], count, axis=0),
        face_rgb=colours.astype(np.uint8),
        face_instance=np.zeros(count, np.int32),
        face_texture=np.full(count, -1, np.int16),
        face_uv=np.zeros((count, 3, 2), np.float32),
    )
    assert triangles_of(glb_from_mesh(many)).shape == (count, 3, 3)


def test_a_height_without_faces_is_refused_with_the_heights_there_are(scene: Scene) -> None:
    with pytest.raises(
        SceneError, match=r"no face on a storey at 90.0 m; expected a height near one of \[0.00, 2.80\]"
    ):
        browser_glb(scene, 90.0)
