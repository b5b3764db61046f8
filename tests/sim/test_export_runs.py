"""Runs in other formats: equal when read back, laid out as Minari does, never half-written."""

import json
import math
from pathlib import Path

import numpy as np
import pyarrow.dataset
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.errors import RunFileError
from sim.exchange import export_runs as exports
from sim.exchange.export_runs import export_runs
from sim.exchange.import_runs import check_file
from sim.exchange.pose_files import PoseReading
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, EpisodeStart, RuleMeasures, Run, RunInfo, Step, read_run
from sim.types import Action, Pose

from .foreign_runs import two_starts
from .worlds import measured, run_info

START = Pose((1.0, 0.2, -2.0), math.radians(90))
WORLD = PoseReading("world")


def info(**changes: object) -> RunInfo:
    """`run.json` of a run."""
    return run_info("my.run", **{"who": "VLFM", "seed": 3} | changes)


def episode_run(
    *, episode_id: str = "40", participant: str | None = None, timed: bool = True, stops: bool = True
) -> EpisodeRun:
    """Forward, right, a blocked forward, and STOP: SPL 0.8 under `paper`."""
    x, y, z = START.position
    moves = [("forward", 90, False), ("right", 60, False), ("forward", 60, True), ("stop", 60, False)]
    place = {"position": (x - 0.25, y, z)}
    steps = tuple(
        Step(action=Action(name), **place, yaw=math.radians(yaw), collided=hit, t_s=0.7 * number if timed else 0.0)
        for number, (name, yaw, hit) in enumerate(moves[: 4 if stops else 3], start=1)
    )
    rule = RuleMeasures(success=stops, spl=0.8 * stops, soft_spl=0.8, dtg=0.0 if stops else None, start_distance=0.2)
    measures = measured(rule, path_m=0.25, num_steps=len(steps), collisions=1)
    names = {"split": "easy", "scene": "Flat", "episode_id": episode_id, "participant": participant}
    start = EpisodeStart(**names, position=START.position, yaw=START.yaw)
    return EpisodeRun(start=start, steps=steps, end=EpisodeEnd(reason="stop" if stops else "giveup", measures=measures))


ANSWER = Answer(split="hard", scene="Flat", episode_id="9", candidates=((1.0, 0.0, 2.0),), scores=(0.5,))
BOTH = Run(info=info(), episodes=(episode_run(), episode_run(episode_id="41", stops=False)), answers=(ANSWER,))


@pytest.fixture
def dataset(tmp_path: Path) -> PersonalDataset:
    """Two episodes that start at START; ids 40 and 41."""
    return two_starts(tmp_path / "data", START.position, yaws_deg=(90, 90))


def test_a_run_folder_is_equal_when_read_back(tmp_path: Path) -> None:
    (written,) = export_runs([BOTH], format="jsonl", out=tmp_path)
    assert written.folder == tmp_path / "my.run"
    assert read_run(written.folder) == BOTH
    assert (written.num_episodes, written.num_answers, written.num_left_out) == (2, 1, 0)


def test_parts_of_one_run_are_merged(tmp_path: Path) -> None:
    parts = [Run(info=BOTH.info, episodes=(episode,)) for episode in BOTH.episodes]
    export_runs([*parts, parts[0], Run(info=BOTH.info, answers=(ANSWER,))], format="jsonl", out=tmp_path)
    assert read_run(tmp_path / "my.run") == BOTH


