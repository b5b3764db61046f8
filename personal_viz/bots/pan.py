"""A simulated PAN participant: presses keys as a browser sends them and waits for their counter and pictures."""

import asyncio
import time
from collections.abc import Sequence

from sim.types import Action

from ..study_app.screens.pan import HOTKEYS
from .page import BotPage
from .records import Press
from .walker import BURST, BURST_GAP_S, PRESS_GAP_S, Bot

_KEYS = {action: (key, code) for key, (code, action) in HOTKEYS.items() if len(key) == 1}
_KEYS |= dict.fromkeys((Action.STOP, Action.FOUND), ("enter", "Enter"))
"""viser's name and the browser's code of the key of each action."""
_RANDOM_MOVES = (Action.FORWARD, Action.FORWARD, Action.FORWARD, Action.LEFT, Action.RIGHT)
_STEPS_OF_RANDOM = 80
"""Number of steps after which a bot that does not know the way stops, in each search."""


class PanBot(Bot):
    """Walks the shortest way, or anywhere."""

    task = "pan"
    _planned: Sequence[Sequence[Action]] | None = None
    """The actions of each search; an episode is one search."""
    _num_noted = 1
    """Number of connections of which the log says where they began."""

    @property
    def _is_at_work(self) -> bool:
        return self._page.is_walking

    def _forget(self) -> None:
        self._planned = None

    def _heard(self, page: BotPage, now_s: float) -> None:
        """Notes when the awaited key was stored and when its picture came."""
        self.log.step_counted = self.log.step_counted if page.step_counted is None else page.step_counted
        for press in self._awaited:
            assert isinstance(press, Press)
            if press.counted_s is None and (page.step_counted or 0) >= press.step:
                press.counted_s = now_s
                self.log.num_acked += 1
            if (page.step_shown or 0) >= press.step:
                self._answered(press, now_s)

    async def _act_in_the_dark(self) -> None:
        await self._send(Action.FORWARD, awaited=False)

    async def _act_once(self, next_s: float) -> None:
        if self.log.num_connections > self._num_noted:
            self._num_noted = self.log.num_connections
            self.log.resumed.append((self._page.step_shown or 0, len(self.log.presses)))
        action = await self._next_action()
        if action in (Action.STOP, Action.FOUND):
            await self._stop(action)
            return
        press = await self._send(action, awaited=not self._awaited)
        for _ in range(BURST - 1 if self._kind == "impatient" else 0):
            await asyncio.sleep(BURST_GAP_S)
            await self._send(action, awaited=False)
        await self._until_shown(press, next_s)

    async def _stop(self, action: Action) -> None:
        """Presses STOP or FOUND twice, at a person's pace and not before the last picture."""
        await self._until(lambda: not self._awaited or not self._page.is_walking)
        before = (self._page.search, self._page.step_shown)
        await self._send(action, awaited=False)
        await self._until(lambda: self._page.button("pan.press_again") is not None)
        await asyncio.sleep(PRESS_GAP_S)
        await self._send(action, awaited=False)
        if not await self._until(lambda: self._page.has_gone_on(*before)):
            self.log.num_unanswered += self._connection.is_open
        if not self._page.is_walking:
            self._planned = None

    @property
    def _answer(self) -> Action:
        return Action.STOP if self._homes.config.sequences is None else Action.FOUND

    async def _next_action(self) -> Action:
        step = self._page.step_shown or 0
        if self._kind == "shortest":
            if self._planned is None:
                self._planned = await asyncio.to_thread(self._homes.way, self.log.code)
            way = self._planned[self._page.search] if self._page.search < len(self._planned) else ()
            return way[step] if step < len(way) else self._answer
        if step >= _STEPS_OF_RANDOM:
            return self._answer
        return _RANDOM_MOVES[int(self._rng.integers(len(_RANDOM_MOVES)))]

    async def _send(self, action: Action, *, awaited: bool = True) -> Press:
        """Presses the key of an action as a browser does: first the page's message, then viser's command."""
        connection = self._connection
        key, code = _KEYS[action]
        command = connection.page.command(key)
        now_s = time.perf_counter()
        press = Press(now_s, round(now_s * 1e3, 3), (connection.page.step_shown or 0) + 1, is_awaited=awaited)
        if command is None:
            return press
        self._note(press, self.log.presses)
        await connection.tell({"kind": "press", "n": 0, "action": action.value, "code": code, "t_cli_ms": press.mark})
        await connection.trigger(command.uuid)
        return press
