"""Simulated participants: they come in through the real gateway and websocket, answer the pages and do their trials.

`PanBot` presses keys, `PogBot` clicks; each notes what it sends and when its answer came.
"""

import asyncio
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from sim.errors import StudyError
from sim.types import TaskKind

from ..study_app.operator.served import Person
from .forms import LEADS_ON, LastPage, answer_pages, open_session, right_answers
from .homes import BotHomes
from .page import BotPage
from .records import BotKind, BotLog
from .wire import BotConnection, connect_viser

PRESS_GAP_S = 0.06
"""Sessions drop presses within 50 ms of the last one."""
ANSWER_S = 15.0
"""Longest wait for the answer to a key or a click; after that the bot says so and goes on."""
SLOWER = 4.0
"""How much slower than asked a slow bot is."""
LEAVE_S = 0.5
"""From the last answer to closing the page: what has no visible answer is on its way for less."""
BURST = 3
"""Presses or clicks of an impatient bot instead of one, faster than pictures come, slower than the gateway's limit."""
BURST_GAP_S = 0.03
DROP_CHANCE = 0.03
"""How often a disconnecting bot hangs up instead of acting."""
AWAY_S = (0.2, 1.5)
"""For how long."""


class Bot(ABC):
    """One simulated participant."""

    task: ClassVar[TaskKind]

    def __init__(self, person: Person, kind: BotKind, homes: BotHomes | None, *, rate: float, seed: int) -> None:
        """Does nothing yet.

        Args:
            person: Whom it stands for.
            kind: How it behaves.
            homes: Where it knows the right answers to the quiz from, and, as its kind wants, more; None = from nowhere.
            rate: Actions per second.
            seed: Of its choices.
        """
        self.log = BotLog(person.code, kind, self.task)
        self._link, self._kind, self._homes = person.link, kind, homes
        self._answers = frozenset() if homes is None else right_answers(homes.config, self.task)
        self._rate = rate / SLOWER if kind == "slow" else rate
        self._rng = np.random.default_rng(seed)
        self._connection: BotConnection | None = None
        self._last: LastPage | None = None
        """At which it stopped."""
        self._reading: asyncio.Task[None] | None = None
        self._changed = asyncio.Condition()

    @property
    @abstractmethod
    def _is_at_work(self) -> bool:
        """Whether the page shows a trial, in which `_act_once` knows what to do."""

    @property
    @abstractmethod
    def _is_waiting(self) -> bool:
        """Whether the answer to something is awaited."""

    @abstractmethod
    async def _act_once(self, next_s: float) -> None:
        """Does the next thing and waits for its answer; most kinds go on at `next_s` even without one."""

    @abstractmethod
    async def _act_in_the_dark(self) -> None:
        """Sends something of which the bot will not hear, because it hangs up next."""

    @abstractmethod
    def _heard(self, page: BotPage, now_s: float) -> None:
        """Notes which answers have come."""

    @abstractmethod
    def _forget(self) -> None:
        """Another page is there: what was planned for the last one is not done any more."""

    @abstractmethod
    def _cut_off(self) -> None:
        """The connection has ended: what has no answer yet will not get one."""

    async def arrive(self) -> None:
        """Comes in and answers every page until the first trial, or until nothing is left to do.

        Raises:
            StudyError: It is not let in, or a page has no answer.
        """
        await self._connect()
        await self._until_at_work()

    async def act(self, until_s: float) -> None:
        """Takes part until then (`time.perf_counter()`); an error ends this bot only."""
        next_s = time.perf_counter() + float(self._rng.uniform(0, 1 / self._rate))
        try:
            while next_s < until_s:
                await asyncio.sleep(max(0.0, next_s - time.perf_counter()))
                if self._kind == "disconnecting" and self._rng.random() < DROP_CHANCE:
                    await self._hang_up()
                await self._until_at_work()
                if self.log.is_finished or self.log.is_resting:
                    break
                next_s = max(next_s + 1 / self._rate, time.perf_counter() + PRESS_GAP_S)
                await self._act_once(next_s)
                if self._kind == "shortest":
                    next_s = max(next_s, time.perf_counter() + PRESS_GAP_S)
        except StudyError as error:
            self.log.problem = str(error)
        await self.leave()

    async def leave(self) -> None:
        """Closes the page when the last answer has come."""
        if self._connection is not None:
            await self._until(lambda: not self._is_waiting)
            await asyncio.sleep(LEAVE_S)
            self._cut_off()
            await self._connection.close()
        if self._reading is not None:
            await self._reading
            self._reading = None

    async def _connect(self) -> None:
        """Opens the link, and viser's page once all others are answered."""
        self._forget()
        self._cut_off()
        session = await asyncio.to_thread(open_session, self._link)
        self._last = await asyncio.to_thread(answer_pages, session, self._answers)
        if self._last is not None:
            return
        self._connection = await connect_viser(session)
        self.log.num_connections += 1
        self._reading = asyncio.create_task(self._read(self._connection))

    async def _hang_up(self) -> None:
        """Loses the network for a moment and comes back, sometimes with something on its way."""
        assert self._connection is not None
        if self._rng.random() < 0.5 and self._is_at_work:
            await self._act_in_the_dark()
        self._connection.abort()
        if self._reading is not None:
            await self._reading
        await asyncio.sleep(float(self._rng.uniform(*AWAY_S)))
        await self._connect()

    async def _read(self, connection: BotConnection) -> None:
        """Keeps the page up to date and notes which answers came."""
        page = connection.page
        while await connection.receive():
            now_s = time.perf_counter()
            self.log.num_frames, page.num_frames = self.log.num_frames + page.num_frames, 0
            self._heard(page, now_s)
            await self._tell()
        await self._tell()

    async def _tell(self) -> None:
        async with self._changed:
            self._changed.notify_all()

    async def _until(self, is_so: Callable[[], bool], *, within_s: float = ANSWER_S) -> bool:
        """Waits for the page; False when it did not happen in time, or the connection has ended."""
        connection = self._connection
        assert connection is not None
        try:
            async with asyncio.timeout(within_s), self._changed:
                await self._changed.wait_for(lambda: is_so() or not connection.is_open)
        except TimeoutError:
            return False
        return is_so()

    async def _until_at_work(self) -> None:
        """Answers pages until a trial is there, nothing is left to do, or the study wants the bot to rest.

        Raises:
            StudyError: The page did not change within ANSWER_S.
        """
        deadline_s = time.perf_counter() + ANSWER_S
        while self._last is None:
            connection = self._connection
            assert connection is not None
            if connection.page.goes_on:
                await connection.close()
            if not connection.is_open:
                await self._connect()
                continue
            page = connection.page
            if self._is_at_work:
                return
            before = set(page.elements)
            if await self._answer_card(connection):
                self._forget()
                deadline_s = time.perf_counter() + ANSWER_S
            elif time.perf_counter() > deadline_s:
                raise StudyError(
                    f"{self.log.code}: the page says {page.text[:200]!r}; expected one that a bot can answer. "
                    "Teach personal_viz/bots/forms.py the page."
                )
            await self._until(lambda page=page, before=before: set(page.elements) != before, within_s=1.0)
        self.log.is_resting = self._last.place == "pause"
        self.log.is_finished = not self.log.is_resting
        self.log.completion_code = self._last.completion_code

    async def _answer_card(self, connection: BotConnection) -> bool:
        """Presses what leads on, or how sure it is; False when the page offers nothing, or nothing yet."""
        for pattern in (*LEADS_ON, rf"^{self._sure}:"):
            button = connection.page.button(pattern)
            if button is not None:
                await connection.set_value(button.uuid, True)
                return True
        return False

    @property
    def _known(self) -> BotHomes:
        """What only a bot on the study's own machine knows."""
        assert self._homes is not None
        return self._homes

    @property
    def _sure(self) -> int:
        """How sure it says it is of an answer: who knows is certain, all others have guessed."""
        return 5 if self._kind == "shortest" else 1

    @property
    def _page(self) -> BotPage:
        assert self._connection is not None
        return self._connection.page

    @property
    def _page_is_open(self) -> bool:
        return self._connection is not None and self._connection.is_open
