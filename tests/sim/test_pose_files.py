"""Pose files of other programs: what they may hold, what must be declared, and one clear line for every mistake."""

import io
import json
import math
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.errors import RunFileError
from sim.exchange import pose_tables
from sim.exchange.import_runs import check_file
from sim.exchange.pose_files import FreeMotion, PoseReading
from sim.tasks.run_files import EpisodeRun
from sim.types import EpisodeKey

from .foreign_runs import quat, two_starts

START = (1.0, 0.2, -2.0)
KEY = EpisodeKey("easy", "Flat", "40")
WORLD = PoseReading("world", quaternion="xyzw", episode=KEY, stopped=True)
HEAD = "x,y,z,yaw_deg"


WALK = [  # forward, left, forward against a wall after 0.1 m
    (1.0, 0.2, -2.0, 0.0),
    (1.0, 0.2, -2.25, 0.0),
    (1.0, 0.2, -2.25, 30.0),
    (0.95, 0.2, -2.25 - 0.05 * math.sqrt(3), 30.0),
]
ACTIONS = ["forward", "left", "forward", "stop"]


@pytest.fixture
def dataset(tmp_path: Path) -> PersonalDataset:
    """Two episodes that start at START looking along -z and along -x; ids 40 and 41."""
    return two_starts(tmp_path / "data", START, yaws_deg=(0, 90))


def runs_of(dataset: PersonalDataset, name: str, content: str | bytes, reading: PoseReading) -> list[EpisodeRun]:
    """The runs that the import reads from a file with this name and content."""
    path = dataset.root.parent / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return [found.run for found in check_file(path, dataset=dataset, reading=reading)]


def run_of(dataset: PersonalDataset, name: str, content: str | bytes, reading: PoseReading = WORLD) -> EpisodeRun:
    (run,) = runs_of(dataset, name, content, reading)
    return run


def refusal(dataset: PersonalDataset, name: str, content: str | bytes, reading: PoseReading = WORLD) -> str:
    with pytest.raises(RunFileError) as error:
        runs_of(dataset, name, content, reading)
    assert "\n" not in str(error.value)
    return str(error.value)


def csv_of(header: str, rows: list[tuple[Any, ...]]) -> str:
    return "\n".join([header, *(",".join(str(cell) for cell in row) for row in rows)]) + "\n"


