"""Nothing that a participant's browser could get holds ground truth."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from pydantic import BaseModel

from human_study.trial.commands import Click, CloseMap, Confirm, GiveUp, Move, PressStop, Rate, ShowStorey, Start, Tick
from human_study.trial.events import MapKind, event_to_json
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import Look, TrialTerms
from human_study.trial.views import LookView, Mark, MarkedObject, PanView, PogView, RateView
from sim.episodes.schema import Episode, Goal
from sim.tasks.run_files import Measures, RuleMeasures
from sim.types import Action, Task, TaskKind

from .small_world import CANARY, episode
from .trials import FORWARD, LEFT, RAY, begun, new_session

View = LookView | PanView | PogView | RateView
Shape = Mark | MarkedObject
GOAL, OUTLINE = episode().targets[0].object_name, MarkedObject("lamp", (-2.0, 0.5, 0.0), (1.0, 1.0, 1.0))
FORBIDDEN_NAMES = {"goal", "goals", "targets", "success", "captions", "extracted_summary", "owner", "measures", "dtg"}
FORBIDDEN_TYPES = (Episode, Goal, Measures, RuleMeasures, PanSession, PogSession)


def walk(value: object, path: str = "view") -> Iterator[tuple[str, object]]:
    """Every value inside `value` with the names that lead to it, for values of any type."""
    yield path, value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            yield from walk(getattr(value, field.name), f"{path}.{field.name}")
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from walk(getattr(value, name), f"{path}.{name}")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from walk(key, f"{path}.key")
            yield from walk(item, f"{path}.{key}")
    elif isinstance(value, tuple | list | set | frozenset):
        for index, item in enumerate(value):
            yield from walk(item, f"{path}.{index}")


def assert_clean(value: object) -> None:
    """No ground-truth text, name or type, and nothing opaque that could hide one, anywhere in `value`."""
    for path, item in walk(value):
        assert not FORBIDDEN_NAMES & set(path.split(".")), path
        assert not isinstance(item, FORBIDDEN_TYPES), path
        assert not (isinstance(item, str) and CANARY in item), path
        is_known = isinstance(item, str | int | float | tuple | np.ndarray | Task | View | Shape | None)
        assert is_known, f"{path} is a {type(item).__name__}"


def test_the_walk_finds_ground_truth_wherever_it_hides() -> None:
    assert any(isinstance(item, str) and CANARY in item for _, item in walk(("x", {"deep": [episode()]})))
    with pytest.raises(AssertionError):
        assert_clean(episode())


@pytest.mark.parametrize(
    ("kind", "commands"),
    [
        ("pan", [Start(), *[LEFT] * 3, *[FORWARD] * 5, *[PressStop()] * 2]),
        ("pog", [Start(), ShowStorey(0), Click(RAY, (-2.0, 0.5, 0.0)), Confirm()]),
        ("pog", [Start(), Click(RAY, (-2.4, 0.1, 0.0), object_name=GOAL, snapped=(-2.0, 0.5, 0.0)), Confirm()]),
    ],
    ids=["a successful walk", "a right answer", "a mark on the target"],
)
def test_no_view_of_a_right_trial_holds_ground_truth(kind: TaskKind, commands: list) -> None:
    session = new_session(kind, **({"objects": {GOAL: OUTLINE}} if kind == "pog" else {}))
    views = [session.handle(command, float(number)).view for number, command in enumerate(commands)]
    assert [view.is_over for view in views] == [False] * (len(commands) - 1) + [True]
    for view in views:
        assert_clean(view)


@pytest.mark.parametrize(("kind", "what"), [("pan", "topdown"), ("pan", "glb"), ("pog", "home")])
def test_no_view_before_or_after_the_task_holds_ground_truth_or_a_text_of_it(kind: TaskKind, what: MapKind) -> None:
    terms = TrialTerms(look=Look(what, 1.0, 60.0), task_max_s=100.0, asks_confidence=True)
    session = new_session(kind, terms)
    before = [session.handle(command, float(at)).view for at, command in enumerate([Start(), Tick(), ShowStorey(1)])]
    session.handle(CloseMap(), 3.0)
    last = [PressStop(), PressStop()] if kind == "pan" else [Click(RAY, (-2.0, 0.5, 0.0)), Confirm()]
    task = [session.handle(command, 4.0 + at).view for at, command in enumerate(last)]
    after = session.handle(Rate(3), 6.0).view
    assert [type(view) for view in before] == [LookView] * 3
    assert isinstance(task[-1], RateView)
    for view in (*before, *task, after):
        assert_clean(view)
    for view in (*before, task[-1]):
        assert not any(isinstance(item, Task) for _, item in walk(view))


def test_a_right_and_a_wrong_answer_look_the_same_but_for_the_mark() -> None:
    ends = []
    for hit in ((-2.0, 0.5, 0.0), (2.5, 0.0, 2.5)):
        session = begun("pog")
        session.handle(Click(RAY, hit), 1.0)
        ends.append(dataclasses.replace(session.handle(Confirm(), 2.0).view, mark=None, marks=()))
    assert ends[0] == ends[1]


def test_no_event_holds_ground_truth() -> None:
    session = new_session("pan")
    for number, command in enumerate([Start(), Move(Action.LEFT, "KeyA"), GiveUp()]):
        for event in session.handle(command, float(number)).events:
            assert CANARY not in event_to_json(event)
