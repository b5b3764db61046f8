"""Writes about participants: stages, consent, taken links, leaving, exclusions."""

import hashlib
import json
import sqlite3
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from sim.errors import StudyError

from ..design.plan import StudyPlan
from ..design.secrets import new_id
from ..design.study import StudyConfig
from ..journey import Person, Stage
from .assigning import due_order_no, free_slot, others_can_take, release
from .database import BACKUP_FOLDER, audit, backup
from .records import (
    AUDIT_PILOT,
    DATABASE_FILE,
    AnswerKind,
    VerificationEntry,
    answer_place,
    read_study,
    unknown_participant,
)
from .trial_writes import Now, abandon_running
from .vault import Vault
from .writer import GroupWriter

MAX_ANSWER = 2000
"""Most characters of a personal answer, such as a comment."""
KEPT_BACKUPS = 10
"""Number of kept backups; older ones are deleted."""


class PeopleWrites:
    """The part of the store about participants; like the whole store it blocks, and any thread may call it."""

    def __init__(
        self, folder: Path, config: StudyConfig, plan: StudyPlan, writer: GroupWriter, vault: Vault, *, boot_id: str
    ) -> None:
        """Takes a writer that the caller closes; `boot_id` names this machine's boot."""
        self.folder = folder
        self.config = config
        self.plan = plan
        self._writer = writer
        self._vault = vault
        self._boot_id = boot_id
        self._backup_lock = threading.Lock()

    def participant(self, code: str) -> Person:
        """A participant. Raises StudyError for an unknown one."""
        with read_study(self.folder) as reader:
            return reader.participant(code)

    def enter_stage(self, code: str, stage: Stage, detail: dict[str, Any] | None = None) -> None:
        """Stores that a participant reached a stage; after `finished` the database is backed up if there is space.

        Repeats are stored too. The trials of a participant who is screened out go to others. The detail holds answers
        and similar facts, in JSON under 4 kB, without anything that identifies the person.

        Raises:
            StudyError: There is no such participant, or the detail is too long.
        """
        text = json.dumps(detail or {}, sort_keys=True)
        if len(text) > 4096:
            raise StudyError(f"participant {code!r}: detail of {stage} has {len(text)} characters; expected 4096.")

        def job(database: sqlite3.Connection) -> None:
            self._require_known(database, code)
            _add_stage(database, code, stage, text)
            if stage == "screened_out":
                release(database, code, stage)

        self._writer.write(job)
        if stage == "finished":
            with suppress(StudyError):  # the stage is stored; the serving process backs it up later and reports it
                self.back_up()

    def give_consent(self, code: str, text: str, *, given: bool) -> None:
        """Stores a participant's answer to the consent text that was shown.

        Raises:
            StudyError: There is no such participant.
        """
        text_hash = hashlib.sha256(text.encode()).hexdigest()

        def job(database: sqlite3.Connection) -> None:
            self._require_known(database, code)
            database.execute(
                "INSERT INTO consent(code, text_hash, given, at_ns) VALUES (?, ?, ?, ?)",
                (code, text_hash, int(given), time.time_ns()),
            )
            _add_stage(database, code, "consented" if given else "declined", "{}")
            if not given:
                release(database, code, "declined")

        self._writer.write(job)

    def keep_answer(self, code: str, kind: AnswerKind, text: str) -> None:
        """Stores what a participant says about the study or about themselves, encrypted with the participant's key.

        A second answer of a kind is stored too; the newest one counts.

        Raises:
            StudyError: There is no such participant, the participant's records are deleted, or the text is too long.
        """
        if len(text) > MAX_ANSWER:
            raise StudyError(f"participant {code!r}: {kind} has {len(text)} characters; expected {MAX_ANSWER} at most.")

        def job(database: sqlite3.Connection) -> None:
            self._require_known(database, code)
            payload = self._vault.seal(code, text, where=answer_place(code, kind))
            database.execute(
                "INSERT INTO personal_answer(code, kind, payload, at_ns) VALUES (?, ?, ?, ?)",
                (code, kind, payload, time.time_ns()),
            )

        self._writer.write(job)

    def has_answered(self, code: str, kind: AnswerKind) -> bool:
        """Whether the participant has given a personal answer of this kind."""
        with read_study(self.folder) as reader:
            return bool(reader.rows("SELECT 1 FROM personal_answer WHERE code = ? AND kind = ? LIMIT 1", code, kind))

    def claim_person(self, ext_hash: str | None) -> str | None:
        """The code of a place for a person who comes through an open link; None when the study is full.

        The same keyed hash of the recruiting platform's id gets the same place again.
        """

        def job(database: sqlite3.Connection) -> str | None:
            known = database.execute("SELECT code FROM claim WHERE ext_hash = ?", (ext_hash,)).fetchone()
            if ext_hash is not None and known:
                return known[0]
            free = database.execute(
                "SELECT code FROM participant WHERE NOT EXISTS(SELECT 1 FROM claim WHERE claim.code = participant.code)"
                " AND NOT EXISTS(SELECT 1 FROM stage WHERE stage.code = participant.code) ORDER BY length(code), code"
            ).fetchall()
            for (code,) in free:
                if self._has_work(database, code):
                    database.execute("INSERT INTO claim VALUES (?, ?, ?)", (code, ext_hash, time.time_ns()))
                    return code
            return None

        return self._writer.write(job)

    def drop_out(self, code: str, reason: str) -> int:
        """Gives a participant's unfinished counted trials to others; returns their number.

        A running trial ends as `abandoned` (HUMAN_STUDY.md, section 4). A participant who comes back gets the trials
        that are left then. A participant without unfinished trials is not changed.
        """
        now = self._now()

        def job(database: sqlite3.Connection) -> int:
            self._require_known(database, code)
            task = self.plan.participant(code).task
            num_left = abandon_running(database, self._vault, self.config, self.plan, code, now=now)
            # trials that wait for another attempt stay with the only person who could make it
            num_left += release(database, code, reason, also_tried=others_can_take(self.config, self.plan, task))
            if num_left:
                _add_stage(database, code, "dropped_out", json.dumps({"reason": reason, "released": num_left}))
                audit(database, f"drop out ({reason})", code)
            return num_left

        return self._writer.write(job)

    def withdraw(self, code: str) -> None:
        """Withdraws the participant: open trials go to others, and with `on_withdraw: delete` all data is shredded.

        Raises:
            StudyError: There is no such participant, or the keys cannot be written (then the withdrawal is stored, and
                finished at the next start).
        """
        is_deleted = self.config.privacy.on_withdraw == "delete"

        def job(database: sqlite3.Connection) -> None:
            self._require_known(database, code)
            release(database, code, "withdrawn", also_done=is_deleted)
            _add_stage(database, code, "withdrawn", json.dumps({"deleted": is_deleted}))
            audit(database, "withdraw", code)

        self._writer.write(job)
        if is_deleted:
            self._vault.shred(code)

    def finish_withdrawals(self) -> None:
        """Deletes the keys of participants who withdrew just before the program ended."""
        if self.config.privacy.on_withdraw != "delete":
            return
        with read_study(self.folder) as reader:
            gone = [person.code for person in reader.participants() if person.is_withdrawn]
        for code in gone:
            self._vault.shred(code)

    def add_verification(self, entry: VerificationEntry) -> None:
        """Stores the result of doing a trial again."""

        def job(database: sqlite3.Connection) -> None:
            database.execute(
                "INSERT INTO verification VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    entry.trial_id,
                    entry.run_id,
                    entry.status,
                    entry.max_position_error,
                    entry.first_bad_step,
                    entry.detail[:500],
                    entry.sim_hash,
                    entry.at_ns,
                ),
            )

        self._writer.write(job)

    def exclude(self, target_kind: Literal["trial", "participant"], target: str, *, rule_id: str, reason: str) -> str:
        """Leaves a trial or a participant out of the figures; returns the exclusion's id. Nothing is deleted.

        Raises:
            StudyError: There is no such trial or participant.
        """
        exclusion_id = new_id()

        def job(database: sqlite3.Connection) -> None:
            table, column = ("trial", "trial_id") if target_kind == "trial" else ("participant", "code")
            if not database.execute(f"SELECT 1 FROM {table} WHERE {column} = ?", (target,)).fetchone():
                raise StudyError(f"{self.folder}: found no {target_kind} {target!r}; expected one of the study's.")
            database.execute(
                "INSERT INTO exclusion VALUES (?, ?, ?, ?, ?, ?)",
                (exclusion_id, target_kind, target, rule_id, reason, time.time_ns()),
            )
            audit(database, f"exclude ({rule_id})", f"{target_kind} {target}")

        self._writer.write(job)
        return exclusion_id

    def undo_exclusion(self, exclusion_id: str) -> None:
        """Counts an excluded trial or participant again; a second call changes nothing.

        Raises:
            StudyError: There is no such exclusion.
        """

        def job(database: sqlite3.Connection) -> None:
            if not database.execute("SELECT 1 FROM exclusion WHERE exclusion_id = ?", (exclusion_id,)).fetchone():
                raise StudyError(f"{self.folder}: found no exclusion {exclusion_id!r}; expected one that was made.")
            database.execute("INSERT OR IGNORE INTO exclusion_undone VALUES (?, ?)", (exclusion_id, time.time_ns()))
            audit(database, "undo exclusion", exclusion_id)

        self._writer.write(job)

    def mark_pilot(self) -> None:
        """Records for ever that the study was served without an ethics id: its figures are those of a pilot."""
        self._writer.write(lambda database: audit(database, AUDIT_PILOT, self.config.study))

    def back_up(self) -> Path:
        """Copies the database to `backups/`; the newest KEPT_BACKUPS stay. Copies hold ciphertext only, never a key.

        Raises:
            StudyError: The copy cannot be written.
        """
        with self._backup_lock:
            path = self.folder / BACKUP_FOLDER / f"study-{self._next_backup_ns()}.db"
            try:
                source = sqlite3.connect(f"{(self.folder / DATABASE_FILE).absolute().as_uri()}?mode=ro", uri=True)
                try:
                    backup(source, path)
                finally:
                    source.close()
                for old in sorted(path.parent.glob("study-[0-9]*.db"))[:-KEPT_BACKUPS]:
                    old.unlink(missing_ok=True)
            except (OSError, sqlite3.Error) as error:
                raise StudyError(
                    f"{path}: cannot be written ({error}); expected space for a copy of the database. "
                    "The study goes on."
                ) from None
            return path

    def _next_backup_ns(self) -> int:
        """Time in a backup's name: now, or just after the newest backup if the wall clock went back."""
        names = [path.stem.removeprefix("study-") for path in (self.folder / BACKUP_FOLDER).glob("study-[0-9]*.db")]
        return max([time.time_ns(), *(int(name) + 1 for name in names if name.isdecimal())])

    def _now(self) -> Now:
        return Now(time.time_ns(), time.monotonic_ns(), self._boot_id)

    def _has_work(self, database: sqlite3.Connection, code: str) -> bool:
        """Whether the participant still has counted trials to do."""
        person = database.execute("SELECT 1 FROM assignment WHERE code = ? AND phase = 'main'", (code,)).fetchone()
        if person:
            return due_order_no(database, code) is not None
        return free_slot(database, self.config, self.plan, code) is not None

    def _require_known(self, database: sqlite3.Connection, code: str) -> None:
        codes = [found for (found,) in database.execute("SELECT code FROM participant ORDER BY rowid")]
        if code not in codes:
            raise unknown_participant(self.folder, code, codes)


def _add_stage(database: sqlite3.Connection, code: str, stage: Stage, detail: str) -> None:
    database.execute(
        "INSERT INTO stage(code, stage, detail, at_ns) VALUES (?, ?, ?, ?)", (code, stage, detail, time.time_ns())
    )
