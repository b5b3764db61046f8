"""Sessions in the small world under given terms, for tests of what surrounds a task."""

from collections.abc import Sequence

from human_study.trial.commands import Command, Resume
from human_study.trial.events import Event
from human_study.trial.session import PanSession, PogSession
from human_study.trial.terms import Look, TrialTerms
from sim.types import TaskKind

from .small_world import SCENE_DIGEST, env, episode, study

STOREYS = (0.0, 3.0)
MAP_LOOK = TrialTerms(condition="topdown", look=Look("topdown", min_s=5.0, max_s=60.0))
HOME_LOOK = TrialTerms(condition="map_first", look=Look("home", min_s=5.0, max_s=60.0))


def new_session(kind: TaskKind, terms: TrialTerms, *, max_steps: int = 500) -> PanSession | PogSession:
    """A session that nobody has started."""
    task = study(steps=max_steps).task_for(episode(), kind)
    names = {"key": episode().key, "task": task, "storeys": STOREYS, "scene_digest": SCENE_DIGEST, "terms": terms}
    if kind == "pan":
        return PanSession(env(max_steps=max_steps, with_pictures=True), **names)
    return PogSession(**names)


def rebuilt_session(
    kind: TaskKind, terms: TrialTerms, events: Sequence[Event], *, max_steps: int = 500
) -> PanSession | PogSession:
    """The session after these events."""
    task = study(steps=max_steps).task_for(episode(), kind)
    names = {"key": episode().key, "task": task, "storeys": STOREYS, "scene_digest": SCENE_DIGEST, "terms": terms}
    if kind == "pan":
        return PanSession(env(max_steps=max_steps, with_pictures=True), **names).after(events)
    return PogSession(**names).after(events)


def driven(session: PanSession | PogSession, commands: Sequence[tuple[Command, float]]) -> list[Event]:
    """All events of these commands at these times."""
    return [event for command, now_s in commands for event in session.handle(command, now_s).events]


def resumed(
    kind: TaskKind, terms: TrialTerms, events: Sequence[Event], *, away_s: float = 30.0, now_s: float = 0.0
) -> tuple[PanSession | PogSession, tuple[Event, ...]]:
    """The session after these events and an absence, and what the return led to."""
    session = rebuilt_session(kind, terms, events)
    return session, session.handle(Resume(away_s=away_s), now_s).events


def kinds(events: Sequence[Event]) -> list[str]:
    """Their kinds."""
    return [event.kind for event in events]
