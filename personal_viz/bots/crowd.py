"""Many bots on their own thread, while the caller times them, or ends and restarts the study."""

import asyncio
import threading
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from typing import Any

import psutil

from sim.errors import StudyError
from sim.types import TaskKind

from .figures import BotFigures, Spent, figures_of, problems_of
from .homes import BotHomes
from .pan import PanBot
from .pog import PogBot
from .records import BotKind, BotLog, count_bots
from .server import cpu_seconds
from .site import Person, Site
from .walker import PATIENCE_S, Bot

_ARRIVE_TOGETHER = 10
"""Number of bots that come in at the same time."""
_POLL_S = 0.005


class Crowd:
    """Bots and the thread on which they run; made by `crowd`."""

    def __init__(self, bots: Sequence[Bot], loop: asyncio.AbstractEventLoop) -> None:
        """Takes the bots, none of which has come yet, and their event loop."""
        self.bots = tuple(bots)
        self._loop = loop
        self._is_over = True
        self._have_left = False
        self._acting: Future[Any] | None = None

    @property
    def logs(self) -> list[BotLog]:
        """The log of each bot so far."""
        return [bot.log for bot in self.bots]

    @property
    def problems(self) -> tuple[str, ...]:
        """Why bots ended early."""
        return problems_of(self.logs)

    @property
    def num_acked(self) -> int:
        """Number of keys that the study has told the bots are on disk."""
        return sum(log.num_acked for log in self.logs)

    def arrive(self) -> None:
        """Lets all bots come in and answer the pages until the first trial.

        Raises:
            StudyError: A bot is not let in.
        """
        for first in range(0, len(self.bots), _ARRIVE_TOGETHER):
            self._all(bot.arrive() for bot in self.bots[first : first + _ARRIVE_TOGETHER]).result()

    def begin(self) -> None:
        """Makes all bots act from now on."""
        assert self._is_over
        self._is_over = False
        self._acting = self._all(bot.act(lambda: self._is_over) for bot in self.bots)

    def halt(self, *, after_s: float = 0.0) -> None:
        """Returns when no bot presses keys any more; all pages stay open.

        Args:
            after_s: Seconds for which the bots go on, unless all have finished before.
        """
        if self._acting is not None:
            wait([self._acting], after_s)
            self._is_over = True
            self._acting.result()

    def leave(self) -> None:
        """Makes all bots close their pages, unless they have done so."""
        self.halt()
        if not self._have_left:
            self._all(bot.leave() for bot in self.bots).result()
        self._have_left = True

    def await_acks(self, count: int) -> None:
        """Returns when this many more keys are acknowledged.

        Raises:
            StudyError: They are not acknowledged in time, or a bot gave up.
        """
        goal = self.num_acked + count
        self._await(lambda: self.num_acked >= goal, f"{count} keys acknowledged")

    def await_all_here(self, connections: Sequence[int]) -> None:
        """Returns when all bots have come back and stand in their trials.

        Args:
            connections: Number of connections that each bot had before.

        Raises:
            StudyError: A bot is not back in time.
        """
        pairs = tuple(zip(self.bots, connections, strict=True))
        self._await(
            lambda: all(bot.is_here and bot.log.num_connections > count for bot, count in pairs), "everybody back"
        )

    def _await(self, is_so: Callable[[], bool], what: str) -> None:
        """Waits until `is_so` holds, while the bots act.

        Raises:
            StudyError: That did not happen in time, or a bot gave up.
        """
        deadline_s = time.perf_counter() + PATIENCE_S
        while not is_so():
            if self.problems or time.perf_counter() > deadline_s:
                raise StudyError(
                    f"bots: found no {what} within {PATIENCE_S:g} s, problems {list(self.problems)}; expected it soon "
                    "after the study was served again. See serve.log of the run."
                )
            time.sleep(_POLL_S)

    def _all(self, works: Iterator[Coroutine[Any, Any, None]]) -> Future[Any]:
        async def gathered() -> None:
            await asyncio.gather(*works)

        return asyncio.run_coroutine_threadsafe(gathered(), self._loop)


