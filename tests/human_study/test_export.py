"""Exports: run folders like those of agents, tables in three formats, a manifest; nothing that leads to a person."""

import csv
import hashlib
import json
import re
import sqlite3
from pathlib import Path

import pyarrow.parquet as parquet
import pytest

from human_study.export.data_dictionary import columns_of
from human_study.export.manifest import read_manifest, require_unchanged
from human_study.export.rows import EventRow
from human_study.export.study_export import TABLES, export_study
from human_study.export.survey import small_cells, survey_counts
from human_study.report.source import read_survey
from human_study.store.records import VerificationEntry
from human_study.trial.commands import GiveUp, Move, Start
from human_study.trial.outcome import pan_outcome
from sim.errors import StudyError
from sim.tasks.run_files import read_run
from sim.types import Action

from .finished import POINT, SUCCESS, TOO_FAR, do_trial, events_of, first_key, study_with_trials, table_of
from .small_world import SquareRoom, episode, study
from .stores import edit, filled, open_small, trials_of


def files_of(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


def run_of(folders: list[Path], task: str) -> Path:
    (found,) = (folder for folder in folders if f"-{task}" in folder.name)
    return found


def test_finished_trials_become_run_folders_like_those_of_agents(finished: Path) -> None:
    folders = sorted((finished / "out").glob("pilot-*"))
    assert sorted(re.sub("p0[12]", "pNN", folder.name) for folder in folders) == ["pilot-pNN-pan", "pilot-pNN-pog"]
    pan, pog = read_run(run_of(folders, "pan")), read_run(run_of(folders, "pog"))
    assert (pan.info.who, pan.info.who_kind, pan.info.scene_kind) == ("human", "human", "invented")
    assert (pan.info.condition, pog.info.condition) == ("none", "map_open")
    assert (len(pan.episodes), len(pan.answers), len(pog.episodes), len(pog.answers)) == (1, 0, 0, 1)
    run, answer = pan.episodes[0], pog.answers[0]
    code = run.start.participant or ""
    assert pan.info.run_id == f"pilot-{code}-pan"
    key = first_key("p02")
    expected = pan_outcome(
        events_of(key, SUCCESS, task="pan"), episode(key.episode_id), navigation=SquareRoom(), participant=code
    )
    assert run == expected
    assert answer.measures.success
    assert {code, answer.participant} == {"p01", "p02"}


def test_a_golden_bot_gives_the_figures_computed_by_hand(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        do_trial(store, "p02", 1, SUCCESS)
        do_trial(store, "p02", 2, TOO_FAR)
        do_trial(store, "p01", 1, POINT)
    export_study(tmp_path / "study", tmp_path / "out")
    rows = {(row["task"], row["order_no"]): row for row in table_of(tmp_path / "out", "trials") if row["attempt"]}
    right, wrong, point = rows["pan", 1], rows["pan", 2], rows["pog", 1]
    names = ("end_reason", "success", "spl", "dtg", "n_steps", "path_m", "planar_distance", "t_total_s")
    assert [right[name] for name in names] == ["stop", True, pytest.approx(0.8), 0.0, 9, 1.25, 0.75, 10.0]
    assert [wrong[name] for name in names] == ["stop", False, 0.0, 0.25, 7, 0.75, 1.25, 8.0]
    assert wrong["softspl"] == pytest.approx(0.75)  # a quarter of the 1 m is left, no detour
    assert [point[name] for name in names] == ["click", True, None, None, None, None, 0.5, 2.0]
    assert (right["t_look_s"], right["t_hidden_s"], right["t_first_view_s"]) == (None, 0.0, 0.0)
    assert right["head_hash"] == read_manifest(tmp_path / "out").head_hashes[f"{right['participant']}/1/1"]


def test_the_manifest_says_what_was_left_out_and_why(finished: Path) -> None:
    manifest = read_manifest(finished / "out")
    assert [(left.attempt[3:], left.reason) for left in manifest.left_out] == [
        ("/2/1", "technical"),
        ("/2/2", "not finished"),
        ("/3/1", "not finished"),
    ]
    assert (manifest.num_participants, manifest.num_deleted, manifest.num_not_begun) == (2, 0, 2)
    assert manifest.study_version == study().study_version
    assert not manifest.is_pilot


def test_a_study_that_was_served_as_a_pilot_says_so_for_ever(folder: Path) -> None:
    with open_small(folder / "study") as store:
        store.mark_pilot()
    export_study(folder / "study", folder / "out")
    assert read_manifest(folder / "out").is_pilot


def test_the_manifest_holds_hash_and_rows_of_every_file(finished: Path) -> None:
    manifest, files = read_manifest(finished / "out"), files_of(finished / "out")
    assert set(manifest.files) == set(files) - {"manifest.json"}
    for name, entry in manifest.files.items():
        assert (entry.sha256, entry.num_bytes) == (hashlib.sha256(files[name]).hexdigest(), len(files[name])), name
    counts = {name: manifest.files[f"{name}.csv"].num_rows for name in TABLES}
    assert counts == {"trials": 7, "events": 45, "participants": 2, "exclusions": 0, "verifications": 0}
    assert require_unchanged(finished / "out", manifest).keys() == manifest.files.keys()


def test_the_same_records_give_the_same_bytes(folder: Path) -> None:
    export_study(folder / "study", folder / "out")
    first = files_of(folder / "out")
    export_study(folder / "study", folder / "out")
    export_study(folder / "study", folder / "again")
    assert files_of(folder / "out") == first == files_of(folder / "again")
    assert sorted(path.name for path in folder.iterdir()) == ["again", "out", "study"]


def test_an_export_works_while_the_study_is_served_and_grows_with_it(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        do_trial(store, "p02", 1, SUCCESS)
        (folder,) = export_study(tmp_path / "study", tmp_path / "out")
        before = read_run(folder)
        do_trial(store, "p02", 2, TOO_FAR)
        (folder,) = export_study(tmp_path / "study", tmp_path / "out")
    after = read_run(folder)
    assert (len(before.episodes), len(after.episodes)) == (1, 2)
    assert after.episodes[0] == before.episodes[0]


def test_giving_people_other_codes_changes_no_table(tmp_path: Path) -> None:
    two = study(task=("pan",), design={"kind": "crossed", "raters_per_episode": 2})
    with filled(tmp_path / "study", two) as store:
        do_trial(store, "p01", 1, SUCCESS)
        do_trial(store, "p02", 1, TOO_FAR)
        do_trial(store, "p02", 2, SUCCESS)
    export_study(tmp_path / "study", tmp_path / "out")
    edit(
        tmp_path / "study",
        "UPDATE participant SET code = 'x' || code; UPDATE assignment SET code = 'x' || code;"
        "UPDATE participant SET code = CASE code WHEN 'xp01' THEN 'p02' ELSE 'p01' END;"
        "UPDATE assignment SET code = CASE code WHEN 'xp01' THEN 'p02' ELSE 'p01' END;",
    )
    keys = json.loads((tmp_path / "study" / "keys.json").read_text())
    (tmp_path / "study" / "keys.json").write_text(json.dumps({"p01": keys["p02"], "p02": keys["p01"]}))
    export_study(tmp_path / "study", tmp_path / "renamed")
    assert files_of(tmp_path / "renamed") == files_of(tmp_path / "out")


def test_the_three_formats_of_a_table_say_the_same(finished: Path) -> None:
    out = finished / "out"
    for name, (_, model) in TABLES.items():
        lines, columns = table_of(out, name), columns_of(model)
        table = parquet.read_table(out / f"{name}.parquet")
        assert table.column_names == [column.name for column in columns]
        json_columns = {column.name for column in columns if column.type == "JSON"}
        from_parquet = [
            {key: json.loads(value) if key in json_columns else value for key, value in row.items()}
            for row in table.to_pylist()
        ]
        assert from_parquet == lines, name
        with (out / f"{name}.csv").open(newline="") as file:
            cells = list(csv.DictReader(file))
        assert len(cells) == len(lines)
        for cell, line in zip(cells, lines, strict=True):
            for column in columns:
                value = line[column.name]
                if isinstance(value, float):
                    assert float(cell[column.name]) == value
                elif value is None:
                    assert cell[column.name] == ""
                elif isinstance(value, str):
                    assert cell[column.name] == value
    metadata = parquet.read_metadata(out / "events.parquet")
    assert metadata.row_group(0).column(0).compression == "ZSTD"


def test_every_column_is_in_the_data_dictionary(finished: Path) -> None:
    text = (finished / "out" / "data_dictionary.md").read_text()
    for name, (_, model) in TABLES.items():
        section = text.partition(f"## {name}\n")[2].partition("\n## ")[0]
        for column in columns_of(model):
            assert f"| `{column.name}` | {column.type} |" in section
    assert "| `spl` | number | share | yes | Success weighted by path length, 0 to 1; PAN only. |" in text
    assert "| `t_total_s` | number | s | yes |" in text


def test_times_begin_with_the_trial_and_no_id_of_the_store_is_told(finished: Path) -> None:
    events = [EventRow.model_validate(row) for row in table_of(finished / "out", "events")]
    assert {row.t_srv_s for row in events if row.seq == 1} == {0.0}
    assert max(row.t_srv_s for row in events) < 60.0
    text = b"".join(content for name, content in files_of(finished / "out").items() if not name.endswith(".parquet"))
    database = sqlite3.connect(finished / "study" / "study.db")
    ids = [row[0] for row in database.execute("SELECT trial_id FROM trial UNION SELECT assignment_id FROM assignment")]
    stamps = [str(row[0])[:10] for row in database.execute("SELECT opened_ns FROM trial")]
    database.close()
    assert len(ids) == 11
    assert not [one for one in (*ids, *stamps) if one.encode() in text]


def test_exclusions_take_trials_out_of_the_run_folders_and_stay_in_the_tables(folder: Path) -> None:
    with open_small(folder / "study") as store:
        trial_id = next(trial.trial_id for trial in trials_of(store, "p02") if trial.order_no == 1)
        assert trial_id is not None
        exclusion = store.exclude("trial", trial_id, rule_id="disturbed", reason="=1+1 telephone")
        store.exclude("participant", "p01", rule_id="odd", reason="not in the plan")
        assert export_study(folder / "study", folder / "out") == []
        left_out = {left.reason for left in read_manifest(folder / "out").left_out}
        assert {"excluded: disturbed", "excluded: odd"} <= left_out
        found = {row["rule_id"]: row for row in table_of(folder / "out", "exclusions")}
        assert (found["disturbed"]["order_no"], found["disturbed"]["is_planned"]) == (1, True)
        assert (found["odd"]["order_no"], found["odd"]["is_planned"]) == (None, False)
        assert "'=1+1 telephone" in (folder / "out" / "exclusions.csv").read_text()
        store.undo_exclusion(exclusion)
    (run,) = export_study(folder / "study", folder / "out")
    assert len(read_run(run).episodes) == 1
    found = {row["rule_id"]: row["is_undone"] for row in table_of(folder / "out", "exclusions")}
    assert found == {"disturbed": True, "odd": False}


def test_the_latest_verification_stands_beside_each_trial(folder: Path) -> None:
    with open_small(folder / "study") as store:
        trial_id = trials_of(store, "p01")[0].trial_id or ""
        store.add_verification(VerificationEntry(trial_id, "RUN1", "drift", 0.5, 3, "step 3", "s" * 64, 1))
        store.add_verification(VerificationEntry(trial_id, "RUN2", "verified", 0.0, None, "", "t" * 64, 2))
    export_study(folder / "study", folder / "out")
    (row,) = (row for row in table_of(folder / "out", "trials") if row["task"] == "pog" and row["attempt"])
    assert row["verification"] == "verified"
    rows = [(row["run_no"], row["status"], row["first_bad_step"]) for row in table_of(folder / "out", "verifications")]
    assert rows == [(1, "drift", 3), (2, "verified", None)]
    assert b"RUN1" not in b"".join(files_of(folder / "out").values())


def test_the_export_of_a_study_that_was_tampered_with_is_refused(folder: Path) -> None:
    edit(folder / "study", "UPDATE event SET kind = 'act' WHERE kind = 'key'")
    with pytest.raises(StudyError, match="does not continue the chain"):
        export_study(folder / "study", folder / "out")
    assert not (folder / "out").exists()


def test_a_folder_of_something_else_is_left_alone_and_one_that_cannot_be_written_is_named(folder: Path) -> None:
    export_study(folder / "study", folder / "out")
    study_with_trials(folder / "other", study(study="other"))
    with pytest.raises(StudyError, match="holds study pilot"):
        export_study(folder / "other", folder / "out")
    (folder / "notes").mkdir()
    (folder / "notes" / "mine.txt").write_text("mine")
    with pytest.raises(StudyError, match=r"is not empty and holds no manifest\.json"):
        export_study(folder / "study", folder / "notes")
    export_study(folder / "study", folder / "out")
    (folder / "out" / "mine.txt").write_text("mine")
    with pytest.raises(StudyError, match=r"mine\.txt: was not written by an export"):
        export_study(folder / "study", folder / "out")
    assert (folder / "out" / "mine.txt").read_text() == "mine"
    (folder / "file").write_text("")
    with pytest.raises(StudyError, match=r"out: cannot be written \(Not a directory\)"):
        export_study(folder / "study", folder / "file" / "out")


def test_giving_up_is_a_result_and_is_exported(tmp_path: Path) -> None:
    with filled(tmp_path / "study") as store:
        do_trial(store, "p02", 1, [Start(), Move(Action.RIGHT, "KeyD"), GiveUp(), GiveUp()])
        do_trial(store, "p01", 1, [Start(), GiveUp(), GiveUp()])
    folders = export_study(tmp_path / "study", tmp_path / "out")
    pan, pog = read_run(run_of(folders, "pan")), read_run(run_of(folders, "pog"))
    assert pan.episodes[0].end.reason == "giveup"
    assert (pog.answers[0].reason, pog.answers[0].candidates) == ("giveup", ())


def test_answers_to_the_survey_are_a_table_of_their_own_and_small_cells_are_named(tmp_path: Path) -> None:
    survey = {"questions": ("age", "ai_tools")}
    config = study(task=("pan",), flow=("consent",), design={"kind": "crossed", "raters_per_episode": 7}, survey=survey)
    with filled(tmp_path / "study", config) as store:
        for number in range(1, 7):
            store.keep_answer(f"p{number:02}", "survey", '{"age": "25_34", "ai_tools": "no"}')
        store.keep_answer("p07", "survey", '{"age": "65_or_older"}')
    export_study(tmp_path / "study", tmp_path / "out")
    rows = read_survey(tmp_path / "out")
    assert len(rows) == 13
    assert {row.participant for row in rows} == {f"p{number:02}" for number in range(1, 8)}
    assert survey_counts(rows) == {"age": {"25_34": 6, "65_or_older": 1}, "ai_tools": {"no": 6}}
    assert small_cells(rows) == ["age 65_or_older (1)", "1 combinations of answers about the person (1 people)"]
    assert read_manifest(tmp_path / "out").files["survey.csv"].num_rows == 13
    assert "keep it apart" in (tmp_path / "out" / "data_dictionary.md").read_text(encoding="utf-8")
    assert "65_or_older" not in (tmp_path / "out" / "participants.jsonl").read_text(encoding="utf-8")
    for path in (tmp_path / "out").glob("survey.*"):
        path.unlink()  # kept apart
    require_unchanged(tmp_path / "out", read_manifest(tmp_path / "out"))
    assert read_survey(tmp_path / "out") == ()


def test_answers_of_somebody_who_withdrew_are_in_no_table(tmp_path: Path) -> None:
    config = study(task=("pan",), flow=("consent",), survey={"questions": ("age",)})
    with filled(tmp_path / "study", config) as store:
        store.keep_answer("p01", "survey", '{"age": "25_34"}')
        store.withdraw("p01")
    export_study(tmp_path / "study", tmp_path / "out")
    assert (tmp_path / "out" / "survey.csv").read_text(encoding="utf-8") == "participant,topic,answer\n"
