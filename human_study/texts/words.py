"""The words of a study: values and passages from its file and plan that every template can name.

Limits are the same values that trials are run and scored with (`sim.tasks.rules`, `trial_terms`), so that no text can
give a different one. `passages.md` of a language holds every rule that appears in more than one text for participants;
`templates/board.md` has those for boards, which read English.
"""

import functools
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import jinja2
from jinja2.runtime import Macro
from jinja2.sandbox import SandboxedEnvironment

from sim.errors import StudyError, did_you_mean
from sim.tasks.rules import AUTHORS_DISTANCE, HABITAT_DISTANCE, RELAXED_RADIUS, SUCCESS_RADIUS
from sim.types import FORWARD_STEP, TURN_STEP, SuccessRule, TaskKind

from ..design.plan import StudyPlan
from ..design.study import Condition, HistoryCondition, PanCondition, PogCondition, StudyConfig
from ..trial.terms import GIVE_UP_WITHIN_S, STOP_WITHIN_S, look_of, terms_of
from .catalogue import LANGUAGES, Catalogue, catalogue_of
from .estimate import announced_minutes
from .survey import questions_of

WIDTH = 110
_LIMITS: dict[SuccessRule, tuple[float, ...]] = {
    "paper": (SUCCESS_RADIUS, RELAXED_RADIUS),
    "habitat": (HABITAT_DISTANCE,),
    "authors": (AUTHORS_DISTANCE,),
    "paper-strict": (SUCCESS_RADIUS,),
}
"""Distances in metres by which a rule of PAN tells right from wrong."""
_FIELDS = {
    "ethics.institution": "institution",
    "ethics.contact": "contact",
    "ethics.pay": "pay",
    "ethics.pay_if_leaving": "pay_if_leaving",
    "ethics.insurance": "insurance",
    "ethics.data_protection_officer": "data_protection_officer",
    "ethics.legal_basis": "legal_basis",
    "ethics.complaint_body": "complaint_body",
    "ethics.irb": "irb",
    "ethics.duration_min": "minutes",
    "privacy.retention": "retention_date",
}
"""Fields of the study file that may be empty, and the words that they fill."""
_MARK = re.compile(r"\[to\s+be\s+filled\s+in:\s+([a-z_.]+)\]")
_TEMPLATES = Path(__file__).parent / "templates"
_PASSAGES = ("passages.md", "board.md")


def limits_m(config: StudyConfig, task: TaskKind) -> tuple[float, ...]:
    """The distances in metres that decide whether an answer is right; the boundary counts as right."""
    return _LIMITS[config.success] if task == "pan" else (SUCCESS_RADIUS,)


def words_of(
    config: StudyConfig,
    *,
    plan: StudyPlan | None = None,
    task: TaskKind | None = None,
    conditions: Sequence[Condition] | None = None,
    is_for_people: bool = False,
    catalogue: Catalogue | None = None,
) -> dict[str, Any]:
    """Every value and passage that a template can name.

    Args:
        plan: Gives the announced time where the study file does not, and says whether this is a pilot.
        task: The reader's task; None = a reader of the whole study.
        conditions: All conditions that the reader will meet; None = all conditions of the task.
        is_for_people: Whether participants read the words. In a pilot they read plain words instead of a mark where the
            study file is still empty.
        catalogue: The language of the words; None = the study's own.
    """
    told = catalogue if catalogue is not None else catalogue_of(config.language)
    said_instead = told.texts if is_for_people and plan is not None and plan.is_pilot else {}
    values: dict[str, Any] = {
        _FIELDS[field]: value or said_instead.get(f"pilot.{_FIELDS[field]}") or open_place(field)
        for field, value in _stated(config, plan, told).items()
    }
    tasks = config.task if task is None else (task,)
    of_task: dict[TaskKind, Sequence[Condition]] = {
        each: config.conditions(each) if conditions is None else conditions for each in tasks
    }
    met = {name for names in of_task.values() for name in names}
    seen = {config.view_in(each, name) for each, names in of_task.items() for name in names}
    views = [name for name in (*get_args(PanCondition), *get_args(PogCondition)) if name in seen]
    values |= {
        "catalogue": told,
        "study": config,
        "rule": config.success,
        "task": task,
        "tasks": tasks,
        "conditions": [name for name in (*views, *get_args(HistoryCondition)) if name in met],
        "views": views,
        "actions": [action.name.lower() for action in config.action_set],
        "limits": [told.length(limit) for limit in limits_m(config, "pan")],
        "point_limit": told.length(SUCCESS_RADIUS),
        "forward": f"{100 * FORWARD_STEP:.0f} cm",
        "turn": told.how_many(round(math.degrees(TURN_STEP)), "degree", "degrees"),
        "stop_within": told.duration(STOP_WITHIN_S),
        "give_up_within": told.duration(GIVE_UP_WITHIN_S),
        "resume": told.duration(config.resume_within_s),
        "gap": told.duration(config.breaks.sitting_gap_s),
        "pan_limit": _time_limit(config, "pan", told),
        "pog_limit": _time_limit(config, "pog", told),
        "looks": {name: _look_limit(config, name, told) for name in views},
        "is_longer_than_a_sitting": _is_longer_than_a_sitting(config),
        "has_platform_code": hashes_platform_ids(config),
        "survey_topics": [question.about for question in questions_of(config, told).values()],
    }
    for name in _PASSAGES:
        passages = vars(_environment(told).get_template(name).make_module(values))
        values |= {name: str(words()).strip() for name, words in passages.items() if isinstance(words, Macro)}
    return values


