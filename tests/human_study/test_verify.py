"""Verification of finished trials, which recomputes them from their events."""

import pytest

from human_study.export.verify import FAR_OFF, TrialHome, Verification, verify_trial
from human_study.trial.events import Act, Error, Event
from human_study.trial.outcome import Outcome, pog_outcome, unscored_outcome
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeRun
from sim.types import Action

from .finished import FAILURE, POINT, STOREYS, SUCCESS, events_of, room
from .small_world import episode
from .trials import run_of


def verify(events: list[Event], outcome: Outcome, *, home: TrialHome | None = None) -> Verification:
    return verify_trial(events, outcome, episode().key, home=home or room(), participant="p02")


def success() -> tuple[list[Event], EpisodeRun]:
    events = events_of(episode().key, SUCCESS, task="pan")
    return events, run_of(events)


def test_an_honest_trial_is_verified() -> None:
    events, run = success()
    found = verify(events, run.end)
    assert (found.status, found.first_bad_step, found.max_position_error, found.detail) == ("verified", None, 0.0, "")
    assert found.recomputed == run


def test_a_changed_pose_is_drift_from_that_step_on_and_a_changed_start_at_step_0() -> None:
    events, _ = success()
    acts = [index for index, event in enumerate(events) if isinstance(event, Act)]
    moved = events[acts[4]]
    events[acts[4]] = moved.model_copy(update={"position": (-0.6, 0.0, 0.0)})
    end = run_of(events).end
    found = verify(events, end)
    assert (found.status, found.first_bad_step) == ("drift", 5)
    assert found.max_position_error == pytest.approx(0.1)
    events, _ = success()
    events[0] = events[0].model_copy(update={"position": (0.0, 0.0, 0.5)})
    end = run_of(events).end
    assert (verify(events, end).status, verify(events, end).first_bad_step) == ("drift", 0)


def test_an_outcome_that_the_events_do_not_give_fails() -> None:
    events, run = success()
    wrong = EpisodeEnd(reason="stop", measures=run.end.measures.model_copy(update={"path_m": 9.0}))
    found = verify(events, wrong)
    assert found.status == "failed"
    assert found.detail == "outcome.measures.path_m is stored as 9.0, recomputed as 1.25"


def test_an_outcome_of_a_program_that_did_not_know_paper_strict_still_agrees() -> None:
    events, run = success()
    raw = run.end.model_dump(mode="json")
    assert raw["measures"]["rules"].pop("paper-strict") is not None
    old = EpisodeEnd.model_validate(raw)
    assert verify(events, old).status == "verified"
    raw["measures"]["rules"]["paper"]["success"] = False
    assert verify(events, EpisodeEnd.model_validate(raw)).status == "failed"


def test_steps_after_the_end_a_missing_end_and_another_scene_are_not_verified() -> None:
    events, run = success()
    extra = next(event for event in events if isinstance(event, Act) and event.action is Action.LEFT)
    assert verify([*events, extra], run.end).status == "failed"
    assert verify(events[:10], run.end).status == "failed"
    assert verify(events, run.end, home=room(scene_digest="e" * 64)).status == "unsupported"


def test_a_pog_answer_is_recomputed_from_its_clicks() -> None:
    events = events_of(episode().key, POINT, task="pog")
    answer = pog_outcome(events, episode(), storeys=STOREYS, participant="p02")
    assert verify(events, answer).status == "verified"
    assert isinstance(verify(events, answer).recomputed, Answer)
    moved = answer.model_copy(update={"candidates": ((-2.0, 0.5, 0.0),)})
    assert verify(events, moved).detail.startswith("outcome.candidates[0][0] is stored as -2.0")


def test_a_click_whose_ray_meets_the_home_elsewhere_is_drift() -> None:
    events = events_of(episode().key, POINT, task="pog")
    answer = pog_outcome(events, episode(), storeys=STOREYS, participant="p02")
    casts = ((-1.5, 0.1, 0.0), "verified", 0.0), ((-1.5, 0.1, 0.25), "drift", 0.25), (None, "drift", FAR_OFF)
    for point, status, error in casts:
        home = room()
        home = TrialHome(home.navigation, home.scene_digest, STOREYS, home.episode, cast=lambda *_: point)  # noqa: B023
        found = verify(events, answer, home=home)
        assert (found.status, found.max_position_error) == (status, pytest.approx(error))


def test_a_technical_failure_is_verified_up_to_where_it_failed() -> None:
    events = events_of(episode().key, FAILURE, task="pan")
    end = unscored_outcome(episode().key, "pan", reason="technical", participant="p02")
    assert verify(events, end).status == "verified"
    assert verify(events, EpisodeEnd(reason="giveup")).status == "failed"


def test_a_success_that_was_called_a_technical_failure_afterwards_fails() -> None:
    events, _ = success()
    found = verify(events, EpisodeEnd(reason="technical"))
    assert found.status == "failed"
    assert found.detail == "outcome.reason is stored as 'technical', recomputed as 'stop'"
    late = [*events, Error(message="measures", is_fatal=True)]
    assert verify(late, EpisodeEnd(reason="technical")).status == "verified"
