"""How a study goes while it runs: who is where, how much is done, what is free. Never how well anybody did.

Outcomes stay hidden until the collection is over, so that nobody stops it at a moment that suits (HUMAN_STUDY.md,
section 8). Ages are of the server's wall clock: for people to read, nothing is decided by them.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.types import SPLITS, Split, TaskKind

from ..design.study import Condition
from .database import BACKUP_FOLDER, free_mb
from .progress_people import STUCK_AFTER_S, PersonProgress, State, person_progress
from .progress_rows import PersonRow, person_rows
from .records import DATABASE_FILE, StudyReader

MOST_TIMES = 120
"""Points of the timeline."""


@dataclass(frozen=True, slots=True)
class SlotCount:
    """Episodes of one split in one condition, each as often as the plan wants it."""

    task: TaskKind
    condition: Condition
    split: Split
    num_done: int
    num_held: int
    """Somebody has it, and has still to do it."""
    num_free: int
    """Given back, and waiting for somebody."""
    num_failed: int
    """Ended twice by a failure of ours, or left twice where nobody else can take it; nobody gets it again."""

    @property
    def num_all(self) -> int:
        """All of them."""
        return self.num_done + self.num_held + self.num_free + self.num_failed


@dataclass(frozen=True, slots=True)
class TimePoint:
    """How far the collection was."""

    at_ns: int
    num_done: int
    """Counted trials."""


@dataclass(frozen=True, slots=True)
class DiskState:
    """Room for the study, and copies of it."""

    free_mb: int
    used_mb: float
    """By the database and its log."""
    num_backups: int
    last_backup_s: float | None
    """Seconds since the newest backup; None = there is none."""


@dataclass(frozen=True, slots=True)
class StudyProgress:
    """How a study goes; holds no outcome of any trial."""

    study: str
    study_version: str
    is_pilot: bool
    now_ns: int
    num_done: int
    """Counted trials that are over."""
    num_all: int
    """Counted trials that the plan wants."""
    people: tuple[PersonProgress, ...]
    slots: tuple[SlotCount, ...]
    timeline: tuple[TimePoint, ...]
    """Oldest first; at most MOST_TIMES."""
    disk: DiskState

    def num_in(self, *states: State) -> int:
        """How many participants are in one of these states."""
        return sum(person.state in states for person in self.people)


def study_progress(reader: StudyReader, *, now_ns: int, stuck_after_s: float = STUCK_AFTER_S) -> StudyProgress:
    """The progress in a snapshot of the study.

    Args:
        reader: One snapshot.
        now_ns: The server's wall clock.
        stuck_after_s: Who stores nothing for so long in a trial is stuck.
    """
    config = reader.config
    rows = person_rows(reader)
    slots = _slots(rows)
    return StudyProgress(
        study=config.study,
        study_version=reader.study_version,
        is_pilot=reader.is_pilot,
        now_ns=now_ns,
        num_done=sum(slot.num_done for slot in slots),
        num_all=sum(slot.num_all for slot in slots),
        people=tuple(person_progress(config, row, now_ns=now_ns, stuck_after_s=stuck_after_s) for row in rows),
        slots=slots,
        timeline=_timeline(rows),
        disk=_disk(reader.folder, now_ns),
    )


def _slots(rows: Sequence[PersonRow]) -> tuple[SlotCount, ...]:
    """One count for each task, condition and split that the plan has."""
    holders = defaultdict(list)
    for row in rows:
        for trial in row.person.trials:
            if trial.phase == "main":
                holders[trial.slot].append(trial)
    counts: dict[tuple[TaskKind, Condition, Split], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for (task, condition, key, _), trials in holders.items():
        held = next((trial for trial in trials if not trial.is_released), None)
        state = "free" if held is None else "held" if held.is_due else "done" if held.is_done else "failed"
        counts[task, condition, key.split][state] += 1
    return tuple(
        SlotCount(*place, **{f"num_{state}": counts[place][state] for state in ("done", "held", "free", "failed")})
        for place in sorted(counts, key=lambda place: (place[0], place[1], SPLITS.index(place[2])))
    )


def _timeline(rows: Sequence[PersonRow]) -> tuple[TimePoint, ...]:
    """Counted trials over time, thinned out; the last one is always there."""
    ends = sorted(
        trial.ended_ns
        for row in rows
        for trial in row.person.trials
        if trial.phase == "main" and trial.is_done and trial.ended_ns is not None
    )
    points = [TimePoint(at_ns, number) for number, at_ns in enumerate(ends, start=1)]
    every = -(-len(points) // MOST_TIMES) or 1
    return tuple(reversed(points[::-1][::every]))


def _disk(folder: Path, now_ns: int) -> DiskState:
    sizes = [path.stat().st_size for path in (folder / DATABASE_FILE, folder / f"{DATABASE_FILE}-wal") if path.exists()]
    backups = [path.stat().st_mtime_ns for path in (folder / BACKUP_FOLDER).glob("*.db")]
    return DiskState(
        free_mb=free_mb(folder),
        used_mb=round(sum(sizes) / 2**20, 2),
        num_backups=len(backups),
        last_backup_s=max(0.0, (now_ns - max(backups)) / 1e9) if backups else None,
    )
