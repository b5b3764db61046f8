"""The question after an answer: how sure are you? Five buttons, or the keys 1 to 5."""

from collections.abc import Awaitable, Callable

from human_study.trial.commands import Command, Rate
from human_study.trial.views import RateView

from .panels import Card, Choice, Page

_WORDS = {1: "guessed", 2: "rather unsure", 3: "half and half", 4: "rather sure", 5: "certain"}


class RateApp:
    """Draws the question on a page and turns presses into commands."""

    def __init__(self, page: Page, view: RateView, send: Callable[[Command], Awaitable[None]]) -> None:
        """Builds the screen."""

        async def chosen(name: str) -> None:
            await send(Rate(int(name)))

        choices = tuple(Choice(str(value), f"{value}: {_WORDS[value]}", hotkey=str(value)) for value in view.choices)
        body = "<p>How sure are you of your answer? Press a button, or a key from 1 to 5.</p>"
        page.card(Card("How sure are you?", body, choices), chosen)

    def show(self, view: RateView) -> None:
        """The question never changes."""

    def close(self) -> None:
        """`Page.clear` ends it."""
