"""The pages around the trials as cards: what each says and which buttons it has."""

import html
from dataclasses import dataclass

from human_study.design.study import Condition, StudyConfig
from human_study.journey import Journey
from human_study.texts.quiz import Question

from ..page_script import Device
from .markdown import html_from_markdown, title_of
from .panels import Card, Choice, paragraphs, progress_html

MIN_WIDTH, MIN_HEIGHT = 1000, 600
"""Smallest page in pixels, to which the device check asks people to widen their window."""
_SMALLER = 0.95
"""Browsers' own bars make "about": a little less is accepted."""
IN_3D: tuple[Condition, ...] = ("glb", "map_first", "map_open", "map_2d")
"""Conditions in which the browser draws the home itself and needs WebGL."""
ON_LEAVE = {
    "delete": "What you did in your searches will be deleted and cannot be brought back.",
    "keep": "What you did so far will be kept without your name. Nothing more will be asked of you.",
}
"""What happens to the data of somebody who withdraws (`privacy.on_withdraw`)."""


@dataclass(frozen=True, slots=True)
class DeviceReport:
    """What the device check found; stored coarsely."""

    device: Device
    needs_webgl: bool
    has_pressed: bool
    """Whether the key W arrived."""
    uses_buttons: bool
    """Whether the participant has no keyboard, or does not want to use it."""

    @property
    def is_large_enough(self) -> bool:
        """Whether the page has room for picture and texts."""
        return self.device.width >= _SMALLER * MIN_WIDTH and self.device.height >= _SMALLER * MIN_HEIGHT

    @property
    def can_show(self) -> bool:
        """Whether graphics and window will do."""
        return self.is_large_enough and (self.device.webgl2 or not self.needs_webgl)

    @property
    def is_ready(self) -> bool:
        """Whether the participant can go on."""
        return self.can_show and (self.has_pressed or self.uses_buttons)

    def detail(self) -> dict[str, bool | int]:
        """For the record: sizes rounded, nothing that tells one computer from another."""
        return {
            "webgl2": self.device.webgl2,
            "width": 100 * round(self.device.width / 100),
            "height": 100 * round(self.device.height / 100),
            "keyboard": self.has_pressed,
        }


def device_card(report: DeviceReport | None, *, has_keys: bool, may_leave: bool = False) -> Card:
    """The device check.

    Args:
        report: None = the browser has not answered yet.
        has_keys: Whether the task is done with keys.
        may_leave: Whether somebody whose computer cannot show the study is sent back to the recruiting platform.
    """
    if report is None:
        body = '<p role="status">Looking at your browser &hellip;</p>'
        return Card("Can this computer show the study?", body, (Choice("reload", "Try again", "gray"),))
    device = report.device
    lines = []
    if report.needs_webgl:
        how = (
            "works"
            if device.webgl2
            else "is not available. Please open your link in a current Firefox, Chrome, Edge or Safari, or switch "
            "hardware acceleration on."
        )
        lines.append(("3-D", device.webgl2, f"3-D graphics (WebGL 2): {how}"))
    size = f"Your window has room for {device.width} x {device.height} pixels"
    if report.is_large_enough:
        lines.append(("Window", True, f"{size}: enough"))
    else:
        more = f"; {MIN_WIDTH} x {MIN_HEIGHT} are needed. Please make it larger; this page notices by itself."
        lines.append(("Window", False, size + more))
    if has_keys:
        known = report.has_pressed or report.uses_buttons
        text = (
            "The key arrived"
            if report.has_pressed
            else "You use the buttons on the screen"
            if report.uses_buttons
            else "Please press the key W, the second letter of the upper row (Z on French keyboards)"
        )
        lines.append(("Keyboard", known if known else None, text))
    items = "".join(
        f"<li><b>{'&#10003; OK' if ok else '&#9675; Now' if ok is None else '&#10007; Not yet'}</b>"
        f"<span><strong>{name}.</strong> {html.escape(text)}.</span></li>"
        for name, ok, text in lines
    )
    body = f"<p>Please have a mouse or touchpad{' and a keyboard' if has_keys else ''} at hand.</p>"
    body += f'<ul class="checks" role="status">{items}</ul>'
    choices: tuple[Choice, ...] = ()
    if report.is_ready:
        choices = (Choice("continue", "Continue"),)
    elif report.can_show:
        choices = (Choice("buttons", "Continue without a keyboard, with buttons", "gray"),)
    elif may_leave:
        choices = (Choice("leave", "This cannot be changed here: end my part", "gray"),)
    return Card("Can this computer show the study?", body, choices)


def consent_card(text: str) -> Card:
    """The consent text, as the researcher wrote it, and the question."""
    body = (
        f'<div class="scroll" tabindex="0" role="region" aria-label="Text">{html_from_markdown(text)}</div>'
        "<p>Please read the text to its end. Do you agree and want to take part?</p>"
    )
    choices = (Choice("agree", "I agree and take part"), Choice("decline", "I do not agree", "gray"))
    return Card(title_of(text, otherwise="Before you begin"), body, choices)


