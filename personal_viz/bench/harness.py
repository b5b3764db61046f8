"""What all benchmarks share: times side by side, figures beside references and targets, one table, one JSON format.

A benchmark returns values, as a nested dict of names. `report_of` makes a `Report` of them: each number becomes a
`Figure` whose name is the path to it (`sizes.1M.rgbd_ms`); figures of one path but its end are a case (`sizes.1M`).
"""

import asyncio
import contextlib
import datetime
import math
import os
import platform
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from pydantic import BaseModel, ConfigDict

from sim.cache import VARIABLE
from sim.render.raycast import own_cores
from sim.tasks.provenance import git_commit, package_versions

Progress = Callable[[str], None]
"""Told what is being done, one line at a time."""
Values = Mapping[str, Any]
"""Numbers, None for those that could not be measured, and mappings of such; anything else is no figure."""
_UNITS = {
    "_ms": "ms",
    "_us": "us",
    "_mm": "mm",
    "_per_s": "1/s",
    "_s": "s",
    "_mb": "MB",
    "_megabytes": "MB",
}
"""Unit by the end of a name, or of its case; the first that fits."""


class Target(NamedTuple):
    """What a figure has to reach."""

    limit: float
    at_least: bool = False
    goal: str = ""
    """What more is hoped for, in words."""

    @property
    def words(self) -> str:
        """`<= 1.7 (goal 1.5)`."""
        return f"{'>=' if self.at_least else '<='} {number(self.limit)}{f' (goal {self.goal})' if self.goal else ''}"

    def is_met_by(self, value: float) -> bool:
        """The limit itself is enough."""
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
    """What was measured in the same run for comparison."""
    reference_name: str = ""
    target: str = ""
    """In words; empty = there is none."""
    met: bool | None = None

    @property
    def case(self) -> str:
        """All of the name but its end."""
        return self.name.rpartition(".")[0]


class Machine(_Model):
    """What the figures depend on besides the code."""

    cpu: str
    cores: int
    """Processors that this process may use."""
    load: float
    """The machine's load average of the last minute before anything was measured: others work on it too."""
    python: str
    versions: dict[str, str]
    """Of the packages that figures may depend on."""


class Report(_Model):
    """What a benchmark found. `document` is its JSON."""

    benchmark: str
    quick: bool
    values: dict[str, Any]
    figures: tuple[Figure, ...]
    machine: Machine
    notes: tuple[str, ...]
    """How it was measured."""
    left_out: tuple[str, ...]
    """What the full benchmark has and this run has not."""
    problems: tuple[str, ...]
    created_utc: str
    git_commit: str | None
    seconds: float
    """Elapsed, of the whole run."""

    def document(self) -> dict[str, Any]:
        """As JSON has it: the values at the top, then all other fields."""
        fields = self.model_dump(mode="json")
        return {"benchmark": self.benchmark, **fields.pop("values"), **fields}

    def missed(self) -> list[str]:
        """Names of the figures that miss their targets."""
        return [figure.name for figure in self.figures if figure.met is False]


class Plan(NamedTuple):
    """What a benchmark says of its figures."""

    targets: Mapping[str, Target] = {}
    """By name. One that is not among the values is reported as not measured."""
    references: Mapping[str, str] = {}
    """By the end of a figure's name: the end of the name, in the same case, of what it is compared with."""
    units: Mapping[str, str] = {}
    """By the end of a name, or by its case, where these do not tell."""


def report_of(
    benchmark: str,
    values: Values,
    plan: Plan,
    *,
    quick: bool,
    machine: Machine,
    seconds: float,
    notes: Sequence[str] = (),
    left_out: Sequence[str] = (),
    problems: Sequence[str] = (),
) -> Report:
    """Makes a figure of each number."""
    found = dict(_numbers(values, ""))
    return Report(
        benchmark=benchmark,
        quick=quick,
        values=dict(values),
        figures=tuple(_figure(name, found, plan) for name in dict.fromkeys((*found, *plan.targets))),
        machine=machine,
        notes=tuple(notes),
        left_out=tuple(left_out),
        problems=tuple(problems),
        created_utc=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        git_commit=git_commit(),
        seconds=seconds,
    )


