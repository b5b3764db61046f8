"""Preregistration text: hypotheses, design, sample, exclusions and analysis, as the report will do them."""

from sim.types import TaskKind

from ..exclusions import rules_before_data
from ..hypothesis_names import HYPOTHESIS_NAME
from ..plan import StudyPlan
from ..reporting.hypotheses import ALPHA
from ..reporting.statistics import LEVEL, NUM_RESAMPLES
from ..study import StudyConfig
from .sample import Sample, design_text, people_text
from .sheets import filled_or_open, open_place, wrapped

PREREGISTRATION = """\
# Preregistration: {study}

Written by `personal-viz study ethics` before the first counted trial, from the study file with hash
`{study_version}`{plan}. Whoever knows the hash can check that neither was changed afterwards: every record of the
study carries it.

## 1. Hypotheses

{hypotheses}

## 2. Design

{design}

## 3. Sample

{sample} Episodes are drawn {stratify} from the dataset with digest `{dataset}`, with seed {seed}. The number of
participants is fixed; there is no interim analysis, and displays of progress show no results before the study closes.

## 4. Measures

{measures}

All rules of success are computed when a trial ends and are stored; the primary one is `{rule}`. Trials without a
reachable success region have no distance: they are counted and reported, not averaged.

## 5. Trials that are no result, and exclusions

A trial that a failure of the program stopped (`technical`) is given out once more. A trial that a person left for
longer than {resume:g} s (`abandoned`) is given to somebody else. Neither is a result: they are counted as failures in
sensitivity rows only. Giving up, running out of steps and running out of time are results: failures, with the
distance at that place.

The main tables hold every counted trial with a result, whoever did it and however (intention to treat). The
following rules leave trials or people out of the per-protocol rows and of the exported run files. They are applied
without looking at success, are listed with their reasons in the report, and delete nothing:

| Rule | Applies when |
|---|---|
{rules}

Rules that are not in this list are marked as unplanned wherever they are used.

## 6. Analysis

1. Each cell of the tables (split, condition) holds k of n, the mean, and a {level:.0%} interval that takes
   participants and episodes for random: the two-way variance with Satterthwaite's degrees of freedom, for success
   rates on the logit scale. Beside it stands the two-way (pigeonhole) bootstrap with {resamples} resamples and a
   fixed seed.
2. Totals are {total}. Within a split {weight}.
3. People and agents are compared on the same episodes: the difference is taken trial by trial, several runs of one
   agent are averaged per episode first, and the interval is the two-way one.
4. Conditions are compared within people and within episodes, with people and episodes random.
5. The primary hypotheses are tested two-sided at a family-wise level of {alpha:.0%}, adjusted after Holm. Everything
   else is exploratory and is reported as such.
6. Order and earlier visits to a home are reported as effects within people and within episodes.
7. Agreement between people is reported as Krippendorff's alpha and Gwet's AC1; episodes at which most people choose
   the same wrong place are listed as possibly mislabelled and stay in.
8. Sensitivity rows: per protocol (without excluded trials and people), with technical failures and with abandoned
   trials as failures, without each person's first trials, and verified trials only.
9. All trials are done again in the simulator before the analysis; trials that do not agree with their record are
   reported.

## 7. What people have to go by

People see {information}, and read query number {query}. What each agent has is stated beside every comparison.

## 8. Not part of this study

Homes that are not scans (schematic or invented ones) serve pilots and tests; no human baseline is claimed on them.
Responsible: {institution}, {contact}. Approval or exemption: {irb}.
"""

MEASURE_NAMES = {
    "SR": "success rate",
    "SPL": "success weighted by path length",
    "SoftSPL": "soft success weighted by path length",
    "DTG": "distance left to the goal",
    "steps": "number of steps",
    "time": "time to the answer",
}
MEASURES: dict[TaskKind, str] = {
    "pan": "Steering (PAN): success rate (SR), success weighted by path length (SPL), SoftSPL, distance left to the "
    "goal (DTG, walking distance), steps, time to the answer, and success within 25 to 500 steps.",
    "pog": "Pointing (POG): success rate (the mark is within 1 m of the object's middle on the floor plan of its "
    "storey), planar distance, and time to the answer.",
}
TOTALS = {
    "mean_of_splits": "the plain mean of the splits",
    "pooled": "the mean over all trials, whatever their split",
    "dataset_weighted": "the mean of the splits, weighted by their size in the dataset",
}
WEIGHTS = {
    "trials": "every trial counts the same",
    "participants": "every participant counts the same",
}
INFORMATION = {
    "rgb": "the camera's picture",
    "compass": "a compass",
    "depth": "depth",
    "map": "the map explored so far",
}


def preregistration_text(config: StudyConfig, plan: StudyPlan | None, sample: Sample | None) -> str:
    """The document, complete but for fields that the study file leaves empty.

    Args:
        config: The study.
        plan: None = not planned yet.
        sample: Of the plan.
    """
    dataset = config.dataset
    rules = "\n".join(f"| `{name}` | {text} |" for name, text in rules_before_data(config).items())
    text = PREREGISTRATION.format(
        study=config.study,
        study_version=config.study_version,
        plan=f" and the plan with hash `{plan.plan_version}`" if plan is not None else "",
        hypotheses=_hypotheses(config),
        design=design_text(config),
        sample=people_text(sample),
        stratify="as evenly over the homes as possible" if dataset.stratify == "scene" else "at random",
        dataset=dataset.sha256,
        seed=dataset.seed,
        measures="\n\n".join(MEASURES[task] for task in config.task),
        rule=config.success,
        resume=config.resume_within_s,
        rules=rules,
        level=LEVEL,
        resamples=f"{NUM_RESAMPLES:,}".replace(",", " "),
        total=TOTALS[config.aggregate.total],
        weight=WEIGHTS[config.aggregate.weight],
        alpha=ALPHA,
        information=" and ".join(INFORMATION[name] for name in config.information),
        query=config.query_index + 1,
        institution=filled_or_open(config.ethics.institution, "ethics.institution"),
        contact=filled_or_open(config.ethics.contact, "ethics.contact"),
        irb=filled_or_open(config.ethics.irb, "ethics.irb"),
    )
    return wrapped(text)


def _hypotheses(config: StudyConfig) -> str:
    """One sentence for each primary hypothesis."""
    if not config.primary:
        return (
            f"No primary hypothesis is named ({open_place('primary')}); then everything in the report is exploratory."
        )
    lines = [f"{number}. {hypothesis_sentence(name)}" for number, name in enumerate(config.primary, start=1)]
    return "\n".join(lines)


def hypothesis_sentence(name: str) -> str:
    """What a name of `primary` claims; the name itself where the report does not know it."""
    match = HYPOTHESIS_NAME.match(name)
    if match is None:
        return f"`{name}`: to be stated in words; the report does not test it by itself."
    measure, task = (
        MEASURE_NAMES[match["measure"]],
        {"pan": " in steering", "pog": " in pointing"}.get(match["task"], ""),
    )
    if match["memory"] == "memory":
        return f"`{name}`: the {measure}{task} of people differs between having been shown the home before and not."
    if match["memory"] is not None:
        return f"`{name}`: the {measure}{task} of people differs between condition `{match['memory']}` and the other."
    agent = "the agent" if match["agent"] == "agent" else f"the agent `{match['agent']}`"
    seen = f" in condition `{match['condition']}`" if match["condition"] else ""
    return f"`{name}`: the {measure}{task} of people{seen} differs from that of {agent} on the same episodes."
