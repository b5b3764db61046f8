"""Questions that reviewers ask about human baselines, answered from the study file where it holds the answer.

After Wei et al., "Human Baselines in Model Evaluations Need Rigor and Transparency" (ICML 2025), and Kress-Gazit et
al., "Robot Learning as an Empirical Science" (2024). The questions are in our words; the papers' own lists go further.
"""

from collections.abc import Sequence

from ..design.study import StudyConfig
from ..texts.words import words_of
from .counts import ExclusionCount, FlowCount
from .measures import WITHIN
from .rows import TOTAL, ReportRow
from .trials import ReportValue

NOT_IN_FILE = "not in the study file"
_WEI, _KRESS = "Wei et al.", "Kress-Gazit et al."
Answers = dict[str, str]
"""Answer by question."""


class ChecklistItem(ReportValue):
    """A question and its answer."""

    source: str
    part: str
    question: str
    answer: str
    """The answer; `not in the study file` where only the researcher knows it."""


def checklist(
    config: StudyConfig,
    *,
    rows: Sequence[ReportRow],
    flow: Sequence[FlowCount],
    exclusions: Sequence[ExclusionCount],
    is_pilot: bool,
    plan_changes: Sequence[str] = (),
) -> list[ChecklistItem]:
    """All questions of both lists."""
    parts: list[tuple[str, str, Answers]] = [
        (_WEI, "1 Design", _design(config, rows, plan_changes)),
        (_WEI, "2 People", _people(config, flow, is_pilot=is_pilot)),
        (_WEI, "3 Execution", _execution(config, exclusions)),
        (_WEI, "4 Analysis and sharing", _analysis(config)),
        (_KRESS, "Experiment", _robotics(config, rows)),
    ]
    return [
        ChecklistItem(source=source, part=part, question=question, answer=answer)
        for source, part, answers in parts
        for question, answer in answers.items()
    ]


def _design(config: StudyConfig, rows: Sequence[ReportRow], plan_changes: Sequence[str]) -> Answers:
    dataset = config.dataset
    sizes = ", ".join(f"{split} {size}" for split, size in dataset.splits.items())
    most = "any number" if dataset.max_per_scene is None else f"at most {dataset.max_per_scene}"
    agents = ", ".join(sorted({row.who for row in rows if row.kind == "agent"}))
    limits = []
    if "pan" in config.task:
        limits += [f"{config.steps} steps"] + ([f"{config.pan_max_s:g} s of walking"] if config.pan_max_s else [])
    if "pog" in config.task and config.pog.answer_max_s:
        limits.append(f"{config.pog.answer_max_s:g} s of pointing")
    return {
        "Which items, and how were they drawn?": (
            f"{sizes}; stratified by {dataset.stratify}, {most} per home, seed {dataset.seed}; "
            f"dataset {dataset.sha256[:12]}"
        ),
        "Same items for people and agents?": (
            f"yes: {agents} on the people's episodes only" if agents else "no agent is in this report"
        ),
        "Same task, actions and information?": (
            f"people have actions {config.actions}, query {config.query_index} and {', '.join(config.information)}; "
            f"what each agent has is {NOT_IN_FILE}"
        ),
        "Equal effort and limits?": (
            f"{', '.join(limits) or 'no limit'}; success within so many steps is tabulated; nothing is best of several"
        ),
        "Sample size justified?": f"study plan --power gives its precision; why this size is {NOT_IN_FILE}",
        "Planned as asked for?": "; ".join(plan_changes) or "yes, or planned by an earlier version",
        "Hypotheses fixed before data?": ", ".join(config.primary) or "none named: everything is exploratory",
        "Piloted before?": NOT_IN_FILE,
    }


def _people(config: StudyConfig, flow: Sequence[FlowCount], *, is_pilot: bool) -> Answers:
    counts = {count.point: count.n for count in flow}
    practice = ", ".join(f"{getattr(config.practice, task)} {task}" for task in config.task)
    came = f"{counts['came']} came, {counts['finished']} finished" if "came" in counts else "not in these records"
    return {
        "Which population, and how recruited?": f"recruited by {config.recruit.kind}; population {NOT_IN_FILE}",
        "How many came, and how many finished?": came,
        "Ethics approval?": config.ethics.irb or ("none: this is a pilot" if is_pilot else NOT_IN_FILE),
        "Consent?": "stored with the text's hash" if "consent" in config.flow else "not asked by this program",
        "Pay?": config.ethics.pay or NOT_IN_FILE,
        "Instructions and training?": f"{', '.join(config.flow) or 'nothing'} before; practice trials: {practice}",
        "Demographics and expertise?": "not collected",
    }


def _execution(config: StudyConfig, exclusions: Sequence[ExclusionCount]) -> Answers:
    every, breaks = config.checks.every, config.breaks
    conditions = ", ".join(name for task in config.task for name in config.conditions(task))
    rules = ", ".join(f"{row.rule_id} ({row.num_trials} trials)" for row in exclusions)
    rest = f"a break is offered every {breaks.every} trials" if breaks.every else "no breaks"
    sitting = f", at most {breaks.sitting_max} trials in a sitting" if breaks.sitting_max else ""
    return {
        "Quality control?": f"an attention trial after every {every} trials" if every else "no attention trials",
        "Exclusions and their rules?": rules or "no rule was used",
        "Who does what, in which order?": (
            f"{config.design.kind}, {config.design.raters_per_episode} people per episode and condition, order at "
            f"random from a seed; conditions {conditions}"
        ),
        "Feedback or help during trials?": "none until the study closes; a practice trial says whether it was right",
        "Breaks and fatigue?": f"{rest}{sitting}; see the order effect",
        "Same interface for all?": "yes: one page; keys can be remapped and pictures scale with the window",
    }


def _analysis(config: StudyConfig) -> Answers:
    return {
        "Uncertainty of every number?": "two-way intervals, people and episodes random; a bootstrap as second (CSV)",
        "Tests and multiplicity?": "Holm over the primary hypotheses; everything else is marked exploratory",
        "Agreement between people?": "Krippendorff's alpha and Gwet's AC1 on success, place and object",
        "Data and code available?": (
            f"exported with hashes; kept until {config.privacy.retention or NOT_IN_FILE}; where it is published is "
            f"{NOT_IN_FILE}"
        ),
    }


def _robotics(config: StudyConfig, rows: Sequence[ReportRow]) -> Answers:
    has_several = any(len(config.conditions(task)) > 1 for task in config.task)
    words = words_of(config)
    mixed = "conditions alternate within people" if has_several else "one condition per task"
    measures = {row.measure for row in rows if row.measure not in WITHIN and row.split == TOTAL}
    return {
        "Success criterion, stated exactly?": " ".join(
            f"{task.upper()}{f', rule {config.success}' if task == 'pan' else ''}: {words[f'board_{task}_rule']}"
            for task in config.task
        ),
        "Initial conditions controlled?": "start pose, text and home are the episode's, the same for everybody",
        "Number of trials per condition?": "k/n in every cell",
        "More than the success rate?": ", ".join(sorted(measures)),
        "Comparisons interleaved?": f"{mixed}; agents ran apart, in the same simulator",
        "Failure modes described?": f"ends, unreachable goals and suspect labels are listed; prose is {NOT_IN_FILE}",
        "Statistical analysis?": "intervals, paired differences and tests below",
        "Evaluator blinded?": "scores are computed from stored events; study verify computes them again",
    }
