"""Pages, dashboard, `study status` and leases see a participant at the same place, whatever happens."""

import contextlib
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings
from starlette.testclient import TestClient

from human_study.design.plan import StudyScene
from human_study.design.planning import Practice
from human_study.design.study import FlowStep
from human_study.journey import GONE, Journey, journey_of
from human_study.store.store import StudyStore
from personal_viz.cli.study.status import progress_now
from personal_viz.study_app.gateway.lease_keeper import LeaseKeeper
from personal_viz.study_app.gateway.pages import Pages
from personal_viz.study_app.operator.dashboard import Dashboard
from personal_viz.study_app.operator.progress_view import place_words
from personal_viz.study_app.store_link import StoreLink
from sim.types import EpisodeKey
from tests.human_study.small_world import study
from tests.human_study.stores import HOUSE_ONCE, begin_next, do_next, open_planned, plan_homes

from .stage import store_line

CODE, ORIGIN, PORT, GAP_S, LEASE_S = "p01", "http://127.0.0.1:4321", 4321, 3600.0, 900.0
FLOWS: tuple[tuple[FlowStep, ...], ...] = (("device", "consent", "instructions", "quiz"), ("instructions",), ())
ACTS = st.sampled_from(
    [
        *["go on"] * 12,
        *["fail the quiz", "fail the quiz", "open", "technical", "abandoned"],
        *["refuse the device", "screened_out", "decline", "withdraw", "full", "stay away", "finished"],
    ]
)


@contextlib.contextmanager
def started(folder: Path, flow: Sequence[FlowStep]) -> Iterator[tuple[StudyStore, StoreLink]]:
    """p01 practises and has an episode in each of three homes, p03 is spare; with a worker's line to the store."""
    config = study(
        task=("pan",),
        design=HOUSE_ONCE,
        flow=flow,
        practice={"pan": 1, "pog": 0},
        breaks={"every": 1, "sitting_max": 2, "sitting_gap_s": GAP_S},
    )
    practice = Practice((StudyScene(name="P", kind="invented"),), (EpisodeKey("easy", "P", "0"),), ())
    drawn = plan_homes(config, practice=practice)
    with open_planned(folder, config, drawn) as store, store_line(store) as link:
        yield store, link


def act(store: StudyStore, name: str, journey: Journey) -> None:
    """Lets this happen to the participant; does nothing if it cannot happen at this place."""
    is_at_trials = journey.place in ("practice", "trial")
    match name:
        case "go on":
            go_on(store, journey)
        case "fail the quiz" if journey.place == "quiz":
            store.enter_stage(CODE, "quiz_failed", {"wrong": ["stop"]})
        case "refuse the device" if journey.place == "device":
            store.enter_stage(CODE, "device_failed", {"webgl2": False})
        case "open" if is_at_trials:
            begin_next(store, CODE)
        case "technical" | "abandoned" if is_at_trials:
            do_next(store, CODE, reason=name)
        case "decline" if journey.place == "consent":
            store.give_consent(CODE, "text", given=False)
        case "withdraw":
            store.withdraw(CODE)
        case "stay away":
            store.drop_out(CODE, "away")
        case "screened_out" | "full" | "finished":
            store.enter_stage(CODE, name)


def go_on(store: StudyStore, journey: Journey) -> None:
    """Takes the next step of the study, as the page of the place stores it."""
    done = {"done": journey.num_done}
    match journey.place:
        case "not_arrived":
            store.enter_stage(CODE, "arrived")
        case "device":
            store.enter_stage(CODE, "device_ok")
        case "consent":
            store.give_consent(CODE, "text", given=True)
        case "instructions":
            store.enter_stage(CODE, "instructed")
        case "quiz":
            store.enter_stage(CODE, "quiz_passed")
        case "break" | "pause" if journey.rest is None:
            store.enter_stage(CODE, "break_started", {**done, "sitting": journey.place == "pause"})
        case "break":
            store.enter_stage(CODE, "break_ended", done)
        case "pause":
            store.enter_stage(CODE, "sitting_started", done)
        case "practice" | "trial":
            do_next(store, CODE)
        case "dropped_out":
            store.enter_stage(CODE, "returned")
        case "ending" if store.next_trial(CODE) is None:
            store.enter_stage(CODE, "finished")


def has_left(store: StudyStore, away_s: float) -> bool:
    """Whether others get the trials of somebody who is away for `away_s`."""
    now_s = [0.0]
    keeper = LeaseKeeper(store, tell=lambda _: None, clock=lambda: now_s[0])
    keeper.tick()
    now_s[0] = away_s
    num_before = len(store.participant(CODE).stages)
    keeper.tick()
    return len(store.participant(CODE).stages) > num_before


@pytest.mark.slow
@given(flow=st.sampled_from(FLOWS), names=st.lists(ACTS, max_size=24), is_shown=st.booleans())
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_everything_that_asks_for_a_participants_place_gets_the_same_answer(
    flow: tuple[FlowStep, ...], names: list[str], is_shown: bool
) -> None:
    with tempfile.TemporaryDirectory() as name, started(Path(name), flow) as (store, link):
        page, pages = Dashboard(store.folder, look_every_s=0.0), Pages(store, texts={})
        dashboard = TestClient(page.app(PORT), base_url=ORIGIN)
        dashboard.post("/enter", content=page.token, headers={"Origin": ORIGIN})

        def agreed() -> Journey:
            """The participant's place, on which all agree."""
            journey = journey_of(store.config, link.person(CODE))
            status = progress_now(store.folder).people[0]
            shown = json.loads(dashboard.get("/progress").content)
            row, words = shown["progress"]["people"][0], shown["people"][0]
            assert status.place == journey.place
            assert words["where"] == place_words(status)
            assert (status.num_planned, row["num_planned"]) == (journey.num_all,) * 2
            assert (status.state in ("out", "finished")) == (journey.place in GONE)
            return journey

        for name in ["", *names]:
            act(store, name, agreed())
        journey = agreed()
        if is_shown:  # asking for the page stores what needs no answer: a return, the beginning of a break, the end
            shown = pages.shown(CODE, "/page/x/")
            journey = agreed()
            assert (shown is None) == (journey.place in ("practice", "trial"))
            assert shown is None or f'data-place="{journey.place}"' in shown
        is_awaited = journey.place not in (*GONE, "not_arrived") and any(
            trial.is_due and trial.phase == "main" for trial in link.person(CODE).trials
        )
        assert has_left(store, LEASE_S + 1) == (is_awaited and journey.place != "pause")
        if journey.place == "pause":
            assert has_left(store, LEASE_S + GAP_S + 1) == is_awaited
