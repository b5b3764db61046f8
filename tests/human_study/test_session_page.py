"""A session's record of its page, the question after the end, and taking a trial over from another tab."""

import pytest

from human_study.trial.commands import (
    Click,
    Confirm,
    Fail,
    GiveUp,
    Measure,
    PageChanged,
    PressStop,
    Rate,
    Resize,
    Resume,
    Start,
    Tick,
)
from human_study.trial.events import Confidence, Net, Resized
from human_study.trial.outcome import end_reason
from human_study.trial.terms import TrialTerms
from human_study.trial.views import PanView, PogView, RateView

from .trials import LEFT, RAY, answer_of, begun, driven, kinds, new_session, rebuilt_session, resumed, run_of

ASKING = TrialTerms(condition="map_open", asks_confidence=True)
STOPPED = [(Start(), 0.0), (LEFT, 1.0), (PressStop(), 2.0), (PressStop(), 3.0)]


def test_the_page_tells_of_itself_with_both_clocks() -> None:
    session = new_session("pan", TrialTerms(condition="none"))
    names = ("blur", "hidden", "visible", "focus")
    events = driven(session, [(Start(), 0.0), *((PageChanged(name, t_cli_ms=4.5), 1.0) for name in names)])
    assert kinds(events) == ["open", "shown", *names]
    assert (events[-1].t_s, events[-1].t_cli_ms) == (1.0, 4.5)


def test_the_size_of_a_page_is_kept_rounded_and_within_bounds() -> None:
    session = new_session("pan", TrialTerms(condition="none"))
    sizes = [(1366, 641), (-5, 10**9)]
    events = driven(session, [(Start(), 0.0), *((Resize(*size), 1.0) for size in sizes)])
    kept = [(event.width, event.height) for event in events if isinstance(event, Resized)]
    assert kept == [(1350, 650), (0, 100_000)]


def test_round_trips_are_kept_and_one_that_is_no_number_is_refused() -> None:
    session = begun("pog", TrialTerms(condition="map_open"))
    (kept,) = session.handle(Measure(41.25), 1.0).events
    assert isinstance(kept, Net)
    assert kept.round_trip_ms == 41.25
    with pytest.raises(ValueError, match="finite"):
        session.handle(Measure(float("nan")), 1.0)


def test_after_the_end_nothing_of_the_page_is_recorded() -> None:
    session = new_session("pan", TrialTerms(condition="none"))
    driven(session, STOPPED)
    assert session.handle(PageChanged("hidden"), 4.0).events == ()


def test_a_person_who_has_answered_is_asked_how_sure_the_answer_is() -> None:
    session = new_session("pan", ASKING)
    events = driven(session, STOPPED)
    assert (session.is_over, session.is_done, session.phase) == (True, False, "rate")
    assert session.view(3.0) == RateView((1, 2, 3, 4, 5))
    assert session.handle(LEFT, 4.0).events == ()
    update = session.handle(Rate(4), 5.0)
    assert isinstance(update.events[0], Confidence)
    assert update.events[0].value == 4
    assert session.is_done
    assert isinstance(update.view, PanView)
    assert update.view.is_over
    assert session.handle(Rate(5), 6.0).events == ()
    run = run_of([*events, *update.events])
    assert (run.end.reason, [step.t_s for step in run.steps]) == ("stop", [1.0, 3.0])


def test_the_question_changes_neither_answer_nor_time() -> None:
    session = new_session("pog", ASKING)
    events = driven(session, [(Start(), 0.0), (Click(RAY, (-2.0, 0.5, 0.0)), 6.0), (Confirm(), 8.0), (Rate(1), 20.0)])
    assert kinds(events) == ["open", "click", "confirm", "confidence"]
    assert answer_of(events).t_s == 8.0


@pytest.mark.parametrize("ending", [[(GiveUp(), 1.0), (GiveUp(), 2.0)], [(Fail("renderer died"), 1.0)]])
def test_a_person_who_has_not_answered_is_not_asked(ending: list) -> None:
    session = new_session("pan", ASKING)
    driven(session, [(Start(), 0.0), *ending])
    assert session.phase == "done"


def test_the_question_does_not_wait_for_ever() -> None:
    session = new_session("pan", ASKING)
    driven(session, STOPPED)
    wait_s = session.wait_s(3.0)
    assert wait_s == 60.0
    update = session.handle(Tick(), 63.0)
    assert isinstance(update.events[0], Confidence)
    assert update.events[0].value is None
    assert session.is_done
    assert session.wait_s(63.0) is None


def test_a_person_who_comes_back_to_the_question_finds_it_unless_it_is_too_late() -> None:
    events = driven(new_session("pan", ASKING), STOPPED)
    soon, back = resumed("pan", ASKING, events, away_s=30.0)
    assert (soon.phase, back) == ("rate", ())
    late, back = resumed("pan", ASKING, events, away_s=700.0)
    assert (late.phase, kinds(back)) == ("done", ["confidence"])
    assert end_reason([*events, *back]) == "stop"


def test_a_rated_trial_is_done_when_it_is_rebuilt_and_only_five_answers_can_be_given() -> None:
    events = driven(new_session("pan", ASKING), [*STOPPED, (Rate(2), 4.0)])
    assert rebuilt_session("pan", ASKING, events).is_done
    with pytest.raises(AssertionError):
        Rate(6)


@pytest.mark.parametrize("kind", ["pan", "pog"])
def test_taking_a_trial_over_from_an_open_tab_is_logged(kind: str) -> None:
    terms = TrialTerms(condition="none" if kind == "pan" else "map_open")
    events = driven(new_session(kind, terms), [(Start(), 0.0)])
    session = rebuilt_session(kind, terms, events)
    update = session.handle(Resume(away_s=0.0, took_over=True), 0.0)
    assert kinds(update.events) == ["superseded", "shown" if kind == "pan" else "storey"]
    assert isinstance(update.view, PanView | PogView)
