"""Runs read back from recordings have equal values, even from files that a crash cut short."""

import subprocess
import sys
from pathlib import Path

import pytest
import rerun as rr
import rerun_cli

from recordings import paths
from recordings.read import log_record_end, log_record_start, log_record_steps, read_recorded, read_rrd
from recordings.replay import log_comparison
from recordings.sinks import open_recording
from sim.episodes.schema import Episode
from sim.errors import RecordingError
from sim.mesh import Scene
from sim.tasks.run_files import ClickRay, Run

from .conftest import KEY, written


@pytest.fixture(scope="module")
def runs(agent_run: Run, human_run: Run, answer_run: Run) -> list[Run]:
    """An agent, a study with two people one of whom also clicked, and a grounder."""
    first = human_run.episodes[0]
    second = first.model_copy(
        update={"start": first.start.model_copy(update={"participant": "P/08 ü"}), "steps": first.steps}
    )
    ray = ClickRay(
        origin=(0.1, 2.0, 1 / 3),
        direction=(0.0, -1.0, 0.0),
        camera_position=(0.1, 2.0, 0.2),
        camera_wxyz=(1.0, 0.0, 0.0, 0.0),
        storey_y=-0.0,
    )
    click = answer_run.answers[0].model_copy(update={"participant": "P07", "ray": ray, "t_s": 1e-7, "scores": ()})
    study = human_run.model_copy(update={"episodes": (first, second), "answers": (click,)})
    return [agent_run, study, answer_run]


@pytest.fixture(scope="module")
def rrd(tmp_path_factory: pytest.TempPathFactory, runs: list[Run], episode: Episode, home: Scene) -> Path:
    """All runs in one recording, without pictures."""
    out = tmp_path_factory.mktemp("rrd") / "all.rrd"
    return log_comparison(runs, episode=episode, scene=home, out=out, renderer=None, with_pixels=False)


def test_runs_and_answers_of_a_comparison_are_equal_when_read_back(rrd: Path, runs: list[Run]) -> None:
    assert read_rrd(rrd) == runs
    assert [run.model_dump_json() for run in read_rrd(rrd)] == [run.model_dump_json() for run in runs]
    assert read_recorded(rrd)[1:] == ((), True, ())


def test_a_run_without_steps_can_be_read_back(tmp_path: Path, agent_run: Run, episode: Episode, home: Scene) -> None:
    run = agent_run.episodes[0]
    end = run.end.model_copy(update={"reason": "giveup", "measures": None})
    left = agent_run.model_copy(update={"episodes": (run.model_copy(update={"steps": (), "end": end}),)})
    out = tmp_path / "a.rrd"
    log_comparison([left], episode=episode, scene=home, out=out, renderer=None, with_pixels=False)
    assert read_rrd(out) == [left]


CRASH = """
import os, sys
from pathlib import Path
import rerun as rr
from recordings import paths
from recordings.read import log_record_end, log_record_start, log_record_steps
from sim.tasks.run_files import read_run

run = read_run(Path(sys.argv[1]))
stream = rr.RecordingStream(paths.APPLICATION_ID, recording_id="live")
stream.save(sys.argv[2])
for label, ends in (("whole", True), ("cut", False)):
    log_record_start(stream, label, run.info, run.episodes[0].start)
    steps = run.episodes[0].steps[: None if ends else 5]
    log_record_steps(stream, label, steps, times=[rr.TimeColumn(paths.STEP, sequence=range(1, len(steps) + 1))])
    if ends:
        log_record_end(stream, label, run.episodes[0].end)
stream.flush()
os._exit(1)
"""


def test_the_complete_runs_of_a_program_that_dies_can_be_read(tmp_path: Path, agent_run: Run) -> None:
    out = tmp_path / "live.rrd"
    command = [sys.executable, "-c", CRASH, str(written(agent_run, tmp_path / "run")), str(out)]
    done = subprocess.run(command, timeout=60, cwd=Path(__file__).parents[2])
    assert done.returncode == 1
    assert read_recorded(out) == ([agent_run], ("/runs/cut",), False, ())


def test_a_file_cut_within_a_message_is_read_up_to_it(tmp_path: Path, rrd: Path, runs: list[Run]) -> None:
    data, cut = rrd.read_bytes(), tmp_path / "cut.rrd"
    held = []
    for share in (0.0, 0.5, 0.8, 0.9, 0.95, 1.0):
        cut.write_bytes(data[: max(12, round(share * len(data)) - 1000)])
        recorded = read_recorded(cut)
        assert not recorded.is_whole
        items = [item for run in recorded.runs for item in (*run.episodes, *run.answers)]
        assert all(item in [i for run in runs for i in (*run.episodes, *run.answers)] for item in items)
        held.append(len(items))
    assert held[0] == 0
    assert held == sorted(held)
    assert held[-1] == 5


