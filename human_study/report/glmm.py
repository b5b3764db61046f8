"""The mixed model of HUMAN_STUDY.md, section 8, as data and a script for R; this program does not fit it."""

from collections.abc import Sequence
from math import isnan

from pandas import concat

from sim.homes.kind import scene_label, scene_labels
from sim.types import SPLITS, TaskKind

from ..export.text_tables import csv_lines
from .page import filled
from .trials import Frame, TrialGroup, is_first_condition

COLUMNS = (
    *("success", "condition", "split", "order", "prior_visits", "seconds_before"),
    *("participant", "episode", "house", "excluded"),
    *("scene_kind", "scene_label"),
)


def glmm_csv(people: Sequence[TrialGroup], task: TaskKind) -> str:
    """One line per counted trial of people; empty cells where the study's records are missing."""
    lines = []
    for group in (group for group in people if group.task == task):
        for trial in group.trials.itertuples():
            order, visits = (None if isnan(x) else int(x) for x in (trial.place, trial.prior_visits))
            seconds = None if isnan(trial.secs_before) else trial.secs_before
            excluded = trial.excluded if isinstance(trial.excluded, str) else None
            told = (int(trial.sr == 100), group.condition, trial.split, order, visits, seconds)
            whose = (trial.participant, trial.episode, trial.scene, excluded)
            lines.append((*told, *whose, group.scene_kind, scene_label(group.scene_kind)))
    return csv_lines(COLUMNS, sorted(lines, key=lambda line: (line[6], line[7], line[1])))


def glmm_script(people: Sequence[TrialGroup], task: TaskKind) -> str:
    """R code that fits `success ~ condition*split + order + prior_visits + (1|participant)+(1|episode)+(1|house)`.

    Terms that do not vary in these data are left out, because the model could not be fitted with them. Effects of
    conditions are those over all splits, against the condition that the report compares with.
    """
    groups = [group for group in people if group.task == task and not group.trials.empty]
    trials: Frame = concat([group.trials for group in groups])
    conditions = sorted(dict.fromkeys(group.condition for group in groups), key=lambda c: not is_first_condition(c))
    splits = [split for split in SPLITS if (trials["split"] == split).any()]
    randoms = {"participant": "participant", "episode": "episode", "house": "scene"}
    varies = {
        "condition": len(conditions) > 1,
        "split": len(splits) > 1,
        "order": trials["place"].nunique() > 1,
        "prior_visits": trials["prior_visits"].nunique() > 1,
        **{name: 1 < trials[column].nunique() < len(trials) for name, column in randoms.items()},
    }
    used = [name for name, has_many in varies.items() if has_many]
    crossed = " * ".join(name for name in used if name in ("condition", "split"))
    terms = [crossed, *(f"scale({name})" for name in used if name in ("order", "prior_visits"))]
    return filled(
        "glmm.R.j2",
        task=task,
        left_out=[name for name in varies if name not in used],
        fixed=[name for name in used if name not in randoms],
        labels=scene_labels(group.scene_kind for group in groups),
        conditions=conditions,
        splits=splits,
        contrasts=[f"_{name}" for name in splits[:-1]],
        is_mixed=any(name in randoms for name in used),
        terms=[
            *([term for term in terms if term] or ["1"]),
            *(f"(1 | {name})" for name in used if name in randoms),
        ],
        quoted=lambda names: ", ".join(f'"{name}"' for name in names),
    )
