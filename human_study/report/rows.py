"""One number of one row of a report's tables, with its interval; totals are made as the study declares."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from sim.errors import StudyError
from sim.homes.kind import scene_label
from sim.types import SPLITS, TaskKind

from .measures import MEASURES
from .statistics import Estimate, Interval, Trials, Weight, mean, rate, trials_of
from .trials import Frame, GroupKind, ReportValue, TrialGroup

TOTAL = "total"
TotalKind = Literal["mean_of_splits", "pooled", "dataset_weighted"]
RandomKind = Literal["homes", "episodes"]


@dataclass(frozen=True, slots=True)
class Aggregate:
    """How cells and totals are averaged, and what their intervals take for random (`aggregate` of the study file)."""

    total: TotalKind = "mean_of_splits"
    """`mean_of_splits` as in the paper, `pooled` over all trials, or `dataset_weighted` by the splits' sizes."""
    weight: Weight = "trials"
    split_sizes: Mapping[str, int] | None = None
    """Episodes of each split in the whole dataset; needed for `dataset_weighted`."""
    intervals: RandomKind = "homes"
    """`homes`: people, episodes and homes; times, paths and steps on the log scale. `episodes`: people and episodes."""

    def require_sizes(self) -> None:
        """Raises StudyError when the splits' sizes are needed and not known."""
        if self.total == "dataset_weighted" and not self.split_sizes:
            raise StudyError(
                "aggregate.total is 'dataset_weighted', but the sizes of the dataset's splits are not known; expected "
                "the dataset. Give --dataset."
            )


class ReportRow(ReportValue):
    """One number of one row of a table, with its interval."""

    task: TaskKind
    scene_kind: str
    who: str
    """A row's name; `human - AGENT` for differences on the same episodes."""
    kind: GroupKind
    condition: str
    split: str
    """A split, or `total` over the splits present, averaged as `aggregate` says."""
    measure: str
    """`sr`, `spl`, `soft_spl`, `sr_within_K` in percent, `dtg`, `distance`, `path_m` in metres, `steps`, `t_s`.

    `sr_strict` = percent of successes by rule `paper-strict`, over the trials that have it; `far_from_view` = percent
    of the successes by `paper` that end more than 1 m of walking from every view point. Trials that a rule excludes
    have neither. `on_object` = percent of POG answers whose click met the target itself. `dtw` (m per place), `ndtw`
    (0 to 1) and `end_apart` (m) compare the way with the shortest path.
    """
    value: float
    low: float | None
    high: float | None
    method: str
    """Method of the interval, or the reason why there is none."""
    k: int | None
    """Successes; None for other measures."""
    n: int
    """Trials."""
    num_participants: int
    """Number of people; an agent counts as one, because its runs are averaged first."""
    num_episodes: int
    num_homes: int
    share: float | None
    """Weight of a split's cell in its total; None = the total is not a mean of cells but of people's means."""
    scene_label: str
    """Label that results in these homes must carry; empty for scans."""


def rows_of(group: TrialGroup, aggregate: Aggregate, *, behind: TrialGroup | None = None) -> list[ReportRow]:
    """One row per measure and split, then its total; `behind` holds the trials before averaging, for k and n."""
    rows = []
    for measure in group.measures:
        known = group.trials.loc[group.trials[measure].notna(), [measure, "split", "participant", "episode", "scene"]]
        splits = [split for split in SPLITS if (known["split"] == split).any()]
        for split in [*splits, TOTAL]:
            found = known if split == TOTAL else known[known["split"] == split]
            counted = found[measure]
            if behind is not None:
                counted = behind.trials.loc[behind.trials["episode"].isin(found["episode"]), measure].dropna()
            share = _share(split, known, splits, aggregate)
            rows.append(_row(group, measure, split, found, counted, aggregate, share))
    return rows


