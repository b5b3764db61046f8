"""The POG screen: texts beside the 3-D home, storey buttons, a mark that follows clicks, confirm. No feedback."""

import asyncio
import html
from collections.abc import Awaitable, Callable

import viser

from human_study.commands import Click, Confirm, GiveUp, LookFrom, PogCommand, ShowStorey
from human_study.session import CAMERA_EVERY_S
from human_study.views import PogView
from sim.tasks.pog import PogScene
from sim.tasks.run_files import ClickRay

from .panels import Page
from .scene_view import SceneView, StoreyCopies

SAMPLE_EVERY_S = 1.1 * CAMERA_EVERY_S
"""A little more than the session's limit, so that it keeps every sample."""
Send = Callable[[PogCommand], Awaitable[None]]


class PogApp:
    """Draws one POG trial on a page and turns clicks into commands."""

    def __init__(
        self,
        page: Page,
        view: PogView,
        send: Send,
        *,
        copies: StoreyCopies,
        pog_scene: PogScene,
        progress: str,
    ) -> None:
        """Builds the screen.

        Args:
            page: The participant's page.
            view: What to show first.
            send: Where commands go.
            copies: Browser copies of the home.
            pog_scene: The same storeys, for intersecting clicks.
            progress: "Trial 1 of 6".
        """
        self._page, self._send, self._pog_scene = page, send, pog_scene
        self._shown = view
        self._looked_from: LookFrom | None = None
        self._is_sampling = False
        self._is_closed = False
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
        page.client.camera.on_update(self._on_camera)
        self._scene_view.show_storey(view.storey)
        self.show(view)

    def show(self, view: PogView) -> None:
        """Draws storey and mark."""
        if view.storey != self._shown.storey:
            self._scene_view.show_storey(view.storey)
        if view.marker is not None:
            self._scene_view.show_mark(view.marker)
        self._shown = view
        advice = (
            "Drag to turn, scroll to zoom, right-drag to move. Click the object to mark it."
            if view.marker is None
            else "Click again to move your mark, or confirm it."
        )
        self._status.content = (
            f'<div style="padding:.6em .8em 0;font-size:14px;color:#555">{self._caption}</div>'
            f'<div style="padding:.2em .8em;font-size:16px"><b>{advice}</b></div>'
        )
        self._page.client.flush()

    def close(self) -> None:
        """Takes the home out of the browser and stops listening to clicks and camera."""
        self._is_closed = True
        self._page.client.scene.remove_click_callback()
        self._scene_view.remove()

    async def _on_click(self, event: viser.SceneClickEvent) -> None:
        camera = event.client.camera
        ray = ClickRay(
            origin=_three(event.ray_origin),
            direction=_three(event.ray_direction),
            camera_position=_three(camera.position),
            camera_wxyz=_four(camera.wxyz),
            storey_y=self._shown.storeys[self._shown.storey],
        )
        hit = self._pog_scene.hit(self._shown.storey, ray.origin, ray.direction)
        await self._send(Click(ray, hit))

    async def _on_camera(self, camera: viser.CameraHandle) -> None:
        """Samples the camera while it moves; the pose in which it comes to rest is always among the samples."""
        self._looked_from = LookFrom(_three(camera.position), _four(camera.wxyz))
        if self._is_sampling:
            return
        self._is_sampling = True
        sent = None
        while self._looked_from != sent and not self._is_closed:
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
