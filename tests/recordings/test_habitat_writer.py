"""The file that users copy into a Habitat environment: old Python, no packages, clear errors, complete episodes."""

import ast
import math
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from recordings import habitat_golden, habitat_writer
from recordings.habitat_writer import RunWriter
from sim.tasks.run_files import EpisodeRun, read_episode_runs

AHEAD = [0.0, 0.0, 0.0, 1.0]
LEFT = [0.0, math.sin(math.radians(15)), 0.0, math.cos(math.radians(15))]


def runs_of(path: Path) -> list[EpisodeRun]:
    return [run for _, run in read_episode_runs(path)]


@pytest.fixture
def writer(tmp_path: Path) -> RunWriter:
    return RunWriter(tmp_path / "agent.jsonl")


@pytest.fixture
def started(writer: RunWriter) -> RunWriter:
    writer.start_episode("easy", "Flat", "4", [1.0, 0.2, -2.0], AHEAD)
    return writer


@pytest.mark.parametrize(
    ("module", "others", "standard"),
    [(habitat_writer, set(), {"__future__", "json", "math", "os", "re", "typing"}), (habitat_golden, {"numpy"}, None)],
    ids=["writer: six modules of the standard library", "golden: numpy and the standard library"],
)
def test_the_files_to_copy_run_on_python_3_8_and_need_few_modules(
    module: ModuleType, others: set[str], standard: set[str] | None
) -> None:
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"), feature_version=(3, 8))
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names.add(str(node.module))
    assert "__future__" in names, "annotations are not evaluated"
    assert names - set(sys.stdlib_module_names) == others
    assert standard is None or names == standard
    compile(tree, str(module.__file__), "exec")


def test_an_episode_is_read_back_as_a_run(started: RunWriter) -> None:
    started.step(1, [1.0, 0.2, -2.25], AHEAD, collided=False, t_s=0.5)
    started.step("turn_left", [1.0, 0.2, -2.25], LEFT)
    started.step("look_down", [1.0, 0.2, -2.25], LEFT)
    started.step("LOOK_DOWN", [1.0, 0.2, -2.25], LEFT)
    started.step("look_up", [1.0, 0.2, -2.25], LEFT, tilt=-0.5)
    started.step(0, [1.0, 0.2, -2.25], LEFT)
    started.end_episode()
    (run,) = runs_of(Path(started.path))
    assert str(run.key) == "easy/Flat/4"
    assert [step.action for step in run.steps] == ["forward", "left", "look_down", "look_down", "look_up", "stop"]
    assert [step.yaw for step in run.steps] == pytest.approx([0, *[math.pi / 6] * 5])
    assert [step.tilt for step in run.steps] == pytest.approx([0, 0, -math.pi / 6, -math.pi / 3, -0.5, -0.5])
    assert run.steps[0].t_s == 0.5
    assert run.end.reason == "stop"
    assert run.end.measures is None


@pytest.mark.parametrize(
    "rotation",
    [
        tuple(LEFT),
        np.array(LEFT, np.float32),
        SimpleNamespace(w=LEFT[3], x=0.0, y=LEFT[1], z=0.0),
        SimpleNamespace(vector=np.array(LEFT[:3]), scalar=LEFT[3]),
        [-value for value in LEFT],
    ],
    ids=["tuple", "numpy array", "numpy-quaternion", "magnum", "the same with all signs changed"],
)
def test_every_usual_kind_of_quaternion_is_accepted(writer: RunWriter, rotation: Any) -> None:
    writer.start_episode("hard", "hm3d/val/00800-Flat/Flat.basis.glb", np.int64(7), np.zeros(3, np.float32), rotation)
    writer.step(np.int64(0), np.zeros(3, np.float32), rotation)
    writer.end_episode("stop")
    (run,) = runs_of(Path(writer.path))
    assert str(run.key) == "hard/Flat/7"
    assert run.start.yaw == pytest.approx(math.pi / 6, abs=1e-6)


def test_an_episode_is_written_as_soon_as_it_has_ended_and_not_before(started: RunWriter) -> None:
    started.step("stop", [1.0, 0.2, -2.0], AHEAD)
    assert not Path(started.path).exists()
    started.end_episode()
    assert len(runs_of(Path(started.path))) == 1


def test_a_second_program_continues_after_the_last_complete_episode(started: RunWriter) -> None:
    path = Path(started.path)
    started.step("stop", [1.0, 0.2, -2.0], AHEAD)
    started.end_episode()
    whole = path.read_bytes()
    for cut in (9, len(whole) - 1, whole.index(b"\n") + 1):
        path.write_bytes(whole + whole[:cut])
        again = RunWriter(path)
        assert path.read_bytes() == whole
    again.start_episode("easy", "Flat", "5", [0, 0, 0], AHEAD)
    again.step("stop", [0, 0, 0], AHEAD)
    again.end_episode()
    assert [run.key.episode_id for run in runs_of(path)] == ["4", "5"]


