"""The study's one writer: an acknowledged write is committed, synced to disk and can never be changed.

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

from sim.errors import StudyError
from sim.types import EpisodeKey, TaskKind

from ..design.plan import Phase, PlannedParticipant, StudyPlan
from ..design.study import Condition, StudyConfig
from ..journey import AssignedTrial, has_dropped_out, way_out
from ..trial.events import Error, Event, Reconnect
from ..trial.outcome import Outcome
from .assigning import assign, due_order_no, fill
from .database import audit, close_to_others, open_database
from .lock import StudyLock, take_lock
from .people import PeopleWrites
from .records import DATABASE_FILE, StoredEvent, num_rows, read_study
from .trial_writes import (
    Now,
    insert_events,
    insert_outcome,
    last_event,
    new_trial,
    queue_again,
    seconds_since_last_event,
)
from .vault import Vault
from .writer import GroupWriter


class SupersededError(StudyError):
    """A newer tab drives this trial; nothing was stored."""


class TrialEndedError(StudyError):
    """The trial has its outcome and takes no more events; nothing was stored."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The right to write to a trial until it is opened again."""

    trial_id: str
    code: str
    """The participant."""
    order_no: int
    phase: Phase
    task: TaskKind
    condition: Condition
    key: EpisodeKey
    attempt: int
    """Number of the attempt, from 1; higher after our failures."""
    epoch: int
    """1 at the first opening, then higher; pass it with every append."""
    away_s: float
    """Seconds since the trial's last event; 0 without events."""


