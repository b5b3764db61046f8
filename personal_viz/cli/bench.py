"""Verb `bench`: measures speed and sizes, writes the figures as JSON and tables, the simulator's as a picture too."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from sim.errors import PersonalVizError, StudyError

from .options import Json

if TYPE_CHECKING:
    from pydantic import BaseModel

StudyPart = Literal["store", "load", "browser", "kills", "people", "big-home", "restart", "soak"]


@dataclass(frozen=True, slots=True)
class Measured:
    """What a benchmark found."""

    figures: BaseModel
    """As JSON has them."""
    markdown: str
    """The same as a table."""
    tables: tuple[tuple[str, Sequence[Sequence[str]]], ...]
    """(title, rows with the heads first) of what the terminal shows."""
    lines: tuple[str, ...] = ()
    """Below the tables."""
    picture: bytes | None = None
    """PNG."""


@dataclass
class Bench:
    """Measure speed on this machine; each figure stands beside its reference measured in the same run."""

    what: Positional[Literal["sim", "recordings", "study", "grounding"]]
    out: Annotated[Path, arg(help="Folder of the table, the plot and the JSON file.")] = Path("runs/bench")
    quick: Annotated[bool, arg(help="Fewer and smaller scenes, at most 50 s; study: some minutes.")] = False
    parts: Annotated[tuple[StudyPart, ...], arg(help="study: only these, by default all, which takes an hour.")] = ()
    json: Json = False

    def work(self) -> int:
        if self.parts and self.what != "study":
            raise PersonalVizError(
                f"bench {self.what}: --parts is {' '.join(self.parts)}; expected none, because only bench study has "
                "parts. Leave it out."
            )
        _require_folder(self.out)
        measured = self._measured(lambda line: print(line, file=sys.stderr, flush=True))
        document = measured.figures.model_dump_json(indent=2)
        files: dict[str, str | bytes] = {"json": document + "\n", "md": measured.markdown}
        if measured.picture is not None:
            files["png"] = measured.picture
        paths = _write({self.out / f"bench-{self.what}.{ending}": content for ending, content in files.items()})
        if self.json:
            print(document)
            return 0
        for title, rows in measured.tables:
            _print_table(title, rows)
        for line in (*measured.lines, f"Written to {', '.join(map(str, paths))}"):
            print(line)
        return 0

    def _measured(self, tell: Callable[[str], None]) -> Measured:
        match self.what:
            case "sim":
                return _sim(tell, quick=self.quick)
            case "recordings":
                from ..bench import recordings

                figures = recordings.measure_recordings(
                    recordings.QUICK if self.quick else recordings.FULL, progress=tell
                )
                return Measured(
                    figures, recordings.markdown(figures), (("Recordings", recordings.figure_rows(figures)),)
                )
            case "grounding":
                from ..bench import grounding, grounding_table

                figures = grounding.measure_grounding(grounding.QUICK if self.quick else grounding.FULL, progress=tell)
                rows = grounding_table.figure_rows(figures)
                return Measured(figures, grounding_table.markdown(figures), (("Grounding", rows),))
            case "study":
                return _study(tell, quick=self.quick, asked=self.parts)


def _sim(tell: Callable[[str], None], *, quick: bool) -> Measured:
    from ..bench.sim import report, simulator
    from ..bench.sim.plot import frame_time_png

    found = simulator.run_benchmark(simulator.QUICK if quick else simulator.FULL, quick=quick, progress=tell)
    left_out = [f"Left out of this quick run: {', '.join(found.left_out)}"] if found.left_out else []
    return Measured(
        found,
        report.markdown(found),
        (("Targets", report.target_rows(found)), ("Figures", report.figure_rows(found))),
        (*report.machine_lines(found.machine), *left_out, f"{found.seconds:.0f} s"),
        frame_time_png(found),
    )


def _study(tell: Callable[[str], None], *, quick: bool, asked: Sequence[str]) -> Measured:
    """The human study's figures; () measures all parts.

    Raises:
        StudyError: A part is unknown, or a study cannot be served.
    """
    from ..bench.study import parts

    unknown = sorted(set(asked) - set(parts.PARTS))
    if unknown:
        raise StudyError(
            f"--parts {' '.join(unknown)}: is none of the parts; expected some of {', '.join(parts.PARTS)}."
        )
    settings = parts.QUICK if quick else parts.FULL
    if asked:
        settings = settings.model_copy(update={"parts": tuple(part for part in parts.PARTS if part in asked)})
    figures = parts.measure_study(settings, progress=tell)
    return Measured(figures, parts.markdown(figures), (("Human study", parts.figure_rows(figures)),))


def _require_folder(out: Path) -> None:
    """Found out before anything is measured."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise _unwritable(out, error) from None


def _write(files: dict[Path, str | bytes]) -> list[Path]:
    from sim.files import write_whole

    for path, content in files.items():
        try:
            write_whole(path, content)
        except OSError as error:
            raise _unwritable(path.parent, error) from None
    return list(files)


def _unwritable(out: Path, error: OSError) -> PersonalVizError:
    return PersonalVizError(
        f"--out: {str(out)!r} cannot be written ({error.strerror}); expected a folder, or a place for one. "
        "Choose another."
    )


def _print_table(title: str, rows: Sequence[Sequence[str]]) -> None:
    """The first row holds the heads."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from personal_viz.printed import Console

    from .metrics import MIN_TABLE_WIDTH

    heads, *lines = rows
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    for k, head in enumerate(heads):
        table.add_column(head.replace(" cluttered", "\ncluttered"), justify="right" if k else "left", no_wrap=True)
    for row in lines:
        table.add_row(row[0].strip("*"), *row[1:])
    Console(file=sys.stdout, width=max(MIN_TABLE_WIDTH, Console().width)).print(table)
