"""Intervals for means over trials, where participants and episodes are both samples (HUMAN_STUDY.md, section 8).

A trial is one participant at one episode. Trials of one participant resemble each other, and so do trials of one
episode. An interval that treats trials as independent is therefore too narrow: with five people it covers the truth in
57 of 100 studies, not in 95 (section 8's simulation).
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import stdtrit

from sim.tasks.metrics import wilson

from ..design.analysis import LEVEL, NUM_RESAMPLES

_ROUNDING = 1e-12
"""Standard errors below this share of the largest value are rounding errors, that is, zero."""
_BLOCK = 1_000
"""Resamples held in memory at a time."""


Weight = Literal["trials", "participants"]
"""Average of a split: over its trials, or over its people's means."""


@dataclass(frozen=True, slots=True)
class Trials:
    """One number per trial, with its participant, episode and stratum."""

    values: NDArray[np.float64]
    """(N,), successes 0 or 1, or any measure; finite."""
    participant_index: NDArray[np.intp]
    """(N,), 0 to the number of participants - 1, each at least once."""
    episode_index: NDArray[np.intp]
    """(N,), 0 to the number of episodes - 1, each at least once."""
    stratum_index: NDArray[np.intp]
    """(N,), 0 to the number of strata - 1, each at least once. Strata are the splits; an episode is in one of them."""
    stratum_shares: tuple[float, ...] | None = None
    """Share of each stratum in the mean; None = the plain mean of the strata's means, as the paper's Total.

    (1, -1) makes the mean a difference of two strata."""
    weight: Weight = "trials"
    """Whether each trial or each participant counts the same within a stratum."""

    @property
    def num_strata(self) -> int:
        """Number of strata."""
        return int(self.stratum_index.max(initial=-1)) + 1

    @property
    def shares(self) -> NDArray[np.float64]:
        """Weight of each stratum in the mean, (S,)."""
        if self.stratum_shares is None:
            return np.full(self.num_strata, 1 / self.num_strata)
        return np.asarray(self.stratum_shares, np.float64)

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weight of each trial in the mean, (N,)."""
        each = self._within_stratum
        return self.shares[self.stratum_index] * each / np.bincount(self.stratum_index, each)[self.stratum_index]

    @property
    def stratum_means(self) -> NDArray[np.float64]:
        """Mean of each stratum, (S,)."""
        each = self._within_stratum
        return np.bincount(self.stratum_index, each * self.values) / np.bincount(self.stratum_index, each)

    @property
    def mean(self) -> float:
        """The mean of the strata's means, weighted by their shares."""
        means = self.stratum_means
        return float(means.mean() if self.stratum_shares is None else self.shares @ means)

    @property
    def _within_stratum(self) -> NDArray[np.float64]:
        """Weight of each trial in its stratum, in any unit, (N,)."""
        if self.weight == "trials":
            return np.ones(len(self.values))
        _, cell = np.unique(self.participant_index * self.num_strata + self.stratum_index, return_inverse=True)
        return 1 / np.bincount(cell)[cell]

    @property
    def num_participants(self) -> int:
        """Number of participants."""
        return int(self.participant_index.max(initial=-1)) + 1

    @property
    def num_episodes(self) -> int:
        """Number of episodes."""
        return int(self.episode_index.max(initial=-1)) + 1


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval of a mean."""

    low: float
    high: float
    method: str
    """Name of the method for the reader of a report, with its limits."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with its intervals, in the unit of the values."""

    value: float
    n: int
    """Trials."""
    num_participants: int
    num_episodes: int
    interval: Interval | None
    """Two-way interval; None where one participant and one episode, or one trial, say nothing about others."""
    bootstrap: Interval | None
    """Interval from drawing participants and episodes again; None as for `interval`, and where none is made."""

    @property
    def low(self) -> float | None:
        """Lower end of the two-way interval."""
        return self.interval.low if self.interval else None

    @property
    def high(self) -> float | None:
        """Upper end of the two-way interval."""
        return self.interval.high if self.interval else None

    def scaled(self, factor: float) -> "Estimate":
        """The estimate in another unit."""
        two_way, bootstrap = (
            found and replace(found, low=factor * found.low, high=factor * found.high)
            for found in (self.interval, self.bootstrap)
        )
        return replace(self, value=factor * self.value, interval=two_way, bootstrap=bootstrap)


