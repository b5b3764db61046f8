"""The cards between trials, where the browser stays with viser: what each says and which buttons it has."""

from human_study.journey import Journey

from ..markdown import html_from_markdown
from .panels import Card, Choice, paragraphs, progress_html


def practice_card(num_practice: int) -> Card:
    """Before the first practice trial."""
    what = "one search" if num_practice == 1 else f"{num_practice} searches"
    text = (
        f"You begin with {what} to practise, in a home that is not part of the study.\n"
        "Practice is not counted. Take your time and try every key or button.\n"
        "After each search of the practice you are told whether your answer was right."
    )
    return Card("Practice", paragraphs(text), (Choice("begin", "Begin to practise"),))


def real_card(journey: Journey) -> Card:
    """After the practice, before the first counted trial."""
    text = "The practice is over. From now on every search counts.\nYou will not be told whether an answer was right."
    body = paragraphs(text) + progress_html(journey.num_done, journey.num_all, unit="searches")
    return Card("Now it counts", body, (Choice("begin", "Begin"),))


def saved_card(journey: Journey, name: str, word: str = "") -> Card:
    """Between two trials: which one is stored, and what is said (Markdown) of one that was practice."""
    bar = progress_html(journey.num_done, journey.num_all, unit="searches") if journey.num_all else ""
    return Card(
        "Saved", paragraphs(f"{name} is stored.") + html_from_markdown(word) + bar, (Choice("next", "Next trial"),)
    )


def interrupted_card(journey: Journey) -> Card:
    """After a trial that has no result: it failed, or its participant was away for too long."""
    bar = progress_html(journey.num_done, journey.num_all, unit="searches") if journey.num_all else ""
    text = "This search was interrupted, so it does not count. Everything else that you did is stored."
    return Card("Interrupted", paragraphs(text) + bar, (Choice("next", "Go on"),))


def lost_picture_card() -> Card:
    """After the browser lost its WebGL context."""
    text = (
        "Your browser stopped drawing in 3-D; that is not your fault. The search that was open does not count and is "
        "asked again. Everything else is stored."
    )
    return Card("The 3-D picture was lost", paragraphs(text), (Choice("reload", "Load the page again"),))
