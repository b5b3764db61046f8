"""Simulated participants: they come in through the real gateway and websocket, answer the pages and press keys.

Each bot notes every key that it sends and when its answer came; `bots_count` compares that with the study's database.
"""

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sim.errors import StudyError
from sim.types import Action

from .bots_flow import answer_page, is_the_end
from .bots_page import BotPage
from .bots_wire import BotConnection, enter

BotKind = Literal["shortest", "random", "slow", "impatient", "disconnecting"]
KINDS: tuple[BotKind, ...] = ("shortest", "random", "slow", "impatient", "disconnecting")
HOTKEYS = {
    Action.FORWARD: "W",
    Action.LEFT: "A",
    Action.RIGHT: "D",
    Action.LOOK_UP: "R",
    Action.LOOK_DOWN: "F",
    Action.STOP: "enter",
}
"""viser's name of the key of each action."""
CODES = {"W": "KeyW", "A": "KeyA", "D": "KeyD", "R": "KeyR", "F": "KeyF", "enter": "Enter"}
"""What the session logs for it."""
PRESS_GAP_S = 0.06
"""Sessions drop presses within 50 ms of the last one."""
ANSWER_S = 15.0
"""Longest wait for the answer to a key; after that the bot says so and goes on."""
SLOWER = 4.0
"""How much slower than asked a slow bot is."""
LEAVE_S = 0.5
"""From the last answer to closing the page: keys without a visible answer are on their way for less."""
BURST = 3
"""Keys that an impatient bot presses instead of one, faster than pictures come, and slower than the gateway's limit."""
BURST_GAP_S = 0.03
DROP_CHANCE = 0.03
"""How often a disconnecting bot hangs up instead of pressing a key."""
AWAY_S = (0.2, 1.5)
"""For how long."""
_RANDOM_MOVES = (Action.FORWARD, Action.FORWARD, Action.FORWARD, Action.LEFT, Action.RIGHT)
_STEPS_OF_RANDOM = 80
"""After so many steps a bot that does not know the way stops."""
Way = Callable[[str], Sequence[Action]]
"""All actions of a participant's present trial, STOP last, from its start; () when there is none."""


@dataclass(slots=True)
class Press:
    """One key that was sent."""

    t_cli_ms: float
    """The bot's clock, different for each of its keys; stored with the key."""
    sent_s: float
    """`time.perf_counter()`."""
    counted_s: float | None = None
    """When the step counter said that it is stored."""
    shown_s: float | None = None
    """When its picture came."""
    was_cut_off: bool = False
    """Whether the bot hung up before it heard of an answer."""


@dataclass(slots=True)
class BotLog:
    """What one bot did."""

    code: str
    """The participant."""
    kind: BotKind
    presses: list[Press] = field(default_factory=list)
    num_frames: int = 0
    num_connections: int = 0
    num_unanswered: int = 0
    """Keys whose effect was awaited for ANSWER_S in vain; those pressed before an earlier one's picture are not."""
    problem: str = ""
    """Why it ended early; empty when it did not."""
    is_finished: bool = False
    """Whether it has no trial left."""


