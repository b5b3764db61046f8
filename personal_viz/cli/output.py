"""Prints and writes for verbs: tables, one JSON document, lines of progress, the files of a report."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from personal_viz.printed import Console
    from recordings.paths import RecordingKey
    from recordings.sinks import LiveSink

TABLE_WIDTH = 150
"""Columns that most tables need."""


def table_console(width: int = TABLE_WIDTH, *, folds: bool = False) -> Console:
    """A console on standard output for tables.

    Args:
        width: Columns that the tables need; the console has at least as many.
        folds: Whether the tables may have fewer columns on a narrow terminal.
    """
    from personal_viz.printed import Console

    if folds and sys.stdout.isatty():
        return Console()
    return Console(file=sys.stdout, width=max(width, Console().width))


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
    from sim.files import write_whole

    from .refusals import writing

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
