"""Export to run folders, and doing finished trials again."""

from pathlib import Path

import pytest

from human_study.commands import Click, Confirm, Fail, GiveUp, Move, PanCommand, PogCommand, PressStop, Start
from human_study.events import Act, Event
from human_study.export import Manifest, export_study
from human_study.outcome import Outcome, pan_outcome, pog_outcome
from human_study.session import PanSession, PogSession
from human_study.store import StudyStore, open_store
from human_study.study import StudyScene
from human_study.tickets import token_hash
from human_study.verify import Verification, verify_trial
from sim.errors import RunFileError, StudyError
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun, read_run
from sim.types import Action, EpisodeKey

from .small_world import SCENE_DIGEST, SquareRoom, env, episode, plan, study
from .stores import edit
from .test_session import FORWARD, LEFT, RAY

STOREYS = [(0.0, 0.0)]
SUCCESS: list[PanCommand] = [Start(), *[LEFT] * 3, *[FORWARD] * 5, PressStop(), PressStop()]
POINT: list[PogCommand] = [Start(), Click(RAY, (-1.5, 0.1, 0.0)), Confirm()]


def events_of(key: EpisodeKey, commands: list, *, task: str) -> list[Event]:
    """What a session makes of the commands, one a second."""
    config = study()
    if task == "pan":
        session = PanSession(
            env(), key=key, task=config.task_for(episode(key.episode_id), "pan"), scene_digest=SCENE_DIGEST
        )
    else:
        text = config.task_for(episode(key.episode_id), "pog")
        session = PogSession(key=key, task=text, storeys=(0.0,), scene_digest=SCENE_DIGEST)
    return [event for number, command in enumerate(commands) for event in session.handle(command, number).events]


def do_trial(store: StudyStore, code: str, order_no: int, commands: list) -> None:
    """One participant's whole trial, stored and finished."""
    trial = store.open_trial(code, order_no)
    store.append_many(trial.trial_id, trial.epoch, events_of(trial.key, commands, task=trial.task))
    events = [stored.event for stored in store.events(trial.trial_id)]
    home = episode(trial.key.episode_id)
    outcome: Outcome
    if trial.task == "pan":
        outcome = pan_outcome(events, home, navigation=SquareRoom(), participant=code).end
    else:
        outcome = pog_outcome(events, home, storeys=STOREYS, participant=code)
    store.finish_trial(trial.trial_id, outcome)


def study_with_trials(folder: Path) -> None:
    """p01: one answer. p02: a success, a technical failure, and one trial that still runs."""
    with open_store(folder, study()) as store:
        for person in plan(study()).participants:
            store.add_participant(person.code, token_hash(person.code), person.trials)
        do_trial(store, "p01", 1, POINT)
        do_trial(store, "p02", 1, SUCCESS)
        do_trial(store, "p02", 2, [Start(), FORWARD, Fail("renderer died")])
        running = store.open_trial("p02", 3)
        store.append_many(running.trial_id, running.epoch, events_of(running.key, [Start(), FORWARD], task="pan"))


def verify(events: list[Event], outcome: Outcome, **changes: object) -> Verification:
    arguments = {"navigation": SquareRoom(), "scene_digest": SCENE_DIGEST, "storeys": STOREYS, "participant": "p02"}
    return verify_trial(events, outcome, episode(), **(arguments | changes))  # type: ignore[arg-type]


def success() -> tuple[list[Event], EpisodeRun]:
    events = events_of(episode().key, SUCCESS, task="pan")
    return events, pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02")


def test_finished_trials_become_run_folders_like_those_of_agents(tmp_path: Path) -> None:
    study_with_trials(tmp_path / "study")
    folders = export_study(tmp_path / "study", tmp_path / "runs")
    assert [folder.name for folder in folders] == ["pilot-p01-pog", "pilot-p02-pan"]
    pog, pan = (read_run(folder) for folder in folders)
    assert (pan.info.who, pan.info.who_kind, pan.info.scene_kind) == ("human", "human", "invented")
    assert (len(pan.episodes), len(pan.answers), len(pog.episodes), len(pog.answers)) == (1, 0, 0, 1)
    run, answer = pan.episodes[0], pog.answers[0]
    first = plan(study()).participants[1].trials[0].key
    assert run == pan_outcome(
        events_of(first, SUCCESS, task="pan"),
        episode(first.episode_id),
        navigation=SquareRoom(),
        participant="p02",
    )
    assert run.end.measures is not None
    assert run.end.measures.rules["paper"] is not None
    assert run.end.measures.rules["paper"].spl == pytest.approx(0.8)
    assert answer.measures is not None
    assert answer.measures.success
    assert answer.participant == "p01"


def test_the_manifest_says_what_was_left_out_and_why(tmp_path: Path) -> None:
    study_with_trials(tmp_path / "study")
    export_study(tmp_path / "study", tmp_path / "runs")
    manifest = Manifest.model_validate_json((tmp_path / "runs" / "export.json").read_bytes())
    rows = [(row.code, row.order_no, row.end_reason, row.run_id) for row in manifest.trials]
    assert rows == [
        ("p01", 1, "click", "pilot-p01-pog"),
        ("p02", 1, "stop", "pilot-p02-pan"),
        ("p02", 2, "technical", None),
    ]
    assert manifest.num_unfinished == 3
    assert manifest.study_version == study().study_version


