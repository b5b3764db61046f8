"""One trial of a home sequence: what is told when, marks, giving up, resuming, and the run that the events give."""

from pathlib import Path

import pytest

from human_study.export.verify import TrialHome, verify_trial
from human_study.trial.commands import Command, Confirm, GiveUp, Move, PressStop, Resume, Start, Tick, Unmark
from human_study.trial.events import (
    Abandoned,
    Act,
    Error,
    Event,
    SearchBegun,
    Shown,
    Unmarked,
    event_from_json,
    event_to_json,
)
from human_study.trial.outcome import end_reason, unscored_outcome
from human_study.trial.searches import sequence_outcome
from human_study.trial.views import PanView, PogView
from sim.episodes.sequence_files import HomeSequence
from sim.errors import StudyError
from sim.sequences.figures import sequence_figures
from sim.sequences.searches import sequence_key
from sim.types import Action, EndReason, TaskKind
from tests.sim.home_story import leaks, marked_story, told_in

from .sequence_trials import click_on, clicks, driven, home_of, new_session, oracle_run, presses, sequence_study

MESSAGES, SUBTASKS = marked_story()
TEXTS = [message["text"] for message in MESSAGES]
CONFIG = sequence_study()
LEFT = Move(Action.LEFT, "KeyA")


@pytest.fixture(scope="module")
def told(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, HomeSequence]:
    """Folder of the set, and its sequence."""
    out = tmp_path_factory.mktemp("set")
    return out, told_in(small_home_root, out, messages=MESSAGES, subtasks=SUBTASKS)


@pytest.fixture(scope="module")
def story(told: tuple[Path, HomeSequence]) -> HomeSequence:
    return told[1]


@pytest.fixture(scope="module")
def home(small_home_root: Path, story: HomeSequence) -> TrialHome:
    return home_of(small_home_root, [story])


def outcome(events, story, home, code="p01"):
    return sequence_outcome(events, story, navigation=home.navigation, storeys=home.storeys, participant=code)


@pytest.mark.parametrize("task", ["pan", "pog"])
@pytest.mark.parametrize("is_deaf", [False, True])
def test_bots_have_the_known_answers(
    task: TaskKind, is_deaf: bool, small_home_root: Path, told: tuple[Path, HomeSequence], home: TrialHome
) -> None:
    out, story = told
    if task == "pan":
        commands = list(presses(oracle_run(small_home_root, out, story, is_deaf=is_deaf)))
    else:
        commands = list(clicks(story, home, is_deaf=is_deaf))
    session = new_session(CONFIG, home, story, task)
    run = outcome(driven(session, commands), story, home)
    assert run is not None
    assert session.is_done
    figures = sequence_figures([run])
    wrong = 0.0 if is_deaf else 1.0
    assert (figures.sr_fresh, figures.sr_revisit) == (1, 1)
    assert (figures.sr_changed, figures.sr_stale, figures.stale) == (wrong, wrong, float(is_deaf))
    assert (run.start.task, run.start.participant, run.start.position) == (task, "p01", story.start.position)
    assert run.end.reason == ("stop" if task == "pan" else "giveup" if is_deaf else "click")


@pytest.mark.parametrize(
    ("condition", "readable"),
    [
        ("history_visible", [(0,), (0,), (0, 1), (0, 1, 2), (0, 1, 2), (0, 1, 2)]),
        ("history_hidden", [(0,), (), (1,), (2,), (), ()]),
    ],
)
def test_a_view_tells_what_may_be_read_and_nothing_of_later_searches(
    condition: str, readable: list[tuple[int, ...]], story: HomeSequence, home: TrialHome
) -> None:
    session = new_session(CONFIG, home, story, "pan", condition)
    events = list(session.handle(Start(), 0.0).events)
    for index, told in enumerate(readable):
        view = session.view(float(10 * index))
        assert isinstance(view, PanView)
        assert [note.text for note in view.notes] == [TEXTS[number] for number in told]
        assert (view.search, view.num_searches, view.query) == (index, 6, SUBTASKS[index]["query"][0])
        assert view.task.description == "\n".join(TEXTS[number] for number in told)
        assert view.task.queries == (view.query,)
        assert view.is_for_all == (index == 1)
        events += [event for wait in (1, 3) for event in session.handle(GiveUp(), 10 * index + wait).events]
    assert [(event.search, event.notes) for event in events if isinstance(event, SearchBegun)] == list(
        enumerate(readable)
    )
    assert end_reason(events) == session.end_reason == "giveup"
    run = outcome(events, story, home)
    assert run is not None
    assert [search.reason for search in run.end.searches] == 6 * ["giveup"]
    other = [
        event.model_copy(update={"notes": (0, 1, 2)}) if isinstance(event, SearchBegun) else event for event in events
    ]
    with pytest.raises(StudyError, match="search 0 was shown as"):
        outcome(other, story, home)


