"""The documents for an ethics board and a registry, from the study file and the plan: `study ethics --out`.

The preregistration names hypotheses, design, sample, exclusions and analysis, in the way that the report will use them.
"""

from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sim.types import TaskKind
from sim.words.english import how_many

from ..design.analysis import ALPHA, HYPOTHESIS_NAME, LEVEL
from ..design.plan import PlannedParticipant, StudyPlan
from ..design.study import StudyConfig
from ..store.exclusions import rules_before_data
from ..store.records import StudyDates
from .catalogue import ENGLISH, catalogue_of
from .estimate import BREAK_S, LOOK_S, READING_S, ROUND_TO_MIN, SURVEY_S, TRIAL_S, TimeEstimate, estimate_time
from .words import filled, open_place, words_of

MEASURE_NAMES = {
    "SR": "success rate",
    "SPL": "success weighted by path length",
    "SoftSPL": "soft success weighted by path length",
    "DTG": "distance left to the goal",
    "steps": "number of steps",
    "time": "time to the answer",
}
_WORDS: dict[str, str] = {"pan": "steering", "pog": "pointing"}


@dataclass(frozen=True, slots=True)
class TaskShare:
    """The people of one task."""

    task: TaskKind
    num_people: int
    num_trials: int
    """Counted trials of all people."""
    fewest: int
    """Counted trials of the person with the fewest."""
    most: int
    longest: TimeEstimate
    """Time of the person with the most trials."""
    total_s: float
    """Seconds of all people together, expected."""

    @property
    def trials_each(self) -> str:
        """Counted trials per person as text: "30", or "28 to 30"."""
        return f"{self.most}" if self.fewest == self.most else f"{self.fewest} to {self.most}"


@dataclass(frozen=True, slots=True)
class Sample:
    """The numbers of people, trials and homes in a plan."""

    shares: tuple[TaskShare, ...]
    """One per task, in the study's order."""
    num_spare: int
    """People with a link but no trials of their own, who take the trials that others leave."""
    num_episodes: int
    by_split: dict[str, int]
    by_kind: dict[str, int]
    """Number of homes of each kind."""
    most_visits: int
    """Most counted trials of one person in one home."""

    @property
    def num_people(self) -> int:
        """People with trials of their own."""
        return sum(share.num_people for share in self.shares)

    @property
    def num_trials(self) -> int:
        """Counted trials."""
        return sum(share.num_trials for share in self.shares)


def ethics_documents(
    config: StudyConfig, plan: StudyPlan | None, *, consent: str | None = None, dates: StudyDates | None = None
) -> dict[str, str]:
    """Each document by its file name, Markdown.

    Args:
        plan: Gives the numbers of people, trials and homes; None = not planned yet, and they are marked as open.
        consent: The consent form as the participants will read it; None = the form that a new study begins with.
        dates: Dates of the study's records; None = the study has none yet.
    """
    sample = sample_of(config, plan) if plan is not None else None
    words = board_words(config, plan, sample)
    told = words_of(config, plan=plan)
    told |= {
        "per_task": [words_of(config, plan=plan, task=task) for task in config.task],
        "pay_sentence": _sentence(told["pay"]),
    }
    return {
        "protocol.md": filled("protocol.md", words),
        "information_sheet.md": filled("information_sheet.md", told),
        "consent.md": consent if consent is not None else filled("consent.md", told),
        "data_flow.md": filled("data_flow.md", words),
        "retention.md": filled("retention.md", words),
        "time_and_pay.md": filled("time_and_pay.md", words | _times(sample)),
        "preregistration.md": filled("preregistration.md", words | _analysis(config) | _registered(config, dates)),
    }


def board_words(config: StudyConfig, plan: StudyPlan | None, sample: Sample | None) -> dict[str, Any]:
    """The words of the study for readers who are not participants, with the numbers of its plan."""
    words = words_of(config, plan=plan, catalogue=catalogue_of(ENGLISH))
    changes = plan.changes if plan is not None else ()
    practice = [f"{getattr(config.practice, task)} {task.upper()}" for task in config.task]
    return words | {
        "is_planned": plan is not None,
        "plan_version": f"`{plan.plan_version}`" if plan is not None else open_place("plan.json"),
        "participants": " ".join((people_text(config, sample), *(f"Other than asked: {each}." for each in changes))),
        "spare": f"{sample.num_spare} more may be invited, who do the trials that others leave."
        if sample is not None and sample.num_spare
        else "",
        "practice": ", ".join(practice) if any(getattr(config.practice, task) for task in config.task) else "",
        "is_counterbalanced": any(len(config.conditions(task)) > 1 for task in config.task),
        "pay_sentence": _sentence(words["pay"]),
    }


