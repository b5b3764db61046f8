"""The cards that participants read before, between and after trials, while the browser stays with viser."""

import html
from dataclasses import dataclass, replace
from typing import Literal

from human_study.design.study import StudyConfig
from human_study.journey import (
    AssignedTrial,
    Journey,
    Person,
    ended_trial,
    has_rested,
    journey_of,
    trial_before,
)
from human_study.texts.catalogue import Catalogue, catalogue_of
from human_study.texts.participants import parts_of, trial_name
from human_study.trial.views import RateView

from ..markdown import html_from_markdown

Problem = Literal["paused", "lost_picture", "taken_over", "broken"]
"""Why a page cannot go on: the store cannot write; the browser lost its WebGL context; a newer tab took over; or a
failure of ours that no trial could take."""


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


def problem_card(problem: Problem, words: Catalogue, *, of_sequences: bool = False) -> Card:
    """The card that tells of a problem; its one button, where something can be done, is named `again`."""
    text = "homes.lost_picture" if of_sequences and problem == "lost_picture" else f"problem.{problem}.text"
    again = (Choice("again", words(f"problem.{problem}.again")),) if problem in ("paused", "lost_picture") else ()
    return Card(words(f"problem.{problem}.title"), paragraphs(words(text)), again)


def welcome_back_card(config: StudyConfig, person: Person) -> Card | None:
    """The card for somebody who left or reloaded the page between two trials; None for others."""
    journey, before = journey_of(config, person), trial_before(person)
    if journey.place not in ("practice", "trial") or before is None or has_rested(person, journey):
        return None
    return _saved(config, journey, trial_name(config, person, before))


def begin_card(config: StudyConfig, person: Person) -> Card | None:
    """The card before the first practice trial, or before the first counted trial after practice; None elsewhere."""
    journey, words = journey_of(config, person), catalogue_of(config.language)
    practice = [trial for trial in person.kept if trial.phase == "practice"]
    others = [trial for trial in person.kept if trial.phase != "practice"]
    if journey.place == "practice" and not any(trial.is_begun for trial in practice):
        card = _practice(config, len(practice))
    elif journey.place == "trial" and practice and not any(trial.is_begun for trial in others):
        card = _counted(config, journey)
    else:
        return None
    parts = parts_of(config, person)
    if journey.place not in parts:
        return card
    names = tuple(words(f"part.{part}") for part in parts)
    return replace(card, parts=names, part=parts.index(journey.place))


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
    words = catalogue_of(config.language)
    if ended is not None:
        return _saved(config, journey, trial_name(config, person, ended), feedback)
    lost = words("interrupted.text" if config.sequences is None else "homes.interrupted")
    body = paragraphs(lost) + progress_html(config, journey)
    return Card(words("interrupted.title"), body, (Choice("next", words("page.go_on")),))


def rate_card(view: RateView, words: Catalogue) -> Card:
    """The question how sure the participant is; the names of its choices are numbers."""
    choices = tuple(Choice(str(value), words(f"rate.{value}"), hotkey=str(value)) for value in view.choices)
    return Card(words("rate.title"), paragraphs(words("rate.text")), choices)


def card_html(card: Card, words: Catalogue) -> str:
    """HTML of the card without its buttons."""
    title = html.escape(card.title)
    return f'<div class="personal-page">{_parts_html(card, words)}<h1>{title}</h1>{card.body}</div>'


def progress_html(config: StudyConfig, journey: Journey) -> str:
    """HTML of a progress bar, with the numbers in words beside it; empty where no trial counts."""
    num_done, num_all, words = journey.num_done, journey.num_all, catalogue_of(config.language)
    if not num_all:
        return ""
    key = "page.done" if config.sequences is None else "homes.done"
    done = html.escape(words(key, done=num_done, all=num_all))
    return f'<progress max="{num_all}" value="{num_done}" aria-label="{done}"></progress><p class="quiet">{done}</p>'


def _practice(config: StudyConfig, num_practice: int) -> Card:
    words = catalogue_of(config.language)
    begin, told = words("homes.practice_begin"), words("homes.practice_told")
    if config.sequences is None:
        searches = words.how_many(num_practice, "practice_search", "practice_searches")
        begin, told = words("practice.begin", searches=searches), words("practice.told")
    text = "\n".join((begin, words("practice.free"), told))
    return Card(words("practice.title"), paragraphs(text), (Choice("begin", words("practice.start")),))


def _counted(config: StudyConfig, journey: Journey) -> Card:
    words = catalogue_of(config.language)
    text = paragraphs(f"{words('counted.text')}\n{words('counted.told')}")
    return Card(
        words("counted.title"), text + progress_html(config, journey), (Choice("begin", words("counted.start")),)
    )


def _saved(config: StudyConfig, journey: Journey, name: str, feedback: str = "") -> Card:
    words = catalogue_of(config.language)
    told, progress = paragraphs(words("saved.text", trial=name)), progress_html(config, journey)
    is_home_next = config.sequences is not None and journey.place == "trial"  # all practice is in one home
    go_on = words("homes.next" if is_home_next else "saved.next")
    return Card(words("saved.title"), told + html_from_markdown(feedback) + progress, (Choice("next", go_on),))


def _parts_html(card: Card, words: Catalogue) -> str:
    items = []
    for number, part in enumerate(card.parts):
        kind = "done" if number < card.part else "now" if number == card.part else ""
        current = ' aria-current="step"' if number == card.part else ""
        mark = "&#10003; " if number < card.part else ""
        items.append(f'<li class="{kind}"{current}>{mark}{html.escape(part)}</li>')
    label = html.escape(words("page.steps"))
    return f'<ol class="steps" aria-label="{label}">{"".join(items)}</ol>' if items else ""
