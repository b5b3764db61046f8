"""The PAN screen: the robot's present view, texts, step counter, buttons, keys. No mesh and no goal in the browser."""

import base64
import html
import io
from collections.abc import Awaitable, Callable

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from human_study.commands import GiveUp, Move, PanCommand, PressStop
from human_study.views import PanView
from sim.types import Action

from .panels import Page, overlay_html

JPEG_QUALITY = 80
BUTTON_LABELS = {
    Action.FORWARD: "Forward (W or Up)",
    Action.LEFT: "Turn left (A or Left)",
    Action.RIGHT: "Turn right (D or Right)",
    Action.LOOK_UP: "Look up (R)",
    Action.LOOK_DOWN: "Look down (F)",
}
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
Send = Callable[[PanCommand], Awaitable[None]]


class PanApp:
    """Draws one PAN trial on a page and turns presses into commands."""

    def __init__(self, page: Page, view: PanView, send: Send, *, scene_label: str, progress: str) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: What to show first.
            send: Where commands go.
            scene_label: How the home must be called (schematic and invented homes say so).
            progress: "Trial 1 of 6".
        """
        self._page = page
        page.clear()
        self._status = page.client.gui.add_html("")
        page.add(self._status)
        page.task_texts(view.task)
        self._image = page.overlay("")
        self._caption = f"{html.escape(progress)} &middot; {html.escape(scene_label)}"
        for action in view.task.actions:
            if action is not Action.STOP:
                page.button(BUTTON_LABELS[action], _sender(send, Move(action, code=f"button-{action.value}")))
        page.button("STOP here (Enter twice)", _sender(send, PressStop(code="button-stop")), color="red")
        page.button("Give up this search", _sender(send, GiveUp()), color="gray")
        for key, (code, action) in HOTKEYS.items():
            if action in view.task.actions:
                page.hotkey(key, f"{action.value} ({code})", _sender(send, Move(action, code=code)))
        page.hotkey("enter", "stop (Enter)", _sender(send, PressStop(code="Enter")))
        self.show(view)

    def show(self, view: PanView) -> None:
        """Draws the robot's view and the counter; on its way to the browser when this returns."""
        self._status.content = _status_html(self._caption, view)
        if view.rgb is not None:
            self._image.content = overlay_html(_image_html(view.rgb, view.step))
        self._page.client.flush()


def _sender(send: Send, command: PanCommand) -> Callable[[], Awaitable[None]]:
    async def press() -> None:
        await send(command)

    return press


def _status_html(caption: str, view: PanView) -> str:
    armed = (
        '<span style="background:#b00020;color:#fff;padding:.1em .5em;border-radius:4px">'
        "Press Enter or STOP again to finish</span>"
        if view.is_armed
        else "&nbsp;"
    )
    return (
        f'<div style="padding:.6em .8em 0;font-size:14px;color:#555">{caption}</div>'
        f'<div style="padding:.2em .8em;font-size:16px"><b>Step {view.step} of {view.task.max_steps}</b> {armed}</div>'
    )


def _image_html(rgb: NDArray[np.uint8], step: int) -> str:
    """The robot's view as an inline JPEG; (H, W, 3) in."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=JPEG_QUALITY)
    data = base64.b64encode(buffer.getvalue()).decode()
    height, width = rgb.shape[:2]
    return (
        f'<img alt="What the robot sees" data-step="{step}" src="data:image/jpeg;base64,{data}" '
        f'style="width:min(100%, calc(100vh * {width} / {height}));max-width:{2 * width}px;height:auto">'
    )
