"""`study ethics`: documents in a folder, and texts for participants filled in."""

import re
from pathlib import Path

import pytest

from human_study.design.study import StudyConfig, save_study
from human_study.texts.words import open_places
from personal_viz.cli.study.ethics import StudyEthics


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
