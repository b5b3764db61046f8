"""Scenes are found in the folders that are given, and errors name the file that was looked for."""

import gzip
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.copies.browser_glb import glb_from_mesh
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, SceneError
from sim.frames import glb_zup_from_world
from sim.homes.kind import common_kind, scene_kind
from sim.homes.open_home import find_scan, open_scene
from sim.homes.plan import save_plan
from sim.homes.recovered.plans import recover_plan
from sim.scans.up_axis import up_axis
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh
from sim.walk.navmesh import NavMesh

from .gltf_files import RED, GltfWriter, png, with_basis
from .synthetic import SCENE, write_dataset, write_home


def test_a_plan_beside_the_episodes_is_an_invented_home(demo_root: Path) -> None:
    scene = open_scene(PersonalDataset(demo_root), "Demo")
    assert (scene.kind, scene.name, scene.label) == ("invented", "Demo", "Demo (invented home)")
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)
    assert scene.digest == open_scene(PersonalDataset(demo_root), "Demo").digest


def test_a_corrected_plan_of_a_schematic_home_does_not_hide_the_scan(tmp_path: Path) -> None:
    dataset = PersonalDataset(write_dataset(tmp_path))
    save_plan(recover_plan(dataset, SCENE), dataset.root / "scenes" / f"{SCENE}.plan.json")
    assert scene_kind(dataset, SCENE, None) == "schematic"
    assert scene_kind(dataset, SCENE, tmp_path / "scans") == "scan"


@pytest.mark.slow
def test_clutter_is_added_to_invented_and_schematic_homes_and_labelled(demo_root: Path, tmp_path: Path) -> None:
    dataset = PersonalDataset(write_home(tmp_path))
    for opened, name, label in (
        (PersonalDataset(demo_root), "Demo", "Demo (invented home, clutter 1)"),
        (dataset, SCENE, f"{SCENE} (schematic, not HM3D, clutter 1)"),
    ):
        plain, full = open_scene(opened, name), open_scene(opened, name, clutter=1)
        assert (plain.clutter, full.clutter, full.label) == (0, 1, label)
        assert len(full.objects) > len(plain.objects)
        assert full.objects[: len(plain.objects)] == plain.objects
        assert full.digest != plain.digest
        assert full.digest == open_scene(opened, name, clutter=1).digest, "the cached plan is opened again"


def test_clutter_is_refused_for_scans(demo_root: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"found clutter level 2 for the scan of 'Demo'; expected 0") as error:
        open_scene(PersonalDataset(demo_root), "Demo", scenes_dir=tmp_path, clutter=2)
    assert "\n" not in str(error.value)


def test_without_plan_the_home_is_schematic_and_says_so(tmp_path: Path) -> None:
    scene = open_scene(PersonalDataset(write_home(tmp_path)), SCENE)
    assert (scene.kind, scene.label) == ("schematic", f"{SCENE} (schematic, not HM3D)")
    assert [item.name for item in scene.objects] == ["coffee table_7"]
    map_of_mesh = floor_grid_from_mesh(scene.mesh)
    assert isinstance(scene.navigation, FloorGrid)
    assert scene.navigation.digest == map_of_mesh.digest, "people walk where they see floor"
    assert len(scene.digest) == 64


def test_records_that_make_less_floor_than_a_home_needs_are_refused(tmp_path: Path) -> None:
    dataset = PersonalDataset(write_dataset(tmp_path))  # two view points, and a start 3.25 m away
    with pytest.raises(
        SceneError, match=rf"home '{SCENE}': its records make 1\.\d\d m2 of floor; expected at least 1 m2 in one"
    ):
        open_scene(dataset, SCENE)


def test_a_scan_is_found_anywhere_below_the_folder(demo_root: Path, episodes: PersonalDataset, tmp_path: Path) -> None:
    mesh = open_scene(PersonalDataset(demo_root), "Demo").mesh
    path = tmp_path / "hm3d_v0.2" / "val" / "00000-Demo" / "Demo.glb"
    path.parent.mkdir(parents=True)
    path.write_bytes(glb_from_mesh(replace(mesh, vertices=glb_zup_from_world(mesh.vertices))))
    scene = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert (scene.kind, scene.objects, scene.label) == ("scan", (), "Demo")
    assert len(scene.mesh.faces) == len(mesh.faces)
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)


def test_an_error_about_a_missing_scene_names_the_files_that_were_looked_for(demo_root: Path, tmp_path: Path) -> None:
    dataset = PersonalDataset(demo_root)
    with pytest.raises(SceneError) as error:
        open_scene(dataset, "Demo", scenes_dir=tmp_path)
    assert f"expected {tmp_path}/**/Demo.glb" in str(error.value)
    with pytest.raises(DatasetError, match="found no scene 'Nowhere'; expected one of: Demo"):
        open_scene(dataset, "Nowhere")


