"""Starts Rerun's own program: bound to loopback, without telemetry, and never outliving us."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
from pathlib import Path

import rerun_cli

from sim.cache import cache_dir
from sim.errors import RecordingError

LOOPBACK = "127.0.0.1"
START_S = 60.0
"""Longest wait for the program, which is ready within a second on an idle machine; longer means that it hangs."""
END_S = 5.0
"""Seconds that the program gets to end after SIGTERM; then it is killed."""
DATA_PORT = re.compile(r"Listening for gRPC connections on 127\.0\.0\.1:(\d+)")
"""The line that the program writes when programs and viewers can connect."""
WEB_PORT = re.compile(r"Hosting a web-viewer at http://127\.0\.0\.1:(\d+)")
"""The line that the program writes when it serves its web page, after that of DATA_PORT."""
_LAUNCH = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])
"""
"""Asks Linux to kill us when the thread that started us ends (PR_SET_PDEATHSIG), then becomes the program."""


@dataclass(frozen=True, slots=True)
class RerunProcess:
    """A running Rerun program."""

    process: subprocess.Popen[str]
    port: int
    """The port that was announced."""
    last_lines: deque[str]
    """The end of its log."""
    reader: threading.Thread
    """Ends with the log."""

    def wait(self) -> int:
        """Waits until the program ends and returns its exit code; waiting costs no processor time."""
        return self.process.wait()

    @property
    def is_running(self) -> bool:
        """Whether the program is still running."""
        return self.process.poll() is None

    @property
    def failure(self) -> str | None:
        """The program's last message, if it ended by itself with an error; otherwise None."""
        if not self.process.poll():
            return None
        self.reader.join(END_S)
        return self.last_lines[-1] if self.last_lines else f"exit code {self.process.returncode}"


@contextlib.contextmanager
def running_rerun(*arguments: str, announces: re.Pattern[str] = DATA_PORT) -> Iterator[RerunProcess]:
    """Runs `rerun` with these arguments until the end of the block, however the block ends.

    The program itself is started, because `rerun` on the path is a wrapper, and stopping the wrapper leaves the program
    running. On Linux the kernel also kills the program when the thread that entered the block ends, so `kill -9` leaves
    nothing behind.

    Args:
        arguments: Arguments without `--bind` and `--port`: the program listens on a free port of loopback.
        announces: The line that says that it is ready; its group is the port that the caller needs.

    Raises:
        RecordingError: The program ended, or was not ready in time.
    """
    command = [str(program()), "--bind", LOOPBACK, "--port", "0", *arguments]
    last_lines: deque[str] = deque(maxlen=8)
    announced: Future[int] = Future()
    launch = [sys.executable, "-I", "-S", "-c", _LAUNCH, str(os.getpid())] if sys.platform == "linux" else []
    process = subprocess.Popen(
        [*launch, *command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=quiet_environment(),
        start_new_session=True,  # Ctrl-C is for us; we then end it
    )
    try:
        reader = threading.Thread(target=_read, args=(process, announces, announced, last_lines), daemon=True)
        reader.start()
        yield RerunProcess(process, _port(announced, command, process, last_lines), last_lines, reader)
    finally:
        _end(process)


def program() -> Path:
    """Rerun's program, the one that `rerun` on the path would start."""
    return Path(rerun_cli.__file__).with_name("rerun.exe" if sys.platform == "win32" else "rerun")


def quiet_environment() -> dict[str, str]:
    """Our environment, changed so that Rerun sends no usage data; the user's own settings are neither read nor changed.

    Two things turn it off: our own settings folder, and `CI`, which also works if no folder can be written.
    """
    environment = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    environment |= {"CI": "1", "NO_COLOR": "1", "RUST_LOG": "info"}  # we read its port from its log
    folder = cache_dir() / "rerun-settings"
    with contextlib.suppress(OSError):
        _write_settings(folder)
        environment["XDG_CONFIG_HOME"] = str(folder)
    return environment


def _write_settings(folder: Path) -> None:
    """`rerun/analytics.json` as `rerun analytics disable` of 0.41 writes it; it reads no file that lacks a field."""
    path = folder / "rerun" / "analytics.json"
    settings = {
        "analytics_enabled": False,
        "analytics_id": "none",
        "metadata": {},
        "config_file_path": str(path),
        "data_dir_path": str(folder / "rerun" / "analytics"),
    }
    text = json.dumps(settings)
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if path.read_text() == text:
            return
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.TemporaryDirectory(dir=path.parent) as beside:
        whole = Path(beside) / path.name
        whole.write_text(text)
        os.replace(whole, path)


def _read(
    process: subprocess.Popen[str], announces: re.Pattern[str], announced: Future[int], last_lines: deque[str]
) -> None:
    """Reads the program's log to its end, so that it never waits for a reader."""
    assert process.stderr is not None
    for line in process.stderr:
        last_lines.append(line.strip())
        found = announces.search(line)
        if found and not announced.done():
            announced.set_result(int(found[1]))
    if not announced.done():
        announced.set_exception(EOFError())


def _port(announced: Future[int], command: list[str], process: subprocess.Popen[str], last_lines: deque[str]) -> int:
    try:
        return announced.result(timeout=START_S)
    except EOFError:
        found = f"it ended with exit code {process.wait()} ({' | '.join(last_lines) or 'no message'})"
    except FutureTimeoutError:
        found = f"it was not ready within {START_S:.0f} s"
    raise RecordingError(
        f"rerun {' '.join(command[1:])}: {found}; expected Rerun's program to listen. "
        "Look at the message, or write to a file: --rerun FILE.rrd, --out FILE.rrd without --open."
    )


def _end(process: subprocess.Popen[str]) -> None:
    """Ends the program and every process that it started."""
    for ending in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, ending)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=END_S)
            break