def hypothesis_sentence(name: str) -> str:
    """The claim behind a name in `primary`; the name itself where the report does not know it."""
    match = HYPOTHESIS_NAME.match(name)
    if match is None:
        return f"`{name}`: to be stated in words; the report does not test it by itself."
    measure = MEASURE_NAMES[match["measure"]]
    task = f" in {_WORDS[match['task']]}" if match["task"] else ""
    if match["memory"] == "memory":
        return f"`{name}`: the {measure}{task} of people differs between having been shown the home before and not."
    if match["memory"] is not None:
        return f"`{name}`: the {measure}{task} of people differs between condition `{match['memory']}` and the other."
    agent = "the agent" if match["agent"] == "agent" else f"the agent `{match['agent']}`"
    seen = f" in condition `{match['condition']}`" if match["condition"] else ""
    return f"`{name}`: the {measure}{task} of people{seen} differs from that of {agent} on the same episodes."


def sample_of(config: StudyConfig, plan: StudyPlan) -> Sample:
    """The numbers of a plan."""
    main = {person.code: [trial for trial in person.trials if trial.phase == "main"] for person in plan.participants}
    busy = [person for person in plan.participants if main[person.code]]
    keys = {trial.key for trials in main.values() for trial in trials}
    visits = [count for trials in main.values() for count in Counter(trial.scene for trial in trials).values()]
    shares = [_share(config, task, [person for person in busy if person.task == task]) for task in config.task]
    return Sample(
        shares=tuple(share for share in shares if share.num_people),
        num_spare=len(plan.participants) - len(busy),
        num_episodes=len(keys),
        by_split=dict(sorted(Counter(key.split for key in keys).items())),
        by_kind=dict(sorted(Counter(scene.kind for scene in plan.scenes).items())),
        most_visits=max(visits, default=0),
    )


def people_text(config: StudyConfig, sample: Sample | None) -> str:
    """The numbers of people, trials, episodes and homes, as sentences."""
    unit = "episodes" if config.sequences is None else "sequences"
    if sample is None:
        return f"The number of participants is {open_place('plan.json')}."
    kinds = " and ".join(f"{count} {kind}" for kind, count in sample.by_kind.items())
    splits = ", ".join(f"{count} {split}" for split, count in sample.by_split.items())
    each = "; ".join(
        f"{_people(share.num_people)} with {share.trials_each} {_WORDS[share.task]} trials each"
        for share in sample.shares
    )
    homes, visits = sum(sample.by_kind.values()), sample.most_visits
    return (
        f"The study has places for {_people(sample.num_people)} ({each}), {sample.num_trials} trials in all, with "
        f"{sample.num_episodes} {unit} ({splits}) in {how_many(homes, 'home')} ({kinds}). Nobody meets "
        f"one home more than {'once' if visits == 1 else f'{visits} times'} in counted trials."
    )


def _times(sample: Sample | None) -> dict[str, Any]:
    """The estimated time of each task, and its stated parts."""
    shares = sample.shares if sample is not None else ()
    return {
        "shares": shares,
        "longest": max((share.longest.minutes for share in shares), default=0),
        "not_planned": open_place("plan.json"),
        "reading_s": READING_S,
        "survey_s": SURVEY_S,
        "trial_s": TRIAL_S,
        "look_s": LOOK_S,
        "break_s": BREAK_S,
        "round_to_min": ROUND_TO_MIN,
    }


def _analysis(config: StudyConfig) -> dict[str, Any]:
    """The analysis of the records that the report will make."""
    hypotheses = [f"{at}. {hypothesis_sentence(name)}" for at, name in enumerate(config.primary, start=1)] or [
        "The report of home sequences tests no hypothesis: everything in it is exploratory."
        if config.sequences is not None
        else f"No primary hypothesis is named ({open_place('primary')}); then everything in the report is exploratory."
    ]
    return {
        "hypotheses": "\n".join(hypotheses),
        "rules": rules_before_data(config),
        "level": f"{LEVEL:.0%}",
        "alpha": f"{ALPHA:.0%}",
    }


def _sentence(pay: str) -> str:
    return pay if pay.endswith((".", "!", "]")) else f"{pay}."


def _registered(config: StudyConfig, dates: StudyDates | None) -> dict[str, Any]:
    """What was fixed when, and what only the researcher knows about the size of the sample."""
    effect = config.smallest_effect
    begun = dates.num_begun if dates is not None else 0
    return {
        "dates": dates,
        "today": datetime.now(UTC).date().isoformat(),
        "begun": f"{how_many(begun, 'counted trial')} {'was' if begun == 1 else 'were'}",
        "smallest_effect": open_place("smallest_effect")
        if effect is None
        else f"a difference of {effect:g} percentage points between success rates",
        "sample_size_reason": config.sample_size_reason or open_place("sample_size_reason"),
    }


def _people(count: int) -> str:
    return "1 person" if count == 1 else f"{count} people"


def _share(config: StudyConfig, task: TaskKind, people: list[PlannedParticipant]) -> TaskShare:
    counts = [sum(trial.phase == "main" for trial in person.trials) for person in people]
    estimates = [estimate_time(config, num_trials=count, task=task) for count in counts]
    return TaskShare(
        task=task,
        num_people=len(people),
        num_trials=sum(counts),
        fewest=min(counts, default=0),
        most=max(counts, default=0),
        longest=max(
            estimates, key=lambda estimate: estimate.total_s, default=estimate_time(config, num_trials=0, task=task)
        ),
        total_s=sum(estimate.total_s for estimate in estimates),
    )
