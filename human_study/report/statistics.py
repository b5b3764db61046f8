"""Intervals for means over trials: participants, episodes and homes are all samples (HUMAN_STUDY.md, section 8).

A trial is one participant at one episode in one home. Trials of one participant resemble each other, and so do trials
of one episode and of one home. An interval that treats trials as independent is therefore too narrow: with five people
it covers the truth in 57 of 100 studies, not in 95 (section 8's simulation).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import stdtrit

from sim.tasks.metrics import wilson

from ..design.analysis import LEVEL

_ROUNDING = 1e-12
"""Standard errors below this share of the largest value are rounding errors, that is, zero."""


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
    home_index: NDArray[np.intp] | None = None
    """(N,), 0 to the number of homes - 1, each at least once; None = homes are not random, only their episodes are."""
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

    @property
    def sampled_index(self) -> NDArray[np.intp]:
        """The second random factor beside participants, (N,): homes with the episodes in them, or episodes alone.

        An episode lies in one home, so a sum over a home's trials holds what its episodes have in common, too.
        """
        return self.episode_index if self.home_index is None else self.home_index

    @property
    def num_sampled(self) -> int:
        """Number of homes, or of episodes where homes are not random."""
        return int(self.sampled_index.max(initial=-1)) + 1

    @property
    def factors(self) -> str:
        """What is random, for the reader of a report."""
        return "two-way" if self.home_index is None else "people, episodes and homes random (three-way)"


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval of a mean."""

    low: float
    high: float
    method: str
    """Name of the method for the reader of a report, with its limits."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with its interval, in the unit of the values."""

    value: float
    n: int
    """Trials."""
    num_participants: int
    num_episodes: int
    interval: Interval | None
    """None where the trials say nothing about other people, episodes or homes."""

    @property
    def low(self) -> float | None:
        """Lower end of the interval."""
        return self.interval.low if self.interval else None

    @property
    def high(self) -> float | None:
        """Upper end of the interval."""
        return self.interval.high if self.interval else None

    def scaled(self, factor: float) -> "Estimate":
        """The estimate in another unit."""
        found = self.interval
        scaled = found and replace(found, low=factor * found.low, high=factor * found.high)
        return replace(self, value=factor * self.value, interval=scaled)


