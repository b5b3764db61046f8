"""Tests: the study's primary hypotheses with Holm's adjustment, and comparisons of agents that have one run each."""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from itertools import combinations

from scipy.special import stdtr

from sim.types import SPLITS, TaskKind

from ..design.analysis import ALPHA, HYPOTHESIS_NAME
from .effects import EffectRow, holm
from .measures import MEASURES
from .rows import Aggregate, counted_trials, estimate_of, no_interval
from .statistics import mcnemar_p, variance_of_mean
from .trials import ReportValue, TrialGroup, is_first_condition, row_label

_MEASURES = {measure.claim: name for name, measure in MEASURES.items() if measure.claim}
"""Names of columns, by their names in a study file."""


class HypothesisRow(ReportValue):
    """The result of one primary hypothesis."""

    name: str
    value: float | None = None
    low: float | None = None
    high: float | None = None
    p: float | None = None
    """Two-sided p of no difference; None = it could not be tested, and `method` says why."""
    p_holm: float | None = None
    """p adjusted over all primary hypotheses, including those not tested."""
    n: int = 0
    splits: tuple[str, ...] = ()
    """Splits of the trials: those of the difference, not always all that people did."""
    method: str

    @property
    def is_shown(self) -> bool:
        """Whether no difference is rejected at the family-wise level."""
        return self.p_holm is not None and self.p_holm < ALPHA


class AgentPairRow(ReportValue):
    """The numbers of episodes on which only one of two agents succeeded."""

    task: TaskKind
    scene_kind: str
    first: str
    second: str
    n: int
    """Number of episodes that both agents did."""
    num_only_first: int
    num_only_second: int
    p: float | None
    """Exact two-sided p; None where an agent has several runs, because these are not a single yes or no."""
    p_holm: float | None = None
    """p adjusted over all pairs that have one."""


def hypothesis_rows(
    names: Sequence[str], differences: Sequence[TrialGroup], memory: Sequence[EffectRow], aggregate: Aggregate
) -> list[HypothesisRow]:
    """A row per name of `primary` in the study file.

    Args:
        differences: People minus agents on the same episodes.
        memory: Effects of conditions, of all splits together.
    """
    rows = [_tested(name, differences, memory, aggregate) for name in names]
    adjusted = holm([1.0 if row.p is None else row.p for row in rows])
    return [
        row.model_copy(update={"p_holm": None if row.p is None else p}) for row, p in zip(rows, adjusted, strict=True)
    ]


def _tested(
    name: str, differences: Sequence[TrialGroup], memory: Sequence[EffectRow], aggregate: Aggregate
) -> HypothesisRow:
    match = HYPOTHESIS_NAME.match(name)
    if match is None:
        return _untested(name, "the name is none that the report knows, such as human_minus_agent_SR")
    task, measure, condition = match["task"], _MEASURES[match["measure"]], match["condition"]
    if match["memory"] is not None:
        effects = [
            row
            for row in memory
            if (row.split, row.measure) == ("all", measure)
            and task in (None, row.task)
            and match["memory"] in ("memory", row.what.partition(" - ")[0])
        ]
        if len(effects) != 1:
            found = ", ".join(f"{row.task} {row.what}" for row in effects) or "none"
            return _untested(name, f"needs exactly one pair of conditions, found {found}")
        (effect,) = effects
        parts = [
            row.split for row in memory if (row.task, row.what, row.measure) == (effect.task, effect.what, measure)
        ]
        return _of_effect(name, effect, tuple(split for split in SPLITS if split in parts))
    groups = [
        group
        for group in differences
        if task in (None, group.task)
        and (match["agent"] == "agent" or group.who == f"human - {match['agent']}")
        and (group.condition == condition if condition else is_first_condition(group.condition))
        and measure in group.measures
    ]
    if len(groups) != 1:
        found = ", ".join(f"{group.task} {group.who} ({group.condition})" for group in groups) or "none"
        return _untested(name, f"needs exactly one comparison, found {found}")
    return _of_difference(name, groups[0], measure, aggregate)


def _of_difference(name: str, group: TrialGroup, measure: str, aggregate: Aggregate) -> HypothesisRow:
    trials = counted_trials(group.trials, measure, aggregate)
    interval = estimate_of(group.trials, measure, aggregate, is_difference=True).interval
    if interval is None:
        return _untested(name, no_interval(group.trials, aggregate))
    variance, df = variance_of_mean(trials)
    known = set(group.trials["split"][group.trials[measure].notna()])
    splits = tuple(split for split in SPLITS if split in known)
    return HypothesisRow(
        name=name,
        value=trials.mean,
        low=interval.low,
        high=interval.high,
        p=float(2 * stdtr(df, -abs(trials.mean) / variance**0.5)),
        n=len(trials.values),
        splits=splits,
        method=f"{group.who}, {group.task}, {group.condition}, {' and '.join(splits)}: paired on the same episodes, "
        f"{interval.method}",
    )


def _of_effect(name: str, row: EffectRow, splits: tuple[str, ...]) -> HypothesisRow:
    found = row.effect.model_dump(include={"value", "low", "high", "p", "n"})
    told = f"{row.what}, {row.task}, {' and '.join(splits)}" if splits else f"{row.what}, {row.task}"
    return HypothesisRow(name=name, **found, splits=splits, method=f"{told}: {row.effect.method}")


def _untested(name: str, why: str) -> HypothesisRow:
    return HypothesisRow(name=name, method=f"not tested: {why}")


def agent_pairs(agents: Sequence[TrialGroup], episodes: AbstractSet[str]) -> list[AgentPairRow]:
    """McNemar's exact test of each pair of agents of one task, with all their runs, on episodes that people did."""
    pairs = [_pair(first, second, episodes) for first, second in combinations(agents, 2) if first.task == second.task]
    rows = [row for row in pairs if row.n]
    adjusted = iter(holm([row.p for row in rows if row.p is not None]))
    return [row if row.p is None else row.model_copy(update={"p_holm": next(adjusted)}) for row in rows]


def _pair(first: TrialGroup, second: TrialGroup, episodes: AbstractSet[str]) -> AgentPairRow:
    groups = (first, second)
    both = sorted(set(first.trials["episode"]) & set(second.trials["episode"]) & episodes)
    found = [group.trials[group.trials["episode"].isin(both)].sort_values("episode") for group in groups]
    one, other = (trials["sr"].to_numpy() == 100 for trials in found)
    is_single = len(one) == len(other) == len(both)
    return AgentPairRow(
        task=first.task,
        scene_kind=first.scene_kind,
        first=row_label(first.who, first.condition),
        second=row_label(second.who, second.condition),
        n=len(both),
        num_only_first=int((one & ~other).sum()) if is_single else 0,
        num_only_second=int((~one & other).sum()) if is_single else 0,
        p=mcnemar_p(one, other) if is_single else None,
    )
