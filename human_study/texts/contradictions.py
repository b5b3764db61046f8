"""Checks that a researcher's own text agrees with the study file: each number is found by the words beside it.

A number beside unknown words, and a rule told without numbers, are not noticed. Only fields in double braces are sure
to agree.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass

from sim.types import FORWARD_STEP, TURN_STEP, TaskKind

from ..design.plan import StudyPlan
from ..design.study import Language, StudyConfig
from ..trial.terms import GIVE_UP_WITHIN_S, STOP_WITHIN_S
from .catalogue import catalogue_of
from .estimate import announced_minutes
from .words import limits_m

_VALUES: dict[str, float] = {
    **{"half": 0.5, "a": 1, "an": 1, "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7},
    **{"eight": 8, "nine": 9, "ten": 10, "twelve": 12, "fifteen": 15, "twenty": 20, "thirty": 30, "forty": 40},
    **{"fifty": 50, "sixty": 60, "seventy": 70, "eighty": 80, "ninety": 90},
}
_WORD = "|".join(sorted((*_VALUES, "hundred"), key=len, reverse=True))
_N = rf"(?P<n>\d+(?:[.,]\d+)?|(?:(?:{_WORD})(?:[ -](?={_WORD}))?)+)"
_LENGTH = r"(?P<unit>metres?|meters?|m|centimetres?|centimeters?|cm)\b"
_TIME = r"(?P<unit>seconds?|s|minutes?|min|hours?|h)\b"
_CURRENCY = r"(?:EUR|USD|GBP|CHF|euros?|dollars?|pounds?|francs?|€|\$|£)"
_SCALE = {"c": 0.01, "s": 1.0, "h": 3600.0}
"""Metres or seconds in one unit, by the unit's first letter."""
_NEAR = r"(?:within|(?:closer|nearer|less|more) than|at most|up to|under|radius of|distance of)"
_MOST = r"(?:have|has|after|within|most|up to|than|uses?|used|are|(?:maximum|limit|budget)(?: of| is)?)"
_ABOUT = r"(?:about |around |approximately |roughly |some |up to |at most |\d+ ?(?:to|-|–) ?)*"

_DENIALS: dict[Language, str] = {
    "en": r"no|not|never|nothing(?! else)",
    "de": r"keine?[mnrs]?|nicht|nie|niemals|nichts(?! anderes| weiter)",
}
"""Words that deny, by language."""
_QUESTIONS = r"demographic|personal questions|questions about you|Fragen zu Ihrer Person|Fragen über Sie"
"""Other words for a survey."""


@dataclass(frozen=True, slots=True)
class _Fact:
    """A number of the study, and how texts name it."""

    field: str
    """Field of the study file, or another name of the number."""
    allowed: Collection[float]
    """Values that a text may give: metres, seconds, or a count."""
    patterns: tuple[str, ...]
    """Regular expressions with the group `n` and, for a quantity, the group `unit`."""


def disagreements(text: str, config: StudyConfig, *, plan: StudyPlan, task: TaskKind) -> list[str]:
    """The places where the text contradicts the study file, in words, each once.

    Args:
        text: The text as participants of the task would read it.
        plan: Gives numbers of trials and the announced time.
    """
    plain = " ".join(re.sub(r"[*_`]", "", text).split())
    found = []
    for fact in _facts(config, plan, task):
        for pattern in fact.patterns:
            for match in re.finditer(pattern, plain, flags=re.IGNORECASE):
                if all(abs(_quantity(match) - allowed) > 1e-9 for allowed in fact.allowed):
                    expected = " or ".join(f"{value:g}" for value in sorted(fact.allowed)) or "empty"
                    found.append(f"says {match[0]!r}, but {fact.field} is {expected}")
    return list(dict.fromkeys([*found, *_of_another_rule(plain, config, task), *_denied(plain, config)]))


def unsaid(text: str, config: StudyConfig) -> list[str]:
    """What the study does with people's data and a consent form does not say, in words."""
    plain = " ".join(text.split()).lower()
    told = _told(config)
    return [f"does not name the {word}, but {field} is set" for word, field in told if word.lower() not in plain]


