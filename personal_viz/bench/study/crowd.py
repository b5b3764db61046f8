"""Bots on their own thread that come back by themselves while the caller ends and restarts the study."""

import asyncio
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError

from ...bots.homes import BotHomes
from ...bots.page import BotPage
from ...bots.pan import PanBot
from ...bots.records import BotKind, BotLog
from ...bots.site import Person, Site, make_bot_study
from ..harness import background_loop
from .server import Server

PATIENCE_S = 120.0
"""Seconds for which a bot tries to come back."""
AGAIN_S = 0.2
"""Seconds between two tries."""
_TURN_S = 3.0
"""Seconds for which a bot acts before it checks whether it should stop."""
_ARRIVE_TOGETHER = 10
_POLL_S = 0.005
T = TypeVar("T")


class CrewSettings(BaseModel):
    """The bots that act in a study while something is measured."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bots: int
    kinds: tuple[BotKind, ...] = ("random",)
    """Kinds of bots, dealt out in turn; a crowd has no `shortest`."""
    rate: float = 2.0
    """Keys per second that each bot should press."""
    seed: int
    """Seed of the plan and of the bots' choices."""


class StayingBot(PanBot):
    """A bot that comes back when the study is served again, and notes where it then stands."""

    def __init__(self, person: Person, kind: BotKind, homes: BotHomes | None, *, rate: float, seed: int) -> None:
        """Takes the same arguments as PanBot."""
        super().__init__(person, kind, homes, rate=rate, seed=seed)
        self.num_acked = 0
        """Number of keys that the study has told the bot are on disk."""
        self.resumed: list[tuple[int, int]] = []
        """(step of the first picture, place in `log.presses` of the next key) after each return."""
        self.step_counted = 0
        """Last value of the page's counter."""
        self.is_here = False
        """Whether it stands in a trial, or has none left, since it last lost its connection."""
        self._stays, self._noted, self._tried_s = True, 1, 0.0

    async def go_on(self, is_over: Callable[[], bool]) -> None:
        """Acts until told otherwise, until it has no trial left, or until something goes wrong."""
        while not is_over() and not self.log.problem and not self.log.is_finished:
            await self.act(time.perf_counter() + _TURN_S)

    async def go(self) -> None:
        """Closes the page after the last answer has come."""
        self._stays = False
        await self.leave()

    async def leave(self) -> None:
        """Closes the page only after `go`: between two turns the bot stays."""
        if not self._stays:
            await super().leave()

    async def _connect(self) -> None:
        self.is_here = False
        deadline_s = time.perf_counter() + PATIENCE_S
        while True:
            await asyncio.sleep(max(0.0, self._tried_s + AGAIN_S - time.perf_counter()))
            self._tried_s = time.perf_counter()
            try:
                await super()._connect()
                return
            except StudyError:
                if time.perf_counter() > deadline_s:
                    raise

    async def _until_at_work(self) -> None:
        deadline_s = time.perf_counter() + PATIENCE_S
        while True:
            try:
                await super()._until_at_work()
                self.is_here = True
                return
            except StudyError:  # the page was late, or the study ended meanwhile
                if time.perf_counter() > deadline_s:
                    raise

    async def _act_once(self, next_s: float) -> None:
        if self.log.num_connections > self._noted:
            self._noted = self.log.num_connections
            self.resumed.append((self._page.step_shown or 0, len(self.log.presses)))
        await super()._act_once(next_s)

    def _heard(self, page: BotPage, now_s: float) -> None:
        press = self._press[0] if self._press is not None and self._press[0].counted_s is None else None
        super()._heard(page, now_s)
        self.step_counted = self.step_counted if page.step_counted is None else page.step_counted
        self.num_acked += press is not None and press.counted_s is not None


