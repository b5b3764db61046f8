"""Scenes are found where they are said to be, and errors name the file looked for."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from sim.episodes.dataset import PersonalDataset
from sim.episodes.generation import invent_dataset
from sim.errors import DatasetError, SceneError
from sim.frames import glb_zup_from_world
from sim.scenes.browser_glb import glb_from_mesh
from sim.scenes.kind import common_kind, scene_kind
from sim.scenes.sources import open_scene

from .synthetic import SCENE, write_dataset


@pytest.fixture(scope="module")
def invented(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("invented")
    invent_dataset(root, name="Demo", seed=2)
    return root


def test_a_plan_beside_the_episodes_is_an_invented_home(invented: Path) -> None:
    scene = open_scene(PersonalDataset(invented), "Demo")
    assert (scene.kind, scene.name, scene.label) == ("invented", "Demo", "Demo (invented home)")
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)
    assert scene.digest == open_scene(PersonalDataset(invented), "Demo").digest


def test_without_plan_the_home_is_schematic_and_says_so(tmp_path: Path) -> None:
    scene = open_scene(PersonalDataset(write_dataset(tmp_path)), SCENE)
    assert scene.kind == "schematic"
    assert scene.label == f"{SCENE} (schematic, not HM3D)"
    assert [item.name for item in scene.objects] == ["coffee table_7"]


def test_a_scan_is_found_anywhere_below_the_folder(invented: Path, tmp_path: Path) -> None:
    mesh = open_scene(PersonalDataset(invented), "Demo").mesh
    path = tmp_path / "hm3d_v0.2" / "val" / "00000-Demo" / "Demo.glb"
    path.parent.mkdir(parents=True)
    path.write_bytes(glb_from_mesh(replace(mesh, vertices=glb_zup_from_world(mesh.vertices))))
    episodes = tmp_path / "episodes"
    shutil.copytree(invented, episodes, ignore=shutil.ignore_patterns("*.plan.json"))
    scene = open_scene(PersonalDataset(episodes), "Demo", scenes_dir=tmp_path)
    assert (scene.kind, scene.objects, scene.label) == ("scan", (), "Demo")
    assert len(scene.mesh.faces) == len(mesh.faces)
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)


def test_a_missing_scan_is_named_with_the_pattern_looked_for(invented: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as error:
        open_scene(PersonalDataset(invented), "Demo", scenes_dir=tmp_path)
    assert f"expected {tmp_path}/**/Demo.glb" in str(error.value)
    assert "basis" not in str(error.value)
    basis = tmp_path / "00000-Demo" / "Demo.basis.glb"
    basis.parent.mkdir()
    basis.write_bytes(b"")
    with pytest.raises(SceneError, match=r"found only .*Demo\.basis\.glb, whose Basis textures are not supported yet"):
        open_scene(PersonalDataset(invented), "Demo", scenes_dir=tmp_path)


def test_an_unknown_scene_is_a_dataset_error(invented: Path) -> None:
    with pytest.raises(DatasetError, match="found no scene 'Nowhere'; expected one of: Demo"):
        open_scene(PersonalDataset(invented), "Nowhere")


def test_a_plan_of_another_home_is_refused(invented: Path, tmp_path: Path) -> None:
    shutil.copytree(invented, tmp_path / "copy")
    for path in (tmp_path / "copy").rglob("Demo.*"):
        path.rename(path.with_name(path.name.replace("Demo", "Other", 1)))
    with pytest.raises(SceneError, match=r"Other\.plan\.json: name is 'Demo'; expected 'Other'"):
        open_scene(PersonalDataset(tmp_path / "copy"), "Other")


def test_the_digest_follows_the_walkable_cells(tmp_path: Path) -> None:
    dataset = PersonalDataset(write_dataset(tmp_path))
    scene = open_scene(dataset, SCENE)
    assert scene.digest != scene.mesh.digest()
    assert len(scene.digest) == 64


def test_a_folder_may_hold_invented_and_released_homes_and_each_has_its_own_kind(
    invented: Path, tmp_path: Path
) -> None:
    shutil.copytree(invented, tmp_path / "both")
    dataset = PersonalDataset(write_dataset(tmp_path / "both"))
    assert set(dataset.scenes) == {"Demo", SCENE}
    for name, kind in (("Demo", "invented"), (SCENE, "schematic")):
        assert open_scene(dataset, name).kind == scene_kind(dataset, name, None) == kind
        assert common_kind(dataset, [name], None) == kind
    with pytest.raises(SceneError, match=rf"found scene kinds invented \(Demo\), schematic \({SCENE}\); expected one"):
        common_kind(dataset, dataset.scenes, None)
    assert scene_kind(dataset, SCENE, tmp_path) == "scan"
    assert scene_kind(dataset, "Demo", tmp_path) == "invented"  # its mesh on disk is no scan