@pytest.fixture(scope="module")
def episodes(demo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> PersonalDataset:
    """The episodes of the invented home without its plan, so that it can only be opened from a scan."""
    root = tmp_path_factory.mktemp("plain") / "episodes"
    shutil.copytree(demo_root, root, ignore=shutil.ignore_patterns("scenes"))
    return PersonalDataset(root)


def room(name: str = "corners_etc1s.ktx2") -> GltfWriter:
    """A z-up floor of 6 x 6 m with a Basis texture."""
    return with_basis(name, points=np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], np.float32))


def test_hm3d_folders_are_read_with_basis_textures_and_semantics(episodes: PersonalDataset, tmp_path: Path) -> None:
    folder = tmp_path / "hm3d" / "val" / "00800-Demo"
    folder.mkdir(parents=True)
    room("corners_etc1s.basis").save(folder / "Demo.basis.glb")
    without = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    semantic = room()
    del semantic.json["extensionsRequired"]
    semantic.json["textures"] = [{"source": 0}]
    semantic.json["images"] = [{"bufferView": semantic.view(png(np.full((4, 4, 3), (1, 2, 3), np.uint8)))}]
    semantic.save(folder / "Demo.semantic.glb")
    (folder / "Demo.semantic.txt").write_text('HM3D Semantic Annotations\n5,010203,"floor",4\n')
    scene = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert (scene.kind, [item.name for item in scene.objects]) == ("scan", ["floor_5"])
    assert scene.mesh.ids is not None
    assert scene.objects[0].size == pytest.approx((6, 0, 6))
    np.testing.assert_allclose(scene.mesh.textures[0][5, 5].astype(int), RED, atol=4)
    assert isinstance(scene.navigation, FloorGrid)
    assert scene.navigation.is_navigable(np.array([0.0, 0, 0]))
    assert without.digest != scene.digest
    (folder / "Demo.semantic.txt").unlink()
    with pytest.raises(SceneError, match=r"found without Demo\.semantic\.txt"):
        open_scene(episodes, "Demo", scenes_dir=tmp_path)


def test_a_plain_glb_is_preferred_to_a_basis_one_and_both_to_other_formats(tmp_path: Path) -> None:
    names = ["Demo.glb", "Demo.basis.glb", "Demo.gltf", "Demo.ply", "Demo.obj"]
    for folder, name in zip("edcba", names, strict=True):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).touch()
    for name in names:
        found = find_scan("Demo", tmp_path)
        assert found.name == name
        found.unlink()
    with pytest.raises(SceneError, match=r"expected .*/\*\*/Demo\.glb \(or \.basis\.glb, \.gltf, \.ply, \.obj\)"):
        find_scan("Demo", tmp_path)
    (tmp_path / "a" / "x[1].glb").touch()
    assert find_scan("x[1]", tmp_path).name == "x[1].glb"


def test_links_to_folders_are_followed_once_and_real_folders_are_preferred(tmp_path: Path) -> None:
    elsewhere = tmp_path / "versioned" / "hm3d-0.2" / "val" / "00800-Demo"
    elsewhere.mkdir(parents=True)
    (elsewhere / "Demo.basis.glb").touch()
    scans = tmp_path / "scene_datasets"
    scans.mkdir()
    (scans / "hm3d").symlink_to(tmp_path / "versioned" / "hm3d-0.2")
    (elsewhere / "up").symlink_to(scans)  # a loop
    (scans / "gone").symlink_to(tmp_path / "gone")
    y_up(scans)
    linked = scans / "hm3d" / "val" / "00800-Demo" / "Demo.basis.glb"
    assert find_scan("Demo", scans) == linked
    assert up_axis(linked, root=scans) == "y"
    (scans / "real").mkdir()
    (scans / "real" / "Demo.basis.glb").touch()
    assert find_scan("Demo", scans) == scans / "real" / "Demo.basis.glb"
    (elsewhere / "Demo.glb").touch()
    assert find_scan("Demo", scans) == linked.with_name("Demo.glb")
    assert find_scan("Demo", elsewhere) == elsewhere / "Demo.glb"


def y_up(folder: Path) -> None:
    """Writes the configuration that Habitat reads beside y-up scans."""
    text = '{"stages": {"default_attributes": {"up": [0, 1, 0], "shader_type": "flat"}}}'
    (folder / "own.scene_dataset_config.json").write_text(text)


def test_a_scan_without_configuration_is_y_up_and_another_axis_comes_from_habitats_configuration(
    episodes: PersonalDataset, tmp_path: Path
) -> None:
    (tmp_path / "Demo.obj").write_text("v -3 0 -3\nv -3 0 3\nv 3 0 3\nv 3 0 -3\nf 1 2 3\nf 1 3 4\n")
    scene = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert scene.navigation.storey_heights == pytest.approx((0.0,), abs=0.01)
    (tmp_path / "Demo.stage_config.json").write_text('{"up": [0, 0, 1]}')
    with pytest.raises(SceneError, match=r"Demo\.obj: .*stage_config\.json"):  # on its side, it has no floor
        open_scene(episodes, "Demo", scenes_dir=tmp_path)
    y_up(tmp_path)
    (tmp_path / "Demo.stage_config.json").unlink()
    scene = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert scene.navigation.storey_heights == pytest.approx((0.0,), abs=0.01)


