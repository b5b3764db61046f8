"""A participant who keeps walking, run by the crash test in processes that it kills."""

from itertools import cycle
from multiprocessing.connection import Connection
from pathlib import Path

from human_study.trial.commands import Move, Resume, Start
from human_study.trial.session import PanSession
from sim.types import Action

from .small_world import SCENE_DIGEST, env, episode, study
from .stores import open_small

WALK = (Action.FORWARD, Action.FORWARD, Action.LEFT, Action.FORWARD, Action.RIGHT, Action.RIGHT, Action.FORWARD)


def walk_until_killed(folder: Path, acknowledged: Connection) -> None:
    """Walks on in p02's first trial; sends (seq, step, pose) after each acknowledged write."""
    config = study()
    store = open_small(folder, config)
    trial = store.open_trial("p02", 1)
    events = [stored.event for stored in store.events(trial.trial_id)]
    world, task = env(with_pictures=True), config.task_for(episode(), "pan")
    names = {"key": trial.key, "task": task, "scene_digest": SCENE_DIGEST}
    session = PanSession(world, **names).after(events) if events else PanSession(world, **names)
    command = Resume(trial.away_s) if events else Start()
    actions = cycle(WALK[len(world.steps) % len(WALK) :] + WALK[: len(world.steps) % len(WALK)])
    now_s = 0.0
    while not session.is_over:
        update = session.handle(command, now_s)
        seq = store.append_many(trial.trial_id, trial.epoch, update.events)[-1]
        acknowledged.send((seq, update.view.step, world.pose))
        now_s += 0.5
        command = Move(next(actions), "Key")
