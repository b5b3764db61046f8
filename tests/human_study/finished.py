"""Studies in the small room with finished trials, made of fixed commands with results computed by hand."""

import json
from collections.abc import Sequence
from pathlib import Path

from human_study.design.plan import StudyScene
from human_study.design.study import StudyConfig
from human_study.export.verify import TrialHome
from human_study.store.store import StudyStore
from human_study.trial.commands import Click, Command, Confirm, Fail, Move, PressStop, Start
from human_study.trial.events import Event
from human_study.trial.outcome import Outcome, pan_outcome, pog_outcome, unscored_outcome
from human_study.trial.session import PanSession, PogSession
from sim.tasks.run_files import Answer, EpisodeRun
from sim.types import Action, EpisodeKey, TaskKind

from .small_world import SCENE_DIGEST, SquareRoom, env, episode, plan, study
from .stores import filled
from .trials import FORWARD, LEFT, RAY, driven

STOREYS = [(0.0, 0.0)]
SUCCESS: list[Command] = [Start(), *[LEFT] * 3, *[FORWARD] * 5, PressStop(), PressStop()]
"""Ends at (-1.25, 0, 0), 0.75 m from the target, after 1.25 m; the shortest way into the region is 1.0 m."""
TOO_FAR: list[Command] = [Start(), *[LEFT] * 3, *[FORWARD] * 3, PressStop(), PressStop()]
"""Ends 1.25 m from the target and 0.25 m from the region."""
POINT: list[Command] = [Start(), Click(RAY, (-1.5, 0.1, 0.0)), Confirm()]
"""0.5 m from the target."""
FAILURE: list[Command] = [Start(), FORWARD, Fail("renderer died")]
BEGUN: list[Command] = [Start(), Move(Action.FORWARD, "KeyW")]


def room(scene: StudyScene | None = None, *, scene_digest: str = SCENE_DIGEST) -> TrialHome:
    """The room as a home for verification and import check."""
    del scene
    return TrialHome(SquareRoom(), scene_digest, STOREYS, lambda key: episode(key.episode_id))


def events_of(key: EpisodeKey, commands: Sequence[Command], *, task: TaskKind) -> list[Event]:
    """The events of a session that gets these commands, one a second."""
    text = study().task_for(episode(key.episode_id), task)
    session: PanSession | PogSession
    if task == "pan":
        session = PanSession(env(), key=key, task=text, scene_digest=SCENE_DIGEST)
    else:
        session = PogSession(key=key, task=text, storeys=(0.0,), scene_digest=SCENE_DIGEST)
    return driven(session, [(command, float(number)) for number, command in enumerate(commands)])


def result_of(events: Sequence[Event], key: EpisodeKey, *, task: TaskKind, code: str) -> EpisodeRun | Answer:
    """The result of a trial's events."""
    home = episode(key.episode_id)
    if task == "pan":
        return pan_outcome(events, home, navigation=SquareRoom(), participant=code)
    return pog_outcome(events, home, storeys=STOREYS, participant=code)


def do_trial(store: StudyStore, code: str, order_no: int, commands: Sequence[Command]) -> str:
    """One participant's whole trial, stored and finished; returns its id."""
    trial = store.open_trial(code, order_no)
    store.append_many(trial.trial_id, trial.epoch, events_of(trial.key, commands, task=trial.task))
    events = [stored.event for stored in store.events(trial.trial_id)]
    outcome: Outcome
    if any(isinstance(command, Fail) for command in commands):
        outcome = unscored_outcome(trial.key, trial.task, reason="technical", participant=code)
    else:
        result = result_of(events, trial.key, task=trial.task, code=code)
        outcome = result.end if isinstance(result, EpisodeRun) else result
    store.finish_trial(trial.trial_id, outcome)
    return trial.trial_id


def study_with_trials(folder: Path, config: StudyConfig | None = None) -> None:
    """p01: one right answer. p02: a success, a technical failure, and one trial that still runs."""
    with filled(folder, config) as store:
        do_trial(store, "p01", 1, POINT)
        do_trial(store, "p02", 1, SUCCESS)
        do_trial(store, "p02", 2, FAILURE)
        running = store.open_trial("p02", 3)
        store.append_many(running.trial_id, running.epoch, events_of(running.key, BEGUN, task="pan"))


def first_key(code: str) -> EpisodeKey:
    """Episode of a participant's first trial in `study_with_trials`."""
    return plan(study()).participant(code).trials[0].key


def table_of(out: Path, table: str) -> list[dict]:
    """The rows of an exported table."""
    return [json.loads(line) for line in (out / f"{table}.jsonl").read_text().splitlines()]
