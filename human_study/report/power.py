"""Simulates how precise a study will be, with the report's own intervals (`study plan --power`).

People and episodes are drawn at random on the logit scale (HUMAN_STUDY.md, section 8): planning figures, not findings.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from scipy.special import expit, logit

from sim.errors import StudyError

from ..design.plan import StudyPlan
from ..design.study import StudyConfig
from .effects import WithinDesign
from .statistics import Interval, Trials, mean_interval, rate_interval

RELEASED = {"easy": 600, "medium": 700, "hard": 700}
"""Episodes in the authors' repository (d997eca), for a study that uses all of them."""
NUM_HOMES = 31
"""Number of homes in the released dataset, and most trials of a person where nobody meets a home twice."""
MOST_SD = 4.0
"""Largest spread on the logit scale; people one spread below and above one half succeed in 2 and 98 percent."""
_MODEL = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PowerAssumptions(BaseModel):
    """Assumptions about people, episodes and agents."""

    model_config = _MODEL
    base_rate: float = Field(default=0.65, gt=0, lt=1)
    """Success rate of people over all splits."""
    split_gap: float = Field(default=0.10, gt=0, lt=1)
    """Difference of success between two splits, around the base rate."""
    agent_gap: float = Field(default=0.15, gt=0, lt=1)
    """How much lower an agent's success rate is than people's, on the same episodes, in one run."""
    memory_gap: float = Field(default=0.10, gt=0, lt=1)
    """How much higher people's success rate is with memory."""
    person_sds: tuple[Annotated[float, Field(ge=0, le=MOST_SD)], ...] = Field(default=(0.3, 0.9), min_length=1)
    """Spreads of people on the logit scale: one for similar people and one for different people."""
    episode_sd: float = Field(default=1.3, ge=0, le=MOST_SD)
    """Spread of episodes on the logit scale; 1.3 gives the figures of HUMAN_STUDY.md, section 3."""
    agent_alike: float = Field(default=0.5, ge=0, le=1)
    """Share of the episodes' variance in difficulty that people and the agent have in common."""
    home_share: float = Field(default=0.15, ge=0, le=1)
    """Share of the episodes' variance in difficulty that is that of their homes, where homes are random."""
    num_simulations: int = Field(default=150, ge=20, le=20_000)
    seed: int = Field(default=0, ge=0)


@dataclass(frozen=True, slots=True)
class PowerDesign:
    """The assignment of people to episodes, as far as precision depends on it; the same in every split."""

    label: str
    num_people: int
    episodes_per_split: int
    raters: int
    """People per episode and condition."""
    num_splits: int = 3
    num_conditions: int = 1
    num_homes: int | None = None
    """Homes over which the episodes are spread; None = intervals take episodes for random, and not homes."""

    def home_index(self, episodes: NDArray[np.intp]) -> NDArray[np.intp] | None:
        """The home of each episode, numbered over all splits; None where homes are not random."""
        return None if self.num_homes is None else episodes % self.num_homes

    @property
    def trials_per_split(self) -> int:
        """Number of trials of one condition in one split."""
        return self.episodes_per_split * self.raters

    @property
    def trials_per_person(self) -> float:
        """Number of trials of one person in all splits and conditions."""
        return self.trials_per_split * self.num_splits * self.num_conditions / self.num_people

    def split_trials(self, condition: int = 0) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The people and the episodes of a split's trials of a condition, each (N,).

        There are as many groups of episodes as conditions. People of one arm meet a group's episodes in one condition,
        people of the next arm in the next condition.
        """
        arms = self.num_conditions
        episodes = np.repeat(np.arange(self.episodes_per_split), self.raters)
        place = np.tile(np.arange(self.raters), self.episodes_per_split)
        of_arm = self.num_people // arms
        stride = max(1, of_arm // self.raters)
        people = (condition - episodes) % arms + arms * ((episodes // arms + place * stride) % of_arm)
        return people, episodes


class PowerRow(BaseModel):
    """A design under one spread of people."""

    model_config = _MODEL
    design: str
    person_sd: float
    num_people: int
    episodes_per_split: int
    raters_per_episode: int
    trials_per_person: float
    trials: int
    """Trials of all people, in all splits and conditions."""
    width_split: float
    """Mean full width of a split's 95 % interval of the success rate, points."""
    width_total: float
    """Mean full width of the total's interval, points."""
    power_splits: float
    """Share of studies that tell two splits apart."""
    power_agent: float
    """Share of studies that tell people and agent apart, on one split's episodes."""
    power_memory: float | None
    """Share of studies that find the effect of memory within people, all splits together; None = one condition."""


