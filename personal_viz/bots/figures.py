"""The figures of a crowd of bots: how fast the study answered, and whether anything was lost."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.render.raycast import own_cores
from sim.types import TaskKind

from .records import BotCount, BotKind, BotLog


class BotFigures(BaseModel):
    """The document that `study bots --json` prints. Times are measured at the bots' websockets, without a browser."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    participants: int
    kinds: tuple[BotKind, ...]
    rate: float
    """Actions per second asked of each bot; slow bots act at a quarter of it."""
    seconds: float
    """Elapsed from the first key or click until the last bot has left."""
    actions: int
    """Keys and clicks that were sent (`clicks` counts the latter)."""
    actions_per_s: float
    frames: int
    """Pictures of the robots' cameras received."""
    ack_p50_ms: float | None
    """From sending a key to the step counter that follows its commit: the key and its step are on disk."""
    ack_p95_ms: float | None
    ack_max_ms: float | None
    key_to_frame_p50_ms: float | None
    """From sending a key to its picture."""
    key_to_frame_p95_ms: float | None
    unanswered: int
    """Keys, clicks and answers whose effect did not come in time, without those of connections that ended."""
    lost: int
    """Keys, clicks and answers that were sent and are not in the database, without `cut_off`."""
    duplicated: int
    """Those that are in the database more than once."""
    unknown: int
    """Those in the database that no bot sent."""
    cut_off: int
    """Those that were on their way when a bot hung up, and are not in the database."""
    dropped: dict[str, int]
    """Those without effect, by the reason in the database."""
    rate_limited: Literal[0] = 0
    """Messages over the gateway's rate limit; bots stay below it, so that everything has to be stored."""
    connections: int
    problems: tuple[str, ...]
    """Why bots ended early, and what was lost."""
    server_cpu_ms_per_action: float | None
    """CPU milliseconds of gateway and workers; None if the serving process is not ours."""
    bots_cpu_ms_per_action: float
    cores: int
    """Number of cores that this process may use; bots and server share them."""
    actions_per_s_per_core: float
    load_before: float
    """The machine's load average of the last minute when the bots began: others work on it too."""
    tasks: dict[TaskKind, int] = {}
    """Number of bots in each task."""
    clicks: int = 0
    """Clicks of POG bots that were sent, and presses that move the mark."""
    answers: int = 0
    """Confirmed marks in the database."""
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
    """Time that a run took."""

    elapsed_s: float
    bots_cpu_s: float
    server_cpu_s: float | None
    """CPU seconds of gateway and workers; None if the serving process is not ours."""
    load_before: float


def figures_of(
    logs: Sequence[BotLog], counted: BotCount, spent: Spent, *, kinds: Sequence[BotKind], rate: float
) -> BotFigures:
    """The figures of a run.

    Args:
        logs: The logs of all bots.
        counted: What the database holds of them.
        spent: Time that the run took.
        kinds: As asked for.
        rate: As asked for.
    """
    num_actions, server_s = max(1, counted.sent), spent.server_cpu_s
    presses = [press for log in logs for press in log.presses]
    points = [point for log in logs for point in log.points]
    return BotFigures(
        participants=len(logs),
        kinds=tuple(kinds),
        rate=rate,
        seconds=spent.elapsed_s,
        actions=counted.sent,
        actions_per_s=counted.sent / spent.elapsed_s,
        frames=sum(log.num_frames for log in logs),
        **quantiles_ms("ack", [press.counted_ms for press in presses], 50, 95, 100),
        **quantiles_ms("key_to_frame", [press.shown_ms for press in presses], 50, 95),
        unanswered=sum(log.num_unanswered for log in logs),
        lost=len(counted.lost),
        duplicated=counted.duplicated,
        unknown=counted.unknown,
        cut_off=counted.cut_off,
        dropped=dict(sorted(counted.dropped.items())),
        connections=sum(log.num_connections for log in logs),
        problems=(*problems_of(logs), *(f"lost {key}" for key in counted.lost)),
        server_cpu_ms_per_action=None if server_s is None else 1e3 * server_s / num_actions,
        bots_cpu_ms_per_action=1e3 * spent.bots_cpu_s / num_actions,
        cores=own_cores(),
        actions_per_s_per_core=counted.sent / spent.elapsed_s / own_cores(),
        load_before=spent.load_before,
        tasks=dict(Counter(log.task for log in logs)),
        clicks=len(points),
        answers=counted.answers,
        **quantiles_ms("click_to_mark", [point.shown_ms for point in points], 50, 95, 100),
        finished=sum(log.is_finished for log in logs),
        resting=sum(log.is_resting for log in logs),
    )


def problems_of(logs: Sequence[BotLog]) -> tuple[str, ...]:
    """Why bots ended early."""
    return tuple(f"{log.code} ({log.kind}): {log.problem}" for log in logs if log.problem)


def quantile(values: Sequence[float | None], share: float) -> float | None:
    """An interpolated quantile of the values that are not None; None without any."""
    known = [value for value in values if value is not None]
    return float(np.quantile(known, share)) if known else None


def quantiles_ms(name: str, values: Sequence[float | None], *percents: int) -> dict[str, Any]:
    """Quantiles of milliseconds, or None, under their names such as `ack_p95_ms`; 100 % is `ack_max_ms`."""
    return {f"{name}_{'max' if p == 100 else f'p{p}'}_ms": quantile(values, p / 100) for p in percents}
