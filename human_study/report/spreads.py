"""How a measure is spread over trials: quartiles, which no mean shows, and trials that have no value."""

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from sim.types import SPLITS, TaskKind

from .trial_groups import TrialGroup

SPREAD_MEASURES = ("dtg", "distance", "steps", "path_m", "t_s", "t_look_s")


class SpreadRow(BaseModel):
    """Quartiles of a measure over all trials of a row, in one split or all."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    task: TaskKind
    scene_kind: str
    who: str
    condition: str
    split: str
    """A split, or `all` trials alike."""
    measure: str
    lower: float
    median: float
    upper: float
    n: int
    """Trials with a value."""
    num_missing: int
    """Trials without one: for `dtg` those from whose end no way leads to the goal (unreachable)."""


def spread_rows(group: TrialGroup) -> list[SpreadRow]:
    """Rows for every measure of the group that has a spread worth showing."""
    rows = []
    for measure in (name for name in SPREAD_MEASURES if name in group.measures):
        for split in (*SPLITS, "all"):
            trials = [trial for trial in group.trials if split in (trial.key.split, "all")]
            values = [value for trial in trials if (value := trial.figures.get(measure)) is not None]
            if values:
                rows.append(_row(group, split, measure, values, num_missing=len(trials) - len(values)))
    return rows


def _row(group: TrialGroup, split: str, measure: str, values: Sequence[float], *, num_missing: int) -> SpreadRow:
    lower, median, upper = (float(value) for value in np.quantile(values, [0.25, 0.5, 0.75]))
    return SpreadRow(
        task=group.task,
        scene_kind=group.scene_kind,
        who=group.who,
        condition=group.condition,
        split=split,
        measure=measure,
        lower=lower,
        median=median,
        upper=upper,
        n=len(values),
        num_missing=num_missing,
    )
