"""Random commands and crashes: a rebuilt session shows the same, a trial ends at most once, time never runs back."""

import dataclasses

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from human_study.trial.commands import (
    Click,
    CloseMap,
    Command,
    Confirm,
    Fail,
    GiveUp,
    LookFrom,
    Measure,
    Move,
    PageChanged,
    PressStop,
    Rate,
    Resize,
    Resume,
    ShowStorey,
    Start,
    Tick,
)
from human_study.trial.events import Act, Clicked, Confidence, Event, MapOff, Shown, event_from_json, event_to_json
from human_study.trial.outcome import end_reason, trial_end
from human_study.trial.terms import Look, TrialTerms
from human_study.trial.views import LookView, PanView, PogView, RateView
from sim.types import Action

from .trials import RAY, new_session, rebuilt_session

MAX_STEPS = 6
TERMS = st.sampled_from(
    [
        ("pan", TrialTerms(condition="none")),
        ("pan", TrialTerms(condition="topdown", look=Look("topdown", 2.0, 8.0), asks_confidence=True)),
        ("pan", TrialTerms(condition="glb", look=Look("glb"), task_max_s=20.0, resume_within_s=30.0)),
        ("pog", TrialTerms(condition="map_first", look=Look("home", 1.0, 6.0), task_max_s=15.0, asks_confidence=True)),
        ("pog", TrialTerms(condition="map_open", resume_within_s=30.0)),
        ("pog", TrialTerms(condition="map_2d", task_max_s=10.0, asks_confidence=True)),
    ]
)
COMMANDS: st.SearchStrategy[Command] = st.sampled_from(
    [
        Tick(),
        CloseMap(),
        Move(Action.FORWARD, "KeyW"),
        Move(Action.LEFT, "KeyA", repeat=True),
        Move(Action.LOOK_UP, "KeyR"),
        PressStop(),
        ShowStorey(0),
        ShowStorey(1),
        ShowStorey(7),
        LookFrom((0.0, 5.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        Click(RAY, (-2.0, 0.5, 0.0)),
        Click(RAY, (1.0, 3.0, 1.0)),
        Click(RAY, None),
        Confirm(),
        GiveUp(),
        Rate(1),
        Rate(5),
        PageChanged("hidden"),
        PageChanged("visible"),
        Resize(800, 600),
        Measure(12.5),
    ]
)
RARE: st.SearchStrategy[Command] = st.sampled_from([Fail("renderer died"), PageChanged("context_lost")])
WAITS = st.integers(0, 12).map(lambda quarters: quarters / 4)  # exact in binary, so that clocks agree to the last bit


def settled(view: LookView | PanView | PogView | RateView) -> tuple:
    """A view without the fields that depend on the moment, or on a press that an absence takes back."""
    if isinstance(view, LookView):
        return (dataclasses.replace(view, wait_s=0, left_s=0),)
    if isinstance(view, PanView):
        rgb = None if view.rgb is None else view.rgb.tobytes()
        return (rgb, dataclasses.replace(view, rgb=None, is_armed=False, is_giving_up=False, left_s=0))
    if isinstance(view, PogView):
        return (dataclasses.replace(view, is_giving_up=False, left_s=0),)
    return (view,)


class Trial(RuleBasedStateMachine):
    """One trial of one participant whose server may die at any moment."""

    @initialize(terms=TERMS)
    def start(self, terms: tuple) -> None:
        self.kind, self.terms = terms
        self.session = new_session(self.kind, self.terms, max_steps=MAX_STEPS)
        self.now_s = 0.0
        self.events: list[Event] = []
        self.give(Start())

    def give(self, command: Command, *, busy: bool = False) -> None:
        """Gives one command; its events are stored as text."""
        was_done = self.session.is_done if self.events else False
        update = self.session.handle(command, self.now_s, busy=busy)
        assert not (was_done and update.events)
        self.events += [event_from_json(event_to_json(event)) for event in update.events]

    @rule(command=COMMANDS, wait_s=WAITS, busy=st.booleans())
    def act(self, command: Command, wait_s: float, busy: bool) -> None:
        self.now_s += wait_s
        self.give(command, busy=busy)

    @rule(command=RARE)
    def fail(self, command: Command) -> None:
        self.give(command)

    @precondition(lambda self: not self.session.is_done)
    @rule()
    def wait(self) -> None:
        """Waits until something happens by itself."""
        wait_s = self.session.wait_s(self.now_s)
        if wait_s is not None:
            assert wait_s > 0
            self.now_s += wait_s
            self.give(Tick())

    @rule(away_s=st.sampled_from([0.0, 10.0, 40.0, 700.0]), took_over=st.booleans())
    def crash(self, away_s: float, took_over: bool) -> None:
        before, view = self.session, settled(self.session.view(self.now_s))
        self.session = rebuilt_session(self.kind, self.terms, self.events, max_steps=MAX_STEPS)
        assert (self.session.phase, self.session.end_reason) == (before.phase, before.end_reason)
        self.now_s = 1000.0
        count = len(self.events)
        self.give(Resume(away_s=away_s, took_over=took_over))
        if away_s <= self.terms.resume_within_s and self.session.phase == before.phase:
            assert settled(self.session.view(self.now_s)) == view
        if before.is_over:
            assert {event.kind for event in self.events[count:]} <= {"confidence"}

    @invariant()
    def ends_at_most_once(self) -> None:
        end = trial_end(self.events)
        assert self.session.end_reason == end_reason(self.events)
        assert self.session.is_over == (end is not None)
        if end is not None:
            after = self.events[1 + next(i for i, event in enumerate(self.events) if event is end[0]) :]
            assert {event.kind for event in after} <= {"stop", "confidence"}

    @invariant()
    def goes_one_way(self) -> None:
        times = [event.t_s for event in self.events if event.t_s is not None]
        assert times == sorted(times)
        assert sum(isinstance(event, MapOff) for event in self.events) <= 1
        assert sum(isinstance(event, Confidence) for event in self.events) <= 1
        assert sum(isinstance(event, Act) for event in self.events) <= MAX_STEPS
        if self.terms.look is not None:
            off = next((i for i, event in enumerate(self.events) if isinstance(event, MapOff)), len(self.events))
            assert not any(isinstance(event, Act | Shown | Clicked) for event in self.events[:off])


Trial.TestCase.settings = settings(max_examples=150, stateful_step_count=30, deadline=None)
TestTrial = Trial.TestCase
