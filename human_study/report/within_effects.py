"""Effects within people and within episodes: of memory, of the place in the order, of having been in the home before.

Whoever is better than others, and whichever episode is easier, drops out; what is left is how one person's trials
differ, at the same episodes as other people's. Both stay random for the interval, as in `statistics`.
"""

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.special import stdtr, stdtrit

from ..design.analysis import LEVEL
from .statistics import clustered_variance

_TINY = 1e-9
"""Share of a covariate's variation within people and episodes below which it has none."""


class Effect(BaseModel):
    """By how much a measure differs per unit of a covariate."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    value: float | None
    """In units of the measure; None = it cannot be told, `method` says why."""
    low: float | None
    high: float | None
    p: float | None
    """Two-sided, of no effect."""
    n: int
    """Trials."""
    num_participants: int
    num_episodes: int
    method: str


class WithinDesign:
    """Which trials there are and what the covariate is; many sets of outcomes may be tried on one."""

    def __init__(
        self,
        covariate: NDArray[np.float64],
        participant_index: NDArray[np.intp],
        episode_index: NDArray[np.intp],
        *,
        is_within_episodes: bool = True,
    ) -> None:
        """Takes out what people and episodes differ by.

        Args:
            covariate: (N,), such as 1 with memory and 0 without.
            participant_index: (N,), from 0, each at least once.
            episode_index: (N,), from 0, each at least once.
            is_within_episodes: Whether episodes' own difficulty is taken out too.
        """
        self._at = (participant_index, episode_index)
        self._factors = [participant_index, episode_index] if is_within_episodes else [participant_index]
        self._sizes = [int(index.max()) + 1 for index in self._factors]
        gram = self._sums_of_dummies()
        sizes, axes = np.linalg.eigh(gram)
        kept = sizes > _TINY * sizes[-1]
        self._inverse = (axes[:, kept] / sizes[kept]) @ axes[:, kept].T
        self._covariate = self._within(covariate)
        self._spread = float(self._covariate @ self._covariate)
        self._left = len(covariate) - int(kept.sum()) - 1
        self._whole = float(((covariate - covariate.mean()) ** 2).sum())
        self._what = "people and episodes" if is_within_episodes else "people"

    def effect(self, values: NDArray[np.float64]) -> Effect:
        """Slope of the values (N,) on the covariate."""
        people, episodes = self._at
        counts = {"n": len(values), "num_participants": int(people.max()) + 1, "num_episodes": int(episodes.max()) + 1}
        none = {"value": None, "low": None, "high": None, "p": None}
        if self._spread <= _TINY * max(self._whole, _TINY):
            return Effect(**none, **counts, method=f"cannot be told: it does not vary within {self._what}")  # type: ignore[arg-type]
        if self._left < 1:
            return Effect(**none, **counts, method=f"cannot be told: too few trials beside {self._what}")  # type: ignore[arg-type]
        within = self._within(values)
        slope = float(self._covariate @ within) / self._spread
        residual = within - slope * self._covariate
        correction = np.sqrt(len(values) / self._left)  # residuals are too small by what was taken out
        variance, df = clustered_variance(correction * self._covariate * residual / self._spread, people, episodes)
        error = float(np.sqrt(variance))
        if not error > _TINY * max(1.0, abs(slope)):
            unknown = none | {"value": slope}
            return Effect(**unknown, **counts, method="no interval: the trials do not differ otherwise")  # type: ignore[arg-type]
        half = float(stdtrit(df, (1 + LEVEL) / 2)) * error
        return Effect(
            value=slope,
            low=slope - half,
            high=slope + half,
            p=float(2 * stdtr(df, -abs(slope) / error)),
            **counts,
            method=f"within {self._what}, two-way, t with {df:.1f} df",
        )

    def _within(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """What is left of values (N,) when each factor's levels may have means of their own."""
        pairs = list(zip(self._factors, self._sizes, strict=True))
        sums = np.concatenate([np.bincount(index, values, minlength=size) for index, size in pairs])
        levels = np.split(self._inverse @ sums, np.cumsum(self._sizes)[:-1])
        return values - sum(level[index] for level, index in zip(levels, self._factors, strict=True))

    def _sums_of_dummies(self) -> NDArray[np.float64]:
        """(K, K): how many trials each two levels share."""
        firsts = np.concatenate([[0], np.cumsum(self._sizes)])
        gram = np.zeros((firsts[-1], firsts[-1]))
        for first, one in zip(firsts, self._factors, strict=False):
            for second, other in zip(firsts, self._factors, strict=False):
                np.add.at(gram, (first + one, second + other), 1.0)
        return gram


def holm(p_values: list[float]) -> list[float]:
    """Holm's adjusted p of each of a family of hypotheses, in the given order."""
    order = sorted(range(len(p_values)), key=lambda at: p_values[at])
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, at in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[at]))
        adjusted[at] = largest
    return adjusted
