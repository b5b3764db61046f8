"""Checks whether the main figures hold when trials are counted in other ways (HUMAN_STUDY.md, section 8)."""

from collections.abc import Sequence
from dataclasses import replace

from pandas import concat

from ..export.runs import run_condition
from ..export.trial_table import TrialRow
from .rows import Aggregate, counted_trials, estimate_of
from .statistics import Interval, mean_interval, numbered, rate_interval
from .trials import Frame, GroupRow, TrialGroup, row_key, trial_frame

FIRST_TRIALS = 10
"""One row leaves out this many first trials, in which people get used to the keys."""
MAIN = "intention to treat (as in the tables)"


class SensitivityRow(GroupRow):
    """The total success rate, counted in one way."""

    way: str
    value: float | None
    """Percent, or percent points for differences; None = no trial is left, and `method` says why."""
    low: float | None
    high: float | None
    k: int | None
    n: int
    method: str


def sensitivity_rows(group: TrialGroup, rows: Sequence[TrialRow], aggregate: Aggregate) -> list[SensitivityRow]:
    """The group's total success rate in each way of counting; of people, or of people minus an agent.

    Args:
        group: People, or differences of people's trials.
        rows: Rows of the study's trials; () = they are missing, and the rows that need them say so.
        aggregate: How cells and totals are averaged, as in the tables.
    """
    trials = group.trials
    ways = {MAIN: trials}
    if rows:
        ways |= {
            "per protocol: without excluded trials and people": trials[trials["excluded"] == ""],
            f"without each person's first {FIRST_TRIALS} trials": trials[trials["place"] > FIRST_TRIALS],
            "verified trials only": trials[trials["verification"] == "verified"],
        }
        if " - " not in group.who:
            ways["technical failures as failures"] = _with_failures(group, rows, "technical")
            ways["abandoned and never ended trials as failures"] = _with_failures(group, rows, "abandoned")
    return [*(_counted(group, way, found, aggregate) for way, found in ways.items()), _by_house(group, aggregate)]


def _with_failures(group: TrialGroup, rows: Sequence[TrialRow], reason: str) -> Frame:
    """The trials, with a failure in place of the later attempt of each person whose trial ended for this reason."""
    prefix = group.trials["participant"].iloc[0].rpartition("/")[0]
    failed = {}
    for row in rows:
        is_theirs = row.task == group.task and run_condition(row.condition) == group.condition
        is_such = row.end_reason == reason or (reason == "abandoned" and row.is_never_ended)
        if row.phase == "main" and is_such and is_theirs and row.scene_kind == group.scene_kind:
            person = f"{prefix}/{row.participant}"
            failed[person, str(row_key(row))] = {"key": row_key(row), "participant": person, "sr": 0.0}
    names = zip(group.trials["participant"], group.trials["episode"], strict=True)
    kept = group.trials[[name not in failed for name in names]]
    return concat([kept, trial_frame(failed.values())]) if failed else kept


def _counted(group: TrialGroup, way: str, trials: Frame, aggregate: Aggregate) -> SensitivityRow:
    if trials["sr"].isna().all():
        return _row(group, way, trials, None, "no such trials")
    estimate = estimate_of(trials, "sr", aggregate, is_share=" - " not in group.who)
    return _row(group, way, trials, estimate.value, estimate.interval or "no interval")


def _by_house(group: TrialGroup, aggregate: Aggregate) -> SensitivityRow:
    """The rate with homes as a third random factor; each episode lies in one home, so people by homes is enough."""
    way = "homes random too (three-way)"
    trials = group.trials[group.trials["sr"].notna()]
    if trials.empty:
        return _row(group, way, trials, None, "no such trials")
    found = counted_trials(trials, "sr", aggregate)
    if trials["scene"].nunique() == 1:
        return _row(group, way, trials, found.mean, "no interval: a single home")
    is_share = " - " not in group.who
    scale = 100.0 if is_share else 1.0
    by_house = replace(found, values=found.values / scale, episode_index=numbered(trials["scene"].tolist()))
    interval = rate_interval(by_house) if is_share else mean_interval(by_house)
    if interval is not None:
        interval = interval.model_copy(update={"low": scale * interval.low, "high": scale * interval.high})
    return _row(group, way, trials, found.mean, interval or "no interval")


def _row(group: TrialGroup, way: str, trials: Frame, value: float | None, interval: Interval | str) -> SensitivityRow:
    """A row of these trials; a text as `interval` is the reason why there is none."""
    has_interval = isinstance(interval, Interval)
    hits = trials["sr"].dropna()
    return SensitivityRow(
        **group.names,
        way=way,
        value=value,
        low=interval.low if has_interval else None,
        high=interval.high if has_interval else None,
        k=None if " - " in group.who else int((hits == 100).sum()),
        n=len(hits),
        method=interval.method if has_interval else interval,
    )