class PowerReport(BaseModel):
    """The output of `study plan --power --json`."""

    model_config = _MODEL
    assumptions: PowerAssumptions
    num_homes: int | None = None
    """Homes of all designs; None = intervals take episodes for random, and not homes."""
    rows: tuple[PowerRow, ...]
    """For each spread of people: the design first, then alternatives."""


def power_report(design: PowerDesign, *, assumptions: PowerAssumptions) -> PowerReport:
    """Precision and power of a design and of others like it.

    Raises:
        StudyError: The gaps give a success rate outside 0 to 1.
    """
    base, half = assumptions.base_rate, assumptions.split_gap / 2
    rates = (base - assumptions.agent_gap, base + assumptions.memory_gap, base - half, base + half)
    if not all(0 < rate < 1 for rate in rates):
        raise StudyError(
            f"power: base rate {base:g} with the gaps gives rates from {min(rates):g} to {max(rates):g}; expected all "
            "within 0 and 1. Give smaller gaps. See personal-viz study plan --help."
        )
    designs = [design, *alternatives(design)]
    rows = [
        power_row(one, person_sd=spread, assumptions=assumptions)
        for spread in assumptions.person_sds
        for one in designs
    ]
    return PowerReport(assumptions=assumptions, num_homes=design.num_homes, rows=tuple(rows))


def design_of(config: StudyConfig, plan: StudyPlan | None = None) -> PowerDesign:
    """A study's design for its first task, by the study file where there is no plan; splits count as their mean.

    Raises:
        StudyError: The study is of home sequences.
    """
    if config.sequences is not None:
        raise StudyError(
            f"study plan --power: found {config.study}, a study of home sequences; expected one of episodes, because "
            "searches that share a sequence are not simulated. Leave out --power, or the study."
        )
    task, kind = config.task[0], config.design.kind
    arms, raters = len(config.conditions(task)), config.design.raters_per_episode
    sizes = [RELEASED[split] if size == "all" else size for split, size in config.dataset.splits.items()]
    total, people, homes = sum(sizes), raters * arms, len(config.dataset.scenes) or NUM_HOMES
    if kind == "house-once":
        most = min(config.design.trials_per_person or NUM_HOMES, NUM_HOMES)
        least = math.ceil(total * arms * raters / most)
        people = max(math.ceil(least / arms) * arms, raters * arms * (config.dataset.max_per_scene or 1))
    if plan is not None:
        mine = [person for person in plan.participants if person.task == task]
        drawn = [{trial.key for trial in person.trials if trial.phase == "main"} for person in mine]
        people, total = sum(bool(keys) for keys in drawn), len(set().union(*drawn))
        homes = len({trial.scene for person in mine for trial in person.trials if trial.phase == "main"})
    episodes = max(1, round(total / len(sizes)))
    num_homes = homes if config.aggregate.intervals == "homes" else None
    return PowerDesign(f"this study: {kind}, {people} people", people, episodes, raters, len(sizes), arms, num_homes)


