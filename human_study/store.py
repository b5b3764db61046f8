"""The study's one writer: what it acknowledged is committed, synced to disk and can never be changed.

One process holds `study.lock`; one thread owns the only write connection and commits waiting writes together. Every
method may be called from any thread and blocks until its write is on disk.
"""

import sqlite3
import time
import uuid
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from sim.errors import StudyError
from sim.types import EpisodeKey, TaskKind

from .database import audit, open_database, take_lock
from .events import Event, Reconnect, event_to_json
from .outcome import Outcome
from .plan import PlannedTrial
from .records import (
    DATABASE_FILE,
    StoredEvent,
    TrialStatus,
    event_hash,
    first_hash,
    read_study,
)
from .study import StudyConfig
from .tickets import new_id
from .writer import GroupWriter


class SupersededError(StudyError):
    """A newer tab drives this trial; nothing was stored."""


class TrialEndedError(StudyError):
    """The trial has its outcome and takes no more events; nothing was stored."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The right to write to a trial until somebody opens it again."""

    trial_id: str
    code: str
    """The participant."""
    order_no: int
    task: TaskKind
    key: EpisodeKey
    epoch: int
    """1 when first opened; pass it with every append."""
    away_s: float
    """Seconds since the trial's last event; 0 without events."""


class StudyStore:
    """The open store of one study; made by `open_store`, a context manager."""

    def __init__(self, folder: Path, config: StudyConfig, database: sqlite3.Connection, lock: IO[str]) -> None:
        """Takes over a database that is up to date and a lock that is held."""
        self.folder = folder
        self.config = config
        self._path = folder / DATABASE_FILE
        self._database = database
        self._lock = lock
        self._boot_id = _boot_id()
        self._writer = GroupWriter(database, self._path)

    def __enter__(self) -> "StudyStore":
        """The store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes it."""
        self.close()

    def close(self) -> None:
        """Finish waiting writes, close the database and let go of the lock; twice is once."""
        self._writer.close()
        self._database.close()
        self._lock.close()

    def add_participant(self, code: str, token_hash: str, trials: Sequence[PlannedTrial]) -> None:
        """Register a participant with the planned trials.

        Raises:
            StudyError: The code or the token is taken, or two trials share a place in the order.
        """

        def job(database: sqlite3.Connection) -> None:
            now_ns = time.time_ns()
            taken = database.execute(
                "SELECT code FROM participant WHERE code = ? OR token_hash = ?", (code, token_hash)
            ).fetchone()
            if taken or len({trial.order_no for trial in trials}) != len(trials):
                raise StudyError(
                    f"{self._path}: participant {code!r} is registered already or has two trials in one place; "
                    "expected a new code and an order without repeats. Make a new plan in a new folder."
                )
            database.execute("INSERT INTO participant VALUES (?, ?, ?)", (code, token_hash, now_ns))
            database.executemany(
                "INSERT INTO slot VALUES (?, ?, ?, ?, ?, ?, ?)",
                [(new_id(), code, trial.order_no, trial.task, *trial.key) for trial in trials],
            )
            audit(database, "add participant", code)

        self._writer.write(job)

    def open_trial(self, code: str, order_no: int) -> Trial:
        """Begin a planned trial, or take it over: the newest opening writes, older ones are refused from now on.

        A trial that already has events gets the event `reconnect`.

        Raises:
            TrialEndedError: It has its outcome.
            StudyError: The participant has no such trial.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> Trial:
            slot = database.execute(
                "SELECT slot_id, task, split, scene, episode_id FROM slot WHERE code = ? AND order_no = ?",
                (code, order_no),
            ).fetchone()
            if slot is None:
                raise StudyError(
                    f"{self._path}: participant {code!r} has no trial {order_no}; expected one of the plan's. "
                    "Check the code and the number."
                )
            slot_id, task, *key = slot
            trial_id = self._latest_attempt(database, slot_id, now.wall_ns)
            self._require_running(database, trial_id)
            last_epoch = database.execute("SELECT max(epoch) FROM sitting WHERE trial_id = ?", (trial_id,)).fetchone()[
                0
            ]
            epoch = (last_epoch or 0) + 1
            database.execute("INSERT INTO sitting VALUES (?, ?, ?)", (trial_id, epoch, now.wall_ns))
            away_s = _seconds_since_last_event(database, trial_id, now)
            if away_s is not None:
                self._insert(database, trial_id, epoch, [Reconnect(epoch=epoch, away_s=away_s)], now)
            return Trial(trial_id, code, order_no, task, EpisodeKey(*key), epoch, away_s or 0.0)

        return self._writer.write(job)

    def append(self, trial_id: str, epoch: int, event: Event) -> int:
        """Store one event; returns its number in the trial. Raises as `append_many`."""
        return self.append_many(trial_id, epoch, (event,))[0]

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> tuple[int, ...]:
        """Store events together, all or none; returns their numbers in the trial.

        Raises:
            SupersededError: The trial was opened again after `epoch`.
            TrialEndedError: The trial has its outcome.
            StoreFullError: The disk is full.
            StudyError: There is no such trial, or the store is closed.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> tuple[int, ...]:
            newest = database.execute("SELECT max(epoch) FROM sitting WHERE trial_id = ?", (trial_id,)).fetchone()[0]
            if newest is None:
                raise StudyError(f"{self._path}: found no trial {trial_id!r}; expected one that open_trial gave.")
            if epoch != newest:
                raise SupersededError(
                    f"trial {trial_id}: epoch is {epoch}; expected {newest}, the newest tab. Continue in that tab."
                )
            self._require_running(database, trial_id)
            return self._insert(database, trial_id, epoch, events, now)

        return self._writer.write(job) if events else ()

    def finish_trial(self, trial_id: str, outcome: Outcome) -> Outcome:
        """Store how a trial ended and close it for good; returns what is stored, which is the first answer ever given.

        Args:
            trial_id: Of an open trial with at least one event.
            outcome: `EpisodeEnd` with measures for PAN, the whole `Answer` for POG.

        Raises:
            StoreFullError: The disk is full.
            StudyError: The trial has no events, or the store is closed.
        """
        now_ns = time.time_ns()
        reason = outcome.reason

        def job(database: sqlite3.Connection) -> None:
            if database.execute("SELECT 1 FROM outcome WHERE trial_id = ?", (trial_id,)).fetchone():
                return
            _, head = _last_event(database, trial_id)
            if head is None:
                raise StudyError(f"{self._path}: trial {trial_id!r} has no events; expected at least 'open'.")
            database.execute(
                "INSERT INTO outcome VALUES (?, ?, ?, ?, ?)",
                (trial_id, reason, outcome.model_dump_json(), head, now_ns),
            )

        self._writer.write(job)
        with read_study(self.folder) as reader:
            stored = reader.outcome(trial_id)
        assert stored is not None
        return stored

    def events(self, trial_id: str) -> tuple[StoredEvent, ...]:
        """All stored events of a trial, in order."""
        with read_study(self.folder) as reader:
            return reader.events(trial_id)

    def trials(self, code: str) -> tuple[TrialStatus, ...]:
        """All planned trials of a participant, in order. Raises StudyError for an unknown participant."""
        with read_study(self.folder) as reader:
            return reader.trials(code)

    def code_of_token(self, token: str) -> str | None:
        """The participant who holds this personal token; None if nobody does."""
        with read_study(self.folder) as reader:
            return reader.code_of_token(token)

    def check(self) -> int:
        """Check the database and all hash chains; returns the number of events. Raises StudyError on damage."""
        with read_study(self.folder) as reader:
            return reader.check()

    def _now(self) -> "_Now":
        return _Now(time.time_ns(), time.monotonic_ns(), self._boot_id)

    def _latest_attempt(self, database: sqlite3.Connection, slot_id: str, now_ns: int) -> str:
        row = database.execute(
            "SELECT trial_id FROM trial WHERE slot_id = ? ORDER BY attempt DESC LIMIT 1", (slot_id,)
        ).fetchone()
        if row is not None:
            return row[0]
        trial_id = new_id()
        database.execute("INSERT INTO trial VALUES (?, ?, 1, ?)", (trial_id, slot_id, now_ns))
        return trial_id

    def _require_running(self, database: sqlite3.Connection, trial_id: str) -> None:
        row = database.execute("SELECT end_reason FROM outcome WHERE trial_id = ?", (trial_id,)).fetchone()
        if row is not None:
            raise TrialEndedError(
                f"trial {trial_id}: has ended ({row[0]}); expected a running trial. Open the participant's next trial."
            )

    def _insert(
        self, database: sqlite3.Connection, trial_id: str, epoch: int, events: Sequence[Event], now: "_Now"
    ) -> tuple[int, ...]:
        last_seq, head = _last_event(database, trial_id)
        prev = head or first_hash(self.config.study_version, trial_id)
        rows = []
        for seq, event in enumerate(events, start=last_seq + 1):
            row = (trial_id, seq, epoch, event.kind, now.wall_ns, now.mono_ns, now.boot_id, event_to_json(event))
            digest = event_hash(prev, row)
            rows.append((*row, prev, digest))
            prev = digest
        database.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
        return tuple(row[1] for row in rows)