def npz_of(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def actions_of(run: EpisodeRun) -> list[str]:
    return [step.action.value for step in run.steps]


def test_actions_are_inferred_from_poses_and_a_declared_or_repeated_last_row_is_stop(dataset: PersonalDataset) -> None:
    run = run_of(dataset, "log.csv", csv_of(HEAD, WALK))
    assert actions_of(run) == ["forward", "left", "forward", "stop"]
    assert [step.collided for step in run.steps] == [False, False, True, False]
    assert run.end.reason == "stop"
    assert run.steps[-1].position == run.steps[-2].position
    repeated = csv_of(HEAD, [*WALK, WALK[-1]])
    assert actions_of(run_of(dataset, "log.csv", repeated)) == ["forward", "left", "forward", "stop"]
    unstopped = run_of(dataset, "log.csv", repeated, replace(WORLD, stopped=False))
    assert actions_of(unstopped) == ["forward", "left", "forward", "forward"]
    assert (unstopped.end.reason, unstopped.steps[-1].collided) == ("abandoned", True)


def test_stop_frame_and_order_of_quaternions_are_never_guessed(dataset: PersonalDataset, tmp_path: Path) -> None:
    message = refusal(dataset, "log.csv", csv_of(HEAD, WALK), replace(WORLD, stopped=None))
    assert "log.csv:2: nothing says whether the run ended with STOP" in message
    assert "--stopped yes or --stopped no" in message
    path = tmp_path / "log.csv"
    path.write_text(csv_of(HEAD, WALK))
    with pytest.raises(
        RunFileError, match=r"its frame is not declared; expected one of world, zup, ros, start, start-ro"
    ):
        list(check_file(path, dataset=dataset))
    poses = [[*pose[:3], *quat(pose[3])] for pose in WALK]
    message = refusal(dataset, "log.json", json.dumps(poses), replace(WORLD, quaternion=None))
    assert "the order of its quaternions is not declared; expected xyzw or wxyz" in message
    wrong = refusal(dataset, "log.json", json.dumps(poses), replace(WORLD, quaternion="wxyz"))
    assert "rolled by 180.0" in wrong or "begins" in wrong or "tilted" in wrong


def test_a_row_may_name_the_action_before_or_after_its_pose(dataset: PersonalDataset) -> None:
    poses, header = [*WALK, WALK[-1]], HEAD + ",action"
    after = [(*pose, action) for pose, action in zip(poses, ["", *ACTIONS], strict=True)]
    before = [(*pose, action) for pose, action in zip(poses, [*ACTIONS, ""], strict=True)]
    reading = replace(WORLD, stopped=None)
    first, second = (run_of(dataset, "log.csv", csv_of(header, rows), reading) for rows in (after, before))
    assert actions_of(first) == ACTIONS
    assert first == second


def test_a_full_action_column_needs_a_declaration(dataset: PersonalDataset) -> None:
    reading = replace(WORLD, stopped=None)
    before = acted(*ACTIONS)
    after = [(*pose, action) for pose, action in zip([*WALK[1:], WALK[-1]], [1, 2, 1, 0], strict=True)]
    assert "--rows before-action or --rows after-action" in refusal(dataset, "log.csv", before, reading)
    first = run_of(dataset, "log.csv", before, replace(reading, rows="before-action"))
    second = run_of(dataset, "log.csv", csv_of(HEAD + ",action", after), replace(reading, rows="after-action"))
    assert actions_of(first) == actions_of(second) == ACTIONS
    assert first.poses == second.poses
    cut = refusal(dataset, "log.csv", acted(*ACTIONS[:3]), replace(reading, rows="before-action"))
    assert "the pose after it is missing" in cut


@pytest.mark.parametrize(
    "names", [["move_forward", "turn_left", "move_forward", "stop"], [1, 2, 1, 0], [1.0, 2.0, 1.0, 0.0]]
)
def test_actions_may_have_habitats_names_or_numbers(dataset: PersonalDataset, names: list[Any]) -> None:
    rows = [(*pose, action) for pose, action in zip([*WALK, WALK[-1]], ["", *names], strict=True)]
    run = run_of(dataset, "log.csv", csv_of(HEAD + ",action", rows), replace(WORLD, stopped=None))
    assert actions_of(run) == ACTIONS


def test_habitat_labs_agent_states_are_read_in_the_declared_order(dataset: PersonalDataset) -> None:
    states = [{"agent_state": {"position": pose[:3], "rotation": quat(pose[3])}} for pose in WALK]
    assert actions_of(run_of(dataset, "log.json", json.dumps(states))) == ACTIONS
    wxyz = [{"position": pose[:3], "rotation": [quat(pose[3])[i] for i in (3, 0, 1, 2)]} for pose in WALK]
    episode = {"episodes": [{"split": "easy", "scene_id": "a/Flat.basis.glb", "episode_id": 40, "poses": wxyz}]}
    reading = replace(WORLD, quaternion="wxyz", episode=None)
    assert actions_of(run_of(dataset, "log.json", json.dumps(episode), reading)) == ACTIONS
    named = [{"position": pose[:3], "rotation": dict(zip("xyzw", quat(pose[3]), strict=True))} for pose in WALK]
    assert actions_of(run_of(dataset, "log.json", json.dumps(named), replace(WORLD, quaternion=None))) == ACTIONS


def test_onemaps_rows_are_read_with_declared_columns_and_a_tum_file_needs_no_header(dataset: PersonalDataset) -> None:
    """OneMap writes (-z, -x, y, yaw) per step and no header."""
    rows = "".join(f"{-z},{-x},{y},{math.radians(yaw)}\n" for x, y, z, yaw in WALK)
    reading = replace(WORLD, frame="ros", columns=("x", "y", "z", "yaw"))
    assert actions_of(run_of(dataset, "poses_0.csv", rows, reading)) == ACTIONS
    message = refusal(dataset, "poses_0.csv", rows, replace(reading, columns=()))
    assert "the first row is numbers only" in message
    assert "--columns" in message
    rows = "".join(f"{100.5 + n} {x} {y} {z} 0 {quat(d)[1]} 0 {quat(d)[3]}\n" for n, (x, y, z, d) in enumerate(WALK))
    told = "# episode: easy/Flat/40\n# stopped: yes\n# timestamp tx ty tz qx qy qz qw\n" + rows
    run = run_of(dataset, "log.tum", told, PoseReading("world"))
    assert actions_of(run) == ACTIONS
    assert [step.t_s for step in run.steps] == [1.0, 2.0, 3.0, 3.0]
    assert run_of(dataset, "log.txt", rows) == run


def test_one_file_may_hold_several_episodes(dataset: PersonalDataset) -> None:
    rows = [("easy", "Flat", 40, *pose, 1 if last else 0) for pose, last in zip(WALK, [0, 0, 0, 1], strict=True)]
    rows += [("easy", "Flat", 41, *START, 90.0, 0)]
    reading = replace(WORLD, episode=None, stopped=None)
    found = runs_of(dataset, "log.csv", csv_of("split,scene,episode_id,x,y,z,yaw_deg,stopped", rows), reading)
    assert [(run.key.episode_id, run.end.reason, len(run.steps)) for run in found] == [
        ("40", "stop", 4),
        ("41", "abandoned", 0),
    ]


@pytest.mark.parametrize("name", ["easy-Flat-40.csv", "easy-Flat-40-P03.csv"])
def test_the_file_name_may_give_the_episode(dataset: PersonalDataset, name: str) -> None:
    reading = replace(WORLD, episode=None)
    assert run_of(dataset, name, csv_of(HEAD, WALK), reading).key == KEY
    assert "--episode SPLIT/SCENE/ID" in refusal(dataset, "log.csv", csv_of(HEAD, WALK), reading)


def test_camera_poses_give_the_tilt_and_the_actions_that_look_up_and_down(dataset: PersonalDataset) -> None:
    rows = []
    for yaw, tilt in ((0, 0), (0, 30), (30, 30), (30, 0)):
        (y, x), cos, sin = np.radians([yaw, tilt]) / 2, math.cos, math.sin  # q_yaw * q_tilt
        quaternion = [cos(y) * sin(x), sin(y) * cos(x), -sin(y) * sin(x), cos(y) * cos(x)]
        rows.append([1.0, 0.2 + 0.88, -2.0, *quaternion])
    log, reading = json.dumps(rows), replace(WORLD, poses="camera", camera_axes="opengl")
    run = run_of(dataset, "log.json", log, reading)
    assert actions_of(run) == ["look_up", "left", "look_down", "stop"]
    assert [math.degrees(step.tilt) for step in run.steps] == pytest.approx([30, 30, 0, 0], abs=1e-6)
    assert run.steps[0].position == pytest.approx(START)
    for axes, message in (
        (None, "camera's axes are not declared"),
        ("opencv", "camera is tilted by 180.0 degrees at the"),
    ):
        assert message in refusal(dataset, "log.json", log, replace(reading, camera_axes=axes))
    assert "a turn about the up axis only" in refusal(dataset, "log.json", json.dumps(rows[1:]), WORLD)


def test_turns_of_five_degrees_are_refused_with_the_option_for_free_motion(dataset: PersonalDataset) -> None:
    rows = [(*START, 0.0), (*START, 5.0), (1.0, 0.2, -2.1, 10.0), (1.0, 0.2, -2.1, 10.0)]
    message = refusal(dataset, "log.csv", csv_of(HEAD, rows))
    assert "log.csv:3: moved 0.000 m, turned 5.0 and tilted 0.0 degrees" in message
    assert "--motion free" in message
    free = replace(WORLD, free=FreeMotion(max_move=0.15, max_turn_deg=9))
    run = run_of(dataset, "log.csv", csv_of(HEAD, rows), free)
    assert (run.start.motion, actions_of(run)) == ("free", ["left", "forward", "stop"])
    assert not any(step.collided for step in run.steps)
    slow = replace(WORLD, free=FreeMotion(max_move=0.05, max_turn_deg=9))
    assert "log.csv:4: moved 0.100 m and turned 5.0 degrees; expected at most 0.05 m" in refusal(
        dataset, "log.csv", csv_of(HEAD, rows), slow
    )
    short = replace(WORLD, free=FreeMotion(max_move=0.15, max_turn_deg=9, max_steps=2))
    assert "found step 3; expected at most 2" in refusal(dataset, "log.csv", csv_of(HEAD, rows), short)


def test_rounded_positions_must_be_declared_and_unknown_columns_are_left_out(dataset: PersonalDataset) -> None:
    rows = [*WALK[:2], (1.0, 0.2, -2.505, 0)]
    assert "expected 0 to 0.25 m straight ahead" in refusal(dataset, "log.csv", csv_of(HEAD, rows))
    assert len(run_of(dataset, "log.csv", csv_of(HEAD, rows), replace(WORLD, rounding=0.01)).steps) == 3
    path = dataset.root.parent / "log.csv"
    path.write_text(csv_of(HEAD + ",reward", [(*pose, 1) for pose in WALK]))
    (checked,) = check_file(path, dataset=dataset, reading=WORLD)
    assert checked.ignored == ("reward",)


def bomb(**shapes: Any) -> bytes:
    """A .npz whose arrays announce more data than they hold."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, shape in shapes.items():
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
            archive.writestr(f"{name}.npy", header.getvalue() + b"\0" * 240)
    return stream.getvalue()


def acted(*actions: Any) -> str:
    """A CSV of the first poses of the walk, each with its action."""
    return csv_of(HEAD + ",action", [(*pose, action) for pose, action in zip(WALK, actions, strict=False)])


HOSTILE: dict[str, tuple[str, str | bytes, str]] = {
    "not a number": ("log.csv", csv_of(HEAD, [WALK[0], (1, "nan", -2.25, 0)]),
        "log.csv:3: y is 'nan'; expected a finite"),
    "an infinity": ("log.csv", csv_of(HEAD, [WALK[0], (1, "inf", -2.25, 0)]),
        "log.csv:3: y is 'inf'; expected a finite"),
    "a ragged row": ("log.csv", csv_of(HEAD, [WALK[0], (1, 2, 3)]), "log.csv:3: found 3 cells; expected 4"),
    "an empty cell": ("log.csv", csv_of(HEAD, [WALK[0], (1, "", 3, 0)]), "log.csv:3: y is missing"),
    "decimal commas": ("log.csv", "x;y;z;yaw\n1,0;0,2;-2,0;0\n", "log.csv:2: x is '1,0'; expected a finite number"),
    "no row at all": ("log.csv", "# nothing\n\n", "log.csv: found no row"),
    "a header only": ("log.csv", HEAD + "\n", "log.csv: found no row below its header"),
    "no known column": ("log.csv", "a,b\n1,2\n", "none of which is known"),
    "no rotation": ("log.csv", csv_of("x,y,z,speed", WALK), "log.csv:2: found columns x, y, z; expected a quaternion"),
    "no height in y-up": ("log.csv", csv_of("x,y,foo,yaw_deg", WALK), "expected x,y,z, or in 2-D x,z in frame world"),
    "two rotations": ("log.csv", csv_of("x,y,z,yaw_deg,yaw", [(*p, 0) for p in WALK]), "found rotations twice"),
    "a column twice": ("log.csv", csv_of("x,y,z,yaw,x", [(*p, 0) for p in WALK]), "gives x a second time"),
    "an unknown action": ("log.csv", acted("", "fly"), ":3: action is 'fly'"),
    "action 6": ("log.csv", acted("", 6), ":3: action is '6'; expected 0-5"),
    "a hole in actions": ("log.csv", acted("", 1, "", 1), "found no action"),
    "a wrong action": ("log.csv", acted("", "left"), ":3: action 'left' changed yaw by 0.0"),
    "a move too far": ("log.csv", csv_of(HEAD, [*WALK[:2], (1.0, 0.2, -2.65, 0)]),
        ":4: action 'forward' ended 0.400 m ahead"),
    "another start": ("log.csv", csv_of(HEAD, WALK[1:]), "log.csv:2: episode easy/Flat/40 begins 0.250 m"),
    "time that runs back": ("log.csv", csv_of(HEAD + ",t_s", [(*WALK[0], 1), (*WALK[1], 0.5)]),
        ":3: t_s is 0.500, before"),
    "an unclosed quote": ("log.csv", HEAD + '\n1,"2,3,4\n', "log.csv:2: found 2 cells; expected 4"),
    "NUL bytes": ("log.csv", b"x,y\0,z\n", "log.csv: holds NUL characters"),
    "no UTF-8": ("log.csv", b"x,y,z\n\xff\xfe", "log.csv: is not UTF-8 text"),
    "no JSON": ("log.json", "{", "log.json: is not JSON"),
    "a deep JSON": ("log.json", "[" * 200_000, "log.json: is not JSON"),
    "a number as JSON": ("log.json", "3", "log.json: found 3; expected a list of records"),
    "NaN in JSON": ("log.json", "[[1, NaN, 3, 0, 0, 0, 1]]", "log.json[0]: y is nan; expected a finite"),
    "text in JSON": ("log.json", '[[1, "a", 3, 0, 0, 0, 1]]', "log.json[0]: y is 'a'; expected a finite"),
    "a ragged JSON": ("log.json", "[[1, 2, 3, 0, 0, 0, 1], [1, 2]]", "log.json[1]: pose has 2 numbers; expected 7"),
    "a ragged array": ("log.json", '{"positions": [[1, 2, 3], [1, 2]], "yaw": [0, 0]}',
        "positions[1]: gives p0, p1, yaw; expected x, y, z, yaw as in the first"),
    "lists of other lengths": ("log.json", '{"positions": [[1, 2, 3]], "yaw": [0, 0]}', "yaw: has 2 rows; expected 1"),
    "an empty list": ("log.json", "[]", "is an empty list"),
    "episodes that are none": ("log.json", '{"episodes": [7]}', "log.json: episodes[0] is 7"),
    "a long quaternion": ("log.json", "[[1, 0.2, -2, 0, 0, 0, 2]]", "has length 2.0000; expected 1"),
    "no quaternion at all": ("log.json", "[[1, 0.2, -2, 0, 0, 0, 0]]", "has length 0.0000; expected 1"),
    "a roll": ("log.json", f"[[1, 0.2, -2, 0, 0, {math.sin(0.1)}, {math.cos(0.1)}]]", "rolled by 11.5 degrees"),
    "no archive": ("log.npz", b"PK nothing", "log.npz: is not an .npz file"),
    "pickled arrays": ("log.npz", npz_of(positions=np.array([{"a": 1}], object)),
        "it is pickled; expected plain numbers"),
    "10^8 rows announced": ("log.npz", bomb(positions=(10**8, 3), yaw=(10**8,)),
        "announces (100000000, 3) x 8 bytes and holds 240"),
    "negative rows": ("log.npz", bomb(positions=(-1, 3)), "log.npz: positions.npy"),
    "a shear": ("log.npz", npz_of(poses=np.full((2, 4, 4), 0.5)),
        "log.npz: poses[0]: the matrix is not a rigid transform"),
    "a flat array": ("log.npz", npz_of(positions=np.zeros(6), yaw=np.zeros(6)),
        "positions[0] is 0.0; expected a list of numbers"),
    "other lengths": ("log.npz", npz_of(positions=np.zeros((3, 3)), yaw=np.zeros(2)), "yaw: has 2 rows; expected 3"),
    "nothing known": ("log.npz", npz_of(a=np.zeros(2)), "log.npz: found ['a']; expected arrays positions"),
    "NaN in an array": ("log.npz", npz_of(positions=[[1, np.nan, 3]], yaw=[0.0]), "positions[0]: y is nan"),
    "no pose at all": ("log.npz", npz_of(positions=np.zeros((0, 3)), yaw=np.zeros(0)), "log.npz: found no pose"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "content", "message"), HOSTILE.values(), ids=HOSTILE)
def test_a_damaged_file_is_refused_in_one_clear_line(
    dataset: PersonalDataset, name: str, content: str | bytes, message: str
) -> None:
    assert message in refusal(dataset, name, content)


def test_a_huge_file_is_refused_in_one_clear_line(dataset: PersonalDataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pose_tables, "MAX_BYTES", 1 << 20)
    for name in ("log.csv", "log.json", "log.npz"):
        assert "is larger than 1 MiB; expected pose files up to that" in refusal(dataset, name, b"1" * ((1 << 20) + 1))
