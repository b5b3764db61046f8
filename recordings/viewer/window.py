"""Shows recordings to a person: in Rerun's own window if there is a display, else on a page that we serve on loopback.

The programs started here send no usage data, listen on loopback only, and end with us.
"""

import contextlib
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path

from sim.errors import RecordingError

from .process import RerunProcess, running_rerun
from .web import live_url, serve_file, serve_folder, serve_live

STREAM_MEMORY = "25%"
"""Largest memory that a stream without a window keeps for viewers that open later; the oldest data is dropped first."""


@contextlib.contextmanager
def live_viewer() -> Iterator[str]:
    """Yields the address of a stream that a viewer shows, `rerun+http://127.0.0.1:PORT/proxy`.

    With a display a window opens; a page shows the same, with or without a display. After the block has ended without
    an error, waits until the window is closed or for Ctrl-C, because the streamed data is stored nowhere else. The
    stream goes on if the window is closed earlier or cannot be opened.

    Raises:
        RecordingError: Rerun's program cannot be started.
    """
    serving = running_rerun("--serve-grpc", "--server-memory-limit", STREAM_MEMORY)
    with serving as server, serve_live(server.port) as site, contextlib.ExitStack() as stack:
        stream = live_url(server.port)
        _say(f"Watch live in a browser on this machine: {site.address}")
        window = _connected_window(stack, stream) if has_display() else None
        yield stream
        if window is not None and window.failure is None:
            _until_ctrl_c("Everything is shown. Close the viewer, or press Ctrl-C, to end.", window.wait)
        failure = window.failure if window is not None else None
        if failure is not None:
            _say(f"The window ended ({failure}); a page shows the same.")
        if window is None or failure is not None:
            _until_ctrl_c(f"Everything is shown at {site.address}. Press Ctrl-C to end.", server.wait)


def open_file(path: Path) -> None:
    """Shows one recording until its window is closed or until Ctrl-C.

    Raises:
        RecordingError: There is no such file, or Rerun's program cannot be started.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: found no file; expected a recording. Write one with personal-viz replay.")
    if has_display() and _is_seen_in_window(path):
        return
    with serve_file(path) as site:
        _until_ctrl_c(
            f"Open {site.address} in a browser on this machine to see {path}. Ctrl-C ends it.", threading.Event().wait
        )


def open_folder(folder: Path, page: str = "index.html") -> None:
    """Serves a folder that `personal-viz compare` wrote, with the web viewer at `/viewer/`, until Ctrl-C.

    Raises:
        RecordingError: The page is missing, or the viewer cannot be served.
    """
    if not (folder / page).is_file():
        raise RecordingError(f"{folder}: found no {page}; expected one. Write the folder with personal-viz compare.")
    with serve_folder(folder, page=page) as site:
        if has_display():
            webbrowser.open(site.address)
        _until_ctrl_c(
            f"Open {site.address} in a browser on this machine to see {folder}. Ctrl-C ends it.", threading.Event().wait
        )


def has_display() -> bool:
    """Whether a window can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _connected_window(stack: contextlib.ExitStack, stream: str) -> RerunProcess | None:
    """A window on a stream that closes with the stack; if none can be opened, says why and returns None."""
    try:
        return stack.enter_context(running_rerun("--connect", stream, "--expect-data-soon"))
    except RecordingError as error:
        _say(f"No window can be opened ({error}).")
        return None


def _is_seen_in_window(path: Path) -> bool:
    """Whether a window showed a file until it was closed, or until Ctrl-C; if none can be opened, says why."""
    try:
        with running_rerun(str(path.resolve())) as window:
            _until_ctrl_c(f"{path} is open in a window. Close it, or press Ctrl-C, to end.", window.wait)
            failure = window.failure
    except RecordingError as error:
        failure = str(error)
    if failure is not None:
        _say(f"The window ended ({failure}); a page shows the same.")
    return failure is None


def _until_ctrl_c(line: str, wait: Callable[[], object]) -> None:
    """Prints the line, then waits; Ctrl-C ends the wait without an error, even while printing."""
    with contextlib.suppress(KeyboardInterrupt):
        _say(line)
        wait()


def _say(line: str) -> None:
    print(line, flush=True)