def trials_of(
    values: Sequence[float],
    participants: Sequence[str],
    episodes: Sequence[str],
    strata: Sequence[str] | None = None,
    *,
    homes: Sequence[str] | None = None,
    shares: Mapping[str, float] | None = None,
    weight: Weight = "trials",
) -> Trials:
    """Trials from parallel sequences.

    Args:
        values: Finite numbers.
        strata: Any text; None = one stratum for all.
        homes: The home of each trial; None = homes are not random.
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
    return Trials(numbers, people, where, stratum, None if homes is None else numbered(homes), stratum_shares, weight)


def rate(trials: Trials) -> Estimate:
    """Share of successes; the interval is built on the logit scale, so it stays within 0 and 1.

    Args:
        trials: At least one trial; values are 0 or 1, or between them where an agent's runs were averaged.
    """
    return _estimate(trials, interval=rate_interval(trials))


def mean(trials: Trials, *, on_log: bool = False) -> Estimate:
    """Mean of any measure, or of differences on the same episodes, over at least one trial; as `mean_interval`."""
    return _estimate(trials, interval=mean_interval(trials, on_log=on_log))


def variance_of_mean(trials: Trials) -> tuple[float, float]:
    """Variance of the mean and Satterthwaite's degrees of freedom, with participants and `sampled_index` both random.

    The variance is the largest of the two-way sum and its parts, because the sum may come out too small, even negative
    (Cameron, Gelbach and Miller 2011). A factor with a single level adds nothing, but a single home tells nothing about
    other homes: then, and with one level of both factors, the variance is NaN.
    """
    if trials.home_index is not None and trials.num_sampled < 2:
        return float("nan"), 0.0
    centred = trials.values - trials.stratum_means[trials.stratum_index]
    return clustered_variance(trials.weights * centred, trials.participant_index, trials.sampled_index)


def clustered_variance(
    shares: NDArray[np.float64], participant_index: NDArray[np.intp], sampled_index: NDArray[np.intp]
) -> tuple[float, float]:
    """Variance of a weighted sum and Satterthwaite's degrees of freedom, from each trial's part in the sum.

    Args:
        shares: (N,), weight times residual of each trial.
        participant_index: (N,), as in `Trials`.
        sampled_index: (N,), as in `Trials`.
    """
    by_person = _cluster_variance(shares, participant_index)
    by_sampled = _cluster_variance(shares, sampled_index)
    cell = participant_index * (int(sampled_index.max(initial=-1)) + 1) + sampled_index
    by_cell = _cluster_variance(shares, np.unique(cell, return_inverse=True)[1])
    parts = [part for part in (by_person, by_sampled, by_cell) if part is not None]
    if by_cell is None:
        return float("nan"), 0.0
    together = 0.0
    if by_person is not None and by_sampled is not None:
        together = by_person[0] + by_sampled[0] - by_cell[0]
    variance = max(together, *(part for part, _ in parts))
    if variance == 0:
        return 0.0, float(min(df for _, df in parts))
    spread = sum(part**2 / df for part, df in parts)
    fewest = min(df for _, df in parts)
    return variance, max(variance**2 / spread, fewest)


def rate_interval(trials: Trials) -> Interval | None:
    """Interval of a share, built on the logit scale; None where the trials say nothing about others.

    All values are within 0 and 1. If each participant and episode (or home) occurs once, or there is one run, the
    interval is Wilson's. If all values are equal, it is exact and counts people or homes, not trials.
    """
    assert ((trials.values >= 0) & (trials.values <= 1)).all()
    n, share = len(trials.values), min(max(trials.mean, 0.0), 1.0)  # weights sum to 1 but for rounding
    share = float(round(share)) if np.isin(trials.values, (round(share),)).all() else share
    is_each_once = n == trials.num_sampled and trials.num_participants in (1, n)
    variance, df = variance_of_mean(trials)
    is_wilsons = is_each_once and trials.num_strata == 1 and np.isin(trials.values, (0, 1)).all()
    if is_wilsons and (trials.home_index is None or n > 1):
        return wilson_interval(round(share * n), n)
    if np.isnan(variance):
        return None
    if share in (0.0, 1.0):
        return _one_sided(trials, share)
    half = float(stdtrit(df, (1 + LEVEL) / 2)) * np.sqrt(variance) / (share * (1 - share))
    logit = np.log(share / (1 - share))
    low, high = 1 / (1 + np.exp(-(logit + np.array([-half, half]))))
    return Interval(low=float(low), high=float(high), method=f"{trials.factors} on the logit scale, t with {df:.1f} df")


def mean_interval(trials: Trials, *, on_log: bool = False) -> Interval | None:
    """Interval of a mean of any measure; None where one trial, or trials that are all alike, say nothing.

    Args:
        trials: At least one trial.
        on_log: Whether the interval is built on the log scale around the mean, so that its ends are the mean divided
            and multiplied by the same factor; for measures above 0, whose trials are skewed.
    """
    variance, df = variance_of_mean(trials)
    if not variance > (_ROUNDING * float(np.abs(trials.values).max())) ** 2:
        return None
    value = trials.mean
    half = float(stdtrit(df, (1 + LEVEL) / 2)) * float(np.sqrt(variance))
    if not on_log:
        return Interval(low=value - half, high=value + half, method=f"{trials.factors}, t with {df:.1f} df")
    factor = float(np.exp(half / value))
    return Interval(
        low=value / factor, high=value * factor, method=f"{trials.factors} on the log scale, t with {df:.1f} df"
    )


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


def _estimate(trials: Trials, *, interval: Interval | None) -> Estimate:
    return Estimate(
        value=trials.mean,
        n=len(trials.values),
        num_participants=trials.num_participants,
        num_episodes=trials.num_episodes,
        interval=interval,
    )


def _one_sided(trials: Trials, share: float) -> Interval:
    """Exact interval where all trials agree. They do not show how alike one person's trials are: each person is one."""
    n = min(count for count in (trials.num_participants, trials.num_sampled) if count > 1)
    rest = ((1 - LEVEL) / 2) ** (1 / n)
    low, high = (rest, 1.0) if share == 1 else (0.0, 1 - rest)
    return Interval(low=low, high=high, method=f"exact, all {len(trials.values)} trials alike, counted as {n}")


def _cluster_variance(share: NDArray[np.float64], group: NDArray[np.intp]) -> tuple[float, int] | None:
    """Variance of the sum of centred shares when whole groups are drawn, its degrees of freedom; None = one group."""
    sums = np.bincount(group, weights=share)
    groups = len(sums)
    return None if groups < 2 else (float(groups / (groups - 1) * (sums**2).sum()), groups - 1)