def alternatives(design: PowerDesign) -> list[PowerDesign]:
    """Other designs with the same number of trials, and with twice as many."""
    arms = design.num_conditions
    people, episodes, raters = design.num_people, design.episodes_per_split, design.raters
    half = max(1, raters // 2)
    twice = 2 * people
    found = [
        replace(design, label="as many trials, twice the people", num_people=twice),
        replace(
            design,
            label="as many trials, more episodes, fewer people each",
            episodes_per_split=max(1, round(episodes * raters / half)),
            raters=half,
        ),
        replace(design, label="twice the trials: twice the people", num_people=twice, raters=2 * raters),
        replace(design, label="twice the trials: twice the episodes", episodes_per_split=2 * episodes),
        replace(design, label="twice the trials: twice both", num_people=twice, episodes_per_split=2 * episodes),
        replace(design, label="the paper: 5 people, the same 50", num_people=5 * arms, raters=5, episodes_per_split=50),
    ]
    different: dict[tuple[int, int, int], PowerDesign] = {}
    for one in (design, *found):
        different.setdefault((one.num_people, one.episodes_per_split, one.raters), one)
    return list(different.values())[1:]


def power_row(design: PowerDesign, *, person_sd: float, assumptions: PowerAssumptions) -> PowerRow:
    """One design under one spread of people; draws the same studies every time."""
    model = _Model(design, person_sd, assumptions)
    return PowerRow(
        design=design.label,
        person_sd=person_sd,
        num_people=design.num_people,
        episodes_per_split=design.episodes_per_split,
        raters_per_episode=design.raters,
        trials_per_person=round(design.trials_per_person, 1),
        trials=design.trials_per_split * design.num_splits * design.num_conditions,
        width_split=100 * model.over(model.split_width),
        width_total=100 * model.over(model.total_width),
        power_splits=model.over(model.tells_splits),
        power_agent=model.over(model.tells_agent),
        power_memory=model.over(model.finds_memory) if design.num_conditions > 1 else None,
    )


class _Model:
    """Draws random studies of a design."""

    def __init__(self, design: PowerDesign, person_sd: float, assumptions: PowerAssumptions) -> None:
        self._design, self._person_sd, self._assumptions = design, person_sd, assumptions
        self._spread = float(np.hypot(person_sd, assumptions.episode_sd))
        self._rng = np.random.default_rng([assumptions.seed, round(1000 * person_sd)])
        self._people, self._episodes = design.split_trials()
        self._within = _memory_design(design) if design.num_conditions > 1 else None

    def over(self, once: Callable[[], float]) -> float:
        """Mean of `once` over the simulations."""
        return float(np.mean([once() for _ in range(self._assumptions.num_simulations)]))

    def split_width(self) -> float:
        hits = self._hits([self._assumptions.base_rate])
        return _width(rate_interval(self._trials(hits, 1)))

    def total_width(self) -> float:
        number = self._design.num_splits
        hits = self._hits([self._assumptions.base_rate] * number)
        return _width(rate_interval(self._trials(hits, number)))

    def tells_splits(self) -> bool:
        base, gap = self._assumptions.base_rate, self._assumptions.split_gap
        hits = self._hits([base + gap / 2, base - gap / 2])
        return _excludes_zero(mean_interval(replace(self._trials(hits, 2), stratum_shares=(1.0, -1.0))))

    def tells_agent(self) -> bool:
        """Whether a drawn study tells people and agent apart on one split, trial by trial as the report does it."""
        base, gap, spread = self._assumptions.base_rate, self._assumptions.agent_gap, self._assumptions.episode_sd
        (ease,) = self._ease(1)
        own = spread * self._rng.normal(size=len(ease))
        alike = self._assumptions.agent_alike
        theirs = _centre(base - gap, spread) + math.sqrt(alike) * ease + math.sqrt(1 - alike) * own
        agent = self._rng.random(len(ease)) < expit(theirs)
        skill = self._person_sd * self._rng.normal(size=self._design.num_people)
        ours = _centre(base, self._spread) + skill[self._people] + ease[self._episodes]
        hits = (self._rng.random(len(ours)) < expit(ours)).astype(np.float64)
        return _excludes_zero(mean_interval(self._trials(hits - agent[self._episodes], 1)))

    def finds_memory(self) -> bool:
        """Whether a drawn study tells the first two conditions apart, within people and episodes, over all splits."""
        assert self._within is not None
        within, people, episodes, has_map = self._within
        base, gap = self._assumptions.base_rate, self._assumptions.memory_gap
        centres = np.array([_centre(base, self._spread), _centre(base + gap, self._spread)])
        skill = self._person_sd * self._rng.normal(size=self._design.num_people)
        ease = self._ease(self._design.num_splits).ravel()
        chance = expit(centres[has_map] + skill[people] + ease[episodes])
        effect = within.effect((self._rng.random(len(chance)) < chance).astype(np.float64))
        return effect.p is not None and effect.p < 0.05

    def _hits(self, rates: list[float]) -> NDArray[np.float64]:
        """Outcomes of several splits, one after the other; people are the same in all."""
        skill = self._person_sd * self._rng.normal(size=self._design.num_people)
        ease = self._ease(len(rates))
        chance = [
            expit(_centre(rate, self._spread) + skill[self._people] + ease[split, self._episodes])
            for split, rate in enumerate(rates)
        ]
        whole = np.concatenate(chance)
        return (self._rng.random(len(whole)) < whole).astype(np.float64)

    def _ease(self, num_splits: int) -> NDArray[np.float64]:
        """How easy each episode is, (splits, episodes); those of one home have a part in common."""
        size, spread = self._design.episodes_per_split, self._assumptions.episode_sd
        ease = spread * self._rng.normal(size=(num_splits, size))
        homes = self._design.home_index(np.arange(num_splits * size))
        if homes is None:
            return ease
        share = self._assumptions.home_share
        of_home = spread * self._rng.normal(size=int(homes.max()) + 1)[homes].reshape(ease.shape)
        return math.sqrt(share) * of_home + math.sqrt(1 - share) * ease

    def _trials(self, values: NDArray[np.float64], number: int) -> Trials:
        """The trials of several splits, one after the other, with these values."""
        who = np.unique(self._people, return_inverse=True)[1]
        split = np.repeat(np.arange(number), len(who))
        where = np.tile(self._episodes, number) + split * self._design.episodes_per_split
        homes = self._design.home_index(where)
        home_index = None if homes is None else np.unique(homes, return_inverse=True)[1]
        return Trials(values, np.tile(who, number), where, split, home_index)


@functools.lru_cache(maxsize=16)
def _memory_design(
    design: PowerDesign,
) -> tuple[WithinDesign, NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Trials of the first two conditions in all splits: their `WithinDesign`, people, episodes and conditions."""
    size, splits = design.episodes_per_split, range(design.num_splits)
    both = [design.split_trials(condition) for condition in (0, 1)]
    people = np.concatenate([who for who, _ in both for _ in splits])
    episodes = np.concatenate([where + size * split for _, where in both for split in splits])
    has_map = np.repeat([0, 1], [len(who) * len(splits) for who, _ in both])
    index = np.unique(people, return_inverse=True)[1]
    homes = design.home_index(episodes)
    home_index = None if homes is None else np.unique(homes, return_inverse=True)[1]
    return WithinDesign(has_map.astype(np.float64), index, episodes, home_index), people, episodes, has_map


def _width(interval: Interval | None) -> float:
    return 1.0 if interval is None else interval.high - interval.low


def _excludes_zero(interval: Interval | None) -> bool:
    return interval is not None and (interval.low > 0 or interval.high < 0)


_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(40)


@functools.cache
def _centre(rate: float, spread: float) -> float:
    """Logit around which draws of this spread succeed at this rate, by the usual approximation, then Newton steps."""
    centre = float(logit(rate)) * math.sqrt(1 + spread**2 / 2.9)
    for _ in range(4):
        share = expit(centre + spread * _NODES)
        mean, slope = (_WEIGHTS @ part / _WEIGHTS.sum() for part in (share, share * (1 - share)))
        centre -= float((mean - rate) / slope)
    return centre