def trials_of(
    values: Sequence[float],
    participants: Sequence[str],
    episodes: Sequence[str],
    strata: Sequence[str] | None = None,
    *,
    shares: Mapping[str, float] | None = None,
    weight: Weight = "trials",
) -> Trials:
    """Trials from parallel sequences.

    Args:
        values: Finite numbers.
        strata: Any text; None = one stratum for all.
        shares: Share of each stratum that occurs in the mean, in any unit; None = all the same.
        weight: Whether each trial or each participant counts the same within a stratum.
    """
    people, where = numbered(participants), numbered(episodes)
    stratum = numbered(strata or ["all"] * len(values))
    assert len(people) == len(where) == len(stratum) == len(values)
    numbers = np.asarray(values, np.float64)
    assert np.isfinite(numbers).all()
    stratum_shares = None
    if shares is not None and strata:
        found = [shares[name] for name in sorted(set(strata))]
        stratum_shares = tuple(share / sum(found) for share in found)
    return Trials(numbers, people, where, stratum, stratum_shares, weight)


def rate(trials: Trials, *, seed: int | None = 0) -> Estimate:
    """Share of successes; the interval is built on the logit scale, so it stays within 0 and 1.

    Args:
        trials: At least one trial; values are 0 or 1, or between them where an agent's runs were averaged.
        seed: Seed of the bootstrap; None = none is made.
    """
    return _estimate(trials, interval=rate_interval(trials), seed=seed)


def mean(trials: Trials, *, seed: int | None = 0) -> Estimate:
    """Mean of any measure, or of differences on the same episodes, over at least one trial; `seed` as for `rate`."""
    return _estimate(trials, interval=mean_interval(trials), seed=seed)


def two_way_variance(trials: Trials) -> tuple[float, float]:
    """Variance of the mean and Satterthwaite's degrees of freedom, with participants and episodes both random.

    The variance is the largest of the two-way sum and its parts, because the sum may come out too small, even negative
    (Cameron, Gelbach and Miller 2011). A factor with a single level adds nothing; with one level of both the variance
    is NaN.
    """
    centred = trials.values - trials.stratum_means[trials.stratum_index]
    return clustered_variance(trials.weights * centred, trials.participant_index, trials.episode_index)


def clustered_variance(
    shares: NDArray[np.float64], participant_index: NDArray[np.intp], episode_index: NDArray[np.intp]
) -> tuple[float, float]:
    """Variance of a weighted sum and Satterthwaite's degrees of freedom, from each trial's part in the sum.

    Args:
        shares: (N,), weight times residual of each trial.
        participant_index: (N,), as in `Trials`.
        episode_index: (N,), as in `Trials`. Indices of homes, which hold episodes, give the three-way sum.
    """
    by_person = _cluster_variance(shares, participant_index)
    by_episode = _cluster_variance(shares, episode_index)
    cell = participant_index * (int(episode_index.max(initial=-1)) + 1) + episode_index
    by_cell = _cluster_variance(shares, np.unique(cell, return_inverse=True)[1])
    parts = [part for part in (by_person, by_episode, by_cell) if part is not None]
    if by_cell is None:
        return float("nan"), 0.0
    together = 0.0
    if by_person is not None and by_episode is not None:
        together = by_person[0] + by_episode[0] - by_cell[0]
    variance = max(together, *(part for part, _ in parts))
    if variance == 0:
        return 0.0, float(min(df for _, df in parts))
    spread = sum(part**2 / df for part, df in parts)
    fewest = min(df for _, df in parts)
    return variance, max(variance**2 / spread, fewest)


def rate_interval(trials: Trials) -> Interval | None:
    """Two-way interval of a share, built on the logit scale; None where one trial says nothing about others.

    All values are within 0 and 1. If each participant and episode occurs once, or there is one run, the interval is
    Wilson's. If all values are equal, it is exact and counts people, not trials.
    """
    assert ((trials.values >= 0) & (trials.values <= 1)).all()
    n, share = len(trials.values), min(max(trials.mean, 0.0), 1.0)  # weights sum to 1 but for rounding
    share = float(round(share)) if np.isin(trials.values, (round(share),)).all() else share
    is_each_once = n == trials.num_episodes and trials.num_participants in (1, n)
    if is_each_once and trials.num_strata == 1 and np.isin(trials.values, (0, 1)).all():
        return wilson_interval(round(share * n), n)
    variance, df = two_way_variance(trials)
    if np.isnan(variance):
        return None
    if share in (0.0, 1.0):
        return _one_sided(trials, share)
    half = float(stdtrit(df, (1 + LEVEL) / 2)) * np.sqrt(variance) / (share * (1 - share))
    logit = np.log(share / (1 - share))
    low, high = 1 / (1 + np.exp(-(logit + np.array([-half, half]))))
    return Interval(low=float(low), high=float(high), method=f"two-way on the logit scale, t with {df:.1f} df")


def mean_interval(trials: Trials) -> Interval | None:
    """Two-way interval of a mean of any measure; None where one trial, or trials that are all alike, say nothing."""
    variance, df = two_way_variance(trials)
    if not variance > (_ROUNDING * float(np.abs(trials.values).max())) ** 2:
        return None
    value = trials.mean
    half = float(stdtrit(df, (1 + LEVEL) / 2)) * float(np.sqrt(variance))
    return Interval(low=value - half, high=value + half, method=f"two-way, t with {df:.1f} df")


