"""Prints and writes for verbs: tables, one JSON document, lines of progress, the files of a report."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from personal_viz.printed import Console
from recordings.paths import RecordingKey
from sim.files import write_whole

from .refusals import writing

if TYPE_CHECKING:
    from recordings.sinks import LiveSink

TABLE_WIDTH = 150
"""Columns that most tables need."""
_FIRST_WIDTH = 44
"""Most columns of the first column, which holds names; longer ones are folded."""


def table_console(width: int = TABLE_WIDTH, *, folds: bool = False) -> Console:
    """A console on standard output for tables.

    Args:
        width: Columns that the tables need; the console has at least as many.
        folds: Whether the tables may have fewer columns on a narrow terminal.
    """
    if folds and sys.stdout.isatty():
        return Console()
    return Console(file=sys.stdout, width=max(width, Console().width))


def table_of(
    heads: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    *,
    title: str = "",
    texts: Collection[str] = (),
    total: Sequence[str] = (),
) -> Table:
    """A table; no cell is read as markup.

    Args:
        heads: Heads of the columns, of one or two lines.
        rows: Cells of each row.
        title: Line above the table.
        texts: Heads of the columns that hold text, as the first one does; the others hold numbers, set to the right.
        total: Cells of a last row that is set apart; empty = none.
    """
    above = Text(title, "table.title") if title else None
    table = Table(title=above, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    has_two_lines = any("\n" in head for head in heads)
    for index, head in enumerate(heads):
        is_text = index == 0 or head in texts
        table.add_column(
            Text(f"\n{head}" if has_two_lines and "\n" not in head else head),
            justify="left" if is_text else "right",
            no_wrap=not is_text,
            overflow="fold",
            max_width=_FIRST_WIDTH if index == 0 else None,
        )
    for row in rows:
        table.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    if total:
        table.add_section()
        table.add_row(*map(Text, total), style="bold")
    return table


def print_table(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    *,
    texts: Collection[str] = (),
    total: Sequence[str] = (),
    width: int = TABLE_WIDTH,
    folds: bool = False,
) -> None:
    """Prints `table_of` on a console of `table_console`."""
    table = table_of(heads, rows, title=title, texts=texts, total=total)
    table_console(width, folds=folds).print(table)


def print_json(document: object) -> None:
    """Prints one document on standard output."""
    print(json.dumps(document, indent=2))


def say(line: str) -> None:
    """Prints a line of progress on standard error."""
    print(line, file=sys.stderr, flush=True)


def write_report(out: Path, files: Mapping[str, str | bytes], *, earlier: Sequence[str]) -> None:
    """Writes all files of a report into a folder; removes drawings of an earlier report that are not among them.

    Args:
        out: The folder, `--out`.
        files: Contents by file name.
        earlier: Patterns of the names of drawings.

    Raises:
        PersonalVizError: The folder cannot be written.
    """
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        for old in {path for pattern in earlier for path in out.glob(pattern)}:
            if old.name not in files:
                old.unlink()
        for name, content in files.items():
            write_whole(out / name, content)


@contextmanager
def recorded(rerun: str, keys: Sequence[RecordingKey], *, said_to: TextIO) -> Iterator[LiveSink]:
    """Yields the sink of the option `--rerun`; at the end of the block, prints where it recorded.

    Args:
        rerun: The option.
        keys: Keys of the recordings.
        said_to: Standard output, or standard error beside a JSON document.

    Raises:
        RecordingError: A single file cannot hold all these recordings, or no viewer answers.
    """
    from recordings.sinks import live_sink

    with live_sink(rerun, keys) as sink:
        yield sink
        if sink.kind != "address":
            print(f"Recorded to {sink.where}; see it with: rerun {sink.where}", file=said_to)