class Crowd:
    """Staying bots and the thread on which they run; made by `crowd`."""

    def __init__(self, bots: Sequence[StayingBot], loop: asyncio.AbstractEventLoop) -> None:
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
        return tuple(f"{log.code} ({log.kind}): {log.problem}" for log in self.logs if log.problem)

    @property
    def num_acked(self) -> int:
        """Number of keys that the study has told the bots are on disk."""
        return sum(bot.num_acked for bot in self.bots)

    def arrive(self) -> None:
        """Lets all bots come in and answer the pages until the first trial.

        Raises:
            StudyError: A bot is not let in.
        """
        for first in range(0, len(self.bots), _ARRIVE_TOGETHER):
            self._wait(_all(bot.arrive() for bot in self.bots[first : first + _ARRIVE_TOGETHER]))

    def begin(self) -> None:
        """Makes all bots act from now on."""
        assert self._is_over
        self._is_over = False
        self._acting = self._submit(_all(bot.go_on(lambda: self._is_over) for bot in self.bots))

    def halt(self) -> None:
        """Returns when no bot presses keys any more; all pages stay open."""
        self._is_over = True
        if self._acting is not None:
            self._acting.result()

    def leave(self) -> None:
        """Makes all bots close their pages, unless they have done so."""
        self.halt()
        if not self._have_left:
            self._wait(_all(bot.go() for bot in self.bots))
        self._have_left = True

    def await_acks(self, count: int, *, within_s: float = PATIENCE_S) -> None:
        """Returns when this many more keys are acknowledged.

        Raises:
            StudyError: They are not acknowledged in time, or no bot can go on.
        """
        goal = self.num_acked + count
        self.wait_until(lambda: self.num_acked >= goal, f"{count} keys acknowledged", within_s=within_s)

    def await_all_here(self, connections: Sequence[int], *, within_s: float = PATIENCE_S) -> None:
        """Returns when all bots have come back and stand in their trials.

        Args:
            connections: Number of connections that each bot had before.
            within_s: Longest wait, seconds.

        Raises:
            StudyError: A bot is not back in time.
        """
        pairs = tuple(zip(self.bots, connections, strict=True))
        self.wait_until(
            lambda: all(bot.is_here and bot.log.num_connections > count for bot, count in pairs),
            "everybody back",
            within_s=within_s,
        )

    def wait_until(self, is_so: Callable[[], bool], what: str, *, within_s: float = PATIENCE_S) -> None:
        """Waits until `is_so` holds, while the bots act.

        Raises:
            StudyError: That did not happen in time, or a bot gave up.
        """
        deadline_s = time.perf_counter() + within_s
        while not is_so():
            if self.problems or time.perf_counter() > deadline_s:
                raise StudyError(
                    f"bots: found no {what} within {within_s:g} s, problems {list(self.problems)}; expected it soon "
                    "after the study was served again. See serve.log of the run."
                )
            time.sleep(_POLL_S)

    def _submit(self, work: Coroutine[Any, Any, T]) -> Future[T]:
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def _wait(self, work: Coroutine[Any, Any, T]) -> T:
        return self._submit(work).result()


@contextmanager
def crowd(site: Site, codes: Sequence[str], crew: CrewSettings) -> Iterator[Crowd]:
    """Yields bots for a block; at its end all leave.

    Args:
        site: The study; its links must still lead to it after a restart.
        codes: Codes of the participants, one bot for each.
        crew: How the bots behave.
    """
    kinds, homes, people = crew.kinds, BotHomes(site), {person.code: person for person in site.everybody}
    with background_loop("crowd") as loop:
        found = Crowd(
            [
                StayingBot(people[code], kinds[number % len(kinds)], homes, rate=crew.rate, seed=crew.seed + number)
                for number, code in enumerate(codes)
            ],
            loop,
        )
        yield found
        found.leave()


@contextmanager
def staffed(
    folder: Path, dataset: Path, crew: CrewSettings, *, spare: int = 0, workers: int | None = None
) -> Iterator[tuple[Server, Site, Crowd]]:
    """Yields a served study with its own plan, and its bots, which have not come yet; at the block's end all leave.

    Args:
        folder: An empty folder.
        dataset: Dataset of one invented home.
        crew: Number of bots, and how they behave.
        spare: Number of participants without a bot, at the end of the list.
        workers: Number of the server's workers; None = as many as usual.
    """
    make_bot_study(folder, participants=crew.bots + spare, seed=crew.seed, dataset=dataset)
    with Server(folder / "study", dataset, workers=workers) as server:
        site = server.start()
        with crowd(site, list(site.links)[: crew.bots], crew) as found:
            yield server, site, found


async def _all(works: Iterator[Coroutine[Any, Any, None]]) -> None:
    await asyncio.gather(*works)
