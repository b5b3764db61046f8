"""The measures of a report: how each is shown and tested, and its value for a run's trial or a row of the study."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim.tasks.run_files import FAR_FROM_VIEW, Answer, EpisodeRun
from sim.types import MAX_STEPS, SuccessRule, TaskKind

from ..export.trial_table import TrialRow, measured

STEP_LIMITS = (25, 50, 100, 200, 300, 400, 500)
"""Steps of the anytime success rate: success within each of these."""
STRICT, FAR = "sr_strict", "far_from_view"
"""Columns: success by rule `paper-strict`, and whether a success by `paper` ends far from every view point."""
_BOTH: tuple[TaskKind, ...] = ("pan", "pog")
_PAN: tuple[TaskKind, ...] = ("pan",)


@dataclass(frozen=True, slots=True)
class Measure:
    """One figure of a trial: percent, metres, steps or seconds."""

    head: str
    """Heading of its table; empty for measures that share one table."""
    tasks: tuple[TaskKind, ...] = _BOTH
    claim: str = ""
    """Its name in hypotheses of a study file; empty where they cannot name it."""
    digits: int = 1
    """Decimals that a reader needs."""
    is_rate: bool = False
    """Whether each trial has 100 or 0, so that k of n can be given."""
    most: float = math.inf
    """Largest value that a trial can have; the least is 0. Intervals end there."""
    is_skewed: bool = False
    """Whether a few trials are many times as large as the rest: its intervals are built on the log scale."""
    has_spread: bool = False
    """Whether its quartiles are shown."""
    has_effect: bool = False
    """Whether effects of conditions and of the order are looked for."""


WITHIN = {f"sr_within_{limit}": Measure("", _PAN, is_rate=True, most=100) for limit in STEP_LIMITS}
"""The anytime success rate, by name."""
WAYS = {
    "dtw": Measure("DTW to the shortest path (m per place)", _PAN, digits=2),
    "ndtw": Measure("nDTW with the shortest path", _PAN, digits=2, most=1),
    "end_apart": Measure("end to the end of the shortest path (m)", _PAN, digits=2),
}
"""How far a trial's way is from the shortest path, by name; `ways` fills them in where the homes are at hand."""
MEASURES: dict[str, Measure] = {
    "sr": Measure("SR (%)", claim="SR", is_rate=True, most=100, has_effect=True),
    "spl": Measure("SPL (%)", _PAN, claim="SPL", most=100, has_effect=True),
    "soft_spl": Measure("soft SPL (%)", _PAN, claim="SoftSPL", most=100),
    "dtg": Measure("DTG (m)", _PAN, claim="DTG", digits=2, has_spread=True),
    "on_object": Measure("clicks on the object itself (%)", ("pog",), is_rate=True, most=100),
    "distance": Measure(
        "distance to the goal's centre (m)", ("pog",), digits=2, is_skewed=True, has_spread=True, has_effect=True
    ),
    "steps": Measure(
        "steps to decision", _PAN, claim="steps", most=MAX_STEPS, is_skewed=True, has_spread=True, has_effect=True
    ),
    "path_m": Measure("path (m)", _PAN, digits=2, is_skewed=True, has_spread=True),
    **WAYS,
    "t_s": Measure("time to decision (s)", claim="time", is_skewed=True, has_spread=True, has_effect=True),
    **WITHIN,
    STRICT: Measure("SR by rule paper-strict (%)", _PAN, is_rate=True, most=100),
    FAR: Measure(
        f"successes by rule paper that end more than {FAR_FROM_VIEW:g} m of walking from every view point (%)",
        _PAN,
        is_rate=True,
        most=100,
    ),
    "t_look_s": Measure("look at the home or its map before (s)", is_skewed=True, has_spread=True),
}
"""Measures by the name of their column, in the order of the report."""


def measures_of(task: TaskKind) -> tuple[str, ...]:
    """Names of a task's measures, in the order of the report."""
    return tuple(name for name, measure in MEASURES.items() if task in measure.tasks)


def run_figures(item: EpisodeRun | Answer, rule: SuccessRule) -> dict[str, float | None] | str:
    """Figures by measure, or the reason why the trial does not count."""
    end = item.end if isinstance(item, EpisodeRun) else item
    if end.reason == "technical":
        return "technical failure"
    plain = measured(end, rule)
    if not plain:
        return "never scored"
    if isinstance(item, Answer):
        return _figures("pog", plain) | {"t_s": item.t_s if item.participant is not None else None}
    if "success" not in plain:
        return f"no usable point under rule {rule}"
    assert item.end.measures is not None
    strict, is_far = item.end.measures.rules["paper-strict"], item.end.measures.ends_far_from_view
    # run files hold no end time but that of the last step, and a trial that was given up does not end with a step
    has_time = item.start.participant is not None and item.end.reason in ("stop", "steps") and item.steps
    return _figures("pan", plain) | {
        "t_s": item.steps[-1].t_s if has_time else None,
        STRICT: None if strict is None else 100.0 * strict.success,
        FAR: None if is_far is None else 100.0 * is_far,
    }


def row_figures(row: TrialRow, *, same_rule: bool) -> dict[str, float | None] | str:
    """Figures of a trial that has only a row, or the reason why it does not count."""
    if not same_rule:
        return "excluded; its row is under another success rule"
    return "never scored" if row.success is None else _figures(row.task, dict(row))


def row_times(row: TrialRow) -> dict[str, float | None]:
    """Time to decision, from the start of the task to the trial's end, however it ended, and the look before it."""
    total_s = row.t_total_s
    return {"t_s": None if total_s is None else total_s - (row.t_look_s or 0.0), "t_look_s": row.t_look_s}


def _figures(task: TaskKind, plain: Mapping[str, Any]) -> dict[str, float | None]:
    """The report's measures from the plain figures of a run's trial or of an exported row."""
    hit = bool(plain["success"])
    if task == "pog":
        on_object = plain.get("on_object")
        figures = {"sr": 100.0 * hit, "distance": plain["planar_distance"]}
        return figures | {"on_object": None if on_object is None else 100.0 * on_object}
    steps = plain["n_steps"] or 0
    spl, soft_spl = (None if plain[name] is None else 100.0 * plain[name] for name in ("spl", "softspl"))
    figures = {"sr": 100.0 * hit, "spl": spl, "soft_spl": soft_spl, "dtg": plain["dtg"], "steps": float(steps)}
    within = {name: 100.0 * (hit and steps <= limit) for name, limit in zip(WITHIN, STEP_LIMITS, strict=True)}
    return {**figures, "path_m": plain["path_m"], **within}
