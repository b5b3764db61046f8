"""People's figures in home sequences, with people and homes random, and sequences and their searches inside homes.

Each person does several homes, so intervals over homes alone would be too narrow where people differ.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sim.episodes.sequences import SubtaskKind
from sim.sequences.figures import SequenceFigures, SequenceRule, SrDifference, Values, sequence_figures
from sim.sequences.runs import SequenceRun
from sim.types import EpisodeKey, SuccessRule

from ..report.statistics import Interval, Trials, mean_interval, rate_interval, trials_of


def people_figures(runs: Sequence[SequenceRun], rule: SequenceRule) -> SequenceFigures:
    """The measures of people's runs; their intervals are on the logit scale."""
    return sequence_figures(runs, rule=rule, interval_of=_share_interval)


def people_difference(
    first: Sequence[SequenceRun], second: Sequence[SequenceRun], *, rule: SuccessRule, kind: SubtaskKind | None
) -> SrDifference | None:
    """SR of people in one condition less that in another, over the searches done in both; None where they share none.

    Args:
        first: Runs of people.
        second: Runs in the condition whose SR is taken away.
        rule: Says which searches are right.
        kind: The only kind of search that counts; None = all.
    """
    ones, others = list(_searches(first, rule, kind)), list(_searches(second, rule, kind))
    shared = {at for at, _, _ in ones} & {at for at, _, _ in others}
    sides = [[(right, run) for at, right, run in side if at in shared] for side in (ones, others)]
    if not shared:
        return None
    trials = _trials([*sides[0], *sides[1]], [str(side) for side, found in enumerate(sides) for _ in found])
    trials = replace(trials, stratum_shares=(1.0, -1.0))
    return _difference(trials, len(sides[0]), len(sides[1]))


def agent_difference(
    people: Sequence[SequenceRun], agent: Sequence[SequenceRun], *, rule: SuccessRule, kind: SubtaskKind | None
) -> SrDifference | None:
    """People less the mean of an agent's runs, search by search where both did it; arguments as `people_difference`."""
    theirs: dict[_At, list[float]] = defaultdict(list)
    for at, right, _ in _searches(agent, rule, kind):
        theirs[at].append(right)
    shared = [found for found in _searches(people, rule, kind) if found[0] in theirs]
    if not shared:
        return None
    apart = [(right - float(np.mean(theirs[at])), run) for at, right, run in shared]
    return _difference(_trials(apart), len(apart), sum(len(theirs[at]) for at in {at for at, _, _ in shared}))


_At = tuple[EpisodeKey, int]
"""A sequence, and the place of a search in it."""


def _searches(
    runs: Sequence[SequenceRun], rule: SuccessRule, kind: SubtaskKind | None
) -> Iterator[tuple[_At, float, SequenceRun]]:
    """The searches of a kind for which the rule is defined, and whether they are right: 0 or 1."""
    for run in runs:
        for index, search in enumerate(run.end.searches):
            right = search.succeeds(rule)
            if kind in (None, search.kind) and right is not None:
                yield (run.key, index), float(right), run


def _trials(values: Values, strata: Sequence[str] | None = None) -> Trials:
    runs = [run for _, run in values]
    return trials_of(
        [value for value, _ in values],
        [run.start.participant or "" for run in runs],
        [str(run.key) for run in runs],
        strata,
        homes=[run.start.scene for run in runs],
    )


def _share_interval(values: Values) -> tuple[float, float] | None:
    """Of the mean of shares; those that rounding lifts above 1 are 1."""
    return _ends(rate_interval(_trials([(min(value, 1.0), run) for value, run in values]))) if values else None


def _difference(trials: Trials, num_first: int, num_second: int) -> SrDifference:
    interval = _ends(mean_interval(trials))
    return SrDifference(value=trials.mean, interval=interval, num_first=num_first, num_second=num_second)


def _ends(interval: Interval | None) -> tuple[float, float] | None:
    return None if interval is None else (interval.low, interval.high)
