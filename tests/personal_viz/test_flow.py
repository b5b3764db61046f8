"""Which page comes next is a function of what is stored: every step, breaks, sittings, and the ways out."""

from typing import Any

import pytest

from human_study.design.study import StudyBreaks, StudyConfig, StudyDataset
from human_study.store.stages import Stage, StageEntry
from personal_viz.study_app.screens.pauses import MachineTime
from personal_viz.study_app.screens.place import (
    FlowPlace,
    ended_trial,
    flow_place,
    has_rested,
    parts_of,
    trial_before,
    trial_name,
)
from personal_viz.study_app.store_link import PersonPlace, TrialPlace
from sim.types import EpisodeKey

NOW_NS = 1_800_000_000 * 10**9
Entered = tuple[Stage, dict[str, Any]]
READY: tuple[Entered, ...] = (
    ("device_ok", {}),
    ("consented", {}),
    ("instructed", {}),
    ("quiz_passed", {}),
)


def config(**choices: Any) -> StudyConfig:
    """A study of both tasks with all pages."""
    return StudyConfig(study="flow", dataset=StudyDataset(sha256="0" * 64), task=("pan", "pog"), **choices)


def trial(order_no: int, *, phase: str = "main", is_over: bool = False, is_begun: bool = False) -> TrialPlace:
    """One assigned PAN trial."""
    key = EpisodeKey("easy", f"Home{order_no}", f"e{order_no}")
    return TrialPlace(order_no, phase, "pan", "none", key, is_begun or is_over, is_over)  # type: ignore[arg-type]


def place(
    *stages: Entered,
    trials: list[TrialPlace] | None = None,
    study: StudyConfig | None = None,
    seconds_ago: float = 0.0,
) -> FlowPlace:
    """Where somebody is with these stages, all of them entered so long ago."""
    at_ns = NOW_NS - int(seconds_ago * 1e9)
    entries = [StageEntry(stage, detail, at_ns) for stage, detail in stages]
    person = PersonPlace("p01", "pan", entries, trials if trials is not None else [trial(1), trial(2)], None)
    return flow_place(study or config(), person, now=MachineTime(NOW_NS, 10**15, None))


def test_the_pages_come_in_the_order_of_the_study_file() -> None:
    steps = [place(*READY[:number]).step for number in range(5)]
    assert steps == ["device", "consent", "instructions", "quiz", "trial"]
    other = config(flow=("consent", "device"))
    assert [place(*READY[1 : 1 + number], study=other).step for number in range(2)] == ["consent", "device"]
    assert place(("consented", {}), ("device_ok", {}), study=other).step == "trial"


def test_a_failed_device_check_can_be_passed_later() -> None:
    assert place(("device_failed", {})).step == "device"
    assert place(("device_failed", {}), ("device_ok", {})).step == "consent"


def test_the_demo_has_one_page_and_none_for_who_comes_back() -> None:
    demo = config(flow=("instructions",))
    assert place(study=demo).step == "instructions"
    assert place(study=demo, trials=[trial(1, is_begun=True), trial(2)]).step == "trial"


def test_two_failed_rounds_of_the_quiz_lead_back_to_the_instructions() -> None:
    ready = READY[:3]
    failed: Entered = ("quiz_failed", {"wrong": ["stop"]})
    assert (place(*ready).step, place(*ready).failed_rounds) == ("quiz", 0)
    assert (place(*ready, failed).step, place(*ready, failed).failed_rounds) == ("quiz", 1)
    assert (place(*ready, failed, failed).step, place(*ready, failed, failed).failed_rounds) == ("instructions", 2)
    again = place(*ready, failed, failed, ("instructed", {}))
    assert (again.step, again.failed_rounds) == ("quiz", 0)
    assert place(*ready, failed, failed, ("instructed", {}), failed, ("quiz_passed", {})).step == "trial"


def test_practice_comes_before_the_counted_trials_and_is_not_counted() -> None:
    trials = [trial(1, phase="practice"), trial(2), trial(3)]
    first = place(*READY, trials=trials)
    assert (first.step, first.num_done, first.num_all) == ("practice", 0, 2)
    after = place(*READY, trials=[trial(1, phase="practice", is_over=True), trial(2), trial(3)])
    assert (after.step, after.num_done, after.num_all) == ("trial", 0, 2)


def test_attention_trials_are_not_counted_either() -> None:
    trials = [trial(1, is_over=True), trial(2, phase="check", is_over=True), trial(3)]
    assert place(*READY, trials=trials) == FlowPlace("trial", 1, 2)


