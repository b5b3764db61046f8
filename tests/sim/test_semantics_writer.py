"""Semantic files of planned homes in HM3D's format: hm3d.py reads back what was written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.authoring.semantics_writer import rooms_of_objects, semantic_files
from sim.copies.glb_writer import glb_from_mesh
from sim.frames import glb_zup_from_world
from sim.homes.building.house import mesh_from_plan
from sim.homes.plan import Finish, HomePlan, Rect, Storey
from sim.scans.hm3d import Semantics, load_semantics
from sim.scans.meshes import load_mesh
from sim.scans.semantic_txt import read_semantic_txt

from .plans import piece, room


@pytest.fixture(scope="module")
def plan() -> HomePlan:
    pieces = (("chair", "study"), ("table lamp", "bedroom"), ("picture", "bedroom"), ("rug", ""))
    furniture = tuple(
        piece(
            f"{category}_{k}", (1.0 + 1.7 * k, 1.2, 2.0), (0.6, 0.9, 0.5), yaw=0.7 * k, room=name,
            finish=Finish(material="wood", rgb=(120, 70, 30 * k)),
        )
        for k, (category, name) in enumerate(pieces, start=1)
    )  # fmt: skip
    rooms = (room("study", Rect(0, 0, 4, 4)), room("bedroom", Rect(4, 0, 8, 4)))
    storeys = (Storey(label="ground floor", floor_y=0.5),)
    return HomePlan(name="Home", kind="invented", storeys=storeys, rooms=rooms, furniture=furniture)


@pytest.fixture(scope="module")
def folder(plan: HomePlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scan")
    mesh, objects = mesh_from_plan(plan)
    files = semantic_files(mesh, objects, region_of=rooms_of_objects(plan))
    (folder / "Home.semantic.glb").write_bytes(files.glb)
    (folder / "Home.semantic.txt").write_bytes(files.txt)
    zup = glb_zup_from_world(mesh.vertices).astype(np.float32)
    (folder / "Home.glb").write_bytes(glb_from_mesh(replace(mesh, vertices=zup)))
    return folder


def read_back(folder: Path) -> Semantics:
    return load_semantics(folder / "Home.semantic.glb", folder / "Home.semantic.txt", load_mesh(folder / "Home.glb"))


def test_objects_keep_their_names_places_and_rooms_when_read_back(plan: HomePlan, folder: Path) -> None:
    _, wanted = mesh_from_plan(plan)
    read = read_back(folder)
    assert [(o.instance_id, o.name, o.category) for o in read.objects] == [
        (1, "chair_1", "chair"), (2, "table lamp_2", "table lamp"), (3, "picture_3", "picture"), (4, "rug_4", "rug")
    ]  # fmt: skip
    for found, planned in zip(read.objects, wanted, strict=True):
        assert found.centre == pytest.approx(planned.centre, abs=1e-5)
        assert found.size == pytest.approx(planned.size, abs=1e-5)
    assert [label.region for label in read_semantic_txt(folder / "Home.semantic.txt")] == [0, 1, 1, -1]


def test_faces_of_the_scan_have_the_ids_of_the_plan(plan: HomePlan, folder: Path) -> None:
    mesh, _ = mesh_from_plan(plan)
    read = read_back(folder).mesh
    assert read.ids is not None
    texels = read.ids.images[0]
    uv = read.ids.face_uv.mean(axis=1)
    rows, cols = (np.floor(uv[:, ::-1] * texels.shape).astype(int)).T
    ids = np.where(read.ids.face_image < 0, read.face_instance, texels[rows, cols])
    assert len(read.faces) == len(mesh.faces)
    assert np.bincount(ids, minlength=5).tolist() == np.bincount(mesh.face_instance, minlength=5).tolist()


def test_the_text_has_hm3ds_format_and_a_name_that_does_not_match_the_id_is_a_bug(folder: Path, plan: HomePlan) -> None:
    lines = (folder / "Home.semantic.txt").read_text().splitlines()
    assert lines[:2] == ["HM3D Semantic Annotations", '1,9E3779,"chair",0']
    labels = read_semantic_txt(folder / "Home.semantic.txt")
    assert len({label.rgb for label in labels} | {0}) == 5
    mesh, objects = mesh_from_plan(plan)
    with pytest.raises(AssertionError, match="chair_7"):
        semantic_files(mesh, [replace(objects[0], name="chair_7")], region_of={})
