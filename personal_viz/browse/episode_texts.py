"""An episode, its runs and the list as HTML for the panels. Pure; everything that comes from files is escaped."""

import base64
import html
import re
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from sim.episodes.ownership import OwnershipGraph
from sim.episodes.schema import Episode
from sim.render.renderer import jpeg_bytes
from sim.tasks.run_files import Answer, EpisodeRun

from .catalogue import Catalogue, ListPage
from .graph_svg import color_of_person
from .shown import LayerChoice, Shown

STYLE = """
<style>
.bw{font-family:system-ui,sans-serif;font-size:13.5px;line-height:1.45;color:#222;padding:.35em .8em}
.bw h2{font-size:19px;margin:.1em 0 .3em}
.bw p{margin:.35em 0}
.bw .dim{color:#666;font-size:12.5px}
.bw table{border-collapse:collapse;width:100%;font-size:12.5px}
.bw td,.bw th{padding:.2em .4em;text-align:left;border-bottom:1px solid #e6e8ec;vertical-align:top}
.bw th{font-weight:600;color:#555}
.bw td.n,.bw th.n{text-align:right;font-variant-numeric:tabular-nums}
.bw .rows{max-height:calc(100vh - 305px);min-height:120px;overflow-y:auto;border:1px solid #dfe2e7;border-radius:6px}
.bw .row{padding:.28em .55em;border-bottom:1px solid #eef0f3;cursor:pointer}
.bw .row:hover{background:#eef4fb}
.bw .row.here{background:#ffe9a8}
.bw .row b{font-weight:600}
.bw .tag{border-radius:4px;padding:0 .4em;font-size:11.5px;background:#e8ebf0;color:#333}
.bw .yes{color:#18794e;font-weight:600}.bw .no{color:#b42318;font-weight:600}
.bw .dot{display:inline-block;width:.8em;height:.8em;border-radius:50%;vertical-align:-.05em}
.bw .warn{background:#fff4d6;border:1px solid #e8c66a;border-radius:6px;padding:.3em .6em;font-size:12.5px}
.bw button{font:inherit;border:1px solid #c9ced6;background:#fff;border-radius:5px;padding:.1em .7em;cursor:pointer}
.bw button:disabled{opacity:.4;cursor:default}
.bw button.here{background:#ffe9a8;border-color:#a86b00}
.bw label{cursor:pointer;margin-right:1em}
.bw label input{vertical-align:-.15em}
.bw .fixed,.bw th,.bw .key{white-space:nowrap}
.bw .key{overflow:hidden;text-overflow:ellipsis}
.bw .bar{display:flex;justify-content:space-between;align-items:center;gap:.6em}
</style>
"""
"""For every panel; sent once."""
_LAYERS = (
    ("view_points", "view points", "Darts where the target can be seen from: larger and darker with iou, grey: extra."),
    ("region", "success region", "Places where STOP succeeds under rule paper."),
    ("names", "all names", "Categories of all objects of the storey."),
)
"""Fields of LayerChoice with what is written beside their boxes."""


_SCROLL = (
    '<img src="data:," alt="" style="display:none" onerror="const here=this.parentElement.querySelector(\'.row.here\');'
    "if(here)here.scrollIntoView({block:'nearest'})\">"
)
"""Brings the shown episode into view when the list has been drawn again."""


def list_html(catalogue: Catalogue, page: ListPage, here: int) -> str:
    """One page of the list, with buttons to turn it.

    Args:
        catalogue: All episodes.
        page: What to list.
        here: Number of the episode that is shown.
    """
    if not page.total:
        return '<div class="bw"><p>No episode matches. Take a word or a choice back.</p></div>'
    rows = "".join(_row(catalogue, number, is_here=number == here) for number in page.numbers)
    last = page.first + len(page.numbers)
    before = "" if page.first > 0 else " disabled"
    after = "" if last < page.total else " disabled"
    turn = (
        f'<button data-click="page -1"{before} aria-label="Earlier episodes">&#8249;</button> '
        f'<button data-click="page 1"{after} aria-label="Later episodes">&#8250;</button>'
        if page.total > len(page.numbers)
        else ""
    )
    return (
        f'<div class="bw"><p class="bar">'
        f'<span class="count">{page.first + 1}&#8211;{last} of {page.total:,} episodes</span><span>{turn}</span></p>'
        f'<div class="rows">{rows}</div>{_SCROLL}</div>'
    )