def _facts(config: StudyConfig, plan: StudyPlan, task: TaskKind) -> list[_Fact]:
    counts = {sum(trial.phase == "main" for trial in person.trials) for person in plan.participants}
    breaks, minutes = config.breaks, announced_minutes(config, plan)
    numbers = {breaks.every, breaks.sitting_max, config.checks.every, config.practice.pan, config.practice.pog}
    seldom = {float(number) for number in (*counts, *numbers, 1, 2) if number is not None}
    stated = f"{config.ethics.pay} {config.ethics.pay_if_leaving} {config.ethics.insurance}"
    pay = [_value(number) for number in re.findall(r"\d+(?:[.,]\d+)?", stated)]
    retention = config.privacy.retention
    unit = "searches" if config.sequences is None else "homes"
    facts = [
        _Fact(f"the study's number of {unit}", seldom, (rf"\b{_N} (?:{unit}|trials|tasks)\b",)),
        _Fact(
            "the announced time in seconds (ethics.duration_min)",
            {60.0 * minutes} if minutes is not None else set(),
            (rf"(?<!break )(?<!search )\b(?:takes?|lasts?|set aside|spend)\b (?:you )?{_ABOUT}{_N} ?{_TIME}",),
        ),
        _Fact("ethics.pay", pay, (rf"{_CURRENCY} ?(?P<n>\d+(?:[.,]\d+)?)", rf"(?P<n>\d+(?:[.,]\d+)?) ?{_CURRENCY}")),
        _Fact(
            "the year of privacy.retention",
            {float(retention.year)} if retention is not None else set(),
            (r"\bdeleted\b[^.]*?\b(?P<n>20\d\d)\b",),
        ),
        _Fact("resume_within_s", {config.resume_within_s}, (rf"\bwithin {_N} {_TIME}(?: to)? the same\b",)),
        _Fact(
            "the time for a second press in seconds",
            {STOP_WITHIN_S, GIVE_UP_WITHIN_S},
            (rf"\btwice within {_N} {_TIME}",),
        ),
        _Fact(
            f"the distance in metres that decides ({f'rule {config.success}' if task == 'pan' else 'of the mark'})",
            limits_m(config, task),
            (rf"\b{_NEAR} {_N} ?{_LENGTH}", rf"\b{_N} ?{_LENGTH} (?:or (?:less|closer|nearer)|from|of|away)\b"),
        ),
    ]
    if task == "pan":
        limit = {config.pan_max_s} if config.pan_max_s is not None else set()
        facts += [
            _Fact("steps", {config.steps}, (rf"\b{_MOST} {_N} steps\b", rf"\b{_N} steps (?:for|per|in|at|each)\b")),
            _Fact("pan_max_s", limit, (rf"\bends after {_N} {_TIME}",)),
            _Fact("one step in metres", {FORWARD_STEP}, (rf"\b(?:walks|moves|goes) {_N} ?{_LENGTH}",)),
            _Fact("one turn in degrees", {round(TURN_STEP * 57.29578)}, (rf"\bturns {_N} ?(?:degrees|°)",)),
        ]
    return facts


def _of_another_rule(plain: str, config: StudyConfig, task: TaskKind) -> list[str]:
    """Words that belong to a rule of PAN that this study does not score by."""
    by_middle = r"\b(?:its|object's) (?:middle|cent(?:re|er))|(?:middle|cent(?:re|er)) of (?:the|that) object"
    by_view = r"viewing places?|plain view"
    if task == "pog" or config.success not in ("habitat", "authors"):
        pattern = by_view
    else:
        pattern = by_middle
    match = re.search(pattern, plain, flags=re.IGNORECASE)
    rule = f"success is {config.success}" if task == "pan" else "a mark counts by its distance from the middle"
    return [f"says {match[0]!r}, but {rule}"] if match is not None else []


def _told(config: StudyConfig) -> list[tuple[str, str]]:
    """(word that a consent form must use, field that makes it necessary)."""
    words = catalogue_of(config.language)
    told = [(words("told.language_model"), "ethics.language_model")] if config.ethics.language_model else []
    told += [(words("told.comment"), "comments")] if config.comments else []
    return told + ([(words("told.survey"), "survey.questions")] if config.survey.questions else [])


def _denied(plain: str, config: StudyConfig) -> list[str]:
    """Sentences that deny what the study does with people's data."""
    found, denial = [], _DENIALS[config.language]
    for word, field in _told(config):
        word = f"(?:{word}|{_QUESTIONS})" if field == "survey.questions" else word
        match = re.search(rf"\b(?:{denial})\b[^.:;]{{0,80}}\b{word}", plain, flags=re.IGNORECASE)
        found += [f"says {match[0]!r}, but {field} is set"] if match is not None else []
    return found


def _quantity(match: re.Match[str]) -> float:
    """The number in a match; metres or seconds if it has a unit."""
    value = _value(match["n"])
    unit = match.groupdict().get("unit")
    if unit is None:
        return value
    is_minutes = unit.lower().startswith("min")
    return value * (60.0 if is_minutes else _SCALE.get(unit.lower()[0], 1.0))


def _value(text: str) -> float:
    """The value of a number in digits, or in words up to nine hundred ninety-nine."""
    if text[0].isdigit():
        return float(text.replace(",", "."))
    total = 0.0
    for word in re.split(r"[ -]", text.lower()):
        total = (total or 1) * 100 if word == "hundred" else total + _VALUES[word]
    return total
