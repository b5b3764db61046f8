"""The documents for an ethics board and a registry, from the study file and the plan: `study ethics --out`."""

from collections.abc import Callable

from sim.tasks.rules import SUCCESS_RADIUS
from sim.types import Action

from ..plan import StudyPlan
from ..study import StudyConfig
from .board_texts import (
    CONDITIONS,
    DATA_FLOW,
    INFORMATION_SHEET,
    PROCEDURE,
    PROTOCOL,
    PURPOSE,
    RECRUITING,
    RETENTION,
    SUCCESS_RULES,
    TASKS,
    TIME_AND_PAY,
)
from .data_flow import data_items, not_stored
from .estimate import BREAK_S, LOOK_S, READING_S, ROUND_TO_MIN, TRIAL_S, announced_minutes
from .preregistration import preregistration_text
from .sample import Sample, TaskShare, design_text, people_text, range_text, sample_of
from .sheet_texts import BREAK_RULE, WHAT_TEXTS
from .sheets import consent_text, duration_text, filled_or_open, look_text, open_place, withdrawal_text, wrapped

_ACTIONS = {
    Action.FORWARD: "forward",
    Action.LEFT: "turn left",
    Action.RIGHT: "turn right",
    Action.STOP: "stop",
    Action.LOOK_UP: "look up",
    Action.LOOK_DOWN: "look down",
}


def ethics_documents(config: StudyConfig, plan: StudyPlan | None, *, consent: str | None = None) -> dict[str, str]:
    """Each document by its file name, Markdown.

    Args:
        config: The study.
        plan: Gives the numbers of people, trials and homes; None = not planned yet, and they are marked as open.
        consent: The consent form as the participants will read it; None = as a new study would begin with it.
    """
    sample = sample_of(config, plan) if plan is not None else None
    return {
        "protocol.md": protocol(config, plan, sample),
        "information_sheet.md": information_sheet(config, plan),
        "consent.md": consent if consent is not None else consent_text(config, plan=plan),
        "data_flow.md": data_flow(config),
        "retention.md": retention(config),
        "time_and_pay.md": time_and_pay(config, plan, sample),
        "preregistration.md": preregistration_text(config, plan, sample),
    }


def protocol(config: StudyConfig, plan: StudyPlan | None, sample: Sample | None) -> str:
    """The study protocol."""
    ethics = config.ethics
    overview = [
        ("Study", config.study),
        ("Version of the study file", f"`{config.study_version}`"),
        ("Version of the plan", f"`{plan.plan_version}`" if plan is not None else open_place("plan.json")),
        ("Approval or exemption", filled_or_open(ethics.irb, "ethics.irb")),
        ("Records are deleted on", _retention_date(config)),
    ]
    checks = config.checks.every
    text = PROTOCOL.format(
        study=config.study,
        overview="| | |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in overview),
        purpose=PURPOSE,
        tasks="\n\n".join(_task(config, task) for task in config.task),
        conditions=_conditions(config),
        design=design_text(config),
        participants=people_text(sample),
        recruiting=RECRUITING[config.recruit.kind],
        spare=_spare(sample),
        procedure=_procedure(config),
        duration=_duration(config, plan),
        pay=_sentence(filled_or_open(ethics.pay, "ethics.pay")),
        breaks=_breaks(config),
        withdrawal=withdrawal_sentence(config),
        not_stored=not_stored(),
        checks=f"After every {checks} searches one with the object in plain view shows attention." if checks else "",
        institution=filled_or_open(ethics.institution, "ethics.institution"),
        contact=filled_or_open(ethics.contact, "ethics.contact"),
        irb=filled_or_open(ethics.irb, "ethics.irb"),
    )
    return wrapped(text)


def information_sheet(config: StudyConfig, plan: StudyPlan | None) -> str:
    """What people can take home before they decide."""
    ethics = config.ethics
    either = " Everybody does one of the two." if len(config.task) > 1 else ""
    text = INFORMATION_SHEET.format(
        study=config.study,
        institution=filled_or_open(ethics.institution, "ethics.institution"),
        contact=filled_or_open(ethics.contact, "ethics.contact"),
        irb=filled_or_open(ethics.irb, "ethics.irb"),
        what=" ".join(WHAT_TEXTS[task] for task in config.task) + either,
        duration=_duration(config, plan),
        breaks=_breaks(config),
        pay=_sentence(filled_or_open(ethics.pay, "ethics.pay")),
        withdrawal=withdrawal_text(config).replace("\n", " "),
        not_stored_short="We do not store your name, e-mail address, internet address or browser.",
        retention=f"They are deleted on {_retention_date(config)}.",
    )
    return wrapped(text)


def data_flow(config: StudyConfig) -> str:
    """What is stored where, for how long, and who sees it."""
    items = data_items(config, retention=_retention_date(config))
    rows = [f"| {item.name} | {item.purpose} | {item.place} | {item.readers} | {item.until} |" for item in items]
    return wrapped(DATA_FLOW.format(study=config.study, not_stored=not_stored(), rows="\n".join(rows)))


def retention(config: StudyConfig) -> str:
    """The retention table."""
    date = _retention_date(config)
    rows = [f"| {item.name} | {item.until} |" for item in data_items(config, retention=date)]
    text = RETENTION.format(
        study=config.study, retention=date, withdrawal=withdrawal_sentence(config), rows="\n".join(rows)
    )
    return wrapped(text)


