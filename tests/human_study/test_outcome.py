"""From stored events to a result: times, points on maps, rays that are cast again."""

import math

import pytest

from human_study.export.trial_table import trial_figures
from human_study.export.verify import verify_trial
from human_study.trial.commands import Click, Confirm, GiveUp, ShowStorey, Start
from human_study.trial.events import Abandoned, Clicked, Error, Event, MapPixel, Moment
from human_study.trial.outcome import (
    largest_click_error,
    pan_outcome,
    pog_outcome,
    task_began_s,
    trial_end,
    walked_steps,
)
from human_study.trial.terms import TrialTerms
from human_study.trial.views import MarkedObject
from sim.errors import StudyError
from sim.types import TaskKind

from .finished import room
from .small_world import SquareRoom, episode
from .trials import FORWARD, RAY, answer_of, drive, driven, new_session, ray_down

PIXEL = MapPixel(uv=(50.25, 100.75), origin_xz=(-3.0, -2.0), pixel_m=0.02, shape=(300, 400))
UPSTAIRS = ray_down(0.0, 9.0, 0.0, storey_y=3.0)


def pointed(click: Click) -> list[Event]:
    """A confirmed click on the map."""
    session = new_session("pog", TrialTerms(condition="map_2d"))
    return driven(session, [(Start(), 0.0), (ShowStorey(1), 1.0), (click, 2.0), (Confirm(), 3.0)])


def test_a_click_on_the_map_is_a_point_on_the_floor_of_the_storey_that_was_shown() -> None:
    events = pointed(Click(UPSTAIRS, PIXEL.point(3.0), pixel=PIXEL))
    answer = pog_outcome(events, episode(), storeys=[(0.0, 0.0), (3.0, 3.0)], participant="p01")
    assert answer.candidates[0] == pytest.approx((-3.0 + 50.25 * 0.02, 3.0, -2.0 + 100.75 * 0.02), abs=1e-12)
    assert answer.measures.planar_distance is None  # the target is on the other storey


@pytest.mark.parametrize("hit", [None, (-1.99, 3.0, 0.015), (-1.995, 0.0, 0.015)])
def test_a_point_that_is_not_the_place_of_its_pixel_is_refused(hit: tuple[float, float, float] | None) -> None:
    events = pointed(Click(UPSTAIRS, (0.0, 3.0, 0.0), pixel=PIXEL))
    events = [event.model_copy(update={"hit": hit}) if isinstance(event, Clicked) else event for event in events]
    with pytest.raises(StudyError, match="the place of its pixel"):
        answer_of(events)


def test_an_end_that_the_server_wrote_without_a_time_gives_an_answer_without_one() -> None:
    events = driven(new_session("pog", TrialTerms(condition="map_open")), [(Start(), 0.0)])
    events.append(Error(message="renderer died", is_fatal=True))
    assert answer_of(events).t_s is None


@pytest.mark.parametrize("kind", ["pan", "pog"])
def test_technical_failures_and_people_who_never_came_back_have_no_measures(kind: TaskKind) -> None:
    begun = driven(new_session(kind, TrialTerms(condition="none" if kind == "pan" else "map_open")), [(Start(), 0.0)])
    endings: list[tuple[Event, bool]] = [
        (Error(t_s=5.0, message="renderer died", is_fatal=True), False),
        (Abandoned(away_s=1000.0), False),  # the store wrote it
        (Abandoned(t_s=5.0, away_s=1000.0), True),
        (Moment(kind="giveup", t_s=5.0), True),
    ]
    for end, is_scored in endings:
        events = [*begun, end]
        if kind == "pan":
            found = pan_outcome(events, episode(), navigation=SquareRoom(), participant="p01").end
        else:
            found = answer_of(events)
        assert (found.measures is not None) == is_scored, end
        verified = verify_trial(events, found, episode().key, home=room(), participant="p01")
        assert (verified.status, verified.detail) == ("verified", "")


GOAL, OTHER = episode().targets[0].object_name, "chair_3"
OBJECTS = {name: MarkedObject("thing", (-2.0, 0.5, 0.0), (1.0, 1.0, 1.0)) for name in (GOAL, OTHER)}


@pytest.mark.parametrize(
    ("name", "objects", "on_object"),
    [(GOAL, OBJECTS, True), (OTHER, OBJECTS, False), (None, OBJECTS, False), (GOAL, None, None)],
)
def test_a_click_is_on_the_object_if_it_met_the_target_however_far_from_its_middle(
    name: str | None, objects: dict[str, MarkedObject] | None, on_object: bool | None
) -> None:
    session = new_session("pog", objects=objects)
    answer = answer_of(
        driven(session, [(Start(), 0.0), (Click(RAY, (0.5, 0.0, 0.0), object_name=name), 1.0), (Confirm(), 2.0)])
    )
    assert (answer.measures.on_object, answer.measures.success) == (on_object, False)
    assert trial_figures((), answer, rule="paper").on_object == on_object


def test_an_answer_that_was_given_up_is_on_no_object() -> None:
    click = Click(RAY, (-2.0, 0.5, 0.0), object_name=GOAL)
    session = new_session("pog", objects=OBJECTS)
    events = driven(session, [(Start(), 0.0), (click, 1.0), (GiveUp(), 2.0), (GiveUp(), 4.0)])
    assert answer_of(events).measures.on_object is False


def test_the_object_of_a_click_is_found_again_or_is_an_error_without_end() -> None:
    middle, hit = (-2.0, 0.5, 0.0), (-2.3, 0.0, 0.1)
    session = new_session("pog", objects=OBJECTS)
    events = driven(session, [(Start(), 0.0), (Click(RAY, hit, object_name=GOAL, snapped=middle), 1.0)])
    for found, error in (((GOAL, middle), 0.0), ((GOAL, (-2.0, 0.5, 0.2)), 0.2), ((OTHER, middle), math.inf)):
        assert largest_click_error(events, lambda *_: hit, lambda *_, it=found: it) == pytest.approx(error)
    assert largest_click_error(events, lambda *_: hit, lambda *_: None) == math.inf
    assert largest_click_error(events, lambda *_: hit) == 0.0


def test_without_a_look_the_task_begins_with_the_trial_and_its_first_end_counts() -> None:
    events = drive(new_session("pan"), [FORWARD, FORWARD])
    assert task_began_s(events) == 0.0
    assert [step.t_s for step in walked_steps(events)] == [0.5, 1.0]
    events = drive(new_session("pan", max_steps=1), [FORWARD])
    end = trial_end([*events, Error(message="late", is_fatal=True)])
    assert end[1] == "steps"


def test_rays_that_are_cast_again_must_meet_the_stored_points() -> None:
    hits = iter([(1.0, 0.0, 1.0), None, (0.0, 0.03, 0.0)])
    stored = [(1.0, 0.0, 1.0), None, (0.0, 0.0, 0.0)]
    session = new_session("pog", TrialTerms(condition="map_open"))
    events = driven(session, [(Start(), 0.0), *((Click(RAY, hit), 1.0 + t) for t, hit in enumerate(stored))])
    asked: list[float] = []

    def cast(storey_y: float, origin: tuple, direction: tuple) -> tuple[float, float, float] | None:
        asked.append(storey_y)
        assert (origin, direction) == (RAY.origin, RAY.direction)
        return next(hits)

    assert largest_click_error(events, cast) == pytest.approx(0.03)
    assert asked == [0.0, 0.0, 0.0]
    assert largest_click_error(events[:2], lambda *_: None) == math.inf
    assert largest_click_error(pointed(Click(UPSTAIRS, PIXEL.point(3.0), pixel=PIXEL)), cast) == 0.0