@contextmanager
def crowd(
    site: Site, people: Sequence[Person], *, kinds: Sequence[BotKind], rate: float, seed: int, patience_s: float = 0.0
) -> Iterator[Crowd]:
    """Yields bots for a block; at its end all leave.

    Args:
        site: The study. If the bots are patient, its links must lead to it after a restart.
        people: The participants, one bot for each.
        kinds: Kinds of bots, dealt out in turn in each task.
        rate: Actions per second and bot.
        seed: Seed of the bots' choices.
        patience_s: Seconds for which a bot tries to come back after an error.
    """
    homes = BotHomes(site)
    numbers: Counter[TaskKind] = Counter()
    bots: list[Bot] = []
    for number, person in enumerate(people):
        make = PanBot if person.task == "pan" else PogBot
        kind = kinds[numbers[person.task] % len(kinds)]
        numbers[person.task] += 1
        bots.append(make(person, kind, homes, rate=rate, seed=seed + number, patience_s=patience_s))
    with background_loop("crowd") as loop:
        found = Crowd(bots, loop)
        yield found
        found.leave()


def run_bots(
    site: Site,
    *,
    participants: int,
    seconds: float,
    rate: float,
    kinds: Sequence[BotKind],
    seed: int,
    tasks: Sequence[TaskKind] = ("pan",),
    progress: Callable[[str], None] = lambda _: None,
    on_acting: Callable[[], None] = lambda: None,
) -> BotFigures:
    """Lets bots come in, answer the pages and do their trials until the time is up or all have finished.

    Args:
        site: A study that is being served.
        participants: Number of bots, for the first participants of the tasks in the plan's order.
        seconds: Longest time from the first key on.
        rate: Actions per second and bot.
        kinds: Kinds of bots, dealt out in turn in each task.
        seed: Seed of the bots' choices.
        tasks: Tasks whose participants take part.
        progress: Gets a line about the present work.
        on_acting: Called when all are in and the first key is pressed.

    Raises:
        StudyError: The study has too few participants, a bot is not let in, or the database is damaged.
    """
    people = site.people(tasks)
    if len(people) < participants:
        names = " and ".join(task.upper() for task in tasks)
        raise StudyError(
            f"{site.folder}: has {len(people)} {names} participants; expected at least {participants}. "
            "Plan more, or give a smaller --participants."
        )
    with crowd(site, people[:participants], kinds=kinds, rate=rate, seed=seed) as bots:
        progress(f"{participants} bots come in")
        bots.arrive()
        progress(f"all are in; they act for {seconds:g} s")
        on_acting()
        spent = timed(bots, seconds, server_pid=site.pid)
    progress("comparing with the database")
    return figures_of(bots.logs, count_bots(site.folder, bots.logs), spent, kinds=kinds, rate=rate)


def timed(bots: Crowd, seconds: float, *, server_pid: int | None) -> Spent:
    """Lets bots that have arrived act and then leave; returns the time that it took.

    Args:
        bots: A crowd.
        seconds: Longest time for which they act.
        server_pid: Id of the serving process; None if it is not ours.
    """
    load_before = psutil.getloadavg()[0]
    before_s = None if server_pid is None else cpu_seconds(server_pid)
    own_s, began_s = time.process_time(), time.perf_counter()
    bots.begin()
    bots.halt(after_s=seconds)
    bots.leave()
    elapsed_s, own_s = time.perf_counter() - began_s, time.process_time() - own_s
    server_s = None if server_pid is None or before_s is None else cpu_seconds(server_pid) - before_s
    return Spent(elapsed_s, own_s, server_s, load_before)


@contextmanager
def background_loop(name: str) -> Iterator[asyncio.AbstractEventLoop]:
    """Yields an event loop on its own thread; tasks that still run at the block's end are cancelled."""
    begun: Future[asyncio.AbstractEventLoop] = Future()
    is_over = asyncio.Event()

    async def until_over() -> None:
        begun.set_result(asyncio.get_running_loop())
        await is_over.wait()

    thread = threading.Thread(target=lambda: asyncio.run(until_over()), daemon=True, name=name)
    thread.start()
    loop = begun.result()
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(is_over.set)
        thread.join()
