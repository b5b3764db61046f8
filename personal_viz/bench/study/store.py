"""Measures the cost of a commit: stores people's keys, without pictures, pages and further processes."""

import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from human_study.design.plan import PlannedParticipant, PlannedTrial, StudyPlan, StudyScene
from human_study.design.secrets import token_hash
from human_study.design.study import StudyConfig, StudyDataset
from human_study.store.store import StudyStore, open_store
from human_study.trial.events import Act, Event, Key, Open, Shown
from sim.types import PAPER4, Action

SCENE = "BenchHome"
_HASH = "0" * 64


def store_acks_ms(*, participants: int, rate: float, seconds: float) -> list[float]:
    """Milliseconds from handing a key and its step to the store until they are on disk, for all keys of all people.

    Args:
        participants: Number of people who act at the same time, one thread each, as seats do.
        rate: Keys per second and person.
        seconds: Duration.
    """
    with tempfile.TemporaryDirectory(prefix="personal-viz-bench-") as name:
        config = StudyConfig(study="bench", dataset=StudyDataset(sha256=_HASH), task=("pan",), flow=())
        plan = _plan(config, participants)
        with open_store(Path(name), config, plan) as store:
            for person in plan.participants:
                store.add_participant(person, token_hash(person.code))
            acks: list[float] = []
            with ThreadPoolExecutor(participants) as people:
                waits = [
                    people.submit(_press, store, person.code, number / participants, rate, seconds, acks)
                    for number, person in enumerate(plan.participants)
                ]
                for wait in waits:
                    wait.result()
    return acks


def _press(store: StudyStore, code: str, offset: float, rate: float, seconds: float, acks: list[float]) -> None:
    """Plays one person: stores a key, its step and its picture at a time."""
    trial = store.open_trial(code, 1)
    store.append_many(trial.trial_id, trial.epoch, (_opened(),))
    began_s = time.perf_counter() + offset / rate
    for number in range(int(seconds * rate)):
        time.sleep(max(0.0, began_s + number / rate - time.perf_counter()))
        before_s = time.perf_counter()
        store.append_many(trial.trial_id, trial.epoch, _step(number, before_s - began_s))
        acks.append(1e3 * (time.perf_counter() - before_s))
        store.append_many(trial.trial_id, trial.epoch, (Shown(t_s=1.0, step=number + 1, frame_hash=_HASH),))


def _step(number: int, t_s: float) -> tuple[Event, ...]:
    return (
        Key(t_s=t_s, t_cli_ms=t_s * 1e3, code="KeyW", action=Action.FORWARD),
        Act(t_s=t_s, action=Action.FORWARD, position=(0.25 * number, 0.0, 1.5), yaw=0.0),
    )


def _opened() -> Open:
    return Open(
        t_s=0.0,
        task="pan",
        split="easy",
        scene=SCENE,
        episode_id="0",
        scene_digest=_HASH,
        max_steps=500,
        actions=PAPER4,
        position=(0.0, 0.0, 1.5),
        yaw=0.0,
    )


def _plan(config: StudyConfig, participants: int) -> StudyPlan:
    people = []
    for number in range(1, participants + 1):
        trial = PlannedTrial(
            order_no=1,
            phase="main",
            task="pan",
            condition="none",
            split="easy",
            scene=SCENE,
            episode_id="0",
            rep=number,
        )
        people.append(PlannedParticipant(code=f"p{number:02d}", task="pan", arm=0, trials=(trial,)))
    return StudyPlan(
        study_version=config.study_version,
        scenes=(StudyScene(name=SCENE, kind="invented"),),
        participants=tuple(people),
    )
