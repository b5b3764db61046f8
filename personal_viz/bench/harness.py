"""Shared by all benchmarks: interleaved timing, figures beside references and targets, one table, one JSON format.

A benchmark is a module with a `PLAN`, the settings `FULL` and `QUICK`, and `measure(settings, progress)`, which returns
`Findings`: its values are a nested dict of names. `run_benchmark` makes a `Report` of them: each number becomes a
`Figure` whose name is the path to it (`sizes.1M.rgbd_ms`); figures whose paths differ only in the last part are a case
(`sizes.1M`).
"""

import contextlib
import datetime
import math
import os
import platform
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import psutil
from pydantic import BaseModel, ConfigDict

from human_study.export.text_tables import markdown_table
from sim.cache import VARIABLE
from sim.render.raycast import own_cores
from sim.tasks.provenance import git_commit, package_versions

InputKind = Literal["released", "invented"]
RELEASE = Path(__file__).parents[3] / "shared/personal-dataset/split"
"""Folder of the released episodes, beside the repository."""
Progress = Callable[[str], None]
"""Callback that gets lines about the current work."""
Values = Mapping[str, Any]
"""Numbers, None for numbers that could not be measured, and mappings of these; anything else is not a figure."""
_UNITS = {
    "_ms": "ms",
    "_us": "us",
    "_mm": "mm",
    "_per_s": "1/s",
    "_s": "s",
    "_mb": "MB",
    "_megabytes": "MB",
    "_percent": "%",
}
"""Unit by the end of a name, or of its case; the first that fits is used."""


class Target(NamedTuple):
    """The limit that a figure has to meet."""

    limit: float
    at_least: bool = False
    goal: str = ""
    """A better value that we hope for, in words."""

    @property
    def words(self) -> str:
        """The target in words, such as `<= 1.7 (goal 1.5)`."""
        return f"{'>=' if self.at_least else '<='} {number(self.limit)}{f' (goal {self.goal})' if self.goal else ''}"

    def is_met_by(self, value: float) -> bool:
        """Whether the value meets the target; the limit itself does."""
        return value >= self.limit if self.at_least else value <= self.limit


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Figure(_Model):
    """One number that was measured, or not."""

    name: str
    value: float | None
    """None = not measured in this run."""
    unit: str
    reference: float | None = None
    """Value that was measured in the same run for comparison."""
    reference_name: str = ""
    target: str = ""
    """The target in words; empty = there is none."""
    met: bool | None = None

    @property
    def case(self) -> str:
        """The name without its last part."""
        return self.name.rpartition(".")[0]


class Machine(_Model):
    """The machine and the versions on which the figures depend."""

    cpu: str
    cores: int
    """Number of processors that this process may use."""
    load: float
    """The machine's load average in the minute before the measurement: others work on it too."""
    python: str
    versions: dict[str, str]
    """Versions of the packages on which figures may depend."""


class Report(_Model):
    """The results of a benchmark. `document` is its JSON."""

    benchmark: str
    quick: bool
    values: dict[str, Any]
    figures: tuple[Figure, ...]
    machine: Machine
    notes: tuple[str, ...]
    """How the figures were measured."""
    left_out: tuple[str, ...]
    """Parts of the full benchmark that this run left out."""
    problems: tuple[str, ...]
    created_utc: str
    git_commit: str | None
    seconds: float
    """Elapsed seconds of the whole run."""

    def document(self) -> dict[str, Any]:
        """The JSON document: the values at the top, then all other fields."""
        fields = self.model_dump(mode="json")
        return {"benchmark": self.benchmark, **fields.pop("values"), **fields}

    def missed(self) -> list[str]:
        """Names of the figures that miss their targets."""
        return [figure.name for figure in self.figures if figure.met is False]


class Plan(NamedTuple):
    """Targets, references and units of a benchmark's figures."""

    targets: Mapping[str, Target] = {}
    """Targets by name. A name that is not among the values is reported as not measured, if its first part is there."""
    references: Mapping[str, str] = {}
    """Last part of a figure's name -> last part of the name of its reference, which is in the same case."""
    units: Mapping[str, str] = {}
    """Units by the end of a name, or by its case, if the name does not tell the unit."""


