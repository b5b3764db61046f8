"""The PAN screen: the robot's present view, texts, step counter, buttons, keys. No mesh and no goal in the browser."""

import base64
import html
from collections.abc import Awaitable, Callable, Mapping

import numpy as np
import viser
from numpy.typing import NDArray

from human_study.commands import GiveUp, Move, PanCommand, PressStop
from human_study.views import PanView
from sim.types import Action

from .frames import jpeg_bytes
from .page_script import KeyAction
from .panels import Page, overlay_html

BUTTON_LABELS = {
    Action.FORWARD: ("Forward", "W or Up"),
    Action.LEFT: ("Turn left", "A or Left"),
    Action.RIGHT: ("Turn right", "D or Right"),
    Action.LOOK_UP: ("Look up", "R"),
    Action.LOOK_DOWN: ("Look down", "F"),
    Action.STOP: ("STOP here", "Enter"),
}
"""What a button says and which keys do the same."""
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
"""viser's key names to (code that is logged, action); DESIGN.md, keys."""
STOP_ARMED = "Press Enter or STOP again to finish"
GIVING_UP = "Press Give up again to end this search"
Send = Callable[[PanCommand], Awaitable[None]]
Encode = Callable[[NDArray[np.uint8]], bytes]


class PanApp:
    """Draws one PAN trial on a page and turns presses into commands."""

    def __init__(
        self,
        page: Page,
        view: PanView,
        send: Send,
        *,
        scene_label: str,
        progress: str,
        display_scale: float = 2.0,
        encode: Encode = jpeg_bytes,
        own_keys: Callable[[], Mapping[KeyAction, str]] = dict,
    ) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: What to show first.
            send: Where commands go.
            scene_label: What kind of home it is (schematic and invented homes say so), without its name.
            progress: "Trial 1 of 6".
            display_scale: The picture fills the window up to this many times its size.
            encode: A picture as JPEG; `Frames.jpeg` remembers.
            own_keys: Action to `KeyboardEvent.code` where the participant chose other keys; may change meanwhile.
        """
        self._page, self._encode, self._display_scale = page, encode, display_scale
        self._own_keys = own_keys
        self._buttons: dict[Action, viser.GuiButtonHandle] = {}
        page.clear()
        self._caption = f"{html.escape(progress)} &middot; {html.escape(scene_label)}"
        with page.client.atomic():
            self._status_html = _status_html(self._caption, view)
            self._status = page.client.gui.add_html(self._status_html)
            page.add(self._status)
            page.task_texts(view.task)
            self._image = page.overlay(self._image_html(view))
            self._shown = (view.rgb, view.step)
            self._add_controls(view, send)
        page.client.flush()

    def show(self, view: PanView) -> None:
        """Draws what has changed, picture or texts; on its way to the browser when this returns.

        A view without a picture leaves the last one there.
        """
        status = _status_html(self._caption, view)
        if status != self._status_html:
            self._status_html = self._status.content = status
        if view.rgb is not None and (view.rgb is not self._shown[0] or view.step != self._shown[1]):
            self._shown = (view.rgb, view.step)
            self._image.content = overlay_html(self._image_html(view))
        for action, button in self._buttons.items():
            label = button_label(action, self._own_keys())
            if button.label != label:
                button.label = label
        self._page.client.flush()

    def _add_controls(self, view: PanView, send: Send) -> None:
        """A button for every key, and the keys."""
        page = self._page
        for action in view.task.actions:
            if action is not Action.STOP:
                press = _sender(send, Move(action, code=f"button-{action.value}"))
                self._buttons[action] = page.button(button_label(action, self._own_keys()), press)
        stop = _sender(send, PressStop(code="button-stop"))
        self._buttons[Action.STOP] = page.button(button_label(Action.STOP, self._own_keys()), stop, color="red")
        page.button("Give up this search", _sender(send, GiveUp()), color="gray")
        for key, (code, action) in HOTKEYS.items():
            if action in view.task.actions:
                page.hotkey(key, f"{action.value} ({code})", _sender(send, Move(action, code=code)))
        page.hotkey("enter", "stop (Enter)", _sender(send, PressStop(code="Enter")))

    def _image_html(self, view: PanView) -> str:
        """The robot's view as an inline JPEG; empty while there is none."""
        if view.rgb is None:
            return ""
        data = base64.b64encode(self._encode(view.rgb)).decode()
        height, width = view.rgb.shape[:2]
        return (
            f'<img alt="What the robot sees" data-step="{view.step}" style="width:min(100%, calc(100vh * {width} / '
            f'{height}));max-width:{round(self._display_scale * width)}px;height:auto" '
            f'src="data:image/jpeg;base64,{data}">'
        )


def button_label(action: Action, own_keys: Mapping[KeyAction, str]) -> str:
    """What a button says, with the keys that do the same: the participant's own where there are some."""
    text, keys = BUTTON_LABELS[action]
    own = own_keys.get(action.value)
    if own is not None:
        keys = own.removeprefix("Key").removeprefix("Digit").removeprefix("Arrow")
    return f"{text} ({keys}{' twice' if action is Action.STOP else ''})"


def _sender(send: Send, command: PanCommand) -> Callable[[], Awaitable[None]]:
    async def press() -> None:
        await send(command)

    return press


def _status_html(caption: str, view: PanView) -> str:
    """Trial, steps, time left, and what another press would end; read aloud when it changes."""
    notice = STOP_ARMED if view.is_armed else GIVING_UP if view.is_giving_up else ""
    left = "" if view.left_s is None else f" &middot; {_duration(view.left_s)} left"
    marked = (
        f'<span style="background:#8f1d17;color:#fff;padding:.1em .5em;border-radius:4px">{notice}</span>'
        if notice
        else "&nbsp;"
    )
    return (
        f'<div style="padding:.6em .65rem 0;font-size:14px;color:#57606a">{caption}</div>'
        f'<div role="status" aria-live="polite" class="personal-text" style="padding:.2em .65rem">'
        f"<b>Step {view.step} of {view.task.max_steps}</b>{left} {marked}</div>"
    )


def _duration(left_s: int) -> str:
    return f"{left_s // 60} min" if left_s >= 60 and left_s % 60 == 0 else f"{left_s} s"
