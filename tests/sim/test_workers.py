"""Worker processes: any number of them gives the same results in the same order, and no finished result is lost."""

import os
import select
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from sim.errors import AgentError, PersonalVizError
from sim.tasks.workers import SceneJob, results, without
from sim.types import EpisodeKey

BATCH = 3
ROOT = Path(__file__).resolve().parents[2]


def job(scene: str, *, episodes: int) -> SceneJob:
    """A scene with this many episodes."""
    return SceneJob(Path("nowhere"), scene, tuple(EpisodeKey("easy", scene, str(i)) for i in range(episodes)))


def open_names(job: SceneJob) -> Callable[[EpisodeKey], tuple[str, int]]:
    """Gives the name of each episode, and how many episodes the opened scene has done so far."""
    done: list[EpisodeKey] = []

    def name(key: EpisodeKey) -> tuple[str, int]:
        if key == ("easy", "B", "4"):
            raise AgentError("B/4: no.")
        if key == ("easy", "C", "1"):
            os._exit(9)
        done.append(key)
        return str(key), len(done)

    return name


def collect(jobs: list[SceneJob], into: list[str], *, processes: int) -> None:
    """Appends the names to `into` as they come."""
    for name, _ in results(open_names, jobs, processes=processes, batch=BATCH):
        into.append(name)


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_the_order_of_the_jobs(processes: int) -> None:
    jobs = [job("A", episodes=7), job("Empty", episodes=0), job("D", episodes=4)]
    found = list(results(open_names, jobs, processes=processes, batch=BATCH))
    assert [name for name, _ in found] == [str(key) for job in jobs for key in job.keys]


def test_a_worker_opens_a_scene_once_for_several_batches_and_finished_episodes_are_left_out() -> None:
    (only,) = [job("A", episodes=7)]
    found = [count for _, count in results(open_names, [only], processes=2, batch=1)]
    assert max(found) > 1  # seven batches on two processes: one process did at least four on one opened scene
    (left,) = without([job("A", episodes=3)], {EpisodeKey("easy", "A", "1")})
    assert [key.episode_id for key in left.keys] == ["0", "2"]


@pytest.mark.parametrize("processes", [1, 2])
def test_results_finished_before_an_error_are_handed_over(processes: int) -> None:
    handed_over: list[str] = []
    with pytest.raises(AgentError, match="B/4: no"):
        collect([job("A", episodes=2), job("B", episodes=9)], handed_over, processes=processes)
    assert handed_over == ["easy/A/0", "easy/A/1", "easy/B/0", "easy/B/1", "easy/B/2", "easy/B/3"]


def test_a_worker_that_is_ended_from_outside_gives_a_one_line_error() -> None:
    handed_over: list[str] = []
    with pytest.raises(PersonalVizError, match=r"--jobs 2: a worker process was ended from outside.*fewer --jobs"):
        collect([job("A", episodes=3), job("C", episodes=3)], handed_over, processes=2)
    assert set(handed_over) <= {"easy/A/0", "easy/A/1", "easy/A/2"}


def open_forever(job: SceneJob) -> Callable[[EpisodeKey], int]:
    """Gives the process id for the first episode, then never ends."""

    def pid(key: EpisodeKey) -> int:
        if key.episode_id != "0":
            threading.Event().wait()
        return os.getpid()

    return pid


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="waits for a process by its Linux handle")
def test_worker_processes_end_when_the_program_is_killed() -> None:
    program = (
        "from tests.sim.test_workers import job, open_forever\n"
        "from sim.tasks.workers import results\n"
        "if __name__ == '__main__':\n"
        "    for pid in results(open_forever, [job('A', episodes=3)], processes=2, batch=1):\n"
        "        print(pid, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        handle = os.pidfd_open(worker)
        parent.kill()
    has_ended, _, _ = select.select([handle], [], [], 20.0)
    os.close(handle)
    assert has_ended