class Findings(NamedTuple):
    """The results of a benchmark's work."""

    values: Values
    notes: Sequence[str] = ()
    """How the figures were measured."""
    left_out: Sequence[str] = ()
    """Parts of the full benchmark that this run left out."""
    problems: Sequence[str] = ()
    versions: Mapping[str, str] = {}
    """Further versions on which the figures depend."""
    seconds: float | None = None
    """Elapsed seconds of the whole run, if they count from another moment than the start of the benchmark."""


def run_benchmark(benchmark: str, measure: Callable[[], Findings], plan: Plan, *, quick: bool) -> Report:
    """Measures, and makes a report with a figure for each number in the values.

    Args:
        benchmark: Name of the benchmark.
        measure: Does the work.
        plan: Targets, references and units.
        quick: Written into the report.
    """
    here, began_s = _machine(), time.perf_counter()
    found = measure()
    numbers = dict(_numbers(found.values, ""))
    targets = [name for name in plan.targets if name.partition(".")[0] in found.values]
    return Report(
        benchmark=benchmark,
        quick=quick,
        values=dict(found.values),
        figures=tuple(_figure(name, numbers, plan) for name in dict.fromkeys((*numbers, *targets))),
        machine=here.model_copy(update={"versions": here.versions | dict(found.versions)}),
        notes=tuple(found.notes),
        left_out=tuple(found.left_out),
        problems=tuple(found.problems),
        created_utc=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        git_commit=git_commit(),
        seconds=time.perf_counter() - began_s if found.seconds is None else found.seconds,
    )


def tables(report: Report) -> Iterator[tuple[str, list[list[str]]]]:
    """Yields (title, rows) of each table, the header row first: the targets, then the figures with a column per case.

    Cases with the same figures share a table; a case without any measurement is left out.
    """
    targets = [figure for figure in report.figures if figure.target]
    words = {True: "yes", False: "NO", None: "not measured"}
    rows = [[one.name, one.target, number(one.value), words[one.met]] for one in targets]
    if rows:
        yield "Targets", [["figure", "target", "found", "met"], *rows]
    cases: dict[str, dict[str, Figure]] = {}
    for figure in report.figures:
        cases.setdefault(figure.case, {})[figure.name.rpartition(".")[2]] = figure
    groups: dict[tuple[str, ...], list[str]] = {}
    for case, figures in cases.items():
        if any(figure.value is not None for figure in figures.values()):
            groups.setdefault(tuple(figures), []).append(case)
    for names, alike in groups.items():
        first = cases[alike[0]]
        body = [[name, first[name].unit, *(number(cases[case][name].value) for case in alike)] for name in names]
        yield "Figures", [["figure", "unit", *(case or "found" for case in alike)], *body]


def markdown(report: Report) -> str:
    """The report as a Markdown page."""
    lines = [f"# Benchmark {report.benchmark}{' (quick)' if report.quick else ''}", ""]
    lines += [f"{report.created_utc}, commit {report.git_commit or 'unknown'}, {report.seconds:.0f} s.", ""]
    lines += [f"- {line}" for line in (machine_line(report.machine), *report.notes)]
    lines += [f"- Left out of this run: {', '.join(report.left_out)}"] if report.left_out else []
    for title, rows in tables(report):
        lines += ["", f"## {title}", "", markdown_table(rows[0], rows[1:], num_text=1)]
    if report.problems:
        lines += ["", "## Problems", "", *(f"- {problem}" for problem in report.problems)]
    return "\n".join([*lines, ""])


def machine_line(machine: Machine) -> str:
    """Processor, load and versions in one line for people."""
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    return f"{machine.cpu}, {machine.cores} cores, load {machine.load:.1f}; Python {machine.python}, {versions}"


