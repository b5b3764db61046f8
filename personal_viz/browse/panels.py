"""The panels of `personal-viz browse`: the list left, the episode right, a walk along a run in the corner.

Nothing is computed here: each widget puts a message on the visitor's queue, and the visitor fills the panels.

viser reports nothing about its HTML elements, but it reports changes of text inputs. So the script `channel.js` listens
for the mouse on elements with `data-hover` and `data-click`, and types into a hidden input, at most ten messages a
second; clicks are never dropped. The script also marks graph nodes under the mouse at once, without waiting for the
server, and keeps the arrow keys that move a slider from turning viser's camera.
"""

import html
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, cast

import viser

from sim.types import SPLITS, Split

from .library import Wanted
from .messages import Message, Words
from .panel_html import style_html

LIST_WIDTH, EPISODE_WIDTH, WALK_WIDTH = 290, 470, 340
"""Pixels of the three panels."""
ALL = "all"
_FOR_RESEARCHERS = (
    '<div class="bw"><p class="warn"><b>For researchers: shows the goal.</b> Not for participants or agents.</p></div>'
)
Part = Literal["list", "head", "home", "story", "graph", "facts", "runs", "picture"]
"""Places for HTML; `home` is also for notices: that a home loads, or an error."""
_EPISODE_PARTS: tuple[Part, ...] = ("head", "home", "story", "graph", "facts", "runs")
"""From above."""
_KEYS: tuple[tuple[str, Literal["P", "N"], str], ...] = (("Previous episode", "P", "-1"), ("Next episode", "N", "1"))
_LABEL = "messages of this page"
"""Label by which the script finds its input, because viser sends no ids to scripts."""
_EVERY_MS = 100
_SCRIPT = Path(__file__).with_name("channel.js")
Put = Callable[[Message], None]


class Panels:
    """The widgets of one browser."""

    def __init__(self, client: viser.ClientHandle, put: Put, *, scenes: Sequence[str], has_runs: bool) -> None:
        """Builds the panels.

        Args:
            put: Takes messages; called on viser's event loop, it must not wait.
            scenes: Choices of the filter.
        """
        self._client, self._put = client, put
        self._html: dict[Part, viser.GuiHtmlHandle] = {}
        gui = client.gui
        gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
        gui.set_panel_label("Episode")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(EPISODE_WIDTH)
        gui.add_html(style_html() + _FOR_RESEARCHERS)
        for part in _EPISODE_PARTS:
            self._html[part] = gui.add_html("")
        open_channel(client, put)
        episodes = gui.add_panel()
        with episodes.add_tab("Episodes"):
            self._build_list(scenes, has_runs)
        episodes.dock_left()
        episodes.set_width(LIST_WIDTH)
        self._walk = gui.add_panel(visible=False)
        with self._walk.add_tab("Along a run"):
            self._build_walk()
        self._walk.float(x=12, y=-12, width=WALK_WIDTH)
        for label, key, by in _KEYS:
            self._listen_to_key(label, key, by)

    def show(self, part: Part, content: str) -> None:
        """Shows a part's new HTML, made by `panel_html`."""
        self._html[part].content = content

    def show_walk(self, steps: int | None) -> None:
        """The slider along a run with this number of steps, at its start; None hides the panel."""
        self._walk.visible = steps is not None
        if steps is not None:
            with self._client.atomic():
                self._slider.value = 0
                self._slider.max = max(1, steps)

    def _build_list(self, scenes: Sequence[str], has_runs: bool) -> None:
        gui = self._client.gui
        split = gui.add_dropdown("Split", (ALL, *SPLITS))
        scene = gui.add_dropdown("Scene", (ALL, *scenes))
        words = gui.add_text("Search", "", hint="Words in the description, query, owner, object or episode key.")
        only = gui.add_checkbox("With runs", False, hint="Only episodes of which a run or an answer is given.")
        only.visible = has_runs
        self._html["list"] = gui.add_html("")

        async def changed(_: object) -> None:
            wanted = Wanted(
                split=None if split.value == ALL else cast(Split, split.value),
                scene=None if scene.value == ALL else scene.value,
                words=words.value,
                with_runs=only.value,
            )
            self._put(wanted)

        for widget in (split, scene, words, only):
            widget.on_update(changed)

    def _build_walk(self) -> None:
        gui = self._client.gui
        self._html["picture"] = gui.add_html("")
        self._slider = gui.add_slider("Step", 0, 1, 1, 0)

        @self._slider.on_update
        async def _(_: object) -> None:
            self._put(("slide", str(int(self._slider.value))))

    def _listen_to_key(self, label: str, key: Literal["P", "N"], by: str) -> None:
        command = self._client.gui.add_command(label, hotkey=key)

        @command.on_trigger
        async def _(_: object) -> None:
            self._put(("step", by))


def open_channel(client: viser.ClientHandle, put: Callable[[Words], None]) -> None:
    """Sends the script to the browser, and puts the words of its messages on the queue."""
    field = client.gui.add_text(_LABEL, "")

    @field.on_update
    async def _(_: object) -> None:
        put(tuple(field.value.split()[1:]))  # a number comes first, so that no two messages are equal

    script = _SCRIPT.read_text(encoding="utf-8").replace("LABEL", _LABEL).replace("EVERY", str(_EVERY_MS))
    client.gui.add_html(f'<img src="data:," style="display:none" alt="" onerror="{html.escape(script)}">')
