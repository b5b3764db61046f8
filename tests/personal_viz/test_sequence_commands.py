"""`run --sequences` and `metrics` on its runs, as a user types them."""

import json
from pathlib import Path

import pytest

from personal_viz.cli.runs import replay
from personal_viz.cli.runs.metrics import Metrics
from personal_viz.cli.runs.sequence_table import print_sequences
from personal_viz.cli.verbs import parse
from recordings.read import read_recorded
from sim.errors import PersonalVizError, RecordingError, RunFileError
from sim.sequences.rows import sequence_rows
from sim.tasks.run_folders import read_runs
from tests.sim.home_story import MESSAGES, SUBTASKS, told_in

FIGURES = {
    *("sr_fresh", "sr_revisit", "sr_changed", "sr_stale", "progress", "partial", "composite", "csr", "cgt", "ppl"),
    *("stale", "interference", "lag", "n"),
}
"""Measures that other programs read by name."""


@pytest.fixture(scope="module")
def told(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of one sequence."""
    out = tmp_path_factory.mktemp("set")
    told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)
    return out


def run(root: Path, told: Path, out: Path, *more: str) -> None:
    words = ["run", "--dataset", str(root), "--sequences", str(told), "--agent", "shortest-path", "--out", str(out)]
    assert parse([*words, *more]).run() == 0


def told_again(root: Path, out: Path) -> Path:
    """Another set."""
    told_in(root, out, messages=MESSAGES[:1], subtasks=SUBTASKS[:1])
    return out


def replayed(root: Path, told: Path, out: Path) -> None:
    """The agent with messages beside the one without, in one recording."""
    with_words = sorted(path for path in out.glob("sequences-*") if "memory" not in path.name)
    words = ["replay", "--dataset", str(root), "--sequences", str(told), "--out", str(out / "a.rrd"), "--runs"]
    assert parse([*words, *map(str, with_words)]).run() == 0
    assert {run.run_id for run, _ in read_recorded(out / "a.rrd").sequences} == {path.name for path in with_words}


def test_sequences_are_run_resumed_told_in_a_table_and_recorded(
    small_home_root: Path,
    told: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for more in ((), ("--ignore-messages",), ("--memory", "on")):
        run(small_home_root, told, tmp_path, *more)
    capsys.readouterr()
    run(small_home_root, told, tmp_path)
    assert "1 sequence in 1 scene (invented), 1 done before" in capsys.readouterr().out
    assert Metrics((tmp_path,), json=True).run() == 0
    rows = {row["condition"]: row for row in json.loads(capsys.readouterr().out)}
    assert set(rows) == {"none", "messages ignored", "memory"}
    assert set(rows["none"]["sequence_measures"]) > FIGURES
    hears, ignores = (rows[name]["sequence_measures"] for name in ("none", "messages ignored"))
    assert (hears["sr_changed"], hears["stale"], hears["composite"], hears["n"]) == (1, 0, 1, 1)
    assert (ignores["sr_changed"], ignores["stale"], ignores["sr_fresh"]) == (0, 1, hears["sr_fresh"])
    assert rows["memory"]["memory_gain"]["sr"] == 0
    assert rows["none"]["memory_gain"] is rows["none"]["beside_first"] is None
    beside = rows["messages ignored"]["beside_first"]
    assert (beside["condition"], beside["sr"]) == (
        "none",
        {"value": -3 / 6, "interval": None, "num_first": 6, "num_second": 6},
    )
    assert rows["none"]["goat_measures"]["n"] == 1
    assert Metrics((tmp_path,)).run() == 0
    shown = capsys.readouterr().out
    assert "Home sequences, rule paper" in shown
    assert "Invented homes, made from a seed: no human baseline for PersONAL" in shown
    assert "shortest-path (messages ignored): SR -50.0 points beside shortest-path on the same sequences." in shown
    assert "memory gain in 1 revisits SR +0.0, SPL +0.0, steps +0.0" in shown
    monkeypatch.setattr(replay, "renderer_of", lambda _: None)  # pictures are tested with episodes
    replayed(small_home_root, told, tmp_path)
    assert "a.rrd: hard/Small/told in Small (invented home)" in capsys.readouterr().out
    with pytest.raises(RecordingError, match=r"was made on the set of sequences .* expected one set"):
        replayed(small_home_root, told_again(small_home_root, tmp_path / "again"), tmp_path)


def test_options_that_do_not_belong_to_sequences_are_refused(small_home_root: Path, told: Path, tmp_path: Path) -> None:
    with pytest.raises(PersonalVizError, match="--episode beside --sequences: expected one of them"):
        run(small_home_root, told, tmp_path, "--episode", "easy/Small/1")
    sees = ("--agent", "onemap", "--perception", "oracle", "--goal-text", "caption")
    with pytest.raises(PersonalVizError, match="captions are those of the answer after all messages"):
        run(small_home_root, told, tmp_path, "--ignore-messages", *sees)
    with pytest.raises(PersonalVizError, match="--memory on, --ignore-messages: found no --sequences"):
        parse(["run", "--dataset", str(small_home_root), "--agent", "random", "--memory", "on"]).run()
    with pytest.raises(PersonalVizError, match="the chosen splits and scenes hold no episode"):
        run(small_home_root, told, tmp_path, "--split", "easy")


def test_verbs_about_episodes_leave_sequences_out_or_refuse_them(
    small_home_root: Path, told: Path, tmp_path: Path
) -> None:
    run(small_home_root, told, tmp_path, "--run-id", "sequences")
    words = ["run", "--dataset", str(small_home_root), "--agent", "random", "--limit", "1", "--split", "easy"]
    assert parse([*words, "--out", str(tmp_path), "--run-id", "episodes"]).run() == 0
    assert [found.info.run_id for found in read_runs([tmp_path])] == ["episodes"]
    with pytest.raises(RunFileError, match="holds home sequences; expected episodes or answers"):
        read_runs([tmp_path / "sequences"])


def test_runs_on_different_sets_never_share_a_table(small_home_root: Path, told: Path, tmp_path: Path) -> None:
    told_in(small_home_root, tmp_path / "other", messages=MESSAGES[:2], subtasks=SUBTASKS[:3])
    run(small_home_root, told, tmp_path / "runs", "--run-id", "one")
    run(small_home_root, tmp_path / "other", tmp_path / "runs", "--run-id", "two")
    with pytest.raises(RunFileError, match=r"found sequences .* expected runs on one set"):
        Metrics((tmp_path / "runs",)).run()


def test_settings_that_all_rows_of_a_perception_share_are_told_once(
    small_home_root: Path, told: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(small_home_root, told, tmp_path)
    row = sequence_rows(sorted(tmp_path.iterdir()))[0]
    seen = ("oracle:mild (miss=0.2, far=8..3)", "oracle:far (miss=0.2)", "oracle:far (miss=0.3)")
    conditions = [f"{who}sees with {what} in hashed" for who in ("", "memory, ") for what in seen]
    capsys.readouterr()
    print_sequences([row.model_copy(update={"condition": condition}) for condition in conditions])
    shown = capsys.readouterr().out
    assert shown.count(seen[0]) == 1
    assert f"\n{seen[0]}.\n" in shown
    assert "(memory, sees with oracle:mild in hashed): interference" in shown
    for text in seen[1:]:
        assert f"(memory, sees with {text} in hashed): interference" in shown, "two settings of one name stay apart"
