"""A study that the benchmark serves, kills, ends and serves again at the same address, as a person or a host would."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from sim.cache import VARIABLE
from sim.errors import StudyError

from ...bots.site import Site, hear_ctrl_c
from .processes import children

END_S = 30.0
"""Longest wait for the end of a server that was told to end; then it is killed."""
_LINK = re.compile(r"PAN\s+(p\d+)\s+(\S+)")
_DASHBOARD = re.compile(r"for you only: (\S+)")
_READY = "Everything is written to"


class Server:
    """A context manager: `study serve` as a child process, which may be ended and started as often as one likes."""

    def __init__(
        self, folder: Path, dataset: Path, *, scenes_dir: Path | None = None, cache: Path | None = None
    ) -> None:
        """Starts nothing yet.

        Args:
            folder: Of a planned study. What the program says is kept beside it, in `serve.log`.
            dataset: Of the study.
            scenes_dir: Of scans.
            cache: Cache folder of the program; None = the user's own.
        """
        self.log = folder.parent / "serve.log"
        self.dashboard = ""
        """Link of the researcher's page."""
        self._folder, self._dataset, self._scenes_dir, self._cache = folder, dataset, scenes_dir, cache
        self._port = _free_port()
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Server":
        """Nothing is served before `start`."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the program if it still runs."""
        if self._process is not None and self._process.poll() is None:
            self.end(signal.SIGINT)

    @property
    def pid(self) -> int:
        """Of the serving process."""
        assert self._process is not None
        return self._process.pid

    def start(self) -> Site:
        """Serves; returns when people can come.

        Raises:
            StudyError: The program ended instead.
        """
        self.begin()
        return self.until_ready()

    def begin(self) -> None:
        """Starts the program, and does not wait for it."""
        program = [sys.executable, "-m", "personal_viz", "study", "serve", str(self._folder)]
        program += ["--dataset", str(self._dataset), "--port", str(self._port), "--pilot"]
        program += ["--scenes-dir", str(self._scenes_dir)] if self._scenes_dir else []
        cache = {VARIABLE: str(self._cache)} if self._cache else {}
        with self.log.open("a") as said:
            self._process = subprocess.Popen(
                program,
                stdout=subprocess.PIPE,
                stderr=said,
                text=True,
                env={**os.environ, **cache},
                process_group=0,
                preexec_fn=hear_ctrl_c,
            )

    def until_ready(self) -> Site:
        """Waits until the program has printed the personal links.

        Raises:
            StudyError: It ended instead.
        """
        assert self._process is not None
        assert self._process.stdout is not None
        links: dict[str, str] = {}
        for line in self._process.stdout:
            if found := _LINK.search(line):
                links[found.group(1)] = found.group(2)
            if found := _DASHBOARD.search(line):
                self.dashboard = found.group(1)
            if _READY in line:
                break
        if not links:
            said = self.log.read_text().splitlines()[-5:]
            raise StudyError(
                f"{self._folder}: study serve ended with {said}; expected links of PAN participants. "
                "Run it by hand to see more."
            )
        return Site(self._folder, self._dataset, self._scenes_dir, links, self.pid)

    def kill(self) -> None:
        """kill -9 of the serving process and its group; the workers find out by themselves, as after a crash."""
        os.killpg(self.pid, signal.SIGKILL)
        self._reap()

    def kill_worker(self, number: int) -> bool:
        """kill -9 of one of the workers that there are now; False when there is none."""
        workers = children(self.pid)
        if not workers:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(workers[number % len(workers)], signal.SIGKILL)
        return True

    def end(self, number: signal.Signals) -> float:
        """Tells the program to end, as a host does; seconds until it has, after END_S it is killed."""
        assert self._process is not None
        began_s = time.perf_counter()
        self._process.send_signal(number)
        self._reap()
        return time.perf_counter() - began_s

    def _reap(self) -> None:
        assert self._process is not None
        try:
            self._process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()


def _free_port() -> int:
    """A port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
