"""Measures the cost of a commit: stores people's keys, without pictures, pages and further processes."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from human_study.design.plan import StudyScene
from human_study.design.planning import make_plan
from human_study.design.secrets import token_hash
from human_study.design.study import StudyChecks, StudyConfig, StudyDataset, StudyDesign, StudyPractice
from human_study.store.store import StudyStore, open_store
from human_study.trial.events import Act, Event, Key, Open, Shown
from sim.types import PAPER4, Action, EpisodeKey

from ...bots.figures import quantiles_ms
from ..harness import Progress, Values

SCENE = "BenchHome"
_HASH = "0" * 64


class StoreSettings(BaseModel):
    """Settings for measuring the store alone."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    participants: int = 50
    rate: float = 2.0
    """Keys per second of each participant."""
    seconds: float = 10.0

    @property
    def words(self) -> str:
        """A description of the work, for the report."""
        return f"the store alone, {self.participants} people for {self.seconds:g} s."


def measure_store(settings: StoreSettings, *, folder: Path, dataset: Path, progress: Progress) -> Values:
    """Times the store alone, from handing over a key and its step until they are on disk. It serves no study."""
    acks = store_acks_ms(folder, participants=settings.participants, rate=settings.rate, seconds=settings.seconds)
    return quantiles_ms("ack", acks, 50, 95)


def store_acks_ms(folder: Path, *, participants: int, rate: float, seconds: float) -> list[float]:
    """Milliseconds from handing a key and its step to the store until they are on disk, for all keys of all people.

    Args:
        folder: An empty folder.
        participants: Number of people who act at the same time, one thread each, as seats do.
        rate: Keys per second and person.
        seconds: Duration.
    """
    config = StudyConfig(
        study="bench",
        dataset=StudyDataset(sha256=_HASH),
        task=("pan",),
        flow=(),
        design=StudyDesign(kind="crossed", raters_per_episode=participants),
        practice=StudyPractice(pan=0, pog=0),
        checks=StudyChecks(every=None),
    )
    home, key = StudyScene(name=SCENE, kind="invented"), EpisodeKey("easy", SCENE, "0")
    plan = make_plan(config, [home], [key], is_pilot=True)
    acks: list[float] = []
    with open_store(folder, config, plan) as store, ThreadPoolExecutor(participants) as people:
        for person in plan.participants:
            store.add_participant(person, token_hash(person.code))
        waits = [
            people.submit(_press, store, person.code, number / participants, rate, seconds, acks)
            for number, person in enumerate(plan.participants)
        ]
        for wait in waits:
            wait.result()
    return acks


def _press(store: StudyStore, code: str, offset: float, rate: float, seconds: float, acks: list[float]) -> None:
    """Plays one person: stores one key, its step and its picture after another."""
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