def pigeonhole_interval(trials: Trials, *, seed: int = 0, num_resamples: int = NUM_RESAMPLES) -> Interval | None:
    """Percentile interval of the mean when participants and episodes are both drawn again, with replacement (Owen).

    Episodes are drawn within their stratum. None where neither can be drawn again. Resamples in which nobody met any
    episode of a stratum are left out.
    """
    people, episodes = trials.num_participants, trials.num_episodes
    if max(people, episodes) < 2:
        return None
    at = (trials.participant_index, trials.episode_index)
    sums, counts = np.zeros((people, episodes)), np.zeros((people, episodes))
    np.add.at(sums, at, trials.values)
    np.add.at(counts, at, 1.0)
    of_stratum = [np.unique(trials.episode_index[trials.stratum_index == s]) for s in range(trials.num_strata)]
    found = []
    for of_people, *of_all in _draws((people, *(len(columns) for columns in of_stratum)), num_resamples, seed):
        block = len(of_people)
        means = np.zeros(block)
        for columns, share, of_episodes in zip(of_stratum, trials.shares, of_all, strict=True):
            total, weight = sums[:, columns], counts[:, columns]
            if trials.weight == "trials":
                over, under = ((of_people @ part * of_episodes).sum(axis=1) for part in (total, weight))
            else:
                of_each, has = of_episodes @ total.T, of_episodes @ weight.T
                of_each = np.divide(of_each, has, out=np.zeros_like(of_each), where=has > 0)
                over, under = (of_people * of_each).sum(axis=1), (of_people * (has > 0)).sum(axis=1)
            means += share * np.divide(over, under, out=np.full(block, np.nan), where=under > 0)
        found.append(means[np.isfinite(means)])
    tail = (1 - LEVEL) / 2
    low, high = np.quantile(np.concatenate(found), [tail, 1 - tail])
    return Interval(low=float(low), high=float(high), method=f"two-way bootstrap, {num_resamples} resamples")


def wilson_interval(k: int, n: int) -> Interval:
    """Wilson's interval of a share of n independent trials.

    Trials are independent where each participant and each episode occurs once, or in one run, which says nothing about
    other participants.
    """
    low, high = wilson(k, n)
    return Interval(low=low, high=high, method="Wilson, trials independent")


def mcnemar_p(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Exact two-sided p of two agents' successes (N,) on the same episodes, one run each."""
    only_first, only_second = int((first & ~second).sum()), int((~first & second).sum())
    discordant = only_first + only_second
    return 1.0 if discordant == 0 else float(stats.binomtest(only_first, discordant).pvalue)


def numbered(names: Sequence[str]) -> NDArray[np.intp]:
    """Index (N,) of each name among the sorted distinct names."""
    places = {name: place for place, name in enumerate(sorted(set(names)))}
    return np.array([places[name] for name in names], np.intp)


def _estimate(trials: Trials, *, interval: Interval | None, seed: int | None) -> Estimate:
    return Estimate(
        value=trials.mean,
        n=len(trials.values),
        num_participants=trials.num_participants,
        num_episodes=trials.num_episodes,
        interval=interval,
        bootstrap=None if seed is None else pigeonhole_interval(trials, seed=seed),
    )


def _one_sided(trials: Trials, share: float) -> Interval:
    """Exact interval where all trials agree. They do not show how alike one person's trials are: each person is one."""
    n = min(count for count in (trials.num_participants, trials.num_episodes) if count > 1)
    rest = ((1 - LEVEL) / 2) ** (1 / n)
    low, high = (rest, 1.0) if share == 1 else (0.0, 1 - rest)
    return Interval(low=low, high=high, method=f"exact, all {len(trials.values)} trials alike, counted as {n}")


def _cluster_variance(share: NDArray[np.float64], group: NDArray[np.intp]) -> tuple[float, int] | None:
    """Variance of the sum of centred shares when whole groups are drawn, its degrees of freedom; None = one group."""
    sums = np.bincount(group, weights=share)
    groups = len(sums)
    return None if groups < 2 else (float(groups / (groups - 1) * (sums**2).sum()), groups - 1)


@functools.lru_cache(maxsize=4)
def _draws(sizes: tuple[int, ...], num_resamples: int, seed: int) -> list[tuple[NDArray[np.float64], ...]]:
    """How often each of n members is drawn when n are drawn with replacement: (block, n) per block and n of `sizes`.

    Measures of one row share it.
    """
    rng = np.random.default_rng(seed)
    blocks = [min(_BLOCK, num_resamples - first) for first in range(0, num_resamples, _BLOCK)]
    return [tuple(rng.multinomial(n, np.full(n, 1 / n), size=block).astype(float) for n in sizes) for block in blocks]
