"""Importing runs of another simulator: only possible steps are accepted, and all measures are computed here."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recordings.habitat_writer import RunWriter as HabitatWriter
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError, RunFileError
from sim.exchange.import_runs import check_file, import_runs
from sim.frames import forward_from_yaw
from sim.tasks.run_files import EpisodeRun, RuleMeasures

from .foreign_runs import Rows, quat, two_starts
from .worlds import measured

START = (1.0, 0.2, -2.0)


@pytest.fixture
def dataset(tmp_path: Path) -> PersonalDataset:
    """Two episodes that start at START looking along -z and along -x; ids 40 and 41."""
    return two_starts(tmp_path / "data", START, yaws_deg=(0, 90))


def possible_run(writer: HabitatWriter, *, episode_id: str | int = "40", yaw_deg: float = 0.0) -> None:
    """Writes forward, left, look up, a blocked forward and stop."""
    x, y, z = START
    writer.start_episode("easy", "Flat", episode_id, START, quat(yaw_deg))
    if yaw_deg:
        writer.step("stop", START, quat(yaw_deg))
    else:
        writer.step(1, (x, y, z - 0.25), quat(0))
        writer.step(2, (x, y, z - 0.25), quat(30))
        writer.step(4, (x, y, z - 0.25), quat(30))
        writer.step(1, (x - 0.05, y, z - 0.25 - 0.05 * math.sqrt(3)), quat(30))
        writer.step(0, (x - 0.05, y, z - 0.25 - 0.05 * math.sqrt(3)), quat(30))
    writer.end_episode()


@pytest.fixture
def lines(tmp_path: Path) -> Rows:
    """The lines of a possible run of episode 40: start, 5 steps, end."""
    possible_run(HabitatWriter(tmp_path / "good.jsonl"))
    return [json.loads(line) for line in (tmp_path / "good.jsonl").read_text().splitlines()]


def checked(rows: Rows, dataset: PersonalDataset) -> EpisodeRun:
    """The only run of a file with these lines."""
    path = dataset.root.parent / "run.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return next(check_file(path, dataset=dataset)).run


def test_a_possible_run_is_imported_with_our_collisions_and_without_the_files_claims(
    dataset: PersonalDataset, lines: Rows
) -> None:
    run = checked(lines, dataset)
    assert [step.collided for step in run.steps] == [False, False, False, True, False]
    assert [step.action for step in run.steps] == ["forward", "left", "look_up", "forward", "stop"]
    assert run.end.reason == "stop"
    rule = RuleMeasures(success=True, spl=1.0, soft_spl=1.0, dtg=0.0, start_distance=1.0)
    lines[-1]["measures"] = measured(rule, num_steps=len(lines) - 2).model_dump(mode="json")
    lines[2]["collided"] = True
    run = checked(lines, dataset)
    assert run.end.measures is None
    assert run.steps[1].collided is False
    moved(2, (0.15, 0.4, 0.0))(lines)
    assert checked(lines, dataset).steps[0].position == pytest.approx((1.15, 0.6, -2.25))


def moved(line: int, by: tuple[float, float, float]) -> Callable[[Rows], object]:
    """Moves every pose from this line on, so that only this step is wrong."""

    def change(rows: Rows) -> None:
        for row in rows[line - 1 : -1]:
            row["position"] = [old + add for old, add in zip(row["position"], by, strict=True)]

    return change


def put(line: int, **values: Any) -> Callable[[Rows], object]:
    return lambda rows: rows[line - 1].update(values)


def turned(line: int, angle: str, by_deg: float) -> Callable[[Rows], object]:
    """Changes the `yaw` or `tilt` of every pose from this line on."""

    def change(rows: Rows) -> None:
        for row in rows[line - 1 : -1]:
            row[angle] += math.radians(by_deg)

    return change


def repeat_turns(rows: Rows) -> None:
    """501 turns and no STOP."""
    turns = [{**rows[1], "action": "left", "position": START, "yaw": math.radians(30 * n)} for n in range(1, 502)]
    rows[1:-1] = turns
    rows[-1]["reason"] = "steps"


IMPOSSIBLE: dict[str, tuple[Callable[[Rows], object], str]] = {
    "a forward that goes on too far": (moved(5, (-0.14, 0, -0.14 * 3**0.5)), ":5: action 'forward' ended 0.380 m"),
    "a forward backwards": (moved(5, (0.1, 0, 0.1 * 3**0.5)), ":5: action 'forward' ended -0.100 m ahead"),
    "a forward to the side": (moved(5, (0.1, 0, -0.1 / 3**0.5)), ":5: action 'forward' ended"),
    "a forward up a wall": (moved(5, (0, 0.6, 0)), ":5: action 'forward' ended 0.100 m ahead, 0.000 m aside and 0.6"),
    "a first forward far off its line": (moved(2, (0.4, 0, 0)), ":2: action 'forward' ended 0.250 m ahead, 0.400 m"),
    "a first forward from another floor": (moved(2, (0, 0.8, 0)), ":2: action 'forward' ended"),
    "a turn of 31 degrees": (turned(3, "yaw", 1), ":3: action 'left' changed yaw by 31.0 degrees; expected 30"),
    "a turn to the other side": (turned(3, "yaw", -60), ":3: action 'left' changed yaw by -30.0 degrees; expected 30"),
    "a turn that moves": (moved(3, (0.01, 0, 0)), ":3: action 'left' moved the robot 0.010 m; expected no"),
    "a forward that turns": (turned(5, "yaw", 30), ":5: action 'forward' changed yaw by 30.0 degrees; expected 0"),
    "a look of 20 degrees": (turned(4, "tilt", -10), ":4: action 'look_up' changed tilt by 20.0 degrees; expected 30"),
    "a look that moves": (moved(4, (0, 0, 0.02)), ":4: action 'look_up' moved the robot 0.020 m"),
    "a turn that tilts": (turned(3, "tilt", 5), ":3: action 'left' changed tilt by 5.0 degrees; expected 0"),
    "a stop that moves": (moved(6, (0, 0, 0.02)), ":6: action 'stop' moved the robot 0.020 m"),
    "an action after stop": (put(5, action="stop"), ":5: action 'stop' moved the robot"),
    "two stops": (lambda rows: rows.insert(6, dict(rows[5] | {"action": "stop"})), ":7: found action 'stop' after"),
    "501 steps": (repeat_turns, ":502: found step 501; expected at most 500"),
    "a stop that did not happen": (lambda rows: rows.pop(5), ":6: reason is 'stop' after 4 steps"),
    "a limit that was not reached": (put(7, reason="steps"), ":7: reason is 'steps' after 5 steps"),
    "a stop called giving up": (put(7, reason="giveup"), ":7: reason is 'giveup' after 5 steps"),
    "a start that is 2 cm off": (put(1, position=[1.02, 0.2, -2.0]), ":1: episode easy/Flat/40 begins 0.020 m"),
    "a start that is 1 degree off": (put(1, yaw=math.radians(1)), ":1: episode easy/Flat/40 begins 0.000 m and 1.0"),
    "an unknown episode": (put(1, episode_id="99"), ":1: found no episode easy/Flat/99"),
    "an unknown scene": (put(1, scene="Loft"), ":1: scene 'Loft' is not in split 'easy'"),
    "a split without the scene": (put(1, split="hard"), ":1: scene 'Flat' is not in split 'hard'"),
    "a position that is no number": (put(4, position=[math.nan, 0.2, -2.25]), ":4: position.0"),
    "a yaw that is infinite": (put(4, yaw=math.inf), ":4: yaw"),
    "a step before its episode": (lambda rows: rows.pop(0), ":1: kind is 'step'; expected 'episode' here"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "message"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_an_impossible_run_is_refused_with_its_line_number(
    dataset: PersonalDataset, lines: Rows, change: Callable[[Rows], object], message: str
) -> None:
    change(lines)
    with pytest.raises(RunFileError) as error:
        checked(lines, dataset)
    assert f"run.jsonl{message}" in str(error.value)


def test_a_sliding_step_may_end_within_one_step_length_of_the_wanted_end(dataset: PersonalDataset, lines: Rows) -> None:
    moved(5, (-0.1 * math.sqrt(3) + 0.02, 0, 0.1))(lines)
    with pytest.raises(RunFileError, match="allow_sliding=True"):
        checked(lines, dataset)
    lines[0]["allow_sliding"] = True
    assert checked(lines, dataset).steps[3].collided
    moved(5, (0.4, 0, 0))(lines)
    with pytest.raises(RunFileError, match=r"0\.25 m from the wanted end"):
        checked(lines, dataset)


def test_episode_numbers_of_habitat_lab_are_places_in_the_file(dataset: PersonalDataset, tmp_path: Path) -> None:
    path = tmp_path / "lab.jsonl"
    writer = HabitatWriter(path)
    possible_run(writer, episode_id=0)
    possible_run(writer, episode_id=1, yaw_deg=90)
    assert [run.run.key.episode_id for run in check_file(path, dataset=dataset)] == ["40", "41"]


def imported(dataset: PersonalDataset, *files: Path, **changes: Any) -> Path:
    """Imports files into the folder `runs` beside the dataset and returns that folder."""
    options = {"dataset": dataset, "scenes_dir": None, "out": dataset.root.parent / "runs", "who": "VLFM"}
    import_runs([*files], **options | {"allow_schematic": True} | changes)
    return dataset.root.parent / "runs"


def test_nothing_is_written_when_one_of_several_files_is_impossible(
    dataset: PersonalDataset, tmp_path: Path, lines: Rows
) -> None:
    put(3, yaw=1.0)(lines)
    lines[0].update(episode_id="41", yaw=math.radians(90))
    (tmp_path / "bad.jsonl").write_text("".join(json.dumps(row) + "\n" for row in lines))
    with pytest.raises(RunFileError, match=r"bad\.jsonl:2: action 'forward'"):
        imported(dataset, tmp_path / "good.jsonl", tmp_path / "bad.jsonl")
    assert not (tmp_path / "runs").exists()


def test_files_and_options_that_cannot_be_used_are_refused(
    dataset: PersonalDataset, tmp_path: Path, lines: Rows
) -> None:
    good, twice, empty = (tmp_path / f"{name}.jsonl" for name in ("good", "twice", "empty"))
    twice.write_text(good.read_text() * 2)
    empty.touch()
    refused: list[tuple[Path, dict[str, Any], str]] = [
        (twice, {}, r"twice\.jsonl:8: episode easy/Flat/40 comes a second time \(first at .*:1\)"),
        (good, {"allow_schematic": False}, r"only schematic homes.*Give --scenes-dir"),
        (good, {"run_id": "../x"}, r"run_id is '\.\./x'"),
        (empty, {"scenes_dir": tmp_path}, "found no finished episode"),
        (tmp_path / "none.jsonl", {"scenes_dir": tmp_path}, "cannot be read"),
    ]
    for path, options, message in refused:
        with pytest.raises(PersonalVizError, match=message):
            imported(dataset, path, **options)


def test_a_run_through_a_wall_is_refused_at_the_line_where_it_leaves_the_floor(demo_root: Path, tmp_path: Path) -> None:
    dataset = PersonalDataset(demo_root)
    episode = next(dataset.episodes())
    start = episode.start
    rows: Rows = [{"kind": "episode", **episode.key._asdict(), "position": start.position, "yaw": start.yaw}]
    for number in range(1, 61):
        place = np.add(start.position, 0.25 * number * forward_from_yaw(start.yaw)).tolist()
        rows.append({"kind": "step", "action": "forward", "position": place, "yaw": start.yaw})
    rows.append({"kind": "end", "reason": "abandoned"})
    path = tmp_path / "walls.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(RunFileError, match=r"walls\.jsonl:\d+: position .* aside and .* the nearest floor"):
        imported(dataset, path, out=tmp_path / "out", allow_schematic=False)
    assert not (tmp_path / "out").exists()