class StudyStore(PeopleWrites):
    """The open store of one study; made by `open_store`, a context manager."""

    def __init__(
        self, folder: Path, config: StudyConfig, plan: StudyPlan, database: sqlite3.Connection, lock: StudyLock
    ) -> None:
        """Takes over an up-to-date database and a held lock."""
        path = folder / DATABASE_FILE
        writer = GroupWriter(database, path, lock, num_rows=num_rows(database))
        super().__init__(folder, config, plan, writer, Vault(folder), boot_id=_boot_id())
        self._path = path
        self._database = database
        self._lock = lock
        self._num_lost_logs = 0
        self._connections: dict[str, int] = {}
        """Each participant's newest connection that has opened a trial; used only by the writer's thread."""

    def __enter__(self) -> "StudyStore":
        """The store itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the store."""
        self.close()

    def close(self) -> None:
        """Finishes waiting writes, closes the database and releases the lock; a second call does nothing."""
        self._writer.close()
        self._database.close()
        self._lock.close()

    def add_participant(self, person: PlannedParticipant, token_hash: str) -> None:
        """Registers a participant with the planned trials.

        Raises:
            StudyError: The code or the token is taken, two trials share a place in the order, or another participant
                has one of the episodes.
        """

        def job(database: sqlite3.Connection) -> None:
            now_ns = time.time_ns()
            taken = database.execute(
                "SELECT code FROM participant WHERE code = ? OR token_hash = ?", (person.code, token_hash)
            ).fetchone()
            if taken or len({trial.order_no for trial in person.trials}) != len(person.trials):
                raise StudyError(
                    f"{self._path}: participant {person.code!r} is registered already or has two trials in one place; "
                    "expected a new code and an order without repeats. Make a new plan in a new folder."
                )
            database.execute(
                "INSERT INTO participant(code, token_hash, created_ns, task, arm) VALUES (?, ?, ?, ?, ?)",
                (person.code, token_hash, now_ns, person.task, person.arm),
            )
            try:
                for trial in person.trials:
                    assign(database, person.code, trial)
            except sqlite3.IntegrityError as error:
                raise StudyError(
                    f"{self._path}: participant {person.code!r}: {error}; expected episodes that nobody else has. "
                    "Make the plan again in a new folder."
                ) from None
            audit(database, "add participant", person.code)

        self._vault.add(person.code)
        self._writer.write(job)

    def next_trial(self, code: str) -> AssignedTrial | None:
        """The participant's next trial; when all planned ones are done, it is one that others left.

        Until that trial has ended, further calls return the same one. None when there is nothing (more) to do.

        Raises:
            StudyError: There is no such participant, or the participant has left for good.
        """
        person = self.participant(code)
        out = way_out(person.stages)
        if out is not None:
            raise StudyError(f"{self._path}: participant {code!r} has left ({out}); expected one who takes part.")
        if has_dropped_out(person.stages):
            self.enter_stage(code, "returned")

        def job(database: sqlite3.Connection) -> None:
            if due_order_no(database, code) is None:
                fill(database, self.config, self.plan, code)

        self._writer.write(job)
        return self.participant(code).due

    def open_trial(self, code: str, order_no: int, *, connection: int = 0) -> Trial:
        """Begins a planned trial or takes it over: the newest opening may write, older ones are refused from now on.

        A trial that already has events gets the event `reconnect`. `connection` is higher for each later connection of
        the participant since the store was opened: a home takes long to open, and an older connection that comes later
        must not take over from a newer one.

        Raises:
            SupersededError: A newer connection has opened a trial.
            TrialEndedError: The trial has its outcome.
            StudyError: The participant has no such trial.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> Trial:
            newest = self._connections.get(code, 0)
            if connection < newest:
                raise SupersededError(
                    f"participant {code!r}: asked from connection {connection}; expected {newest}, the newest tab's. "
                    "Continue in that tab."
                )
            row = database.execute(
                "SELECT assignment_id, phase, task, condition, split, scene, episode_id FROM assignment"
                " WHERE code = ? AND order_no = ?",
                (code, order_no),
            ).fetchone()
            if row is None:
                raise StudyError(
                    f"{self._path}: participant {code!r} has no trial {order_no}; expected one that next_trial gave. "
                    "Check the code and the number."
                )
            assignment_id, phase, task, condition, *names = row
            key = EpisodeKey(*names)
            self._require_consent(database, code)
            self._connections[code] = connection
            trial_id, attempt = self._latest_attempt(database, code, assignment_id, key, now.wall_ns)
            self._require_running(database, trial_id)
            last_epoch = database.execute("SELECT max(epoch) FROM sitting WHERE trial_id = ?", (trial_id,)).fetchone()
            epoch = (last_epoch[0] or 0) + 1
            database.execute("INSERT INTO sitting VALUES (?, ?, ?)", (trial_id, epoch, now.wall_ns))
            away_s = seconds_since_last_event(database, trial_id, now)
            if away_s is not None:
                self._insert(database, trial_id, epoch, [Reconnect(epoch=epoch, away_s=away_s)], now)
            return Trial(trial_id, code, order_no, phase, task, condition, key, attempt, epoch, away_s or 0.0)

        return self._writer.write(job)

    def append(self, trial_id: str, epoch: int, event: Event) -> int:
        """Stores one event; returns its number in the trial. Raises the errors of `append_many`."""
        return self.append_many(trial_id, epoch, (event,))[0]

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> tuple[int, ...]:
        """Stores events together, all or none; returns their numbers in the trial.

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

    def note_error(self, code: str, message: str) -> None:
        """Stores an error outside the trial with the participant's running trial; does nothing if none is running.

        An opened trial without its first event does not count: every trial begins with `open`. The message, which is
        cut at 500 characters, must not identify the person.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> None:
            row = database.execute(
                "SELECT trial_id, max(epoch) FROM sitting JOIN trial USING(trial_id) JOIN assignment"
                " USING(assignment_id) WHERE code = ? AND trial_id NOT IN (SELECT trial_id FROM outcome)"
                " AND assignment_id NOT IN (SELECT assignment_id FROM release)"
                " AND EXISTS(SELECT 1 FROM event WHERE event.trial_id = trial.trial_id AND seq = 1 AND kind = 'open')"
                " GROUP BY trial_id ORDER BY trial.opened_ns DESC LIMIT 1",
                (code,),
            ).fetchone()
            if row is not None:
                trial_id, epoch = row
                self._insert(database, trial_id, epoch, [Error(message=message[:500], is_fatal=False)], now)

        self._writer.write(job)

    def finish_trial(self, trial_id: str, outcome: Outcome) -> Outcome:
        """Stores a trial's outcome and closes it for good; returns the stored outcome, which is the first one given.

        For PAN it is an `EpisodeEnd` with measures, for POG the whole `Answer`.

        Raises:
            TrialEndedError: The participant gave the trial back, or withdrew.
            StoreFullError: The disk is full.
            StudyError: The trial has no events, or the store is closed.
        """
        now_ns = time.time_ns()

        def job(database: sqlite3.Connection) -> None:
            if database.execute("SELECT 1 FROM outcome WHERE trial_id = ?", (trial_id,)).fetchone():
                return
            self._require_held(database, trial_id)
            _, head = last_event(database, trial_id)
            if head is None:
                raise StudyError(f"{self._path}: trial {trial_id!r} has no events; expected at least 'open'.")
            insert_outcome(database, self._vault, trial_id, outcome, now_ns=now_ns)
            queue_again(database, trial_id, outcome.reason, now_ns, config=self.config, plan=self.plan)

        self._writer.write(job)
        with read_study(self.folder) as reader:
            stored = reader.outcome(trial_id)
        if stored is None:
            raise TrialEndedError(f"trial {trial_id}: the participant withdrew; expected a trial that is kept.")
        return stored

    def look_after_log(self) -> str | None:
        """Saves the database anew if its log was taken away; one thread calls it.

        Returns a line for the person who serves the study if that happened since the last call.

        Raises:
            StoreFullError: It cannot be saved now.
        """
        self._writer.write(lambda _: None)
        told, self._num_lost_logs = self._num_lost_logs, self._writer.num_lost_logs
        if self._num_lost_logs == told:
            return None
        return (
            f"{self._path}-wal: was taken away while the study is served; expected nobody to touch it. All rows were "
            "saved anew and nothing is lost: find out which program deleted it."
        )

    def events(self, trial_id: str) -> tuple[StoredEvent, ...]:
        """All stored events of a trial, in order."""
        with read_study(self.folder) as reader:
            return reader.events(trial_id)

    def code_of_token(self, token: str) -> str | None:
        """Code of the participant with this personal token; None if there is none."""
        with read_study(self.folder) as reader:
            return reader.code_of_token(token)

    def _require_consent(self, database: sqlite3.Connection, code: str) -> None:
        """Raises StudyError where the study needs consent and the last answer is not yes."""
        if "consent" not in self.config.flow:
            return
        row = database.execute("SELECT given FROM consent WHERE code = ? ORDER BY seq DESC LIMIT 1", (code,)).fetchone()
        if row is None or not row[0]:
            raise StudyError(
                f"{self._path}: participant {code!r} has not consented; expected consent before the first trial."
            )

    def _latest_attempt(
        self, database: sqlite3.Connection, code: str, assignment_id: str, key: EpisodeKey, now_ns: int
    ) -> tuple[str, int]:
        """(id, attempt) of the trial to continue; makes the first one, with the participant's earlier visits."""
        row = database.execute(
            "SELECT trial_id, attempt FROM trial WHERE assignment_id = ? ORDER BY attempt DESC LIMIT 1",
            (assignment_id,),
        ).fetchone()
        return row if row is not None else (new_trial(database, code, assignment_id, 1, key, now_ns), 1)

    def _require_running(self, database: sqlite3.Connection, trial_id: str) -> None:
        row = database.execute("SELECT end_reason FROM outcome WHERE trial_id = ?", (trial_id,)).fetchone()
        if row is not None:
            raise TrialEndedError(
                f"trial {trial_id}: has ended ({row[0]}); expected a running trial. Open the participant's next trial."
            )
        self._require_held(database, trial_id)

    def _require_held(self, database: sqlite3.Connection, trial_id: str) -> None:
        """Raises TrialEndedError where the trial was given back, or the participant withdrew in any trial."""
        row = database.execute(
            "SELECT reason FROM release JOIN trial USING(assignment_id) WHERE trial_id = ?1 UNION ALL"
            " SELECT stage FROM stage JOIN assignment USING(code) JOIN trial USING(assignment_id)"
            " WHERE trial_id = ?1 AND stage = 'withdrawn'",
            (trial_id,),
        ).fetchone()
        if row is not None:
            raise TrialEndedError(
                f"trial {trial_id}: was given back ({row[0]}); expected a running trial. Open the participant's next."
            )

    def _insert(
        self, database: sqlite3.Connection, trial_id: str, epoch: int, events: Sequence[Event], now: Now
    ) -> tuple[int, ...]:
        version = self.config.study_version
        return insert_events(database, self._vault, version, trial_id, epoch=epoch, events=events, now=now)


def open_store(folder: Path, config: StudyConfig, plan: StudyPlan) -> StudyStore:
    """Opens a study's store for writing; makes it when the folder has none.

    Raises:
        StudyError: The folder cannot be written, another process has the store open, stored events were changed or
            taken away, or the file is damaged or belongs to another program, a newer version or another study.
    """
    with ExitStack() as opened:
        lock = opened.enter_context(closing(take_lock(folder)))
        close_to_others(folder)
        database = opened.enter_context(closing(open_database(folder / DATABASE_FILE, config, plan)))
        with read_study(folder) as reader:
            reader.check()
        opened.pop_all()
    store = StudyStore(folder, config, plan, database, lock)
    store.finish_withdrawals()
    return store


def _boot_id() -> str:
    """A name of this machine's boot; where the system has none, a name of this process."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return str(uuid.uuid4())
