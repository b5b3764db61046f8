"""Serves a study in a child process, kills it, ends it and serves it again at the same address, as a host would."""

import contextlib
import os
import re
import signal
import time
from pathlib import Path

import psutil

from sim.cache import VARIABLE
from sim.errors import StudyError

from ..study_app.operator.served import ServedStudy, free_port, serve_command
from .site import Site

_DASHBOARD = re.compile(r"for you only: (\S+)")


class Server:
    """A context manager for a study that may be ended and served again any number of times."""

    def __init__(
        self,
        folder: Path,
        dataset: Path,
        *,
        evidence: tuple[Path, ...] = (),
        scenes_dir: Path | None = None,
        cache: Path | None = None,
        workers: int | None = None,
    ) -> None:
        """Starts nothing yet.

        Args:
            folder: Folder of a planned study. The program's output is kept beside it, in `serve.log`.
            dataset: Dataset of the study.
            evidence: Folders of the dataset's evidence.
            scenes_dir: Folder of scans.
            cache: Cache folder of the program; None = the user's own.
            workers: Number of workers; None = the usual number.
        """
        self.log = folder.parent / "serve.log"
        self._folder, self._dataset, self._evidence, self._scenes_dir = folder, dataset, evidence, scenes_dir
        self._command = serve_command(
            folder, dataset, port=free_port(), workers=workers, evidence=evidence, scenes_dir=scenes_dir
        )
        self._environment = {VARIABLE: str(cache)} if cache else {}
        self._study: ServedStudy | None = None

    def __enter__(self) -> "Server":
        """Returns itself; serves nothing before `start`."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the program if it still runs."""
        if self._study is not None:
            self._study.end()

    @property
    def pid(self) -> int:
        """Id of the serving process."""
        return self._served.pid

    @property
    def dashboard(self) -> str:
        """Link of the researcher's page."""
        found = _DASHBOARD.search(self._served.said)
        assert found is not None, self._served.said
        return found.group(1)

    @property
    def workers(self) -> list[psutil.Process]:
        """Processes that the serving process has started and that still run."""
        with contextlib.suppress(psutil.NoSuchProcess):
            return psutil.Process(self.pid).children()
        return []

    def start(self) -> Site:
        """Starts serving; returns when people can come.

        Raises:
            StudyError: The program ended instead.
        """
        self.begin()
        return self.until_ready()

    def begin(self) -> None:
        """Starts the program without waiting for it."""
        with self.log.open("a") as said:
            self._study = ServedStudy(self._command, stderr=said, environment=self._environment)

    def until_ready(self) -> Site:
        """Waits until the program serves.

        Raises:
            StudyError: The program ended instead; the message has its last lines.
        """
        try:
            self._served.await_ready()
        except StudyError as error:
            raise StudyError(f"{error} Its last lines: {self.log.read_text().splitlines()[-5:]}") from None
        return Site(self._folder, self._dataset, self._scenes_dir, self._served.people, self.pid, self._evidence)

    def kill(self) -> None:
        """Kills the serving process with kill -9."""
        self._served.kill()

    def kill_worker(self, number: int) -> bool:
        """Kills one of the present workers with kill -9; returns False if there is none."""
        workers = self.workers
        if not workers:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(workers[number % len(workers)].pid, signal.SIGKILL)
        return True

    def end(self, number: signal.Signals) -> float:
        """Tells the program to end, as a host does; returns the seconds until it has ended."""
        began_s = time.perf_counter()
        self._served.end(number)
        return time.perf_counter() - began_s

    @property
    def _served(self) -> ServedStudy:
        """The program that was started last."""
        assert self._study is not None
        return self._study


def cpu_seconds(pid: int) -> float:
    """CPU seconds of a process and its children so far; 0 when it is gone."""
    with contextlib.suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        times = [one.cpu_times() for one in (process, *process.children())]
        return sum(one.user + one.system for one in times)
    return 0.0