def test_a_break_comes_after_so_many_trials_and_never_within_one() -> None:
    study = config(breaks=StudyBreaks(every=2, sitting_max=None))
    done = [trial(1, is_over=True), trial(2, is_over=True)]
    assert place(*READY, trials=[*done, trial(3)], study=study).step == "break"
    assert place(*READY, ("break_started", {"done": 2}), trials=[*done, trial(3)], study=study).step == "break"
    assert place(*READY, ("break_ended", {"done": 2}), trials=[*done, trial(3)], study=study).step == "trial"
    assert place(*READY, trials=[*done, trial(3, is_begun=True)], study=study).step == "trial"
    assert place(*READY, trials=done, study=study).step == "none_due"


@pytest.mark.parametrize(("seconds_ago", "back_in_s"), [(0.0, 3600.0), (3000.0, 600.0), (4000.0, 0.0)])
def test_a_sitting_ends_after_so_many_trials_and_goes_on_after_the_gap(seconds_ago: float, back_in_s: float) -> None:
    study = config(breaks=StudyBreaks(every=None, sitting_max=1, sitting_gap_s=3600.0))
    trials = [trial(1, is_over=True), trial(2), trial(3)]
    ended: Entered = ("break_started", {"done": 1, "sitting": True})
    paused = place(*READY, ended, trials=trials, study=study, seconds_ago=seconds_ago)
    assert (paused.step, paused.back_in_s) == ("pause", back_in_s)
    assert place(*READY, ended, ("sitting_started", {"done": 1}), trials=trials, study=study).step == "trial"


def test_a_trial_under_way_is_not_held_up_by_the_end_of_a_sitting() -> None:
    study = config(breaks=StudyBreaks(every=1, sitting_max=1))
    trials = [trial(1, is_over=True), trial(2, is_begun=True)]
    assert place(*READY, trials=trials, study=study).step == "trial"


@pytest.mark.parametrize("stage", ["declined", "withdrawn", "screened_out", "full"])
def test_who_is_out_stays_out(stage: Stage) -> None:
    assert place(*READY, (stage, {})).step == stage
    assert place((stage, {}), *READY).step == stage


def test_the_end_is_what_is_stored_and_not_that_nothing_is_due() -> None:
    assert place(*READY, trials=[trial(1, is_over=True)]).step == "none_due"
    assert place(*READY, ("finished", {}), trials=[trial(1, is_over=True)]).step == "finished"


def test_the_parts_of_the_way_are_those_that_the_study_has() -> None:
    person = PersonPlace("p01", "pan", [], [trial(1, phase="practice"), trial(2)], None)
    assert parts_of(config(), person) == (
        "Check",
        "Consent",
        "Instructions",
        "Questions",
        "Practice",
        "Study",
        "End",
    )
    no_practice = PersonPlace("p01", "pan", [], [trial(1)], None)
    assert parts_of(config(flow=("consent",)), no_practice) == ("Consent", "Study", "End")
    assert parts_of(config(flow=("instructions",)), person) == ()


@pytest.mark.parametrize(
    ("stages", "trials", "before", "name"),
    [
        ((), [trial(1), trial(2)], None, ""),
        ((), [trial(1, is_over=True), trial(2)], 1, "Trial 1 of 2"),
        ((), [trial(1, is_over=True), trial(2, is_begun=True)], None, ""),
        ((), [trial(1, is_over=True), trial(2, is_over=True)], None, ""),
        ((), [trial(1, phase="practice", is_over=True), trial(2)], 1, "Practice 1 of 1"),
        ((), [trial(1, is_over=True), trial(2, phase="check", is_over=True), trial(3)], 2, "Trial 2 of 3"),
    ],
)
def test_the_stored_trial_before_the_next_one_is_named(
    stages: tuple[Entered, ...], trials: list[TrialPlace], before: int | None, name: str
) -> None:
    person = PersonPlace("p01", "pan", [StageEntry(stage, detail, NOW_NS) for stage, detail in stages], trials, None)
    found = trial_before(person)
    assert (found and found.order_no) == before
    assert (trial_name(person, found) if found else "") == name


def test_only_a_trial_that_has_ended_is_stored() -> None:
    trials = [trial(1, is_over=True), trial(3, is_begun=True), trial(4)]  # the second was given to somebody else
    person = PersonPlace("p01", "pan", [], trials, None)
    assert [ended_trial(person, order_no) for order_no in (1, 2, 3, 4)] == [trials[0], None, None, None]


def test_whoever_went_on_from_a_break_has_rested_until_the_next_trial_is_done() -> None:
    def rested(*stages: Entered, num_done: int) -> bool:
        entries = [StageEntry(stage, detail, NOW_NS) for stage, detail in stages]
        return has_rested(PersonPlace("p01", "pan", entries, [], None), FlowPlace("trial", num_done, 9))

    assert not rested(("sitting_started", {"done": 0}), num_done=0)
    assert not rested(("break_started", {"done": 2}), num_done=2)
    assert rested(("break_started", {"done": 2}), ("break_ended", {"done": 2}), num_done=2)
    assert rested(("sitting_started", {"done": 4}), num_done=4)
    assert not rested(("sitting_started", {"done": 4}), num_done=5)
