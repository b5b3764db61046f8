"""A simulated participant: comes in through the real gateway and websocket, answers the pages and does its trials.

`PanBot` presses keys, `PogBot` clicks; each logs its actions and when their answers came.
"""

import asyncio
import time
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from typing import ClassVar, TypeVar

import numpy as np

from human_study.texts.catalogue import catalogue_of
from sim.errors import StudyError
from sim.types import TaskKind

from ..study_app.operator.served import Person
from .forms import ENTER_S, LastPage, answer_pages, open_session, right_answers
from .homes import BotHomes
from .page import BotPage
from .records import BotKind, BotLog, Sent
from .wire import BotConnection, connect_viser

PRESS_GAP_S = 0.06
"""Sessions drop presses within 50 ms of the last one."""
ANSWER_S = 15.0
"""Longest wait for the answer to a key or a click; after that the bot logs it as unanswered and goes on."""
SLOWER = 4.0
"""Factor by which a slow bot is slower than asked."""
LEAVE_S = 0.5
"""Seconds from the last answer to closing the page; messages without a visible answer take less."""
BURST = 3
"""Presses or clicks of an impatient bot instead of one, faster than pictures come, slower than the gateway's limit."""
BURST_GAP_S = 0.03
DROP_CHANCE = 0.03
"""Probability that a disconnecting bot hangs up instead of acting."""
AWAY_S = (0.2, 1.5)
"""Shortest and longest time for which it then stays away, seconds."""
PATIENCE_S = 120.0
"""Seconds for which a patient bot tries to come back."""
_LEADS_ON = (
    *("practice.start", "counted.start", "saved.next", "homes.next", "page.go_on", "problem.paused.again"),
    *("look.topdown_begin", "look.glb_begin"),
)
"""Words of the buttons that lead on, on cards and after a look at a home."""
_AGAIN_S = 0.2
"""Shortest time between two connections, seconds."""
_Sent = TypeVar("_Sent", bound=Sent)


