"""Stores of small studies, for tests of the store and of what reads it."""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from human_study.design.plan import StudyPlan, StudyScene
from human_study.design.planning import make_plan
from human_study.design.secrets import token_hash
from human_study.design.study import StudyConfig
from human_study.export.collect import collect, exported_codes
from human_study.export.trial_table import TrialRow
from human_study.store.records import StoredTrial, read_study
from human_study.store.store import StudyStore, Trial, open_store
from human_study.trial.events import Abandoned, Error, Event, Key, Moment, Open
from sim.tasks.run_files import EpisodeEnd
from sim.types import Action, EpisodeKey, Split

from .small_world import SCENE_DIGEST, plan, study

KEY = Key(code="KeyW", action=Action.FORWARD)
OPEN = Open(
    **{"task": "pan", "split": "easy", "scene": "room", "episode_id": "0", "scene_digest": SCENE_DIGEST},
    **{"max_steps": 500, "actions": (Action.STOP,), "position": (0.0, 0.0, 0.0), "yaw": 0.0},
)
HOUSE_ONCE = {"kind": "house-once", "raters_per_episode": 2, "overbook": 1.5}
"""In three homes with one episode each: p01 and p02 do every episode, and p03 is spare."""
HOMES = ("A", "B", "C")
ENDS: dict[str, Event] = {
    "giveup": Moment(kind="giveup"),
    "abandoned": Abandoned(away_s=1e4),
    "technical": Error(message="x", is_fatal=True),
}


def open_small(folder: Path, config: StudyConfig | None = None) -> StudyStore:
    """The store of a small study; makes it where there is none."""
    config = config or study()
    return open_store(folder, config, plan(config))


def plan_homes(
    config: StudyConfig, homes: Sequence[str] = HOMES, *, splits: Sequence[Split] = ("easy",), **choices: Any
) -> StudyPlan:
    """The plan of a study in invented homes that have an episode in each of these splits."""
    scenes = [StudyScene(name=home, kind="invented") for home in homes]
    return make_plan(config, scenes, [EpisodeKey(split, home, "0") for home in homes for split in splits], **choices)


def open_planned(folder: Path, config: StudyConfig, drawn: StudyPlan | None = None) -> StudyStore:
    """The store of a planned study with everybody registered; without `drawn`, its homes are `HOMES`."""
    store = open_store(folder, config, drawn or plan_homes(config))
    register(store)
    return store


def started(folder: Path, **changes: object) -> StudyStore:
    """`open_planned` of a study of PAN in `HOMES`, with the design `HOUSE_ONCE` unless another is given."""
    return open_planned(folder, study(**({"task": ("pan",), "design": HOUSE_ONCE} | changes)))


def register(store: StudyStore) -> None:
    """Registers everybody of the plan who is not registered; tokens are `token-p01` and so on."""
    for person in store.plan.participants:
        if store.code_of_token(token := f"token-{person.code}") is None:
            store.add_participant(person, token_hash(token))


def filled(folder: Path, config: StudyConfig | None = None) -> StudyStore:
    """The store of a small study with everybody registered."""
    store = open_small(folder, config)
    register(store)
    return store


@contextmanager
def opened(folder: Path) -> Iterator[tuple[StudyStore, Trial]]:
    """A store with one trial that has its first event, until the end of the block."""
    with filled(folder) as store:
        trial = store.open_trial("p02", 1)
        store.append(trial.trial_id, trial.epoch, OPEN)
        yield store, trial


def begun_trial(folder: Path) -> Trial:
    """A trial with its first event, in a store that is closed again."""
    with opened(folder) as (_, trial):
        return trial


def begin_next(store: StudyStore, code: str) -> Trial | None:
    """The participant's next trial with its first event; None where none is due."""
    place = store.next_trial(code)
    if place is None:
        return None
    trial = store.open_trial(code, place.order_no)
    store.append(trial.trial_id, trial.epoch, OPEN)
    return trial


def do_next(store: StudyStore, code: str, *, reason: str = "giveup") -> EpisodeKey | None:
    """Does the participant's next trial, which ends for this reason; returns its episode, None where none is due."""
    trial = begin_next(store, code)
    if trial is None:
        return None
    store.append(trial.trial_id, trial.epoch, ENDS[reason])
    store.finish_trial(trial.trial_id, EpisodeEnd(reason=reason))
    return trial.key


def trials_of(store: StudyStore, code: str) -> tuple[StoredTrial, ...]:
    """All assigned trials of a participant, each with all its attempts."""
    with read_study(store.folder) as reader:
        return reader.trials(code)


def checked(store: StudyStore) -> int:
    """The number of events, after a check of the database and all hash chains."""
    with read_study(store.folder) as reader:
        return reader.check()


def edit(folder: Path, sql: str) -> None:
    """Changes the database behind the store's back, after removing the append-only triggers."""
    database = sqlite3.connect(folder / "study.db")
    for (name,) in database.execute("SELECT name FROM sqlite_schema WHERE type = 'trigger'").fetchall():
        database.execute(f"DROP TRIGGER {name}")
    database.executescript(sql)
    database.close()


def rows_of(folder: Path) -> list[TrialRow]:
    """The rows of all attempts, under the study's own codes."""
    with read_study(folder) as reader:
        codes = {exported: code for code, exported in exported_codes(reader).items()}
        rows = [row.model_copy(update={"participant": codes[row.participant]}) for row in collect(reader).trials]
    return sorted(rows, key=lambda row: (row.participant, row.order_no, row.attempt))
