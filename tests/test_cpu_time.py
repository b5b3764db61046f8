"""Too much CPU time fails a run, waiting does not; what hangs is named; long files run first; homes are built once."""

import os
from multiprocessing import get_context
from pathlib import Path

import pytest

from .built_once import built_once
from .cpu_time import CpuTimes

pytest_plugins = ["pytester"]

CONFTEST = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from tests.cpu_time import CpuTimes, long_files_first

def pytest_configure(config):
    config.pluginmanager.register(CpuTimes(shown_s=0.2, limit_s=0.5))
    config.addinivalue_line("markers", "slow: long")
    config.option.loadscopereorder = False

def pytest_collection_modifyitems(items):
    long_files_first(items)
"""
BURN = """
import subprocess, sys, time
import pytest

def burn(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
"""


@pytest.fixture(autouse=True)
def no_other_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plugins of other packages take a second to import."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")


def run(
    pytester: pytest.Pytester, tests: str, *arguments: str, conftest: str = CONFTEST, **files: str
) -> pytest.RunResult:
    """Runs these tests with limits of 0.2 s (printed) and 0.5 s (failed)."""
    pytester.makeconftest(conftest)
    pytester.makepyfile(test_few=BURN + tests, **{name: BURN + text for name, text in files.items()})
    return pytester.runpytest_inprocess("-p", "no:cacheprovider", "-p", "xdist.plugin", *arguments)


@pytest.mark.parametrize("workers", [(), ("-n", "2", "--dist", "loadfile")], ids=["one process", "workers"])
def test_an_unmarked_test_that_computes_for_too_long_fails_the_run(
    pytester: pytest.Pytester, workers: tuple[str, ...]
) -> None:
    tests = """
def test_long(): burn(0.7)
def test_middling(): burn(0.3)
def test_short(): pass
"""
    done = run(pytester, tests, *workers)
    done.assert_outcomes(passed=3)
    assert done.ret == pytest.ExitCode.TESTS_FAILED
    shown = [line.rpartition("::")[2] for line in done.outlines if " s of CPU in " in line]
    assert shown == ["test_long", "test_middling"]
    done.stdout.fnmatch_lines(["FAILED: 1 unmarked tests took more than 0.5 s of CPU time; *"])


def test_fixtures_and_ended_children_count(pytester: pytest.Pytester) -> None:
    tests = """
@pytest.fixture
def home(): burn(0.7)

def test_fixture(home): pass

def test_child():
    subprocess.run([sys.executable, "-c", "sum(range(80_000_000))"])
"""
    done = run(pytester, tests)
    assert done.ret == pytest.ExitCode.TESTS_FAILED
    assert {line.rpartition("::")[2] for line in done.outlines if " s of CPU in " in line} == {
        "test_fixture",
        "test_child",
    }
    done.stdout.fnmatch_lines(["FAILED: 2 unmarked tests took *"])


def test_an_older_child_that_ends_during_a_short_test_does_not_make_it_long() -> None:
    times = CpuTimes(limit_s=1.0)
    report = pytest.TestReport(
        "test_short", ("", 0, ""), {}, "passed", None, "teardown", duration=0.01,
        user_properties=[("cpu_s", 900.0), ("markers", "")],
    )  # fmt: skip
    times.pytest_runtest_logreport(report)
    assert times._too_long() == set()


def test_compilation_by_numba_does_not_count(pytester: pytest.Pytester) -> None:
    tests = """
import numba
made = [numba.njit(lambda x, k=k: [x + k for _ in range(k)]) for k in range(2)]

def test_compiles():
    for kernel in made:
        start = time.process_time()
        while time.process_time() < start + 0.6:
            kernel.recompile() if kernel.signatures else kernel(1)
"""
    done = run(pytester, tests)
    done.assert_outcomes(passed=1)
    assert done.ret == pytest.ExitCode.OK, done.outlines


def test_a_test_that_waits_is_printed_but_passes_and_a_marked_test_may_compute_long(pytester: pytest.Pytester) -> None:
    tests = """
def test_waits(): time.sleep(0.7)

@pytest.mark.slow
def test_marked(): burn(0.7)
"""
    done = run(pytester, tests, "--junitxml=times.xml")
    assert done.ret == pytest.ExitCode.OK
    assert [line.rpartition("::")[2] for line in done.outlines if " s of CPU in " in line] == ["test_waits"]
    assert (pytester.path / "times.xml").read_text().count('name="cpu_s"') == 2


def test_files_with_long_tests_come_first_and_stay_together(pytester: pytest.Pytester) -> None:
    tests = "def test_a(): pass\ndef test_b(): pass\n"
    marked = "@pytest.mark.slow\ndef test_c(): pass\ndef test_d(): pass\n"
    more = "pytestmark = pytest.mark.slow\ndef test_e(): pass\ndef test_f(): pass\n"
    done = run(pytester, tests, "-v", test_marked=marked, test_more=more)
    assert [line.split()[0][-1] for line in done.outlines if " PASSED" in line] == list("efcdab")


def fill(folder: Path) -> None:
    (folder / str(os.getpid())).touch()


def test_a_folder_is_built_once_however_many_processes_ask(tmp_path: Path) -> None:
    with get_context("spawn").Pool(2) as pool:
        folders = pool.starmap(built_once, [(tmp_path, "home", fill)] * 8)
    assert set(folders) == {tmp_path / "home"}
    assert len(list((tmp_path / "home").iterdir())) == 1


def test_the_next_process_builds_a_folder_whose_first_build_failed(tmp_path: Path) -> None:
    def fails(folder: Path) -> None:
        fill(folder)
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        built_once(tmp_path, "home", fails)
    assert len(list(built_once(tmp_path, "home", fill).iterdir())) == 1


def test_a_test_whose_fixture_hangs_after_its_failure_is_named(pytester: pytest.Pytester) -> None:
    hangs = """
@pytest.fixture
def deaf():
    yield
    time.sleep(60)

def test_hangs(deaf): assert False
"""
    limit = """
    from tests.hung_tests import EndsHungTests
    config.pluginmanager.register(EndsHungTests(limit_s=4, beyond_s=1))
"""
    conftest = CONFTEST.replace("\n\ndef pytest_collection", f"{limit}\ndef pytest_collection")
    done = run(pytester, hangs, "-n", "1", "--dist", "loadfile", "--max-worker-restart", "0", conftest=conftest)
    assert done.ret == pytest.ExitCode.TESTS_FAILED
    done.stdout.fnmatch_lines(["*worker 'gw0' crashed while running 'test_few.py::test_hangs'*"])
