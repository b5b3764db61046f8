"""The documents for an ethics board and a registry, from the study file and the plan: `study ethics --out`."""

from collections.abc import Callable
from typing import Any

from ..design.plan import StudyPlan
from ..design.study import StudyConfig
from .estimate import BREAK_S, LOOK_S, READING_S, ROUND_TO_MIN, TRIAL_S
from .preregistration import preregistration_text
from .sample import Sample, TaskShare, people_text, range_text, sample_of
from .words import filled, open_place, words_of


def ethics_documents(config: StudyConfig, plan: StudyPlan | None, *, consent: str | None = None) -> dict[str, str]:
    """Each document by its file name, Markdown.

    Args:
        config: The study.
        plan: Gives the numbers of people, trials and homes; None = not planned yet, and they are marked as open.
        consent: The consent form as the participants will read it; None = as a new study would begin with it.
    """
    sample = sample_of(config, plan) if plan is not None else None
    words = board_words(config, plan, sample)
    return {
        "protocol.md": filled("protocol.md", words),
        "information_sheet.md": filled("information_sheet.md", words),
        "consent.md": consent if consent is not None else filled("consent.md", words),
        "data_flow.md": filled("data_flow.md", words),
        "retention.md": filled("retention.md", words),
        "time_and_pay.md": filled("time_and_pay.md", {**words, **_times(config, words, sample)}),
        "preregistration.md": preregistration_text(config, words),
    }


def board_words(config: StudyConfig, plan: StudyPlan | None, sample: Sample | None) -> dict[str, Any]:
    """The words of the study for readers who are not participants, with what its plan asks for."""
    words = words_of(config, plan=plan)
    pay, changes = words["pay"], plan.changes if plan is not None else ()
    practice = [f"{getattr(config.practice, task)} {task.upper()}" for task in config.task]
    return words | {
        "is_planned": plan is not None,
        "plan_version": f"`{plan.plan_version}`" if plan is not None else open_place("plan.json"),
        "participants": " ".join([people_text(sample), *(f"Other than asked: {change}." for change in changes)]),
        "spare": f"{sample.num_spare} more may be invited, who do the trials that others leave."
        if sample is not None and sample.num_spare
        else "",
        "per_task": [words_of(config, plan=plan, task=task) for task in config.task],
        "practice": ", ".join(practice) if any(getattr(config.practice, task) for task in config.task) else "",
        "is_counterbalanced": any(len(config.conditions(task)) > 1 for task in config.task),
        "pay_sentence": pay if pay.endswith((".", "!", "]")) else f"{pay}.",
    }


def _times(config: StudyConfig, words: dict[str, Any], sample: Sample | None) -> dict[str, str]:
    """The estimate of time, and what it means for pay."""
    shares = sample.shares if sample is not None else ()
    hours = f"{sum(share.total_s for share in shares) / 3600:.1f} hours" if shares else open_place("plan.json")
    return {
        "columns": " | ".join(share.task.upper() for share in shares) or "not planned yet",
        "rules": "|".join("---" for _ in shares) or "---",
        "rows": _time_rows(shares) if shares else f"| People | {open_place('plan.json')} |",
        "reading": f"{READING_S:g}",
        "pan": f"{TRIAL_S['pan']:g}",
        "pog": f"{TRIAL_S['pog']:g}",
        "look": f"{LOOK_S:g}",
        "rest": f"{BREAK_S:g}",
        "step": f"{ROUND_TO_MIN}",
        "sum": _told(config, words["duration"], shares),
        "hours": hours,
    }


def _time_rows(shares: tuple[TaskShare, ...]) -> str:
    figures: list[tuple[str, Callable[[TaskShare], str]]] = [
        ("People", lambda share: f"{share.num_people}"),
        ("Counted trials per person", range_text),
        ("Attention trials, at most", lambda share: f"{share.longest.num_checks}"),
        ("Practice trials", lambda share: f"{share.longest.num_practice}"),
        ("Reading and checks, minutes", lambda share: f"{share.longest.reading_s / 60:.0f}"),
        ("Practice, minutes", lambda share: f"{share.longest.practice_s / 60:.0f}"),
        ("Trials, minutes at most", lambda share: f"{share.longest.trials_s / 60:.0f}"),
        ("Breaks, minutes at most", lambda share: f"{share.longest.breaks_s / 60:.0f}"),
        ("**In all, minutes per person**", lambda share: f"**{share.longest.minutes}**"),
    ]
    return "\n".join(f"| {name} | " + " | ".join(tell(share) for share in shares) + " |" for name, tell in figures)


def _told(config: StudyConfig, duration: str, shares: tuple[TaskShare, ...]) -> str:
    stated, longest = config.ethics.duration_min, max((share.longest.minutes for share in shares), default=0)
    if stated is None:
        return f"Participants are told: {duration}"
    if longest > stated:
        return f"**The stated {stated} minutes are less than the estimate of {longest}: change ethics.duration_min.**"
    return f"The stated {stated} minutes cover the estimate."
