"""Parts of the annotators' panels, and their HTML; what can be clicked has `data-click`, which `ObjectList` hears."""

import base64
import html
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import viser
from numpy.typing import NDArray

from sim.render.renderer import jpeg_bytes
from sim.words.english import how_many

from ..browse.messages import Words
from ..browse.panels import open_channel
from ..view.stage import WorkQueue, panel_html
from .session import Row

LIST_WIDTH = 340
"""Pixels of the left panel."""
MOST_ROWS = 200
"""A longer list is cut; the search finds the rest."""
_STYLE = (
    "<style>.bw.an .row{display:flex;gap:.5em;align-items:baseline}.bw.an .row .dim{flex:1;overflow:hidden;"
    "text-overflow:ellipsis;white-space:nowrap}.bw.an .row .tag{white-space:nowrap}"
    ".tag.complete,.tag.kept,.tag.changed{background:var(--personal-good-soft)!important}"
    ".tag.unsaved,.tag.flagged{background:var(--personal-warn-soft)!important}"
    ".bw .grid{display:grid;grid-template-columns:1fr 1fr;gap:4px}.bw .grid img{width:100%;display:block}"
    ".bw .said{background:var(--personal-good-soft);border:1px solid var(--personal-good);"
    "border-radius:6px;padding:.3em .6em}"
    ".bw .old{font-size:15px}.bw .word{margin:0 .3em .3em 0}</style>"
)
"""Sent with the list, which every app has."""


class Notice:
    """A line on what was done, or what is wrong."""

    def __init__(self, gui: viser.GuiApi, line: str = "") -> None:
        """Puts the line where the panel is now."""
        self._html = gui.add_html("")
        self.say(line)

    def say(self, line: str) -> None:
        """What was done, or what to do next; empty = nothing."""
        self._show(line, "said")

    def warn(self, line: str) -> None:
        """What is wrong."""
        self._show(line, "warn")

    def _show(self, line: str, kind: str) -> None:
        self._html.content = panel_html(f'<p class="{kind} notice">{html.escape(line)}</p>') if line else ""


class ObjectList:
    """The left panel: a search over the list of objects."""

    def __init__(self, client: viser.ClientHandle, work: WorkQueue, obey: Callable[[Words], None]) -> None:
        """Builds the panel, empty; `obey` hears what is clicked in our HTML: a row says `object ID`."""
        open_channel(client, lambda words: work.put(partial(obey, words)))
        panel = client.gui.add_panel()
        with panel.add_tab("Objects"):
            self._search = client.gui.add_text("Search", "", hint="Number, category, caption, room or state.")
            self._list = client.gui.add_html("")
        panel.dock_left()
        panel.set_width(LIST_WIDTH)

    @property
    def words(self) -> str:
        """What a person searches for."""
        return self._search.value

    def listen_to_search(self, work: WorkQueue, obey: Callable[[], None]) -> None:
        """Calls `obey` when a person searches."""
        work.listen_to_change(self._search, obey)

    def show(self, rows: Sequence[Row], *, here: int | None, total: int) -> None:
        """Lists the objects that were found; `here` is the selected one."""
        self._list.content = list_html(rows, here=here, total=total)


def list_html(rows: Sequence[Row], *, here: int | None, total: int) -> str:
    """The list of objects; a click on a row says `object ID`."""
    parts = []
    for row in rows[:MOST_ROWS]:
        mark = " here" if row.id == here else ""
        parts.append(
            f'<div class="row{mark}" data-click="object {row.id}"><b>{row.id} {html.escape(row.category)}</b>'
            f'<span class="dim">{html.escape(row.words)}</span><span class="tag {row.state}">{row.state}</span></div>'
        )
    found = how_many(len(rows), "object")
    count = found if len(rows) == total else f"{len(rows)} of {how_many(total, 'object')}"
    more = f"; the first {MOST_ROWS} are listed, search for the others" if len(rows) > MOST_ROWS else ""
    done = sum(row.state in ("complete", "kept", "changed") for row in rows)
    into_view = (
        "const here=this.parentElement.querySelector('.row.here');if(here)here.scrollIntoView({block:'nearest'})"
    )
    return (
        f'{_STYLE}<div class="bw an"><p class="count">{count}, {done} done{more}</p><div class="rows">'
        f'{"".join(parts)}<img src="data:," alt="" style="display:none" onerror="{into_view}"></div></div>'
    )


def words_html(kind: str, words: Sequence[str]) -> str:
    """Words to click instead of typing them; a click says `KIND WORD`."""
    buttons = "".join(
        f'<button class="word" data-click="{kind} {html.escape(word)}">{html.escape(word)}</button>' for word in words
    )
    return panel_html(buttons) if buttons else ""


def pictures_html(pictures: Sequence[NDArray[np.uint8]], *, note: str) -> str:
    """Pictures (H, W, 3) in two columns, with a line below them."""
    images = "".join(
        f'<img src="data:image/jpeg;base64,{base64.b64encode(jpeg_bytes(rgb)).decode()}" alt="The object">'
        for rgb in pictures
    )
    return panel_html(f'<div class="grid">{images}</div><p class="dim">{html.escape(note)}</p>')
