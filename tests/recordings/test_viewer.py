"""Viewers that we start: no usage data, loopback only, no process left behind after any ending, no busy waiting."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import rerun as rr

from personal_viz.study_app.operator.served import hear_ctrl_c
from recordings.viewer import window
from recordings.viewer.process import RerunProcess, program, quiet_environment, running_rerun
from recordings.viewer.window import live_viewer, open_file, open_folder
from sim.cache import VARIABLE
from sim.errors import RecordingError

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
SERVES = """
from recordings.viewer.process import running_rerun
with running_rerun("--serve-grpc") as server:
    print(server.process.pid, flush=True)
    input()
"""
SHOWS_LIVE = """
from recordings.viewer.window import live_viewer
with live_viewer() as address:
    print(address, flush=True)
"""


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """Removes the display, so that tests open no window."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


def is_running(pid: int) -> bool:
    """Whether a process exists and is not a zombie."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


def listening(pid: int) -> set[str]:
    """Addresses, in hexadecimal as Linux writes them, on which a process listens."""
    sockets = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            sockets.add(os.readlink(link).removeprefix("socket:[").removesuffix("]"))
    found = set()
    for table in ("tcp", "tcp6"):
        for row in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = row.split()
            if fields[3] == "0A" and fields[9] in sockets:
                found.add(fields[1].split(":")[0])
    return found


@contextlib.contextmanager
def python(code: str) -> Iterator[subprocess.Popen[str]]:
    """A separate process that runs our code, started as from a user's terminal."""
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=hear_ctrl_c,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_until_gone(pid: int) -> None:
    """Returns when the process has ended; fails if it has not ended after a minute."""
    tick = threading.Event()
    for _ in range(600):
        if not is_running(pid):
            return
        tick.wait(0.1)
    raise AssertionError(f"process {pid} still exists")


def test_rerun_sends_no_usage_data_and_the_users_settings_do_not_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    environment = quiet_environment()
    done = subprocess.run(
        [program(), "analytics", "config"], env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    assert json.loads(done.stdout)["analytics_enabled"] is False
    assert list(tmp_path.iterdir()) == []
    assert environment["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in environment


def test_usage_data_stays_off_if_no_settings_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))
    environment = quiet_environment() | {"RUST_LOG": "debug", "XDG_CONFIG_HOME": str(tmp_path)}
    with running_with_log(environment) as log:
        assert any("Analytics disabled on CI" in line for line in log)


@contextlib.contextmanager
def running_with_log(environment: dict[str, str]) -> Iterator[list[str]]:
    """Starts Rerun and gives the lines of its log until it listens."""
    command = [str(program()), "--serve-grpc", "--bind", "127.0.0.1", "--port", "0"]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    lines = []
    try:
        for line in process.stderr:
            lines.append(line)
            if "Listening for gRPC" in line:
                break
        yield lines
    finally:
        process.kill()
        process.communicate()


@on_linux
def test_a_server_listens_only_on_loopback_and_ends_with_its_block() -> None:
    with running_rerun("--serve-grpc") as server:
        pid = server.process.pid
        assert listening(pid) == {"0100007F"}
        assert server.is_running
    assert not is_running(pid)


@on_linux
def test_an_error_in_the_block_ends_the_server_too() -> None:
    with pytest.raises(ZeroDivisionError), running_rerun("--serve-grpc") as server:
        raise ZeroDivisionError
    assert not is_running(server.process.pid)


@on_linux
@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_server_outlives_a_program_that_is_killed_or_interrupted(ending: signal.Signals) -> None:
    with python(SERVES) as process:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        assert is_running(pid)
        process.send_signal(ending)
        process.wait(60)
        wait_until_gone(pid)


def test_an_error_about_a_program_that_does_not_start_gives_the_reason() -> None:
    told = r"rerun .*--no-such-option: it ended with exit code 2 .*unexpected"
    with pytest.raises(RecordingError, match=told), running_rerun("--no-such-option"):
        pass


def test_a_stream_without_a_display_is_served_and_ends_at_once_on_an_error(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(ZeroDivisionError), live_viewer() as address:
        stream_and_fail(address)
    assert "Watch live in a browser on this machine: http://127.0.0.1:" in capsys.readouterr().out


def stream_and_fail(address: str) -> None:
    """Sends one point to the server of the stream and raises an error."""
    stream = rr.RecordingStream("personal-viz", recording_id="live")
    stream.connect_grpc(address)
    stream.log("point", rr.Points3D([0.0, 0.0, 0.0]))
    stream.flush()
    stream.disconnect()
    raise ZeroDivisionError


@on_linux
def test_a_finished_stream_stays_visible_until_ctrl_c() -> None:
    with python(SHOWS_LIVE) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(3)]
        assert lines[2].startswith("Everything is shown at http://127.0.0.1:")
        children = [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
        assert len(children) == 1
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert not is_running(children[0])


def test_a_live_server_gets_no_file_because_it_would_use_cpu_all_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple[str, ...]] = []

    @contextlib.contextmanager
    def noted(*arguments: str) -> Iterator[RerunProcess]:
        started.append(arguments)
        with running_rerun(*arguments) as server:
            yield server

    monkeypatch.setattr(window, "running_rerun", noted)
    with pytest.raises(KeyboardInterrupt), live_viewer():
        raise KeyboardInterrupt
    assert started == [("--serve-grpc", "--server-memory-limit", window.STREAM_MEMORY)]


def test_a_window_that_cannot_open_is_reported_and_a_page_shows_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setenv("DISPLAY", ":no-such-display")
    monkeypatch.setattr(window, "_until_ctrl_c", until_ended_or_ctrl_c)
    (tmp_path / "x.rrd").touch()
    open_file(tmp_path / "x.rrd")
    told = capsys.readouterr().out.splitlines()
    assert told[-2].startswith("The window ended (")
    assert told[-2].endswith("); a page shows the same.")
    assert told[-1].startswith("Open http://127.0.0.1:")


def until_ended_or_ctrl_c(line: str, wait) -> None:
    """Waits until a window ends; at the page it returns, as if a person pressed Ctrl-C."""
    print(line)
    if wait.__name__ == "wait" and isinstance(wait.__self__, RerunProcess):
        wait()


def test_missing_files_and_pages_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"x\.rrd: found no file"):
        open_file(tmp_path / "x.rrd")
    with pytest.raises(RecordingError, match=r"found no index\.html; expected one"):
        open_folder(tmp_path)