def estimate_of(trials: Frame, measure: str, aggregate: Aggregate, *, is_difference: bool = False) -> Estimate:
    """Mean of a measure over at least one trial that has it, in its own unit; shares are in percent.

    The interval holds only values that the measure, or a difference of it, can have.

    Args:
        aggregate: How splits are put together, and what is random.
        is_difference: Whether the trials are people's minus an agent's.
    """
    found, told = counted_trials(trials, measure, aggregate), MEASURES[measure]
    if told.is_rate and not is_difference:
        return rate(replace(found, values=found.values / 100)).scaled(100)
    on_log = told.is_skewed and not is_difference and aggregate.intervals == "homes"
    estimate = mean(found, on_log=on_log)
    least = -told.most if is_difference else 0.0
    return replace(estimate, interval=estimate.interval and possible(estimate.interval, least, told.most))


def counted_trials(trials: Frame, measure: str, aggregate: Aggregate) -> Trials:
    """The trials that have the measure, as input for the statistics."""
    known = trials[trials[measure].notna()]
    return trials_of(
        known[measure].tolist(),
        known["participant"].tolist(),
        known["episode"].tolist(),
        None if aggregate.total == "pooled" else known["split"].tolist(),
        homes=known["scene"].tolist() if aggregate.intervals == "homes" else None,
        shares=aggregate.split_sizes if aggregate.total == "dataset_weighted" else None,
        weight=aggregate.weight,
    )


def possible(interval: Interval, low: float, high: float) -> Interval:
    """The interval, cut to values from low to high."""
    if interval.low >= low and interval.high <= high:
        return interval
    method = f"{interval.method}, cut to possible values"
    return Interval(low=max(interval.low, low), high=min(interval.high, high), method=method)


def no_interval(trials: Frame, aggregate: Aggregate) -> str:
    """Why these trials of one measure have no interval."""
    if aggregate.intervals == "homes" and trials["scene"].nunique() == 1:
        return "no interval: a single home says nothing of others"
    return "no interval: a single trial, or all alike, says nothing of others"


def require_totals(rows: Iterable[ReportRow]) -> None:
    """Raises StudyError where a total is not the declared mean of the splits beside it."""
    cells: dict[tuple, dict[str, ReportRow]] = defaultdict(dict)
    for row in rows:
        cells[row.task, row.scene_kind, row.who, row.condition, row.measure][row.split] = row
    for name, found in cells.items():
        total = found.pop(TOTAL, None)
        shares = [row.share for row in found.values() if row.share is not None]
        if total is not None and found and not shares:
            continue
        expected = sum(row.value * row.share for row in found.values() if row.share is not None)
        is_whole = len(shares) == len(found) and abs(sum(shares) - 1) < 1e-9
        if total is None or not is_whole or abs(total.value - expected) > 1e-9 * max(1.0, abs(expected)):
            raise StudyError(
                f"report: total of {' '.join(map(str, name))} is {None if total is None else total.value}; expected "
                f"{expected}, the mean of {', '.join(found)} with shares {shares}. Make the report again from the runs."
            )


def _share(split: str, known: Frame, splits: Sequence[str], aggregate: Aggregate) -> float | None:
    if split == TOTAL:
        return None
    if aggregate.total == "mean_of_splits":
        return 1 / len(splits)
    if aggregate.total == "dataset_weighted":
        sizes = aggregate.split_sizes or {}
        return sizes[split] / sum(sizes[name] for name in splits)
    if aggregate.weight == "participants":
        return None
    return float((known["split"] == split).sum() / len(known))


def _row(
    group: TrialGroup, measure: str, split: str, found: Frame, counted: Any, aggregate: Aggregate, share: float | None
) -> ReportRow:
    """One row; `counted` holds the values of all runs behind the trials."""
    is_difference = group.kind == "difference"
    estimate = estimate_of(found, measure, aggregate, is_difference=is_difference)
    is_counted = MEASURES[measure].is_rate and not is_difference
    return ReportRow(
        **group.names,
        kind=group.kind,
        split=split,
        measure=measure,
        value=estimate.value,
        low=estimate.low,
        high=estimate.high,
        method=estimate.interval.method if estimate.interval else no_interval(found, aggregate),
        k=int((counted == 100).sum()) if is_counted else None,
        n=len(counted),
        num_participants=estimate.num_participants,
        num_episodes=estimate.num_episodes,
        num_homes=int(found["scene"].nunique()),
        share=share,
        scene_label=scene_label(group.scene_kind),
    )
