"""The parts of the annotators' panels as HTML; what can be clicked has `data-click`, of which `open_channel` tells."""

import base64
import html
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.render.renderer import jpeg_bytes
from sim.words.english import how_many

from ..view.stage import panel_html
from .session import Row

MOST_ROWS = 200
"""A longer list is cut; the search finds the rest."""
_STYLE = (
    "<style>.bw.an .row{display:flex;gap:.5em;align-items:baseline}.bw.an .row .dim{flex:1;overflow:hidden;"
    "text-overflow:ellipsis;white-space:nowrap}.bw.an .row .tag{white-space:nowrap}"
    ".tag.complete,.tag.kept,.tag.changed{background:#d5f0e0!important}.tag.unsaved,.tag.flagged{background:#ffe3b3!important}"
    ".bw .grid{display:grid;grid-template-columns:1fr 1fr;gap:4px}.bw .grid img{width:100%;display:block}"
    ".bw .said{background:#e3f4ea;border:1px solid #9bd0b1;border-radius:6px;padding:.3em .6em}"
    ".bw .old{font-size:15px}.bw .word{margin:0 .3em .3em 0}</style>"
)
"""Sent with the list, which every app has."""


def notice(text: str, *, is_warning: bool = False) -> str:
    """A line on what was done, or what is wrong."""
    return panel_html(f'<p class="{"warn" if is_warning else "said"} notice">{html.escape(text)}</p>') if text else ""


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
