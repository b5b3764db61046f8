"""The POG screen: texts beside the 3-D home, storey buttons, a mark that follows clicks, confirm. No feedback."""

import asyncio
import html
from collections.abc import Awaitable, Callable

import viser

from human_study.commands import Confirm, GiveUp, LookFrom, PogCommand, ShowStorey
from human_study.session import CAMERA_EVERY_S
from human_study.views import PogView
from sim.tasks.run_files import ClickRay

from .panels import Page
from .scene_view import SceneView, StoreyCopies

SAMPLE_EVERY_S = 1.1 * CAMERA_EVERY_S
"""A little more than the session's limit, so that it keeps every sample."""
Send = Callable[[PogCommand | ClickRay], Awaitable[None]]


class PogApp:
    """Draws one POG trial on a page and turns clicks into rays and commands."""

    def __init__(self, page: Page, view: PogView, send: Send, *, copies: StoreyCopies, progress: str) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: What to show first.
            send: Where commands go, and the rays of clicks.
            copies: Browser copies of the home.
            progress: "Trial 1 of 6".
        """
        self._page, self._send = page, send
        self._shown = view
        self._looked_from: LookFrom | None = None
        self._is_sampling = False
        page.clear()
        self._scene_view = SceneView(page.client, copies)
        self._status = page.client.gui.add_html("")
        page.add(self._status)
        self._caption = f"{html.escape(progress)} &middot; {html.escape(copies.scene.label)}"
        page.task_texts(view.task)
        if len(view.storeys) > 1:
            for index in range(len(view.storeys)):
                page.button(f"Show storey {index + 1} of {len(view.storeys)}", self._sender(ShowStorey(index)))
        page.button("Confirm the mark", self._sender(Confirm()), color="green")
        page.button("Give up this search", self._sender(GiveUp()), color="gray")
        page.client.scene.on_click()(self._on_click)  # type: ignore[arg-type]  # viser awaits it
        page.listen_to_camera(self._on_camera)
        self._scene_view.show_storey(view.storey)
        if view.marker is not None:
            self._scene_view.show_mark(view.marker)
        self._draw_status()

    def show(self, view: PogView) -> None:
        """Draws what has changed."""
        before, self._shown = self._shown, view
        if view.storey != before.storey:
            self._scene_view.show_storey(view.storey)
        if view.marker is not None and (view.marker, view.storey) != (before.marker, before.storey):
            self._scene_view.show_mark(view.marker)
        if (view.marker is None) != (before.marker is None):
            self._draw_status()

    def close(self) -> None:
        """Takes the home out of the browser and stops listening to clicks; `Page.clear` ends the rest."""
        self._page.client.scene.remove_click_callback(self._on_click)
        self._scene_view.remove()

    def _draw_status(self) -> None:
        advice = (
            "Drag to turn, scroll to zoom, right-drag to move. Click the object to mark it."
            if self._shown.marker is None
            else "Click again to move your mark, or confirm it."
        )
        self._status.content = (
            f'<div style="padding:.6em .8em 0;font-size:14px;color:#555">{self._caption}</div>'
            f'<div style="padding:.2em .8em;font-size:16px"><b>{advice}</b></div>'
        )
        self._page.client.flush()

    async def _on_click(self, event: viser.SceneClickEvent) -> None:
        camera = event.client.camera
        ray = ClickRay(
            origin=_three(event.ray_origin),
            direction=_three(event.ray_direction),
            camera_position=_three(camera.position),
            camera_wxyz=_four(camera.wxyz),
            storey_y=self._shown.storeys[self._shown.storey],
        )
        await self._send(ray)

    async def _on_camera(self, camera: viser.CameraHandle) -> None:
        """Samples the camera while it moves; the pose in which it comes to rest is always among the samples."""
        self._looked_from = LookFrom(_three(camera.position), _four(camera.wxyz))
        if self._is_sampling:
            return
        self._is_sampling = True
        sent = None
        while self._looked_from != sent:
            sent = self._looked_from
            await self._send(sent)
            await asyncio.sleep(SAMPLE_EVERY_S)
        self._is_sampling = False

    def _sender(self, command: PogCommand) -> Callable[[], Awaitable[None]]:
        async def press() -> None:
            await self._send(command)

        return press


def _three(values) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


def _four(values) -> tuple[float, float, float, float]:
    w, x, y, z = (float(value) for value in values)
    return (w, x, y, z)
