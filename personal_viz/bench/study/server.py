"""Serves a study, kills it, ends it and serves it again at the same address, as a person or a host would."""

import contextlib
import os
import re
import signal
import time
from collections import Counter
from pathlib import Path

import psutil

from sim.cache import VARIABLE
from sim.errors import StudyError

from ...bots.site import Site
from ...study_app.operator.served import ServedStudy, free_port, serve_command
from ..harness import peak_mb

_DASHBOARD = re.compile(r"for you only: (\S+)")


class Server:
    """A context manager for a study that may be ended and served again any number of times."""

    def __init__(
        self,
        folder: Path,
        dataset: Path,
        *,
        scenes_dir: Path | None = None,
        cache: Path | None = None,
        workers: int | None = None,
    ) -> None:
        """Starts nothing yet.

        Args:
            folder: Folder of a planned study. The program's output is kept beside it, in `serve.log`.
            dataset: Dataset of the study.
            scenes_dir: Folder of scans.
            cache: Cache folder of the program; None = the user's own.
            workers: Number of workers; None = as many as usual.
        """
        self.log = folder.parent / "serve.log"
        self._folder, self._dataset, self._scenes_dir = folder, dataset, scenes_dir
        self._command = serve_command(folder, dataset, port=free_port(), workers=workers, scenes_dir=scenes_dir)
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
    def study(self) -> ServedStudy:
        """The program that was started last."""
        assert self._study is not None
        return self._study

    @property
    def pid(self) -> int:
        """Id of the serving process."""
        return self.study.pid

    @property
    def dashboard(self) -> str:
        """Link of the researcher's page."""
        found = _DASHBOARD.search(self.study.said)
        assert found is not None, self.study.said
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
            self.study.await_ready()
        except StudyError as error:
            raise StudyError(f"{error} Its last lines: {self.log.read_text().splitlines()[-5:]}") from None
        return Site(self._folder, self._dataset, self._scenes_dir, self.study.people, self.pid)

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
        self.study.end(number)
        return time.perf_counter() - began_s


def held_by(pid: int) -> dict[str, float]:
    """Resources that a serving process and its workers hold now; a process that ends meanwhile does not count.

    Returns:
        Sums: `processes`, `fds` (open file descriptors), `threads`, `clients` (established TCP connections of the
        workers: viser's clients), `rss_mb` (resident memory, MB of 10^6 bytes; pages that processes share count in
        each), `peak_mb` (the largest that each of the processes ever had).
    """
    held = Counter[str](processes=0, fds=0, threads=0, clients=0)
    with contextlib.suppress(psutil.NoSuchProcess):
        serving = psutil.Process(pid)
        for process in (serving, *serving.children()):
            with contextlib.suppress(psutil.NoSuchProcess):
                connections = process.net_connections("tcp") if process.pid != pid else []
                established = sum(connection.status == psutil.CONN_ESTABLISHED for connection in connections)
                held.update(processes=1, fds=process.num_fds(), threads=process.num_threads(), clients=established)
                held.update(rss_mb=process.memory_info().rss / 1e6, peak_mb=peak_mb(process))  # pyright: ignore
    return dict(held)
