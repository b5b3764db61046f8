"""The PAN screen: the robot's present view, texts, step counter, buttons, keys. No mesh and no goal in the browser.

STOP and giving up need a second press. The request for it is written on the button itself and over the picture, so
that nothing moves under the pointer between the two presses.
"""

import base64
import html
from collections.abc import Callable, Mapping
from functools import partial
from typing import cast

import numpy as np
import viser
from numpy.typing import NDArray

from human_study.texts.catalogue import Catalogue
from human_study.trial.commands import GiveUp, Move, PressStop
from human_study.trial.views import PanView
from sim.render.renderer import jpeg_bytes
from sim.types import Action

from ..page_script import KeyAction
from .page import Page, Send, overlay_html, relabel, show_giving_up
from .texts import TaskTexts, news_of

HOTKEYS = {
    "W": ("KeyW", Action.FORWARD),
    "arrowup": ("ArrowUp", Action.FORWARD),
    "A": ("KeyA", Action.LEFT),
    "arrowleft": ("ArrowLeft", Action.LEFT),
    "D": ("KeyD", Action.RIGHT),
    "arrowright": ("ArrowRight", Action.RIGHT),
    "R": ("KeyR", Action.LOOK_UP),
    "F": ("KeyF", Action.LOOK_DOWN),
}
"""(logged code, action) by viser's names of keys; DESIGN.md, keys."""
Encode = Callable[[NDArray[np.uint8]], bytes]


class PanScreen:
    """Draws one PAN trial on a page and turns presses into commands."""

    def __init__(
        self,
        page: Page,
        view: PanView,
        send: Send,
        *,
        caption: str,
        has_history: bool = True,
        display_scale: float = 2.0,
        encode: Encode = jpeg_bytes,
    ) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: The first view.
            send: Receives the commands.
            caption: HTML with the trial's name and the kind of home, without the home's name.
            has_history: In home sequences, whether messages of earlier searches can be read again.
            display_scale: The picture fills the window up to this many times its size.
            encode: Encodes a picture as JPEG; `Frames.jpeg` remembers the results.
        """
        self._page, self._caption, self._encode, self._display_scale = page, caption, encode, display_scale
        self._buttons: dict[Action, viser.GuiButtonHandle] = {}
        self._texts = TaskTexts(page, has_history=has_history)
        page.clear()
        with page.client.atomic():
            self._status_html = _status_html(caption, view, page.words)
            with page.always_visible("top"):
                self._texts.add_query(view)
                self._status = page.add(page.client.gui.add_html(self._status_html))
            self._texts.add_description(view)
            self._image = page.overlay(self._image_html(view))
            self._shown = (view.rgb, view.step)
            self._add_controls(view, send)
            self._show_sign(view)
        page.client.flush()

    def show(self, view: PanView) -> None:
        """Draws the changes of the view, picture or texts; they are on their way to the browser when this returns.

        A view without a picture leaves the last picture in place.
        """
        self._texts.show(view)
        status = _status_html(self._caption, view, self._page.words)
        if status != self._status_html:
            self._status_html = self._status.content = status
        self._show_sign(view)
        if view.rgb is not None and (view.rgb is not self._shown[0] or view.step != self._shown[1]):
            self._shown = (view.rgb, view.step)
            self._image.content = overlay_html(self._image_html(view))
        for action, button in self._buttons.items():
            relabel(button, self._label(action, view))
        show_giving_up(self._give_up, self._page.words, is_giving_up=view.is_giving_up)
        self._page.client.flush()

    def _show_sign(self, view: PanView) -> None:
        """Shows the request for a second press, a search that begins, that an object was marked, or that the last step
        was blocked, anew after each blocked step."""
        words = self._page.words
        if view.is_armed or view.is_giving_up:
            armed = words(_armed_key(view), keys=keys_of(_answer(view), words, self._page.own_keys))
            self._page.sign(armed if view.is_armed else words("give_up.armed"))
        elif view.is_just_marked:
            self._page.sign(words("pan.marked"), view.step, is_news=True)
        elif view.is_blocked:
            self._page.sign(words("pan.blocked"), view.step)
        else:
            self._page.sign("" if view.step or view.is_over else news_of(view, words), is_news=True)

    def _label(self, action: Action, view: PanView) -> str:
        is_last = action is Action.FOUND and view.is_just_marked
        words, own = self._page.words, self._page.own_keys
        return button_label(action, words, own, is_armed=view.is_armed, is_last=is_last)

    def _add_controls(self, view: PanView, send: Send) -> None:
        """Adds the keys, and a button for each of them."""
        page = self._page
        for action in view.task.actions:
            if action is not _answer(view):
                press = partial(send, Move(action, code=f"button-{action.value}"))
                self._buttons[action] = page.button(self._label(action, view), press)
        stop = partial(send, PressStop(code="button-stop"))
        with page.always_visible("bottom"):
            self._buttons[_answer(view)] = page.button(self._label(_answer(view), view), stop, color="red")
            self._give_up = page.button(page.words("give_up.button"), partial(send, GiveUp()), color="gray")
        for key, (code, action) in HOTKEYS.items():
            if action in view.task.actions:
                page.hotkey(key, f"{action.value} ({code})", partial(send, Move(action, code=code)))
        page.hotkey("enter", "stop (Enter)", partial(send, PressStop(code="Enter")))

    def _image_html(self, view: PanView) -> str:
        """The robot's view as an inline JPEG; empty while there is no picture."""
        if view.rgb is None:
            return ""
        data = base64.b64encode(self._encode(view.rgb)).decode()
        height, width = view.rgb.shape[:2]
        bump = ' class="personal-bump"' if view.is_blocked else ""
        most = round(self._display_scale * width)
        alt = html.escape(self._page.words("pan.picture"))
        return (
            f'<img alt="{alt}" data-step="{view.step}"{bump} '
            f'style="width:min(100%, calc(100vh * {width} / {height}));max-width:{most}px;height:auto" '
            f'src="data:image/jpeg;base64,{data}">'
        )


