"""Sessions in the small world under given terms."""

from collections.abc import Sequence
from typing import Any

from human_study.trial.commands import Command, Move, Resume, Start
from human_study.trial.events import Event
from human_study.trial.outcome import pan_outcome, pog_outcome
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import Look, TrialTerms
from sim.tasks.run_files import Answer, ClickRay, EpisodeRun
from sim.types import Action, TaskKind

from .small_world import SCENE_DIGEST, SquareRoom, env, episode, study

STOREYS = (0.0, 3.0)
NO_TERMS = TrialTerms()
MAP_LOOK = TrialTerms(condition="topdown", look=Look("topdown", min_s=5.0, max_s=60.0))
HOME_LOOK = TrialTerms(condition="map_first", look=Look("home", min_s=5.0, max_s=60.0))
LEFT, RIGHT, FORWARD = (Move(action, "Key") for action in (Action.LEFT, Action.RIGHT, Action.FORWARD))


def ray_down(x: float, y: float, z: float, *, storey_y: float = 0.0) -> ClickRay:
    """A ray straight down, from a camera at its origin."""
    origin, camera_wxyz = (x, y, z), (1.0, 0.0, 0.0, 0.0)
    return ClickRay(
        origin=origin, direction=(0.0, -1.0, 0.0), camera_position=origin, camera_wxyz=camera_wxyz, storey_y=storey_y
    )


RAY = ray_down(0.0, 2.0, 0.0)


def new_session(
    kind: TaskKind, terms: TrialTerms = NO_TERMS, *, max_steps: int = 500, **choices: Any
) -> PanSession | PogSession:
    """A session that nobody has started; `choices` are further arguments of its class."""
    task = study(steps=max_steps).task_for(episode(), kind)
    names = {"key": episode().key, "task": task, "storeys": STOREYS, "scene_digest": SCENE_DIGEST, "terms": terms}
    if kind == "pan":
        return PanSession(env(max_steps=max_steps, with_pictures=True), **names, **choices)
    return PogSession(**names, **choices)


def begun(kind: TaskKind, terms: TrialTerms = NO_TERMS, **choices: bool) -> PanSession | PogSession:
    """A session that was started at 0 s."""
    session = new_session(kind, terms, **choices)
    session.handle(Start(), 0.0)
    return session


def rebuilt_session(
    kind: TaskKind, terms: TrialTerms, events: Sequence[Event], *, max_steps: int = 500
) -> PanSession | PogSession:
    """The session after these events."""
    return new_session(kind, terms, max_steps=max_steps).after(events)


def drive(session: PanSession | PogSession, commands: Sequence[Command], *, every_s: float = 0.5) -> list[Event]:
    """Starts the session at 100 s and gives it one command every `every_s`; returns all events."""
    return driven(session, [(command, 100 + every_s * number) for number, command in enumerate([Start(), *commands])])


def driven(session: PanSession | PogSession, commands: Sequence[tuple[Command, float]]) -> list[Event]:
    """All events of these commands at these times."""
    return [event for command, now_s in commands for event in session.handle(command, now_s).events]


def resumed(
    kind: TaskKind, terms: TrialTerms, events: Sequence[Event], *, away_s: float = 30.0, now_s: float = 0.0
) -> tuple[PanSession | PogSession, tuple[Event, ...]]:
    """The session after these events and an absence, and the events of the return."""
    session = rebuilt_session(kind, terms, events)
    return session, session.handle(Resume(away_s=away_s), now_s).events


def run_of(events: Sequence[Event]) -> EpisodeRun:
    """The result of p02's walk."""
    return pan_outcome(events, episode(), navigation=SquareRoom(), participant="p02")


def answer_of(events: Sequence[Event]) -> Answer:
    """The result of p01's pointing, in a home with one storey."""
    return pog_outcome(events, episode(), storeys=[(0.0, 0.0)], participant="p01")


def kinds(events: Sequence[Event]) -> list[str]:
    """Their kinds."""
    return [event.kind for event in events]
