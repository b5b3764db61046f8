"""The progress of a running study: places of participants, finished and free trials. It never shows any results.

Outcomes stay hidden until the collection is over, so that nobody stops it at a convenient moment (HUMAN_STUDY.md,
section 8). Ages use the server's wall clock: people read them, no code decides by them.
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
"""Most points of the timeline."""


@dataclass(frozen=True, slots=True)
class SlotCount:
    """Counts of the planned trials of one split in one condition."""

    task: TaskKind
    condition: Condition
    split: Split
    num_done: int
    num_held: int
    """Trials that a participant holds and has not finished."""
    num_free: int
    """Trials that were given back and have no new holder."""
    num_failed: int
    """Trials that our failures ended twice, or that were left twice without another taker; nobody gets them again."""

    @property
    def num_all(self) -> int:
        """Number of all planned trials."""
        return self.num_done + self.num_held + self.num_free + self.num_failed


@dataclass(frozen=True, slots=True)
class TimePoint:
    """State of the collection at one time."""

    at_ns: int
    num_done: int
    """Counted trials that were over."""


@dataclass(frozen=True, slots=True)
class DiskState:
    """Disk space of the study, and its backups."""

    free_mb: int
    used_mb: float
    """Space used by the database and its log, MB."""
    num_backups: int
    last_backup_s: float | None
    """Seconds since the newest backup; None = there is none."""


@dataclass(frozen=True, slots=True)
class StudyProgress:
    """The progress of a study; holds no outcome of any trial."""

    study: str
    study_version: str
    is_pilot: bool
    now_ns: int
    num_done: int
    """Counted trials that are over."""
    num_all: int
    """Counted trials in the plan."""
    people: tuple[PersonProgress, ...]
    slots: tuple[SlotCount, ...]
    timeline: tuple[TimePoint, ...]
    """Points in time, oldest first; at most MOST_TIMES."""
    disk: DiskState

    def num_in(self, *states: State) -> int:
        """Number of participants in any of these states."""
        return sum(person.state in states for person in self.people)


def study_progress(reader: StudyReader, *, now_ns: int, stuck_after_s: float = STUCK_AFTER_S) -> StudyProgress:
    """The progress in a snapshot of the study.

    Args:
        reader: One snapshot.
        now_ns: The server's wall clock.
        stuck_after_s: A participant in a trial without stored events for this long is stuck.
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
    """One count for each task, condition and split in the plan."""
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
    """Counted trials over time, thinned out; the last point is always kept."""
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
