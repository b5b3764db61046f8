"""`personal-viz ... | head`: no verb ends with a traceback when nobody reads its output any more."""

import io
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from personal_viz.__main__ import main
from personal_viz.cli.validate import Validate
from personal_viz.cli.verbs import VERBS
from sim.errors import DatasetError

COMMAND = [sys.executable, "-m", "personal_viz"]


@pytest.fixture
def lost() -> Iterator[io.TextIOWrapper]:
    """A stream into a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream:
        yield stream


@pytest.mark.parametrize("verb", [[], ["study"], *map(str.split, VERBS)], ids=" ".join)
def test_help_of_every_verb_ends_in_silence(
    verb: list[str], lost: io.TextIOWrapper, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["personal-viz", *verb, "--help"])
    monkeypatch.setattr(sys, "stdout", lost)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 141
    lost.flush()  # as Python does at its end


@pytest.mark.parametrize("arguments", [["nonsense"], ["validate", "--dataset", "/nowhere"]], ids=" ".join)
def test_errors_that_nobody_reads_end_in_silence(
    arguments: list[str], lost: io.TextIOWrapper, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("stdout", "stderr"):  # 2>&1 | head
        monkeypatch.setattr(sys, name, lost)
    monkeypatch.setattr(sys, "argv", ["personal-viz", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 141
    lost.flush()


def test_a_broken_pipe_of_our_own_is_a_bug(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(_: object) -> int:
        raise BrokenPipeError("a worker's")

    monkeypatch.setattr(Validate, "run", run)
    monkeypatch.setattr(sys, "argv", ["personal-viz", "validate", "--dataset", "x"])
    with pytest.raises(BrokenPipeError, match="a worker's"):
        main()


def test_exit_codes_stay_while_somebody_reads(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    def fail(_: object) -> int:
        raise DatasetError("x: is\nmissing")

    for run, code in ((lambda _: 3, 3), (fail, 1)):
        monkeypatch.setattr(Validate, "run", run)
        monkeypatch.setattr(sys, "argv", ["personal-viz", "validate", "--dataset", "x"])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == code
    assert capsys.readouterr().err == "personal-viz: x: is missing\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [["stats", "--json"], ["validate", "--json"], ["run", "--agent", "random", "--limit", "2"]],
    ids=" ".join,
)
def test_a_long_output_cut_short_leaves_no_traceback(arguments: list[str], demo_root: Path, tmp_path: Path) -> None:
    verb = [*COMMAND, arguments[0], "--dataset", str(demo_root), *arguments[1:]]
    with subprocess.Popen(verb, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        said = process.stderr.read()
    assert process.returncode == 141
    assert "Traceback" not in said
    assert "BrokenPipe" not in said
