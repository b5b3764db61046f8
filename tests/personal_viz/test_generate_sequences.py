"""`generate --sequences`: a set of home sequences from an edition, which `validate` and `stats` read."""

import json
from pathlib import Path

import pytest

from sim.authoring.sequences.stories import SHARES

from .program import assert_one_line, personal_viz


@pytest.fixture(scope="module")
def made(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """A set of three sequences, and the printed document."""
    out = tmp_path_factory.mktemp("set")
    done = personal_viz("generate", small_home_root, "--sequences", 3, "--seed", 2, "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    return out, json.loads(done.stdout)


def test_a_set_is_written_and_counted(made: tuple[Path, dict[str, object]]) -> None:
    out, printed = made
    assert sorted(path.name for path in out.rglob("*.json*")) == ["Small.json.gz"]
    assert list(printed) == ["sequences", "subtasks", "by_kind", "refused"]
    assert (printed["sequences"], printed["refused"]) == (3, {})
    by_kind = printed["by_kind"]
    assert isinstance(by_kind, dict)
    assert list(by_kind) == list(SHARES)
    assert sum(by_kind.values()) == printed["subtasks"]
    done = personal_viz("validate", "--dataset", out)
    assert "0 files that cannot be used, 0 broken guarantees." in done.stdout


def test_stats_count_searches_and_messages_of_each_split(made: tuple[Path, dict[str, object]]) -> None:
    out, printed = made
    figures = json.loads(personal_viz("stats", "--dataset", out, "--json").stdout)
    assert figures["sequences"] == {
        name: {"sequences": number} for name, number in (("easy", 1), ("medium", 1), ("hard", 1), ("all", 3))
    }
    assert figures["kinds"]["all"] == {kind: count for kind, count in sorted(printed["by_kind"].items()) if count}  # pyright: ignore
    assert sum(figures["modes"]["all"].values()) == printed["subtasks"]
    assert figures["messages"]["all"]["intro"] == 3
    assert sum(figures["lengths"]["all"].values()) == 3
    shown = personal_viz("stats", "--dataset", out).stdout
    for title in (
        "Home sequences of each split",
        "Sequences by length",
        "Messages by kind",
        "Searches by kind",
        "Searches by mode",
    ):
        assert title in shown


def test_a_set_needs_a_folder_of_its_own(made: tuple[Path, dict[str, object]], small_home_root: Path) -> None:
    asked = ("generate", small_home_root, "--sequences", 3)
    assert_one_line(personal_viz(*asked), "--sequences 3: --out is None", "Give --out")
    assert_one_line(personal_viz(*asked, "--out", small_home_root), "found episodes", "Give another --out")
    assert_one_line(personal_viz(*asked, "--out", made[0]), "found sequences; expected none", "--replace")


def test_one_number_of_sequences_or_none_is_given(small_home_root: Path, tmp_path: Path) -> None:
    for given in ((0,), (3, 4)):
        done = personal_viz("generate", small_home_root, "--out", tmp_path, "--sequences", *given)
        assert_one_line(done, f"--sequences is {' '.join(map(str, given))}", "expected one whole number from 1")
    assert_one_line(personal_viz("generate", small_home_root, "--sequences"), "--sequences 300: --out is None")


def test_a_home_that_carries_nothing_leaves_nothing_behind(small_root: Path, tmp_path: Path) -> None:
    done = personal_viz("generate", small_root, "--sequences", 2, "--out", tmp_path / "set")
    assert_one_line(done, "HomeOne")
    assert not (tmp_path / "set" / "content").exists()