def test_a_home_with_floor_both_ways_is_opened_with_a_warning_unless_a_configuration_or_hm3d_says_the_axis(
    demo_root: Path, episodes: PersonalDataset, tmp_path: Path
) -> None:
    mesh = open_scene(PersonalDataset(demo_root), "Demo").mesh
    (tmp_path / "Demo.glb").write_bytes(glb_from_mesh(mesh))
    doubt = r'Demo\.glb: read as y-up, .* m2 of floor; with z up .*\{"up": \[0, 0, 1\]\} in Demo\.stage_config\.json'
    with pytest.warns(UserWarning, match=doubt) as said:
        scene = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert len(said) == 1
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)
    (tmp_path / "Demo.stage_config.json").write_text('{"up": [0, 1, 0]}')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert open_scene(episodes, "Demo", scenes_dir=tmp_path).digest == scene.digest


def test_homes_that_invent_wrote_before_it_wrote_configurations_are_z_up(demo_root: Path, tmp_path: Path) -> None:
    shutil.copytree(demo_root, tmp_path / "data")
    (tmp_path / "data" / "scenes" / "Demo.stage_config.json").unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = open_scene(PersonalDataset(tmp_path / "data"), "Demo", scenes_dir=tmp_path / "data" / "scenes")
    assert scene.kind == "invented"
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)


@pytest.mark.parametrize("folder", [b"hm3d_v0.2/val", b"data/scene_datasets/hm3d/val"])
def test_episodes_in_hm3d_make_a_file_z_up_whatever_its_folder(
    demo_root: Path, episodes: PersonalDataset, tmp_path: Path, folder: bytes
) -> None:
    shutil.copytree(episodes.root, tmp_path / "data")
    for path in tmp_path.glob("data/*/content/Demo.json.gz"):
        text = gzip.decompress(path.read_bytes()).replace(b'"invented/Demo/', b'"' + folder + b"/00800-Demo/")
        path.write_bytes(gzip.compress(text))
    mesh = open_scene(PersonalDataset(demo_root), "Demo").mesh
    (tmp_path / "Demo.glb").write_bytes(glb_from_mesh(replace(mesh, vertices=glb_zup_from_world(mesh.vertices))))
    scene = open_scene(PersonalDataset(tmp_path / "data"), "Demo", scenes_dir=tmp_path)
    assert scene.navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)


def test_a_navmesh_beside_the_scan_is_used_if_it_fits_the_robot(
    episodes: PersonalDataset, golden_root: Path, tmp_path: Path
) -> None:
    shutil.copy(golden_root / "dev_b.glb", tmp_path / "Demo.glb")
    shutil.copy(golden_root / "dev_b.default.navmesh", tmp_path / "Demo.navmesh")
    y_up(tmp_path)
    own = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert isinstance(own.navigation, FloorGrid)  # this navmesh is for another robot, like those of HM3D
    shutil.copy(golden_root / "dev_b.navmesh", tmp_path / "Demo.basis.navmesh")
    given = open_scene(episodes, "Demo", scenes_dir=tmp_path)
    assert isinstance(given.navigation, NavMesh)
    assert len({own.digest, given.digest, own.mesh.digest()}) == 2
    (tmp_path / "Demo.basis.navmesh").write_bytes(b"TESM")
    with pytest.raises(SceneError, match=r"Demo\.basis\.navmesh"):
        open_scene(episodes, "Demo", scenes_dir=tmp_path)


def test_a_plan_of_another_home_is_refused(demo_root: Path, tmp_path: Path) -> None:
    shutil.copytree(demo_root, tmp_path / "copy")
    for path in (tmp_path / "copy").rglob("Demo.*"):
        path.rename(path.with_name(path.name.replace("Demo", "Other", 1)))
    with pytest.raises(SceneError, match=r"Other\.plan\.json: name is 'Demo'; expected 'Other'"):
        open_scene(PersonalDataset(tmp_path / "copy"), "Other")


def test_a_folder_may_hold_invented_and_released_homes_and_each_has_its_own_kind(
    demo_root: Path, tmp_path: Path
) -> None:
    shutil.copytree(demo_root, tmp_path / "both")
    dataset = PersonalDataset(write_home(tmp_path / "both"))
    assert set(dataset.scenes) == {"Demo", SCENE}
    for name, kind in (("Demo", "invented"), (SCENE, "schematic")):
        assert open_scene(dataset, name).kind == scene_kind(dataset, name, None) == kind
        assert common_kind(dataset, [name], None) == kind
    with pytest.raises(SceneError, match=rf"found scene kinds invented \(Demo\), schematic \({SCENE}\); expected one"):
        common_kind(dataset, dataset.scenes, None)
    assert scene_kind(dataset, SCENE, tmp_path) == "scan"
    assert scene_kind(dataset, "Demo", tmp_path) == "invented"  # its mesh on disk does not count as a scan
