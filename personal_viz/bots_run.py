"""Lets many bots take part at once and says what came of it."""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from human_study.study import load_study
from sim.errors import StudyError
from sim.world.raycast import own_cores

from .bots import Bot, BotKind, BotLog, Press
from .bots_count import count_keys
from .bots_flow import right_answers
from .bots_site import Site, cpu_seconds
from .bots_way import WayFinder

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
    """Elapsed, from the first key to the last bot's leaving."""
    actions: int
    """Keys that were sent."""
    actions_per_s: float
    frames: int
    """Pictures received."""
    ack_p50_ms: float | None
    """From sending a key to the step counter that follows its commit: the key and its step are on disk."""
    ack_p95_ms: float | None
    ack_max_ms: float | None
    key_to_frame_p50_ms: float | None
    """From sending a key to its picture."""
    key_to_frame_p95_ms: float | None
    unanswered: int
    """Keys whose picture did not come in time, connections that ended left out."""
    lost: int
    """Keys that were sent and are not in the database, those left out that were on their way when a bot hung up."""
    duplicated: int
    """Keys that are in the database more than once."""
    unknown: int
    """Keys in the database that no bot sent."""
    cut_off: int
    """Keys that were on their way when a bot hung up, and are not in the database."""
    dropped: dict[str, int]
    """Keys in the database that had no effect, by reason."""
    rate_limited: Literal[0] = 0
    """Keys over the gateway's rate limit; bots stay below it, so that every key has to be stored."""
    connections: int
    problems: tuple[str, ...]
    """Why bots ended early, and which keys were lost."""
    server_cpu_ms_per_action: float | None
    """CPU milliseconds of gateway and workers; None where the serving process is not ours."""
    bots_cpu_ms_per_action: float
    cores: int
    """That this machine lets us use; bots and server share them."""
    actions_per_s_per_core: float
    load_before: float
    """The machine's load average of the last minute when the bots began: others work on it too."""


def run_bots(
    site: Site,
    *,
    participants: int,
    seconds: float,
    rate: float,
    kinds: Sequence[BotKind],
    seed: int,
    progress: Callable[[str], None] = lambda _: None,
    on_acting: Callable[[], None] = lambda: None,
) -> BotFigures:
    """Everybody comes in and answers the pages; then all press keys for so many seconds.

    Args:
        site: The study that is being served.
        participants: How many of its PAN participants.
        seconds: From the first key on.
        rate: Actions per second and bot.
        kinds: Dealt out in turns.
        seed: Of the bots' choices.
        progress: Told what is done now.
        on_acting: Called when all are in and the first key is pressed.

    Raises:
        StudyError: The study has too few PAN participants, a bot is not let in, or the database is damaged.
    """
    if len(site.links) < participants:
        raise StudyError(
            f"{site.folder}: has {len(site.links)} PAN participants; expected at least {participants}. "
            "Plan more, or give a smaller --participants."
        )
    answers = right_answers(load_study(site.folder))
    finder = WayFinder(site) if "shortest" in kinds else None
    bots = []
    for number, (code, link) in enumerate(list(site.links.items())[:participants]):
        kind = kinds[number % len(kinds)]
        way = finder.way if finder is not None and kind == "shortest" else None
        bots.append(Bot(code, link, kind, rate=rate, seed=seed + number, answers=answers, way=way))
    return asyncio.run(
        _run(site, bots, seconds=seconds, rate=rate, kinds=kinds, progress=progress, on_acting=on_acting)
    )


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
    counted = await asyncio.to_thread(count_keys, site.folder, logs)
    num_actions = max(1, counted.sent)
    acks, shown = _times_ms(logs, lambda press: press.counted_s), _times_ms(logs, lambda press: press.shown_s)
    return BotFigures(
        participants=len(bots),
        kinds=tuple(kinds),
        rate=rate,
        seconds=elapsed_s,
        actions=counted.sent,
        actions_per_s=counted.sent / elapsed_s,
        frames=sum(log.num_frames for log in logs),
        ack_p50_ms=quantile(acks, 0.5),
        ack_p95_ms=quantile(acks, 0.95),
        ack_max_ms=quantile(acks, 1.0),
        key_to_frame_p50_ms=quantile(shown, 0.5),
        key_to_frame_p95_ms=quantile(shown, 0.95),
        unanswered=sum(log.num_unanswered for log in logs),
        lost=counted.lost,
        duplicated=counted.duplicated,
        unknown=counted.unknown,
        cut_off=counted.cut_off,
        dropped=counted.dropped,
        connections=sum(log.num_connections for log in logs),
        problems=(
            *(f"{log.code} ({log.kind}): {log.problem}" for log in logs if log.problem),
            *(f"lost {key}" for key in counted.lost_keys),
        ),
        server_cpu_ms_per_action=None if served_cpu is None else 1e3 * served_cpu / num_actions,
        bots_cpu_ms_per_action=1e3 * own_cpu / num_actions,
        cores=own_cores(),
        actions_per_s_per_core=counted.sent / elapsed_s / own_cores(),
        load_before=load_before,
    )


def quantile(values: Sequence[float], share: float) -> float | None:
    """A quantile, interpolated; None of nothing."""
    return float(np.quantile(values, share)) if values else None


def _times_ms(logs: Sequence[BotLog], moment: Callable[[Press], float | None]) -> list[float]:
    found = []
    for log in logs:
        for press in log.presses:
            at_s = moment(press)
            if at_s is not None:
                found.append(1e3 * (at_s - press.sent_s))
    return found
