"""A report as headings, texts, tables and pictures; writes them as Markdown or as one HTML page."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


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
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 78rem; padding: 0 1rem; color: #1b1b1b; }
table { border-collapse: collapse; margin: .6rem 0; font-size: 13px; }
th, td { border: 1px solid #c9c9c9; padding: .25rem .5rem; text-align: left; vertical-align: top; }
thead th { background: #f0f0ee; }
.note { color: #4d4d4d; font-size: 12.5px; margin: 0 0 1rem; }
figure { margin: 1rem 0; overflow-x: auto; }
figcaption { color: #4d4d4d; font-size: 13px; }
"""


def markdown_text(blocks: Sequence[Block]) -> str:
    """The blocks as Markdown; pictures are links to files beside it."""
    return "\n\n".join(_markdown(block) for block in blocks) + "\n"


def html_text(blocks: Sequence[Block], pictures: Mapping[str, str]) -> str:
    """The blocks as one HTML page that needs no other file.

    Args:
        blocks: The blocks, in order.
        pictures: SVG text by name; the pictures that the blocks name are put into the page.
    """
    title = next((block.text for block in blocks if isinstance(block, Heading)), "Report")
    body = "\n".join(_html(block, pictures) for block in blocks)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{html.escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def markdown_table(heads: Sequence[str], lines: Sequence[Sequence[str]], *, num_text: int | None = None) -> str:
    """A table in Markdown.

    Args:
        heads: Headings of the columns.
        lines: Cells, with Markdown escaped where needed.
        num_text: Number of columns at the left that hold text; the others hold numbers, set to the right. None = all
            hold text.
    """
    num_text = len(heads) if num_text is None else num_text
    rule = "|" + "---|" * num_text + "---:|" * (len(heads) - num_text)
    first, *others = (f"| {' | '.join(cells)} |" for cells in (heads, *lines))
    return "\n".join([first, rule, *others])


def _markdown(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}"
        case Text(text, is_strong):
            return f"**{text}**" if is_strong else text
        case Picture(name, caption):
            return f"![{caption}]({name})"
        case Table(heads, lines, note):
            table = markdown_table([*map(_piped, heads)], [[*map(_piped, line)] for line in lines])
            return f"{table}\n\n{note}" if note else table


def _html(block: Block, pictures: Mapping[str, str]) -> str:
    match block:
        case Heading(text, level):
            return f"<h{level}>{html.escape(text)}</h{level}>"
        case Text(text, is_strong):
            return f"<p><strong>{html.escape(text)}</strong></p>" if is_strong else f"<p>{html.escape(text)}</p>"
        case Picture(name, caption):
            drawn = pictures.get(name, "")
            inline = drawn[drawn.index("<svg") :] if "<svg" in drawn else html.escape(name)
            return f"<figure>{inline}<figcaption>{html.escape(caption)}</figcaption></figure>"
        case Table(heads, lines, note):
            head = "".join(f"<th>{html.escape(cell)}</th>" for cell in heads)
            body = "\n".join(
                "<tr>"
                + f"<th>{html.escape(line[0])}</th>"
                + "".join(f"<td>{html.escape(cell)}</td>" for cell in line[1:])
                + "</tr>"
                for line in lines
            )
            table = f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table>"
            return table + (f'\n<p class="note">{html.escape(note)}</p>' if note else "")


def _piped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
