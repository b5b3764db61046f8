"""The benchmark's conclusions from a study's records: which keys are lost, and which people resumed elsewhere."""

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from human_study.store.store import StudyStore, Trial
from human_study.trial.events import Act, Event, Key
from personal_viz.bench.harness import held_by
from personal_viz.bench.study.crew import resumed_elsewhere
from personal_viz.bots.records import BotLog, Press, count_bots, missing_steps
from sim.errors import StudyError
from sim.types import Action
from tests.human_study.stores import edit, opened


def log_of(*marks: float) -> BotLog:
    """The log of a bot that has sent these keys."""
    return BotLog("p02", "random", presses=[Press(0.0, mark) for mark in marks])


def key(mark: float | None) -> Key:
    return Key(t_s=1.0, t_cli_ms=mark, code="KeyW", action=Action.FORWARD)


def step(number: int) -> Act:
    return Act(t_s=1.0, action=Action.FORWARD, position=(0.0, 0.0, -0.25 * number), yaw=0.0)


@contextmanager
def stored(folder: Path, *events: Event) -> Iterator[tuple[StudyStore, Trial]]:
    """p02's first trial with these events after its first event."""
    with opened(folder) as (store, trial):
        store.append_many(trial.trial_id, trial.epoch, events)
        yield store, trial


def test_a_counted_step_that_is_not_stored_is_missing(tmp_path: Path) -> None:
    log = log_of(1.0, 2.0)
    log.step_counted = 2
    with stored(tmp_path, key(1.0), step(1)) as (store, trial):
        assert missing_steps(tmp_path, [log]) == ("p02: step 2 was counted, 1 are stored",)
        assert count_bots(tmp_path, [log]).lost[0] == "p02: step 2 was counted, 1 are stored"
        store.append_many(trial.trial_id, trial.epoch, (key(2.0), step(2)))
        assert missing_steps(tmp_path, [log]) == ()


def test_a_damaged_chain_is_found_with_the_steps(tmp_path: Path) -> None:
    with stored(tmp_path, key(1.0), step(1)):
        pass
    edit(tmp_path, "DELETE FROM event WHERE seq = 2")
    with pytest.raises(StudyError):
        missing_steps(tmp_path, [log_of(1.0)])


def test_a_bot_that_resumes_at_another_step_is_found(tmp_path: Path) -> None:
    with stored(tmp_path, key(1.0), step(1), key(2.0), step(2), key(3.0), step(3)):
        pass
    log = log_of(1.0, 2.0, 3.0)
    log.resumed = [(1, 1), (1, 2), (3, 3)]  # before the second key; wrong before the third; no key after the last
    assert resumed_elsewhere(tmp_path, [log]) == (2, ("p02: shown step 1, stored 2",))


def test_files_threads_and_connections_of_a_server_are_counted() -> None:
    before = held_by(os.getpid())
    assert before["rss_mb"] > 10
    assert before["peak_mb"] >= before["rss_mb"] - 1
    ended = threading.Event()
    waiting = threading.Thread(target=ended.wait)
    with open(os.devnull) as one, open(os.devnull) as two:
        waiting.start()
        held = held_by(os.getpid())
        assert held["fds"] >= before["fds"] + 2 > one.fileno() - two.fileno()
        assert held["threads"] >= before["threads"] + 1
        ended.set()
        waiting.join()


def test_connections_of_workers_are_counted() -> None:
    program = "import socket, sys; one = socket.create_connection(('127.0.0.1', int(sys.argv[1]))); print(flush=True)"
    with socket.create_server(("127.0.0.1", 0)) as server:
        worker = subprocess.Popen(
            [sys.executable, "-c", program + "; input()", str(server.getsockname()[1])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        try:
            connection, _ = server.accept()
            worker.stdout.readline()
            held = held_by(os.getpid())
            assert held["processes"] >= 2
            assert held["clients"] == 1
            connection.close()
        finally:
            worker.communicate(b"\n")
