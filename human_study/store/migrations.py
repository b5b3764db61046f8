"""The database's schema as numbered steps: step n leads from version n - 1 to n. Never edit a released step.

Every table is append-only by trigger: a change is a new row. An id is a ULID; `*_ns` is the server's wall clock,
`*_mono_ns` its monotonic clock, comparable within one `boot_id`.
"""

APPLICATION_ID = 0x50565354
"""`PRAGMA application_id` of our databases: "PVST"."""


def _guards(*tables: str) -> str:
    """Triggers that make tables append-only."""
    return "".join(
        f"CREATE TRIGGER {table}_no_{verb.lower()} BEFORE {verb} ON {table}\n"
        f"BEGIN SELECT RAISE(ABORT, '{table} is append-only'); END;\n"
        for table in tables
        for verb in ("UPDATE", "DELETE")
    )


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
""" + _guards("study", "participant", "slot", "trial", "sitting", "event", "outcome", "audit")
_GUARDED_LATER = ("release", "stage", "consent", "verification", "exclusion", "exclusion_undone")
_VERSION_2 = """
DROP TRIGGER slot_no_update;
DROP TRIGGER slot_no_delete;
DROP TRIGGER study_no_update;
DROP TRIGGER study_no_delete;
DROP TRIGGER participant_no_update;
DROP TRIGGER participant_no_delete;
ALTER TABLE study ADD COLUMN plan TEXT NOT NULL DEFAULT '' CHECK(plan = '' OR json_valid(plan));
UPDATE study SET
    plan = json_object(
        'schema_version', 2,
        'study_version', study_version,
        'scenes', json(json_extract(config, '$.scenes')),
        'participants', json('[{"code": "p01", "task": "pog", "trials": []},'
            || ' {"code": "p02", "task": "pan", "trials": []}]')
    ),
    config = json_object(
        'study', json_extract(config, '$.study'),
        'version', 1,
        'dataset', json_object(
            'sha256', json_extract(config, '$.dataset_digest'), 'seed', coalesce(json_extract(config, '$.seed'), 0)
        ),
        'task', json(coalesce(json_extract(config, '$.tasks'), '["pan", "pog"]')),
        'actions', coalesce(json_extract(config, '$.actions'), 'paper4'),
        'steps', coalesce(json_extract(config, '$.max_steps'), 500),
        'query_index', coalesce(json_extract(config, '$.query_index'), 0),
        'design', json('{"kind": "crossed", "raters_per_episode": 1}'),
        'pog', json('{"conditions": ["map_open"]}'),
        'flow', json('["instructions"]'),
        'resume_within_s', coalesce(json_extract(config, '$.resume_within_s'), 600.0),
        'camera', json(coalesce(json_extract(config, '$.camera'), '{}'))
    );
ALTER TABLE participant ADD COLUMN task TEXT NOT NULL DEFAULT 'pan' CHECK(task IN ('pan', 'pog'));
ALTER TABLE participant ADD COLUMN arm INTEGER NOT NULL DEFAULT 0;
UPDATE participant SET task = coalesce((SELECT task FROM slot WHERE slot.code = participant.code LIMIT 1), 'pan');
ALTER TABLE slot RENAME TO assignment;
ALTER TABLE assignment RENAME COLUMN slot_id TO assignment_id;
ALTER TABLE assignment ADD COLUMN phase TEXT NOT NULL DEFAULT 'main' CHECK(phase IN ('practice', 'check', 'main'));
ALTER TABLE assignment ADD COLUMN condition TEXT NOT NULL DEFAULT 'none';
ALTER TABLE assignment ADD COLUMN rep INTEGER NOT NULL DEFAULT 1;
ALTER TABLE assignment ADD COLUMN made_by TEXT NOT NULL DEFAULT 'plan' CHECK(made_by IN ('plan', 'fill'));
ALTER TABLE assignment ADD COLUMN at_ns INTEGER NOT NULL DEFAULT 0;
UPDATE assignment SET condition = 'map_open' WHERE task = 'pog';
ALTER TABLE trial RENAME COLUMN slot_id TO assignment_id;
ALTER TABLE trial ADD COLUMN prior_visits_scene INTEGER;
ALTER TABLE trial ADD COLUMN prior_visits_split INTEGER;
ALTER TABLE trial ADD COLUMN secs_in_scene_before REAL;
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
""" + _guards("study", "participant", "assignment", "claim", *_GUARDED_LATER)

MIGRATIONS: tuple[str, ...] = (_VERSION_1, _VERSION_2)
"""All steps; `PRAGMA user_version` of an up-to-date database is their number."""
