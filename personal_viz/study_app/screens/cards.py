"""The cards that participants read before, between and after trials, while the browser stays with viser."""

import html
from collections.abc import Sequence
from dataclasses import dataclass, replace

from human_study.design.study import StudyConfig
from human_study.journey import (
    AssignedTrial,
    Journey,
    Person,
    ended_trial,
    has_rested,
    journey_of,
    trial_before,
    trial_name,
)
from human_study.texts.participants import PARTS, parts_of
from human_study.trial.views import RateView

from ..markdown import html_from_markdown

_WORDS = {1: "guessed", 2: "rather unsure", 3: "half and half", 4: "rather sure", 5: "certain"}


@dataclass(frozen=True, slots=True)
class Choice:
    """A button of a card."""

    name: str
    """Name of the choice in the program."""
    label: str
    hotkey: str | None = None
    """viser's name of a key that does the same."""


@dataclass(frozen=True, slots=True)
class Card:
    """A page to read: a heading, a text, and buttons."""

    title: str
    body: str
    """HTML, already escaped."""
    choices: tuple[Choice, ...] = ()
    parts: tuple[str, ...] = ()
    """Names of the study's parts above the card; () shows none."""
    part: int = 0
    """Index of the card's own part."""


def paragraphs(text: str) -> str:
    """Plain text as HTML, a paragraph for each line."""
    return "".join(f"<p>{html.escape(line)}</p>" for line in text.split("\n") if line.strip())


PAUSED = Card(
    "The study is paused",
    paragraphs("Nothing that you did is lost. Please try again in a minute."),
    (Choice("again", "Try again"),),
)
"""While the store cannot write."""
LOST_PICTURE = Card(
    "The 3-D picture was lost",
    paragraphs(
        "Your browser stopped drawing in 3-D. That is not your fault. The search that was open does not count; you "
        "will get it again. Everything else is stored."
    ),
    (Choice("reload", "Load the page again"),),
)
"""After the browser lost its WebGL context."""
TAKEN_OVER = Card("This page is no longer used", paragraphs("You opened the study in another tab. Continue there."))
BROKEN = Card("Something went wrong", paragraphs("Nothing that you did is lost. Open your personal link again."))
"""After a failure of ours that no trial could take."""


def welcome_back_card(config: StudyConfig, person: Person) -> Card | None:
    """The card for somebody who left or reloaded the page between two trials; None for others."""
    journey, before = journey_of(config, person), trial_before(person)
    if journey.place not in ("practice", "trial") or before is None or has_rested(person, journey):
        return None
    return _saved(journey, trial_name(person, before))


def begin_card(config: StudyConfig, person: Person) -> Card | None:
    """The card before the first practice trial, or before the first counted trial after practice; None elsewhere."""
    journey = journey_of(config, person)
    practice = [trial for trial in person.kept if trial.phase == "practice"]
    others = [trial for trial in person.kept if trial.phase != "practice"]
    if journey.place == "practice" and not any(trial.is_begun for trial in practice):
        card = _practice(len(practice))
    elif journey.place == "trial" and practice and not any(trial.is_begun for trial in others):
        card = _counted(journey)
    else:
        return None
    parts = parts_of(config, person)
    part = PARTS[journey.place]
    return replace(card, parts=parts, part=parts.index(part)) if part in parts else card


def card_after(config: StudyConfig, person: Person, played: AssignedTrial, *, feedback: str = "") -> Card | None:
    """The card after a trial, by the store's record of it; None where a break comes.

    Args:
        config: The study.
        person: The participant's stored facts.
        played: The trial.
        feedback: Markdown that tells whether a practice trial went well.
    """
    journey, ended = journey_of(config, person), ended_trial(person, played.order_no)
    if journey.place not in ("practice", "trial"):
        return None
    if ended is not None:
        return _saved(journey, trial_name(person, ended), feedback)
    text = "This search was interrupted, so it does not count. Everything else that you did is stored."
    return Card("Interrupted", paragraphs(text) + progress_html(journey), (Choice("next", "Go on"),))


def rate_card(view: RateView) -> Card:
    """The question how sure the participant is; the names of its choices are numbers."""
    choices = tuple(Choice(str(value), f"{value}: {_WORDS[value]}", hotkey=str(value)) for value in view.choices)
    body = "<p>How sure are you of your answer? Press a button, or a key from 1 to 5.</p>"
    return Card("How sure are you?", body, choices)


def card_html(card: Card) -> str:
    """HTML of the card without its buttons."""
    title = html.escape(card.title)
    return f'<div class="personal-page">{_parts_html(card.parts, card.part)}<h1>{title}</h1>{card.body}</div>'


def progress_html(journey: Journey) -> str:
    """HTML of a progress bar, with the numbers in words beside it; empty where no trial counts."""
    num_done, num_all = journey.num_done, journey.num_all
    if not num_all:
        return ""
    return (
        f'<progress max="{num_all}" value="{num_done}" aria-label="{num_done} of {num_all} searches done"></progress>'
        f'<p class="quiet">{num_done} of {num_all} searches done</p>'
    )


def _practice(num_practice: int) -> Card:
    what = "one practice search" if num_practice == 1 else f"{num_practice} practice searches"
    text = (
        f"You begin with {what} in a home that is not part of the study.\n"
        "Practice does not count. Take your time and try every key or button.\n"
        "After each practice search you are told whether your answer was right."
    )
    return Card("Practice", paragraphs(text), (Choice("begin", "Begin to practise"),))


def _counted(journey: Journey) -> Card:
    text = "The practice is over. From now on every search counts.\nYou will not be told whether an answer was right."
    return Card("Now it counts", paragraphs(text) + progress_html(journey), (Choice("begin", "Begin"),))


def _saved(journey: Journey, name: str, feedback: str = "") -> Card:
    body = paragraphs(f"{name} is stored.") + html_from_markdown(feedback) + progress_html(journey)
    return Card("Saved", body, (Choice("next", "Next search"),))


def _parts_html(parts: Sequence[str], present: int) -> str:
    items = []
    for number, part in enumerate(parts):
        kind = "done" if number < present else "now" if number == present else ""
        current = ' aria-current="step"' if number == present else ""
        mark = "&#10003; " if number < present else ""
        items.append(f'<li class="{kind}"{current}>{mark}{html.escape(part)}</li>')
    return f'<ol class="steps" aria-label="Where you are">{"".join(items)}</ol>' if items else ""
