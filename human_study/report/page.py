"""Fills in the templates of this room, and makes one HTML page of a report in Markdown."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import jinja2
from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token

from sim.page_style import tokens_css

from ..export.text_tables import markdown_line, markdown_table, one_cell
from .trials import row_label

NOBODY = "no such trials"
FEWEST_IN_CONTENTS = 4
"""A page with fewer sections has no table of contents."""
_NUMBERS = re.compile(r"(?:n )?-?\d(?:[\d.,/\[\]() ]|(?<=[ \[(])-|to|of)*")
"""A cell of numbers, such as `45.0 [-12.1, 81.0] 9/20`; a `-` after a digit is no minus: dates and ids are texts."""
_NUMBER = re.compile(r"(-?)(\d+)((?:\.\d+)?)")
_FIGURE_SPACE = "\u2007"
"""A space as wide as a digit."""
_TEMPLATES = Path(__file__).parent / "templates"
_STYLE = """
body { font: .9375rem/1.45 var(--personal-font); margin: 2rem auto; max-width: 78rem; padding: 0 1rem;
  color: var(--personal-ink); background: var(--personal-paper); }
table { border-collapse: collapse; margin: .6rem 0; font-size: 13px; }
th, td { border: 1px solid var(--personal-line); padding: .25rem .5rem; text-align: left; vertical-align: top; }
td { font-variant-numeric: tabular-nums; }
thead th { background: var(--personal-head); }
table + p { color: var(--personal-quiet); font-size: 12.5px; margin: 0 0 1rem; }
figure { margin: 1rem 0; overflow-x: auto; }
svg text { font-family: var(--personal-font); }
figcaption { color: var(--personal-quiet); font-size: 13px; }
nav { border-left: 3px solid var(--personal-line); margin: 1.5rem 0; padding: .2rem 1rem; }
nav ul { columns: 18rem; list-style: none; margin: 0; padding: 0; }
nav a { color: var(--personal-link); }
@page { margin: 15mm; }
@media print {
  body { font-size: 10pt; margin: 0; max-width: none; padding: 0; }
  nav { display: none; }
  table { font-size: 8pt; }
  thead { display: table-header-group; }
  tr, figure { break-inside: avoid; }
  h1, h2, h3 { break-after: avoid; }
  figure { overflow: visible; }
  svg { height: auto; max-width: 100%; }
}
"""
_BESIDE = "figure:has(> svg[role=img]) {{ display: inline-block; width: {}px; margin: .6rem; vertical-align: top; }}\n"


def filled(template: str, *, folder: Path = _TEMPLATES, **words: Any) -> str:
    """A template of the folder, filled with these words; sections are one empty line apart."""
    paragraphs = _environment(folder).get_template(template).render(words).split("\n\n")
    return "\n\n".join(text for part in paragraphs if (text := part.strip("\n"))) + "\n"


def label_lines(scene_labels: Iterable[str], *, is_pilot: bool, num_open: int) -> list[str]:
    """The sentences without which no number of a study may be read."""
    labels = []
    if is_pilot:
        labels.append("Pilot: served without an ethics id. These figures are for planning only.")
    if num_open:
        labels.append(f"Interim: {num_open} counted trials are not done. Do not let these figures decide when to stop.")
    return [*labels, *(f"{label}." for label in scene_labels)]


def interval_text(row: Any, digits: int = 1, otherwise: str = NOBODY) -> str:
    """A row's `value [low, high]`; `otherwise` where there is no row or value."""
    if row is None or row.value is None:
        return otherwise
    found = [x for x in (row.value, row.low, row.high) if x is not None]
    shown, *limits = (f"{round(x, digits) + 0.0:.{digits}f}" for x in found)  # no -0.0
    return f"{shown} [{', '.join(limits)}]" if len(limits) == 2 else shown


def count_text(row: Any) -> str:
    """A row's `k/n`, or its number of trials where there are no successes to count."""
    return f"n {row.n}" if row.k is None else f"{row.k}/{row.n}"


def p_text(value: float | None) -> str:
    """A p with three decimals."""
    return "-" if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"