def machine(**versions: str) -> Machine:
    """This machine now, with further versions."""
    return Machine(
        cpu=_cpu_model(),
        cores=own_cores(),
        load=psutil.getloadavg()[0],
        python=platform.python_version(),
        versions=package_versions() | versions,
    )


def tables(report: Report) -> Iterator[tuple[str, list[list[str]]]]:
    """(title, rows with their heads first): the targets, then the figures, a column per case.

    Cases with the same figures share a table; one of which nothing was measured has none.
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
        lines += ["", f"## {title}", "", *markdown_table(rows)]
    if report.problems:
        lines += ["", "## Problems", "", *(f"- {problem}" for problem in report.problems)]
    return "\n".join([*lines, ""])


def machine_line(machine: Machine) -> str:
    """Processor, load and versions, for people."""
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    return f"{machine.cpu}, {machine.cores} cores, load {machine.load:.1f}; Python {machine.python}, {versions}"


def markdown_table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Markdown of rows whose first are the heads."""
    heads, *others = rows
    rule = "|".join(["---"] + ["---:"] * (len(heads) - 1))
    return [f"| {' | '.join(heads)} |", f"|{rule}|", *(f"| {' | '.join(row)} |" for row in others)]


def number(value: float | None) -> str:
    """At most four significant digits, thousands grouped; `-` where there is none."""
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
    """Median time per call of each function, called in turn, so that a slow moment of the machine meets all of them.

    Args:
        work: Functions of a call's number k in [0, calls); the same k means the same input for all.
        calls: Different inputs.
        rounds: How often all inputs are gone through.
        warm_ups: Calls of each function before, which are not measured.
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


class Budget:
    """Time until the last part of a run must have ended, from the start of its process: imports and compiling count."""

    def __init__(self, limit_s: float | None) -> None:
        """Counts from the process's start.

        Args:
            limit_s: Elapsed seconds; None = no limit.
        """
        self._end = math.inf if limit_s is None else time.perf_counter() + limit_s - since_process_start_s()

    @property
    def left_s(self) -> float:
        """Seconds left, inf without a limit; never below 0."""
        return max(self._end - time.perf_counter(), 0.0)

    def has(self, need_s: float) -> bool:
        """Whether a part of this many seconds can begin and end in time; without a limit always."""
        return 0 < self.left_s >= need_s


def since_process_start_s() -> float:
    """Elapsed seconds since this process began."""
    return time.time() - psutil.Process().create_time()


def peak_mb(process: psutil.Process) -> float:
    """The largest resident memory of a process so far, MB of 10^6 bytes; the present one where only that is known."""
    resident_mb = process.memory_info().rss / 1e6
    with contextlib.suppress(OSError), open(f"/proc/{process.pid}/status") as file:
        for line in file:
            if line.startswith("VmHWM"):  # updated lazily: may stand a little below the present one
                return max(int(line.split()[1]) * 1024 / 1e6, resident_mb)
    return resident_mb


@contextlib.contextmanager
def background_loop(name: str) -> Iterator[asyncio.AbstractEventLoop]:
    """An event loop on a thread of its own; what still runs in it at the block's end is cancelled."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True, name=name)
    thread.start()
    try:
        yield loop
    finally:
        asyncio.run_coroutine_threadsafe(_cancel_all(), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _cancel_all() -> None:
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)


@contextlib.contextmanager
def empty_cache() -> Iterator[Path]:
    """A new folder whose `cache` is the program's cache in the block, here and in processes that are started there."""
    before = os.environ.get(VARIABLE)
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as name:
        os.environ[VARIABLE] = f"{name}/cache"
        try:
            yield Path(name)
        finally:
            os.environ.pop(VARIABLE)
            if before is not None:
                os.environ[VARIABLE] = before


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
