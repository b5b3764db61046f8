"""Parts of the store's transactions about one trial: its last event, a new attempt, the end of a failed one."""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass

from sim.types import EndReason, EpisodeKey

from ..design.plan import StudyPlan
from ..design.secrets import new_id
from ..design.study import StudyConfig
from ..trial.events import Abandoned, Event, event_from_json, event_to_json
from ..trial.outcome import Outcome, has_begun, trial_end, unscored_outcome
from .assigning import is_spent, others_can_take, release_one
from .records import event_hash, first_hash
from .vault import Vault

_PRESENT_NS = """
SELECT sum(passed_ns) FROM (
    SELECT CASE WHEN kind <> 'reconnect' THEN
        t_srv_mono_ns - lag(t_srv_mono_ns) OVER (PARTITION BY boot_id ORDER BY seq)
    END AS passed_ns FROM event WHERE event.trial_id = trial.trial_id
)
"""
"""Time that a participant was in a trial, by the monotonic clock of each boot, without the time before each return."""


@dataclass(frozen=True, slots=True)
class Now:
    """The server's clocks."""

    wall_ns: int
    mono_ns: int
    boot_id: str


def code_of(database: sqlite3.Connection, trial_id: str) -> str:
    """The participant of an existing trial."""
    query = "SELECT code FROM trial JOIN assignment USING(assignment_id) WHERE trial_id = ?"
    return database.execute(query, (trial_id,)).fetchone()[0]


def new_trial(
    database: sqlite3.Connection, code: str, assignment_id: str, attempt: int, key: EpisodeKey, now_ns: int
) -> str:
    """Id of a new attempt, stored with the number and duration of the participant's earlier visits to this home."""
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
    """Seconds since the participant's last event; None without events. Reloading the page does not restart the count.

    Within one boot the monotonic clock is used; across boots only the wall clock is available.
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


def insert_events(
    database: sqlite3.Connection,
    vault: Vault,
    study_version: str,
    trial_id: str,
    *,
    epoch: int,
    events: Sequence[Event],
    now: Now,
) -> tuple[int, ...]:
    """Continues a trial's chain; returns the events' numbers in the trial."""
    code = code_of(database, trial_id)
    last_seq, head = last_event(database, trial_id)
    prev = head or first_hash(study_version, trial_id)
    rows = []
    for seq, event in enumerate(events, start=last_seq + 1):
        payload = vault.seal(code, event_to_json(event), where=f"{trial_id}/{seq}")
        row = (trial_id, seq, epoch, event.kind, now.wall_ns, now.mono_ns, now.boot_id, payload)
        digest = event_hash(prev, row)
        rows.append((*row, prev, digest))
        prev = digest
    database.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
    return tuple(row[1] for row in rows)


def insert_outcome(database: sqlite3.Connection, vault: Vault, trial_id: str, outcome: Outcome, *, now_ns: int) -> None:
    """Closes a trial that has events and no outcome."""
    _, head = last_event(database, trial_id)
    payload = vault.seal(code_of(database, trial_id), outcome.model_dump_json(), where=f"{trial_id}/outcome")
    database.execute("INSERT INTO outcome VALUES (?, ?, ?, ?, ?)", (trial_id, outcome.reason, payload, head, now_ns))


def abandon_running(
    database: sqlite3.Connection, vault: Vault, config: StudyConfig, plan: StudyPlan, code: str, *, now: Now
) -> int:
    """Ends the counted trial that a participant left for good as `abandoned`; returns the number of such trials.

    The end has no measures, because the store knows no targets. A trial that has its end and only waits for its outcome
    is not changed, and neither is one that was never begun.
    """
    rows = database.execute(
        "SELECT trial_id, max(epoch) FROM sitting JOIN trial USING(trial_id) JOIN assignment USING(assignment_id)"
        " WHERE code = ? AND phase = 'main' AND trial_id NOT IN (SELECT trial_id FROM outcome)"
        " AND assignment_id NOT IN (SELECT assignment_id FROM release) GROUP BY trial_id",
        (code,),
    ).fetchall()
    num_ended = 0
    for trial_id, epoch in rows:
        events = _events(database, vault, code, trial_id)
        if not has_begun(events) or trial_end(events) is not None:
            continue
        left = Abandoned(away_s=seconds_since_last_event(database, trial_id, now) or 0.0)
        insert_events(database, vault, config.study_version, trial_id, epoch=epoch, events=[left], now=now)
        task, *names = database.execute(
            "SELECT task, split, scene, episode_id FROM trial JOIN assignment USING(assignment_id) WHERE trial_id = ?",
            (trial_id,),
        ).fetchone()
        outcome = unscored_outcome(EpisodeKey(*names), task, reason="abandoned", participant=code)
        insert_outcome(database, vault, trial_id, outcome, now_ns=now.wall_ns)
        queue_again(database, trial_id, "abandoned", now.wall_ns, config=config, plan=plan)
        num_ended += 1
    return num_ended


def queue_again(
    database: sqlite3.Connection,
    trial_id: str,
    reason: EndReason,
    now_ns: int,
    *,
    config: StudyConfig,
    plan: StudyPlan,
) -> None:
    """Gives back the episode of a counted trial that ended without a result (HUMAN_STUDY.md, section 4).

    After a technical failure the episode is done once more: by the same person in a crossed design, by another person
    where nobody may meet a home twice. An abandoned episode goes to another person; if nobody else can take it, it goes
    to the same person, once.
    """
    assignment_id, phase, attempt, code, task, *names = database.execute(
        "SELECT assignment_id, phase, attempt, code, task, split, scene, episode_id FROM trial"
        " JOIN assignment USING(assignment_id) WHERE trial_id = ?",
        (trial_id,),
    ).fetchone()
    if phase != "main" or reason not in ("abandoned", "technical"):
        return
    if reason == "technical" and is_spent(database, assignment_id):
        return
    is_theirs_alone = not others_can_take(config, plan, task)
    if reason == "abandoned" and is_theirs_alone and _num_abandoned(database, assignment_id) > 1:
        return
    if is_theirs_alone or (reason == "technical" and config.design.kind == "crossed"):
        new_trial(database, code, assignment_id, attempt + 1, EpisodeKey(*names), now_ns)
    else:
        release_one(database, assignment_id, reason)


def _num_abandoned(database: sqlite3.Connection, assignment_id: str) -> int:
    return database.execute(
        "SELECT count(*) FROM outcome JOIN trial USING(trial_id) WHERE assignment_id = ? AND end_reason = 'abandoned'",
        (assignment_id,),
    ).fetchone()[0]


def _events(database: sqlite3.Connection, vault: Vault, code: str, trial_id: str) -> list[Event]:
    """All events of a trial, in order."""
    rows = database.execute("SELECT seq, payload FROM event WHERE trial_id = ? ORDER BY seq", (trial_id,))
    places = ((f"{trial_id}/{seq}", payload) for seq, payload in rows)
    return [event_from_json(vault.open(code, payload, where=place), where=place) for place, payload in places]
