"""`study verify`, `exclude`, `export` and `import-check` on real invented homes, practice included."""

import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from human_study.design.plan import PRACTICE_FOLDER, StudyPlan
from human_study.design.study import StudyConfig, StudyDataset, load_study, save_study
from human_study.export.manifest import read_manifest
from human_study.store.records import read_study
from human_study.store.store import StudyStore, Trial, open_store
from human_study.trial.commands import Click, Command, Confirm, GiveUp, Move, PressStop, Start
from human_study.trial.outcome import pan_outcome, pog_outcome
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import terms_of
from personal_viz.cli.study import report as report_verb
from personal_viz.cli.study.exclude import StudyExclude
from personal_viz.cli.study.export import StudyExport
from personal_viz.cli.study.import_check import StudyImportCheck
from personal_viz.cli.study.verify import StudyVerify
from personal_viz.study_app import study_files
from personal_viz.study_app.home.trial_homes import open_trial_home
from personal_viz.study_app.study_files import plan_study
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError, StudyError
from sim.homes.plan import HOMES_VERSION
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun
from sim.types import Action
from tests.human_study.stores import open_planned
from tests.human_study.trials import ray_down

pytestmark = pytest.mark.slow
WALK: tuple[Command, ...] = (
    Start(),
    Move(Action.LEFT, "KeyA"),
    *[Move(Action.FORWARD, "KeyW")] * 6,
    Move(Action.RIGHT, "KeyD"),
    *[Move(Action.FORWARD, "KeyW")] * 3,
    PressStop(),
    PressStop(),
)


