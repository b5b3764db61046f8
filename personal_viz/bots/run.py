"""Lets many bots take part at once and says what came of it."""

import asyncio
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.errors import StudyError
from sim.render.raycast import own_cores
from sim.types import TaskKind

from .homes import BotHomes
from .pan import PanBot
from .pog import PogBot
from .records import BotCount, BotKind, BotLog, Pointed, Press, count_bots
from .site import Person, Site, cpu_seconds
from .walker import Bot

_ARRIVE_TOGETHER = 10
"""Bots that come in at the same time."""


class BotFigures(BaseModel):
    """What `study bots --json` prints. Times are taken at the bots, on the websocket, without a browser."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    participants: int
    kinds: tuple[BotKind, ...]
    rate: float
    """Actions per second of each bot, asked for; slow bots act at a quarter of it."""
    seconds: float
    """Elapsed, from the first key or click to the last bot's leaving."""
    actions: int
    """Keys that were sent, and clicks (`clicks`)."""
    actions_per_s: float
    frames: int
    """Pictures of robots' cameras received."""
    ack_p50_ms: float | None
    """From sending a key to the step counter that follows its commit: the key and its step are on disk."""
    ack_p95_ms: float | None
    ack_max_ms: float | None
    key_to_frame_p50_ms: float | None
    """From sending a key to its picture."""
    key_to_frame_p95_ms: float | None
    unanswered: int
    """Keys, clicks and answers whose effect was not seen in time, connections that ended left out."""
    lost: int
    """Keys, clicks and answers that were sent and are not in the database, those left out that were on their way when a
    bot hung up."""
    duplicated: int
    """Those that are in the database more than once."""
    unknown: int
    """Those in the database that no bot sent."""
    cut_off: int
    """Those that were on their way when a bot hung up, and are not in the database."""
    dropped: dict[str, int]
    """Those that had no effect, by the reason in the database."""
    rate_limited: Literal[0] = 0
    """Messages over the gateway's rate limit; bots stay below it, so that everything has to be stored."""
    connections: int
    problems: tuple[str, ...]
    """Why bots ended early, and what was lost."""
    server_cpu_ms_per_action: float | None
    """CPU milliseconds of gateway and workers; None where the serving process is not ours."""
    bots_cpu_ms_per_action: float
    cores: int
    """That this machine lets us use; bots and server share them."""
    actions_per_s_per_core: float
    load_before: float
    """The machine's load average of the last minute when the bots began: others work on it too."""
    tasks: dict[TaskKind, int] = {}
    """How many took part in each task."""
    clicks: int = 0
    """Clicks of POG bots that were sent, and presses that move the mark."""
    answers: int = 0
    """Marks that they confirmed, in the database."""
    click_to_mark_p50_ms: float | None = None
    """From sending a click to its mark, which is shown when it is on disk."""
    click_to_mark_p95_ms: float | None = None
    click_to_mark_max_ms: float | None = None
    finished: int = 0
    """Bots that have no trial left."""
    resting: int = 0
    """Bots whom the study asked to come back later."""


