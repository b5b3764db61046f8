"""`study serve` as a program: what it prints and refuses, and that SIGTERM leaves nothing running."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed

from human_study.events import Act
from human_study.records import read_study
from human_study.store import StudyStore, open_store
from personal_viz.commands.serve_study import ended_by_sigterm, listen, serve_study, shown_live
from personal_viz.gateway_options import ServeOptions
from sim.episodes.generation import invent_dataset
from sim.errors import StudyError
from tests.human_study.small_world import plan, study

from .gateways import KEY
from .wire import enter


@contextmanager
def served(folder: Path, *more: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A served home with two workers, and what it has printed; its standard error is in `errors.txt`."""
    command = [sys.executable, "-m", "personal_viz", "study", "serve", "--dataset", str(folder / "data")]
    command += ["--scene", "Small", "--out", str(folder / "study"), "--port", "0", "--workers", "2", *more]
    with (folder / "errors.txt").open("w") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, preexec_fn=hear_ctrl_c)
    try:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            lines.append(line)
            if "Everything is written to" in line:
                break
        yield process, lines
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def hear_ctrl_c() -> None:
    """Signals as at a terminal, also where the test's own shell ignores them."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    return [int(child) for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()]


def is_running(pid: int) -> bool:
    """Whether the process is there."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
def test_sigterm_ends_gateway_and_workers_with_people_online(tmp_path: Path) -> None:
    invent_dataset(tmp_path / "data", name="Small", seed=3)
    with served(tmp_path) as (process, lines):
        links = [re.fullmatch(r"  (PAN|POG)  (p\d\d)  (http://127\.0\.0\.1:\d+/#[\w-]{22})\n", line) for line in lines]
        found = {link.group(1): link.group(3) for link in links if link is not None}
        assert set(found) == {"PAN", "POG"}
        assert lines[-1] == f"Everything is written to {tmp_path / 'study'}. Ctrl-C ends the study.\n"
        workers = children(process.pid)
        assert len(workers) == 2
        with enter(found["PAN"]) as client:
            client.receive_until(lambda message: "Gui" in message["type"])
            process.send_signal(signal.SIGTERM)
            rest, _ = process.communicate(timeout=60)
        assert process.returncode == 0
        assert rest.startswith(f"Stopped. Everything is in {tmp_path / 'study'}")
        assert not any(is_running(worker) for worker in workers)
    errors = (tmp_path / "errors.txt").read_text()
    assert "127.0.0.1" not in errors
    assert not any(link.partition("#")[2] in errors for link in found.values())


def stored_steps(folder: Path) -> int:
    """Steps that are stored of everybody; the hash chains are whole."""
    with read_study(folder) as reader:
        reader.check()
        trials = [trial.trial_id for code in reader.codes() for trial in reader.trials(code) if trial.trial_id]
        return sum(isinstance(line.event, Act) for trial_id in trials for line in reader.events(trial_id))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_study_ends_with_people_in_the_middle_of_a_trial_and_keeps_all_that_was_acknowledged(
    tmp_path: Path, number: signal.Signals
) -> None:
    invent_dataset(tmp_path / "data", name="Small", seed=3)
    with served(tmp_path) as (process, lines):
        links = dict(re.findall(r"(PAN|POG)  p\d\d  (http\S+)", "".join(lines)))
        workers = children(process.pid)
        with enter(links["PAN"]) as walker, enter(links["POG"]) as pointer:
            pointer.receive_until(lambda message: "Gui" in message["type"])
            walker.press("Start")
            for step in (0, 1, 2):
                walker.see_step(step)  # only what is stored is shown
                walker.press("Turn left (A or Left)")
            walker.see_step(3)
            process.send_signal(number)
            rest, _ = process.communicate(timeout=120)
            with pytest.raises(ConnectionClosed):
                walker.receive_until(lambda _: False)
        assert process.returncode == 0
        assert "Stopped. Everything is in" in rest
        assert not any(is_running(worker) for worker in workers)
    assert stored_steps(tmp_path / "study") == 3
    with served(tmp_path) as (_, lines):
        (link,) = re.findall(r"PAN  p\d\d  (http\S+)", "".join(lines))
        with enter(link) as walker:
            walker.see_step(3)


@pytest.mark.slow
def test_workers_end_also_when_the_gateway_is_killed(tmp_path: Path) -> None:
    invent_dataset(tmp_path / "data", name="Small", seed=3)
    with served(tmp_path) as (process, _):
        workers = children(process.pid)
        process.kill()
        process.wait()
        deadline_s = time.monotonic() + 60
        while any(is_running(worker) for worker in workers):
            assert time.monotonic() < deadline_s
            time.sleep(0.05)


def test_a_port_that_is_taken_is_said_at_once() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(StudyError, match=rf"port {port} of 127\.0\.0\.1: cannot be used .*--port 8090"):
            listen(ServeOptions(port=port))


def test_sigterm_is_heard_as_ctrl_c_and_the_handlers_come_back() -> None:
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), ended_by_sigterm():
        signal.raise_signal(signal.SIGTERM)
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before


def planned(folder: Path, recruit: str) -> StudyStore:
    """A store with that way of recruiting; closed by the caller."""
    config = study(recruit={"kind": recruit})
    return open_store(folder, config, plan(config))


def test_prolific_without_codes_is_refused_before_anything_starts(tmp_path: Path) -> None:
    with (
        planned(tmp_path, "prolific") as store,
        pytest.raises(StudyError, match=r"secrets\.toml: holds no \[prolific\] codes; expected them"),
    ):
        serve_study(
            store,
            folder=tmp_path,
            dataset=tmp_path,
            scenes_dir=None,
            links=[],
            platform_key=KEY,
            options=ServeOptions(port=0, pilot=True),
        )


def test_one_recording_for_many_trials_is_refused(tmp_path: Path) -> None:
    with (
        planned(tmp_path, "local") as store,
        pytest.raises(StudyError, match=r"--rerun x\.rrd: this study has \d+ trials; expected one"),
        shown_live("x.rrd", store.plan),
    ):
        pass