@pytest.fixture
def study(tmp_path: Path, finished: Path) -> Path:
    """A finished study: p01 walked and p02 pointed at two episodes each, after one practice trial each."""
    return Path(shutil.copytree(finished, tmp_path / "study"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, invented_root: Path) -> Path:
    """The study that each test gets a copy of."""
    folder = tmp_path_factory.mktemp("finished") / "study"
    config = StudyConfig.model_validate(
        {
            "study": "records",
            "dataset": StudyDataset(
                sha256=PersonalDataset(invented_root).digest(),
                splits={"easy": 2},
                seed=4,  # the practice home is neither of the two
            ).model_dump(),
            "task": ("pan", "pog"),
            "design": {"kind": "crossed", "raters_per_episode": 1},
            "pog": {"conditions": ("map_open",)},
            "flow": ("instructions",),
            "practice": {"pan": 1, "pog": 1},
            "checks": {"every": None},
        }
    )
    save_study(folder, config)
    plan = plan_study(folder, invented_root, None, pilot=True)
    with open_planned(folder, config, plan) as store:
        for person in plan.participants:
            for planned in person.trials:
                do_trial(store, invented_root, store.open_trial(person.code, planned.order_no))
    return folder


def do_trial(store: StudyStore, dataset: Path, trial: Trial, commands: Sequence[Command] = WALK) -> None:
    """Does a trial in its real home, with fixed commands."""
    root = store.folder / PRACTICE_FOLDER if trial.phase == "practice" else dataset
    home = open_trial_home(PersonalDataset(root), store.plan.scene(trial.key.scene), None)
    episode = home.episode(trial.key)
    names = {
        "key": trial.key,
        "task": store.config.task_for(episode, trial.task),
        "scene_digest": home.scene_digest,
        "terms": terms_of(store.config, trial.condition),
    }
    if trial.task == "pan":
        session = PanSession(PanEnv(episode.start, home.navigation, renderer=None), **names)
    else:
        session = PogSession(storeys=tuple(home.navigation.storey_heights), **names)
        commands = pointing(home, episode.start.position)
    events = [event for number, command in enumerate(commands) for event in session.handle(command, number).events]
    store.append_many(trial.trial_id, trial.epoch, events)
    stored = [item.event for item in store.events(trial.trial_id)]
    result: EpisodeRun | Answer
    if trial.task == "pan":
        result = pan_outcome(stored, episode, navigation=home.navigation, participant=trial.code)
        store.finish_trial(trial.trial_id, result.end)
    else:
        result = pog_outcome(stored, episode, storeys=home.storeys, participant=trial.code)
        store.finish_trial(trial.trial_id, result)


def pointing(home, start) -> tuple[Command, ...]:
    """A click straight down at the place where the robot would start."""
    storey_y = min(home.navigation.storey_heights, key=lambda height: abs(height - start[1]))
    origin = (start[0], storey_y + 2.0, start[2])
    ray = ray_down(*origin, storey_y=storey_y)
    hit = home.cast(storey_y, ray.origin, ray.direction)
    assert hit is not None
    return (Start(), Click(ray, hit), Confirm())


def test_trials_of_all_homes_and_of_practice_are_verified_and_stored(
    study: Path, invented_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert StudyVerify(study=study, dataset=invented_root, jobs=2).run() == 0
    printed = capsys.readouterr().out
    assert "6 verified" in printed
    assert "Stored beside the trials" in printed
    with read_study(study) as reader:
        entries = reader.verifications()
        assert {entry.status for entry in entries} == {"verified"}
        assert len({entry.trial_id for entry in entries}) == 6
        assert len({entry.sim_hash for entry in entries}) == len({key.scene for key in scenes_of(reader)})


def scenes_of(reader) -> set:
    return {trial.key._replace(split="easy", episode_id="") for code in reader.codes() for trial in reader.trials(code)}


def test_a_study_that_is_served_is_verified_without_being_written(
    study: Path, invented_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = load_study(study)
    with read_study(study) as reader:
        plan = reader.plan
    with open_store(study, config, plan):
        assert StudyVerify(study=study, dataset=invented_root).run() == 0
    assert "Not stored:" in capsys.readouterr().out
    with read_study(study) as reader:
        assert reader.verifications() == ()


def test_an_outcome_that_is_too_good_fails_and_ends_with_1(
    tmp_path: Path, study: Path, invented_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "cheated"
    config, plan = cheated(study, folder)
    with open_planned(folder, config, plan) as store:
        walker = next(person for person in plan.participants if person.task == "pan")
        trial = store.open_trial(walker.code, 2)
        do_trial(store, invented_root, trial, (Start(), GiveUp(), GiveUp()))
    copy = tmp_path / "better"
    config, plan = cheated(study, copy)
    with read_study(folder) as reader:
        done = next(trial for trial in reader.trials(walker.code) if trial.outcome is not None)
        events = [item.event for item in reader.events(done.trial_id or "")]
    assert isinstance(done.outcome, EpisodeEnd)
    with open_planned(copy, config, plan) as store:
        trial = store.open_trial(walker.code, 2)
        store.append_many(trial.trial_id, trial.epoch, events)
        better = done.outcome.measures.model_copy(update={"centre_distance": 0.0})
        store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup", measures=better))
    assert StudyVerify(study=copy, dataset=invented_root).run() == 1
    printed = capsys.readouterr().out
    assert "1 failed" in printed
    assert "outcome.measures.centre_distance is stored as 0.0, recomputed as" in printed


def cheated(study: Path, folder: Path) -> tuple[StudyConfig, StudyPlan]:
    """The same study without records, in another folder."""
    config = load_study(study)
    save_study(folder, config)
    with read_study(study) as reader:
        plan = reader.plan
    (folder / "plan.json").write_text(plan.model_dump_json())
    (folder / PRACTICE_FOLDER).symlink_to(study / PRACTICE_FOLDER)
    return config, plan


def test_another_dataset_is_refused(study: Path) -> None:
    with pytest.raises(DatasetError, match=r"--dataset .*practice: has digest [0-9a-f]{12}; expected"):
        StudyVerify(study=study, dataset=study / PRACTICE_FOLDER).run()


def test_a_study_in_homes_of_another_version_is_not_verified_but_exported_and_reported(
    study: Path,
    invented_root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(study_files, "HOMES_VERSION", study_files.HOMES_VERSION + 1)
    monkeypatch.setattr(report_verb, "HOMES_VERSION", study_files.HOMES_VERSION)
    refused = rf"homes of version {HOMES_VERSION}, this program .*Serve and verify it with personal-viz 0"
    with pytest.raises(StudyError, match=refused) as caught:
        StudyVerify(study=study, dataset=invented_root).run()
    assert "\n" not in str(caught.value)
    assert StudyExport(study=study, out=tmp_path / "out").run() == 0
    assert read_manifest(tmp_path / "out").homes_version == HOMES_VERSION
    with pytest.raises(StudyError, match=refused):
        StudyImportCheck(export=tmp_path / "out", dataset=invented_root).run()
    for source in (study, tmp_path / "out"):
        capsys.readouterr()
        verb = report_verb.StudyReportVerb(runs=(source,), dataset=invented_root, out=tmp_path / "report")
        assert verb.run() == 0
        assert f"homes of version {HOMES_VERSION}, this program makes version" in capsys.readouterr().err


def test_an_export_is_read_back_and_agrees(
    study: Path, invented_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert StudyExport(study=study).run() == 0
    out = study / "exports" / "records"
    assert f"Written to {out}: 2 run folders, 6 trials in trials.csv, 2 of them in no run" in capsys.readouterr().out
    assert StudyImportCheck(export=out, dataset=invented_root).run() == 0
    assert "6 of 6 outcomes agree with their events" in capsys.readouterr().out
    rows = [json.loads(line) for line in (out / "trials.jsonl").read_text().splitlines()]
    rows[-1]["planar_distance"] = 0.0
    (out / "trials.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(StudyError, match=r"trials\.jsonl: has sha256"):
        StudyImportCheck(export=out, dataset=invented_root).run()


def test_a_trial_and_a_person_are_left_out_and_counted_again(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run_folders() -> int:
        StudyExport(study=study).run()
        return len(list((study / "exports" / "records").glob("records-*")))

    def say(**changes: object) -> str:
        assert StudyExclude(study, **({"rule": "disturbed", "reason": "x"} | changes)).run() == 0
        return capsys.readouterr().out

    assert run_folders() == 2
    capsys.readouterr()
    assert "participant p01 is left out by rule disturbed (written down before data)" in say(who="p01")
    assert "rule own (not written down before data)" in say(who="p02/2", rule="own")
    new = "rule unverifed (not written down before data)"
    assert new in say(who="p02/2", rule="unverifed", new_rule=True)
    assert new in say(who="p02/3", rule="unverifed")  # in force, so it is known
    assert "trial p02/2 counts again" in say(who="p02/2", rule="unverifed", undo=True)
    assert "trial p02/3 counts again" in say(who="p02/3", rule="unverifed", undo=True)
    assert "trial p02/3 is left out" in say(who="p02/3")
    assert run_folders() == 0
    capsys.readouterr()
    assert "participant p01 counts again" in say(who="p01", undo=True, reason=None)
    assert "trial p02/3 counts again" in say(who="p02/3", undo=True)
    assert run_folders() == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"who": "p2/3"}, "p2/3: expected a participant's code, such as p03, or with a place in the order"),
        ({"who": "p02/77"}, "trial p02/77: was not assigned"),
        ({"who": "p77"}, "found no participant 'p77'; expected one of p01 to p02. See"),
        ({"who": "P1"}, "found no participant 'P1'; expected one of p01 to p02. Did you mean 'p01'? See study status"),
        ({"who": "p01", "rule": "Was bad!"}, "--rule Was bad!: expected small letters"),
        ({"who": "p01", "reason": " "}, "--reason: found nothing"),
        ({"who": "p01", "undo": True}, "rule disturbed leaves nothing out here"),
        (
            {"who": "p01", "rule": "distrubed"},
            "--rule: found 'distrubed', which is no known rule. Did you mean 'disturbed'? Nothing was changed",
        ),
    ],
)
def test_impossible_exclusions_are_refused(study: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(StudyError, match=re.escape(message)):
        StudyExclude(study, **({"rule": "disturbed", "reason": "x"} | changes)).run()
    with read_study(study) as reader:
        assert {entry.rule_id for entry in reader.exclusions()} <= {"disturbed", "own", "unverifed"}  # of another test
