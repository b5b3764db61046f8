"""The database's schema as numbered steps: step n leads from version n - 1 to n. Never edit a released step.

Every table is append-only by trigger: what changes is a new row. An id is a ULID; `*_ns` is the server's wall clock,
`*_mono_ns` its monotonic clock, comparable within one `boot_id`.
"""

APPLICATION_ID = 0x50565354
"""`PRAGMA application_id` of our databases: "PVST"."""

_VERSION_1 = """
CREATE TABLE study(
    study_version TEXT PRIMARY KEY,
    config TEXT NOT NULL CHECK(json_valid(config)),
    app_version TEXT NOT NULL,
    created_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE participant(
    code TEXT PRIMARY KEY,
    token_hash TEXT NOT NULL UNIQUE,
    created_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE slot(
    slot_id TEXT PRIMARY KEY,
    code TEXT NOT NULL REFERENCES participant(code),
    order_no INTEGER NOT NULL,
    task TEXT NOT NULL CHECK(task IN ('pan', 'pog')),
    split TEXT NOT NULL CHECK(split IN ('easy', 'medium', 'hard')),
    scene TEXT NOT NULL,
    episode_id TEXT NOT NULL,
    UNIQUE(code, order_no)
) STRICT;
CREATE TABLE trial(
    trial_id TEXT PRIMARY KEY,
    slot_id TEXT NOT NULL REFERENCES slot(slot_id),
    attempt INTEGER NOT NULL,
    opened_ns INTEGER NOT NULL,
    UNIQUE(slot_id, attempt)
) STRICT;
CREATE TABLE sitting(
    trial_id TEXT NOT NULL REFERENCES trial(trial_id),
    epoch INTEGER NOT NULL,
    opened_ns INTEGER NOT NULL,
    PRIMARY KEY(trial_id, epoch)
) STRICT, WITHOUT ROWID;
CREATE TABLE event(
    trial_id TEXT NOT NULL REFERENCES trial(trial_id),
    seq INTEGER NOT NULL CHECK(seq >= 1),
    epoch INTEGER NOT NULL,
    kind TEXT NOT NULL,
    t_srv_ns INTEGER NOT NULL,
    t_srv_mono_ns INTEGER NOT NULL,
    boot_id TEXT NOT NULL,
    payload TEXT NOT NULL CHECK(json_valid(payload)),
    prev_hash TEXT NOT NULL,
    hash TEXT NOT NULL,
    PRIMARY KEY(trial_id, seq)
) STRICT, WITHOUT ROWID;
CREATE TABLE outcome(
    trial_id TEXT PRIMARY KEY REFERENCES trial(trial_id),
    end_reason TEXT NOT NULL,
    payload TEXT NOT NULL CHECK(json_valid(payload)),
    head_hash TEXT NOT NULL,
    at_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE audit(
    seq INTEGER PRIMARY KEY,
    at_ns INTEGER NOT NULL,
    action TEXT NOT NULL,
    target TEXT NOT NULL
) STRICT;
CREATE TRIGGER event_after_outcome BEFORE INSERT ON event
WHEN EXISTS(SELECT 1 FROM outcome WHERE trial_id = NEW.trial_id)
BEGIN SELECT RAISE(ABORT, 'the trial has ended'); END;
""" + "".join(
    f"CREATE TRIGGER {table}_no_{verb.lower()} BEFORE {verb} ON {table}\n"
    f"BEGIN SELECT RAISE(ABORT, '{table} is append-only'); END;\n"
    for table in ("study", "participant", "slot", "trial", "sitting", "event", "outcome", "audit")
    for verb in ("UPDATE", "DELETE")
)

MIGRATIONS: tuple[str, ...] = (_VERSION_1,)
"""All steps; `PRAGMA user_version` of an up-to-date database is their number."""
