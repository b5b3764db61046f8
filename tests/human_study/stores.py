"""Stores of a small study, for tests of the store and of what reads it."""

import sqlite3
from pathlib import Path

from human_study.design.secrets import token_hash
from human_study.design.study import StudyConfig
from human_study.export.collect import collect, exported_codes
from human_study.export.trial_table import TrialRow
from human_study.store.records import read_study
from human_study.store.store import StudyStore, Trial, open_store
from human_study.trial.events import Key, Open
from sim.types import Action

from .small_world import SCENE_DIGEST, plan, study

KEY = Key(code="KeyW", action=Action.FORWARD)
OPEN = Open(
    task="pan",
    split="easy",
    scene="room",
    episode_id="0",
    scene_digest=SCENE_DIGEST,
    max_steps=500,
    actions=(Action.STOP,),
    position=(0.0, 0.0, 0.0),
    yaw=0.0,
)


def open_small(folder: Path, config: StudyConfig | None = None) -> StudyStore:
    """The store of a small study; makes it where there is none."""
    config = config or study()
    return open_store(folder, config, plan(config))


def filled(folder: Path) -> StudyStore:
    """A store with the plan's two participants, whose tokens are `token-p01` and `token-p02`."""
    store = open_small(folder)
    for person in plan(study()).participants:
        store.add_participant(person, token_hash(f"token-{person.code}"))
    return store


def opened(folder: Path) -> tuple[StudyStore, Trial]:
    """A store with one trial that has its first event."""
    store = filled(folder)
    trial = store.open_trial("p02", 1)
    store.append(trial.trial_id, trial.epoch, OPEN)
    return store, trial


def edit(folder: Path, sql: str) -> None:
    """Change the database behind the store's back, append-only triggers removed."""
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
