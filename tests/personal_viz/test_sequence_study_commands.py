"""`study init`, `plan`, `verify`, `export` and `import-check` of a study of home sequences in an invented home."""

from pathlib import Path

import pytest

from human_study.design.plan import load_plan
from human_study.design.study import load_study, save_study
from human_study.trial.commands import GiveUp, PressStop
from personal_viz.cli.study.export import StudyExport
from personal_viz.cli.study.import_check import StudyImportCheck
from personal_viz.cli.study.init import StudyInit
from personal_viz.cli.study.plan import StudyPlanVerb
from personal_viz.cli.study.verify import StudyVerify
from personal_viz.study_app.study_files import places_of
from personal_viz.study_app.study_sequences import shortened
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import StudyError
from tests.human_study.sequence_trials import do_sequence, home_of, sequence_study
from tests.human_study.stores import open_planned
from tests.sim.home_story import MESSAGES, SUBTASKS, told_in


@pytest.fixture(scope="module")
def told(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """Folder of the set, and its sequence."""
    out = tmp_path_factory.mktemp("set")
    return out, told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)


def test_a_study_file_names_its_set(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert StudyInit(tmp_path / "study", small_home_root, sequences=told[0]).run() == 0
    config = load_study(tmp_path / "study")
    assert config.sequences is not None
    assert config.sequences.sha256 == SequenceSet(told[0]).digest()
    assert f"--sequences {told[0]}" in capsys.readouterr().out
    with pytest.raises(StudyError, match="has sequences, and no set was given"):
        StudyPlanVerb(tmp_path / "study", small_home_root).run()


def test_a_study_is_planned_done_again_and_read_back(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, story = told
    study, out = tmp_path / "study", tmp_path / "out"
    config = sequence_study(
        dataset={"sha256": PersonalDataset(small_home_root).digest()},
        sequences={"sha256": SequenceSet(root).digest(), "history": "hidden"},
        task=("pan",),
        design={"kind": "crossed", "raters_per_episode": 2},
    )
    save_study(study, config)
    assert StudyPlanVerb(study, small_home_root, sequences=root, pilot=True).run() == 0
    assert "sequences: 1 sequence in 1 home, design crossed" in capsys.readouterr().out
    assert places_of(study).sequences == root.resolve()
    plan = load_plan(study, config)
    home = home_of(small_home_root, [story])
    with open_planned(study, config, plan) as store:
        do_sequence(store, "p01", 1, story, home, [PressStop(), PressStop(), *[GiveUp()] * 10])
    given = {"dataset": small_home_root, "sequences": root}
    assert StudyVerify(study, **given).run() == 0
    assert StudyExport(study, out=out).run() == 0
    assert StudyImportCheck(out, **given).run() == 0
    assert "1 of 1 outcomes agree with their events" in capsys.readouterr().out
    with open_planned(study, config, plan) as store:
        do_sequence(store, "p02", 1, story, home, [GiveUp()] * 12, condition="history_visible")
    assert StudyVerify(study, **given).run() == 1
    found = capsys.readouterr().out
    assert "p02, trial 1, attempt 1" in found
    assert "was opened in condition history_visible; expected history_hidden, as planned" in found
    assert "1 failed, 1 verified" in found
    assert StudyExport(study, out=tmp_path / "again").run() == 0
    assert StudyImportCheck(tmp_path / "again", **given).run() == 1
    assert "was opened in condition history_visible; expected history_hidden" in capsys.readouterr().out
    other = told_in(small_home_root, tmp_path / "other", messages=MESSAGES[:1], subtasks=SUBTASKS[:1])
    with pytest.raises(StudyError, match=f"expected {SequenceSet(root).digest()[:12]}, the study's"):
        StudyVerify(study, small_home_root, sequences=tmp_path / "other").run()
    assert other.key == story.key


def test_practice_ends_with_the_first_search_that_a_later_message_decides(told: tuple[Path, HomeSequence]) -> None:
    short = shortened(told[1].record)
    assert [subtask.kind for subtask in short.subtasks] == ["fresh", "fresh", "stale"]
    assert [message.text for message in short.messages] == [message["text"] for message in MESSAGES[:2]]