def test_a_search_for_all_is_marked_and_ended_by_found_twice_at_once(story: HomeSequence, home: TrialHome) -> None:
    session = new_session(CONFIG, home, story, "pan")
    found = [PressStop(), PressStop()]
    events = driven(session, [*found, *found])
    view = session.view(5.0)
    assert isinstance(view, PanView)
    assert (view.search, view.step, view.num_marks, view.is_just_marked) == (1, 1, 1, True)
    events += session.handle(LEFT, 6.0).events
    view = session.view(7.0)
    assert isinstance(view, PanView)
    assert (view.num_marks, view.is_just_marked) == (1, False)
    for number in range(4):
        events += session.handle(PressStop(), 8.0 + number / 2).events
    view = session.view(10.0)
    assert isinstance(view, PanView)
    assert (view.search, view.step, view.num_marks) == (2, 0, 0)


def test_marks_of_a_search_for_all_are_added_and_taken_away(story: HomeSequence, home: TrialHome) -> None:
    first, second = (click_on(target, home.navigation.storey_heights) for target in story.targets[1])
    session = new_session(CONFIG, home, story, "pog")
    events = driven(session, [Unmark(0), first, Confirm(), first, second, second, Unmark(1), Unmark(7)])
    assert [event.kind for event in events[-2:]] == ["unmark", "dropped"]
    view = session.view(9.0)
    assert isinstance(view, PogView)
    assert [mark.point for mark in view.marks] == [first.hit, second.hit]
    assert view.mark == view.marks[-1]
    rebuilt = new_session(CONFIG, home, story, "pog").after(events)
    back = rebuilt.handle(Resume(away_s=5.0), 20.0)
    assert isinstance(back.view, PogView)
    assert back.view.marks == view.marks
    assert [event.kind for event in back.events] == ["search", "storey"]
    assert rebuilt.handle(Confirm(), 21.0).view.marks == ()


def test_a_rebuilt_walk_goes_on_in_its_search(story: HomeSequence, home: TrialHome) -> None:
    config = sequence_study(pan_max_s=60.0)
    session = new_session(config, home, story, "pan", "history_hidden")
    events = driven(session, [LEFT, GiveUp(), LEFT, GiveUp(), GiveUp(), LEFT], every_s=2.0)
    assert events == [event_from_json(event_to_json(event)) for event in events]
    rebuilt = new_session(config, home, story, "pan", "history_hidden").after(events)
    update = rebuilt.handle(Resume(away_s=30.0), 100.0)
    view = update.view
    assert isinstance(view, PanView)
    assert (view.search, view.step, view.notes, view.left_s) == (1, 1, (), 60)
    assert [event.kind for event in update.events] == ["search", "shown"]
    late = rebuilt.handle(LEFT, 170.0)
    assert [event.kind for event in late.events] == ["timeout", "search", "shown", "key", "dropped"]
    assert isinstance(late.view, PanView)
    assert (late.view.search, late.view.step, late.view.left_s, rebuilt.end_reason) == (2, 0, 60, None)


@pytest.mark.parametrize(
    ("task", "command"),
    [("pan", LEFT), ("pan", PressStop()), ("pan", GiveUp()), ("pog", None), ("pog", Confirm()), ("pog", GiveUp())],
)
def test_what_was_meant_for_the_search_before_does_nothing_in_the_next_one(
    task: TaskKind, command: Command | None, story: HomeSequence, home: TrialHome
) -> None:
    click = click_on(story.targets[0][0], home.navigation.storey_heights)
    command = command or click
    limits = {"pan_max_s": 20.0, "pog": {"conditions": ("map_open",), "answer_max_s": 20.0}}
    session = new_session(sequence_study(**limits), home, story, task)
    session.handle(Start(), 0.0)
    session.handle(click if task == "pog" else LEFT, 5.0)
    for at_s, begun in ((20.0, ["timeout", "search"]), (20.04, [])):  # by its own arrival, and just after that
        update = session.handle(command, at_s)
        kinds = [event.kind for event in update.events if event.kind not in ("shown", "storey", "key")]
        assert kinds == [*begun, "dropped"]
        view = update.view
        assert isinstance(view, PanView | PogView)
        assert (view.search, view.is_giving_up) == (1, False)
        assert not (view.step or view.is_armed if isinstance(view, PanView) else view.marks)
    later = session.handle(command, 20.06).events
    assert ("dropped" in [event.kind for event in later]) == isinstance(command, Confirm)  # nothing is marked


