"""From a study folder with real records to a report."""

from pathlib import Path

import pytest

from human_study.design.study import StudyReporting, save_study
from human_study.export.study_export import export_study
from human_study.report.render import markdown
from human_study.report.report import StudyReport, study_report
from human_study.report.source import read_source
from human_study.store.records import VerificationEntry, read_study
from personal_viz.cli.study.report import StudyReportVerb
from sim.errors import StudyError

from .finished import TOO_FAR, do_trial
from .small_world import CANARY, study
from .stores import open_small

pytestmark = pytest.mark.slow  # a whole report takes seconds


def of_study(folder: Path) -> StudyReport:
    source = read_source([folder])
    return study_report(source.runs, records=source.records)


def rate(found: StudyReport, task: str) -> tuple[float, int | None, int]:
    (row,) = [row for row in found.rows if (row.task, row.split, row.measure) == (task, "easy", "sr")]
    return row.value, row.k, row.n


def test_a_study_folder_is_read_without_an_export(finished: Path) -> None:
    found = of_study(finished / "study")
    assert (found.study, found.scene_kinds) == ("pilot", ("invented",))
    assert rate(found, "pan") == (100, 1, 1)
    assert rate(found, "pog") == (100, 1, 1)
    assert [(cell.task, cell.reason, cell.n) for cell in found.left_out] == [
        ("pan", "begun, never ended (taken as abandoned)", 1),
        ("pan", "technical failure", 1),
    ]
    assert {count.point: count.n for count in found.flow}["began counted trials"] == 2
    text = markdown(found)
    assert "no human baseline for PersONAL" in text
    assert "| Human (home and text together) | 100.0 [20.7, 100.0] 1/1 |" in text
    assert CANARY not in text + found.model_dump_json()


def test_a_study_and_its_export_give_the_same_report(finished: Path) -> None:
    assert of_study(finished / "study").model_dump_json() == of_study(finished / "out").model_dump_json()


def test_facts_that_are_known_after_the_study_reach_the_report_and_the_export(folder: Path) -> None:
    study = folder / "study"
    with open_small(study) as store:
        do_trial(store, "p02", 3, TOO_FAR)
    with read_study(study) as reader:
        config = reader.config
    save_study(study, config.model_copy(update={"reporting": StudyReporting(failures="See the appendix.")}))
    export_study(study, folder / "again")
    for place in (study, folder / "again"):
        answers = {item.question: item.answer for item in of_study(place).checklist}
        assert answers["Failure modes described?"].startswith("See the appendix.")


def test_exclusions_and_verifications_of_the_store_are_in_the_report(folder: Path) -> None:
    with open_small(folder / "study") as store:
        far = do_trial(store, "p02", 3, TOO_FAR)
        store.exclude("trial", far, rule_id="disturbed", reason="the phone rang")
        store.add_verification(
            VerificationEntry(
                trial_id=far,
                run_id="v1",
                status="verified",
                max_position_error=0.0,
                first_bad_step=None,
                detail="",
                sim_hash="s",
                at_ns=1,
            )
        )
    found = of_study(folder / "study")
    assert rate(found, "pan") == (50, 1, 2)  # excluded trials stay in the tables
    (rule,) = found.exclusions
    assert (rule.rule_id, rule.reason, rule.is_planned, rule.num_trials) == ("disturbed", "the phone rang", True, 1)
    (checked,) = [row for row in found.verification if row.task == "pan"]
    assert (checked.num_verified, checked.num_not_yet) == (1, 1)
    per_protocol = next(row for row in found.sensitivity if row.way.startswith("per protocol") and row.task == "pan")
    assert (per_protocol.k, per_protocol.n) == (1, 1)


def test_no_results_two_studies_a_study_and_its_export_and_scans_without_the_dataset_are_refused(
    tmp_path: Path, finished: Path
) -> None:
    with open_small(tmp_path / "study"):
        pass
    with pytest.raises(StudyError, match="holds no counted trial with a result"):
        read_source([tmp_path / "study"])
    save_study(tmp_path / "planned", study())
    with pytest.raises(StudyError, match="planned: holds no counted trial with a result"):
        read_source([tmp_path / "planned"])
    for other in ("study", "out"):
        with pytest.raises(StudyError, match="found records of 2 studies or exports"):
            read_source([finished / "study", finished / other])
    with pytest.raises(StudyError, match="without --dataset"):
        StudyReportVerb(runs=[tmp_path], out=tmp_path / "out", scenes_dir=tmp_path).run()