def number(value: float | None) -> str:
    """The value with at most four significant digits and grouped thousands; `-` for None."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


class Timing(NamedTuple):
    """Medians over the measured calls of one function."""

    core_s: float
    """CPU seconds of all threads of this process."""
    wall_s: float
    """Elapsed seconds."""


def interleaved(
    work: Mapping[str, Callable[[int], object]], *, calls: int, rounds: int = 1, warm_ups: int = 2
) -> dict[str, Timing]:
    """Median time per call of each function, called in turn, so that a slow moment of the machine affects all of them.

    Args:
        work: Functions of a call's number k in [0, calls); the same k means the same input for all functions.
        calls: Number of different inputs.
        rounds: How many times to go through all inputs.
        warm_ups: Number of calls of each function before the measurement.
    """
    for k in range(min(warm_ups, calls)):
        for function in work.values():
            function(k)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for _ in range(rounds):
        for k in range(calls):
            for name, function in work.items():
                wall, core = time.perf_counter(), time.process_time()
                function(k)
                found[name].append((time.process_time() - core, time.perf_counter() - wall))
    return {name: Timing(*(float(value) for value in np.median(times, axis=0))) for name, times in found.items()}


def since_process_start_s() -> float:
    """Elapsed seconds since this process began."""
    return time.time() - psutil.Process().create_time()


def peak_mb(process: psutil.Process) -> float:
    """The largest resident memory of a process so far, MB of 10^6 bytes; the current one if only that is known."""
    now_mb = process.memory_info().rss / 1e6
    with contextlib.suppress(OSError), open(f"/proc/{process.pid}/status") as file:
        for line in file:
            if line.startswith("VmHWM"):  # updated lazily: may be a little below the current one
                return max(int(line.split()[1]) * 1024 / 1e6, now_mb)
    return now_mb


def resident_mb(processes: Iterable[psutil.Process]) -> float:
    """Resident memory of some processes together, MB of 10^6 bytes; one that has ended counts nothing."""
    total_mb = 0.0
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            total_mb += process.memory_info().rss / 1e6
    return total_mb


def held_by(pid: int) -> dict[str, float]:
    """Resources that a serving process and its children hold now; a process that ends meanwhile does not count.

    Returns:
        Sums: `processes`, `fds` (open file descriptors), `threads`, `clients` (established TCP connections of the
        children: viser's clients), `rss_mb` (resident memory, MB of 10^6 bytes; pages that processes share count in
        each), `peak_mb` (the largest that each of the processes ever had).
    """
    held = Counter[str](processes=0, fds=0, threads=0, clients=0)
    with contextlib.suppress(psutil.NoSuchProcess):
        serving = psutil.Process(pid)
        for process in (serving, *serving.children()):
            with contextlib.suppress(psutil.NoSuchProcess):
                connections = process.net_connections("tcp") if process.pid != pid else []
                established = sum(connection.status == psutil.CONN_ESTABLISHED for connection in connections)
                held.update(processes=1, fds=process.num_fds(), threads=process.num_threads(), clients=established)
                held.update(rss_mb=process.memory_info().rss / 1e6, peak_mb=peak_mb(process))  # pyright: ignore
    return dict(held)


@contextlib.contextmanager
def empty_cache() -> Iterator[Path]:
    """Yields a new folder whose `cache` is the program's cache in the block, here and in processes started there."""
    before = os.environ.get(VARIABLE)
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as name:
        cache = Path(name) / "cache"
        cache.mkdir()
        os.environ[VARIABLE] = str(cache)
        try:
            yield Path(name)
        finally:
            os.environ.pop(VARIABLE)
            if before is not None:
                os.environ[VARIABLE] = before


@contextlib.contextmanager
def episodes_at_hand() -> Iterator[tuple[InputKind, Path]]:
    """Yields the folder of the released episodes, or of those of an invented home where they are missing."""
    if RELEASE.is_dir():
        yield "released", RELEASE
        return
    from sim.authoring.generation import invent_dataset  # takes half a second to import, for this case only

    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as name:
        invent_dataset(Path(name), name="Bench", seed=3)
        yield "invented", Path(name)


def _machine() -> Machine:
    return Machine(
        cpu=_cpu_model(),
        cores=own_cores(),
        load=psutil.getloadavg()[0],
        python=platform.python_version(),
        versions=package_versions(),
    )


def _numbers(values: Values, path: str) -> Iterator[tuple[str, float | None]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _numbers(value, f"{path}{name}.")
        elif value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
            yield f"{path}{name}", value


def _figure(name: str, found: Mapping[str, float | None], plan: Plan) -> Figure:
    case, _, end = name.rpartition(".")
    target, value = plan.targets.get(name), found.get(name)
    reference = f"{case}.{plan.references[end]}".lstrip(".") if end in plan.references else ""
    unit = plan.units.get(case) or plan.units.get(end) or _unit_of(end) or _unit_of(case)
    return Figure(
        name=name,
        value=value,
        unit=unit,
        reference=found.get(reference),
        reference_name=reference,
        target=target.words if target else "",
        met=None if target is None or value is None else target.is_met_by(value),
    )


def _unit_of(name: str) -> str:
    return next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), "")


def _cpu_model() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()
