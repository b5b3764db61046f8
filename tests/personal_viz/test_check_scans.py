"""Verb `check-scans`: scans that fit their episodes, and each way in which they do not."""

import gzip
import json
import math
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sim.cache import VARIABLE as CACHE_VARIABLE
from tests.sim import gltf_files
from tests.sim.synthetic import example_content, example_episode, example_goal, example_view_point, write_content

from .program import Done, assert_one_line, personal_viz

NAME = "Small"
SPLITS = ("easy", "medium", "hard")


@pytest.fixture
def lab(tmp_path: Path, small_home_root: Path) -> Path:
    """An invented home as a lab's scan: episodes without a plan, and the scan in a folder of HM3D's name."""
    for split in SPLITS:
        shutil.copytree(small_home_root / split, tmp_path / "data" / split)
    folder = tmp_path / "hm3d" / "val" / f"00900-{NAME}"
    folder.mkdir(parents=True)
    for end in (".glb", ".semantic.glb", ".semantic.txt"):
        shutil.copy(small_home_root / "scenes" / f"{NAME}{end}", folder)
    return tmp_path


def check(lab: Path, *more: object) -> tuple[Done, dict[str, Any]]:
    """The finished command, and its figures of the scan."""
    out = lab / "out"
    done = personal_viz(
        *("check-scans", "--dataset", lab / "data", "--scenes-dir", lab / "hm3d", "--out", out, "--json", *more)
    )
    document = json.loads(done.stdout)
    assert json.loads((out / "check-scans.json").read_text()) == document
    return done, document["scenes"][NAME]


def scan_of(lab: Path, end: str = ".glb") -> Path:
    return lab / "hm3d" / "val" / f"00900-{NAME}" / f"{NAME}{end}"