def time_and_pay(config: StudyConfig, plan: StudyPlan | None, sample: Sample | None) -> str:
    """The estimate of time, and what it means for pay."""
    stated = config.ethics.duration_min
    shares = sample.shares if sample is not None else ()
    hours = f"{sum(share.total_s for share in shares) / 3600:.1f} hours" if shares else open_place("plan.json")
    text = TIME_AND_PAY.format(
        study=config.study,
        stated=f"Participants are told that it takes about {stated} minutes." if stated is not None else "",
        columns=" | ".join(share.task.upper() for share in shares) or "not planned yet",
        rules="|".join("---" for _ in shares) or "---",
        rows=_time_rows(shares) if shares else f"| People | {open_place('plan.json')} |",
        reading=f"{READING_S:g}",
        pan=f"{TRIAL_S['pan']:g}",
        pog=f"{TRIAL_S['pog']:g}",
        look=f"{LOOK_S:g}",
        rest=f"{BREAK_S:g}",
        step=ROUND_TO_MIN,
        sum=_told(config, plan, shares),
        pay=_sentence(filled_or_open(config.ethics.pay, "ethics.pay")),
        hours=hours,
    )
    return wrapped(text)


def withdrawal_sentence(config: StudyConfig) -> str:
    """What withdrawing does to the records, for readers who are not participants."""
    if config.privacy.on_withdraw == "keep":
        return "What a person did before withdrawing is kept and used; the consent form says so."
    return (
        "When a person withdraws, the key that this person's records are encrypted with is deleted, so that they "
        "cannot be read any more, in backups neither. What remains is the code, the stages of the study with their "
        "times, consent and withdrawal, and for each trial that it took place, how it ended, and the number, kinds "
        "and server times of its events."
    )


def _task(config: StudyConfig, task: str) -> str:
    limit, answer = config.pan_max_s, config.pog.answer_max_s
    return TASKS["pan" if task == "pan" else "pog"].format(
        num_actions=len(config.action_set),
        actions=", ".join(_ACTIONS[action] for action in config.action_set),
        steps=config.steps,
        pan_limit=f", or after {duration_text(limit)}" if limit is not None else "",
        success=SUCCESS_RULES[config.success].format(radius=f"{SUCCESS_RADIUS:g}"),
        pog_limit=f", or {duration_text(answer)} after the text appeared" if answer is not None else "",
        radius=f"{SUCCESS_RADIUS:g}",
    )


def _conditions(config: StudyConfig) -> str:
    memory = look_text(config.memory.min_s, config.memory.max_s)
    pog = look_text(config.pog.look_min_s, config.pog.look_max_s)
    lines = [
        f"- {CONDITIONS[name].format(memory=memory, pog=pog)}"
        for task in config.task
        for name in config.conditions(task)
    ]
    several = any(len(config.conditions(task)) > 1 for task in config.task)
    dealt = (
        "\n\nHomes are divided into groups; which group a person meets in which condition is counterbalanced over "
        "people."
        if several
        else ""
    )
    return "Conditions:\n\n" + "\n".join(lines) + dealt


def _procedure(config: StudyConfig) -> str:
    """The numbered steps of one participant."""
    practice = [f"{getattr(config.practice, task)} {task.upper()}" for task in config.task]
    steps = ["The person opens the link of the study.", *(PROCEDURE[step] for step in config.flow)]
    if any(getattr(config.practice, task) for task in config.task):
        steps.append(f"Practice trials in an invented home that is not part of the study ({', '.join(practice)}).")
    steps.append("The counted trials, each with its own text, with progress shown.")
    if config.confidence:
        steps.append("After each answer the person may say with one key, from 1 to 5, how sure the answer is.")
    ends = {"prolific": " and, after everything is stored, the platform's code"}.get(config.recruit.kind, "")
    steps.append(f"A page of thanks{ends}.")
    return "\n".join(f"{number}. {step}" for number, step in enumerate(steps, start=1))


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


def _told(config: StudyConfig, plan: StudyPlan | None, shares: tuple[TaskShare, ...]) -> str:
    stated, longest = config.ethics.duration_min, max((share.longest.minutes for share in shares), default=0)
    if stated is None:
        return f"Participants are told: {_duration(config, plan)}"
    if longest > stated:
        return f"**The stated {stated} minutes are less than the estimate of {longest}: change ethics.duration_min.**"
    return f"The stated {stated} minutes cover the estimate."


def _duration(config: StudyConfig, plan: StudyPlan | None) -> str:
    minutes = announced_minutes(config, plan)
    sitting, gap = config.breaks.sitting_max, config.breaks.sitting_gap_s
    text = f"It takes about {minutes if minutes is not None else open_place('ethics.duration_min')} minutes in all."
    if sitting is None:
        return text
    return f"{text} After {sitting} searches in one sitting people are asked to come back {duration_text(gap)} later."


def _breaks(config: StudyConfig) -> str:
    every = config.breaks.every
    return BREAK_RULE.format(every=every) if every is not None else "Breaks can be taken at any time."


def _spare(sample: Sample | None) -> str:
    if sample is None or not sample.num_spare:
        return ""
    return f"{sample.num_spare} more may be invited, who do the trials that others leave."


def _retention_date(config: StudyConfig) -> str:
    return filled_or_open(str(config.privacy.retention or ""), "privacy.retention")


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "]")) else f"{text}."
