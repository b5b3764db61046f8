"""The up axis of a scan is read from Habitat's configuration files; the nearest file counts."""

import json
from pathlib import Path

import pytest

from sim.errors import SceneError
from sim.scans.up_axis import up_axis


def write_config(path: Path, up: list[float] | None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"stages": {"paths": {}, "default_attributes": {} if up is None else {"up": up}}}))


@pytest.mark.parametrize(
    ("scan", "up"),
    [
        ("val/00800-A/A.glb", "z"),
        ("val/A.basis.glb", "z"),
        ("val/A.glb", None),
        ("00800-B/A.glb", None),
        ("0800-A/A.glb", None),
        ("00800-A/textured/A.ply", None),
    ],
)
def test_without_configuration_only_hm3ds_names_say_an_axis(tmp_path: Path, scan: str, up: str | None) -> None:
    assert up_axis(tmp_path / scan, root=tmp_path) == up
    write_config(tmp_path / "a.scene_dataset_config.json", None)
    assert up_axis(tmp_path / scan, root=tmp_path) == up


def test_the_nearest_file_counts_and_none_above_the_root(tmp_path: Path) -> None:
    scan = tmp_path / "scans" / "val" / "00800-A" / "A.basis.glb"
    write_config(tmp_path / "above.scene_dataset_config.json", [0, 1, 0])
    assert up_axis(scan, root=tmp_path / "scans") == "z"
    write_config(tmp_path / "scans" / "hm3d.scene_dataset_config.json", [0, 1, 0])
    assert up_axis(scan, root=tmp_path / "scans") == "y"
    write_config(scan.parent / "near.scene_dataset_config.json", [0, 0, 1])
    assert up_axis(scan, root=tmp_path / "scans") == "z"
    (scan.parent / "A.stage_config.json").write_text('{"up": [0, 1, 0]}')
    assert up_axis(scan, root=tmp_path / "scans") == "y"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"up": [1, 0, 0]}', r"up is \[1\.0, 0\.0, 0\.0\]; expected \[0, 1, 0\] or \[0, 0, 1\]"),
        ('{"up": "y"}', r"A\.stage_config\.json: up is 'y'"),
        ("{", r"A\.stage_config\.json: .*JSON"),
    ],
)
def test_a_wrong_configuration_file_is_refused_with_its_name(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "A.stage_config.json").write_text(text)
    with pytest.raises(SceneError, match=message) as error:
        up_axis(tmp_path / "A.glb", root=tmp_path)
    assert "\n" not in str(error.value)


def test_two_files_that_differ_are_refused(tmp_path: Path) -> None:
    write_config(tmp_path / "a.scene_dataset_config.json", [0, 1, 0])
    write_config(tmp_path / "b.scene_dataset_config.json", [0, 0, 1])
    with pytest.raises(SceneError, match=r"a\.scene.* says y, b\.scene.* says z; expected one"):
        up_axis(tmp_path / "A.glb", root=tmp_path)
