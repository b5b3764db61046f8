"""`study init`, `plan`, `verify`, `export` and `import-check` of a study of home sequences in an invented home."""

import gzip
from pathlib import Path

import pytest

from human_study.design.plan import PRACTICE_FOLDER, load_plan
from human_study.design.study import STUDY_FILE, StudyChecks, StudyPractice, load_study, save_study
from human_study.texts.catalogue import catalogue_of
from human_study.trial.commands import GiveUp, PressStop
from personal_viz.cli.study.export import StudyExport
from personal_viz.cli.study.import_check import StudyImportCheck
from personal_viz.cli.study.init import StudyInit
from personal_viz.cli.study.plan import StudyPlanVerb
from personal_viz.cli.study.serve import StudyServe
from personal_viz.cli.study.verify import StudyVerify
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.operator import service
from personal_viz.study_app.screens.cards import problem_card
from personal_viz.study_app.study_files import places_of
from personal_viz.study_app.study_sequences import PRACTICE_SET, sequences_by_key, shortened
from sim.authoring.content import packed
from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import HomeSequence, SequenceFile, SequenceSet
from sim.errors import StudyError
from tests.human_study.sequence_trials import do_sequence, home_of, sequence_study
from tests.human_study.stores import open_planned
from tests.sim.home_story import MESSAGES, SUBTASKS, told_in


@pytest.fixture(scope="module")
def told(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """Folder of the set, and its sequence."""
    out = tmp_path_factory.mktemp("set")
    return out, told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)


def told_often(told: Path, out: Path, number: int) -> Path:
    """A set that holds the only sequence of another so many times, under several names."""
    (out / "content").mkdir(parents=True)
    for file in sorted((told / "content").iterdir()):
        content = SequenceFile.model_validate_json(gzip.decompress(file.read_bytes()))
        alike = [content.sequences[0].model_copy(update={"sequence_id": f"told-{n}"}) for n in range(number)]
        (out / "content" / file.name).write_bytes(packed(content.model_copy(update={"sequences": tuple(alike)})))
    return out


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


def test_a_new_study_is_planned_with_many_sequences_in_one_home_and_read_once_when_served(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study, root = tmp_path / "study", told_often(told[0], tmp_path / "set", 6)
    assert StudyInit(study, small_home_root, sequences=root).run() == 0
    config = load_study(study)
    assert (config.dataset.max_per_scene, config.design.trials_per_person, config.breaks.sitting_max) == (None, 6, 6)
    config = config.model_copy(update={"practice": StudyPractice(pan=0, pog=0), "checks": StudyChecks(every=None)})
    (study / STUDY_FILE).unlink()
    save_study(study, config)
    assert StudyPlanVerb(study, small_home_root, sequences=root, pilot=True).run() == 0
    plan = load_plan(study, config)
    assert len({trial.key for one in plan.participants for trial in one.trials if trial.phase == "main"}) == 6
    assert StudyInit(tmp_path / "all", small_home_root, sequences=root, design="crossed").run() == 0
    assert load_study(tmp_path / "all").design.trials_per_person is None
    served, digests = [], []
    digest = SequenceSet.digest
    monkeypatch.setattr(service, "serve_study", lambda *_, **options: served.append(options["sequences"]))
    monkeypatch.setattr(SequenceSet, "digest", lambda one: digests.append(one) or digest(one))
    assert StudyServe(small_home_root, study, serving=ServeOptions(pilot=True)).run() == 0
    assert (served, len(digests)) == ([root.resolve()], 1)


def test_the_card_of_a_lost_picture_says_that_all_searches_of_the_home_do_not_count() -> None:
    card = problem_card("lost_picture", catalogue_of("en"), of_sequences=True)
    assert "Your searches in the home that was open do not count." in card.body


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


@pytest.mark.slow
def test_practice_and_a_search_for_attention_are_done_again_and_read_back(
    small_home_root: Path, told: tuple[Path, HomeSequence], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, root = tmp_path / "study", told_often(told[0], tmp_path / "set", 3)
    config = sequence_study(
        dataset={"sha256": PersonalDataset(small_home_root).digest()},
        sequences={"sha256": SequenceSet(root).digest(), "history": "hidden"},
        task=("pan",),
        design={"kind": "crossed", "raters_per_episode": 1},
        practice={"pan": 1},
        checks={"every": 2},
    )
    save_study(study, config)
    given = {"dataset": small_home_root, "sequences": root}
    assert StudyPlanVerb(study, **given, pilot=True).run() == 0
    plan = load_plan(study, config)
    trials = plan.participants[0].trials
    assert [trial.phase for trial in trials] == ["practice", "main", "main", "check", "main"]
    known = sequences_by_key(SequenceSet(study / PRACTICE_SET))
    home = home_of(study / PRACTICE_FOLDER, list(known.values()))
    with open_planned(study, config, plan) as store:
        for number in (1, 4):
            story = known[trials[number - 1].key]
            do_sequence(store, "p01", number, story, home, [GiveUp()] * 2 * len(story.record.subtasks))
    assert len(known[trials[3].key].record.subtasks) == 1
    assert StudyVerify(study, **given).run() == 0
    assert "study: 2 verified" in capsys.readouterr().out
    assert StudyExport(study, out=tmp_path / "out").run() == 0
    assert StudyImportCheck(tmp_path / "out", **given).run() == 0
    assert "2 of 2 outcomes agree with their events" in capsys.readouterr().out
