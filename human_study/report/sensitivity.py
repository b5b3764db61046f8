"""Checks whether the main figures hold when trials are counted in other ways (HUMAN_STUDY.md, section 8)."""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace

from pandas import concat

from sim.types import SPLITS

from ..export.runs import run_condition
from ..export.trial_table import TrialRow
from .rows import Aggregate, estimate_of, no_interval
from .trials import Frame, GroupRow, TrialGroup, trial_frame

FIRST_TRIALS = 10
"""One row leaves out this many first trials, in which people get used to the keys."""
MAIN = "intention to treat (as in the tables)"


class SensitivityRow(GroupRow):
    """The total success rate, counted in one way."""

    way: str
    value: float | None = None
    """Percent, or percent points for differences; None = no trial is left, or not all splits; `method` says which."""
    low: float | None = None
    high: float | None = None
    k: int | None
    n: int
    method: str


def sensitivity_rows(
    group: TrialGroup, rows: Sequence[TrialRow], aggregate: Aggregate, *, splits: AbstractSet[str]
) -> list[SensitivityRow]:
    """The group's total success rate in each way of counting; of people, or of people minus an agent.

    Args:
        group: People, or differences of people's trials.
        rows: Rows of the study's trials; () = they are missing, and the rows that need them say so.
        splits: Splits of the table in which the group stands. A rate over others is no total beside its totals.
    """
    trials = group.trials
    ways = {MAIN: trials}
    if rows:
        ways |= {
            "per protocol: without excluded trials and people": trials[trials["excluded"] == ""],
            f"without each person's first {FIRST_TRIALS} trials": trials[trials["place"] > FIRST_TRIALS],
            "verified trials only": trials[trials["verification"] == "verified"],
        }
        if group.kind != "difference":
            ways["technical failures as failures"] = _with_failures(group, rows, "technical")
            ways["abandoned and never ended trials as failures"] = _with_failures(group, rows, "abandoned")
    found = [_row(group, way, counted, aggregate, splits) for way, counted in ways.items()]
    if aggregate.intervals == "homes":
        way, other = (
            "in these homes only: people and episodes random (two-way)",
            replace(aggregate, intervals="episodes"),
        )
    else:
        way, other = "homes random too (three-way)", replace(aggregate, intervals="homes")
    return [*found, _row(group, way, trials, other, splits)]


def _with_failures(group: TrialGroup, rows: Sequence[TrialRow], reason: str) -> Frame:
    """The trials, with a failure in place of the later attempt of each person whose trial ended for this reason."""
    prefix = group.trials["participant"].iloc[0].rpartition("/")[0]
    failed = {}
    for row in rows:
        is_theirs = row.task == group.task and run_condition(row.condition) == group.condition
        is_such = row.end_reason == reason or (reason == "abandoned" and row.is_never_ended)
        if row.phase == "main" and is_such and is_theirs and row.scene_kind == group.scene_kind:
            person = f"{prefix}/{row.participant}"
            failed[person, str(row.key)] = {"key": row.key, "participant": person, "sr": 0.0}
    names = zip(group.trials["participant"], group.trials["episode"], strict=True)
    kept = group.trials[[name not in failed for name in names]]
    return concat([kept, trial_frame(failed.values())]) if failed else kept


def _row(group: TrialGroup, way: str, trials: Frame, aggregate: Aggregate, splits: AbstractSet[str]) -> SensitivityRow:
    """The rate of these trials."""
    known = trials[trials["sr"].notna()]
    is_difference = group.kind == "difference"
    counts = {"way": way, "k": None if is_difference else int((known["sr"] == 100).sum()), "n": len(known)}
    if known.empty:
        return SensitivityRow(**group.names, **counts, method="no such trials")
    for word, odd in (("lacks", splits - set(known["split"])), ("adds", set(known["split"]) - splits)):
        if odd:
            method = f"no total: {word} {', '.join(split for split in SPLITS if split in odd)}"
            return SensitivityRow(**group.names, **counts, method=method)
    estimate = estimate_of(known, "sr", aggregate, is_difference=is_difference)
    method = estimate.interval.method if estimate.interval else no_interval(known, aggregate)
    return SensitivityRow(
        **group.names, **counts, value=estimate.value, low=estimate.low, high=estimate.high, method=method
    )