def empty_fields(config: StudyConfig, plan: StudyPlan | None = None) -> tuple[str, ...]:
    """The fields that texts need and that the study file leaves empty."""
    return tuple(field for field, value in _stated(config, plan, catalogue_of(config.language)).items() if not value)


def filled(template: str, words: Mapping[str, Any]) -> str:
    """One of our templates, in the language of these words, filled with them and wrapped to one width.

    Args:
        template: Name of a file of the language, or of `templates`.
        words: From `words_of`.
    """
    return wrapped(_environment(words["catalogue"]).get_template(template).render(words))


def source_of(template: str, language: str) -> str:
    """The unfilled template for participants; a new study gets it as a text to change."""
    return (LANGUAGES / language / template).read_text(encoding="utf-8")


def filled_text(text: str, words: Mapping[str, Any], *, where: Path) -> str:
    """A researcher's text with these words in place of its fields; a text without fields stays as it is.

    Args:
        text: May name any of the words in double braces, or mark a field of the study file as to be filled in.
        words: From `words_of`.

    Raises:
        StudyError: The text names an unknown word, or is not a valid template.
    """
    text = _MARK.sub(lambda mark: words[_FIELDS[mark[1]]] if mark[1] in _FIELDS else mark[0], text)
    if not re.search(r"\{\{|\{%|\{#", text):
        return text
    try:
        return wrapped(_environment(words["catalogue"]).from_string(text).render(words))
    except jinja2.TemplateSyntaxError as error:
        problem, line = error.message, f", line {error.lineno}"
    except (jinja2.TemplateError, ArithmeticError, TypeError, ValueError) as error:
        problem, line = str(error), ""
    names = sorted(name for name, word in words.items() if isinstance(word, str))
    unknown = re.match(r"'(\w+)' is undefined", problem or "")
    raise StudyError(
        f"{where}{line}: cannot be filled in ({problem}); expected only words of the study in double braces."
        f"{did_you_mean(unknown[1], names) if unknown else ''} Use: {', '.join(names)}."
    )


def open_place(field: str) -> str:
    """The mark for a place where the study file leaves `field` empty."""
    return f"[to be filled in: {field}]"


def open_places(text: str) -> tuple[str, ...]:
    """The fields that a text still marks as to be filled in, each once, in order of appearance."""
    return tuple(dict.fromkeys(_MARK.findall(text)))


def hashes_platform_ids(config: StudyConfig) -> bool:
    """Whether ids of a recruiting platform reach the study: people who come by the open link bring them."""
    return config.recruit.kind == "prolific" or (config.recruit.kind == "link" and config.privacy.platform_id == "hmac")


def wrapped(text: str) -> str:
    """The Markdown with its paragraphs wrapped to one width; headings, lists and tables stay as they are."""
    blocks = [block for block in re.split(r"\n\s*\n", text.strip()) if block.strip()]
    filled = [block if _is_kept(block) else textwrap.fill(" ".join(block.split()), WIDTH) for block in blocks]
    return re.sub(r"[ \t]+\n", "\n", "\n\n".join(block.strip("\n") for block in filled) + "\n")


def _is_kept(block: str) -> bool:
    """Whether a block is not a paragraph but a heading, list, table, quotation or drawing (indented)."""
    return block.lstrip()[0] in "#-|>" or block.startswith("    ") or bool(re.match(r"\d+\. ", block))


@functools.cache
def _environment(catalogue: Catalogue) -> SandboxedEnvironment:
    """The templates of a language, and those for boards."""
    made = SandboxedEnvironment(
        loader=jinja2.FileSystemLoader([catalogue.folder, _TEMPLATES]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters["minutes"] = lambda seconds: f"{seconds / 60:.0f}"
    return made


def _stated(config: StudyConfig, plan: StudyPlan | None, told: Catalogue) -> dict[str, str]:
    """Values of the fields that texts need, with the announced time from the plan; '' = the study file has none."""
    values = {field: getattr(config.ethics, field.removeprefix("ethics."), "") for field in _FIELDS}
    day = config.privacy.retention
    values |= {
        "ethics.duration_min": announced_minutes(config, plan),
        "privacy.retention": told.date(day) if day is not None else "",
    }
    return {field: str(value or "").strip() for field, value in values.items()}


def _time_limit(config: StudyConfig, task: TaskKind, told: Catalogue) -> str:
    """The time limit of a trial of the task, in words; '' = there is none."""
    seconds = terms_of(config, config.conditions(task)[0], task=task).task_max_s
    return told.duration(seconds) if seconds is not None else ""


def _look_limit(config: StudyConfig, condition: Condition, told: Catalogue) -> str:
    """The time limit of the look before a trial of the condition, as the end of a sentence; '' = there is none."""
    look = look_of(config, condition)
    if look is None:
        return ""
    least = told.duration(look.min_s) if look.min_s > 0 else None
    most = told.duration(look.max_s) if look.max_s is not None else None
    if least and most:
        return told("look_limit.both", least=least, most=most)
    if least:
        return told("look_limit.least", time=least)
    return told("look_limit.most", time=most) if most else told("look_limit.none")


def _is_longer_than_a_sitting(config: StudyConfig) -> bool:
    """Whether somebody may have more counted trials than fit into one sitting."""
    sitting, asked = config.breaks.sitting_max, config.design.trials_per_person
    return sitting is not None and (asked is None or asked > sitting)
