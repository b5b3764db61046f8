"""`study init` and `study plan`: texts are frozen with the plan, and nothing that was asked changes in silence."""

import hashlib
import shutil
from pathlib import Path

import pytest

from human_study.design.plan import PLAN_FILE, PlannedParticipant, StudyPlan, StudyScene, load_plan
from human_study.design.study import STUDY_FILE, StudyConfig, StudyDataset, load_study
from personal_viz.cli.study.init import StudyInit
from personal_viz.cli.study.plan import StudyPlanVerb
from personal_viz.study_app.study_files import require_texts
from sim.errors import StudyError

from .invented import invented_dataset

ETHICS = {
    "irb": "2026-17",
    "institution": "The University of Anywhere",
    "contact": "study@anywhere.example",
    "pay": "12 EUR",
}


def test_a_study_is_planned_when_its_texts_are_whole_and_says_what_it_could_not_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, dataset = tmp_path / "study", tmp_path / "dataset"
    invented_dataset(dataset, name="FlowHome", seed=5)
    StudyInit(study=study, dataset=dataset, per_split=1).run()
    assert "ethics.institution, ethics.contact, ethics.pay, ethics.irb, privacy.retention\n" in capsys.readouterr().out
    file = (study / STUDY_FILE).read_text(encoding="utf-8")
    for asked, instead in (
        ("trials_per_person: null", "trials_per_person: 4"),
        ("  pan: 2\n  pog: 2", "  pan: 0\n  pog: 0"),
        ("checks:\n  every: 15", "checks:\n  every: null"),
    ):
        assert asked in file
        file = file.replace(asked, instead)
    (study / STUDY_FILE).write_text(file, encoding="utf-8")
    with pytest.raises(StudyError, match=r"consent\.md: ethics\.institution, .*Correct study\.yaml or the text"):
        StudyPlanVerb(study=study, dataset=dataset).run()
    assert not (study / PLAN_FILE).exists()
    for field, value in {**ETHICS, "retention": "2027-12-31"}.items():
        file = file.replace(f"  {field}: ''", f"  {field}: {value}").replace(f"  {field}: null", f"  {field}: {value}")
    (study / STUDY_FILE).write_text(file, encoding="utf-8")
    capsys.readouterr()
    assert StudyPlanVerb(study=study, dataset=dataset).run() == 0
    printed = capsys.readouterr().out
    made = load_plan(study, load_study(study))
    assert made.changes[0].startswith("design.trials_per_person: 4 asked, 1 planned, because")
    assert f"  Other than asked: {made.changes[0]}.\n" in printed
    assert set(made.texts) == {"consent.md", "instructions.md", "told/consent-pan.md", "told/instructions-pan.md"}
    told = study / "told" / "consent-pan.md"
    assert "The University of Anywhere invites you" in told.read_text(encoding="utf-8")
    for path in (told, study / "instructions.md"):
        require_texts(study, load_study(study), made)
        before = path.read_text(encoding="utf-8")
        path.write_text(before + "More.\n", encoding="utf-8")
        with pytest.raises(StudyError, match="the text that was planned"):
            require_texts(study, load_study(study), made)
        path.write_text(before, encoding="utf-8")


def test_marks_go_to_objects_only_where_the_files_of_a_scan_tell_of_objects(tmp_path: Path, demo_root: Path) -> None:
    study, scans = tmp_path / "study", tmp_path / "scans"
    StudyInit(study=study, dataset=demo_root, per_split=1, task=("pog",)).run()
    file = (study / STUDY_FILE).read_text(encoding="utf-8")
    assert "pointing: free" in file
    (study / STUDY_FILE).write_text(file.replace("pointing: free", "pointing: snap"), encoding="utf-8")
    scans.mkdir()
    shutil.copy(demo_root / "scenes" / "Demo.glb", scans)
    with pytest.raises(StudyError, match=r"pog\.pointing is 'snap', but no file tells .* expected Demo\.semantic\.glb"):
        StudyPlanVerb(study=study, dataset=demo_root, scenes_dir=scans, pilot=True).run()
    assert not (study / PLAN_FILE).exists()
    assert StudyPlanVerb(study=study, dataset=demo_root, pilot=True).run() == 0  # the plan tells of its objects


def test_marks_that_an_earlier_version_planned_are_not_shown_to_anybody_new(tmp_path: Path) -> None:
    text = "Ask [to be filled in: ethics.contact]."
    (tmp_path / "consent.md").write_text(text, encoding="utf-8")
    config = StudyConfig(study="old", dataset=StudyDataset(sha256="0" * 64), task=("pan",))
    made = StudyPlan(
        study_version=config.study_version,
        scenes=(StudyScene(name="Home", kind="invented"),),
        texts={"consent.md": hashlib.sha256(text.encode()).hexdigest()},
        participants=(PlannedParticipant(code="p01", task="pan", trials=()),),
    )
    with pytest.raises(StudyError, match=r"consent\.md: ethics\.contact to be filled in"):
        require_texts(tmp_path, config, made)
    (tmp_path / "study.db").touch()  # it has begun, and keeps what people have read
    require_texts(tmp_path, config, made)
