"""Ends and restarts the study while people are online, and checks that they come back to where they were."""

import contextlib
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import psutil

from human_study.design.study import load_study
from human_study.store.records import read_study
from human_study.trial.events import Act, Reconnect
from sim.errors import MissingDependencyError

from ...bots.crowd import Crowd
from ...bots.figures import quantile
from ...bots.records import BotKind, count_bots
from ...bots.server import Server
from ...bots.site import Person, Site
from ..harness import Progress, Values
from .browser import key_to_image_ms, walking
from .crew import CrewSettings, resumed_elsewhere, staffed

if TYPE_CHECKING:
    from playwright.sync_api import Page

_KEYS = 3
"""Number of keys pressed in the browser before each restart."""
_BACK_S = 90.0
"""Longest wait until a browser is back, seconds."""


class RestartSettings(CrewSettings):
    """Number of restarts, and the bots."""

    restarts: int = 4
    """Number of restarts, by SIGTERM and SIGINT in turn."""
    bots: int = 20
    kinds: tuple[BotKind, ...] = ("random", "slow")
    acted_keys: int = 50
    """Number of acknowledged keys before each restart."""
    with_browser: bool = True
    """Whether a real browser takes part, if there is one."""
    seed: int = 19

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return f"{self.restarts} times, by SIGTERM and SIGINT in turns, {self.bots} bots online."


def measure_restarts(settings: RestartSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Ends the program as a host does, restarts it on the same folder and port, and waits for everybody.

    Returns:
        `drain_s`, the longest time from the signal until the serving process has ended, and `processes_left`, which
        were still there then; `start_s`, the median from the restart until it serves; `reconnect_s`, the longest from
        then until all bots, and the browser, stand in their trials; `lost`, keys and steps that were acknowledged and
        are not on disk; `resumes`, returns of bots that could be compared with the records, and `resumed_elsewhere`,
        returns that showed another step, the browser's included; `browser_returns`, how often the browser's page came
        back by itself (None = there is no browser).
    """
    with staffed(folder, dataset, settings, spare=1) as (server, site, bots):
        tally, last = _Tally(server), site.people(("pan",))[-1]
        with _browser(site, last, wanted=settings.with_browser, progress=progress) as visitor:
            bots.arrive()
            bots.begin()
            for number in range(settings.restarts):
                end = (signal.SIGTERM, signal.SIGINT)[number % 2]
                progress(f"restart {number + 1} of {settings.restarts}, by {end.name}")
                bots.await_acks(settings.acted_keys)
                visitor.walk()
                tally.restart(end, bots, visitor)
            bots.await_acks(settings.bots)
            bots.leave()
        found = count_bots(site.folder, bots.logs)
        resumes, elsewhere = resumed_elsewhere(site.folder, bots.logs)
    return {
        "participants": settings.bots + (visitor.page is not None),
        "restarts": settings.restarts,
        "drain_s": max(tally.drains_s),
        "processes_left": tally.num_left,
        "start_s": quantile(tally.starts_s, 0.5),
        "reconnect_s": max(tally.returns_s),
        "lost": len(found.lost),
        "duplicated": found.duplicated,
        "resumes": resumes,
        "resumed_elsewhere": len(elsewhere) + len(visitor.problems),
        "browser_returns": visitor.num_returns if visitor.page is not None else None,
        "problems": (*bots.problems, *found.lost, *elsewhere, *visitor.problems),
    }


class _Tally:
    """The restarts, and their times."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self.num_left = 0
        self.drains_s: list[float] = []
        self.starts_s: list[float] = []
        self.returns_s: list[float] = []

    def restart(self, end: signal.Signals, bots: Crowd, visitor: "_Visitor") -> None:
        """Ends and restarts the program, and waits for everybody."""
        processes = [psutil.Process(self._server.pid), *self._server.workers]
        connections = [log.num_connections for log in bots.logs]
        self.drains_s.append(self._server.end(end))
        self.num_left += sum(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in processes)
        began_s = time.perf_counter()
        self._server.start()
        served_s = time.perf_counter()
        bots.await_all_here(connections)
        visitor.await_return()
        self.starts_s.append(served_s - began_s)
        self.returns_s.append(time.perf_counter() - served_s)


class _Visitor:
    """A participant in a real browser, or nobody."""

    def __init__(self, folder: Path, code: str, page: "Page | None") -> None:
        self.page, self.num_returns = page, 0
        self.problems: list[str] = []
        self._folder, self._code = folder, code
        self._reconnects = 0

    def walk(self) -> None:
        """Presses a few keys, waiting for the picture of each."""
        if self.page is not None:
            key_to_image_ms(self.page, num_keys=_KEYS, warm_ups=0)
            self._reconnects = self._stored()[0]

    def await_return(self) -> None:
        """Waits until the records show that the page came back by itself, then checks that a key works."""
        if self.page is None:
            return
        from playwright.sync_api import TimeoutError as TooLateError

        deadline_s = time.perf_counter() + _BACK_S
        while self._stored()[0] <= self._reconnects:
            if time.perf_counter() > deadline_s:
                said = " ".join(self.page.inner_text("body").split())[:200]
                self.problems.append(f"browser: is not back within {_BACK_S:g} s; its page says {said!r}")
                return
            self.page.wait_for_timeout(100)
        steps = self._stored()[1]
        with contextlib.suppress(TooLateError):
            self.page.locator(f'img[data-step="{steps}"]').wait_for(timeout=1e3 * _BACK_S)
        answered = key_to_image_ms(self.page, num_keys=1, warm_ups=0)
        self.num_returns += bool(answered)
        found = self._stored()[1]
        if not answered or found != steps + 1:
            self.problems.append(
                f"browser: {len(answered)} keys answered, {found} steps stored, {steps} before the key"
            )

    def _stored(self) -> tuple[int, int]:
        """(returns, steps) stored for the first trial."""
        with read_study(self._folder) as reader:
            trial_id = reader.trials(self._code)[0].trial_id
            events = [line.event for line in reader.events(trial_id)] if trial_id is not None else []
        ways = sum(isinstance(event, Reconnect) for event in events)
        return ways, sum(isinstance(event, Act) for event in events)


@contextlib.contextmanager
def _browser(site: Site, person: Person, *, wanted: bool, progress: Progress) -> Iterator[_Visitor]:
    with contextlib.ExitStack() as stack:
        page = None
        if wanted:
            try:
                page = stack.enter_context(walking(person.link, load_study(site.folder)))
            except MissingDependencyError as error:
                progress(f"No browser among the participants: {error}")
        yield _Visitor(site.folder, person.code, page)
