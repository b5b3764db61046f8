"""Measures of runs of home sequences; they only aggregate what was scored when the runs ended.

Conventions: SR, partial and composite success of GOAT-Bench, with its 0.25 m as a second row; progress and PPL of
MultiON; CSR and CGT of LH-VLN. docs/home-sequences.md defines the rest.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy import stats

from sim.episodes.sequences import SubtaskKind
from sim.types import SuccessRule

from .runs import SearchEnd, SequenceRun

SequenceRule = SuccessRule | Literal["goat"]
Values = Sequence[tuple[float, SequenceRun]]
"""Values, each with the run to which it belongs."""
IntervalOf = Callable[[Values], tuple[float, float] | None]
"""The interval of the values' mean; None where they do not give one."""


class SequenceFigures(BaseModel):
    """The measures of a row; shares in [0, 1], None where there is nothing to count."""

    model_config = ConfigDict(frozen=True)
    n: int
    """Sequences."""
    searches: int
    sr: float | None
    sr_fresh: float | None
    sr_revisit: float | None
    sr_changed: float | None
    sr_stale: float | None
    progress: float | None
    """Share of a sequence's searches that succeed before the first failure."""
    partial: float | None
    """Share of a sequence's searches that succeed."""
    composite: float | None
    """Share of sequences in which all searches succeed."""
    csr: float | None
    cgt: float | None
    """PAN only, as `spl`, `ppl`, `dtg` and `steps`."""
    spl: float | None
    """SPL of the searches, from where the robot then stood."""
    ppl: float | None
    """Progress, weighted by the shortest walk through the true objects over the walk made for it."""
    top3: float | None
    """POG only: share of the searches in which one of the first three points succeeds."""
    stale: float | None
    """Share of the searches with an object that was right before in which FOUND was there."""
    interference: float | None
    """SR of unchanged answers after unrelated messages, less SR of unchanged answers before any."""
    dtg: float | None
    """Metres to where the rule counts FOUND, mean over searches that ended with FOUND and have a path there."""
    steps: float | None
    """Mean over the searches that began."""
    lag: float | None
    """Failed searches about a message until the first that succeeds, mean over messages."""
    recall: float | None
    precision: float | None
    intervals: dict[str, tuple[float, float]] = {}
    """95 % intervals of shares over searches and of means over sequences. Of agents: homes random, all else inside
    homes; of people in a report: people random, too."""


class MemoryGain(BaseModel):
    """Paired differences, with memory less without, of the same sequences; of `revisit` searches except `sr_all`."""

    model_config = ConfigDict(frozen=True)
    n: int
    """Pairs of `revisit` searches."""
    sr: float | None
    spl: float | None
    steps: float | None
    sr_all: float | None
    """Over searches of every kind."""
    interval_all: tuple[float, float] | None
    """95 % interval of `sr_all`, homes random."""


class SrDifference(BaseModel):
    """A difference of success rates on sequences that both sides did."""

    model_config = ConfigDict(frozen=True)
    value: float
    interval: tuple[float, float] | None
    """95 %, homes random; None = fewer than two homes."""
    num_first: int
    num_second: int
    """Searches of each side."""


def sequence_figures(
    runs: Sequence[SequenceRun], *, rule: SequenceRule = "paper", interval_of: IntervalOf | None = None
) -> SequenceFigures:
    """The measures of some runs, each of one sequence; without `interval_of`, intervals are over homes."""
    interval_of = interval_of or _over_homes
    ends = [run.end.searches for run in runs]
    searches = [search for found in ends for search in found]
    unchanged = [search for search in searches if search.kind in ("fresh", "revisit")]
    after = _sr([search for search in unchanged if search.is_after_news], rule)
    before = _sr([search for search in unchanged if not search.is_after_news], rule)
    old = [search.is_at_old for search in searches if search.is_at_old is not None]
    whole = [search.all for search in searches if search.all is not None]
    answers = [search.answer for search in searches if search.answer is not None]
    walked = [search for search in searches if search.answer is None]
    measures = {name: one for name, one in _OF_SEQUENCES.items() if walked or name not in _OF_WALKS}
    wholes = {name: [measure(found, rule) for found in ends] for name, measure in measures.items()}
    groups = {"sr": searches, **{f"sr_{kind}": [one for one in searches if one.kind == kind] for kind in _KINDS}}
    run_of = {id(search): run for run in runs for search in run.end.searches}
    intervals = {name: interval_of(list(zip(values, runs, strict=True))) for name, values in wholes.items()}
    for name, group in groups.items():
        known = [search for search in group if search.succeeds(rule) is not None]
        intervals[name] = interval_of([(float(_is_right(search, rule)), run_of[id(search)]) for search in known])
    return SequenceFigures(
        n=len(runs),
        searches=len(searches),
        **{name: _sr(group, rule) for name, group in groups.items()},
        **{name: _mean(wholes.get(name, [])) for name in _OF_SEQUENCES},
        spl=_mean([search_spl(search, rule) for search in walked if search.succeeds(rule) is not None]),
        top3=_mean([float(answer.top3_success) for answer in answers]),
        dtg=_mean([dtg for search in searches if (dtg := search_dtg(search, rule)) is not None]),
        steps=_mean([float(search.measures.num_steps) for search in searches if search.measures is not None]),
        stale=_mean(old),
        interference=None if after is None or before is None else after - before,
        lag=_mean([lag for found in ends for lag in _lags(found, rule)]),
        recall=_mean([found.recall for found in whole]),
        precision=_mean([found.precision for found in whole]),
        intervals={name: interval for name, interval in intervals.items() if interval is not None},
    )