def test_runs_of_several_recordings_in_one_file_stay_apart(tmp_path: Path, agent_run: Run) -> None:
    parts = []
    for number in (1, 2):
        with open_recording(tmp_path / f"{number}.rrd", KEY._replace(episode_id=str(number))) as stream:
            logged(stream, agent_run, "same")
        parts.append(str(tmp_path / f"{number}.rrd"))
    program = Path(rerun_cli.__file__).with_name("rerun")
    both = tmp_path / "both.rrd"
    subprocess.run([program, "rrd", "merge", "-o", both, *parts], check=True, capture_output=True, timeout=60)
    (run,) = read_rrd(both)
    assert run.episodes == agent_run.episodes * 2


def test_files_that_are_not_our_recordings_are_refused_in_one_line(tmp_path: Path) -> None:
    text, foreign = tmp_path / "a.rrd", tmp_path / "b.rrd"
    text.write_text("hello, this is text")
    with pytest.raises(RecordingError, match=r"a\.rrd: found bytes b'hell' at its start; expected an \.rrd file"):
        read_rrd(text)
    text.write_bytes(b"")
    with pytest.raises(RecordingError, match="found bytes b''"):
        read_rrd(text)
    with pytest.raises(RecordingError, match=r"none\.rrd: cannot be read"):
        read_rrd(tmp_path / "none.rrd")
    with open_recording(foreign, KEY) as stream:
        stream.log("/runs/a/records", rr.TextLog("no record"))
    with pytest.raises(RecordingError, match=r"b\.rrd: found no run; expected a recording made by personal-viz"):
        read_rrd(foreign)


def test_damaged_lines_are_refused_with_their_run(tmp_path: Path, agent_run: Run) -> None:
    good = {
        name: value.model_dump_json() for name, value in (("info", agent_run.info), ("end", agent_run.episodes[0].end))
    }
    good |= {"start": agent_run.episodes[0].start.model_dump_json()}
    line = agent_run.episodes[0].steps[0].model_dump_json()
    damages = [
        (good, line[:-9], "expected: whole JSON"),
        (good, line.replace("yaw", "jaw"), "yaw is nothing"),
        (good | {"info": "{}"}, line, "run_id is nothing"),
        (good, line, "40 step lines as measures.num_steps says, found 1"),
        ({"start": good["start"], "end": good["end"]}, line, r"found \['end', 'start'\]; expected info and start"),
    ]
    for number, (texts, step, message) in enumerate(damages):
        out = tmp_path / f"{number}.rrd"
        with open_recording(out, KEY) as stream:
            stream.set_time(paths.STEP, sequence=1)
            stream.log("/runs/odd/record/line", rr.AnyValues(line=step))
            for name, text in texts.items():
                place = "/runs/odd/record/end" if name == "end" else "/runs/odd/record"
                stream.log(place, rr.AnyValues(True, **{name: text}), static=True)
        with pytest.raises(RecordingError, match=message) as caught:
            read_rrd(out)
        assert str(caught.value).startswith(f"{out}: /runs/odd/record: ")
        assert "\n" not in str(caught.value)


def test_a_missing_step_is_refused(tmp_path: Path, agent_run: Run) -> None:
    run = agent_run.episodes[0]
    with open_recording(tmp_path / "a.rrd", KEY) as stream:
        log_record_start(stream, "odd", agent_run.info, run.start)
        at = rr.TimeColumn(paths.STEP, sequence=[1, 3])
        log_record_steps(stream, "odd", run.steps[1:3], times=[at])
        log_record_end(stream, "odd", run.end)
    with pytest.raises(RecordingError, match=r"found steps \[1, 3\]; expected 1, 2, 3"):
        read_rrd(tmp_path / "a.rrd")


def logged(stream: rr.RecordingStream, run: Run, label: str, *, num_steps: int | None = None) -> None:
    """Logs the record of the first episode of a run, or only its first `num_steps` steps."""
    episode = run.episodes[0]
    log_record_start(stream, label, run.info, episode.start)
    steps = episode.steps[:num_steps]
    log_record_steps(stream, label, steps, times=[rr.TimeColumn(paths.STEP, sequence=range(1, len(steps) + 1))])
    log_record_end(stream, label, episode.end)
