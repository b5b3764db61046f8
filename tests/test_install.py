"""What `make` installs, what it says about that, and that the lock files hold every requirement."""

import importlib.util
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
LOCKS = ("requirements.lock", "requirements-torch.lock", "requirements-cuda.lock")
PINNED = re.compile(r"^([\w.-]+)==(\S+)(?: ; (.*?))? \\$", re.MULTILINE)
NO_CPU_BUILD = (1, "ERROR: No matching distribution found for torch==2.13.0+cpu", 0.0)


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The script as a module that sees Linux and neither a driver nor torch nor TORCH_INDEX."""
    spec = importlib.util.spec_from_file_location("install", ROOT / ".ci" / "install.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(module, "LOG", tmp_path / "pip.log")
    monkeypatch.setattr(module.sys, "platform", "linux")
    monkeypatch.setattr(module.sys, "argv", ["install.py"])
    monkeypatch.setattr(module, "has_nvidia_driver", lambda: False)
    monkeypatch.setattr(module, "has_torch", lambda: False)
    monkeypatch.setattr(module, "compile_for_tests", lambda: 0)
    monkeypatch.delenv("TORCH_INDEX", raising=False)
    return module


def asked(install: ModuleType, monkeypatch: pytest.MonkeyPatch, probe: tuple[int, str, float]) -> list[list[str]]:
    """The arguments of each call of pip, in order, when the search for a build without CUDA ends with `probe`."""
    commands: list[list[str]] = []

    def run_pip(arguments: list[str]) -> tuple[int, str, float]:
        commands.append([argument for argument in arguments if argument not in ("install", "--no-compile")])
        return probe if "--dry-run" in arguments else (0, "", 0.0)

    monkeypatch.setattr(install, "run_pip", run_pip)
    assert install.main() == 0
    return commands


def test_without_a_driver_torch_is_installed_without_cuda_if_such_a_build_exists(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = asked(install, monkeypatch, (0, "Would install torch-2.13.0+cpu", 0.0))
    assert commands[-1] == ["-c", "constraints.txt", f"torch=={install.pinned_torch()}+cpu", "-e", "."]
    assert "TORCH_INDEX" not in capsys.readouterr().out


def test_if_only_a_cuda_build_exists_a_line_says_how_many_megabytes_another_index_would_save(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = asked(install, monkeypatch, NO_CPU_BUILD)
    assert ["--dry-run" in command for command in commands] == [True, False]
    assert commands[-1] == ["-c", "constraints.txt", "-e", "."]
    assert re.search(r"TORCH_INDEX=<.*> would save 2\d\d\d MB of them\n", capsys.readouterr().out)


def test_cuda_is_not_mentioned_when_pip_reaches_no_index(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    unreached = "ERROR: Could not find a version (from versions: none)\n" + NO_CPU_BUILD[1]
    asked(install, monkeypatch, (1, unreached, 0.0))
    assert "CUDA" not in capsys.readouterr().out


def test_with_a_driver_pip_chooses_the_build(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install, "has_nvidia_driver", lambda: True)
    assert asked(install, monkeypatch, NO_CPU_BUILD) == [["-c", "constraints.txt", "-e", "."]]


def test_only_torch_comes_from_the_named_index(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCH_INDEX", "https://index.invalid/cpu")
    first = asked(install, monkeypatch, NO_CPU_BUILD)[0]
    assert " ".join(first) == "-c constraints.txt --no-deps --index-url https://index.invalid/cpu torch"


def test_the_locks_are_installed_with_every_digest_checked(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(install.sys, "argv", ["install.py", "--locked"])
    for needs_cuda in (False, True):
        monkeypatch.setattr(install, "wants_cuda", lambda needs_cuda=needs_cuda: needs_cuda)
        commands = [command for command in asked(install, monkeypatch, NO_CPU_BUILD) if "--dry-run" not in command]
        assert commands[-1] == ["--no-deps", "--no-build-isolation", "-e", "."]
        assert all({"--require-hashes", "--no-deps", "-r"} <= set(command) for command in commands[:-1])
        assert [command[-1] for command in commands[:-1]] == list(LOCKS if needs_cuda else LOCKS[:2])


def test_the_locks_install_no_cuda_either(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install.sys, "argv", ["install.py", "--locked"])
    monkeypatch.setattr(install, "wants_cuda", lambda: False)
    commands = asked(install, monkeypatch, (0, "Would install torch-2.13.0+cpu", 0.0))
    (torch,) = (command for command in commands if command[-1] == "requirements-torch.lock")
    assert Path(torch[torch.index("-c") + 1]).read_text() == f"torch=={install.pinned_torch()}+cpu"


def test_a_failure_shows_the_error_without_pips_warnings(
    install: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    noise = "WARNING: Location 'file:///opt/nowhere/' is ignored: it is neither a file nor a directory."
    script = f"import sys; [print({noise!r}) for _ in range(300)]; print('ERROR: the disk is full'); sys.exit(1)"
    real = subprocess.Popen
    monkeypatch.setattr(install.subprocess, "Popen", lambda _, **how: real([sys.executable, "-c", script], **how))
    assert install.pip(["install", "x"]) == 1
    said = capsys.readouterr().err
    assert said.endswith("  ERROR: the disk is full\n")
    assert str(install.LOG) in said
    assert "is ignored" not in said
    assert install.LOG.read_text().count("is ignored") == 300


def locked(name: str) -> dict[str, str]:
    """Locked version of each package, by package name."""
    return {canonicalize_name(package): version for package, version, _ in PINNED.findall((ROOT / name).read_text())}


def test_every_requirement_is_locked_at_the_version_in_constraints() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["test"]]
    for extra in Requirement(next(text for text in extras["test"] if "personal-viz" in text)).extras:
        wanted += extras[extra]
    names = {canonicalize_name(Requirement(text).name) for text in wanted} - {"personal-viz"}
    found = {name: version for lock in LOCKS for name, version in locked(lock).items()}
    assert names - set(found) == set(), "run .ci/lock"
    lines = re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    pinned = {canonicalize_name(name): version for name, version in lines}
    assert {name: version for name, version in found.items() if pinned.get(name, version) != version} == {}
    assert set(locked("requirements.lock")) & {"torch", "triton"} == set()
    assert list(locked("requirements-torch.lock")) == ["torch"]


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_holds_digests_and_names_no_host(lock: str) -> None:
    text = (ROOT / lock).read_text()
    blocks = re.split(r"^(?=[\w.-]+==)", text, flags=re.MULTILINE)[1:]
    assert blocks
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}\b", block) for block in blocks)
    assert len(blocks) == len(PINNED.findall(text))
    assert "://" not in text


def test_torch_is_locked_for_many_platforms() -> None:
    assert (ROOT / "requirements-torch.lock").read_text().count("--hash=") >= 20