def memory_gain(runs: Iterable[tuple[SequenceRun, SequenceRun]], *, rule: SequenceRule = "paper") -> MemoryGain:
    """The gain of memory, from pairs of runs of one sequence with memory and without."""
    found = [(run, zip(run.end.searches, other.end.searches, strict=True)) for run, other in runs]
    pairs = [(run.start.scene, *pair) for run, searches in found for pair in searches]
    revisits = [(one, other) for _, one, other in pairs if one.kind == "revisit"]
    with_memory = [(float(_is_right(one, rule)), home) for home, one, _ in pairs]
    without = [(float(_is_right(other, rule)), home) for home, _, other in pairs]
    sr_all, interval_all = difference_over_homes(with_memory, without) if pairs else (None, None)
    steps = [
        float(one.measures.num_steps - other.measures.num_steps)
        for one, other in revisits
        if one.measures is not None and other.measures is not None
    ]
    return MemoryGain(
        n=len(revisits),
        sr=_mean([float(_is_right(one, rule)) - float(_is_right(other, rule)) for one, other in revisits]),
        spl=_mean([search_spl(one, rule) - search_spl(other, rule) for one, other in revisits]),
        steps=_mean(steps),
        sr_all=sr_all,
        interval_all=interval_all,
    )


def sr_difference(
    first: Sequence[SequenceRun],
    second: Sequence[SequenceRun],
    *,
    rule: SequenceRule = "paper",
    kind: SubtaskKind | None = None,
) -> SrDifference | None:
    """The SR of some runs less that of others, over the sequences that both did; None where they share no search.

    Args:
        first: Runs of any sequences.
        second: The runs whose SR is taken away.
        rule: Says which searches are right.
        kind: The only kind of search that counts; None = all.
    """
    shared = {run.key for run in first} & {run.key for run in second}
    one, other = (
        [
            (float(right), run.key.scene)
            for run in runs
            if run.key in shared
            for search in run.end.searches
            if kind in (None, search.kind) and (right := search.succeeds(rule)) is not None
        ]
        for runs in (first, second)
    )
    if not one or not other:
        return None
    value, interval = difference_over_homes(one, other)
    return SrDifference(value=value, interval=interval, num_first=len(one), num_second=len(other))


def difference_over_homes(
    one: Sequence[tuple[float, str]], other: Sequence[tuple[float, str]]
) -> tuple[float, tuple[float, float] | None]:
    """Difference of two means, with its interval as of `interval_over_homes`; a home's values in both go together.

    Args:
        one: (value, home) of each value.
        other: The same of the mean that is taken away.
    """
    difference, rests = 0.0, []
    for values, sign in ((one, 1), (other, -1)):
        mean = float(np.mean([value for value, _ in values]))
        difference += sign * mean
        rests += [(sign * (value - mean) / len(values), home) for value, home in values]
    return difference, _interval(difference, rests)


def search_spl(search: SearchEnd, rule: SequenceRule) -> float:
    """SPL of one search, by the shortest walk from where it began; to all right objects where they are wanted."""
    if search.measures is None or not search.succeeds(rule):
        return 0.0
    found = search.measures.rules["habitat" if rule == "goat" else rule]
    best_m = search.all.best_m if search.all is not None else found and found.start_distance
    if best_m is None:
        return 0.0
    return _efficiency(best_m, search.measures.path_m)


def search_dtg(search: SearchEnd, rule: SequenceRule) -> float | None:
    """Metres from where FOUND ended a search to where it succeeds; None without both."""
    if search.measures is None or search.reason != "found":
        return None
    found = search.measures.rules["habitat" if rule == "goat" else rule]
    return None if found is None else found.dtg


