"""Pieces of a participant's page: the side panel of a trial, cards with texts to read, and the tools below."""

import html
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import viser

from sim.types import Task

from ..page_script import page_html, sign_html, when_shown

PANEL_WIDTH = 400
"""Width of the side panel with texts and buttons, pixels."""
GIVE_UP = "Give up this search"
GIVING_UP = "Press Give up again to end this search"
AGAIN = ": press again"
"""Added to the label of STOP or giving up after the first press."""
_LAST = 1e6
"""Order of the elements below everything else."""
Press = Callable[[], Awaitable[None]]
SentT = TypeVar("SentT")
CameraListener = Callable[[viser.CameraHandle], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class Choice:
    """A button of a card."""

    name: str
    """Name of the choice in the program."""
    label: str
    color: str | None = None
    """viser's colour name; None = the usual blue. No meaning depends on colour alone: the label says what happens."""
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


class Page:
    """One participant's page; `clear` empties it for the next screen."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Sets up the page, once per connection."""
        self.client = client
        client.gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
        client.gui.set_panel_label("PersONAL study")
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(PANEL_WIDTH)
        self._handles: list[Any] = []
        self._on_camera: CameraListener | None = None
        self._tools: viser.GuiHtmlHandle | None = None
        client.camera.on_update(self._camera_moved)
        client.gui.add_html(page_html(panel_width=PANEL_WIDTH))
        self._sign, self._signed = client.gui.add_html(""), ("", 0)

    def clear(self) -> None:
        """Removes all elements of the present screen."""
        self.sign("")
        for handle in self._handles:
            handle.remove()
        self._handles = []
        self._on_camera = None

    def add(self, handle: Any) -> None:
        """Keeps a handle (GUI element, command or scene node) until the next `clear`."""
        self._handles.append(handle)

    def button(
        self, label: str, press: Press, *, color: str | None = None, hint: str | None = None
    ) -> viser.GuiButtonHandle:
        """Adds a button to the panel; returns it so that its label can change."""
        button = self.client.gui.add_button(label, color=color, hint=hint)  # type: ignore[arg-type]

        @button.on_click
        async def _(_: object) -> None:
            await press()

        self.add(button)
        return button

    def hotkey(self, key: str, label: str, press: Press) -> None:
        """Adds a key that works wherever the focus is; one press is one call, the browser filters auto-repeat."""
        command = self.client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(_: object) -> None:
            await press()

        self.add(command)

    def listen_to_camera(self, listener: CameraListener) -> None:
        """Calls `listener` whenever the 3-D camera has moved, until the next `clear`."""
        self._on_camera = listener

    def task_texts(self, task: Task) -> None:
        """Adds the query, then the paragraph; nothing else of the episode exists here."""
        query = html.escape(task.queries[0])
        description = html.escape(task.description)
        self.add(
            self.client.gui.add_html(
                f'<div class="personal-text" style="padding:.5em .65rem">'
                f'<p style="font-size:1.2em;font-weight:600;line-height:1.35;margin:.2em 0 .6em">{query}</p>'
                f'<div class="scroll" tabindex="0" role="region" aria-label="Who owns what">{description}</div></div>'
            )
        )

    def overlay(self, content: str) -> viser.GuiHtmlHandle:
        """Adds a sheet over the 3-D canvas, which then gets no mouse; returns it so that its content can change."""
        handle = self.client.gui.add_html(overlay_html(content))
        self.add(handle)
        return handle

    def sign(self, text: str, number: int = 0) -> None:
        """Shows a line over the picture or the home and has it read aloud; nothing on the page moves.

        Args:
            text: The line; an empty text removes it.
            number: A different number shows the same text once more.
        """
        if (text, number) != self._signed:
            self._signed = text, number
            self._sign.content = sign_html(text, number)

    def card(self, card: Card, chosen: Callable[[str], Awaitable[None]] | None = None) -> None:
        """Shows a card over the whole page.

        Args:
            card: The card.
            chosen: Called with the name of the button that is pressed, by mouse or key; None = the card has no buttons.
        """
        self.clear()
        with self.client.atomic():
            self.add(self.client.gui.add_html(card_html(card) + when_shown("shown")))
            for choice in card.choices:
                assert chosen is not None, card.title
                press = sender(chosen, choice.name)
                self.button(choice.label, press, color=choice.color)
                if choice.hotkey is not None:
                    self.hotkey(choice.hotkey, choice.label, press)
        self.client.flush()

    def tools(self, *, has_keys: bool, on_leave: str) -> None:
        """Adds the buttons that are always there, below everything else: keys, larger text, leaving the study.

        Args:
            has_keys: Whether the participant uses keys that can be chosen.
            on_leave: Text on what happens to the answers of somebody who leaves.
        """
        keys = '<button type="button" data-tool="keys">Keys</button>' if has_keys else ""
        leave = f'<button type="button" data-tool="leave" data-text="{html.escape(on_leave)}">Leave the study</button>'
        if self._tools is not None:
            self._tools.remove()
        self._tools = self.client.gui.add_html(
            f'<div class="personal-tools" role="group" aria-label="Tools">{keys}'
            f'<button type="button" data-tool="large" aria-pressed="false">Larger text</button>{leave}</div>'
            + when_shown("refresh"),
            order=_LAST,
        )

    def notice(self, title: str, text: str) -> None:
        """Shows a card with one message, the last of this page."""
        self.card(Card(title, paragraphs(text)))

    async def _camera_moved(self, camera: viser.CameraHandle) -> None:
        if self._on_camera is not None:
            await self._on_camera(camera)


def sender(send: Callable[[SentT], Awaitable[None]], content: SentT) -> Press:
    """A callback for a button or key that sends one thing."""

    async def press() -> None:
        await send(content)

    return press


def relabel(button: viser.GuiButtonHandle, label: str, color: str | None = None) -> None:
    """Changes the label and colour of a button, if they differ, without moving it."""
    if button.label != label:
        button.label = label
    if color is not None and button.color != color:
        button.color = color  # type: ignore[assignment]


def show_giving_up(button: viser.GuiButtonHandle, *, is_giving_up: bool) -> None:
    """Labels the button of giving up, before and after its first press."""
    relabel(button, GIVE_UP + AGAIN if is_giving_up else GIVE_UP, "red" if is_giving_up else "gray")


def roomy_html(shown: str, *others: str) -> str:
    """HTML of a text with room for each of the other texts, so that nothing below moves when it changes.

    Args:
        shown: HTML of the present text.
        others: At most two plain texts that are shown in this place at other times.
    """
    before, after = (html.escape(text) for text in (*others, "", "")[:2])
    return f'<div class="personal-room" data-before="{before}" data-after="{after}"><div>{shown}</div></div>'


def overlay_html(content: str) -> str:
    """HTML that covers the page except the side panel."""
    return f'<div class="personal-overlay">{content}</div>'


def card_html(card: Card) -> str:
    """HTML of the card without its buttons."""
    title = html.escape(card.title)
    return f'<div class="personal-page">{_parts_html(card.parts, card.part)}<h1>{title}</h1>{card.body}</div>'


def paragraphs(text: str) -> str:
    """Plain text as HTML, a paragraph for each line."""
    return "".join(f"<p>{html.escape(line)}</p>" for line in text.split("\n") if line.strip())


def progress_html(num_done: int, num_all: int, *, unit: str = "trials") -> str:
    """HTML of a progress bar, with the numbers in words beside it."""
    share = 100 * num_done / max(1, num_all)
    return (
        f'<div class="personal-progress" role="progressbar" aria-valuemin="0" aria-valuemax="{num_all}" '
        f'aria-valuenow="{num_done}" aria-label="{num_done} of {num_all} {unit} done">'
        f'<div style="width:{share:.1f}%"></div></div><p class="quiet">{num_done} of {num_all} {unit} done</p>'
    )


def _parts_html(parts: Sequence[str], present: int) -> str:
    items = []
    for number, part in enumerate(parts):
        kind = "done" if number < present else "now" if number == present else ""
        current = ' aria-current="step"' if number == present else ""
        mark = "&#10003; " if number < present else ""
        items.append(f'<li class="{kind}"{current}>{mark}{html.escape(part)}</li>')
    return f'<ol class="steps" aria-label="Where you are">{"".join(items)}</ol>' if items else ""
