"""Nobody can be found in a database or an export: no ids, no names, and nothing at all of people who withdrew."""

import shutil
from pathlib import Path

import pytest

from human_study.export.manifest import read_manifest
from human_study.export.study_export import export_study
from human_study.store.records import DATABASE_FILE, read_study
from human_study.trial.events import Resized

from .finished import POINT, SUCCESS, do_trial, events_of, table_of
from .small_world import CANARY, study
from .stores import checked, filled

NAME, ADDRESS, AGENT = "Wilhelmina-Canary", "203.0.113.77", "CanaryBrowser/99.5"
PLATFORM_ID = "5f9canaryplatformid77"


def bytes_of(folder: Path) -> bytes:
    return b"\n".join(path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file())


def test_planted_texts_of_stages_are_in_no_export(tmp_path: Path) -> None:
    """A stage that held a name by mistake would stay in the database: exports keep numbers and yes or no only."""
    with filled(tmp_path / "study") as store:
        detail = {"webgl2": True, "width": 1437, "height": 911, "agent": AGENT, "address": ADDRESS, "name": NAME}
        store.enter_stage("p02", "device_ok", detail | {"wrong": [NAME, NAME]})
        store.enter_stage(
            "p02", "sitting_started", {"client": {"dpr": 1.25, "touch": False, "height": 777, "agent": AGENT}}
        )
        do_trial(store, "p02", 1, SUCCESS)
    export_study(tmp_path / "study", tmp_path / "out")
    exported = bytes_of(tmp_path / "out")
    assert not [text for text in (NAME, ADDRESS, AGENT) if text.encode() in exported]
    stages = [stage for row in table_of(tmp_path / "out", "participants") for stage in row["stages"]]
    assert stages[0]["detail"] == {"webgl2": True, "width": 1400, "height": 900, "wrong": 2}
    assert stages[0]["t_s"] == 0.0
    assert stages[1]["detail"] == {"dpr": 1.25, "touch": False, "height": 800}