@dataclass(frozen=True, slots=True)
class Spent:
    """What the bots' part of a run took."""

    elapsed_s: float
    bots_cpu_s: float
    server_cpu_s: float | None
    """Of gateway and workers; None where the serving process is not ours."""
    load_before: float


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
    """Everybody comes in and answers the pages; then all do their trials until the time is up or they have finished.

    Args:
        site: The study that is being served.
        participants: How many of those who do one of the tasks, in the plan's order.
        seconds: From the first key on.
        rate: Actions per second and bot.
        kinds: Dealt out in turns, in each task by itself.
        seed: Of the bots' choices.
        tasks: Whom bots stand for.
        progress: Told what is done now.
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
    bots = _bots(site, people[:participants], rate=rate, kinds=kinds, seed=seed)
    return asyncio.run(
        _run(site, bots, seconds=seconds, rate=rate, kinds=kinds, progress=progress, on_acting=on_acting)
    )


def _bots(site: Site, people: Sequence[Person], *, rate: float, kinds: Sequence[BotKind], seed: int) -> list[Bot]:
    """A bot for each of the people."""
    homes = BotHomes(site)
    numbers: Counter[TaskKind] = Counter()
    bots: list[Bot] = []
    for number, person in enumerate(people):
        kind = kinds[numbers[person.task] % len(kinds)]
        numbers[person.task] += 1
        make = PanBot if person.task == "pan" else PogBot
        bots.append(make(person, kind, homes, rate=rate, seed=seed + number))
    return bots


async def _run(
    site: Site,
    bots: Sequence[Bot],
    *,
    seconds: float,
    rate: float,
    kinds: Sequence[BotKind],
    progress: Callable[[str], None],
    on_acting: Callable[[], None],
) -> BotFigures:
    progress(f"{len(bots)} bots come in")
    for first in range(0, len(bots), _ARRIVE_TOGETHER):
        await asyncio.gather(*(bot.arrive() for bot in bots[first : first + _ARRIVE_TOGETHER]))
    progress(f"all are in; they act for {seconds:g} s")
    load_before = os.getloadavg()[0]
    served_cpu = cpu_seconds(site.pid) if site.pid is not None else None
    on_acting()
    own_cpu, began_s = time.process_time(), time.perf_counter()
    await asyncio.gather(*(bot.act(began_s + seconds) for bot in bots))
    elapsed_s, own_cpu = time.perf_counter() - began_s, time.process_time() - own_cpu
    if served_cpu is not None and site.pid is not None:
        served_cpu = cpu_seconds(site.pid) - served_cpu
    progress("comparing with the database")
    logs = [bot.log for bot in bots]
    counted = await asyncio.to_thread(count_bots, site.folder, logs)
    return figures_of(logs, counted, Spent(elapsed_s, own_cpu, served_cpu, load_before), kinds=kinds, rate=rate)


def figures_of(
    logs: Sequence[BotLog], counted: BotCount, spent: Spent, *, kinds: Sequence[BotKind], rate: float
) -> BotFigures:
    """The figures of a run.

    Args:
        logs: What the bots did, all who took part.
        counted: What the database holds of it.
        spent: Time.
        kinds: As asked for.
        rate: As asked for.
    """
    num_actions = max(1, counted.sent)
    presses = [press for log in logs for press in log.presses]
    acks = _times_ms((press, press.counted_s) for press in presses)
    shown = _times_ms((press, press.shown_s) for press in presses)
    marks = _times_ms((pointed, pointed.shown_s) for log in logs for pointed in log.points)
    server_s = spent.server_cpu_s
    return BotFigures(
        participants=len(logs),
        kinds=tuple(kinds),
        rate=rate,
        seconds=spent.elapsed_s,
        actions=counted.sent,
        actions_per_s=counted.sent / spent.elapsed_s,
        frames=sum(log.num_frames for log in logs),
        ack_p50_ms=quantile(acks, 0.5),
        ack_p95_ms=quantile(acks, 0.95),
        ack_max_ms=quantile(acks, 1.0),
        key_to_frame_p50_ms=quantile(shown, 0.5),
        key_to_frame_p95_ms=quantile(shown, 0.95),
        unanswered=sum(log.num_unanswered for log in logs),
        lost=len(counted.lost),
        duplicated=counted.duplicated,
        unknown=counted.unknown,
        cut_off=counted.cut_off,
        dropped=dict(sorted(counted.dropped.items())),
        connections=sum(log.num_connections for log in logs),
        problems=(
            *(f"{log.code} ({log.kind}): {log.problem}" for log in logs if log.problem),
            *(f"lost {key}" for key in counted.lost),
        ),
        server_cpu_ms_per_action=None if server_s is None else 1e3 * server_s / num_actions,
        bots_cpu_ms_per_action=1e3 * spent.bots_cpu_s / num_actions,
        cores=own_cores(),
        actions_per_s_per_core=counted.sent / spent.elapsed_s / own_cores(),
        load_before=spent.load_before,
        tasks=dict(Counter(log.task for log in logs)),
        clicks=sum(len(log.points) for log in logs),
        answers=counted.answers,
        click_to_mark_p50_ms=quantile(marks, 0.5),
        click_to_mark_p95_ms=quantile(marks, 0.95),
        click_to_mark_max_ms=quantile(marks, 1.0),
        finished=sum(log.is_finished for log in logs),
        resting=sum(log.is_resting for log in logs),
    )


def quantile(values: Sequence[float], share: float) -> float | None:
    """A quantile, interpolated; None of nothing."""
    return float(np.quantile(values, share)) if values else None


def _times_ms(answered: Iterable[tuple[Press | Pointed, float | None]]) -> list[float]:
    return [1e3 * (at_s - sent.sent_s) for sent, at_s in answered if at_s is not None]
