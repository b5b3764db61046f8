"""What participants read before they take part, written from the study file: consent and instructions.

Fields that the study file leaves empty appear as `[to be filled in: ethics.contact]`, so that nobody overlooks them.
The ethics board's documents are made by `ethics_documents`.
"""

import math
import re
import textwrap

from sim.tasks.rules import SUCCESS_RADIUS
from sim.types import FORWARD_STEP, TURN_STEP, Action, TaskKind

from ..plan import StudyPlan
from ..session import STOP_WITHIN_S
from ..study import StudyConfig
from .estimate import announced_minutes
from .sheet_texts import (
    BREAK_RULE,
    CHECKS_TEXT,
    CONFIDENCE_STORED,
    DEFAULT_CONSENT,
    DEFAULT_INSTRUCTIONS,
    LOOK_ROWS,
    MEMORY_TEXTS,
    NOT_STORED,
    PAN_HEADING,
    PAN_SECTION,
    PLATFORM_DROPPED,
    PLATFORM_HASHED,
    PLATFORM_KEPT,
    POG_CONDITION_TEXTS,
    POG_HEADING,
    POG_MOVING,
    POG_SECTION,
    PRACTICE_TEXT,
    QUIZ_TEXT,
    RADIUS_TEXTS,
    REMAINS_OF_PLATFORM,
    WHAT_TEXTS,
    WITHDRAW_TEXTS,
)

WIDTH = 110
_OPEN_PLACE = re.compile(r"\[to\s+be\s+filled\s+in:\s+([a-z_.]+)\]")


def open_place(field: str) -> str:
    """The mark that stands where the study file leaves `field` empty."""
    return f"[to be filled in: {field}]"


def filled_or_open(value: str, field: str) -> str:
    """What the study file says, or the mark of an empty field."""
    return value.strip() or open_place(field)


def open_places(text: str) -> tuple[str, ...]:
    """The fields that a text still marks as to be filled in, each once, in order of appearance."""
    return tuple(dict.fromkeys(_OPEN_PLACE.findall(text)))


def with_filled_places(text: str, config: StudyConfig, *, plan: StudyPlan | None = None) -> str:
    """A text with the marks replaced that the study file can fill by now; all else stays as somebody wrote it.

    Args:
        text: Consent form or instructions.
        config: The study.
        plan: Gives the announced time where the study file does not.
    """
    ethics, minutes = config.ethics, announced_minutes(config, plan)
    values = {
        "ethics.institution": ethics.institution,
        "ethics.contact": ethics.contact,
        "ethics.pay": ethics.pay,
        "ethics.irb": ethics.irb,
        "ethics.duration_min": str(minutes or ""),
        "privacy.retention": str(config.privacy.retention or ""),
    }
    return _OPEN_PLACE.sub(lambda mark: values.get(mark[1], "").strip() or mark[0], text)


def consent_text(config: StudyConfig, *, plan: StudyPlan | None = None) -> str:
    """The consent form as Markdown; true for what the program stores under this study file.

    Args:
        config: The study.
        plan: Gives the announced time where the study file does not; None = not planned yet.
    """
    ethics = config.ethics
    minutes = announced_minutes(config, plan)
    sitting = config.breaks.sitting_max
    parts = f", in sittings of at most {sitting} tasks" if sitting is not None and _may_exceed(config, sitting) else ""
    retention = config.privacy.retention
    text = DEFAULT_CONSENT.format(
        study=config.study,
        institution=filled_or_open(ethics.institution, "ethics.institution"),
        what="\n\n".join(WHAT_TEXTS[task] for task in config.task) + _either(config),
        minutes=minutes if minutes is not None else open_place("ethics.duration_min"),
        parts=parts,
        breaks=BREAK_RULE.format(every=config.breaks.every) if config.breaks.every is not None else "",
        pay=filled_or_open(ethics.pay, "ethics.pay"),
        confidence=CONFIDENCE_STORED if config.confidence else "",
        not_stored=NOT_STORED + _platform_text(config),
        retention=f"The records are deleted on {retention or open_place('privacy.retention')}.",
        back=f"within {duration_text(config.resume_within_s)} to the same task, later to the next one",
        withdraw=withdrawal_text(config),
        contact=filled_or_open(ethics.contact, "ethics.contact"),
        irb=filled_or_open(ethics.irb, "ethics.irb"),
    )
    return wrapped(text)


def instructions_text(config: StudyConfig) -> str:
    """The instructions as Markdown: rules for everybody and a section for each task of the study."""
    sections = {"pan": _pan_section, "pog": _pog_section}
    every = config.breaks.every
    coming = (
        (QUIZ_TEXT, "quiz" in config.flow),
        (PRACTICE_TEXT, any(getattr(config.practice, task) > 0 for task in config.task)),
        (CHECKS_TEXT, config.checks.every is not None),
    )
    text = DEFAULT_INSTRUCTIONS.format(
        sections="".join(sections[task](config) for task in config.task),
        hurry="There is no time limit unless the page shows one, but please do not leave the page during a search.",
        resume=duration_text(config.resume_within_s),
        breaks=BREAK_RULE.format(every=every) if every is not None else "Breaks between two searches are up to you.",
        next=" ".join(text for text, is_true in coming if is_true),
    )
    return wrapped(text)