@pytest.mark.parametrize("leaves", [((GiveUp(), 590.0), (GiveUp(), 591.0)), ((Tick(), 600.0),)])
def test_a_blocked_step_is_no_news_of_the_next_search(
    leaves: tuple[tuple[Command, float], ...], story: HomeSequence, home: TrialHome
) -> None:
    config = sequence_study(pan_max_s=600.0)
    session = new_session(config, home, story, "pan")
    events = driven(session, [Move(Action.FORWARD, "KeyW")] * 40)
    assert events[-1].kind == "shown"
    assert events[-1].blocked
    events += [event for command, at_s in leaves for event in session.handle(command, at_s).events]
    view = session.view(600.0)
    assert isinstance(view, PanView)
    assert (view.search, view.is_blocked) == (1, False)
    rebuilt = new_session(config, home, story, "pan").after(events)
    again = rebuilt.handle(Resume(away_s=5.0), 700.0).events
    assert [event.blocked for event in (events[-1], again[-1]) if isinstance(event, Shown)] == [False, False]


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (Abandoned(away_s=9e4), "abandoned"),
        (Abandoned(t_s=9.0, away_s=9e4), "abandoned"),
        (Error(t_s=9.0, message="renderer died", is_fatal=True), "technical"),
    ],
)
@pytest.mark.parametrize("task", ["pan", "pog"])
def test_a_sequence_that_was_left_or_failed_has_no_figures(
    task: TaskKind, end: Event, reason: EndReason, story: HomeSequence, home: TrialHome
) -> None:
    events = [*driven(new_session(CONFIG, home, story, task), [GiveUp(), GiveUp(), GiveUp()]), end]
    assert end_reason(events) == reason
    assert outcome(events, story, home) is None
    stored = unscored_outcome(sequence_key(story), task, reason=reason, participant="p01")
    assert verify_trial(events, stored, sequence_key(story), home=home, participant="p01").status == "verified"


def test_events_that_cannot_be_fail_with_one_line(story: HomeSequence, home: TrialHome) -> None:
    given_up = [GiveUp()] * 12
    walked = driven(new_session(CONFIG, home, story, "pan"), [PressStop(), PressStop(), *given_up[2:]])
    mark = click_on(story.targets[0][0], home.navigation.storey_heights)
    pointed = driven(new_session(CONFIG, home, story, "pog"), [mark, Confirm(), *given_up[2:]])

    def failing(events: list[Event], record: list[Event]) -> str:
        run = outcome(record, story, home)
        assert run is not None
        found = verify_trial(events, run.end, sequence_key(story), home=home, participant="p01")
        assert found.status == "failed"
        return found.detail

    first, second = [place for place, event in enumerate(walked) if isinstance(event, SearchBegun)][:2]
    early = [*walked[: first + 1], walked[second], *walked[first + 1 :]]
    assert "search 1 was shown after the end of 0; expected search 0" in failing(early, walked)
    again = [*walked[: second + 1], walked[first], *walked[second + 1 :]]
    assert "search 0 was shown after the end of 1; expected search 1" in failing(again, walked)
    found = next(event for event in walked if isinstance(event, Act))
    assert "found action 'found' after the end (giveup)" in failing([*walked, found], walked)
    confirm = next(place for place, event in enumerate(pointed) if event.kind == "confirm")
    unmarked = [*pointed[:confirm], Unmarked(t_s=1.0, index=1), *pointed[confirm:]]
    assert "search 0: takes mark 1 of 1 away" in failing(unmarked, pointed)


@pytest.mark.parametrize("task", ["pan", "pog"])
def test_nothing_of_a_later_search_is_in_a_view_or_an_event(
    task: TaskKind, story: HomeSequence, home: TrialHome
) -> None:
    session = new_session(CONFIG, home, story, task)
    update = session.handle(Start(), 0.0)
    for index in range(len(SUBTASKS)):
        told = repr(update.view) + "".join(map(event_to_json, update.events))
        assert (f"QUERY-{index}" in told, leaks(told, index)) == (True, [])
        session.handle(GiveUp(), 10.0 * index + 1)
        update = session.handle(GiveUp(), 10.0 * index + 3)
