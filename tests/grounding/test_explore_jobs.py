"""Stored explorations: when one is read again, and when it is refused."""

from pathlib import Path

import pytest

from grounding.agents import exploration_jobs as jobs
from grounding.agents.exploration import load_exploration, save_exploration
from grounding.agents.exploration_jobs import ExploreJob, run_job
from sim.errors import RunFileError
from sim.types import Camera

from .two_rooms import two_room_scene, two_rooms


@pytest.fixture(autouse=True)
def only_two_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes every home without a dataset the two-room one."""
    monkeypatch.setattr(jobs, "invented_home", lambda name: (two_room_scene(), two_rooms()))


def job(out: Path, max_steps: int, *, seed: int = 0) -> ExploreJob:
    return ExploreJob(
        "TwoRooms", seed=seed, max_steps=max_steps, camera=Camera(48, 36), storeys="start", out=out, dataset_root=None
    )


def test_a_stored_exploration_is_read_and_not_made_again(tmp_path: Path) -> None:
    made = run_job(job(tmp_path, 12))
    (path,) = tmp_path.glob("*.json")
    written = path.stat().st_mtime_ns
    assert len(made[0].steps) == 12
    assert run_job(job(tmp_path, 12)) == made
    assert path.stat().st_mtime_ns == written
    with pytest.raises(RunFileError, match="expected seed 1"):
        run_job(job(tmp_path, 12, seed=1))


def test_an_exploration_whose_steps_ran_out_is_refused_for_more_or_fewer_steps(tmp_path: Path) -> None:
    run_job(job(tmp_path, 12))
    with pytest.raises(
        RunFileError, match=r"12 steps \(stopped: steps\).*2500 steps or fewer where exploring ended by itself"
    ):
        run_job(job(tmp_path, 2500))
    run_job(job(tmp_path, 12))
    with pytest.raises(RunFileError, match=r"12 steps \(stopped: steps\).* 11 steps or fewer"):
        run_job(job(tmp_path, 11))


def test_an_exploration_that_ended_by_itself_also_serves_for_more_steps(tmp_path: Path) -> None:
    run_job(job(tmp_path, 12))
    (path,) = tmp_path.glob("*.json")
    ended = load_exploration(path).model_copy(update={"stop_reason": "no-frontier"})
    save_exploration(path, ended)
    assert run_job(job(tmp_path, 2500)) == (ended,)
    assert run_job(job(tmp_path, 12)) == (ended,)
    with pytest.raises(RunFileError, match=r"12 steps \(stopped: no-frontier\)"):
        run_job(job(tmp_path, 11))
