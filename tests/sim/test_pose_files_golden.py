"""Trajectories of the real Habitat as pose files in every frame and order give the same runs as habitat_writer.py."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.exchange.import_runs import check_file
from sim.exchange.pose_files import PoseReading
from sim.tasks.run_files import EpisodeRun
from sim.types import Action

from .pose_writers import FRAMES, write_csv, write_gps, write_json, write_npz
from .test_import_golden import golden_dataset, golden_episodes, play_golden

pytestmark = pytest.mark.release


@pytest.fixture(scope="module")
def golden(golden_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[PersonalDataset, list[EpisodeRun]]:
    """Dataset of one house and its 33 runs, about 2,300 poses, as the import reads them from JSONL."""
    root = tmp_path_factory.mktemp("golden")
    rows = golden_episodes(golden_root, "dev_a")
    dataset = golden_dataset(rows, "dev_a", root / "data")
    play_golden(rows, "dev_a", root / "habitat.jsonl")
    return dataset, [found.run for found in check_file(root / "habitat.jsonl", dataset=dataset)]


def assert_same(found: list[EpisodeRun], wanted: list[EpisodeRun], *, height: bool = True) -> None:
    """Fails unless the runs are equal except for the last bits of the numbers."""
    assert [run.key for run in found] == [run.key for run in wanted]
    for ours, theirs in zip(found, wanted, strict=True):
        assert [step.action for step in ours.steps] == [step.action for step in theirs.steps]
        assert [step.collided for step in ours.steps] == [step.collided for step in theirs.steps]
        assert (ours.end.reason, ours.start.allow_sliding) == (theirs.end.reason, theirs.start.allow_sliding)
        axes = [0, 1, 2] if height else [0, 2]
        apart = np.subtract([p.position for p in ours.poses], [p.position for p in theirs.poses])[:, axes]
        assert np.abs(apart).max() < 1e-5
        for mine, other in zip(ours.poses, theirs.poses, strict=True):
            assert math.remainder(mine.yaw - other.yaw, 2 * math.pi) == pytest.approx(0, abs=1e-6)
            assert math.remainder(mine.tilt - other.tilt, 2 * math.pi) == pytest.approx(0, abs=1e-6)


def imported(path: Path, dataset: PersonalDataset, reading: PoseReading) -> list[EpisodeRun]:
    return [found.run for found in check_file(path, dataset=dataset, reading=reading)]


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
@pytest.mark.parametrize("frame", FRAMES)
def test_json_with_arrays_gives_the_same_runs(golden, tmp_path: Path, frame: str, order: str) -> None:
    dataset, runs = golden
    path = write_json(tmp_path / "log.json", runs, frame, order=order)
    assert_same(imported(path, dataset, PoseReading(frame=frame, quaternion=order)), runs)


@pytest.mark.parametrize("camera", ["opencv", "opengl", "flu"])
@pytest.mark.parametrize("frame", FRAMES)
def test_camera_poses_without_actions_give_the_same_runs_with_looks_up_and_down(
    golden, tmp_path: Path, frame: str, camera: str
) -> None:
    dataset, runs = golden
    path = write_json(tmp_path / "log.json", runs, frame, order="xyzw", camera=camera, actions=False)
    reading = PoseReading(frame=frame, quaternion="xyzw", poses="camera", camera_axes=camera)
    found = imported(path, dataset, reading)
    assert sum(step.action in (Action.LOOK_UP, Action.LOOK_DOWN) for run in found for step in run.steps) > 10
    assert_same(found, runs)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("frame", FRAMES)
def test_csv_with_named_columns_gives_the_same_run(golden, tmp_path: Path, frame: str, delimiter: str) -> None:
    dataset, runs = golden
    for run in runs[:8]:
        path = write_csv(tmp_path / "log.csv", run, frame, delimiter=delimiter, allow_sliding=run.start.allow_sliding)
        assert_same(imported(path, dataset, PoseReading(frame=frame)), [run])


@pytest.mark.parametrize("frame", FRAMES)
def test_matrices_in_npz_give_the_same_run(golden, tmp_path: Path, frame: str) -> None:
    dataset, runs = golden
    for run in runs[:8]:
        path = write_npz(tmp_path / "log.npz", run, frame)
        assert_same(imported(path, dataset, PoseReading(frame=frame)), [run])


def test_gps_and_compass_give_the_same_run_at_the_height_of_the_start(golden, tmp_path: Path) -> None:
    dataset, runs = golden
    run = next(run for run in runs if not run.start.allow_sliding and len(run.steps) > 50)
    found = imported(write_gps(tmp_path / "log.json", run), dataset, PoseReading(frame="gps"))
    assert {step.position[1] for step in found[0].steps} == {run.start.position[1]}
    assert_same(found, [run], height=False)


def test_a_wrong_frame_is_refused_and_never_gives_another_run(golden, tmp_path: Path) -> None:
    dataset, runs = golden
    run = replace_sliding(runs)[0]
    for wrote in FRAMES:
        path = write_json(tmp_path / "log.json", [run], wrote, order="xyzw")
        for read in FRAMES:
            if read == wrote:
                continue
            reading = replace(PoseReading(frame=read), quaternion="xyzw")
            with pytest.raises(Exception, match=r"log\.json.*(begins|tilted)"):
                imported(path, dataset, reading)


def replace_sliding(runs: list[EpisodeRun]) -> list[EpisodeRun]:
    """The runs without sliding, which are checked most strictly."""
    return [run for run in runs if not run.start.allow_sliding]
