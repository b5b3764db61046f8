"""`make` says what a machine lacks and how to install it."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / ".ci" / "check_machine.py"


@pytest.fixture
def machine() -> ModuleType:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("check_machine", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_this_machine_is_fine() -> None:
    done = subprocess.run([sys.executable, str(SCRIPT)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(sys.platform != "linux", reason="libraries are checked on Linux only")
def test_missing_libraries_are_named_with_the_command_that_installs_them(
    machine: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(machine.LIBRARIES, "libnowhere.so.9", "libnowhere9")
    monkeypatch.setattr(machine.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(machine.sys, "argv", ["check_machine.py", "--tests"])
    assert machine.main() == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.endswith("apt-get install -y --no-install-recommends libnowhere9\n")


def test_the_demo_needs_no_library_and_no_browser(machine: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "loads", lambda _: False)
    monkeypatch.setattr(machine.shutil, "which", lambda _: None)
    monkeypatch.setattr(machine.sys, "argv", ["check_machine.py"])
    assert machine.main() == 0


def test_root_on_debian_gets_libraries_and_a_browser(machine: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    there, commands = set(), []

    def run(command: str, **_: object) -> subprocess.CompletedProcess:
        commands.append(command)
        there.update(command.split("--no-install-recommends ")[1].split())
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(machine.sys, "platform", "linux")
    monkeypatch.setattr(machine.os, "geteuid", lambda: 0)
    monkeypatch.setattr(machine.subprocess, "run", run)
    monkeypatch.setattr(machine, "loads", lambda library: machine.LIBRARIES[library] in there)
    monkeypatch.setattr(machine.shutil, "which", lambda name: name if name == "apt-get" or name in there else None)
    monkeypatch.setattr(machine.sys, "argv", ["check_machine.py", "--tests"])
    assert machine.main() == 0
    assert ["libgl1" in commands[0], commands[1].endswith(" chromium"), len(commands)] == [True, True, 2]


def test_an_old_python_is_named(machine: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine.sys, "version_info", (3, 9, 1, "final", 0))
    assert "Python 3.9.1; expected 3.11 to 3.14" in machine.python_problem()


def test_without_a_browser_ci_fails_and_a_person_is_told(
    machine: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(machine.shutil, "which", lambda _: None)
    monkeypatch.setattr(machine.os, "geteuid", lambda: 1000)
    monkeypatch.setenv("CI", "true")
    assert "apt-get install -y --no-install-recommends chromium" in machine.browser_problem()
    monkeypatch.setenv("CI", "false")
    assert machine.browser_problem() is None
    assert "chromium" in capsys.readouterr().err
