"""Pieces of the store's transactions about one trial: its last event, a new attempt, what follows a failed one."""

import sqlite3
from dataclasses import dataclass

from sim.types import EndReason, EpisodeKey

from .assigning import release_one
from .tickets import new_id

_PRESENT_NS = """
SELECT sum(passed_ns) FROM (
    SELECT CASE WHEN kind <> 'reconnect' THEN
        t_srv_mono_ns - lag(t_srv_mono_ns) OVER (PARTITION BY boot_id ORDER BY seq)
    END AS passed_ns FROM event WHERE event.trial_id = trial.trial_id
)
"""
"""How long somebody was in a trial: by the steady clock of each boot, without what passed before each return."""


@dataclass(frozen=True, slots=True)
class Now:
    """The server's clocks."""

    wall_ns: int
    mono_ns: int
    boot_id: str


def code_of(database: sqlite3.Connection, trial_id: str) -> str:
    """The participant of a trial that exists."""
    query = "SELECT code FROM trial JOIN assignment USING(assignment_id) WHERE trial_id = ?"
    return database.execute(query, (trial_id,)).fetchone()[0]


def new_trial(
    database: sqlite3.Connection, code: str, assignment_id: str, attempt: int, key: EpisodeKey, now_ns: int
) -> str:
    """Id of a new attempt, stored with how often and how long the participant was in this home before."""
    visits = database.execute(
        f"SELECT split, ({_PRESENT_NS}) FROM trial JOIN assignment USING(assignment_id) WHERE code = ? AND scene = ?",
        (code, key.scene),
    ).fetchall()
    trial_id = new_id()
    database.execute(
        "INSERT INTO trial VALUES (?, ?, ?, ?, ?, ?, ?)",
        (
            trial_id,
            assignment_id,
            attempt,
            now_ns,
            len(visits),
            sum(split == key.split for split, _ in visits),
            sum(passed_ns or 0 for _, passed_ns in visits) / 1e9,
        ),
    )
    return trial_id


def last_event(database: sqlite3.Connection, trial_id: str) -> tuple[int, str | None]:
    """(seq, hash) of a trial's last event; (0, None) without events."""
    row = database.execute(
        "SELECT seq, hash FROM event WHERE trial_id = ? ORDER BY seq DESC LIMIT 1", (trial_id,)
    ).fetchone()
    return row or (0, None)


def seconds_since_last_event(database: sqlite3.Connection, trial_id: str, now: Now) -> float | None:
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


def queue_again(
    database: sqlite3.Connection, trial_id: str, reason: EndReason, now_ns: int, *, is_crossed: bool
) -> None:
    """What becomes of the episode of a counted trial that ended without a result (HUMAN_STUDY.md, section 4).

    Abandoned: somebody else gets it. Failed for technical reasons: once more, by the same person in a crossed
    design, by somebody else where nobody may meet a home twice.
    """
    assignment_id, phase, attempt, code, *names = database.execute(
        "SELECT assignment_id, phase, attempt, code, split, scene, episode_id FROM trial"
        " JOIN assignment USING(assignment_id) WHERE trial_id = ?",
        (trial_id,),
    ).fetchone()
    if phase != "main" or reason not in ("abandoned", "technical"):
        return
    if reason == "technical" and is_crossed:
        if attempt == 1:
            new_trial(database, code, assignment_id, 2, EpisodeKey(*names), now_ns)
        return
    release_one(database, assignment_id, reason)
