"""Verb `bench`: measures the simulator's speed and writes the figures, a table and a picture."""

import sys
import tempfile
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from sim.errors import PersonalVizError
from sim.files import write_whole

from ..bench.plot import frame_time_png
from ..bench.report import SimReport, figure_rows, machine_lines, markdown, target_rows
from ..bench.simulator import FULL, QUICK, run_benchmark
from .runs import MIN_TABLE_WIDTH

NAMES = ("bench-sim.json", "bench-sim.md", "bench-sim.png")
"""What a run writes into its folder."""


def bench_sim(*, out: Path, quick: bool, json: bool) -> int:
    """Measures, writes NAMES into `out` and prints the targets and figures; progress goes to stderr.

    Raises:
        PersonalVizError: `out` cannot be written; found out before anything is measured.
    """
    _require_folder(out)
    settings = QUICK if quick else FULL
    report = run_benchmark(settings, quick=quick, progress=lambda line: print(line, file=sys.stderr, flush=True))
    document = report.model_dump_json(indent=2)
    _write(out, report, document)
    if json:
        print(document)
        return 0
    _print_tables(report)
    print(f"Written to {', '.join(str(out / name) for name in NAMES)}")
    return 0


def bench_recordings(*, out: Path, quick: bool, json: bool) -> int:
    """Measures recordings."""
    raise PersonalVizError("bench recordings: is being written")


def _require_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise _unwritable(out, error) from None


def _write(out: Path, report: SimReport, document: str) -> None:
    data, table, picture = (out / name for name in NAMES)
    try:
        write_whole(data, document + "\n")
        write_whole(table, markdown(report))
        write_whole(picture, frame_time_png(report))
    except OSError as error:
        raise _unwritable(out, error) from None


def _unwritable(out: Path, error: OSError) -> PersonalVizError:
    return PersonalVizError(
        f"--out: {str(out)!r} cannot be written ({error.strerror}); expected a folder, or a place for one. "
        "Choose another."
    )


def _print_tables(report: SimReport) -> None:
    console = Console(file=sys.stdout, width=max(MIN_TABLE_WIDTH, Console().width))
    for title, (heads, *rows) in (("Targets", target_rows(report)), ("Figures", figure_rows(report))):
        table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
        for k, head in enumerate(heads):
            table.add_column(head.replace(" cluttered", "\ncluttered"), justify="right" if k else "left", no_wrap=True)
        for row in rows:
            table.add_row(row[0].strip("*"), *row[1:])
        console.print(table)
    for line in machine_lines(report.machine):
        print(line)
    if report.left_out:
        print(f"Left out of this quick run: {', '.join(report.left_out)}")
    print(f"{report.seconds:.0f} s")
