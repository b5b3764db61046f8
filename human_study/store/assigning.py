"""Assigns episodes while a study runs: finds due trials, takes back episodes, and gives these to other people.

All functions run inside one write transaction, so nobody else decides the same thing at the same time. The database
itself refuses a second live holder (trigger `one_holder`).
"""

import hashlib
import math
import sqlite3
import time
from collections import Counter

from sim.types import EpisodeKey, Split, TaskKind

from ..design.plan import PlannedTrial, Slot, StudyPlan
from ..design.secrets import new_id
from ..design.study import StudyConfig

_LIVE = "NOT EXISTS(SELECT 1 FROM release WHERE release.assignment_id = assignment.assignment_id)"
_SLOT = "task, condition, split, scene, episode_id, rep"
MOST_FAILURES = 2
"""Technical failures after which nobody gets an episode again: it is queued again once (HUMAN_STUDY.md, section 4)."""
_SPENT = (
    "((SELECT count(*) FROM assignment AS held JOIN trial ON trial.assignment_id = held.assignment_id"
    " JOIN outcome USING(trial_id) WHERE held.phase = 'main' AND end_reason = 'technical'"
    " AND held.task = assignment.task AND held.condition = assignment.condition AND held.split = assignment.split"
    " AND held.scene = assignment.scene AND held.episode_id = assignment.episode_id AND held.rep = assignment.rep)"
    f" >= {MOST_FAILURES})"
)
"""Whether the episode of a row of `assignment` failed too often, counted over all its holders."""


def assign(database: sqlite3.Connection, code: str, trial: PlannedTrial, *, made_by: str = "plan") -> None:
    """Gives a trial to a participant."""
    database.execute(
        "INSERT INTO assignment(assignment_id, code, order_no, task, split, scene, episode_id, phase, condition, rep,"
        " made_by, at_ns) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            new_id(),
            code,
            trial.order_no,
            trial.task,
            *trial.key,
            trial.phase,
            trial.condition,
            trial.rep,
            made_by,
            time.time_ns(),
        ),
    )


def due_order_no(database: sqlite3.Connection, code: str) -> int | None:
    """Place of the participant's first trial that is neither given back nor ended; None when there is none.

    A trial whose last attempt has no outcome is due, even after an earlier attempt that failed for technical reasons.
    """
    row = database.execute(
        f"SELECT min(order_no) FROM assignment WHERE code = ? AND {_LIVE} AND NOT EXISTS("
        " SELECT 1 FROM trial JOIN outcome USING(trial_id) WHERE trial.assignment_id = assignment.assignment_id"
        " AND attempt = (SELECT max(attempt) FROM trial AS other WHERE other.assignment_id = trial.assignment_id))",
        (code,),
    ).fetchone()
    return row[0]


def release(
    database: sqlite3.Connection, code: str, reason: str, *, also_done: bool = False, also_tried: bool = True
) -> int:
    """Gives back the participant's unfinished counted trials; returns their number.

    Args:
        also_done: Whether to give back trials with a result too. Trials that failed twice for technical reasons stay.
        also_tried: Whether to give back trials that wait for another attempt too.
    """
    ended = (
        "NOT EXISTS(SELECT 1 FROM trial JOIN outcome USING(trial_id)"
        " WHERE trial.assignment_id = assignment.assignment_id{newest})"
    )
    newest = (
        " AND attempt = (SELECT max(attempt) FROM trial AS other WHERE other.assignment_id = assignment.assignment_id)"
    )
    kept = f"NOT {_SPENT}" if also_done else ended.format(newest=newest if also_tried else "")
    return database.execute(
        f"INSERT INTO release SELECT assignment_id, ?, ? FROM assignment WHERE code = ? AND phase = 'main' AND {_LIVE}"
        f" AND {kept}",
        (reason, time.time_ns(), code),
    ).rowcount


def is_spent(database: sqlite3.Connection, assignment_id: str) -> bool:
    """Whether the episode failed twice for technical reasons, with any holders; then nobody gets it again."""
    row = database.execute(f"SELECT {_SPENT} FROM assignment WHERE assignment_id = ?", (assignment_id,)).fetchone()
    return bool(row[0])


def others_can_take(config: StudyConfig, plan: StudyPlan, task: TaskKind) -> bool:
    """Whether one person's trials can go to another; in a crossed design only to a spare person."""
    if config.design.kind == "house-once":
        return True
    people = (person for person in plan.participants if person.task == task)
    return any(all(trial.phase != "main" for trial in person.trials) for person in people)


