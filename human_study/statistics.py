"""Intervals for means over trials, where participants and episodes are both samples (HUMAN_STUDY.md, section 8).

A trial is one participant at one episode. Trials of one participant resemble each other, so do trials of one episode,
and an interval that takes trials for independent is too narrow: with five people it covers 57 of 100 times, not 95
(section 8's simulation).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from scipy import stats

LEVEL = 0.95
"""Of all intervals."""
NUM_RESAMPLES = 10_000
"""Of a bootstrap."""
_BLOCK = 1_000
"""Resamples held in memory at a time."""


@dataclass(frozen=True, slots=True)
class Trials:
    """One number per trial, and whose it is."""

    values: NDArray[np.float64]
    """(N,), successes 0 or 1, or any measure; finite."""
    participant_index: NDArray[np.intp]
    """(N,), 0 to the number of participants - 1, each at least once."""
    episode_index: NDArray[np.intp]
    """(N,), 0 to the number of episodes - 1, each at least once."""
    stratum_index: NDArray[np.intp]
    """(N,), 0 to the number of strata - 1, each at least once: the splits. The mean is the plain mean of their means,
    as the paper's Total is; an episode is in one of them."""

    @property
    def num_strata(self) -> int:
        """Different strata."""
        return int(self.stratum_index.max(initial=-1)) + 1

    @property
    def stratum_means(self) -> NDArray[np.float64]:
        """(S,)"""
        return np.bincount(self.stratum_index, weights=self.values) / np.bincount(self.stratum_index)

    @property
    def mean(self) -> float:
        """Mean of the strata's means."""
        return float(self.stratum_means.mean())

    @property
    def num_participants(self) -> int:
        """Different participants."""
        return int(self.participant_index.max(initial=-1)) + 1

    @property
    def num_episodes(self) -> int:
        """Different episodes."""
        return int(self.episode_index.max(initial=-1)) + 1


class Interval(BaseModel):
    """Where the mean may lie."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    low: float
    high: float
    method: str
    """For the reader of a report, with what limits it."""


class Estimate(BaseModel):
    """A mean with its intervals, in the unit of the values."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    value: float
    n: int = Field(ge=1)
    """Trials."""
    num_participants: int
    num_episodes: int
    interval: Interval | None
    """Two-way; None where one participant and one episode, or one trial, say nothing about others."""
    bootstrap: Interval | None
    """Participants and episodes both drawn again; None as for `interval`."""


def trials_of(
    values: Sequence[float], participants: Sequence[str], episodes: Sequence[str], strata: Sequence[str] | None = None
) -> Trials:
    """Trials from parallel sequences; names may be any text, no `strata` is one for all."""
    indexes = [_numbered(names) for names in (participants, episodes, strata or ["all"] * len(values))]
    assert all(len(index) == len(values) for index in indexes)
    numbers = np.asarray(values, np.float64)
    assert np.isfinite(numbers).all()
    return Trials(numbers, *indexes)


def rate(trials: Trials, *, seed: int = 0) -> Estimate:
    """Share of successes; the interval is built on the logit scale, so it stays within 0 and 1.

    Args:
        trials: At least one, each 0 or 1, or between them where runs of one agent at an episode were averaged.
        seed: Of the bootstrap.
    """
    return _estimate(trials, interval=rate_interval(trials), seed=seed)


def mean(trials: Trials, *, seed: int = 0) -> Estimate:
    """Mean of any measure, or of differences on the same episodes.

    Args:
        trials: At least one.
        seed: Of the bootstrap.
    """
    return _estimate(trials, interval=_mean_interval(trials), seed=seed)


def two_way_variance(trials: Trials) -> tuple[float, float]:
    """(variance of the mean, Satterthwaite's degrees of freedom), participants and episodes both random.

    The largest of the two-way sum and its parts, because the sum may come out too small, even negative (Cameron,
    Gelbach and Miller 2011). A factor with a single level adds nothing; with one level of both the variance is NaN.
    """
    sizes = np.bincount(trials.stratum_index)
    centred = trials.values - trials.stratum_means[trials.stratum_index]
    share = centred / (trials.num_strata * sizes[trials.stratum_index])
    by_person = _cluster_variance(share, trials.participant_index)
    by_episode = _cluster_variance(share, trials.episode_index)
    _, cell = np.unique(trials.participant_index * trials.num_episodes + trials.episode_index, return_inverse=True)
    by_cell = _cluster_variance(share, cell)
    parts = [part for part in (by_person, by_episode, by_cell) if part is not None]
    if by_cell is None:
        return float("nan"), 0.0
    if by_person is not None and by_episode is not None:
        sign = (1.0, 1.0, -1.0)
        together = sum(s * variance for s, (variance, _) in zip(sign, (by_person, by_episode, by_cell), strict=True))
    else:
        together = 0.0
    variance = max(together, *(part for part, _ in parts))
    if variance == 0:
        return 0.0, float(min(df for _, df in parts))
    spread = sum(part**2 / df for part, df in parts)
    fewest = min(df for _, df in parts)
    return variance, max(variance**2 / spread, fewest)


