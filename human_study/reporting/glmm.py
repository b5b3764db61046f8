"""The mixed model of HUMAN_STUDY.md, section 8, as data and a script for R: this program fits none itself."""

from collections.abc import Sequence

from sim.types import TaskKind

from ..tables.csv_cells import csv_lines
from .trial_groups import TrialGroup

COLUMNS = (
    *("success", "condition", "split", "order", "prior_visits", "seconds_before"),
    *("participant", "episode", "house", "excluded"),
)


def glmm_csv(people: Sequence[TrialGroup], task: TaskKind) -> str:
    """One line per counted trial of people; empty cells where the study's records are not at hand."""
    lines = []
    for group in (group for group in people if group.task == task):
        for trial in group.trials:
            row = trial.row
            lines.append(
                (
                    int(trial.figures["sr"] == 100),
                    group.condition,
                    trial.key.split,
                    trial.place,
                    row.prior_visits_scene if row else None,
                    row.secs_in_scene_before if row else None,
                    trial.participant,
                    str(trial.key),
                    trial.key.scene,
                    ";".join(row.excluded) if row else None,
                )
            )
    return csv_lines(COLUMNS, sorted(lines, key=lambda line: (line[6], line[7], line[1])))


def glmm_script(people: Sequence[TrialGroup], task: TaskKind) -> str:
    """R code that fits `success ~ condition*split + order + prior_visits + (1|participant)+(1|episode)+(1|house)`.

    Terms that do not vary in these data are left out, because the model could not be fitted with them.
    """
    groups = [group for group in people if group.task == task]
    trials = [trial for group in groups for trial in group.trials]
    has_many = {
        "condition": len({group.condition for group in groups}) > 1,
        "split": len({trial.key.split for trial in trials}) > 1,
        "order": len({trial.place for trial in trials} - {None}) > 1,
        "prior_visits": len({trial.row.prior_visits_scene for trial in trials if trial.row} - {None}) > 1,
    }
    randoms = {
        "participant": len({trial.participant for trial in trials}) > 1,
        "episode": len({trial.key for trial in trials}) > 1,
        "house": len({trial.key.scene for trial in trials}) > 1,
    }
    crossed = [name for name in ("condition", "split") if has_many[name]]
    fixed = [" * ".join(crossed)] if crossed else []
    fixed += [f"scale({name})" for name in ("order", "prior_visits") if has_many[name]]
    formula = " + ".join([*(fixed or ["1"]), *(f"(1 | {name})" for name, many in randoms.items() if many)])
    left_out = [name for name, many in (has_many | randoms).items() if not many]
    note = f"# Left out, because they do not vary here: {', '.join(left_out)}.\n" if left_out else ""
    first = next((name for name in ("none", "map_first") if any(g.condition == name for g in groups)), "")
    base = f'd$condition <- relevel(factor(d$condition), ref = "{first}")\n' if has_many["condition"] and first else ""
    split = 'd$split <- factor(d$split, levels = c("easy", "medium", "hard"))\n' if has_many["split"] else ""
    return f"""# Mixed model of success, people's {task.upper()} trials. Run: Rscript {task}-glmm.R (package lme4)
{note}library(lme4)
d <- read.csv("{task}-trials.csv", na.strings = "")
{base}{split}fit <- glmer(
  success ~ {formula},
  data = d, family = binomial, control = glmerControl(optimizer = "bobyqa", optCtrl = list(maxfun = 2e5))
)
print(summary(fit))
print(confint(fit, parm = "beta_", method = "Wald"))  # log odds
print(sessionInfo())
"""
