"""Verb `bench`: measures speed and sizes, prints figures beside targets, writes them as JSON and tables."""

import json as json_format
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.errors import PersonalVizError
from sim.files import write_whole

from ..bench.harness import Report, machine_line, markdown, run_benchmark, tables
from .output import print_table, say
from .refusals import require_folder, writing

StudyPart = Literal["store", "load", "browser", "pogview", "kills", "people", "big-home", "restart", "soak"]


@dataclass
class Bench:
    """Measure speed on this machine; each figure stands beside its reference measured in the same run."""

    what: Positional[Literal["sim", "recordings", "study", "grounding", "agents", "robot", "scale"]]
    out: Annotated[Path, arg(help="Folder of the table, the plot and the JSON file.")] = Path("runs/bench")
    quick: Annotated[bool, arg(help="Fewer and smaller scenes, at most 50 s; study: some minutes.")] = False
    parts: Annotated[tuple[StudyPart, ...], arg(help="study: only these, by default all, which takes an hour.")] = ()
    json: Annotated[
        tuple[Path, ...] | None,
        arg(help="Print one JSON document instead of tables; with a FILE, write it there and print the tables."),
    ] = None

    def run(self) -> int:
        """Measures, writes `bench-<what>.json`, `.md` and, for the simulator, `.png` into `out`; progress to stderr.

        Raises:
            PersonalVizError: A place cannot be written; checked before anything is measured.
        """
        if self.parts and self.what != "study":
            raise PersonalVizError(
                f"bench {self.what}: --parts is {' '.join(self.parts)}; expected none, because only bench study has "
                "parts. Leave it out."
            )
        if self.json and len(self.json) > 1:
            raise PersonalVizError(f"--json: found {len(self.json)} files; expected at most one. Give one.")
        for folder in (self.out, *(path.parent for path in self.json or ())):
            require_folder(folder, "--out or --json")
        report = self._measured()
        written = self._written(report)
        if self.json == ():
            print(_document(report), end="")
            return 0
        _print_tables(report)
        print(f"Written to {', '.join(map(str, written))}")
        return 0

    def _measured(self) -> "Report":
        benchmark = _benchmark(self.what)
        settings = benchmark.QUICK if self.quick else benchmark.FULL
        more = {"parts": self.parts} if self.parts else {}
        return run_benchmark(
            self.what, lambda: benchmark.measure(settings, say, **more), benchmark.PLAN, quick=self.quick
        )

    def _written(self, report: "Report") -> list[Path]:
        """Writes the report's files and returns their paths."""
        document = _document(report)
        files: dict[Path, str | bytes] = {
            self.out / f"bench-{self.what}.json": document,
            self.out / f"bench-{self.what}.md": markdown(report),
        }
        if self.what == "sim":
            from ..bench.sim.plot import frame_time_png

            files[self.out / "bench-sim.png"] = frame_time_png(report)
        for path, content in (files | dict.fromkeys(self.json or (), document)).items():
            with writing(path, "--out or --json"):
                write_whole(path, content)
        return [*files, *(self.json or ())]


def _benchmark(what: str) -> ModuleType:
    """The module of a benchmark, as `bench/harness.py` says."""
    match what:
        case "sim":
            from ..bench.sim import simulator as benchmark
        case "recordings":
            from ..bench import recordings as benchmark
        case "grounding":
            from ..bench import grounding as benchmark
        case "agents":
            from ..bench import agents as benchmark
        case "scale":
            from ..bench import scale as benchmark
        case "robot":
            from ..bench.robot import figures as benchmark
        case _:
            from ..bench.study import parts as benchmark
    return benchmark


def _document(report: "Report") -> str:
    return json_format.dumps(report.document(), indent=2, ensure_ascii=False) + "\n"


def _print_tables(report: "Report") -> None:
    for title, (heads, *lines) in tables(report):
        print_table(title, [head.replace(" cluttered", "\ncluttered") for head in heads], lines)
    print(f"Machine: {machine_line(report.machine)}")
    for problem in report.problems:
        print(f"Problem: {problem}")
    if report.left_out:
        print(f"Left out of this run: {', '.join(report.left_out)}")
    print(f"{report.seconds:.0f} s")