def head_html(episode: Episode, *, place: int | None, total: int) -> str:
    """Query and key of the shown episode, with buttons to its neighbours.

    Args:
        episode: What is shown.
        place: Its place in the filtered list, from 0; None = the filter hides it.
        total: Length of that list.
    """
    where = "not in the list" if place is None else f"{place + 1} of {total:,}"
    before = " disabled" if not total or place == 0 else ""
    after = " disabled" if not total or place == total - 1 else ""
    return (
        f'<div class="bw episode" data-key="{html.escape(str(episode.key), quote=True)}">'
        f'<p class="bar"><span class="dim key">{html.escape(str(episode.key))}</span>'
        f'<span class="fixed"><button data-click="step -1"{before} title="Key P">&#9664; previous</button> '
        f'<span class="dim">{where}</span> <button data-click="step 1"{after} title="Key N">next &#9654;</button>'
        f"</span></p><h2>{html.escape(episode.record.query[0])}</h2></div>"
    )


def home_html(label: str, *, storeys: int, storey: int, choice: LayerChoice) -> str:
    """What the home is called, buttons for its storeys, check boxes for the layers.

    Args:
        label: Of the scene.
        storeys: How many it has.
        storey: Which one is shown.
        choice: Layers that are switched on.
    """
    buttons = "".join(
        f'<button data-click="storey {index}"{" class=here" if index == storey else ""}>storey {index + 1}</button> '
        for index in range(storeys if storeys > 1 else 0)
    )
    boxes = "".join(
        f'<label title="{title}"><input type="checkbox" data-click="layer {name}"'
        f"{' checked' if getattr(choice, name) else ''}> {text}</label> "
        for name, text, title in _LAYERS
    )
    return (
        f'<div class="bw home"><p class="bar"><span class="dim">{html.escape(label)}</span><span>{buttons}</span></p>'
        f'<p class="layers">{boxes}</p></div>'
    )


def notice_html(text: str, *, is_warning: bool = False) -> str:
    """One paragraph."""
    return f'<div class="bw"><p{" class=warn" if is_warning else ""}>{html.escape(text)}</p></div>'


def story_html(episode: Episode, graph: OwnershipGraph) -> str:
    """The paragraph with its names in the graph's colours."""
    return f'<div class="bw"><p class="story">{_with_names(episode, graph)}</p></div>'


def facts_html(episode: Episode) -> str:
    """What is known about the target, its captions among it."""
    facts = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in _facts(episode))
    return f'<div class="bw"><table>{facts}</table></div>'


def runs_html(shown: Sequence[Shown], *, hidden: Collection[str], walked: str | None, notes: Sequence[str] = ()) -> str:
    """Runs and answers of the episode as tables with check boxes.

    Args:
        shown: Of the episode.
        hidden: Labels of those whose path or points are not drawn.
        walked: Label of the run along which the slider leads.
        notes: What a reader must know about them, one line each.
    """
    if not shown:
        return (
            '<div class="bw"><p class="dim">No run or answer of this episode (give run folders with --runs).</p></div>'
        )
    runs = [(index, one, one.run) for index, one in enumerate(shown) if one.run is not None]
    answers = [(index, one, one.answer) for index, one in enumerate(shown) if one.answer is not None]
    parts = [f'<p class="warn">{html.escape(note)}</p>' for note in notes]
    if runs:
        rows = "".join(_run_row(index, one, run, hidden, walked) for index, one, run in runs)
        heads = '<th>run</th><th>success</th><th class="n">SPL</th><th class="n">steps</th><th class="n">m</th>'
        parts.append(f'<table class="runs"><tr><th></th>{heads}<th></th></tr>{rows}</table>')
    if answers:
        rows = "".join(_answer_row(index, one, answer, hidden) for index, one, answer in answers)
        heads = '<th>answer</th><th>success</th><th>top 3</th><th class="n">points</th><th class="n">off by</th>'
        parts.append(f'<table class="answers"><tr><th></th>{heads}</tr>{rows}</table>')
    return f'<div class="bw">{"".join(parts)}</div>'


def picture_html(rgb: NDArray[np.uint8], *, step: int, caption: str) -> str:
    """What a robot sees, (H, W, 3), as an inline JPEG with a line below it."""
    data = base64.b64encode(jpeg_bytes(rgb)).decode()
    return (
        f'<div class="bw"><img alt="What the robot saw" data-step="{step}" src="data:image/jpeg;base64,{data}" '
        f'style="width:100%;height:auto;border-radius:6px"><p class="dim">{html.escape(caption)}</p></div>'
    )


