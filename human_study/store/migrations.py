"""The database's schema as numbered steps; each brings a database to the next version. Never edit a released step.

Every table is append-only by trigger: a change is a new row. An id is a ULID; `*_ns` is the server's wall clock,
`*_mono_ns` its monotonic clock, comparable within one `boot_id`.
"""

APPLICATION_ID = 0x50565354
"""`PRAGMA application_id` of our databases: "PVST"."""
FIRST_VERSION = 2
"""`PRAGMA user_version` after the first step; version 1 was never released and is not read."""
_TABLES = ("study", "participant", "assignment", "trial", "sitting", "event", "outcome", "audit", "claim", "release")
_TABLES += ("stage", "consent", "verification", "exclusion", "exclusion_undone")


def _guards(*tables: str) -> str:
    """Triggers that make tables append-only."""
    return "".join(
        f"CREATE TRIGGER {table}_no_{verb.lower()} BEFORE {verb} ON {table}\n"
        f"BEGIN SELECT RAISE(ABORT, '{table} is append-only'); END;\n"
        for table in tables
        for verb in ("UPDATE", "DELETE")
    )


_SCHEMA = """
CREATE TABLE study(
    study_version TEXT PRIMARY KEY,
    config TEXT NOT NULL CHECK(json_valid(config)),
    app_version TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    plan TEXT NOT NULL CHECK(json_valid(plan))
) STRICT;
CREATE TABLE participant(
    code TEXT PRIMARY KEY,
    token_hash TEXT NOT NULL UNIQUE,
    created_ns INTEGER NOT NULL,
    task TEXT NOT NULL CHECK(task IN ('pan', 'pog')),
    arm INTEGER NOT NULL
) STRICT;
CREATE TABLE assignment(
    assignment_id TEXT PRIMARY KEY,
    code TEXT NOT NULL REFERENCES participant(code),
    order_no INTEGER NOT NULL,
    task TEXT NOT NULL CHECK(task IN ('pan', 'pog')),
    split TEXT NOT NULL CHECK(split IN ('easy', 'medium', 'hard')),
    scene TEXT NOT NULL,
    episode_id TEXT NOT NULL,
    phase TEXT NOT NULL CHECK(phase IN ('practice', 'check', 'main')),
    condition TEXT NOT NULL,
    rep INTEGER NOT NULL,
    made_by TEXT NOT NULL CHECK(made_by IN ('plan', 'fill')),
    at_ns INTEGER NOT NULL,
    UNIQUE(code, order_no)
) STRICT;
CREATE TABLE trial(
    trial_id TEXT PRIMARY KEY,
    assignment_id TEXT NOT NULL REFERENCES assignment(assignment_id),
    attempt INTEGER NOT NULL,
    opened_ns INTEGER NOT NULL,
    prior_visits_scene INTEGER,
    prior_visits_split INTEGER,
    secs_in_scene_before REAL,
    UNIQUE(assignment_id, attempt)
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
CREATE INDEX assignment_of_slot ON assignment(task, condition, split, scene, episode_id, rep);
CREATE INDEX trial_of_assignment ON trial(assignment_id);
CREATE TABLE claim(
    code TEXT PRIMARY KEY REFERENCES participant(code),
    ext_hash TEXT UNIQUE,
    at_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE release(
    assignment_id TEXT PRIMARY KEY REFERENCES assignment(assignment_id),
    reason TEXT NOT NULL,
    at_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE stage(
    seq INTEGER PRIMARY KEY,
    code TEXT NOT NULL REFERENCES participant(code),
    stage TEXT NOT NULL,
    detail TEXT NOT NULL CHECK(json_valid(detail)),
    at_ns INTEGER NOT NULL
) STRICT;
CREATE INDEX stage_of_code ON stage(code);
CREATE TABLE consent(
    seq INTEGER PRIMARY KEY,
    code TEXT NOT NULL REFERENCES participant(code),
    text_hash TEXT NOT NULL,
    given INTEGER NOT NULL CHECK(given IN (0, 1)),
    at_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE verification(
    trial_id TEXT NOT NULL REFERENCES trial(trial_id),
    run_id TEXT NOT NULL,
    status TEXT NOT NULL CHECK(status IN ('verified', 'drift', 'failed', 'unsupported')),
    max_position_error REAL NOT NULL,
    first_bad_step INTEGER,
    detail TEXT NOT NULL,
    sim_hash TEXT NOT NULL,
    at_ns INTEGER NOT NULL,
    PRIMARY KEY(trial_id, run_id)
) STRICT, WITHOUT ROWID;
CREATE TABLE exclusion(
    exclusion_id TEXT PRIMARY KEY,
    target_kind TEXT NOT NULL CHECK(target_kind IN ('trial', 'participant')),
    target TEXT NOT NULL,
    rule_id TEXT NOT NULL,
    reason TEXT NOT NULL,
    at_ns INTEGER NOT NULL
) STRICT;
CREATE TABLE exclusion_undone(
    exclusion_id TEXT PRIMARY KEY REFERENCES exclusion(exclusion_id),
    at_ns INTEGER NOT NULL
) STRICT;
CREATE TRIGGER one_holder BEFORE INSERT ON assignment
WHEN NEW.phase = 'main' AND EXISTS(
    SELECT 1 FROM assignment AS held
    WHERE held.phase = 'main' AND held.task = NEW.task AND held.condition = NEW.condition AND held.split = NEW.split
      AND held.scene = NEW.scene AND held.episode_id = NEW.episode_id AND held.rep = NEW.rep
      AND NOT EXISTS(SELECT 1 FROM release WHERE release.assignment_id = held.assignment_id)
)
BEGIN SELECT RAISE(ABORT, 'somebody has this episode'); END;
CREATE TRIGGER no_trial_before_consent BEFORE INSERT ON trial
WHEN EXISTS(
    SELECT 1 FROM consent JOIN assignment USING(code)
    WHERE assignment.assignment_id = NEW.assignment_id AND consent.given = 0
      AND consent.seq = (SELECT max(seq) FROM consent AS latest WHERE latest.code = consent.code)
)
BEGIN SELECT RAISE(ABORT, 'the participant did not consent'); END;
CREATE TRIGGER event_after_outcome BEFORE INSERT ON event
WHEN EXISTS(SELECT 1 FROM outcome WHERE trial_id = NEW.trial_id)
BEGIN SELECT RAISE(ABORT, 'the trial has ended'); END;
""" + _guards(*_TABLES)

_PERSONAL_ANSWERS = """
CREATE TABLE personal_answer(
    seq INTEGER PRIMARY KEY,
    code TEXT NOT NULL REFERENCES participant(code),
    kind TEXT NOT NULL,
    payload TEXT NOT NULL CHECK(json_valid(payload)),
    at_ns INTEGER NOT NULL
) STRICT;
CREATE INDEX personal_answer_of_code ON personal_answer(code);
""" + _guards("personal_answer")

MIGRATIONS: tuple[str, ...] = (_SCHEMA, _PERSONAL_ANSWERS)
"""All steps, the first one from an empty database."""
SCHEMA_VERSION = FIRST_VERSION + len(MIGRATIONS) - 1
"""`PRAGMA user_version` of an up-to-date database."""