def test_two_runs_of_one_name_are_refused(tmp_path: Path) -> None:
    other = Run(info=info(seed=4), episodes=BOTH.episodes)
    with pytest.raises(RunFileError, match=r"my\.run: two runs of this name have different run\.json"):
        export_runs([BOTH, other], format="tum", out=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("format", ["jsonl", "tum", "minari"])
def test_a_folder_that_exists_is_never_touched(tmp_path: Path, format: str) -> None:
    export_runs([BOTH], format=format, out=tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(RunFileError, match="exists already; expected a new folder"):
        export_runs([BOTH], format=format, out=tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_disk_that_fails_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: str) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(exports, "write_whole", full)
    with pytest.raises(RunFileError, match=r"my\.run: cannot be written \(.*No space left"):
        export_runs([BOTH], format="tum", out=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_answers_are_left_out_of_formats_that_hold_trajectories(tmp_path: Path) -> None:
    for format in ("tum", "minari"):
        (written,) = export_runs([BOTH], format=format, out=tmp_path / format)
        assert (written.num_episodes, written.num_left_out) == (2, 1)
        with pytest.raises(RunFileError, match=r"my\.run: found no episode with poses.*--format jsonl only"):
            export_runs([Run(info=info(), answers=(ANSWER,))], format=format, out=tmp_path / "no")


def test_a_tum_file_is_imported_as_the_same_run(tmp_path: Path, dataset: PersonalDataset) -> None:
    export_runs([BOTH], format="tum", out=tmp_path / "out")
    files = sorted((tmp_path / "out" / "my.run").iterdir())
    assert [path.name for path in files] == ["easy-Flat-40.tum", "easy-Flat-41.tum"]
    for path, wanted in zip(files, BOTH.episodes, strict=True):
        (checked,) = check_file(path, dataset=dataset, reading=WORLD)
        assert [step.model_copy(update={"yaw": 0}) for step in checked.run.steps] == [
            step.model_copy(update={"yaw": 0}) for step in wanted.steps
        ]
        assert [pose.yaw for pose in checked.run.poses] == pytest.approx([p.yaw for p in wanted.poses], abs=1e-12)


def test_a_tum_row_is_time_position_and_quaternion(tmp_path: Path) -> None:
    timed, untimed = (
        exports.tum_text(episode_run(timed=timed), info().model_copy(update={"who": "a\nb"})) for timed in (True, False)
    )
    assert "# PersONAL run of a b: pose" in timed
    assert "# timestamp tx ty tz qx qy qz qw" in timed
    rows = np.loadtxt(timed.splitlines())
    assert rows.shape == (5, 8)
    assert rows[:, 0] == pytest.approx([0, 0.7, 1.4, 2.1, 2.8])
    half = math.sqrt(0.5)
    assert rows[0, 1:] == pytest.approx([1.0, 0.2, -2.0, 0, half, 0, half])
    assert "# step tx ty tz qx qy qz qw" in untimed
    assert np.loadtxt(untimed.splitlines())[:, 0].tolist() == [0, 1, 2, 3, 4]


def test_participants_of_one_episode_get_separate_files_inside_the_folder(tmp_path: Path) -> None:
    people = ("P1", "../P/2", None, "P1")
    run = Run(info=info(), episodes=tuple(episode_run(participant=person) for person in people))
    exports.write_tum_files(run, tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == [
        "easy-Flat-40-P1-2.tum",
        "easy-Flat-40-P1.tum",
        "easy-Flat-40-___P_2.tum",
        "easy-Flat-40.tum",
    ]


def test_a_minari_folder_has_the_layout_of_minari(tmp_path: Path) -> None:
    """The layout is that of Minari 0.5.0 to 0.5.4; the test reads it the way Minari's ArrowStorage does."""
    (written,) = export_runs([BOTH], format="minari", out=tmp_path)
    assert written.folder == tmp_path / "personal" / "my-run-v0"
    data = written.folder / "data"
    metadata = json.loads((data / "metadata.json").read_text())
    assert (metadata["total_episodes"], metadata["total_steps"]) == (2, 7)
    assert (metadata["data_format"], metadata["dataset_id"], metadata["minari_version"]) == (
        "arrow",
        "personal/my-run-v0",
        "0.5.0",
    )
    assert json.loads(metadata["action_space"]) == {"type": "Discrete", "dtype": "int64", "start": 0, "n": 6}
    spaces = json.loads(metadata["observation_space"])["subspaces"]
    assert {name: (box["type"], box["dtype"], box["shape"]) for name, box in spaces.items()} == {
        "gps": ("Box", "float64", [2]),
        "compass": ("Box", "float64", [1]),
        "position": ("Box", "float64", [3]),
        "yaw": ("Box", "float64", [1]),
        "tilt": ("Box", "float64", [1]),
    }
    parts = [
        pyarrow.dataset.dataset(f"{data}/{index}", format="arrow", ignore_prefixes=["_", ".", "metadata.json"])
        for index in range(2)
    ]
    first, second = pyarrow.dataset.dataset(parts).to_batches()
    assert first["actions"].to_pylist()[:-1] == [1, 3, 1, 0]
    assert first["rewards"].to_pylist() == [0, 0, 0, 1, 0]
    assert first["terminations"].to_pylist() == [False, False, False, True, False]
    assert not any(first["truncations"].to_pylist())
    observations = first["observations"]
    assert np.array(observations.field("gps").to_pylist()) == pytest.approx(np.array([[0, 0], *[[0.25, 0]] * 4]))
    assert np.degrees(observations.field("compass").to_pylist()).ravel() == pytest.approx([0, 0, -30, -30, -30])
    assert observations.field("position").to_pylist()[1] == [0.75, 0.2, -2.0]
    infos = {field.name: first["infos"].field(field.name).to_pylist() for field in first["infos"].type}
    assert infos["collided"] == [False, False, False, True, False]
    assert infos["t_s"] == pytest.approx([0, 0.7, 1.4, 2.1, 2.8])
    assert (infos["who"][0], infos["episode_id"][4], infos["success"][2], infos["spl"][0]) == ("VLFM", "40", 1.0, 0.8)
    assert second["truncations"].to_pylist() == [False, False, True, False]
    assert second["rewards"].to_pylist() == [0, 0, 0, 0]
    assert math.isnan(second["infos"].field("dtg").to_pylist()[0])
    about = json.loads((data / "1" / "metadata.json").read_text())
    assert (about["id"], about["total_steps"], about["seed"], about["episode"]["episode_id"]) == (1, 3, 3, "41")
    assert EpisodeEnd.model_validate_json(json.dumps(about["end"]), strict=True) == BOTH.episodes[1].end


def test_the_installed_minari_opens_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minari = pytest.importorskip("minari", reason="Minari is not installed (pip install minari)")
    export_runs([BOTH], format="minari", out=tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    found = minari.load_dataset("personal/my-run-v0")
    episodes = list(found.iterate_episodes())
    assert [episode.actions.tolist() for episode in episodes] == [[1, 3, 1, 0], [1, 3, 1]]
    assert [bool(episode.terminations[-1]) for episode in episodes] == [True, False]
    assert [episode.rewards.sum() for episode in episodes] == [1.0, 0.0]
    assert episodes[0].observations["position"].shape == (5, 3)
