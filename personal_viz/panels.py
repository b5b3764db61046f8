"""Pieces of a participant's page that both tasks share: frame around the page, texts, buttons, full-screen notices."""

import html
from collections.abc import Awaitable, Callable
from typing import Any

import viser

from sim.types import Task

PANEL_WIDTH = 400
"""Pixels of the side panel with texts and buttons."""
_HIDE_VISER_CONTROLS = (
    '<style>button:has(svg[class*="icon-adjustments"]),button:has(svg[class*="icon-list-search"])'
    "{display:none !important} .mantine-Notification-root{display:none !important}</style>"
)
"""Scene tree, settings and viser's own notices (software rendering) are not for participants."""
_KEY_FILTER = (
    '<img src="data:," style="display:none" onerror="'
    "if(!window.personalKeys){window.personalKeys=true;"
    "window.addEventListener('keydown',e=>{if(e.repeat)e.stopImmediatePropagation()},true);"
    "document.documentElement.addEventListener('keydown',e=>{"
    "if(!e.target.closest('input,textarea'))e.stopPropagation()})}\">"
)
"""Drops auto-repeat of held keys, and keeps WASD and arrows from moving viser's camera (VIZ.md 1.4)."""
Press = Callable[[], Awaitable[None]]
CameraListener = Callable[[viser.CameraHandle], Awaitable[None]]


class Page:
    """One participant's page; `clear` empties it for the next screen."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Sets the page up once per connection."""
        self.client = client
        client.gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
        client.gui.set_panel_label("PersONAL study")
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(PANEL_WIDTH)
        self._handles: list[Any] = []
        self._on_camera: CameraListener | None = None
        client.camera.on_update(self._camera_moved)
        client.gui.add_html(_HIDE_VISER_CONTROLS + _KEY_FILTER)

    def clear(self) -> None:
        """Removes everything of the present screen."""
        for handle in self._handles:
            handle.remove()
        self._handles = []
        self._on_camera = None

    def add(self, handle: Any) -> None:
        """Keeps a handle (GUI element, command or scene node) until the next `clear`."""
        self._handles.append(handle)

    def button(self, label: str, press: Press, *, color: str | None = None, hint: str | None = None) -> None:
        """A button of the panel."""
        button = self.client.gui.add_button(label, color=color, hint=hint)  # type: ignore[arg-type]

        @button.on_click
        async def _(_: object) -> None:
            await press()

        self.add(button)

    def hotkey(self, key: str, label: str, press: Press) -> None:
        """A key that works wherever the focus is; a key press is one call, auto-repeat is filtered in the browser."""
        command = self.client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(_: object) -> None:
            await press()

        self.add(command)

    def listen_to_camera(self, listener: CameraListener) -> None:
        """Calls `listener` whenever the 3-D camera has moved, until the next `clear`."""
        self._on_camera = listener

    def task_texts(self, task: Task) -> None:
        """The query, then the paragraph; nothing else of the episode exists here."""
        query = html.escape(task.queries[0])
        description = html.escape(task.description)
        self.add(
            self.client.gui.add_html(
                f'<div style="padding:.6em .8em;font-size:16px;line-height:1.45">'
                f'<p style="font-size:20px;font-weight:600;margin:.2em 0 .6em">{query}</p>'
                f'<p style="margin:0">{description}</p></div>'
            )
        )

    def overlay(self, content: str) -> viser.GuiHtmlHandle:
        """A sheet over the 3-D canvas, which takes no mouse then; returns it so that its content can change."""
        handle = self.client.gui.add_html(overlay_html(content))
        self.add(handle)
        return handle

    def notice(self, title: str, text: str, *, button: tuple[str, Press] | None = None) -> None:
        """A full screen with one message and at most one button."""
        self.clear()
        body = "".join(f'<p style="margin:.8em 0">{html.escape(line)}</p>' for line in text.split("\n") if line)
        self.overlay(
            f'<div style="max-width:34rem;padding:2rem;background:#fff;color:#222;border-radius:12px;font-size:18px;'
            f'line-height:1.5"><h1 style="margin:0;font-size:24px">{html.escape(title)}</h1>{body}</div>'
        )
        if button is not None:
            self.button(*button)
        self.client.flush()

    async def _camera_moved(self, camera: viser.CameraHandle) -> None:
        if self._on_camera is not None:
            await self._on_camera(camera)


def overlay_html(content: str) -> str:
    """HTML that covers all but the side panel."""
    return (
        f'<div style="position:fixed;left:0;top:0;width:calc(100vw - {PANEL_WIDTH}px);height:100vh;z-index:1;'
        f'background:#2b2b2b;display:flex;align-items:center;justify-content:center">{content}</div>'
    )