class Bot:
    """One simulated participant."""

    def __init__(
        self,
        code: str,
        link: str,
        kind: BotKind,
        *,
        rate: float,
        seed: int,
        answers: frozenset[str] = frozenset(),
        way: Way | None = None,
    ) -> None:
        """Does nothing yet.

        Args:
            code: The participant.
            link: Personal link.
            kind: How it behaves.
            rate: Actions per second.
            seed: Of its choices.
            answers: The right answers to the quiz (`bots_flow.right_answers`).
            way: Where a `shortest` bot gets its actions.
        """
        assert (way is not None) == (kind == "shortest"), kind
        self.log = BotLog(code, kind)
        self._link, self._kind, self._way, self._answers = link, kind, way, answers
        self._rate = rate / SLOWER if kind == "slow" else rate
        self._rng = np.random.default_rng(seed)
        self._planned: Sequence[Action] | None = None
        self._connection: BotConnection | None = None
        self._reading: asyncio.Task[None] | None = None
        self._changed = asyncio.Condition()
        self._press: tuple[Press, int] | None = None
        """The key whose answer is awaited, and the step that it leads to."""
        self._num_heard = 0
        """Keys up to the last one whose answer came."""

    async def arrive(self) -> None:
        """Comes in and answers every page until the PAN screen, or until nothing is left to do.

        Raises:
            StudyError: It is not let in, or a page has no answer.
        """
        await self._connect()
        await self._until_walking()

    async def act(self, until_s: float) -> None:
        """Presses keys until then (`time.perf_counter()`); whatever goes wrong ends this bot alone."""
        next_s = time.perf_counter() + float(self._rng.uniform(0, 1 / self._rate))
        try:
            while next_s < until_s:
                await asyncio.sleep(max(0.0, next_s - time.perf_counter()))
                if self._kind == "disconnecting" and self._rng.random() < DROP_CHANCE:
                    await self._hang_up()
                await self._until_walking()
                if self.log.is_finished:
                    break
                next_s = max(next_s + 1 / self._rate, time.perf_counter() + PRESS_GAP_S)
                await self._act_once(next_s)
                if self._kind == "shortest":
                    next_s = max(next_s, time.perf_counter() + PRESS_GAP_S)
        except StudyError as error:
            self.log.problem = str(error)
        await self.leave()

    async def leave(self) -> None:
        """Closes the page when the last key has its answer."""
        if self._connection is not None:
            await self._until(lambda: self._press is None)
            await asyncio.sleep(LEAVE_S)
            for press in self.log.presses[self._num_heard :]:
                press.was_cut_off = True
            await self._connection.close()
        if self._reading is not None:
            await self._reading
            self._reading = None

    async def _connect(self) -> None:
        for press in self.log.presses[self._num_heard :]:
            press.was_cut_off = True
        self._press, self._num_heard = None, len(self.log.presses)
        self._connection = await enter(self._link)
        self.log.num_connections += 1
        self._planned = None
        self._reading = asyncio.create_task(self._read(self._connection))

    async def _hang_up(self) -> None:
        """Loses the network for a moment and comes back, sometimes with a key on its way."""
        assert self._connection is not None
        if self._rng.random() < 0.5 and self._connection.page.is_walking:
            await self._send(Action.FORWARD, awaited=False)
        self._connection.abort()
        if self._reading is not None:
            await self._reading
        await asyncio.sleep(float(self._rng.uniform(*AWAY_S)))
        await self._connect()

    async def _read(self, connection: BotConnection) -> None:
        """Keeps the page up to date and notes when the awaited key was stored and when its picture came."""
        page = connection.page
        while await connection.receive():
            now_s = time.perf_counter()
            self.log.num_frames, page.num_frames = self.log.num_frames + page.num_frames, 0
            if self._press is not None:
                press, step = self._press
                if press.counted_s is None and (page.step_counted or 0) >= step:
                    press.counted_s = now_s
                if press.shown_s is None and (page.step_shown or 0) >= step:
                    press.shown_s = now_s
                    self._press, self._num_heard = None, self.log.presses.index(press) + 1
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

    async def _until_walking(self) -> None:
        """Answers pages until the robot can be moved, or nothing is left to do.

        Raises:
            StudyError: The page did not change within ANSWER_S.
        """
        deadline_s = time.perf_counter() + ANSWER_S
        while True:
            connection = self._connection
            assert connection is not None
            if not connection.is_open:
                await self._connect()
                continue
            page = connection.page
            if page.is_walking:
                return
            if is_the_end(page):
                self.log.is_finished = True
                return
            before = set(page.elements)
            if await answer_page(connection, self._answers):
                self._planned = None
                deadline_s = time.perf_counter() + ANSWER_S
            elif time.perf_counter() > deadline_s:
                raise StudyError(
                    f"{self.log.code}: the page says {page.text[:200]!r}; expected one that a bot can answer. "
                    "Teach bots_flow.py the page."
                )
            await self._until(lambda page=page, before=before: set(page.elements) != before, within_s=1.0)

    async def _act_once(self, next_s: float) -> None:
        """Presses the next key and waits for its answer; most kinds press again at `next_s` even without one."""
        action = await self._next_action()
        if action is Action.STOP:
            await self._stop()
            return
        if self._press is not None and time.perf_counter() - self._press[0].sent_s > ANSWER_S:
            self.log.num_unanswered += 1
            self._press = None
        press = await self._send(action, awaited=self._press is None)
        for _ in range(BURST - 1 if self._kind == "impatient" else 0):
            await asyncio.sleep(BURST_GAP_S)
            await self._send(action, awaited=False)
        within_s = ANSWER_S if self._kind == "shortest" else max(0.0, next_s - time.perf_counter())
        await self._until(lambda: press.shown_s is not None or not self._page.is_walking, within_s=within_s)
        if not self._page.is_walking:
            self._press = None

    async def _stop(self) -> None:
        """STOP twice, at a person's pace and not before the last picture, and then the pages that follow."""
        await self._until(lambda: self._press is None or not self._page.is_walking)
        await self._send(Action.STOP, awaited=False)
        await self._until(lambda: "again to finish" in self._page.text)
        await asyncio.sleep(PRESS_GAP_S)
        await self._send(Action.STOP, awaited=False)
        if not await self._until(lambda: not self._page.is_walking):
            self.log.num_unanswered += self._page_is_open
        self._planned, self._press = None, None

    async def _next_action(self) -> Action:
        step = self._page.step_shown or 0
        if self._way is not None:
            if self._planned is None:
                self._planned = await asyncio.to_thread(self._way, self.log.code)
            return self._planned[step] if step < len(self._planned) else Action.STOP
        if step >= _STEPS_OF_RANDOM:
            return Action.STOP
        return _RANDOM_MOVES[int(self._rng.integers(len(_RANDOM_MOVES)))]

    async def _send(self, action: Action, *, awaited: bool = True) -> Press:
        """Presses the key of an action, as a browser does: first its own message, then viser's command."""
        connection = self._connection
        assert connection is not None
        key = HOTKEYS[action]
        command = connection.page.command(key)
        now_s = time.perf_counter()
        press = Press(round(now_s * 1e3, 3), now_s)
        if command is None:
            return press
        if awaited:
            self._press = (press, (connection.page.step_shown or 0) + 1)
        self.log.presses.append(press)
        await connection.tell({"kind": "press", "n": 0, "code": CODES[key], "t_cli_ms": press.t_cli_ms})
        await connection.trigger(command.uuid)
        return press

    @property
    def _page(self) -> BotPage:
        assert self._connection is not None
        return self._connection.page

    @property
    def _page_is_open(self) -> bool:
        return self._connection is not None and self._connection.is_open
