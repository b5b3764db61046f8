"""Scans that other programs packed: Draco is read, and for the rest a refusal names the command that unpacks them."""

import shlex
import subprocess
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import pytest
import trimesh

from sim import extras
from sim.errors import MissingDependencyError, SceneError
from sim.mesh import TriangleMesh
from sim.scans.glb import load_glb
from sim.scans.ply_obj import load_ply_or_obj

from .gltf_files import UV, GltfWriter, png

POINTS = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def packed(change: Any = lambda data: data) -> GltfWriter:
    """A textured square whose geometry only Draco's data hold; the test may change these."""
    writer = GltfWriter()
    data = DracoPy.encode(POINTS, faces=TRIANGLES, tex_coord=UV.astype(np.float64), quantization_bits=16)
    unpacked = DracoPy.decode(data)
    ids = {one["attribute_type"]: one["unique_id"] for one in unpacked.attributes}
    accessors = writer.json["accessors"]
    accessors += [
        {"componentType": 5126, "count": len(unpacked.points), "type": "VEC3"},
        {"componentType": 5126, "count": len(unpacked.points), "type": "VEC2"},
        {"componentType": 5123, "count": unpacked.faces.size, "type": "SCALAR"},
    ]
    material = writer.material(writer.image(png(np.full((4, 4, 3), 90, np.uint8))))
    draco = {"bufferView": writer.view(change(data)), "attributes": {"POSITION": ids[0], "TEXCOORD_0": ids[3]}}
    writer.show(
        {
            "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
            "indices": 2,
            "material": material,
            "extensions": {"KHR_draco_mesh_compression": draco},
        }
    )
    name = "KHR_draco_mesh_compression"
    writer.json |= {"extensionsUsed": [name], "extensionsRequired": [name]}
    return writer


def refusal(path: Path) -> str:
    with pytest.raises(SceneError) as error:
        load_glb(path, up="y") if path.suffix == ".glb" else load_ply_or_obj(path, up="y")
    assert "\n" not in str(error.value)
    return str(error.value)


def corners(mesh: TriangleMesh) -> set[tuple[float, ...]]:
    return {tuple(np.round(point, 3) + 0.0) for point in mesh.vertices[mesh.faces].reshape(-1, 3)}


def test_a_mesh_that_draco_packed_is_the_mesh(tmp_path: Path) -> None:
    mesh = load_glb(packed().save(tmp_path / "a.glb"), up="y")
    assert len(mesh.faces) == 2
    assert corners(mesh) == {tuple(point) for point in POINTS}
    shown = {
        (tuple(np.round(point, 3) + 0.0), tuple(np.round(uv, 3)))
        for point, uv in zip(mesh.vertices[mesh.faces].reshape(-1, 3), mesh.face_uv.reshape(-1, 2), strict=True)
    }
    plain = GltfWriter()
    material = plain.material(plain.image(png(np.full((4, 4, 3), 90, np.uint8))))
    plain.show(plain.square(uv=UV, material=material))
    other = load_glb(plain.save(tmp_path / "b.glb"), up="y")
    assert shown == {
        (tuple(np.round(point, 3) + 0.0), tuple(np.round(uv, 3)))
        for point, uv in zip(other.vertices[other.faces].reshape(-1, 3), other.face_uv.reshape(-1, 2), strict=True)
    }
    assert [texture.shape for texture in mesh.textures] == [texture.shape for texture in other.textures]


def test_plain_data_beside_packed_ones_need_no_draco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = packed()
    writer.json["extensionsRequired"] = []
    for accessor, values in zip(
        writer.json["accessors"], (POINTS.astype("<f4"), UV, TRIANGLES.astype("<u2")), strict=True
    ):
        accessor |= {"bufferView": writer.view(values.tobytes()), "count": values.size if values.dtype == "<u2" else 4}
    monkeypatch.setattr(extras.importlib, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    assert corners(load_glb(writer.save(tmp_path / "a.glb"), up="y")) == {tuple(point) for point in POINTS}


def test_without_the_extra_the_error_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = packed().save(tmp_path / "a.glb")
    monkeypatch.setattr(extras.importlib, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    with pytest.raises(MissingDependencyError, match=r"pip install 'personal-viz\[draco\]'"):
        load_glb(path)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda data: b"DRAGON" + data[6:], "begin with b'DRAGON"),
        (lambda data: data[:20], "holds Draco data"),
        (lambda data: data[: len(data) // 2], "holds Draco data that cannot be read"),
        (lambda data: data[:12] + b"\xff\xff\xff\xff\x7f" + data[13:], "holds Draco data of 34359738367"),
    ],
)
def test_damaged_draco_data_are_refused_in_one_line(tmp_path: Path, change: Any, found: str) -> None:
    assert found in refusal(packed(change).save(tmp_path / "a.glb"))


def test_draco_data_without_a_named_attribute_or_of_another_size_are_refused(tmp_path: Path) -> None:
    writer = packed()
    writer.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["POSITION"] = 9
    assert "names Draco's attribute 9" in refusal(writer.save(tmp_path / "a.glb"))
    writer = packed()
    writer.json["accessors"][0]["count"] = 3
    assert "accessors.0 unpacks to (4, 3); expected the (3, 3)" in refusal(writer.save(tmp_path / "b.glb"))


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("EXT_meshopt_compression", "npx @gltf-transform/cli copy {0}/a.glb {0}/a-plain.glb"),
        ("EXT_texture_avif", "npx @gltf-transform/cli png {0}/a.glb {0}/a-plain.glb --formats avif"),
    ],
)
def test_what_is_not_read_is_refused_with_the_command_that_converts_it(tmp_path: Path, name: str, command: str) -> None:
    writer = GltfWriter()
    writer.show(writer.square())
    writer.json |= {"extensionsUsed": [name], "extensionsRequired": [name]}
    assert refusal(writer.save(tmp_path / "a.glb")).endswith(f"Run: {command.format(tmp_path)}")
    (tmp_path / "it's a").mkdir()
    told = refusal(writer.save(tmp_path / "it's a" / "b.glb")).partition("Run: ")[2]
    assert str(tmp_path / "it's a" / "b.glb") in shlex.split(told)


@pytest.mark.slow
def test_points_become_a_mesh_by_the_commands_that_the_refusals_name(tmp_path: Path) -> None:
    """A room of 4 m x 3 m x 2.5 m, first as points in a GLB, then in a PLY file, then as a mesh."""
    room = trimesh.creation.box((4, 2.5, 3))
    points, _ = trimesh.sample.sample_surface(room, 40_000, seed=0)
    tmp_path = tmp_path / "it's a"
    tmp_path.mkdir()
    trimesh.PointCloud(points).export(tmp_path / "room.glb")
    told = refusal(tmp_path / "room.glb").partition("Run: ")[2]
    subprocess.run(told.removesuffix(", and open that file: it names the next command."), shell=True, check=True)
    subprocess.run(refusal(tmp_path / "room.ply").partition("Run: ")[2], shell=True, check=True)
    mesh = load_ply_or_obj(tmp_path / "room-mesh.ply", up="y")
    assert len(mesh.faces) > 1000
    beyond = np.abs(mesh.vertices) - np.array((2, 1.25, 1.5))  # positive outside of the walls
    outside, inside = np.linalg.norm(np.maximum(beyond, 0), axis=1), -np.minimum(beyond.max(axis=1), 0)
    assert np.quantile(outside + inside, 0.9) < 0.05
