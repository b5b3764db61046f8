"""The script that users run inside their Habitat: old Python, few imports, and a folder that check-habitat reads.

Habitat itself is not installed: a stand-in on our own map answers, so figures are perfect unless a test changes it.
"""

import gzip
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from personal_viz.bench.habitat.agreement import Agreement, agreement
from recordings import habitat_golden
from tests.recordings.stand_in_habitat import PathFinder, habitat_lab, habitat_sim

SOURCE = Path(habitat_golden.__file__).read_text(encoding="utf-8")
SMALL = {
    "NUM_PAIRS": {"on_mesh": 6, "goal_off_mesh": 6, "both_off_mesh": 3, "any_islands": 6, "other_island": 3},
    "NUM_STEPS": {"random": 8, "near_wall": 20, "off_mesh": 3, "wall_contact": 6},
    "NUM_SNAPS": {"on_mesh": 5, "near": 8, "far": 8, "wild": 4},
    "NUM_MULTI": 6,
    "NUM_POSES": 6,
    "NUM_EPISODES": 12,
    "NUM_POOL": 60,
}


@pytest.fixture
def written(golden_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A function that runs the script with stand-ins and returns the folder."""
    for name, value in SMALL.items():
        monkeypatch.setattr(habitat_golden, name, value)

    def write(*more: str, lab: bool = True, **changes) -> Path:
        monkeypatch.setitem(sys.modules, "habitat_sim", habitat_sim(**changes))
        for name, module in habitat_lab().items():
            monkeypatch.setitem(sys.modules, name, module if lab else None)
        scene = str(golden_root / "dev_a.glb")
        habitat_golden.main(["--scene", scene, "--out", str(tmp_path / "golden"), "--seed", "4", *more])
        return tmp_path / "golden"

    return write


def dumped(found: Agreement) -> dict[str, float | None]:
    return {**found.model_dump(by_alias=True), **found.further.model_dump(by_alias=True)}


def imperfect(found: Agreement) -> dict[str, float | None]:
    """Shares below 1, which a map compared with itself never gives; those of the grid, another map, are left out."""
    names = ("reachability", "within", "snap", "navigable", "exact", "flags", "radius", "obstacle", "holes")
    return {
        name: value
        for name, value in dumped(found).items()
        if any(part in name for part in names) and "grid" not in name and value != 1.0
    }


@pytest.mark.slow
def test_check_habitat_finds_full_agreement_in_the_written_folder(written) -> None:
    folder = written()
    found = agreement(folder)
    assert found.missing == ()
    assert imperfect(found) == {}
    assert found.measures_max_abs_error == pytest.approx(0, abs=2e-6)
    assert found.depth_median_mm == pytest.approx(0.05, abs=0.03)
    assert found.grid_mean_rel_error == pytest.approx(0, abs=0.02)
    assert found.made_with == ("habitat-sim 0.3.3",)
    rows = found.rows
    assert (rows.steps + rows.sensitive, rows.snap) == (37, 25)
    assert 8 <= rows.episodes <= 12  # a start that is also drawn as a goal is left out
    assert (rows.geodesic >= 15, rows.steps >= 20, rows.grid >= 5) == (True, True, True)
    endings = ["default.navmesh", "depth.npz", "episodes.json.gz", "geodesic.json.gz", "glb", "info.json"]
    endings += ["navmesh", "poses.json", "snap.json", "steps.json.gz"]
    assert sorted(path.name for path in folder.iterdir()) == [f"dev_a.{ending}" for ending in endings]
    assert set(found.files) == {path.name for path in folder.iterdir()}


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answers(written, tmp_path: Path) -> None:
    first = {path.name: path.read_bytes() for path in written().glob("*.json")}
    (tmp_path / "golden").rename(tmp_path / "first")
    second = {path.name: path.read_bytes() for path in written().glob("*.json")}
    assert len(first) == 3
    assert first == second


@pytest.mark.slow
def test_without_habitat_lab_only_the_trajectories_are_left_out(written, capsys) -> None:
    found = agreement(written(lab=False))
    assert "habitat-lab is missing" in capsys.readouterr().err
    assert found.missing == ("dev_a.episodes",)
    assert (found.measures_max_abs_error, found.further.success_exact) == (None, None)
    assert set(imperfect(found).values()) == {None}


@pytest.mark.parametrize(
    ("version", "more", "rule"),
    [
        ("0.2.5", [], "no_slide_le_0_3_3"),
        ("0.3.3", [], "no_slide_le_0_3_3"),
        ("0.3.4", [], "no_slide_ge_0_3_4"),
        ("0.3.3", ["--no-sliding-rule", "ge_0_3_4"], "no_slide_ge_0_3_4"),
        ("0.4.0", ["--no-sliding-rule", "le_0_3_3"], "no_slide_le_0_3_3"),
    ],
)
def test_forward_steps_are_stored_under_the_rule_of_the_version_or_the_named_one(written, version, more, rule) -> None:
    folder = written(*more, lab=False, version=version)
    rows = json.loads(gzip.decompress((folder / "dev_a.steps.json.gz").read_bytes()))["steps"]
    assert {key for row in rows for key in row if "slide" in key} == {rule, "slide"}


@pytest.mark.slow
def test_a_habitat_with_different_answers_lowers_the_figures(written) -> None:
    def longer(finder, path) -> bool:
        found = PathFinder.find_path(finder, path)
        path.geodesic_distance *= 1.001
        return found

    def shifted(finder, point):
        return PathFinder.snap_point(finder, point) + np.array([0.0, 0.0, 0.001])

    found = agreement(written(find_path=longer, snap_point=shifted))
    assert found.geodesic_within_1e_4 is not None
    assert found.geodesic_within_1e_4 < 0.1
    assert found.reachability == 1.0
    assert found.snap is not None
    assert found.snap <= 0.2  # only points without any snap still agree
    assert found.measures_max_abs_error is not None
    assert found.measures_max_abs_error > 1e-4


@pytest.mark.slow
def test_a_report_holds_no_coordinates_of_the_scan(written) -> None:
    folder = written(lab=False)
    text = agreement(folder).model_dump_json()
    (pair, *_) = json.loads(gzip.decompress((folder / "dev_a.geodesic.json.gz").read_bytes()))["pairs"]
    assert not any(str(value) in text for value in [*pair["start"], *pair["goal"]])
    assert not re.search(r"\[\s*-?\d+\.", text)


class OneStep:
    """A step filter beside a corner at x = 0."""

    def stepped(self, start, end, *, slide):
        return end if end[0] < 1e-6 else start


def test_a_forward_decided_by_two_micrometres_is_sensitive() -> None:
    is_sensitive = habitat_golden.is_sensitive
    assert is_sensitive(OneStep(), [0.0, 0.0, 0.25], [0.0, 0.0, 0.0], slide=False)
    assert is_sensitive(OneStep(), [0.0, 0.0, 0.25], [2e-6, 0.0, 0.0], slide=False)
    assert not is_sensitive(OneStep(), [0.0, 0.0, 0.25], [-0.01, 0.0, 0.0], slide=False)
    assert not is_sensitive(OneStep(), [0.0, 0.0, 0.25], [0.01, 0.0, 0.0], slide=False)


def test_a_start_on_the_goal_is_left_out_because_habitat_lab_fails_on_it(written, monkeypatch) -> None:
    draws = {"first": True}

    def measured(lab, row):
        if draws.pop("first", False):
            raise ZeroDivisionError
        return {"measures": {}, "nonfinite": {}, "distance_after_step": []}

    monkeypatch.setattr(habitat_golden.Lab, "measured", measured)
    folder = written()
    rows = json.loads(gzip.decompress((folder / "dev_a.episodes.json.gz").read_bytes()))["episodes"]
    assert [row["id"] for row in rows] == list(range(1, 12))


def test_mistakes_are_reported_before_habitat_starts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for scene in (tmp_path / "none.glb", Path(__file__)):
        with pytest.raises(SystemExit) as stop:
            habitat_golden.main(["--scene", str(scene), "--out", str(tmp_path / "out")])
        assert stop.value.code == 2
        assert f"--scene is {str(scene)!r}; expected an existing .glb file" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_navmesh_that_habitat_cannot_make_gives_one_clear_line(written) -> None:
    with pytest.raises(SystemExit, match=r"Habitat made no navmesh of 'my\.navmesh'; check --scene and --navmesh"):
        written("--navmesh", "my.navmesh", load_nav_mesh=lambda finder, path: False)


def test_the_file_runs_alone_and_says_what_it_needs(tmp_path: Path) -> None:
    alone = tmp_path / "habitat_golden.py"
    alone.write_text(SOURCE, encoding="utf-8")
    done = subprocess.run([sys.executable, "-I", str(alone), "--help"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "--no-sliding-rule" in done.stdout
