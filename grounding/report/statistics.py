"""Intervals of success rates over episodes of several homes: by episode (Wilson), and by home (cluster bootstrap).

Episodes of one home share its map and resemble each other. An interval that treats episodes as independent holds for
more questions about these homes; one that resamples whole homes holds for other homes, which claims usually are about.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from sim.tasks import metrics

LEVEL = 0.95
"""Level of all intervals."""
NUM_RESAMPLES = 10_000
FEWEST_HOMES = 5
"""With fewer homes, a bootstrap interval is far too narrow and is left out."""


class Range(NamedTuple):
    """An interval."""

    low: float
    high: float


class Shares(BaseModel):
    """Success of first answers, and of the best of three; percent."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    sr: float
    by_home: Range | None
    top3: float | None
    """None for people, who give one point, and where runs do not hold the distances of three."""
    top3_by_home: Range | None


def wilson(k: float, n: int) -> Range:
    """Wilson's interval of a share of n episodes; k may be a sum of episodes' means over several seeds."""
    low, high = metrics.wilson(k, n)
    return Range(0.0 if k <= 0 else low, 1.0 if k >= n else high)


def mean_of_shares(shares: Sequence[float], ranges: Sequence[Range]) -> Range:
    """Interval of the plain mean of independent shares, from their intervals (MOVER; Zou and Donner 2008)."""
    mean, count = float(np.mean(shares)), len(shares)
    below = math.sqrt(sum((share - one.low) ** 2 for share, one in zip(shares, ranges, strict=True))) / count
    above = math.sqrt(sum((one.high - share) ** 2 for share, one in zip(shares, ranges, strict=True))) / count
    return Range(mean - below, mean + above)


def mean_of_splits(values: NDArray[np.float64], splits: Sequence[str]) -> float:
    """Plain mean of the splits' means of values (N,); `splits` (N,) names the split of each value."""
    names = np.asarray(splits)
    return float(np.mean([values[names == split].mean() for split in sorted(set(splits))]))


class HomeDraws:
    """Homes resampled with replacement; every figure uses the same draws, so that differences are paired."""

    def __init__(self, homes: Sequence[str], *, seed: int) -> None:
        """Draws from the different names in `homes`, in any order; the same seed and names give the same draws."""
        self._place = {name: index for index, name in enumerate(sorted(set(homes)))}
        count = len(self._place)
        rng = np.random.default_rng(seed)
        self._times = rng.multinomial(count, np.full(count, 1 / max(count, 1)), size=NUM_RESAMPLES) if count else None

    def interval(self, values: NDArray[np.float64], homes: Sequence[str], strata: Sequence[str]) -> Range | None:
        """Percentile interval, in percent, of the plain mean over strata of the mean of values (N,) in each.

        Args:
            values: One per episode: a share, or a difference of two.
            homes: (N,) the home of each; all must be among the names given at the start.
            strata: (N,) the split of each.

        Returns:
            None with fewer than FEWEST_HOMES homes among these, and if all values are equal, which says nothing about
            how homes differ. Draws without an episode of some stratum are left out.
        """
        if len(set(homes)) < FEWEST_HOMES or self._times is None or not np.ptp(values):
            return None
        at = np.array([self._place[home] for home in homes])
        names = np.asarray(strata)
        means = []
        for stratum in sorted(set(strata)):
            here = names == stratum
            sums = np.bincount(at[here], values[here], len(self._place))
            counts = np.bincount(at[here], minlength=len(self._place))
            over, under = self._times @ sums, self._times @ counts
            means.append(np.divide(over, under, out=np.full(len(over), np.nan), where=under > 0))
        drawn = np.mean(means, axis=0)
        tail = (1 - LEVEL) / 2
        low, high = np.quantile(drawn[np.isfinite(drawn)], [tail, 1 - tail])
        return Range(100 * float(low), 100 * float(high))

    def shares(
        self,
        first: NDArray[np.float64],
        three: NDArray[np.float64] | None,
        homes: Sequence[str],
        splits: Sequence[str],
    ) -> Shares:
        """The mean of splits of the successes (N,) of first answers, and of three if they are known."""
        return Shares(
            sr=100 * mean_of_splits(first, splits),
            by_home=self.interval(first, homes, splits),
            top3=None if three is None else 100 * mean_of_splits(three, splits),
            top3_by_home=None if three is None else self.interval(three, homes, splits),
        )
