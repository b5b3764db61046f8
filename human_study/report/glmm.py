"""The mixed model of HUMAN_STUDY.md, section 8, as data and a script for R; this program does not fit it."""

from collections.abc import Iterable, Sequence
from math import isnan

from pandas import concat

from sim.homes.kind import scene_label, scene_labels
from sim.types import SPLITS, TaskKind

from ..export.text_tables import csv_lines
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
    crossed = {"condition": len(conditions) > 1, "split": len(splits) > 1}
    numbers = {"order": "place", "prior_visits": "prior_visits"}
    scaled = {name: trials[column].nunique() > 1 for name, column in numbers.items()}
    randoms = {"participant": "participant", "episode": "episode", "house": "scene"}
    grouped = {name: 1 < trials[column].nunique() < len(trials) for name, column in randoms.items()}
    left_out = [name for name, has_many in (crossed | scaled | grouped).items() if not has_many]
    used = [name for name, has_many in (crossed | scaled).items() if has_many]
    fixed = [" * ".join(name for name, has_many in crossed.items() if has_many)]
    fixed += [f"scale({name})" for name, has_many in scaled.items() if has_many]
    terms = [term for term in fixed if term] or ["1"]
    terms += [f"(1 | {name})" for name, has_many in grouped.items() if has_many]
    parts = [
        _head(task, left_out, used, scene_labels(group.scene_kind for group in groups)),
        _levels("condition", conditions) if crossed["condition"] else "",
        _levels("split", splits) + _SUMS.format(names=_texts(f"_{name}" for name in splits[:-1]))
        if crossed["split"]
        else "",
        (_MIXED if any(grouped.values()) else _PLAIN).format(formula="success ~ " + " + ".join(terms)),
        _MARGINS if crossed["condition"] else "",
        "print(sessionInfo())\n",
    ]
    return "".join(parts)


_SUMS = """contrasts(d$split) <- `colnames<-`(contr.sum(nlevels(d$split)), c({names}))  # each against the mean of all
"""
_MIXED = """library(lme4)
fit <- glmer(
  {formula},
  data = d, family = binomial, control = glmerControl(optimizer = "bobyqa", optCtrl = list(maxfun = 2e5))
)
print(summary(fit), correlation = FALSE)
if (isSingular(fit)) {{
  cat("Singular: where a variance above is 0, these data tell no such differences from chance. Estimates hold.\\n")
}}
cat("\\n95 % intervals (Wald, log odds):\\n")
print(confint(fit, parm = "beta_", method = "Wald"))
"""
_PLAIN = """fit <- glm(
  {formula},
  data = d, family = binomial
)
print(summary(fit))
cat("\\n95 % intervals (Wald, log odds):\\n")
print(confint.default(fit))
"""
_MARGINS = """rates <- sapply(levels(d$condition), function(name) {
  other <- d
  other$condition[] <- name
  100 * mean(predict(fit, newdata = other, type = "response"))
})
cat("\\nSuccess in percent, had every trial been done in each condition:\\n")
print(round(rates, 1))
for (name in names(rates)[-1]) {
  cat(sprintf("%s - %s: %.1f points\\n", name, names(rates)[1], rates[[name]] - rates[[1]]))
}
"""


def _head(task: TaskKind, left_out: Sequence[str], used: Sequence[str], labels: Sequence[str]) -> str:
    said = "".join(f'cat("{label}.\\n")\n' for label in labels)
    note = f"# Left out, because they do not vary here: {', '.join(left_out)}.\n" if left_out else ""
    complete = ""
    if used:
        complete = f"""has_all <- complete.cases(d[, c({_texts(used)}), drop = FALSE])
cat(sum(has_all), "of", nrow(d), "trials are used; the others lack one of the terms.\\n")
d <- d[has_all, ]
"""
    return f"""# Mixed model of success, people's {task.upper()} trials: Rscript {task}-glmm.R (needs R's package lme4)
# All trials of the report's tables; without those that a rule excludes: d <- d[is.na(d$excluded), ]
{note}script <- sub("^--file=", "", grep("^--file=", commandArgs(), value = TRUE))
d <- read.csv(file.path(if (length(script)) dirname(script) else ".", "{task}-trials.csv"), na.strings = "")
{said}{complete}"""


def _levels(name: str, levels: Sequence[str]) -> str:
    return f"d${name} <- factor(d${name}, levels = c({_texts(levels)}))\n"


def _texts(names: Iterable[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)
