"""Effects of memory, of the place in the order and of earlier visits to the home, within people and within episodes.

Differences between people and between episodes drop out. What remains is how one person's trials differ, compared with
other people's trials at the same episodes. For the interval people, episodes and homes stay random, as in `statistics`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import concat
from scipy.sparse import csr_array
from scipy.special import stdtr, stdtrit

from sim.types import SPLITS

from ..design.analysis import LEVEL
from .measures import MEASURES, measures_of
from .rows import Aggregate, estimate_of, possible
from .statistics import Interval, clustered_variance, numbered
from .trials import Frame, PeopleRow, ReportValue, TrialGroup, is_first_condition

PER_PLACES = 10
"""The order effect is given per this number of trials."""
ORDER_BLOCK = 10
"""Trials in one row of the order table."""
_TINY = 1e-9
"""A covariate with less than this share of its variation within people and episodes counts as constant there."""


class Effect(ReportValue):
    """The change of a measure per unit of a covariate."""

    value: float | None = None
    """The effect in units of the measure; None = it cannot be estimated, and `method` says why."""
    low: float | None = None
    high: float | None = None
    p: float | None = None
    """Two-sided p of no effect."""
    n: int
    """Number of trials."""
    num_participants: int
    num_episodes: int
    method: str


class EffectRow(PeopleRow):
    """An effect on one measure, in one condition or in `all` of them."""

    what: str
    """`CONDITION - none`, `per 10 trials`, `visited before`, or `per minute in the home before`."""
    split: str
    """A split, or `all`."""
    measure: str
    effect: Effect
    """The effect; in percent points for success and SPL."""


class BlockRow(PeopleRow):
    """A measure over trials that share their place in the order, or whether the person had visited the home."""

    by: str
    """`order` or `visits`."""
    block: str
    """Name of the trials, such as `1-10` or `visited before`."""
    measure: str
    value: float
    low: float | None
    high: float | None
    k: int | None
    n: int


def memory_effects(people: Sequence[TrialGroup], aggregate: Aggregate) -> list[EffectRow]:
    """Each condition against the first of its task (`none`, or `map_first`), within people and within episodes."""
    rows = []
    for task, kind in dict.fromkeys((group.task, group.scene_kind) for group in people):
        groups = [group for group in people if (group.task, group.scene_kind) == (task, kind)]
        base = next((group for group in groups if is_first_condition(group.condition)), groups[0])
        for other in (group for group in groups if group is not base):
            both = [base.trials.assign(covariate=0.0), other.trials.assign(covariate=1.0)]
            trials = concat(both, ignore_index=True)
            what = f"{other.condition} - {base.condition}"
            for split in ("all", *SPLITS):
                found = trials if split == "all" else trials[trials["split"] == split]
                rows += _effects(other, what, "all", split, found, aggregate)
    return rows


def order_effects(people: Sequence[TrialGroup], aggregate: Aggregate) -> list[EffectRow]:
    """Slopes on the place in the order and on earlier visits to the home; needs the study's records."""
    rows = []
    for group in people:
        if group.trials["place"].notna().any():
            for what, covariate in _COVARIATES.items():
                trials = group.trials.assign(covariate=covariate)
                rows += _effects(group, what, group.condition, "all", trials, aggregate)
    return rows


def order_blocks(people: Sequence[TrialGroup], aggregate: Aggregate) -> list[BlockRow]:
    """Success and effort by place in the order, and with and without earlier visits to the home; splits are pooled."""
    rows, pooled = [], Aggregate(total="pooled", intervals=aggregate.intervals)
    for group in people:
        placed = group.trials[group.trials["place"].notna()]
        if placed.empty:
            continue
        for first in range(1, int(placed["place"].max()) + 1, ORDER_BLOCK):
            last = first + ORDER_BLOCK - 1
            rows += _blocks(group, "order", f"{first}-{last}", placed[placed["place"].between(first, last)], pooled)
        rows += _blocks(group, "visits", "first visit", placed[placed["prior_visits"] == 0], pooled)
        rows += _blocks(group, "visits", "visited before", placed[placed["prior_visits"] > 0], pooled)
    return rows


_COVARIATES: dict[str, Callable[[Frame], Any]] = {
    f"per {PER_PLACES} trials": lambda trials: trials["place"] / PER_PLACES,
    "visited before": lambda trials: (trials["prior_visits"] > 0).where(trials["prior_visits"].notna()).astype(float),
    "per minute in the home before": lambda trials: trials["secs_before"] / 60,
}


def _effects(
    group: TrialGroup, what: str, condition: str, split: str, trials: Frame, aggregate: Aggregate
) -> list[EffectRow]:
    """The effect of the column `covariate` on each measure."""
    rows = []
    designs: dict[tuple[int, ...], WithinDesign] = {}  # measures that the same trials have share one
    for measure in (name for name in measures_of(group.task) if MEASURES[name].has_effect):
        known = trials[trials[measure].notna() & trials["covariate"].notna()]
        if len(known) < 2:
            continue
        name = tuple(known.index)
        if name not in designs:
            people, episodes, homes = (numbered(known[factor]) for factor in ("participant", "episode", "scene"))
            home_index = homes if aggregate.intervals == "homes" else None
            designs[name] = WithinDesign(known["covariate"].to_numpy(float), people, episodes, home_index)
        effect = designs[name].effect(known[measure].to_numpy(float))
        if known["covariate"].isin((0, 1)).all():
            effect = _of_possible_values(effect, MEASURES[measure].most)
        names = {**group.people_names, "condition": condition}
        rows.append(EffectRow(**names, what=what, split=split, measure=measure, effect=effect))
    return rows