def csr(right: Sequence[bool], weights: Sequence[float] | None = None) -> float:
    """LH-VLN's conditional success: each right search counts fully after another right one, and as 1/N otherwise.

    Args:
        right: Whether each of N searches succeeded; before the first, all was right.
        weights: Weight of each search, N in sum; None = equal ones. With shares of the shortest walk it is CGT.
    """
    count = len(right)
    before = (True, *right[:-1])
    each = [s * (1 + (count - 1) * b) / count for s, b in zip(right, before, strict=True)]
    return float(np.average(each, weights=weights))


def interval_over_homes(values: Sequence[float], homes: Sequence[str]) -> tuple[float, float] | None:
    """95 % interval of a mean whose values share homes: homes are drawn at random, with all their values.

    The mean's variance is that of the homes' sums of residuals (cluster-robust), with Student's t of one degree less
    than there are homes. None = fewer than two homes.
    """
    mean = float(np.mean(values)) if values else 0.0
    return _interval(mean, [((value - mean) / len(values), home) for value, home in zip(values, homes, strict=True)])


def _interval(middle: float, rests: Iterable[tuple[float, str]]) -> tuple[float, float] | None:
    """The interval around a mean, from its values' (residual, home); residuals are over the number of values."""
    sums: dict[str, float] = defaultdict(float)
    for rest, home in rests:
        sums[home] += rest
    count = len(sums)
    if count < 2:
        return None
    error = (count / (count - 1) * sum(found**2 for found in sums.values())) ** 0.5
    half = float(stats.t.ppf(0.975, count - 1)) * error
    return middle - half, middle + half


def _over_homes(values: Values) -> tuple[float, float] | None:
    return interval_over_homes([value for value, _ in values], [run.start.scene for _, run in values])


def _is_right(search: SearchEnd, rule: SequenceRule) -> bool:
    return bool(search.succeeds(rule))


def _sr(searches: Sequence[SearchEnd], rule: SequenceRule) -> float | None:
    known = [right for search in searches if (right := search.succeeds(rule)) is not None]
    return _mean([float(right) for right in known])


def _efficiency(best_m: float, walked_m: float) -> float:
    """Share of the best walk in the one that was made; 1 where none was needed."""
    return best_m / max(best_m, walked_m) if best_m else 1.0


def _num_right_first(searches: Sequence[SearchEnd], rule: SequenceRule) -> int:
    right = [_is_right(search, rule) for search in searches]
    return right.index(False) if False in right else len(right)


def _progress(searches: Sequence[SearchEnd], rule: SequenceRule) -> float:
    return _num_right_first(searches, rule) / len(searches)


def _partial(searches: Sequence[SearchEnd], rule: SequenceRule) -> float:
    return sum(_is_right(search, rule) for search in searches) / len(searches)


def _composite(searches: Sequence[SearchEnd], rule: SequenceRule) -> float:
    return float(all(_is_right(search, rule) for search in searches))


def _csr(searches: Sequence[SearchEnd], rule: SequenceRule) -> float:
    return csr([_is_right(search, rule) for search in searches])


def _cgt(searches: Sequence[SearchEnd], rule: SequenceRule) -> float:
    """CSR with the searches' shares of the shortest walk as weights; a search without a path weighs nothing."""
    legs = [search.leg_m or 0.0 for search in searches]
    return csr([_is_right(search, rule) for search in searches], legs if sum(legs) else None)


def _ppl(searches: Sequence[SearchEnd], rule: SequenceRule) -> float:
    """Progress by the path: only walks of the searches that count for progress are compared."""
    count = _num_right_first(searches, rule)
    best_m = sum(search.leg_m or 0.0 for search in searches[:count])
    walked_m = sum(search.measures.path_m for search in searches[:count] if search.measures is not None)
    return count / len(searches) * _efficiency(best_m, walked_m) if count else 0.0


def _lags(searches: Sequence[SearchEnd], rule: SequenceRule) -> list[float]:
    """For each later message that searches ask about: how many of them fail before the first that succeeds."""
    asked: dict[int, list[SearchEnd]] = defaultdict(list)
    for search in searches:
        if search.message > 0:
            asked[search.message].append(search)
    return [float(_num_wrong_first(found, rule)) for found in asked.values()]


def _num_wrong_first(searches: Sequence[SearchEnd], rule: SequenceRule) -> int:
    right = [_is_right(search, rule) for search in searches]
    return right.index(True) if True in right else len(right)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


_KINDS: tuple[SubtaskKind, ...] = ("fresh", "revisit", "changed", "stale")
_OF_SEQUENCES: dict[str, Callable[[Sequence[SearchEnd], SequenceRule], float]] = {
    "progress": _progress,
    "partial": _partial,
    "composite": _composite,
    "csr": _csr,
    "cgt": _cgt,
    "ppl": _ppl,
}
"""Measures of one sequence; a row has their means, each with an interval."""
_OF_WALKS = ("cgt", "ppl")
"""Those that need a walk."""
