"""Where a participant is follows from what is stored: every step, breaks, sittings, and the ways out."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import pytest

from human_study.design.study import StudyBreaks, StudyConfig, StudyDataset, StudySequences
from human_study.journey import (
    AssignedTrial,
    Journey,
    Person,
    Place,
    Stage,
    StageEntry,
    ended_trial,
    has_rested,
    journey_of,
    trial_before,
)
from human_study.texts.participants import trial_name
from sim.types import EpisodeKey

NOW_NS = 1_800_000_000 * 10**9
Entered = tuple[Stage, dict[str, Any]]
READY: tuple[Entered, ...] = (("device_ok", {}), ("consented", {}), ("instructed", {}), ("quiz_passed", {}))


def config(**choices: Any) -> StudyConfig:
    """A study of both tasks with all pages."""
    return StudyConfig(study="flow", dataset=StudyDataset(sha256="0" * 64), task=("pan", "pog"), **choices)


def trial(order_no: int, *, phase: str = "main", is_over: bool = False, is_begun: bool = False) -> AssignedTrial:
    """One assigned PAN trial."""
    key = EpisodeKey("easy", f"Home{order_no}", f"e{order_no}")
    end = "done" if is_over else None
    return AssignedTrial(order_no, phase, "pan", "none", key, is_begun=is_begun or is_over, end=end)


def somebody(*stages: Entered, trials: Sequence[AssignedTrial] = (), is_claimed: bool = True) -> Person:
    """A participant with these stages and trials."""
    entries = tuple(StageEntry(stage, detail, NOW_NS) for stage, detail in stages)
    return Person("p01", "pan", is_claimed, entries, tuple(trials))


def journey(
    *stages: Entered, trials: Sequence[AssignedTrial] = (trial(1), trial(2)), study: StudyConfig | None = None
) -> Journey:
    """Where somebody is."""
    return journey_of(study or config(), somebody(*stages, trials=trials))


def place(
    *stages: Entered, trials: Sequence[AssignedTrial] = (trial(1), trial(2)), study: StudyConfig | None = None
) -> Place:
    """The place alone."""
    return journey(*stages, trials=trials, study=study).place


def test_the_pages_come_in_the_order_of_the_study_file() -> None:
    steps = [place(*READY[:number]) for number in range(5)]
    assert steps == ["device", "consent", "instructions", "quiz", "trial"]
    other = config(flow=("consent", "device"))
    assert [place(*READY[1 : 1 + number], study=other) for number in range(2)] == ["consent", "device"]
    assert place(("consented", {}), ("device_ok", {}), study=other) == "trial"


def test_a_failed_device_check_can_be_passed_later() -> None:
    assert place(("device_failed", {})) == "device"
    assert place(("device_failed", {}), ("device_ok", {})) == "consent"


def test_the_demo_has_one_page_and_none_for_people_who_come_back() -> None:
    demo = config(flow=("instructions",))
    assert place(study=demo) == "instructions"
    assert place(study=demo, trials=[trial(1, is_begun=True), trial(2)]) == "trial"


def test_two_failed_rounds_of_the_quiz_lead_back_to_the_instructions() -> None:
    ready = READY[:3]
    failed: Entered = ("quiz_failed", {"wrong": ["stop"]})

    def at(*stages: Entered) -> tuple[Place, int]:
        found = journey(*stages)
        return found.place, found.failed_rounds

    assert at(*ready) == ("quiz", 0)
    assert at(*ready, failed) == ("quiz", 1)
    assert at(*ready, failed, failed) == ("instructions", 2)
    assert at(*ready, failed, failed, ("instructed", {})) == ("quiz", 0)
    assert place(*ready, failed, failed, ("instructed", {}), failed, ("quiz_passed", {})) == "trial"


def test_practice_attention_and_given_back_trials_are_not_counted() -> None:
    others = [trial(2), trial(3)]
    assert journey(*READY, trials=[trial(1, phase="practice"), *others]) == Journey("practice", 0, 2)
    assert journey(*READY, trials=[trial(1, phase="practice", is_over=True), *others]) == Journey("trial", 0, 2)
    trials = [trial(1, is_over=True), trial(2, phase="check", is_over=True), trial(3)]
    assert journey(*READY, trials=trials) == Journey("trial", 1, 2)
    given_back = dataclasses.replace(trial(1, is_begun=True), is_released=True)
    assert journey(*READY, trials=[given_back, trial(2)]) == Journey("trial", 0, 1)
    assert place(*READY, trials=[given_back]) == "ending"


@pytest.mark.parametrize("sequences", [None, StudySequences(sha256="0" * 64)], ids=["searches", "homes"])
def test_a_break_comes_after_the_set_number_of_trials_and_never_within_one(sequences: StudySequences | None) -> None:
    study = config(breaks=StudyBreaks(every=2, sitting_max=None), sequences=sequences)
    done = [trial(1, is_over=True), trial(2, is_over=True)]
    assert place(*READY, trials=[*done, trial(3)], study=study) == "break"
    assert place(*READY, ("break_started", {"done": 2}), trials=[*done, trial(3)], study=study) == "break"
    assert place(*READY, ("break_ended", {"done": 2}), trials=[*done, trial(3)], study=study) == "trial"
    assert place(*READY, trials=[*done, trial(3, is_begun=True)], study=study) == "trial"
    assert place(*READY, trials=done, study=study) == "ending"


def test_a_sitting_ends_after_the_set_number_of_trials_never_within_one_and_the_next_goes_on() -> None:
    study = config(breaks=StudyBreaks(every=None, sitting_max=1, sitting_gap_s=3600.0))
    trials = [trial(1, is_over=True), trial(2), trial(3)]
    ended: Entered = ("break_started", {"done": 1, "sitting": True})
    assert journey(*READY, trials=trials, study=study) == Journey("pause", 1, 3)
    assert journey(*READY, ended, trials=trials, study=study).rest == StageEntry(*ended, NOW_NS)
    assert place(*READY, ended, ("sitting_started", {"done": 1}), trials=trials, study=study) == "trial"
    study = config(breaks=StudyBreaks(every=1, sitting_max=1))
    trials = [trial(1, is_over=True), trial(2, is_begun=True)]
    assert place(*READY, trials=trials, study=study) == "trial"


@pytest.mark.parametrize("stage", ["declined", "withdrawn", "screened_out", "full"])
def test_a_person_who_is_out_stays_out(stage: Stage) -> None:
    assert place(*READY, (stage, {})) == stage
    assert place((stage, {}), *READY) == stage


def test_a_person_has_finished_only_when_that_is_stored() -> None:
    assert place(*READY, trials=[trial(1, is_over=True)]) == "ending"
    assert place(*READY, ("finished", {}), trials=[trial(1, is_over=True)]) == "finished"


def test_a_person_who_never_came_has_not_arrived_and_a_drop_out_may_return() -> None:
    assert journey_of(config(), somebody(is_claimed=False)).place == "not_arrived"
    gone: Entered = ("dropped_out", {})
    assert place(*READY, gone) == "dropped_out"
    assert place(*READY, gone, ("returned", {})) == "trial"
    assert place(*READY, gone, ("withdrawn", {})) == "withdrawn"


@pytest.mark.parametrize(
    ("stages", "trials", "before", "name"),
    [
        ((), [trial(1), trial(2)], None, ""),
        ((), [trial(1, is_over=True), trial(2)], 1, "Search 1 of 2"),
        ((), [trial(1, is_over=True), trial(2, is_begun=True)], None, ""),
        ((), [trial(1, is_over=True), trial(2, is_over=True)], None, ""),
        ((), [trial(1, phase="practice", is_over=True), trial(2)], 1, "Practice 1 of 1"),
        ((), [trial(1, is_over=True), trial(2, phase="check", is_over=True), trial(3)], 2, "Search 2 of 3"),
    ],
)
def test_the_stored_trial_before_the_next_one_is_named(
    stages: tuple[Entered, ...], trials: list[AssignedTrial], before: int | None, name: str
) -> None:
    person = somebody(*stages, trials=trials)
    found = trial_before(person)
    assert (found and found.order_no) == before
    assert (trial_name(config(), person, found) if found else "") == name


def test_only_a_trial_that_has_ended_is_stored() -> None:
    trials = [trial(1, is_over=True), trial(3, is_begun=True), trial(4)]  # the second was given to somebody else
    person = somebody(trials=trials)
    assert [ended_trial(person, order_no) for order_no in (1, 2, 3, 4)] == [trials[0], None, None, None]


def test_a_person_back_from_a_break_has_rested_until_the_next_trial_is_done() -> None:
    def rested(*stages: Entered, num_done: int) -> bool:
        return has_rested(somebody(*stages), Journey("trial", num_done, 9))

    assert not rested(("sitting_started", {"done": 0}), num_done=0)
    assert not rested(("break_started", {"done": 2}), num_done=2)
    assert rested(("break_started", {"done": 2}), ("break_ended", {"done": 2}), num_done=2)
    assert rested(("sitting_started", {"done": 4}), num_done=4)
    assert not rested(("sitting_started", {"done": 4}), num_done=5)


def test_the_survey_comes_after_the_last_trial_and_once() -> None:
    over = [trial(1, is_over=True), trial(2, is_over=True)]
    assert place(*READY, trials=over) == "ending"
    assert place(*READY, ("survey_begun", {}), trials=over) == "survey"
    assert place(*READY, ("survey_begun", {}), ("survey_ended", {}), trials=over) == "ending"
    assert place(*READY, ("survey_begun", {}), ("withdrawn", {}), trials=over) == "withdrawn"
    assert place(*READY, ("survey_begun", {}), ("survey_ended", {}), ("finished", {}), trials=over) == "finished"