def button_label(
    action: Action,
    words: Catalogue,
    own_keys: Mapping[KeyAction, str],
    *,
    is_armed: bool = False,
    is_last: bool = False,
) -> str:
    """The label of a button, with the keys that do the same: the participant's own keys where there are some.

    Args:
        action: The button's action.
        words: The study's language.
        own_keys: `KeyboardEvent.code` by action.
        is_armed: Whether STOP or FOUND was pressed once.
        is_last: Whether FOUND ends a search for all.
    """
    is_answer = action in (Action.STOP, Action.FOUND)
    label = "pan.button" if not is_answer else "pan.press_again" if is_armed else "pan.twice"
    name = words("pan.found_last" if is_last else f"pan.{action.value}")
    return words(label, action=name, keys=keys_of(action, words, own_keys))


def keys_of(action: Action, words: Catalogue, own_keys: Mapping[KeyAction, str]) -> str:
    """The names of an action's keys: of the participant's own key where there is one."""
    own = own_keys.get(cast(KeyAction, action.value))
    return words(f"pan.{action.value}_keys") if own is None else key_name(own, words)


def key_name(code: str, words: Catalogue) -> str:
    """The name of a key by its `KeyboardEvent.code`."""
    return words.texts.get(f"key.{code}") or code.removeprefix("Key").removeprefix("Digit")


def _answer(view: PanView) -> Action:
    """The action that is the answer: STOP, or FOUND in a home sequence."""
    return Action.STOP if view.num_searches is None else Action.FOUND


def _armed_key(view: PanView) -> str:
    """The words that ask for the second press."""
    if view.num_searches is None:
        return "pan.armed"
    return "pan.armed_last" if view.is_just_marked else "pan.armed_mark" if view.is_for_all else "pan.armed_found"


def _status_html(caption: str, view: PanView, words: Catalogue) -> str:
    """Trial, steps and time left as HTML, always two lines; they are read aloud when they change."""
    step = html.escape(words("pan.step", step=view.step, all=view.task.max_steps))
    left = ""
    if view.left_s is not None:
        left = f" &middot; {html.escape(words('pan.left_time', time=words.duration(view.left_s)))}"
    return (
        f'<div class="personal-caption">{caption}</div>'
        f'<div role="status" aria-live="polite" class="personal-text personal-line"><b>{step}</b>{left}</div>'
    )