def _row(catalogue: Catalogue, number: int, *, is_here: bool) -> str:
    episode, count = catalogue.episodes[number], catalogue.num_runs[number]
    runs = f' <span class="tag">{count} run{"s" if count > 1 else ""}</span>' if count else ""
    record = episode.record
    return (
        f'<div class="row{" here" if is_here else ""}" data-click="episode {number}">'
        f"<b>{html.escape(record.owner)}</b> &middot; {html.escape(record.object_category)}{runs}"
        f'<div class="dim">{html.escape(str(episode.key))}</div></div>'
    )


def _facts(episode: Episode) -> list[tuple[str, str]]:
    """(name, HTML) of what is known about the target."""
    record, info = episode.record, episode.record.info
    names = ", ".join(html.escape(name) for name in record.object_names)
    points = [point for goal in episode.targets for point in goal.view_points]
    seen = sum(point.iou is not None for point in points)
    captions = [text for texts in record.captions_per_object for text in texts]
    return [
        ("target", f"<b>{names}</b> ({html.escape(record.object_category)}), floor {html.escape(record.floor_id)}"),
        ("owner", html.escape(record.owner)),
        ("geodesic", f"{info.geodesic_distance:.2f} m as stored; {info.euclidean_distance:.2f} m in a straight line"),
        ("seen from", f"{seen} view points with iou, {len(points) - seen} extra ones"),
        ("captions", "<br>".join(html.escape(text) for text in captions) or '<span class="dim">none</span>'),
    ]


def _with_names(episode: Episode, graph: OwnershipGraph) -> str:
    """The paragraph with each owner's name in bold and in the person's colour; the one asked for is underlined."""
    summary = episode.record.summary
    names = sorted(graph.people, key=len, reverse=True)
    if not names:
        return html.escape(summary)
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, names))})\b")
    return "".join(
        _name(part, episode, graph) if place % 2 else html.escape(part)
        for place, part in enumerate(pattern.split(summary))
    )


def _name(name: str, episode: Episode, graph: OwnershipGraph) -> str:
    line = ";text-decoration:underline" if name == episode.record.owner else ""
    return f'<b style="color:{color_of_person(graph, name)}{line}">{html.escape(name)}</b>'


def _run_row(index: int, one: Shown, run: EpisodeRun, hidden: Collection[str], walked: str | None) -> str:
    measures = run.end.measures
    paper = measures.rules["paper"] if measures is not None else None
    walk = (
        "&#9654;" if one.label == walked else f'<button data-click="walk {index}" title="Walk along">&#9654;</button>'
    )
    return (
        f"<tr>{_who(index, one, hidden)}<td>{_yes_no(None if paper is None else paper.success)}</td>"
        f'<td class="n">{"-" if paper is None else f"{paper.spl:.2f}"}</td><td class="n">{len(run.steps)}</td>'
        f'<td class="n">{"-" if measures is None else f"{measures.path_m:.1f}"}</td><td>{walk}</td></tr>'
    )


def _answer_row(index: int, one: Shown, answer: Answer, hidden: Collection[str]) -> str:
    measures = answer.measures
    off = measures.planar_distance if measures is not None else None
    return (
        f"<tr>{_who(index, one, hidden)}<td>{_yes_no(None if measures is None else measures.success)}</td>"
        f"<td>{_yes_no(None if measures is None else measures.top3_success)}</td>"
        f'<td class="n">{len(answer.candidates)}</td><td class="n">{"-" if off is None else f"{off:.2f} m"}</td></tr>'
    )


def _who(index: int, one: Shown, hidden: Collection[str]) -> str:
    """Two cells: check box and name."""
    checked = "" if one.label in hidden else " checked"
    color = "rgb({},{},{})".format(*one.rgb)
    name = html.escape(one.label)
    title = html.escape(f"{one.kind}, {one.scene_kind}", quote=True)
    return (
        f'<td><input type="checkbox" data-click="show {index}"{checked} aria-label="Show {name}"></td>'
        f'<td title="{title}"><span class="dot" style="background:{color}"></span> {name}</td>'
    )


def _yes_no(value: bool | None) -> str:
    return "-" if value is None else '<span class="yes">yes</span>' if value else '<span class="no">no</span>'