def test_500_steps_without_stop_end_the_episode_at_the_limit(started: RunWriter) -> None:
    for _ in range(500):
        started.step("forward", [1.0, 0.2, -2.0], AHEAD)
    with pytest.raises(ValueError, match="has 500 steps; expected no more"):
        started.step("forward", [1.0, 0.2, -2.0], AHEAD)
    started.end_episode()
    assert runs_of(Path(started.path))[0].end.reason == "steps"


def test_an_unfinished_episode_needs_a_reason(started: RunWriter) -> None:
    started.step("forward", [1.0, 0.2, -2.0], AHEAD)
    for reason in (None, "stop", "steps", "bored"):
        with pytest.raises(ValueError, match=r"expected one of .*'timeout'"):
            started.end_episode(reason)
    started.end_episode("timeout")
    assert runs_of(Path(started.path))[0].end.reason == "timeout"


def test_a_stopped_episode_accepts_no_other_reason_and_no_more_steps(started: RunWriter) -> None:
    started.step("stop", [1.0, 0.2, -2.0], AHEAD)
    with pytest.raises(ValueError, match="has stopped"):
        started.step("forward", [1.0, 0.2, -2.0], AHEAD)
    with pytest.raises(ValueError, match=r"reason is 'giveup' after 1 steps.*expected 'stop'"):
        started.end_episode("giveup")


def test_calls_out_of_order_are_refused(writer: RunWriter) -> None:
    with pytest.raises(ValueError, match="no episode is open"):
        writer.step(1, [0, 0, 0], AHEAD)
    with pytest.raises(ValueError, match="no episode is open"):
        writer.end_episode()
    writer.start_episode("easy", "Flat", "4", [0, 0, 0], AHEAD)
    with pytest.raises(ValueError, match="has not ended"):
        writer.start_episode("easy", "Flat", "5", [0, 0, 0], AHEAD)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"action": 6}, "action is 6; expected 0-5"),
        ({"action": -1}, "action is -1"),
        ({"action": True}, "action is True"),
        ({"action": "jump"}, "action is 'jump'"),
        ({"action": 1.0}, r"action is 1\.0"),
        ({"position": [0, 0]}, "expected 3 numbers"),
        ({"position": 3.0}, "expected 3 numbers"),
        ({"position": [0, math.nan, 0]}, "position is nan; expected a finite number"),
        ({"position": [0, "low", 0]}, "position is 'low'"),
        ({"rotation_xyzw": [0, 0, 1]}, "expected a quaternion"),
        ({"rotation_xyzw": None}, "expected a quaternion"),
        ({"rotation_xyzw": [0, 0, 0, 0.9]}, r"length 0\.9000; expected a unit"),
        ({"rotation_xyzw": [math.sin(0.26), 0, 0, math.cos(0.26)]}, "tilts; expected a turn about"),
        ({"rotation_xyzw": [1.0, 0.0, 0.0, 0.0]}, "in the order x, y, z, w"),
        ({"tilt": math.inf}, "tilt is inf"),
        ({"t_s": "soon"}, "t_s is 'soon'"),
    ],
)
def test_a_bad_argument_of_a_step_is_refused(started: RunWriter, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        started.step(**({"action": 1, "position": [0, 0, 0], "rotation_xyzw": AHEAD} | values))
    started.step("stop", [1.0, 0.2, -2.0], AHEAD)
    started.end_episode()
    assert len(runs_of(Path(started.path))[0].steps) == 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"split": "val"}, "split is 'val'"),
        ({"scene_id_or_name": "a b"}, "scene is 'a b'"),
        ({"episode_id": "1/2"}, "episode_id is '1/2'"),
        ({"position": None}, "expected 3 numbers"),
    ],
)
def test_a_bad_argument_of_a_start_is_refused(writer: RunWriter, values: dict[str, Any], message: str) -> None:
    good = {"split": "easy", "scene_id_or_name": "Flat", "episode_id": 1, "position": [0, 0, 0], "rotation_xyzw": AHEAD}
    with pytest.raises(ValueError, match=message):
        writer.start_episode(**(good | values))


def test_in_a_folder_the_file_is_named_after_the_agent_and_unusable_paths_are_refused(tmp_path: Path) -> None:
    assert Path(RunWriter(tmp_path, agent="vlfm").path) == tmp_path / "vlfm.jsonl"
    with pytest.raises(ValueError, match="Give agent="):
        RunWriter(tmp_path)
    with pytest.raises(ValueError, match=r"agent is '\.\./vlfm'"):
        RunWriter(tmp_path, agent="../vlfm")
    other = tmp_path / "notes.txt"
    other.write_text("my notes\n")
    with pytest.raises(ValueError, match="holds something else than episodes"):
        RunWriter(other)
    assert other.read_text() == "my notes\n"
    with pytest.raises(ValueError, match="Make it first"):
        RunWriter(tmp_path / "none" / "a.jsonl")
