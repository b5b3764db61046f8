"""The command line as a person meets it: one clear line for each mistake, and what the demo serves."""

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from personal_viz.study_app.operator.served import served

from .program import assert_one_line, personal_viz
from .wire import enter

SERVE = ("study", "serve", "--scene", "Demo")


def test_a_port_in_use_is_one_line(demo_root: Path, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = personal_viz(*SERVE, "--dataset", demo_root, "--out", tmp_path / "s", "--port", port)
    assert_one_line(done, f"port {port} of 127.0.0.1: cannot be used", "--port 8090")
    assert not (tmp_path / "s").exists()


@pytest.mark.slow
def test_a_port_that_is_no_number_is_one_line(tmp_path: Path) -> None:
    assert_one_line(personal_viz("demo", "--out", str(tmp_path / "d"), PORT="eighty"), "PORT is 'eighty'; expected")


def test_an_unwritable_folder_is_one_line(demo_root: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    out = str(tmp_path / "file" / "study")
    done = personal_viz(*SERVE, "--dataset", demo_root, "--out", out, "--port", "0")
    assert_one_line(done, f"{out}: cannot be written", "--out")
    assert_one_line(personal_viz("demo", "--out", out, "--port", "0"), f"{out}: cannot be written")


@pytest.mark.slow
def test_a_missing_scan_names_the_file(demo_root: Path, tmp_path: Path) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    for verb in (
        [*SERVE, "--port", "0", "--out", str(tmp_path / "s")],
        ["run", "--agent", "random", "--out", str(tmp_path / "r")],
    ):
        done = personal_viz(*verb, "--dataset", str(demo_root), "--scenes-dir", str(scans))
        assert_one_line(done, "Demo.glb", str(scans))


def test_a_scan_without_faces_is_one_line(demo_root: Path, tmp_path: Path) -> None:
    import trimesh

    trimesh.PointCloud([[0.0, 0.0, 0.0]]).export(tmp_path / "Demo.glb")
    done = personal_viz(
        "run", "--agent", "random", "--dataset", str(demo_root), "--scenes-dir", str(tmp_path), "--out", str(tmp_path)
    )
    assert_one_line(done, "Demo.glb", "face")


def test_unknown_scenes_and_folders_are_one_line(demo_root: Path, tmp_path: Path) -> None:
    out = str(tmp_path)
    assert_one_line(
        personal_viz("run", "--agent", "random", "--dataset", str(demo_root), "--scene", "Nowhere", "--out", out),
        "found no scene 'Nowhere'; expected one of: Demo",
    )
    for verb in (["validate"], ["stats"], ["run", "--agent", "random"], ["ground", "--method", "qs"]):
        done = personal_viz(*verb, "--dataset", str(tmp_path / "empty"))
        assert done.returncode == 1
        assert "Traceback" not in done.stderr
        assert "empty" in done.stderr + done.stdout


def test_usage_errors_exit_with_2() -> None:
    assert personal_viz("run", "--dataset", "data").returncode == 2
    done = subprocess.run([sys.executable, "-m", "personal_viz", "fly"], capture_output=True, timeout=120, check=False)
    assert done.returncode == 2


@pytest.mark.slow
def test_runs_and_metrics_from_start_to_table(demo_root: Path, tmp_path: Path) -> None:
    for agent in ("random", "shortest-path"):
        for jobs in ("1", "2"):
            out = tmp_path / jobs
            options = ("--agent", agent, "--dataset", str(demo_root), "--limit", "1", "--jobs", jobs)
            assert personal_viz("run", *options, "--out", str(out)).returncode == 0
        name = f"{agent}-invented-seed0"
        one, two = ((tmp_path / jobs / name / "steps.jsonl").read_bytes() for jobs in ("1", "2"))
        assert one == two
    rows = json.loads(personal_viz("metrics", str(tmp_path / "1"), "--json").stdout)
    keys = {"who", "task", "condition", "scene_kind", "split", "rule", "n", "k", "sr", "spl", "dtg", "unreachable"}
    assert all(keys <= set(row) for row in rows)
    assert {(row["who"], row["split"], row["n"]) for row in rows} == {
        (agent, split, n)
        for agent in ("random", "shortest-path")
        for split, n in (("easy", 1), ("medium", 1), ("hard", 1), ("total", 3))
    }
    best = [row for row in rows if row["who"] == "shortest-path" and row["split"] == "total"]
    assert best[0]["sr"] > 80


@pytest.mark.slow
def test_the_demo_lets_people_walk_and_point(tmp_path: Path) -> None:
    with served(["demo", "--seed", "5", "--out", str(tmp_path / "demo"), "--port", "0"]) as study:
        with enter(study.link("pan")) as walker:
            walker.see_step(0)
        with enter(study.link("pog")) as pointer:
            pointer.receive_until(lambda message: "Click the middle of the object" in str(message))
        assert study.end() == 0