def test_exporting_twice_changes_nothing(tmp_path: Path) -> None:
    study_with_trials(tmp_path / "study")

    def files(out: Path) -> dict[str, bytes]:
        export_study(tmp_path / "study", out)
        return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}

    first = files(tmp_path / "runs")
    assert files(tmp_path / "runs") == first == files(tmp_path / "again")
    assert len(first) == 5


def test_the_export_of_a_study_that_was_tampered_with_is_refused(tmp_path: Path) -> None:
    study_with_trials(tmp_path / "study")
    edit(tmp_path / "study", "UPDATE event SET payload = replace(payload, 'forward', 'left') WHERE kind = 'act'")
    with pytest.raises(StudyError, match="does not continue the chain"):
        export_study(tmp_path / "study", tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_runs_of_another_study_are_not_added_to(tmp_path: Path) -> None:
    study_with_trials(tmp_path / "study")
    export_study(tmp_path / "study", tmp_path / "runs")
    other = study(seed=5)
    with open_store(tmp_path / "other", other) as store:
        for person in plan(other).participants:
            store.add_participant(person.code, token_hash(person.code), person.trials)
        do_trial(store, "p01", 1, POINT)
    with pytest.raises(RunFileError, match="seed is 0, this run has 5"):
        export_study(tmp_path / "other", tmp_path / "runs")


def test_a_study_that_mixes_scene_kinds_exports_them_apart(tmp_path: Path) -> None:
    kinds = (StudyScene(name="room", kind="invented"), StudyScene(name="other", kind="scan"))
    mixed = study(scenes=kinds)
    with open_store(tmp_path / "study", mixed) as store:
        for person in plan(mixed).participants:
            store.add_participant(person.code, token_hash(person.code), person.trials)
        do_trial(store, "p02", 1, SUCCESS)
    (folder,) = export_study(tmp_path / "study", tmp_path / "runs")
    assert folder.name == "pilot-p02-pan-invented"


def test_an_honest_trial_is_verified() -> None:
    events, run = success()
    found = verify(events, run.end)
    assert (found.status, found.first_bad_step, found.max_position_error, found.detail) == ("verified", None, 0.0, "")
    assert found.recomputed == run


def test_a_changed_pose_is_drift_from_that_step_on() -> None:
    events, _ = success()
    acts = [index for index, event in enumerate(events) if isinstance(event, Act)]
    moved = events[acts[4]]
    assert isinstance(moved, Act)
    events[acts[4]] = moved.model_copy(update={"position": (-0.6, 0.0, 0.0)})
    end = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02").end
    found = verify(events, end)
    assert (found.status, found.first_bad_step) == ("drift", 5)
    assert found.max_position_error == pytest.approx(0.1)


def test_a_changed_start_is_drift_at_step_0() -> None:
    events, _ = success()
    events[0] = events[0].model_copy(update={"position": (0.0, 0.0, 0.5)})
    end = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02").end
    assert (verify(events, end).status, verify(events, end).first_bad_step) == ("drift", 0)


def test_an_outcome_that_the_events_do_not_give_fails() -> None:
    events, run = success()
    assert run.end.measures is not None
    wrong = EpisodeEnd(reason="stop", measures=run.end.measures.model_copy(update={"path_m": 9.0}))
    found = verify(events, wrong)
    assert found.status == "failed"
    assert found.detail == "outcome.measures.path_m is stored as 9.0, recomputed as 1.25"


def test_steps_after_the_end_fail() -> None:
    events, run = success()
    extra = next(event for event in events if isinstance(event, Act) and event.action is Action.LEFT)
    assert verify([*events, extra], run.end).status == "failed"


def test_a_trial_that_never_ended_fails() -> None:
    events, run = success()
    assert verify(events[:10], run.end).status == "failed"


def test_a_trial_on_another_scene_is_unsupported() -> None:
    events, run = success()
    assert verify(events, run.end, scene_digest="e" * 64).status == "unsupported"


def test_a_pog_answer_is_recomputed_from_its_clicks() -> None:
    events = events_of(episode().key, POINT, task="pog")
    answer = pog_outcome(events, episode(), storeys=STOREYS, participant="p02")
    assert verify(events, answer).status == "verified"
    assert isinstance(verify(events, answer).recomputed, Answer)
    moved = answer.model_copy(update={"candidates": ((-2.0, 0.5, 0.0),)})
    assert verify(events, moved).detail.startswith("outcome.candidates[0][0] is stored as -2.0")


def test_giving_up_is_a_result_and_is_exported(tmp_path: Path) -> None:
    with open_store(tmp_path / "study", study()) as store:
        for person in plan(study()).participants:
            store.add_participant(person.code, token_hash(person.code), person.trials)
        do_trial(store, "p02", 1, [Start(), Move(Action.RIGHT, "KeyD"), GiveUp()])
        do_trial(store, "p01", 1, [Start(), GiveUp()])
    pog, pan = (read_run(folder) for folder in export_study(tmp_path / "study", tmp_path / "runs"))
    assert pan.episodes[0].end.reason == "giveup"
    assert (pog.answers[0].reason, pog.answers[0].candidates) == ("giveup", ())