def _of_possible_values(effect: Effect, most: float) -> Effect:
    """The difference of two conditions, with an interval that ends where possible differences end."""
    if effect.low is None or effect.high is None:
        return effect
    cut = possible(Interval(effect.low, effect.high, effect.method), -most, most)
    return effect.model_copy(update={"low": cut.low, "high": cut.high, "method": cut.method})


def _blocks(group: TrialGroup, by: str, block: str, trials: Frame, pooled: Aggregate) -> list[BlockRow]:
    rows = []
    for measure in ("sr", "steps" if group.task == "pan" else "t_s"):
        if trials[measure].isna().all():
            continue
        estimate = estimate_of(trials, measure, pooled)
        found = {"by": by, "block": block, "measure": measure, "n": estimate.n}
        k = int((trials[measure] == 100).sum()) if measure == "sr" else None
        limits = {"value": estimate.value, "low": estimate.low, "high": estimate.high}
        rows.append(BlockRow(**group.people_names, **found, **limits, k=k))
    return rows


class WithinDesign:
    """The trials and their covariate, prepared once; `effect` can then be called for many sets of outcomes."""

    def __init__(
        self,
        covariate: NDArray[np.float64],
        participant_index: NDArray[np.intp],
        episode_index: NDArray[np.intp],
        home_index: NDArray[np.intp] | None = None,
    ) -> None:
        """Takes the differences between people and between episodes out of the covariate.

        Args:
            covariate: (N,), such as 1 with memory and 0 without.
            participant_index: (N,), from 0, each at least once.
            episode_index: (N,), from 0, each at least once.
            home_index: (N,), from 0, each at least once; None = homes are not random.
        """
        self._sampled = (participant_index, episode_index if home_index is None else home_index)
        self._factors = "two-way" if home_index is None else "people, episodes and homes random (three-way)"
        self._is_one_home = home_index is not None and not home_index.any()
        self._sizes = (int(participant_index.max()) + 1, int(episode_index.max()) + 1)
        levels = np.column_stack([participant_index, self._sizes[0] + episode_index])
        firsts = np.arange(0, levels.size + 1, 2)
        self._dummies = csr_array((np.ones(levels.size), levels.ravel(), firsts), (len(levels), sum(self._sizes)))
        gram = (self._dummies.T @ self._dummies).toarray()
        sizes, axes = np.linalg.eigh(gram)
        kept = sizes > _TINY * sizes[-1]
        self._inverse = (axes[:, kept] / sizes[kept]) @ axes[:, kept].T
        self._covariate = self._within(covariate)
        self._spread = float(self._covariate @ self._covariate)
        self._left = len(covariate) - int(kept.sum()) - 1
        self._whole = float(((covariate - covariate.mean()) ** 2).sum())

    def effect(self, values: NDArray[np.float64]) -> Effect:
        """Slope of the values (N,) on the covariate."""
        counts = {"n": len(values), "num_participants": self._sizes[0], "num_episodes": self._sizes[1]}
        if self._spread <= _TINY * max(self._whole, _TINY):
            return Effect(**counts, method="cannot be told: it does not vary within people and episodes")
        if self._left < 1:
            return Effect(**counts, method="cannot be told: too few trials beside people and episodes")
        within = self._within(values)
        slope = float(self._covariate @ within) / self._spread
        if self._is_one_home:
            return Effect(**counts, value=slope, method="no interval: a single home says nothing of others")
        residual = within - slope * self._covariate
        correction = np.sqrt(len(values) / self._left)  # residuals lack what was taken out
        variance, df = clustered_variance(correction * self._covariate * residual / self._spread, *self._sampled)
        error = float(np.sqrt(variance))
        if not error > _TINY * max(1.0, abs(slope)):
            return Effect(**counts, value=slope, method="no interval: the trials do not differ otherwise")
        half = float(stdtrit(df, (1 + LEVEL) / 2)) * error
        p = float(2 * stdtr(df, -abs(slope) / error))
        method = f"within people and episodes, {self._factors}, t with {df:.1f} df"
        return Effect(**counts, value=slope, low=slope - half, high=slope + half, p=p, method=method)

    def _within(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The residuals of values (N,) when each level of each factor has a mean of its own."""
        return values - self._dummies @ (self._inverse @ (self._dummies.T @ values))


def holm(p_values: list[float]) -> list[float]:
    """Holm's adjusted p of each hypothesis in a family, in the given order."""
    order = sorted(range(len(p_values)), key=lambda at: p_values[at])
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, at in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[at]))
        adjusted[at] = largest
    return adjusted