def release_one(database: sqlite3.Connection, assignment_id: str, reason: str) -> None:
    """Gives back one trial, for good."""
    database.execute("INSERT OR IGNORE INTO release VALUES (?, ?, ?)", (assignment_id, reason, time.time_ns()))


def fill(database: sqlite3.Connection, config: StudyConfig, plan: StudyPlan, code: str) -> bool:
    """Gives the participant one episode that nobody holds (any more); False when there is none.

    The participant's own episodes in the plan come first, in its order; then one of the split of which the participant
    has the smallest share, and of these the one with the fewest other people; always in a home that the participant has
    never met (`house-once`), or at least an episode that the participant has not done.
    After each `checks.every` counted trials an attention trial is given too.
    """
    slot = free_slot(database, config, plan, code)
    if slot is None:
        return False
    last = database.execute("SELECT max(order_no) FROM assignment WHERE code = ?", (code,)).fetchone()[0]
    number = (last or 0) + 1
    assign(database, code, PlannedTrial.of(slot, order_no=number, phase="main"), made_by="fill")
    every, num_main = config.checks.every, _splits_held(database, code).total()
    if every is not None and num_main % every == 0:
        checks: list[tuple[EpisodeKey, TaskKind]] = [
            (trial.key, trial.task)
            for person in plan.participants
            for trial in person.trials
            if trial.phase == "check" and trial.task == slot.task
        ]
        if checks:
            key, task = checks[num_main // every % len(checks)]
            check = Slot(task, slot.condition, key, 0)
            assign(database, code, PlannedTrial.of(check, order_no=number + 1, phase="check"), made_by="fill")
    return True


def free_slot(database: sqlite3.Connection, config: StudyConfig, plan: StudyPlan, code: str) -> Slot | None:
    """The trial that `fill` would give; None when there is none, or the participant has done enough."""
    person = plan.participant(code)
    most = config.design.trials_per_person or max(
        sum(trial.phase == "main" for trial in known.trials) for known in plan.participants
    )
    held = _splits_held(database, code)
    if held.total() >= most:
        return None
    conditions = plan.conditions_of(config, person)
    met = _met(database, code)
    homes = {key.scene for key in met}
    rows = database.execute(
        f"SELECT {_SLOT} FROM assignment WHERE phase = 'main' AND task = ? GROUP BY {_SLOT} HAVING NOT max({_LIVE})",
        (person.task,),
    ).fetchall()
    slots = [Slot(task, condition, EpisodeKey(*key), rep) for task, condition, *key, rep in rows]
    allowed = [
        slot
        for slot in slots
        if slot.condition == conditions[slot.key.scene]
        and (slot.key.scene not in homes if config.design.kind == "house-once" else slot.key not in met)
    ]
    planned = {trial.slot: trial.order_no for trial in person.trials}
    of_task = [known for known in plan.participants if known.task == person.task]
    totals = Counter(trial.split for known in of_task for trial in known.trials if trial.phase == "main")

    def preference(slot: Slot) -> tuple[float, float, int, str]:
        """Sort key: own episodes in the plan's order, then the split that lacks most, then the rarest; others mixed."""
        mixed = hashlib.sha256(f"{code}/{slot}".encode()).hexdigest()
        split = slot.key.split
        return planned.get(slot, math.inf), held[split] / totals[split], _num_holders(database, slot), mixed

    return min(allowed, key=preference, default=None)


def _splits_held(database: sqlite3.Connection, code: str) -> Counter[Split]:
    """Number of counted trials of each split that the participant has or did."""
    rows = database.execute(
        f"SELECT split, count(*) FROM assignment WHERE code = ? AND phase = 'main' AND {_LIVE} GROUP BY split", (code,)
    )
    return Counter(dict(rows))


def _met(database: sqlite3.Connection, code: str) -> set[EpisodeKey]:
    """Counted episodes that the participant has now or has ever begun."""
    rows = database.execute(
        "SELECT split, scene, episode_id FROM assignment WHERE code = ? AND phase = 'main' AND"
        f" ({_LIVE} OR EXISTS(SELECT 1 FROM trial WHERE trial.assignment_id = assignment.assignment_id))",
        (code,),
    )
    return {EpisodeKey(*row) for row in rows}


def _num_holders(database: sqlite3.Connection, slot: Slot) -> int:
    """Number of people who have or did the episode in this condition."""
    return database.execute(
        "SELECT count(*) FROM assignment WHERE phase = 'main' AND task = ? AND condition = ? AND split = ?"
        f" AND scene = ? AND episode_id = ? AND {_LIVE}",
        (slot.task, slot.condition, *slot.key),
    ).fetchone()[0]
