"""What changes within people: with memory of the home, along the order of trials, after earlier visits to the home."""

from collections.abc import Callable, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.types import SPLITS, TaskKind

from .row_labels import is_first_condition
from .rows import Aggregate, estimate_of
from .statistics import numbered
from .trial_groups import CountedTrial, TrialGroup
from .within_effects import Effect, WithinDesign

PER_PLACES = 10
"""The order effect is given per so many trials."""
ORDER_BLOCK = 10
"""Trials in one row of the order table."""
EFFECT_MEASURES: dict[TaskKind, tuple[str, ...]] = {
    "pan": ("sr", "spl", "steps", "t_s"),
    "pog": ("sr", "distance", "t_s"),
}
_MODEL = ConfigDict(frozen=True, extra="forbid")
Covariate = Callable[[CountedTrial], float | None]


class EffectRow(BaseModel):
    """An effect on one measure."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    what: str
    """`CONDITION - none`, `per 10 trials`, `visited before`, or `per minute in the home before`."""
    condition: str
    """In which it was looked for; `all` = all of them."""
    split: str
    """A split, or `all`."""
    measure: str
    effect: Effect
    """In percent points for success and SPL."""


class BlockRow(BaseModel):
    """A measure over trials that have something in common: their place in the order, or earlier visits."""

    model_config = _MODEL
    task: TaskKind
    scene_kind: str
    condition: str
    by: str
    """`order` or `visits`."""
    block: str
    """Such as `1-10`, or `visited before`."""
    measure: str
    value: float
    low: float | None
    high: float | None
    k: int | None
    n: int


def memory_effects(people: Sequence[TrialGroup]) -> list[EffectRow]:
    """Each condition against the first of its task (`none`, or `map_first`), within people and within episodes."""
    rows = []
    for task, kind in dict.fromkeys((group.task, group.scene_kind) for group in people):
        groups = [group for group in people if (group.task, group.scene_kind) == (task, kind)]
        base = next((group for group in groups if is_first_condition(group.condition)), groups[0])
        for other in (group for group in groups if group is not base):
            trials = [*base.trials, *other.trials]
            with_it = {id(trial) for trial in other.trials}
            what = f"{other.condition} - {base.condition}"
            for split in ("all", *SPLITS):
                found = [trial for trial in trials if split in (trial.key.split, "all")]
                rows += _effects(other, what, "all", split, found, lambda trial, ids=with_it: float(id(trial) in ids))
    return rows


def order_effects(people: Sequence[TrialGroup]) -> list[EffectRow]:
    """Slopes on the place in the order, and on having been in the home before; needs the study's records."""
    rows = []
    for group in people:
        if any(trial.place is not None for trial in group.trials):
            for what, covariate in _COVARIATES.items():
                rows += _effects(group, what, group.condition, "all", group.trials, covariate)
    return rows


def order_blocks(people: Sequence[TrialGroup]) -> list[BlockRow]:
    """Success and effort by place in the order, and with and without earlier visits to the home."""
    rows = []
    for group in people:
        placed = [trial for trial in group.trials if trial.place is not None]
        for first in range(1, max((trial.place or 0 for trial in placed), default=0) + 1, ORDER_BLOCK):
            last = first + ORDER_BLOCK - 1
            found = [trial for trial in placed if first <= (trial.place or 0) <= last]
            rows += _blocks(group, "order", f"{first}-{last}", found)
        for label, is_visit in (("first visit", False), ("visited before", True)):
            found = [
                trial
                for trial in placed
                if trial.row is not None
                and trial.row.prior_visits_scene is not None
                and (trial.row.prior_visits_scene > 0) == is_visit
            ]
            rows += _blocks(group, "visits", label, found)
    return rows


def _place(trial: CountedTrial) -> float | None:
    return None if trial.place is None else trial.place / PER_PLACES


def _visited(trial: CountedTrial) -> float | None:
    visits = trial.row.prior_visits_scene if trial.row is not None else None
    return None if visits is None else float(visits > 0)


def _minutes(trial: CountedTrial) -> float | None:
    seconds = trial.row.secs_in_scene_before if trial.row is not None else None
    return None if seconds is None else seconds / 60


_COVARIATES: dict[str, Covariate] = {
    f"per {PER_PLACES} trials": _place,
    "visited before": _visited,
    "per minute in the home before": _minutes,
}


def _effects(
    group: TrialGroup,
    what: str,
    condition: str,
    split: str,
    trials: Sequence[CountedTrial],
    covariate: Covariate,
) -> list[EffectRow]:
    rows = []
    designs: dict[tuple[int, ...], WithinDesign] = {}  # measures that the same trials have share one
    for measure in EFFECT_MEASURES[group.task]:
        known = [
            (trial, value, x)
            for trial in trials
            if (value := trial.figures.get(measure)) is not None and (x := covariate(trial)) is not None
        ]
        if len(known) < 2:
            continue
        name = tuple(id(trial) for trial, _, _ in known)
        if name not in designs:
            designs[name] = WithinDesign(
                np.array([x for _, _, x in known]),
                numbered([trial.participant for trial, _, _ in known]),
                numbered([str(trial.key) for trial, _, _ in known]),
            )
        effect = designs[name].effect(np.array([value for _, value, _ in known], np.float64))
        rows.append(
            EffectRow(
                task=group.task,
                scene_kind=group.scene_kind,
                what=what,
                condition=condition,
                split=split,
                measure=measure,
                effect=effect,
            )
        )
    return rows


def _blocks(group: TrialGroup, by: str, block: str, trials: Sequence[CountedTrial]) -> list[BlockRow]:
    rows = []
    for measure in ("sr", "steps" if group.task == "pan" else "t_s"):
        known = [value for trial in trials if (value := trial.figures.get(measure)) is not None]
        if not known:
            continue
        estimate = estimate_of(trials, measure, Aggregate(total="pooled"), is_share=measure == "sr")
        interval = estimate.interval
        rows.append(
            BlockRow(
                task=group.task,
                scene_kind=group.scene_kind,
                condition=group.condition,
                by=by,
                block=block,
                measure=measure,
                value=estimate.value,
                low=interval.low if interval else None,
                high=interval.high if interval else None,
                k=sum(value == 100 for value in known) if measure == "sr" else None,
                n=estimate.n,
            )
        )
    return rows
