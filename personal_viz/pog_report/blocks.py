"""A report as headings, texts, tables and pictures; writes them as Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass

from human_study.export.text_tables import markdown_table, one_cell


@dataclass(frozen=True, slots=True)
class Heading:
    """A title; level 1 is the document's."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str
    is_strong: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Cells as text; the first column names the row."""

    heads: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]
    note: str = ""
    """Text below the table."""


@dataclass(frozen=True, slots=True)
class Picture:
    """An SVG file beside the report."""

    name: str
    caption: str


Block = Heading | Text | Table | Picture


def markdown_text(blocks: Sequence[Block]) -> str:
    """The blocks as Markdown; pictures are links to files beside it."""
    return "\n\n".join(_markdown(block) for block in blocks) + "\n"


def _markdown(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}"
        case Text(text, is_strong):
            return f"**{text}**" if is_strong else text
        case Picture(name, caption):
            return f"![{caption}]({name})"
        case Table(heads, lines, note):
            table = markdown_table([*map(one_cell, heads)], [[*map(one_cell, line)] for line in lines])
            return f"{table}\n\n{note}" if note else table