def instructions_for(text: str, task: TaskKind) -> str:
    """The instructions without the other task's section, found by its heading; a text without that heading is whole."""
    other = POG_HEADING if task == "pan" else PAN_HEADING
    before, found, after = text.partition(f"{other}\n")
    if not found:
        return text
    rest = re.search(r"^## ", after, flags=re.MULTILINE)
    return before + (after[rest.start() :] if rest is not None else "")


def _pan_section(config: StudyConfig) -> str:
    """Keys, limits and the look before a trial."""
    texts = [
        MEMORY_TEXTS[arm].format(look=look_text(config.memory.min_s, config.memory.max_s)) for arm in config.memory.arms
    ]
    return PAN_SECTION.format(
        move=f"{100 * FORWARD_STEP:.0f} cm",
        turn=f"{math.degrees(TURN_STEP):.0f}°",
        look_rows=LOOK_ROWS if Action.LOOK_UP in config.action_set else "",
        stop_s=f"{STOP_WITHIN_S:.0f}",
        radius=RADIUS_TEXTS[config.success].format(metres=f"{SUCCESS_RADIUS:g}"),
        steps=config.steps,
        pan_limit=f" or after {duration_text(config.pan_max_s)}" if config.pan_max_s is not None else "",
        memory="".join(f"\n{text}\n" for text in texts if text),
    )


def _pog_section(config: StudyConfig) -> str:
    """How the home is shown and marked."""
    limit = config.pog.answer_max_s
    look = look_text(config.pog.look_min_s, config.pog.look_max_s)
    conditions = [POG_CONDITION_TEXTS[name].format(look=look) for name in config.pog.conditions]
    return POG_SECTION.format(
        conditions="\n\n".join(conditions),
        moving=POG_MOVING if set(config.pog.conditions) != {"map_2d"} else "",
        radius=f"{SUCCESS_RADIUS:g} metre",
        limit=f" A search ends by itself {duration_text(limit)} after the text appears." if limit is not None else "",
    )


def withdrawal_text(config: StudyConfig) -> str:
    """What becomes of the records of somebody who withdraws."""
    platform = REMAINS_OF_PLATFORM if hashes_platform_ids(config) else ""
    return WITHDRAW_TEXTS[config.privacy.on_withdraw].format(platform=platform)


def _platform_text(config: StudyConfig) -> str:
    """What becomes of the id on a recruiting platform; empty where nobody brings one."""
    if not hashes_platform_ids(config):
        return ""
    return PLATFORM_HASHED + (PLATFORM_KEPT if config.privacy.platform_id == "hmac" else PLATFORM_DROPPED)


def hashes_platform_ids(config: StudyConfig) -> bool:
    """Whether an id of a recruiting platform reaches the study: people on the open link bring it."""
    return config.recruit.kind == "prolific" or (config.recruit.kind == "link" and config.privacy.platform_id == "hmac")


def _either(config: StudyConfig) -> str:
    return "\n\nEverybody does one of the two, as assigned by the study." if len(config.task) > 1 else ""


def _may_exceed(config: StudyConfig, sitting: int) -> bool:
    """Whether somebody may have more counted trials than fit into one sitting."""
    return config.design.trials_per_person is None or config.design.trials_per_person > sitting


def wrapped(text: str) -> str:
    """The Markdown with paragraphs filled to one width; headings, lists and tables stay as they are."""
    blocks = [block for block in text.strip().split("\n\n") if block.strip()]
    filled = [block if _is_kept(block) else textwrap.fill(" ".join(block.split()), WIDTH) for block in blocks]
    return "\n\n".join(block.strip("\n") for block in filled) + "\n"


def _is_kept(block: str) -> bool:
    """Whether a block is no paragraph: heading, list, table, or a drawing (indented)."""
    return block.lstrip()[0] in "#-|" or block.startswith("    ") or bool(re.match(r"\d+\. ", block))


def look_text(least_s: float, most_s: float | None) -> str:
    """How long a look may last, as the end of a sentence."""
    least = f"at least {duration_text(least_s)}" if least_s > 0 else ""
    most = f"at most {duration_text(most_s)}" if most_s is not None else ""
    return " and ".join(part for part in (least, most) if part) or "as long as you like"


def duration_text(seconds: float) -> str:
    """Seconds as words: minutes where they are whole and more than one."""
    if seconds >= 60 and seconds % 60 == 0:
        minutes = round(seconds / 60)
        return f"{minutes} minute" + ("s" if minutes != 1 else "")
    return f"{seconds:g} seconds"
