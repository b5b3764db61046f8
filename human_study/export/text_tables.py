"""Tables of any cells as text: CSV that is safe in a spreadsheet, Markdown, and parts of LaTeX tables."""

import json
import re
from collections.abc import Iterable, Sequence
from typing import Any

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters that make a spreadsheet read text as a formula."""
_TEX = {letter: f"\\{letter}" for letter in "#$%&_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}
"""LaTeX for the characters that it reads as commands."""
_NEEDS_QUOTES = re.compile(r'[",\r\n]')


def csv_lines(heads: Iterable[str], lines: Iterable[Sequence[object]]) -> str:
    """CSV text whose cells no spreadsheet reads as formulas; a cell without value is empty."""
    return "".join(",".join(_quoted(_csv_cell(value)) for value in line) + "\n" for line in (list(heads), *lines))


def markdown_table(heads: Sequence[str], lines: Iterable[Sequence[str]], *, num_text: int | None = None) -> str:
    """A table in Markdown.

    Args:
        lines: Cells, with Markdown escaped where needed.
        num_text: Number of columns at the left that hold text; the others hold numbers, set to the right. None = all
            hold text.
    """
    num_text = len(heads) if num_text is None else num_text
    rule = "|" + "---|" * num_text + "---:|" * (len(heads) - num_text)
    return "\n".join([markdown_line(heads), rule, *map(markdown_line, lines)])


def markdown_line(cells: Sequence[str]) -> str:
    """One line of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def one_cell(value: object) -> str:
    """Any value as the text of one cell of a Markdown table."""
    return str(value).replace("|", "\\|").replace("\n", " ")


def tex(text: str) -> str:
    """The text, escaped for LaTeX."""
    return "".join(_TEX.get(letter, letter) for letter in text)


def tex_table(heads: Sequence[str], lines: Iterable[Sequence[str]], *, below: Sequence[str]) -> str:
    """A LaTeX table; the first column names the rows.

    Args:
        heads: Headings of the columns, as LaTeX.
        lines: Cells, as LaTeX.
        below: Remarks, as text; they are rows of the table, so that a copy of it keeps them.
    """
    rows = [" & ".join(line) + " \\\\\n" for line in (heads, *lines)]
    remarks = [f"\\multicolumn{{{len(heads)}}}{{l}}{{\\footnotesize {tex(text)}.}} \\\\\n" for text in below]
    columns = "l" + "c" * (len(heads) - 1)
    parts = (f"\\begin{{tabular}}{{{columns}}}\n", rows[0], "".join(rows[1:]), "".join(remarks) + "\\end{tabular}\n")
    return "\\hline\n".join(parts)


def json_text(value: Any) -> str:
    """The value as JSON in one cell."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _quoted(text: str) -> str:
    """A cell, in quotes where it needs them; the csv module does not quote a bare carriage return."""
    return '"' + text.replace('"', '""') + '"' if _NEEDS_QUOTES.search(text) else text


def _csv_cell(value: Any) -> str:
    """A value as text: numbers at full precision, lists and objects as JSON, nothing that a spreadsheet executes."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    text = value if isinstance(value, str) else json_text(value)
    return f"'{text}" if text.startswith(_FORMULA) else text
