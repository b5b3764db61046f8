"""What came of bots: how fast the study answered, and whether it kept everything."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.render.raycast import own_cores
from sim.types import TaskKind

from .count import KeyCount
from .log import BotKind, BotLog, Pointed, Press


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


def figures_of(
    logs: Sequence[BotLog], counted: KeyCount, spent: Spent, *, kinds: Sequence[BotKind], rate: float
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
        server_cpu_ms_per_action=None if server_s is None else 1e3 * server_s / num_actions,
        bots_cpu_ms_per_action=1e3 * spent.bots_cpu_s / num_actions,
        cores=own_cores(),
        actions_per_s_per_core=counted.sent / spent.elapsed_s / own_cores(),
        load_before=spent.load_before,
        tasks=dict(Counter(log.task for log in logs)),
        clicks=counted.clicks,
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
