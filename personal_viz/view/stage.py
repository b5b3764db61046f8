"""One browser at a scan: its work in order, and the storey that it shows. `view` and `annotate` build on it."""

import html
import json
import queue
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import viser

from sim.errors import PersonalVizError

from ..browse.layers import remove_nodes
from ..browse.panel_html import style_html
from ..study_app.home.looks import FirstLook, look_from_above
from .shown import Part, Point, ShownScan

Ray = tuple[Point, Point]
"""Origin and direction of a click, world metres."""
_KEYS = Path(__file__).with_name("keys.js")


class WorkQueue:
    """Work of one browser. viser's callbacks only put work on the queue; one thread does it in order."""

    def __init__(self, client: viser.ClientHandle, on_bug: Callable[[str], None]) -> None:
        """Starts the thread; `on_bug` shows a line of warning."""
        self._client, self._on_bug = client, on_bug
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._obey, name=f"browser {client.client_id}", daemon=True).start()

    def put(self, work: Callable[[], None]) -> None:
        """Never waits."""
        self._work.put(work)

    def end(self) -> None:
        """The browser is gone."""
        self._work.put(None)

    def listen(self, widget: Any, obey: Callable[[str], None]) -> None:
        """Calls `obey` with the widget's value at each click."""

        @widget.on_click
        async def _(event: viser.GuiEvent) -> None:
            self.put(partial(obey, str(event.target.value)))

    def listen_to_change(self, widget: Any, obey: Callable[[], None]) -> None:
        """Calls `obey` each time a person, not the program, has changed the widget's value."""

        @widget.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self.put(obey)

    def listen_to_key(self, label: str, key: str, obey: Callable[[], None]) -> None:
        """Calls `obey` at each press of a key outside text fields."""
        command = self._client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]

        @command.on_trigger
        async def _(_: object) -> None:
            self.put(obey)

    def _obey(self) -> None:
        """Does the work in order: what is wrong in one piece is shown, and the next piece is done."""
        while (work := self._work.get()) is not None:
            try:
                work()
            except PersonalVizError as error:
                self._on_bug(str(error))
            except Exception:
                traceback.print_exc(file=sys.stderr)
                self._on_bug("A bug: see the terminal.")
            self._client.flush()


class StoreyView:
    """The storeys of a scan in one browser's 3-D view, one at a time."""

    def __init__(self, client: viser.ClientHandle, shown: ShownScan, work: WorkQueue) -> None:
        """Shows nothing yet; what the browser does is put on `work`."""
        self._client, self._shown, self._work = client, shown, work
        self._home: list[Any] = []
        self._first_look: FirstLook | None = None
        self.index = 0
        client.scene.configure_default_lights(True, cast_shadow=False)

        @client.camera.on_update
        async def _(_: viser.CameraHandle) -> None:
            work.put(self._camera_moved)

    @property
    def part(self) -> Part:
        """What is shown."""
        return self._shown.parts[self.index]

    def show(self, index: int, *, look: bool = True) -> None:
        """Shows one storey, from above if `look`."""
        self.index = index
        remove_nodes(self._home)
        self._home = [self._client.scene.add_glb("/scan", self.part.glb)]
        self._first_look = FirstLook(self._client.camera, self._look) if look else None

    def add_buttons(self, obey: Callable[[int], None]) -> None:
        """A button for each of several storeys."""
        if len(self._shown.parts) > 1:
            storeys = {f"Storey {index + 1}": index for index in range(len(self._shown.parts))}
            buttons = self._client.gui.add_button_group("Storey", tuple(storeys))
            self._work.listen(buttons, lambda name: obey(storeys.get(name, 0)))

    def listen_to_clicks(self, obey: Callable[[Point, Ray], None]) -> None:
        """Calls `obey` with the place that a click meets, and the click's ray."""

        def clicked(ray: Ray) -> None:
            point = self._shown.hit(self.index, *ray)
            if point is not None:
                obey(point, ray)

        async def put(event: viser.SceneClickEvent) -> None:
            self._work.put(partial(clicked, (event.ray_origin, event.ray_direction)))

        self._client.scene.on_click()(put)  # type: ignore[arg-type]  # viser awaits it

    def _look(self) -> None:
        part = self.part
        low, high = np.insert(part.low_xz, 1, part.floor_y), np.insert(part.high_xz, 1, part.top_y)
        look_from_above(self._client.camera, low, high)

    def _camera_moved(self) -> None:
        if self._first_look is not None:
            self._first_look.renew()


def open_panel(gui: viser.GuiApi, name: str, width: int) -> None:
    """Puts the main panel on the right side, in the look of all panels of researchers."""
    gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
    gui.set_panel_label(name)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(width)
    gui.add_html(style_html())


def free_keys(gui: viser.GuiApi, fields: Mapping[str, str] = MappingProxyType({}), saving: Sequence[str] = ()) -> None:
    """Makes keys work once per press and outside text fields, without moving viser's camera, which listens too.

    Args:
        fields: Label of the text field that a key leads to, by the key in lower case. Enter and Escape leave a field.
        saving: Labels of fields from which Enter also presses S.
    """
    script = _KEYS.read_text(encoding="utf-8")
    for name, value in (("FIELDS", dict(fields)), ("SAVING", list(saving))):
        script = script.replace(name, json.dumps(value))
    script = html.escape(script)
    gui.add_html(f'<img src="data:," style="display:none" alt="" onerror="{script}">')


def panel_html(content: str) -> str:
    """Content of a panel in its style."""
    return f'<div class="bw">{content}</div>'
