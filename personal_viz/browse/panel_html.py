"""The parts of the panels as HTML: an episode, its runs, the list, and the graph of who owns what.

`panels.html.j2` has a macro for each part and escapes everything that comes from files. Nodes of the graph carry
`data-hover` and `data-click`, which panels.py turns into messages.
"""

import base64
import re
import textwrap
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import jinja2
import jinja2.environment
import numpy as np
from numpy.typing import NDArray

from sim.episodes.ownership import OwnershipGraph
from sim.episodes.schema import Episode
from sim.page_style import tokens_css
from sim.render.renderer import jpeg_bytes
from sim.tasks.run_files import Answer, EpisodeRun

from .library import ShownEpisode

PEOPLE_COLORS = ("#1f77b4", "#b55300", "#2a7f3a", "#b0306a", "#6b4fa0", "#7a5230", "#007f86", "#727200")
"""One per person, in the graph's order; more people begin it again. Names are written in them on white."""
_ROW = 54
"""Height of a row of the graph, in its own units (pixels where the panel is as wide as the drawing)."""
_LINE = 35
"""Letters in a line of an object's name; it has two lines."""
_HERE = Path(__file__).parent


def style_html() -> str:
    """The style of every panel; sent once."""
    return f"<style>{tokens_css()}{(_HERE / 'browse.css').read_text(encoding='utf-8')}</style>"


def part_html(name: str, **values: object) -> str:
    """A part of the panels: the macro `name` of `panels.html.j2`, called with these values."""
    return str(getattr(_macros(), name)(**values))


def notice_html(text: str, *, is_warning: bool = False) -> str:
    """One paragraph."""
    return part_html("notice", text=text, is_warning=is_warning)


def story_html(episode: Episode, graph: OwnershipGraph) -> str:
    """The paragraph with its names in the graph's colours."""
    return part_html("story", parts=list(_with_names(episode, graph)))


def picture_html(rgb: NDArray[np.uint8], *, step: int, caption: str) -> str:
    """A robot's picture (H, W, 3) as an inline JPEG with a line below it."""
    return part_html("picture", data=base64.b64encode(jpeg_bytes(rgb)).decode(), step=step, caption=caption)


def runs_html(shown: ShownEpisode, *, hidden: set[str], walked: int | None, notes: Sequence[str] = ()) -> str:
    """Runs and answers of the episode as tables with check boxes.

    Args:
        hidden: Titles of those whose path or points are not drawn.
        walked: Place of the run along which the slider leads.
        notes: Remarks on them that a reader needs, one line each.
    """
    numbered = list(enumerate(shown.traces))
    walks = [(index, trace) for index, trace in numbered if isinstance(trace.run, EpisodeRun)]
    answers = [(index, trace) for index, trace in numbered if isinstance(trace.run, Answer)]
    return part_html("runs", walks=walks, answers=answers, hidden=hidden, walked=walked, notes=notes)


def graph_html(shown: ShownEpisode, *, marked: int | None = None, notes: Sequence[str] = ()) -> str:
    """The ownership graph as a drawing, people left and objects right, an edge for each thing owned.

    Args:
        marked: Index of the object node that is marked, with its edges and owners; None = none.
        notes: A short note on each object, such as "storey 2"; empty texts for none.
    """
    graph, links = shown.graph, shown.links
    height = _ROW * max(len(graph.people), len(graph.objects)) + 8
    person_y, object_y = (_places(len(names), height) for names in (graph.people, graph.objects))
    node = None if marked is None else graph.objects[marked]
    owners = {edge.owner for edge in graph.edges if edge.node == node}
    edges = []
    for edge in graph.edges:
        person, thing = graph.people.index(edge.owner), graph.objects.index(edge.node)
        ends = (person, thing, person_y[person], object_y[thing])
        change = shown.changes.get((edge.owner, edge.node), "")
        edges.append((*ends, color_of_person(graph, edge.owner), edge.node == node, change))
    people = [
        (name, y, color_of_person(graph, name), name == shown.episode.record.owner, name in owners)
        for name, y in zip(graph.people, person_y, strict=True)
    ]
    objects = [
        (link, y, _wrapped(f"{index + 1}. {link.node}"), notes[index] if notes else "", index == marked)
        for index, (link, y) in enumerate(zip(links, object_y, strict=True))
    ]
    num_targets = sum(link.is_target for link in links)
    num_told = sum(link.goal is not None for link in links) - num_targets
    return part_html(
        "graph",
        height=height,
        edges=edges,
        people=people,
        objects=objects,
        counts=(len(links), num_targets, num_told, len(links) - num_targets - num_told),
        is_of_search=bool(shown.history),
    )


def history_html(shown: ShownEpisode) -> str:
    """Messages and searches of a home sequence, each search a link; nothing for an episode."""
    return part_html("history", lines=shown.history) if shown.history else ""


def color_of_person(graph: OwnershipGraph, person: str) -> str:
    """The colour in which a person is written and drawn."""
    return PEOPLE_COLORS[graph.people.index(person) % len(PEOPLE_COLORS)]


@cache
def _macros() -> jinja2.environment.TemplateModule:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["cut"] = _cut
    return environment.get_template("panels.html.j2").module


def _with_names(episode: Episode, graph: OwnershipGraph) -> Iterator[tuple[str, str | None, bool]]:
    """The paragraph in pieces: text, colour of the person whose name it is, whether that is the owner asked for."""
    summary, owner = episode.record.summary, episode.record.owner
    names = sorted(graph.people, key=len, reverse=True)
    if not names:
        yield summary, None, False
        return
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, names))})\b")
    for place, part in enumerate(pattern.split(summary)):
        yield part, color_of_person(graph, part) if place % 2 else None, part == owner


def _places(count: int, height: int) -> list[float]:
    return [height * (index + 0.5) / count for index in range(count)]


def _wrapped(text: str) -> list[str]:
    """At most two lines; the node's title has the whole text."""
    first, *more = textwrap.wrap(text, _LINE) or [text]
    return [first, _cut(" ".join(more), _LINE)] if more else [first]


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else text[: letters - 1].rstrip() + "…"
