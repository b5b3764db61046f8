"""The viser workers: child processes on loopback that are started, watched, started again when they die, and ended.

Each worker has a local socket to the store. All connections of a participant go to the same worker.
"""

import contextlib
import socket
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError

from human_study.store.store import StudyStore
from sim.errors import StudyError

from ..store_link import StoreService
from ..worker_door import WorkerDoor
from .admission import Tickets
from .heartbeat import Heartbeat, answers

START_S = 600.0
"""Longest wait for a worker to start. It is for a worker that hangs; the end of one is noticed at once. A scan of a
million triangles takes half a minute the first time (on two idle cores), then four seconds."""
END_S = 6.0
"""Time that the workers get to end, after the connections have had theirs."""
WORKERS_SHARE = 0.6
"""Share of a study's stopping time that the workers get."""
MOST_FAILURES = 5
"""A worker that ends this many times in a row before it is ready, or soon after, is given up."""
PAUSES_S = (0.0, 0.0, 0.5, 2.0, 5.0)
"""Pauses before a worker is started again, by the number of failures."""
HEALTHY_S = 30.0
"""A worker that served for this many seconds counts as not failed."""


class Worker:
    """A place for a viser process; its process may be replaced."""

    def __init__(self, number: int) -> None:
        """Starts no process yet."""
        self.number = number
        self.door: WorkerDoor | None = None
        """The door where the process listens; None while it is not ready."""
        self.process: subprocess.Popen[bytes] | None = None
        self.service: StoreService | None = None
        self.ended = threading.Event()
        self.codes: Counter[str] = Counter()
        """Number of open connections of each participant who has any."""

    def close_socket(self) -> None:
        """Tells the process to end."""
        if self.service is not None:
            self.service.close()

    def end_process(self, patience_s: float) -> None:
        """Waits for a process that was told to end, and kills it if it does not end in time."""
        if self.process is None:
            return
        try:
            self.process.wait(timeout=max(0.1, patience_s))
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class WorkerPool:
    """A context manager: inside, the workers serve; `ended` is set if all had to be given up."""

    def __init__(
        self,
        store: StudyStore,
        command: Callable[[int], Sequence[str]],
        *,
        num_workers: int,
        tickets: Tickets,
        tell: Callable[[str], None],
        heartbeat: Heartbeat | None = None,
        end_s: float = END_S,
    ) -> None:
        """Starts nothing yet.

        Args:
            store: Answers the workers' requests.
            command: Gives the command line of a worker for the file descriptor of its socket.
            num_workers: Number of workers, at least 1.
            tickets: Give the participant of each connection.
            tell: Writes one line for the person at the terminal.
            heartbeat: Decides when a worker counts as hung.
            end_s: Time that the workers get to end, seconds.
        """
        self._heartbeat, self._end_s = heartbeat or Heartbeat(), end_s
        self._store, self._command, self._tickets, self._tell = store, command, tickets, tell
        self.workers = [Worker(number) for number in range(1, num_workers + 1)]
        self.ended = threading.Event()
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._last: dict[str, Worker] = {}
        self._watchers: list[threading.Thread] = []

    def __enter__(self) -> "WorkerPool":
        """Starts all workers together and returns when all are ready.

        Raises:
            StudyError: A worker cannot start; the message is the worker's own.
        """
        try:
            for worker in self.workers:
                self._spawn(worker)
            for worker in self.workers:
                self._await_ready(worker)
        except BaseException:
            self.__exit__()
            raise
        for worker in self.workers:
            watcher = threading.Thread(target=self._watch, args=(worker,), daemon=True, name=f"worker-{worker.number}")
            watcher.start()
            self._watchers.append(watcher)
        return self

    def __exit__(self, *_: object) -> None:
        """Ends all workers: they are told to end first, and killed if they are still there after `end_s`."""
        self._closing.set()
        deadline_s = time.monotonic() + self._end_s
        for worker in self.workers:
            worker.ended.set()
            worker.close_socket()
        for watcher in self._watchers:  # one may be starting a process just now
            watcher.join(timeout=max(0.1, deadline_s - time.monotonic()))
        for worker in self.workers:
            worker.close_socket()
            worker.end_process(deadline_s - time.monotonic())

    @contextlib.contextmanager
    def seat(self, code: str) -> Iterator[WorkerDoor | None]:
        """The door of the participant's worker for one connection; None when none is ready."""
        with self._lock:
            worker = self._fitting(code)
            if worker is not None:
                worker.codes[code] += 1
                self._last[code] = worker
        try:
            yield worker.door if worker is not None else None
        finally:
            with self._lock:
                if worker is not None:
                    worker.codes[code] -= 1
                    worker.codes += Counter()  # drops those who have none

    def num_people(self) -> int:
        """Number of participants connected now."""
        with self._lock:
            return len({code for worker in self.workers for code in worker.codes})

    def warm(self, code: str, scene: str) -> None:
        """Asks the worker that the participant will probably get to open a home; returns at once."""
        with self._lock:
            worker = self._fitting(code)
            service = worker.service if worker is not None else None
            if worker is not None:
                self._last[code] = worker
        if service is not None:
            service.warm(scene)

    def _fitting(self, code: str) -> Worker | None:
        """The worker that has the participant already; else the least loaded one, if possible the one used last."""
        ready = [worker for worker in self.workers if worker.door is not None]
        if not ready:
            return None
        holding = [worker for worker in ready if code in worker.codes]
        fewest = min(len(worker.codes) for worker in ready)
        least = [worker for worker in ready if len(worker.codes) == fewest]
        last = self._last.get(code)
        return holding[0] if holding else (last if last is not None and last in least else least[0])

    def _spawn(self, worker: Worker) -> None:
        ours, theirs = socket.socketpair()
        worker.ended = threading.Event()
        # a process group of its own: Ctrl-C reaches the gateway alone, which then closes the socket; not a session of
        # its own, since Linux shares out the cores by session before it looks at the priority of render threads
        # and no standard output: viser prints its own address there, which participants must not use
        worker.process = subprocess.Popen(
            list(self._command(theirs.fileno())),
            pass_fds=[theirs.fileno()],
            process_group=0,
            stdout=subprocess.DEVNULL,
        )
        theirs.close()
        worker.service = StoreService(
            ours,
            self._store,
            code_of_ticket=self._tickets.code_of,
            client_profile=self._tickets.client_profile,
            on_end=worker.ended.set,
        )

    def _await_ready(self, worker: Worker) -> None:
        assert worker.service is not None
        try:
            worker.door = worker.service.started.result(timeout=START_S)
        except FutureTimeoutError:
            raise StudyError(
                f"viser worker {worker.number} was not ready within {START_S:.0f} s; expected a scene that loads "
                "faster. Start again when the machine is less busy, or use a smaller scene."
            ) from None

    def _watch(self, worker: Worker) -> None:
        """Starts the worker again whenever it ends or hangs, until it fails too often or the pool closes."""
        failures = 0
        while True:
            ready_s = time.monotonic()
            why, alive_s = self._until_ended(worker)
            if self._closing.is_set():
                return
            with self._lock:
                worker.door = None
            worker.close_socket()
            worker.end_process(2.0)
            failures = 0 if alive_s - ready_s > HEALTHY_S else failures + 1
            if failures >= MOST_FAILURES:
                self._give_up(worker)
                return
            self._tell(f"viser worker {worker.number} {why}; it is started again. Nothing acknowledged is lost.")
            if self._closing.wait(timeout=PAUSES_S[failures]):
                return
            self._spawn(worker)
            if self._closing.is_set():  # closing began while we started the process: nobody else would end it
                worker.ended.set()
                return
            try:
                self._await_ready(worker)
            except StudyError as error:
                self._tell(str(error))
                worker.ended.set()

    def _until_ended(self, worker: Worker) -> tuple[str, float]:
        """Waits until a worker ends; kills it when it hangs. Returns what happened, and when it last worked."""
        every_s, patience_s = self._heartbeat.every_s, self._heartbeat.patience_s
        answered_s = time.monotonic()
        while not worker.ended.wait(every_s):
            assert worker.door is not None
            assert worker.process is not None
            if answers(worker.door.port, patience_s=patience_s, over=worker.ended):
                answered_s = time.monotonic()
                continue
            worker.process.kill()
            worker.ended.wait()
            return f"has not answered for {patience_s:.0f} s and was killed", answered_s
        return "ended", time.monotonic()

    def _give_up(self, worker: Worker) -> None:
        self._tell(f"viser worker {worker.number} ended {MOST_FAILURES} times in a row; it is not started again.")
        with self._lock:
            self.workers = [other for other in self.workers if other is not worker]
            if not self.workers:
                self.ended.set()