def html_page(markdown: str, pictures: Mapping[str, str], *, beside_px: int | None = None) -> str:
    """The text as a page: the first column of a table names its rows, and pictures stand in the page.

    The first section is followed by a table of contents. Numbers of a column stand digit below digit.

    Args:
        markdown: Headings, paragraphs, tables, and pictures that stand alone.
        pictures: SVG text by name; the pictures that the text names are put into the page.
        beside_px: Width of drawings (SVG with a role) that stand beside each other; None = each on a line of its own.
    """
    reader = (
        MarkdownIt("commonmark", {"html": False}, renderer_cls=_Html)
        .enable("table")
        .disable(["link", "autolink", "code"])
    )
    tokens = reader.parse(markdown)
    for at, token in enumerate(tokens):
        if token.type == "tr_open" and tokens[at + 1].type == "td_open":
            tokens[at + 1].tag = tokens[at + 3].tag = "th"
        if [child.type for child in token.children or ()] == ["image"]:
            tokens[at - 1].tag = tokens[at + 1].tag = "figure"
    _align_numbers(tokens)
    _add_contents(tokens)
    body = reader.renderer.render(tokens, reader.options, {"pictures": pictures})
    style = tokens_css() + _STYLE + ("" if beside_px is None else _BESIDE.format(beside_px))
    title = next((tokens[at + 1].content for at, token in enumerate(tokens) if token.tag == "h1"), "Report")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<link rel="icon" href="data:,">\n'
        f"<title>{escape(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    )


@cache
def _environment(folder: Path) -> jinja2.Environment:
    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,
    )
    found.globals |= {
        "heads": lambda *names: markdown_table(names, []),
        "cells": lambda *cells: markdown_line([one_cell(cell) for cell in cells]),
    }
    found.filters |= {
        "label": lambda row: row_label(getattr(row, "who", "human"), row.condition),
        "interval": interval_text,
        "count": count_text,
        "p": p_text,
        "figure": lambda value: "-" if value is None else f"{value:.2f}",
    }
    return found


def _add_contents(tokens: list[Token]) -> None:
    """Gives sections an id, and adds a list of links to them after the first."""
    heads = [at for at, token in enumerate(tokens) if token.type == "heading_open" and token.tag == "h2"]
    if len(heads) < FEWEST_IN_CONTENTS:
        return
    links = []
    for number, at in enumerate(heads, start=1):
        tokens[at].attrs["id"] = f"section-{number}"
        links.append(f'<li><a href="#section-{number}">{escape(tokens[at + 1].content)}</a></li>\n')
    contents = f'<nav aria-label="Contents">\n<ul>\n{"".join(links)}</ul>\n</nav>\n'
    tokens.insert(heads[1], Token("html_block", "", 0, content=contents))


def _align_numbers(tokens: Sequence[Token]) -> None:
    """Pads the numbers in each column of each table."""
    columns: dict[int, list[Token]] = defaultdict(list)
    column = 0
    for at, token in enumerate(tokens):
        if token.type == "tr_open":
            column = 0
        elif token.type == "td_open":
            column += 1
            if _NUMBERS.fullmatch(tokens[at + 1].content):
                columns[column].append(tokens[at + 1])
        elif token.type == "table_close":
            for cells in columns.values():
                _pad(cells)
            columns.clear()


def _pad(cells: Sequence[Token]) -> None:
    """Makes numbers at the same place of cells of the same form, and the first number of all, equally wide."""
    forms = [_NUMBER.sub("0", cell.content) for cell in cells]
    widths: dict[tuple[str, int], int] = defaultdict(int)
    for form, cell in zip(forms, cells, strict=True):
        for place, (sign, whole, _) in enumerate(_NUMBER.findall(cell.content)):
            at = (form if place else "", place)
            widths[at] = max(widths[at], len(sign + whole))
    for form, cell in zip(forms, cells, strict=True):
        places = iter(range(len(cell.content)))

        def padded(found: re.Match[str], form: str = form, places: Iterator[int] = places) -> str:
            place = next(places)
            number = found[1].replace("-", "\u2212") + found[2]
            return number.rjust(widths[form if place else "", place], _FIGURE_SPACE) + found[3]

        cell.children = [Token("text", "", 0, content=_NUMBER.sub(padded, cell.content))]


class _Html(RendererHTML):
    """HTML with pictures drawn in place."""

    def image(self, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
        """The picture and its caption; a picture that is not at hand is replaced by its name."""
        name = str(tokens[index].attrs["src"])
        caption = self.renderInlineAsText(tokens[index].children or (), options, env)
        drawn = env["pictures"].get(name, "")
        inline = drawn[drawn.index("<svg") :] if "<svg" in drawn else escape(name)
        return f"{inline}<figcaption>{escape(caption)}</figcaption>"
