"""The command line as a person meets it: one clear line for each mistake, nothing lost when it is killed."""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from human_study.events import Act
from human_study.records import read_study
from personal_viz.served import start_study
from sim.episodes.generation import invent_dataset

from .wire import enter


def personal_viz(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A finished run of the program."""
    command = [sys.executable, "-m", "personal_viz", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=120, env={**os.environ, **environment}, check=False
    )


def assert_one_line(done: subprocess.CompletedProcess[str], *parts: str) -> None:
    """Exit code 1 and one line on standard error that holds the parts."""
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    for part in parts:
        assert part in done.stderr


@pytest.fixture(scope="module")
def homes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with one invented home."""
    root = tmp_path_factory.mktemp("homes")
    invent_dataset(root, name="Demo", seed=1)
    return root


def test_a_port_in_use_is_one_line(homes: Path, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = personal_viz(
            "study", "serve", "--dataset", str(homes), "--scene", "Demo", "--out", str(tmp_path / "s"), "--port", port
        )
    assert_one_line(done, f"port {port} of 127.0.0.1: cannot be used", "--port 8090")
    assert not (tmp_path / "s").exists()


def test_a_port_that_is_no_number_is_one_line(tmp_path: Path) -> None:
    assert_one_line(personal_viz("demo", "--out", str(tmp_path / "d"), PORT="eighty"), "PORT is 'eighty'; expected")


def test_an_unwritable_folder_is_one_line(homes: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    out = str(tmp_path / "file" / "study")
    assert_one_line(
        personal_viz("study", "serve", "--dataset", str(homes), "--scene", "Demo", "--out", out, "--port", "0"),
        f"{out}: cannot be written",
        "--out",
    )
    assert_one_line(personal_viz("demo", "--out", out, "--port", "0"), f"{out}: cannot be written")


def test_a_missing_scan_names_the_file(homes: Path, tmp_path: Path) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    for verb in (
        ["study", "serve", "--scene", "Demo", "--port", "0", "--out", str(tmp_path / "s")],
        ["run", "--agent", "random", "--out", str(tmp_path / "r")],
    ):
        done = personal_viz(*verb, "--dataset", str(homes), "--scenes-dir", str(scans))
        assert_one_line(done, "Demo.glb", str(scans))


def test_a_scan_without_faces_is_one_line(homes: Path, tmp_path: Path) -> None:
    import trimesh

    trimesh.PointCloud([[0.0, 0.0, 0.0]]).export(tmp_path / "Demo.glb")
    done = personal_viz(
        "run", "--agent", "random", "--dataset", str(homes), "--scenes-dir", str(tmp_path), "--out", str(tmp_path)
    )
    assert_one_line(done, "Demo.glb", "face")


def test_unknown_scenes_and_folders_are_one_line(homes: Path, tmp_path: Path) -> None:
    out = str(tmp_path)
    assert_one_line(
        personal_viz("run", "--agent", "random", "--dataset", str(homes), "--scene", "Nowhere", "--out", out),
        "found no scene 'Nowhere'; expected one of: Demo",
    )
    for verb in (["validate"], ["stats"], ["run", "--agent", "random"], ["ground", "--method", "qs"]):
        done = personal_viz(*verb, "--dataset", str(tmp_path / "empty"))
        assert done.returncode == 1
        assert "Traceback" not in done.stderr
        assert "empty" in done.stderr + done.stdout


def test_usage_errors_exit_with_2() -> None:
    assert personal_viz("run", "--agent", "random").returncode == 2
    assert personal_viz("fly").returncode == 2


@pytest.mark.slow
def test_runs_and_metrics_from_start_to_table(homes: Path, tmp_path: Path) -> None:
    for agent in ("random", "shortest-path"):
        for jobs in ("1", "2"):
            out = tmp_path / jobs
            assert (
                personal_viz(
                    "run", "--agent", agent, "--dataset", str(homes), "--out", str(out), "--limit", "3", "--jobs", jobs
                ).returncode
                == 0
            )
        name = f"{agent}-invented-seed0"
        assert (tmp_path / "1" / name / "steps.jsonl").read_bytes() == (
            tmp_path / "2" / name / "steps.jsonl"
        ).read_bytes()
    rows = json.loads(personal_viz("metrics", str(tmp_path / "1"), "--json").stdout)
    keys = {"who", "task", "condition", "scene_kind", "split", "rule", "n", "k", "sr", "spl", "dtg", "unreachable"}
    assert all(keys <= set(row) for row in rows)
    assert {(row["who"], row["split"], row["n"]) for row in rows} == {
        (agent, split, n)
        for agent in ("random", "shortest-path")
        for split, n in (("easy", 3), ("medium", 3), ("hard", 3), ("total", 9))
    }
    best = [row for row in rows if row["who"] == "shortest-path" and row["split"] == "total"]
    assert best[0]["sr"] > 80


@pytest.mark.slow
def test_a_killed_server_resumes_every_link_at_the_same_step_and_pose(homes: Path, tmp_path: Path) -> None:
    command = ("study", "serve", "--dataset", str(homes), "--scene", "Demo")
    first = start_study(tmp_path / "study", *command)
    try:
        with enter(first.links["pan"]) as client:
            client.press("Start")
            buttons = ("Turn left (A or Left)", "Forward (W or Up)", "Forward (W or Up)")
            for step, button in enumerate(buttons, start=1):
                client.press(button)
                client.see_step(step)
    finally:
        os.killpg(first.process.pid, signal.SIGKILL)
        first.process.wait()
    again = start_study(tmp_path / "study", *command)
    try:
        assert again.links["pan"].split("#")[1] == first.links["pan"].split("#")[1]
        with enter(again.links["pan"]) as client:
            client.see_step(3)
            client.press("Turn right (D or Right)")
            client.see_step(4)
    finally:
        assert again.end() == 0
    with read_study(tmp_path / "study") as reader:
        reader.check()
        trial_id = reader.trials("p02")[0].trial_id
        assert trial_id is not None
        acts = [stored.event for stored in reader.events(trial_id) if isinstance(stored.event, Act)]
    assert [act.action.value for act in acts] == ["left", "forward", "forward", "right"]
    assert acts[3].position == acts[2].position


@pytest.mark.skipif(sys.platform != "linux", reason="finds the worker through /proc")
def test_a_worker_that_dies_is_started_again_and_the_trial_goes_on(homes: Path, tmp_path: Path) -> None:
    command = ("study", "serve", "--dataset", str(homes), "--scene", "Demo", "--workers", "1")
    study = start_study(tmp_path / "study", *command)
    try:
        with enter(study.links["pan"]) as client:
            client.press("Start")
            client.see_step(0)
            client.press("Turn left (A or Left)")
            client.see_step(1)
        (worker,) = workers_of(study.process.pid)
        os.kill(worker, signal.SIGKILL)
        with enter(study.links["pan"], patience_s=60) as client:
            client.see_step(1)
    finally:
        assert study.end() == 0


def workers_of(pid: int) -> list[int]:
    """Process ids of the viser workers that a served study has started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in children if b"personal_viz.server" in Path(f"/proc/{child}/cmdline").read_bytes()]