def instruction_card(pages: tuple[str, ...], index: int, *, is_again: bool) -> Card:
    """One page of the instructions, each of which is Markdown that begins with its heading."""
    again = ""
    if is_again and index == 0:
        again = (
            '<p class="note">Some answers were not right yet. Please read this once more; then you are asked again.</p>'
        )
    count = f'<p class="quiet">Page {index + 1} of {len(pages)}</p>'
    onward = Choice("next", "Next") if index + 1 < len(pages) else Choice("next", "I have read this")
    back = (Choice("back", "Back", "gray"),) if index else ()
    body = again + html_from_markdown(pages[index]) + count
    return Card(title_of(pages[index], otherwise="About this study"), body, (onward, *back))


def question_card(question: Question, answers: tuple[str, ...], *, number: int, num_all: int, was_wrong: bool) -> Card:
    """One question; after a wrong answer it says why, and asks again."""
    note = ""
    if was_wrong:
        note = (
            '<div class="note warn" role="alert">'
            + html_from_markdown(f"**Not quite.** {question.because} Please answer again.")
            + "</div>"
        )
    body = f'<p class="quiet">Question {number} of {num_all}</p><p>{html.escape(question.text)}</p>{note}'
    choices = tuple(Choice(answer, answer, "gray") for answer in answers)
    return Card("Is everything clear?", body, choices)


def practice_card(num_practice: int) -> Card:
    """Before the first practice trial."""
    what = "one search" if num_practice == 1 else f"{num_practice} searches"
    text = (
        f"You begin with {what} to practise, in a home that is not part of the study.\n"
        "Practice is not counted. Take your time and try every key or button.\n"
        "After each search of the practice you are told whether your answer was right."
    )
    return Card("Practice", paragraphs(text), (Choice("begin", "Begin to practise"),))


def real_card(journey: Journey, more_html: str = "") -> Card:
    """After the practice, before the first counted trial."""
    text = "The practice is over. From now on every search counts.\nYou will not be told whether an answer was right."
    body = paragraphs(text) + more_html + progress_html(journey.num_done, journey.num_all, unit="searches")
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


def break_card(journey: Journey) -> Card:
    """A rest."""
    text = "Everything is stored. Look away from the screen, stand up, have a drink. Go on when you like."
    body = paragraphs(text) + progress_html(journey.num_done, journey.num_all, unit="searches")
    return Card("Time for a break", body, (Choice("next", "Go on"),))


def pause_card(config: StudyConfig, journey: Journey, *, back_in_s: float) -> Card:
    """The end of a sitting.

    Args:
        config: The study.
        journey: What the participant has done.
        back_in_s: How long the pause still lasts; 0 = the participant can go on.
    """
    bar = progress_html(journey.num_done, journey.num_all, unit="searches")
    if back_in_s <= 0:
        return Card("Welcome back", paragraphs("You can go on now.") + bar, (Choice("next", "Go on"),))
    text = (
        f"You have done {config.breaks.sitting_max} searches in one go; that is enough for now. Everything is stored.\n"
        f"Please come back with the same link in {duration(back_in_s)} or later."
    )
    return Card("A longer rest", paragraphs(text) + bar, (Choice("look", "Look whether I can go on", "gray"),))


def end_card(config: StudyConfig, journey: Journey, *, code: str | None, url: str | None = None) -> Card:
    """What is shown when there is nothing more to do."""
    match journey.place:
        case "finished":
            body = paragraphs("All your answers are stored. You can close this page.")
            if code is not None:
                body += (
                    '<p>Your completion code:</p><p class="code" aria-label="Completion code">'
                    f"{html.escape(code)}</p>{_link_html(url)}"
                )
            return Card("Thank you!", body)
        case "declined":
            return Card(
                "Thank you for reading",
                paragraphs("You do not take part. Stored are this answer, its time and the check of your browser.")
                + _code_html(code, url),
            )
        case "withdrawn":
            done = {
                "delete": "What you did in your searches has been deleted.",
                "keep": "What you did so far is kept without your name.",
            }
            text = f"{done[config.privacy.on_withdraw]} You can close this page."
            return Card("You have left the study", paragraphs(text) + _code_html(code, url))
        case "screened_out":
            text = "Thank you for your interest. This study needs another kind of computer. You can close this page."
            return Card("This study cannot be shown here", paragraphs(text) + _code_html(code, url))
        case _:
            text = (
                "Thank you for coming. All places are taken, so there is nothing left for you to do.\n"
                "You will be paid as announced. You can close this page."
            )
            return Card("The study is full", paragraphs(text) + _code_html(code, url))


def duration(seconds: float) -> str:
    """A time to wait, rounded up, in words."""
    minutes = max(1, -int(-seconds // 60))
    if minutes < 90:
        return "one minute" if minutes == 1 else f"{minutes} minutes"
    return f"{-int(-minutes // 60)} hours"


def _code_html(code: str | None, url: str | None) -> str:
    if code is None:
        return ""
    return f'<p>Your code:</p><p class="code" aria-label="Code">{html.escape(code)}</p>{_link_html(url)}'


def _link_html(url: str | None) -> str:
    if url is None:
        return ""
    address = html.escape(url)
    return f'<p><a href="{address}" rel="noreferrer">Go back to the page that sent you</a></p>'