class Bot(ABC):
    """One simulated participant."""

    task: ClassVar[TaskKind]

    def __init__(
        self, person: Person, kind: BotKind, homes: BotHomes, *, rate: float, seed: int, patience_s: float = 0.0
    ) -> None:
        """Does nothing yet.

        Args:
            person: The participant for whom it acts.
            kind: How it behaves.
            homes: Knows the right answers to the quiz, the targets and the ways to them.
            rate: Actions per second.
            seed: Seed of its choices.
            patience_s: Seconds for which it tries again after an error, such as the end of the study.
        """
        self.log = BotLog(person.code, kind, self.task)
        self.is_here = False
        """Whether it stands in a trial, or has none left, since it last lost its connection."""
        self._link, self._kind, self._homes = person.link, kind, homes
        self._answers = right_answers(homes.config, self.task)
        self._rate = rate / SLOWER if kind == "slow" else rate
        self._rng = np.random.default_rng(seed)
        self._patience_s, self._tried_s = patience_s, 0.0
        self._open: BotConnection | None = None
        self._last: LastPage | None = None
        """The page at which it stopped."""
        self._reading: asyncio.Task[None] | None = None
        self._changed = asyncio.Condition()
        self._on_way: list[Sent] = []
        """Actions in order, from the first one whose answer has not come."""
        self._is_sure = True
        """Whether the answers of this connection can be told apart; not when one comes later than ANSWER_S."""

    @property
    @abstractmethod
    def _is_at_work(self) -> bool:
        """Whether the page shows a trial, in which `_act_once` can act."""

    @abstractmethod
    async def _act_once(self, next_s: float) -> None:
        """Acts and waits for the answer; most kinds go on at `next_s` even without one."""

    @abstractmethod
    async def _act_in_the_dark(self) -> None:
        """Sends an action whose answer the bot will not hear, because it hangs up next."""

    @abstractmethod
    def _heard(self, page: BotPage, now_s: float) -> None:
        """Notes which answers have come."""

    @abstractmethod
    def _forget(self) -> None:
        """Drops all plans, because another page is there."""

    async def arrive(self) -> None:
        """Comes in and answers every page until the first trial, or until nothing is left to do.

        Raises:
            StudyError: It is not let in, or a page has no answer.
        """
        await self._patiently(self._connect)
        await self._patiently(self._until_at_work)

    async def act(self, is_over: Callable[[], bool]) -> None:
        """Takes part until told otherwise, or until nothing is left to do; an error ends this bot only."""
        next_s = time.perf_counter() + float(self._rng.uniform(0, 1 / self._rate))
        try:
            while not self.log.problem:
                await asyncio.sleep(max(0.0, next_s - time.perf_counter()))
                if is_over():
                    break
                if self._kind == "disconnecting" and self._rng.random() < DROP_CHANCE:
                    await self._hang_up()
                await self._patiently(self._until_at_work)
                if self.log.is_finished or self.log.is_resting:
                    break
                next_s = max(next_s + 1 / self._rate, time.perf_counter() + PRESS_GAP_S)
                self._give_up_waiting()
                await self._act_once(next_s)
                if self._kind == "shortest":
                    next_s = max(next_s, time.perf_counter() + PRESS_GAP_S)
        except StudyError as error:
            self.log.problem = str(error)

    async def leave(self) -> None:
        """Closes the page when the last answer has come."""
        if self._open is not None:
            await self._until(lambda: not self._awaited)
            await asyncio.sleep(LEAVE_S)
            self._cut_off()
            await self._open.close()
        if self._reading is not None:
            await self._reading
            self._reading = None

    async def _patiently(self, work: Callable[[], Awaitable[None]]) -> None:
        """Does some work; after an error it is tried again until the bot's patience ends.

        Raises:
            StudyError: The last error.
        """
        deadline_s = time.perf_counter() + self._patience_s
        while True:
            try:
                await work()
                return
            except StudyError:
                if time.perf_counter() >= deadline_s:
                    raise

    async def _connect(self) -> None:
        """Opens the link, and viser's page once all others are answered."""
        self.is_here = False
        self._forget()
        self._cut_off()
        await asyncio.sleep(max(0.0, self._tried_s + _AGAIN_S - time.perf_counter()))
        self._tried_s = time.perf_counter()
        session = await asyncio.to_thread(open_session, self._link)
        self._last = await asyncio.to_thread(answer_pages, session, self._answers, language=self._homes.config.language)
        if self._last is not None:
            return
        self._open = await connect_viser(session, catalogue_of(self._homes.config.language))
        self.log.num_connections += 1
        self._reading = asyncio.create_task(self._read(self._open))

    async def _hang_up(self) -> None:
        """Loses the network for a moment and comes back, sometimes with a message on its way."""
        if self._rng.random() < 0.5 and self._is_at_work:
            await self._act_in_the_dark()
        self._connection.abort()
        if self._reading is not None:
            await self._reading
        await asyncio.sleep(float(self._rng.uniform(*AWAY_S)))
        await self._patiently(self._connect)

    async def _read(self, connection: BotConnection) -> None:
        """Keeps the page up to date and notes which answers came."""
        page, is_open = connection.page, True
        while is_open:
            is_open = await connection.receive()
            self.log.num_frames, page.num_frames = self.log.num_frames + page.num_frames, 0
            if is_open:
                self._heard(page, time.perf_counter())
            async with self._changed:
                self._changed.notify_all()

    async def _until(self, is_so: Callable[[], bool], *, within_s: float = ANSWER_S) -> bool:
        """Waits for the page; False if it did not happen in time, or if the connection has ended."""
        connection = self._connection
        try:
            async with asyncio.timeout(within_s), self._changed:
                await self._changed.wait_for(lambda: is_so() or not connection.is_open)
        except TimeoutError:
            return False
        return is_so()

    @property
    def _awaited(self) -> list[Sent]:
        """Actions for whose answer the bot waits."""
        return [sent for sent in self._on_way if sent.is_awaited]

    def _note(self, sent: _Sent, log: list[_Sent]) -> None:
        """Notes an action in its list of the log, just before it is sent."""
        log.append(sent)
        self._on_way.append(sent)

    def _answered(self, sent: Sent, now_s: float) -> None:
        """Notes that an action's answer is there; all earlier ones of the connection are stored too."""
        sent.shown_s, sent.is_awaited = now_s, False
        if self._is_sure:
            del self._on_way[: self._on_way.index(sent) + 1]

    def _give_up_waiting(self) -> None:
        """Stops waiting for answers that should have come."""
        for sent in self._awaited:
            if time.perf_counter() - sent.sent_s > ANSWER_S:
                self.log.num_unanswered += 1
                sent.is_awaited = self._is_sure = False

    def _cut_off(self) -> None:
        """Gives up all open answers, because the connection or the time of the trial has ended."""
        for sent in self._on_way:
            sent.was_cut_off = True
        self._on_way, self._is_sure = [], True
        self.log.ends.append(len(self.log.presses) + len(self.log.points))

    async def _until_shown(self, sent: Sent, next_s: float) -> None:
        """Waits for an action's answer; only bots that know the way or the target wait longer than until `next_s`."""
        within_s = ANSWER_S if self._kind == "shortest" else max(0.0, next_s - time.perf_counter())
        await self._until(lambda: sent.shown_s is not None or not self._is_at_work, within_s=within_s)
        if not self._is_at_work:
            for one in self._awaited:
                one.is_awaited = False

    async def _until_at_work(self) -> None:
        """Answers pages until a trial is there, nothing is left to do, or the study wants the bot to rest.

        Raises:
            StudyError: The page did not change within ENTER_S.
        """
        deadline_s = time.perf_counter() + ENTER_S
        while self._last is None:
            connection = self._connection
            if connection.page.goes_on:
                await connection.close()
            if not connection.is_open:
                await self._patiently(self._connect)
                continue
            page = connection.page
            if self._is_at_work:
                self.is_here = True
                return
            before = set(page.elements)
            if await self._answer_card(connection):
                self._forget()
                deadline_s = time.perf_counter() + ENTER_S
            elif time.perf_counter() > deadline_s:
                raise StudyError(
                    f"{self.log.code}: the page says {page.text[:200]!r}; expected one that a bot can answer. "
                    "Teach personal_viz/bots/forms.py the page."
                )
            await self._until(lambda page=page, before=before: set(page.elements) != before, within_s=1.0)
        self.is_here = True
        self.log.is_resting = self._last.place == "pause"
        self.log.is_finished = not self.log.is_resting
        self.log.completion_code = self._last.completion_code

    async def _answer_card(self, connection: BotConnection) -> bool:
        """Presses the button that leads on, or says how sure the bot is; False if the page offers neither yet."""
        sure = 5 if self._kind == "shortest" else 1  # the others have guessed
        for key in (*_LEADS_ON, f"rate.{sure}"):
            button = connection.page.button(key)
            if button is not None:
                await connection.set_value(button.uuid, True)
                return True
        return False

    @property
    def _connection(self) -> BotConnection:
        """The present connection, or the last one."""
        assert self._open is not None
        return self._open

    @property
    def _page(self) -> BotPage:
        return self._connection.page
