"""`study ethics`: documents in a folder, and texts for participants filled in."""

import re
from pathlib import Path

import pytest

from human_study.design.study import StudyConfig, save_study
from human_study.texts.words import open_places
from personal_viz.cli.study.ethics import StudyEthics
from personal_viz.cli.study.export import StudyExport
from tests.human_study.small_world import study
from tests.human_study.stores import begin_next, filled


def config_of(**changes: object) -> StudyConfig:
    return StudyConfig.model_validate({"study": "pilot", "dataset": {"sha256": "0" * 64}, "task": "pan"} | changes)


def test_the_command_writes_all_documents_and_counts_open_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = config_of(ethics={"irb": "2026-17"})
    save_study(tmp_path / "study", config)
    (tmp_path / "study" / "consent.md").write_text("# Ours\n\nAsk [to be filled in: ethics.contact].\n")
    assert StudyEthics(study=tmp_path / "study", out=tmp_path / "out").run() == 0
    printed = capsys.readouterr().out
    assert "Written to" in printed
    assert "They are templates: no ethics board has read them." in printed
    assert "come with the plan" in printed
    count = int(re.search(r"(\d+) places are to be filled in", printed)[1])
    texts = [path.read_text() for path in sorted((tmp_path / "out").iterdir())]
    assert count == sum(len(open_places(text)) for text in texts)
    assert (tmp_path / "out" / "consent.md").read_text().startswith("# Ours")


def test_the_command_writes_what_participants_of_each_task_read(tmp_path: Path) -> None:
    save_study(tmp_path, config_of(task=("pan", "pog"), ethics={"contact": "study@anywhere.example"}))
    (tmp_path / "consent.md").write_text("Ask {{ contact }}.\n")
    (tmp_path / "instructions.md").write_text("# Ours\n\nYou have {{ study.steps }} steps.\n")
    assert StudyEthics(study=tmp_path, out=tmp_path / "out").run() == 0
    assert (tmp_path / "out" / "consent.md").read_text() == "Ask study@anywhere.example.\n"
    walking, pointing = ((tmp_path / "out" / f"instructions-{task}.md").read_text() for task in ("pan", "pog"))
    assert walking.startswith("# Ours\n\nYou have 500 steps.\n\n# Your task")
    assert "You steer a small robot" in walking
    assert "You steer a small robot" not in pointing


def test_the_command_says_when_the_first_trial_was_begun(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = study(flow=("consent",))
    save_study(tmp_path / "study", config)
    with filled(tmp_path / "study", config) as store:
        assert StudyEthics(study=tmp_path / "study", out=tmp_path / "before").run() == 0
        assert "written after the first trial" not in capsys.readouterr().out
        store.give_consent("p02", "text", given=True)
        begin_next(store, "p02")
        assert StudyEthics(study=tmp_path / "study", out=tmp_path / "after").run() == 0
    printed = capsys.readouterr().out
    assert re.search(
        r"preregistration\.md says that it was written after the first trial: .* on \d{4}-\d\d-\d\d", printed
    )
    before, after = ((tmp_path / name / "preregistration.md").read_text() for name in ("before", "after"))
    assert before.startswith("# Preregistration: pilot")
    assert after.startswith("# Plan of the analysis, written after the first trial: pilot")


def test_an_export_names_answers_that_few_people_gave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = study(flow=("consent",), survey={"questions": ("age",)}, comments=True)
    with filled(tmp_path / "study", config) as store:
        store.keep_answer("p01", "survey", '{"age": "25_34"}')
    assert StudyExport(study=tmp_path / "study", out=tmp_path / "out").run() == 0
    printed = capsys.readouterr().out
    assert "survey.csv holds answers of single people" in printed
    assert "comments.csv holds what people wrote" in printed
    assert "Fewer than 5 people each, who may be recognised: age 25_34 (1), 1 combinations of" in printed