@dataclass(frozen=True, slots=True)
class _Now:
    wall_ns: int
    mono_ns: int
    boot_id: str


def open_store(folder: Path, config: StudyConfig) -> StudyStore:
    """Open a study's store for writing; makes it when the folder has none.

    Raises:
        StudyError: The folder cannot be written, another process has the store open, the file is damaged, of another
            program, of a newer version or of another study, or stored events were changed.
    """
    with ExitStack() as opened:
        lock = opened.enter_context(take_lock(folder))
        database = opened.enter_context(closing(open_database(folder / DATABASE_FILE, config)))
        with read_study(folder) as reader:
            reader.check()
        opened.pop_all()
    return StudyStore(folder, config, database, lock)


def _last_event(database: sqlite3.Connection, trial_id: str) -> tuple[int, str | None]:
    """(seq, hash) of a trial's last event; (0, None) without events."""
    row = database.execute(
        "SELECT seq, hash FROM event WHERE trial_id = ? ORDER BY seq DESC LIMIT 1", (trial_id,)
    ).fetchone()
    return row or (0, None)


def _seconds_since_last_event(database: sqlite3.Connection, trial_id: str, now: _Now) -> float | None:
    """Seconds since the participant's last event; None without events. Reloading alone does not restart the count.

    Within one boot the monotonic clock counts; across boots only the wall clock is left.
    """
    row = database.execute(
        "SELECT t_srv_ns, t_srv_mono_ns, boot_id FROM event WHERE trial_id = ? AND kind <> 'reconnect'"
        " ORDER BY seq DESC LIMIT 1",
        (trial_id,),
    ).fetchone()
    if row is None:
        return None
    wall_ns, mono_ns, boot_id = row
    passed_ns = now.mono_ns - mono_ns if boot_id == now.boot_id else now.wall_ns - wall_ns
    return max(0, passed_ns) / 1e9


def _boot_id() -> str:
    """Names this machine's boot; where the system has no such name, this process."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return str(uuid.uuid4())