def rate_interval(trials: Trials) -> Interval | None:
    """Two-way interval of a share, built on the logit scale; None where one trial says nothing of others.

    Args:
        trials: At least one, all within 0 and 1. Each participant and episode once, or one run: Wilson's. All alike:
            exact, with people counted instead of trials.
    """
    assert ((trials.values >= 0) & (trials.values <= 1)).all()
    n, share = len(trials.values), trials.mean
    is_each_once = n == trials.num_episodes and trials.num_participants in (1, n)
    if is_each_once and trials.num_strata == 1 and np.isin(trials.values, (0, 1)).all():
        return wilson_interval(round(share * n), n)
    variance, df = two_way_variance(trials)
    if np.isnan(variance):
        return None
    if share in (0.0, 1.0):
        return _one_sided(trials, share)
    half = float(stats.t.ppf((1 + LEVEL) / 2, df)) * np.sqrt(variance) / (share * (1 - share))
    logit = np.log(share / (1 - share))
    low, high = 1 / (1 + np.exp(-(logit + np.array([-half, half]))))
    return Interval(low=float(low), high=float(high), method=f"two-way on the logit scale, t with {df:.1f} df")


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
    rng = np.random.default_rng(seed)
    found = []
    for first in range(0, num_resamples, _BLOCK):
        block = min(_BLOCK, num_resamples - first)
        of_people = _drawn_again(people, block, rng)
        means = np.zeros(block)
        for columns in of_stratum:
            of_episodes = _drawn_again(len(columns), block, rng)
            total = ((of_people @ sums[:, columns]) * of_episodes).sum(axis=1)
            weight = ((of_people @ counts[:, columns]) * of_episodes).sum(axis=1)
            means += np.divide(total, weight, out=np.full(block, np.nan), where=weight > 0) / len(of_stratum)
        found.append(means[np.isfinite(means)])
    tail = (1 - LEVEL) / 2
    low, high = np.quantile(np.concatenate(found), [tail, 1 - tail])
    return Interval(low=float(low), high=float(high), method=f"two-way bootstrap, {num_resamples} resamples")


def wilson_interval(k: int, n: int) -> Interval:
    """Of a share of n independent trials: each participant and each episode once, or one run, which says nothing of
    other participants."""
    z = float(stats.norm.ppf((1 + LEVEL) / 2))
    centre, denominator = k / n + z**2 / (2 * n), 1 + z**2 / n
    half = z * np.sqrt(k / n * (1 - k / n) / n + z**2 / (4 * n**2))
    return Interval(
        low=float((centre - half) / denominator),
        high=float((centre + half) / denominator),
        method="Wilson, trials independent",
    )


def mcnemar_p(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Exact two-sided p of two agents' successes (N,) on the same episodes, one run each."""
    only_first, only_second = int((first & ~second).sum()), int((~first & second).sum())
    discordant = only_first + only_second
    return 1.0 if discordant == 0 else float(stats.binomtest(only_first, discordant).pvalue)


def _estimate(trials: Trials, *, interval: Interval | None, seed: int) -> Estimate:
    return Estimate(
        value=trials.mean,
        n=len(trials.values),
        num_participants=trials.num_participants,
        num_episodes=trials.num_episodes,
        interval=interval,
        bootstrap=pigeonhole_interval(trials, seed=seed),
    )


def _one_sided(trials: Trials, share: float) -> Interval:
    """Where all trials agree nothing tells how alike one participant's are: at worst each person counts once."""
    n = min(count for count in (trials.num_participants, trials.num_episodes) if count > 1)
    rest = ((1 - LEVEL) / 2) ** (1 / n)
    low, high = (rest, 1.0) if share == 1 else (0.0, 1 - rest)
    return Interval(low=low, high=high, method=f"exact, all {len(trials.values)} trials alike, counted as {n}")


def _mean_interval(trials: Trials) -> Interval | None:
    variance, df = two_way_variance(trials)
    if np.isnan(variance):
        return None
    value = trials.mean
    half = float(stats.t.ppf((1 + LEVEL) / 2, df)) * float(np.sqrt(variance))
    return Interval(low=value - half, high=value + half, method=f"two-way, t with {df:.1f} df")


def _cluster_variance(share: NDArray[np.float64], group: NDArray[np.intp]) -> tuple[float, int] | None:
    """(variance of the sum of centred shares when whole groups are drawn, its degrees of freedom); None = one group."""
    sums = np.bincount(group, weights=share)
    groups = len(sums)
    return None if groups < 2 else (float(groups / (groups - 1) * (sums**2).sum()), groups - 1)


def _drawn_again(number: int, num_resamples: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(num_resamples, number): how often each is drawn when as many are drawn with replacement."""
    return rng.multinomial(number, np.full(number, 1 / number), size=num_resamples).astype(np.float64)


def _numbered(names: Sequence[str]) -> NDArray[np.intp]:
    """(N,) place of each name among the different ones in order."""
    places = {name: place for place, name in enumerate(sorted(set(names)))}
    return np.array([places[name] for name in names], np.intp)
