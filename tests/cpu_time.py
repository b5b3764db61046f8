"""Measures the CPU time of each test, not its wall-clock time, so that no test fails because the machine is busy."""

import os
import sys
from collections import defaultdict
from collections.abc import Generator
from typing import Any

import pytest

SHOWN_S = 5.0
"""Unmarked tests that take longer than this in wall-clock or CPU seconds are printed."""
LIMIT_S = 20.0
"""An unmarked test that takes more CPU seconds than this fails the run."""
MARKERS = ("slow", "browser", "release", "bench", "gpu")
"""A long test carries one of these markers (STYLE.md section 8)."""


def cpu_s() -> float:
    """CPU seconds that this process and its ended children have used so far."""
    return sum(os.times()[:4])


class CpuTimes:
    """A pytest plugin that measures every test with its fixtures; long unmarked tests are printed or fail the run.

    A child process counts for the test in which it ended. Compilation by numba does not count: its result is cached,
    so only the first test in a fresh clone would pay. The JUnit file has the seconds of every test, marked or not, as
    `cpu_s`. Under xdist the workers measure, and the main process applies the limits.
    """

    def __init__(self, *, shown_s: float = SHOWN_S, limit_s: float = LIMIT_S) -> None:
        self._shown_s, self._limit_s = shown_s, limit_s
        self._started = 0.0
        self._compiling: Any = None
        self._clock_s = defaultdict[str, float](float)
        self._cpu_s = dict[str, float]()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self) -> Generator[None, bool, bool]:
        """Notes the CPU time used before the test begins."""
        if self._compiling is None and "numba" in sys.modules:
            self._compiling = _compile_times()
        self._started = self._used_s()
        return (yield)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo) -> None:
        """Sends the time along with the last report of a test."""
        if call.when == "teardown":
            item.user_properties.append(("cpu_s", max(0.0, round(self._used_s() - self._started, 2))))
            item.user_properties.append(("markers", " ".join(markers_of(item))))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keeps the times of unmarked tests; under xdist only the main process keeps them."""
        self._clock_s[report.nodeid] += report.duration
        properties = dict(report.user_properties)
        if report.when == "teardown" and properties.get("markers") == "":
            # a child of an earlier test may end in this one
            most_s = self._clock_s[report.nodeid] * (os.cpu_count() or 1)
            self._cpu_s[report.nodeid] = min(float(str(properties["cpu_s"])), most_s)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Fails a run that passed if an unmarked test took too long."""
        if self._too_long() and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Prints the long unmarked tests, longest first."""
        too_long = self._too_long()
        shown = [test for test, cpu in self._cpu_s.items() if max(cpu, self._clock_s[test]) > self._shown_s]
        if not shown:
            return
        terminalreporter.section(f"unmarked tests over {self._shown_s:g} s")
        for test in sorted(shown, key=lambda test: -self._cpu_s[test]):
            line = f"{self._cpu_s[test]:6.1f} s of CPU in {self._clock_s[test]:.1f} s: {test}"
            terminalreporter.write_line(line, red=test in too_long)
        if too_long:
            terminalreporter.write_line(
                f"FAILED: {len(too_long)} unmarked tests took more than {self._limit_s:g} s of CPU time; "
                "make them faster, or mark them slow or release (pyproject.toml explains both markers).",
                red=True,
            )

    def _used_s(self) -> float:
        return cpu_s() - (self._compiling.total_s if self._compiling else 0.0)

    def _too_long(self) -> set[str]:
        return {test for test, cpu in self._cpu_s.items() if cpu > self._limit_s}


def markers_of(item: pytest.Item) -> list[str]:
    """The markers of `MARKERS` that a test carries."""
    carried = {marker.name for marker in item.iter_markers()}
    return [name for name in MARKERS if name in carried]


def long_files_first(items: list[pytest.Item]) -> None:
    """Puts files with many long tests first, so that no worker starts such a file when the others are done.

    A test with a browser counts as ten.
    """
    marked = defaultdict[object, int](int)
    for item in items:
        carried = markers_of(item)
        marked[item.path] += 10 * ("browser" in carried) + bool(carried)
    items.sort(key=lambda item: -marked[item.path])  # stable: tests of a file stay together and in order


def _compile_times() -> Any:
    """A listener whose `total_s` is the CPU time that numba spends compiling in this process from now on."""
    from numba.core import event

    class CompileTimes(event.Listener):
        total_s, depth, started = 0.0, 0, 0.0

        def on_start(self, event: event.Event) -> None:
            self.started = self.started if self.depth else cpu_s()
            self.depth += 1

        def on_end(self, event: event.Event) -> None:  # a caller's end comes after the ends of its callees
            self.depth -= 1
            self.total_s += 0.0 if self.depth else cpu_s() - self.started

    made = CompileTimes()
    event.register("numba:compile", made)
    return made
