"""The ownership graph as a drawing: people left, objects right, an edge for each thing owned. Pure: text in, SVG out.

Nodes carry `data-hover` and `data-click`, which messages.py turns into messages; everything from files is escaped.
"""

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from sim.episodes.ownership import OwnershipGraph

from .object_links import ObjectLink

WIDTH = 440
"""Of the drawing, in its own units (pixels where the panel is as wide)."""
_ROW = 54
_PERSON_X, _OBJECT_X = 92, 196
"""Where edges leave people and reach objects."""
_LINE = 35
"""Letters in a line of an object's name; it has two."""
_HALF = 24
"""Half the height of an object's box."""
PEOPLE_COLORS = ("#1f77b4", "#c05a00", "#2a7f3a", "#b0306a", "#6b4fa0", "#7a5230", "#007f86", "#8a8a00")
"""One per person, in the graph's order; more people begin it again."""


@dataclass(frozen=True, slots=True)
class GraphDrawing:
    """A graph with what is known about its objects."""

    graph: OwnershipGraph
    links: tuple[ObjectLink, ...]
    """One per object node, in order."""
    owner: str
    """Who is asked for."""
    storeys: tuple[str, ...] = ()
    """Of each object: a short note such as "storey 2", empty where there is none."""


def color_of_person(graph: OwnershipGraph, person: str) -> str:
    """The colour in which a person is written and drawn."""
    return PEOPLE_COLORS[graph.people.index(person) % len(PEOPLE_COLORS)]


def graph_svg(drawing: GraphDrawing, *, marked: int | None = None) -> str:
    """The drawing as HTML.

    Args:
        drawing: What to draw.
        marked: Index of the object node that is marked, with its edges and owners; None = no one.
    """
    graph = drawing.graph
    if not graph.edges:
        return '<p style="color:#777">The episode has no ownership sentence.</p>'
    rows = max(len(graph.people), len(graph.objects))
    height = rows * _ROW + 8
    person_y = _places(len(graph.people), height)
    object_y = _places(len(graph.objects), height)
    node = None if marked is None else graph.objects[marked]
    owners = {edge.owner for edge in graph.edges if edge.node == node}
    edges = "".join(
        _edge(
            (person_y[(person := graph.people.index(edge.owner))], object_y[(thing := graph.objects.index(edge.node))]),
            color_of_person(graph, edge.owner),
            f"p{person}",
            f"o{thing}",
            is_on=edge.node == node,
        )
        for edge in graph.edges
    )
    people = "".join(
        _person(drawing, index, y, is_on=graph.people[index] in owners) for index, y in enumerate(person_y)
    )
    objects = "".join(_object(drawing, index, y, is_on=index == marked) for index, y in enumerate(object_y))
    return (
        f'<svg class="og" role="img" aria-label="Ownership graph" viewBox="0 0 {WIDTH} {height}">'
        f"{edges}{people}{objects}</svg>"
    )


def graph_html(drawing: GraphDrawing, *, marked: int | None = None) -> str:
    """The drawing with a line above that says what can be done with it, and one below about the links."""
    return (
        '<div class="bw"><p class="dim">Who owns what: hover to find a thing in the home, click to go there; a click '
        f"on a box in the home marks it here.</p>{graph_svg(drawing, marked=marked)}"
        f'<p class="dim">{link_counts(drawing.links)}</p></div>'
    )


def link_counts(links: Sequence[ObjectLink]) -> str:
    """One line that says how many objects are linked to the home, and how."""
    targets = sum(link.is_target for link in links)
    told = sum(link.goal is not None for link in links) - targets
    unknown = len(links) - targets - told
    parts = [f"{targets} asked for", f"{told} linked by the words of captions"]
    if unknown:
        parts.append(f"{unknown} not linked (dashed), because the texts fit no object or several")
    return f"{len(links)} objects: " + ", ".join(parts) + "."


def _places(count: int, height: int) -> list[float]:
    return [height * (index + 0.5) / count for index in range(count)]


def _edge(ys: tuple[float, float], color: str, person: str, thing: str, *, is_on: bool) -> str:
    (a, b), middle = ys, (_PERSON_X + _OBJECT_X) / 2
    return (
        f'<path class="edge{" on" if is_on else ""}" data-ends="{person} {thing}" stroke="{color}" '
        f'd="M{_PERSON_X} {a:.1f}C{middle} {a:.1f} {middle} {b:.1f} {_OBJECT_X} {b:.1f}"/>'
    )


def _person(drawing: GraphDrawing, index: int, y: float, *, is_on: bool) -> str:
    name = drawing.graph.people[index]
    classes = "node person" + (" target" if name == drawing.owner else "") + (" on" if is_on else "")
    color = color_of_person(drawing.graph, name)
    return (
        f'<g class="{classes}" data-node="p{index}" data-hover="p{index}"><title>{html.escape(name)}</title>'
        f'<rect x="2" y="{y - 12:.1f}" width="{_PERSON_X - 2}" height="24" rx="12"/>'
        f'<circle cx="14" cy="{y:.1f}" r="5" fill="{color}"/>'
        f'<text x="24" y="{y:.1f}">{html.escape(_cut(name, 10))}</text></g>'
    )


def _object(drawing: GraphDrawing, index: int, y: float, *, is_on: bool) -> str:
    link = drawing.links[index]
    classes = "node object" + (" target" if link.is_target else "") + (" on" if is_on else "")
    classes += " linked" if link.goal is not None else " guess"
    events = f' data-click="object {index}"' if link.goal is not None else ""
    note = link.goal or "not linked"
    if drawing.storeys and drawing.storeys[index]:
        note += f" · {drawing.storeys[index]}"
    lines = _wrapped(f"{index + 1}. {link.node}")
    x, rise = _OBJECT_X + 8, 7.5 * len(lines)
    texts = "".join(
        f'<text x="{x}" y="{y - rise + 15 * place:.1f}">{html.escape(line)}</text>' for place, line in enumerate(lines)
    )
    return (
        f'<g class="{classes}" data-node="o{index}" data-hover="o{index}"{events}>'
        f"<title>{html.escape(link.node)} ({html.escape(note)})</title>"
        f'<rect x="{_OBJECT_X}" y="{y - _HALF:.1f}" width="{WIDTH - _OBJECT_X - 2}" height="{2 * _HALF}" rx="5"/>'
        f'{texts}<text class="small" x="{x}" y="{y - rise + 15 * len(lines):.1f}">{html.escape(_cut(note, 40))}</text>'
        "</g>"
    )


def _wrapped(text: str) -> list[str]:
    """At most two lines; what is left out is in the node's title."""
    first, *more = textwrap.wrap(text, _LINE) or [text]
    return [first, _cut(" ".join(more), _LINE)] if more else [first]


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else text[: letters - 1].rstrip() + "…"
