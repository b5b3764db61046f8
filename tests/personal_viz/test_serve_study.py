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
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
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
