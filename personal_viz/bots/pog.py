"""A simulated POG participant: looks, changes the storey, clicks, moves the mark, confirms it.

The answer to a click is its mark, and the answer to a confirmed mark is the next page: both come once it is stored.
"""

import asyncio
import math
import time
from dataclasses import dataclass, field

from .homes import Aim, beside
from .page import BotPage
from .records import Pointed, Sent
from .walker import BURST, BURST_GAP_S, Bot
from .wire import ray_to

_LOOKS = 2
"""Number of places from which a bot looks at the home before it asks for the texts."""
_CLICKS = 3
"""Largest number of clicks before an answer of a bot that does not know the target."""
_ARROWS = ("arrowleft", "arrowup", "arrowdown", "arrowright")


@dataclass(slots=True)
class _Plan:
    """The remaining actions of a trial."""

    aims: list[Aim] = field(default_factory=list)
    """Places to click, in order."""
    later: list[list[Aim]] = field(default_factory=list)
    """Places for the other objects of a search for all."""
    search: int = 0
    """The search for which it was made."""
    num_moves: int = 0
    """Number of presses that move the mark."""


class PogBot(Bot):
    """Points at the target, or anywhere."""

    task = "pog"
    _plan: _Plan | None = None
    _num_looks = 0
    _storey: int | None = 0
    """Index of the shown storey; None if unknown."""
    _num_marks = 0
    """Number of marks of the present page that were handled."""
    _answer: Sent | None = None
    """The answer that was sent, until the page goes on."""
    _search = 0
    """Index of the search of the page at which the last answers came."""

    @property
    def _is_at_work(self) -> bool:
        return self._page.is_looking or self._page.is_pointing

    def _forget(self) -> None:
        self._plan, self._num_looks, self._storey = None, 0, 0

    def _cut_off(self) -> None:
        super()._cut_off()
        self._answer, self._num_marks, self._storey = None, 0, None

    def _heard(self, page: BotPage, now_s: float) -> None:
        """Notes when a mark is where it was awaited, and when the page has gone on after the answer."""
        if page.mark is not None and page.num_marks != self._num_marks:
            self._num_marks = page.num_marks
            points = [sent for sent in self._on_way if isinstance(sent, Pointed) and sent.shown_s is None]
            snaps = self._homes.config.pog.pointing == "snap"  # then the mark may be far from the clicked place
            if found := next((pointed for pointed in points if snaps or pointed.is_marked_by(page.mark)), None):
                self._answered(found, now_s)
        if page.is_pointing and page.search == self._search:
            return
        self._search = page.search
        if self._answer is not None:
            self._answered(self._answer, now_s)
            self._answer = None
        elif self._on_way and (
            page.button("saved.next") or page.button("homes.next")
        ):  # the time was up between click and mark
            self._cut_off()

    async def _act_in_the_dark(self) -> None:
        aim = await asyncio.to_thread(self._homes.anywhere, self.log.code, self._rng)
        if aim is not None and self._page.is_pointing:
            await self._click(aim, awaited=False)

    async def _act_once(self, next_s: float) -> None:
        page = self._page
        if page.is_looking:
            await self._look(next_s)
            return
        if self._plan is None or self._plan.search != page.search:
            self._plan = await self._planned()
        plan = self._plan
        if not plan.aims and plan.later:
            plan.aims = plan.later.pop(0)
        if plan.aims:
            aim = plan.aims[0]
            if await self._shows_storey(aim):
                plan.aims.pop(0)
                await self._point(aim, next_s)
        elif plan.num_moves and page.mark is not None:
            plan.num_moves -= 1
            await self._move_mark(next_s)
        elif page.mark is None and not self._awaited:  # nothing was hit
            self._plan = None
        else:
            await self._confirm()

    async def _planned(self) -> _Plan:
        """The plan for the present trial."""
        search = self._page.search
        if self._kind == "shortest":
            goals = await asyncio.to_thread(self._homes.goals, self.log.code, search)
            return _Plan(later=[[aim, *beside(aim)] for aim in goals], search=search)
        num_clicks = 1 + int(self._rng.integers(_CLICKS))
        found = [await asyncio.to_thread(self._homes.anywhere, self.log.code, self._rng) for _ in range(num_clicks)]
        aims = [aim for aim in found if aim is not None]
        return _Plan(aims, num_moves=int(self._rng.integers(2)), search=search)

    async def _look(self, next_s: float) -> None:
        """Turns the home for a while, then asks what to find; an impatient bot asks at once, and again."""
        if self._num_looks < _LOOKS and self._kind != "impatient":
            self._num_looks += 1
            angle = float(self._rng.uniform(0, 2 * math.pi))
            eye = (6 * math.cos(angle), 6.0, 6 * math.sin(angle))
            await self._connection.look_down(eye)
            return
        button = self._page.button("look.home_begin")
        if button is None or (self._page.says("look.wait_time") and self._kind != "impatient"):
            return
        await self._connection.set_value(button.uuid, True)
        await self._until(lambda: not self._page.is_looking, within_s=max(0.0, next_s - time.perf_counter()))

    async def _shows_storey(self, aim: Aim) -> bool:
        """Whether the storey of a place is shown; asks for it otherwise."""
        if self._storey == aim.storey:
            return True
        button = self._page.storey_button(aim.storey)
        if button is None:  # there is only one
            self._storey = aim.storey
            return True
        before = self._page.num_surfaces
        await self._connection.set_value(button.uuid, True)
        is_shown = await self._until(lambda: self._page.num_surfaces > before)
        self._storey = aim.storey if is_shown else None
        return False

    async def _point(self, aim: Aim, next_s: float) -> None:
        """Clicks once, or several times in a row; a bot that knows the target waits for its mark."""
        pointed = await self._click(aim, awaited=True)
        for _ in range(BURST - 1 if self._kind == "impatient" else 0):
            await asyncio.sleep(BURST_GAP_S)
            await self._click(aim, awaited=False)
        await self._until_shown(pointed, next_s)
        if self._kind == "shortest" and pointed.shown_s is not None and self._plan is not None:
            self._plan.aims = []

    async def _click(self, aim: Aim, *, awaited: bool) -> Pointed:
        """Goes over the place and clicks at it."""
        ray = ray_to(aim.point, self._rng)
        await self._connection.look_down(ray[0])
        pointed = Pointed(time.perf_counter(), (aim.point[0], aim.point[2]), ray, is_awaited=awaited)
        self._note(pointed, self.log.points)
        await self._connection.click(ray)
        return pointed

    async def _move_mark(self, next_s: float) -> None:
        """Presses an arrow."""
        command = self._page.command(_ARROWS[int(self._rng.integers(len(_ARROWS)))])
        mark = self._page.mark
        if command is None or mark is None:
            return
        pointed = Pointed(time.perf_counter(), (mark[0], mark[2]))
        self._note(pointed, self.log.points)
        await self._connection.trigger(command.uuid)
        await self._until_shown(pointed, next_s)

    async def _confirm(self) -> None:
        """Confirms the mark, an impatient bot twice, and waits for the page to go on."""
        if self._page.mark is None:
            await self._until(lambda: self._page.mark is not None or not self._page.is_pointing)
        button, search = self._page.confirm_button, self._page.search
        if button is None or self._page.mark is None:
            return
        if self._answer is None:
            self._answer = Sent(time.perf_counter())
            self._note(self._answer, self.log.answers)
        await self._connection.set_value(button.uuid, True)
        if self._kind == "impatient":
            await asyncio.sleep(BURST_GAP_S)
            await self._connection.set_value(button.uuid, True)
        await self._until(lambda: not self._page.is_pointing or self._page.search != search)
        self._plan = None