def test_the_database_and_its_backups_hold_no_plain_word_of_what_people_did(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        trial = store.open_trial("p02", 1)
        events = events_of(trial.key, SUCCESS, task="pan")
        marked = [event.model_copy(update={"t_cli_ms": 777123.5}) for event in events]
        store.append_many(trial.trial_id, trial.epoch, marked)
        store.back_up()
    stored = bytes_of(tmp_path / "study" / "backups") + b"".join(
        path.read_bytes() for path in (tmp_path / "study").glob(f"{DATABASE_FILE}*")
    )
    assert b"777123.5" not in stored
    assert b"-1.25" not in stored


def test_no_ground_truth_text_is_in_an_export(finished: Path) -> None:
    assert CANARY.encode() not in bytes_of(finished / "out")


def test_a_platform_id_is_in_neither_database_nor_export_as_text(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        assert store.claim_person("ab" * 32) == "p01"
        store.enter_stage("p01", "arrived")
        do_trial(store, "p01", 1, POINT)
    export_study(tmp_path / "study", tmp_path / "out")
    assert PLATFORM_ID.encode() not in bytes_of(tmp_path)
    assert ("ab" * 32).encode() not in bytes_of(tmp_path / "out")


def test_sizes_of_windows_are_rounded(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        trial = store.open_trial("p02", 1)
        events = [*events_of(trial.key, SUCCESS, task="pan")[:3], Resized(t_s=3.0, width=1450, height=850)]
        store.append_many(trial.trial_id, trial.epoch, events)
    export_study(tmp_path / "study", tmp_path / "out")
    (row,) = (row for row in table_of(tmp_path / "out", "events") if row["kind"] == "resize")
    assert row["payload"] == {"width": 1400, "height": 800}


def test_the_browser_clock_begins_anew_with_each_opening(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        first = store.open_trial("p02", 1)
        events = events_of(first.key, SUCCESS, task="pan")
        clocks = [event.model_copy(update={"t_cli_ms": 5000.0 + 10 * place}) for place, event in enumerate(events[:4])]
        store.append_many(first.trial_id, first.epoch, clocks)
        again = store.open_trial("p02", 1)
        store.append(again.trial_id, again.epoch, events[4].model_copy(update={"t_cli_ms": 90.0}))
    export_study(tmp_path / "study", tmp_path / "out")
    found = [(row["epoch"], row["kind"], row["t_cli_ms"]) for row in table_of(tmp_path / "out", "events")]
    assert [clock for _, _, clock in found] == [0.0, 10.0, 20.0, 30.0, None, 0.0]
    assert [epoch for epoch, _, _ in found] == [1, 1, 1, 1, 2, 2]


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_nothing_but_a_count_is_left_of_people_who_withdrew(tmp_path: Path, is_interrupted: bool) -> None:
    config = study(task=("pan",), design={"kind": "crossed", "raters_per_episode": 2})
    with filled(tmp_path / "study", config) as store:
        do_trial(store, "p01", 1, SUCCESS)
        gone = do_trial(store, "p02", 1, SUCCESS)
        store.exclude("trial", gone, rule_id="disturbed", reason=NAME)
        store.exclude("participant", "p02", rule_id="attention", reason=NAME)
        head = _head_hash(tmp_path / "study", gone)
        keys = (tmp_path / "study" / "keys.json").read_text()
        store.withdraw("p02")
    if is_interrupted:  # killed between the withdrawal and the deletion of the key
        (tmp_path / "study" / "keys.json").write_text(keys)
    export_study(tmp_path / "study", tmp_path / "out")
    manifest = read_manifest(tmp_path / "out")
    assert (manifest.num_participants, manifest.num_deleted) == (1, 1)
    assert {row["participant"] for row in table_of(tmp_path / "out", "trials")} == {
        row["participant"] for row in table_of(tmp_path / "out", "participants")
    }
    assert table_of(tmp_path / "out", "exclusions") == []
    exported = bytes_of(tmp_path / "out")
    assert NAME.encode() not in exported
    assert head.encode() not in exported


def test_comments_are_in_one_table_and_go_with_their_writers(tmp_path: Path) -> None:
    config = study(task=("pan",), design={"kind": "crossed", "raters_per_episode": 2}, comments=True)
    with filled(tmp_path / "study", config) as store:
        for code in ("p01", "p02"):
            do_trial(store, code, 1, SUCCESS)
        export_study(tmp_path / "study", tmp_path / "none")
        store.keep_answer("p01", "comment", "=HYPERLINK(1)\nFine, says Anna-Canary")
        store.keep_answer("p02", "comment", f"I am {NAME}")
        store.withdraw("p02")
    export_study(tmp_path / "study", tmp_path / "out")
    assert table_of(tmp_path / "none", "comments") == []
    (row,) = table_of(tmp_path / "out", "comments")
    assert row["comment"] == "=HYPERLINK(1)\nFine, says Anna-Canary"
    assert {row["participant"]} == {row["participant"] for row in table_of(tmp_path / "out", "participants")}
    holders = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file() and b"Canary" in path.read_bytes()}
    assert holders == {"comments.jsonl", "comments.csv", "comments.parquet"}
    assert "'=HYPERLINK(1)" in (tmp_path / "out" / "comments.csv").read_text()
    assert NAME.encode() not in bytes_of(tmp_path / "out")
    assert "## comments" in (tmp_path / "out" / "data_dictionary.md").read_text()
    stored = b"".join(path.read_bytes() for path in (tmp_path / "study").glob(f"{DATABASE_FILE}*"))
    assert b"Canary" not in stored


def test_a_withdrawal_in_the_middle_of_a_trial_leaves_a_chain_that_verifies_and_nothing_to_read(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        trial = store.open_trial("p02", 1)
        store.append_many(trial.trial_id, trial.epoch, events_of(trial.key, SUCCESS, task="pan")[:5])
        backup = store.back_up()
        store.withdraw("p02")
        assert checked(store) == 5
    with read_study(tmp_path / "study") as reader:
        assert reader.check() == 5
        assert reader.events(trial.trial_id) == ()
    export_study(tmp_path / "study", tmp_path / "out")
    assert table_of(tmp_path / "out", "events") == []
    shutil.copy(backup, tmp_path / "study" / DATABASE_FILE)  # made before the withdrawal, and just as unreadable
    with read_study(tmp_path / "study") as reader:
        assert reader.events(trial.trial_id) == ()
        assert {status.is_shredded for status in reader.trials("p02")} == {True}


def test_people_keep_their_codes_when_somebody_withdraws(tmp_path: Path) -> None:
    config = study(task=("pan",), design={"kind": "crossed", "raters_per_episode": 4})
    with filled(tmp_path / "study", config) as store:
        for number, code in enumerate(("p01", "p02", "p03", "p04")):
            store.enter_stage(code, "arrived", {"mark": number})
        export_study(tmp_path / "study", tmp_path / "before")
        store.withdraw("p02")
    export_study(tmp_path / "study", tmp_path / "after")

    def marks(out: Path) -> dict[int, str]:
        return {row["stages"][0]["detail"]["mark"]: row["participant"] for row in table_of(out, "participants")}

    before, after = marks(tmp_path / "before"), marks(tmp_path / "after")
    assert len(before) == 4
    assert after == {mark: code for mark, code in before.items() if mark != 1}
    assert sorted(before.values()) == ["p01", "p02", "p03", "p04"]


def _head_hash(folder: Path, trial_id: str) -> str:
    with read_study(folder) as reader:
        head = reader.head_hash(trial_id)
    assert head is not None
    return head
