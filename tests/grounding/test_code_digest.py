"""Which of our code is part of explorations and maps of homes, so that its change makes them anew."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from grounding import code_digest
from grounding.code_digest import MAPS, POLICY, files_of, map_digest, policy_digest

HERE = Path(code_digest.__file__).parent


def names(patterns: tuple[str, ...]) -> set[str]:
    return {path.relative_to(HERE).as_posix() for path in files_of(patterns)}


@pytest.mark.parametrize("pattern", MAPS)
def test_every_pattern_finds_a_module(pattern: str) -> None:
    assert files_of((pattern,)), "moved? its code would no longer count"


def test_all_of_our_code_that_an_exploration_runs_is_in_its_digest() -> None:
    script = "import sys, grounding.explore; print(*[n for n in sys.modules if n.startswith('grounding.')])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=HERE.parent)
    loaded = {name.removeprefix("grounding.").replace(".", "/") for name in done.stdout.split()}
    modules = {f"{name}.py" for name in loaded if (HERE / f"{name}.py").is_file()}
    assert modules - names(POLICY) == {"code_digest.py"}


def test_a_map_counts_what_makes_it_and_nothing_that_asks_it() -> None:
    ours = names(MAPS)
    assert names(POLICY) < ours
    assert {"maps/cell_sums.py", "mapping.py", "encoding/oracle_perception.py", "oracle/texts.py"} < ours
    assert not [name for name in ours if name.startswith(("pog/", "methods/", "phrasing/", "robot/", "checks/"))]
    assert not {"rpg.py", "baselines.py", "evaluate.py", "phrases.py", "oracle/noise.py"} & ours


def test_a_digest_changes_with_its_own_modules_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / "grounding"
    shutil.copytree(HERE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(code_digest, "_HERE", copy)

    def digests() -> tuple[str, str]:
        return policy_digest.__wrapped__(), map_digest.__wrapped__()

    policy, maps = digests()
    assert (policy, maps) == (policy_digest(), map_digest()), "the same text elsewhere counts as the same"
    (copy / "pog" / "table.py").write_text("changed")
    assert digests() == (policy, maps)
    (copy / "mapping.py").write_text("changed")
    assert digests()[0] == policy
    assert digests()[1] != maps
    (copy / "exploring" / "coverage.py").write_text("changed")
    assert digests()[0] != policy