def change_episodes(lab: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Applies a change to every content file."""
    for split in SPLITS:
        path = lab / "data" / split / "content" / f"{NAME}.json.gz"
        content = json.loads(gzip.decompress(path.read_bytes()))
        change(content)
        path.write_bytes(gzip.compress(json.dumps(content).encode()))


def page(lab: Path) -> str:
    return (lab / "out" / "check-scans.html").read_text()


def test_a_scan_that_fits_is_usable_in_every_figure(lab: Path) -> None:
    done, found = check(lab)
    assert done.returncode == 0
    assert "1 of 1 scan can be used" in done.stderr
    assert (found["problem"], found["doubts"]) == ("", ["no .navmesh beside it: only our own grid is checked"])
    assert (found["kind"], found["file"], found["up"], found["used"]) == ("scan", f"{NAME}.glb", "z", "grid")
    assert len(found["digest"]) == 64
    assert {name: len(digest) for name, digest in found["sha256"].items()} == {
        f"{NAME}{end}": 64 for end in (".glb", ".semantic.glb", ".semantic.txt")
    }
    assert min(found[name] for name in ("triangles", "textures", "objects", "goals", "load_s", "peak_mb")) > 0
    assert [found[name] for name in ("goals_found", "centres_near", "goals_seen", "impossible")] == [1, 1, 1, 0]
    grid = found["maps"]["grid"]
    assert (grid["starts"], grid["view_points"], grid["paths"], grid["within_5"]) == (1, 1, 1, 1)
    assert grid["ratio_median"] == pytest.approx(1, abs=0.001)
    assert str(lab) not in json.dumps(found)
    assert "<svg" not in page(lab)


def as_basis(lab: Path) -> None:
    """Packs every texture of the scan as a Basis image and names the file as HM3D's small ones."""
    data = scan_of(lab).read_bytes()
    length = int.from_bytes(data[12:16], "little")
    found, buffer = json.loads(data[20 : 20 + length]), data[28 + length :]
    image = (gltf_files.DATA / "corners_etc1s.basis").read_bytes()
    writer = gltf_files.GltfWriter()
    writer.json, writer.data = found, bytearray(buffer)
    found["buffers"][0]["byteLength"] = 0  # written anew
    found["images"] = [{"bufferView": writer.view(image), "mimeType": "image/x-basis"}]
    found["textures"] = [{"extensions": {"GOOGLE_texture_basis": {"source": 0}}} for _ in found["textures"]]
    found["extensionsUsed"] = found["extensionsRequired"] = ["GOOGLE_texture_basis"]
    writer.save(scan_of(lab, ".basis.glb"))
    scan_of(lab).unlink()


def test_small_scans_with_basis_textures_are_checked_too(lab: Path) -> None:
    as_basis(lab)
    done, found = check(lab)
    assert (done.returncode, found["problem"], found["file"]) == (0, "", f"{NAME}.basis.glb")
    assert found["textures"] > 0
    assert found["goals_found"] == found["goals_seen"] == found["maps"]["grid"]["within_5"] == 1


def test_a_missing_extra_is_a_reason_with_its_command(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    as_basis(lab)
    monkeypatch.setenv(CACHE_VARIABLE, str(lab / "cache"))  # an image that is in the cache needs no extra
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    done, found = check(lab)
    assert done.returncode == 1
    assert f"{NAME}.basis.glb: images.0 is a Basis texture" in found["problem"]
    assert 'pip install "personal-viz[basis]"' in found["problem"]


def test_every_scan_has_its_line_and_results_in_invented_homes_are_labelled(
    invented_root: Path, tmp_path: Path
) -> None:
    done = personal_viz(
        *("check-scans", "--dataset", invented_root, "--scenes-dir", invented_root / "scenes", "--jobs", 2),
        *("--out", tmp_path),
    )
    assert done.returncode == 0
    lines = [line.split() for line in done.stdout.splitlines()]
    assert [line[:3] for line in lines if line[:1] in (["Demo"], [NAME])] == [["Demo", "yes", "z"], [NAME, "yes", "z"]]
    assert sum("grid" in line for line in lines) == 2
    assert "Invented homes, made from a seed" in done.stdout
    assert "Invented homes, made from a seed" in (tmp_path / "check-scans.html").read_text()


def test_a_folder_that_cannot_be_written_is_refused_before_any_scan_is_opened(lab: Path) -> None:
    (lab / "out").write_text("a file")
    done = personal_viz(
        *("check-scans", "--dataset", lab / "data", "--scenes-dir", lab / "nowhere", "--out", lab / "out")
    )
    assert_one_line(done, "--out")


def test_objects_have_the_scans_own_names_and_the_episodes_categories(lab: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        key = next(iter(content["goals_by_category"]))
        old = content["goals_by_category"][key][0]["object_category"]
        content["goals_by_category"][key.removesuffix(old) + "seat"] = content["goals_by_category"].pop(key)
        for one in (*content["goals_by_category"][key.removesuffix(old) + "seat"], *content["episodes"]):
            one["object_category"] = "seat" if one["object_category"] == old else one["object_category"]

    change_episodes(lab, change)
    _, found = check(lab)
    assert (found["problem"], found["goals_found"], found["centres_near"]) == ("", 1, 1)


def test_reasons_name_no_folder_even_if_it_is_given_from_here(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(lab / "hm3d")
    cut(lab)
    done = personal_viz("check-scans", "--dataset", "../data", "--scenes-dir", ".", "--out", "../out", "--json")
    problem = json.loads(done.stdout)["scenes"][NAME]["problem"]
    assert problem.startswith(f"val/00900-{NAME}/{NAME}.glb: ")
    assert problem.endswith(".")


def cut(lab: Path) -> None:
    scan_of(lab).write_bytes(scan_of(lab).read_bytes()[:5000])


def without_text(lab: Path) -> None:
    scan_of(lab, ".semantic.txt").unlink()


def damaged_navmesh(lab: Path) -> None:
    scan_of(lab, ".navmesh").write_bytes(b"TESMxxxx")


def other_axis(lab: Path) -> None:
    scan_of(lab, ".stage_config.json").write_text('{"up": [0, 1, 0]}')


def turned(lab: Path) -> None:
    """Another home's floor: episodes that start 30 m away."""
    without_text(lab)
    scan_of(lab, ".semantic.glb").unlink()

    def change(content: dict[str, Any]) -> None:
        for one in content["episodes"]:
            one["start_position"][0] += 30

    change_episodes(lab, change)


def other_ids(lab: Path) -> None:
    text = scan_of(lab, ".semantic.txt")
    head, *lines = text.read_text().splitlines()
    swapped = [",".join([str(10_000 + number), *line.split(",")[1:]]) for number, line in enumerate(lines)]
    text.write_text("\n".join([head, *swapped]) + "\n")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda lab: shutil.rmtree(lab / "hm3d" / "val"), f"found no {NAME}.glb"),
        (cut, f"{NAME}.glb: "),
        (without_text, f"found without {NAME}.semantic.txt"),
        (damaged_navmesh, f"{NAME}.navmesh: "),
        (other_axis, "lies on its side"),
        (other_ids, "semantic files are of another scan"),
        (turned, "of the starts are on its floor"),
    ],
)
def test_a_scan_that_cannot_be_used_says_why_in_one_line(
    lab: Path, damage: Callable[[Path], object], said: str
) -> None:
    damage(lab)
    done, found = check(lab)
    assert done.returncode == 1
    assert said in found["problem"]
    assert "\n" not in found["problem"]
    assert str(lab) not in found["problem"]
    assert f"{NAME}: {found['problem']}" in done.stderr.splitlines()
    assert f"{NAME} cannot be used." in page(lab)


def test_objects_without_semantics_are_not_checked_and_the_doubt_is_said(lab: Path) -> None:
    without_text(lab)
    scan_of(lab, ".semantic.glb").unlink()
    done, found = check(lab)
    assert done.returncode == 0
    assert (found["objects"], found["goals_found"], found["goals_seen"]) == (0, None, None)
    homes = personal_viz("homes", "--dataset", lab / "data", "--scenes-dir", lab / "hm3d", "--json")
    total = json.loads(homes.stdout)["total"]
    assert (total["playable"], total["viewpoints_ok"]) == (1, None)
    assert any("no semantic files" in doubt for doubt in found["doubts"])


def test_the_worst_walks_and_centres_are_drawn_and_impossible_records_are_left_out(lab: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        content["episodes"][0]["info"]["geodesic_distance"] *= 3
        content["episodes"][1]["info"]["geodesic_distance"] = 0.01
        first = next(iter(content["goals_by_category"].values()))[0]
        first["position"] = [first["position"][0] + 0.9, *first["position"][1:]]

    change_episodes(lab, change)
    done, found = check(lab)
    assert done.returncode == 0
    assert found["impossible"] == len(SPLITS)
    assert found["maps"]["grid"]["within_5"] == pytest.approx(1 - 3 / (found["episodes"] - 3), abs=1e-3)
    assert found["centres_near"] < 1
    drawn = page(lab)
    assert drawn.count("<polyline") == len(SPLITS) + 1
    assert f"easy/{NAME}/" in drawn
    assert "0.90 m from its recorded centre" in drawn


@pytest.mark.parametrize(
    ("house", "shipped"), [("dev_a", "dev_a.navmesh"), ("dev_b", "dev_b.navmesh"), ("dev_a", "dev_a.default.navmesh")]
)
def test_lengths_of_the_real_habitat_are_found_again_on_its_navmesh_and_nearly_on_our_grid(
    golden_root: Path, tmp_path: Path, house: str, shipped: str
) -> None:
    pairs = json.loads(gzip.decompress((golden_root / f"{house}.geodesic.json.gz").read_bytes()))["pairs"]
    kept = [one for one in pairs if one["navmesh"] == shipped and one["kind"] == "on_mesh"][:60]
    kept = [one for one in kept if one["reachable"] and one["distance"] > 1]
    content = example_content(scene=house, goals_by_category={}, episodes=[])
    for number, one in enumerate(kept, start=1):
        x, y, z = one["goal"]
        named = {"object_category": f"thing{number}", "object_id": number}
        view = example_view_point(x, z, y=y, quat_xyzw=[0.0, 0.0, 0.0, 1.0], iou=0.5)
        goal = example_goal(position=one["goal"], object_name=f"thing{number}_{number}", view_points=[view], **named)
        content["goals_by_category"][f"{house}.basis.glb_thing{number}"] = [goal]
        info = {"geodesic_distance": one["distance"], "euclidean_distance": 1.0, "closest_goal_object_id": number}
        asked = {"start_position": one["start"], "info": info, "scene_id": f"{house}.glb", "episode_id": str(number)}
        content["episodes"].append(example_episode(**named | asked | {"object_id": f"thing{number}_{number}"}))
    write_content(tmp_path / "data", "easy", content, scene=house)
    scans = tmp_path / "scans"
    scans.mkdir()
    shutil.copy(golden_root / f"{house}.glb", scans)
    shutil.copy(golden_root / shipped, scans / f"{house}.navmesh")
    done = personal_viz("check-scans", "--dataset", tmp_path / "data", "--scenes-dir", scans, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "check-scans.json").read_text())["scenes"][house]
    fits = shipped == f"{house}.navmesh"
    assert (found["used"], found["episodes"]) == ("navmesh" if fits else "grid", len(kept))
    # the map that is used comes first; a scan that only glTF says to be y-up is in doubt without a fitting .navmesh
    maps = [line.split() for line in done.stdout.splitlines() if "navmesh" in line or "grid" in line]
    assert [("grid" in line, house in line) for line in maps] == (
        [(False, True), (True, False)] if fits else [(True, True), (False, False)]
    )
    assert any("read as y-up" in doubt for doubt in found["doubts"]) is not fits
    navmesh, grid = found["maps"]["navmesh"], found["maps"]["grid"]
    assert (navmesh["within_1"], navmesh["starts"], navmesh["view_points"]) == (1, 1, 1)
    assert math.isclose(navmesh["ratio_median"], 1, abs_tol=1e-4)
    if fits:
        assert grid["within_5"] > 0.9
        assert grid["ratio_median"] == pytest.approx(1, abs=0.01)
