"""Verb `bench`: measures speed and sizes, writes the figures as JSON and tables, the simulator's as a picture too."""

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from personal_viz.printed import Console
from sim.errors import PersonalVizError, StudyError
from sim.files import write_whole

from ..bench.sim.plot import frame_time_png
from ..bench.sim.report import SimReport, figure_rows, machine_lines, markdown, target_rows
from ..bench.sim.simulator import FULL, QUICK, run_benchmark
from .runs import MIN_TABLE_WIDTH

NAMES = ("bench-sim.json", "bench-sim.md", "bench-sim.png")
"""What a run of the simulator's benchmark writes into its folder."""
RECORDING_NAMES = ("bench-recordings.json", "bench-recordings.md")
"""The same of the recordings' benchmark."""
GROUNDING_NAMES = ("bench-grounding.json", "bench-grounding.md")
"""The same of grounding's benchmark."""
STUDY_NAMES = ("bench-study.json", "bench-study.md")
"""The same of the human study's benchmark."""


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
    """Measures recordings, writes RECORDING_NAMES into `out` and prints the figures; progress goes to stderr.

    Raises:
        PersonalVizError: `out` cannot be written; found out before anything is measured.
    """
    from ..bench.recordings import FULL, QUICK, figure_rows, markdown, measure_recordings

    _require_folder(out)
    figures = measure_recordings(
        QUICK if quick else FULL, progress=lambda line: print(line, file=sys.stderr, flush=True)
    )
    document = figures.model_dump_json(indent=2)
    _write_two(out, RECORDING_NAMES, document, markdown(figures))
    if json:
        print(document)
        return 0
    _print_table("Recordings", figure_rows(figures))
    print(f"Written to {', '.join(str(out / name) for name in RECORDING_NAMES)}")
    return 0


def bench_grounding(*, out: Path, quick: bool, json: bool) -> int:
    """Measures grounding, writes GROUNDING_NAMES into `out` and prints the figures; progress goes to stderr.

    Raises:
        PersonalVizError: `out` cannot be written; found out before anything is measured.
    """
    from ..bench.grounding import FULL, QUICK, measure_grounding
    from ..bench.grounding_table import figure_rows, markdown

    _require_folder(out)
    figures = measure_grounding(
        QUICK if quick else FULL, progress=lambda line: print(line, file=sys.stderr, flush=True)
    )
    document = figures.model_dump_json(indent=2)
    _write_two(out, GROUNDING_NAMES, document, markdown(figures))
    if json:
        print(document)
        return 0
    _print_table("Grounding", figure_rows(figures))
    print(f"Written to {', '.join(str(out / name) for name in GROUNDING_NAMES)}")
    return 0


def bench_study(*, out: Path, quick: bool, json: bool, parts: Sequence[str] = ()) -> int:
    """Measures a study, writes STUDY_NAMES into `out` and prints the figures; progress goes to stderr.

    Args:
        out: Folder.
        quick: Shorter.
        json: Print the figures as JSON alone.
        parts: Names of `bench.study.PARTS`, measured in that order; () = all.

    Raises:
        PersonalVizError: `out` cannot be written, a part is unknown, or a study cannot be served.
    """
    from ..bench.study.parts import FULL, PARTS, QUICK, figure_rows, markdown, measure_study

    unknown = sorted(set(parts) - set(PARTS))
    if unknown:
        raise StudyError(f"--parts {' '.join(unknown)}: is none of the parts; expected some of {', '.join(PARTS)}.")
    _require_folder(out)
    settings = QUICK if quick else FULL
    if parts:
        settings = settings.model_copy(update={"parts": tuple(part for part in PARTS if part in parts)})
    figures = measure_study(settings, progress=lambda line: print(line, file=sys.stderr, flush=True))
    document = figures.model_dump_json(indent=2)
    _write_two(out, STUDY_NAMES, document, markdown(figures))
    if json:
        print(document)
        return 0
    _print_table("Human study", figure_rows(figures))
    print(f"Written to {', '.join(str(out / name) for name in STUDY_NAMES)}")
    return 0


def require_no_parts(what: str, parts: Sequence[str]) -> None:
    """Refuses parts where there are none.

    Raises:
        PersonalVizError: There are some.
    """
    if parts:
        raise PersonalVizError(
            f"bench {what}: --parts is {' '.join(parts)}; expected none, because only bench study has parts. "
            "Leave it out."
        )


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


def _write_two(out: Path, names: tuple[str, str], document: str, table: str) -> None:
    try:
        write_whole(out / names[0], document + "\n")
        write_whole(out / names[1], table)
    except OSError as error:
        raise _unwritable(out, error) from None


def _unwritable(out: Path, error: OSError) -> PersonalVizError:
    return PersonalVizError(
        f"--out: {str(out)!r} cannot be written ({error.strerror}); expected a folder, or a place for one. "
        "Choose another."
    )


def _print_tables(report: SimReport) -> None:
    for title, rows in (("Targets", target_rows(report)), ("Figures", figure_rows(report))):
        _print_table(title, rows)
    for line in machine_lines(report.machine):
        print(line)
    if report.left_out:
        print(f"Left out of this quick run: {', '.join(report.left_out)}")
    print(f"{report.seconds:.0f} s")


def _print_table(title: str, rows: Sequence[Sequence[str]]) -> None:
    """The first row holds the heads."""
    heads, *lines = rows
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    for k, head in enumerate(heads):
        table.add_column(head.replace(" cluttered", "\ncluttered"), justify="right" if k else "left", no_wrap=True)
    for row in lines:
        table.add_row(row[0].strip("*"), *row[1:])
    Console(file=sys.stdout, width=max(MIN_TABLE_WIDTH, Console().width)).print(table)
