-- A study's database as version 1 of the schema wrote it: one participant, one finished trial.
BEGIN TRANSACTION;
CREATE TABLE audit(
    seq INTEGER PRIMARY KEY,
    at_ns INTEGER NOT NULL,
    action TEXT NOT NULL,
    target TEXT NOT NULL
) STRICT;
INSERT INTO "audit" VALUES(1,1795192633105038767,'migrate','schema version 1');
INSERT INTO "audit" VALUES(2,1795192633117475061,'add participant','p02');
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
INSERT INTO "event" VALUES('01M7WX3DS1XGF6EB198H241YT9',1,1,'open',1795192633125093599,2473728174820,'6c3087ce-821e-43eb-a8d8-c2df7c3bfef4','{"t_s":null,"t_cli_ms":null,"kind":"open","task":"pan","split":"easy","scene":"room","episode_id":"0","scene_digest":"dddddddddddddddddddddddddddddddddddddddddddddddddddddddddddddddd","max_steps":500,"actions":["stop"],"position":[0.0,0.0,0.0],"yaw":0.0}','a320fbedfe8e6eda9e86c289e0a32cba1e1666adef03722bb708d7f1a65ad107','03d6f87babaf6095adbe8f0f6f2f27ddcdb67f52f90cf6870c13ddc3075c349b');
INSERT INTO "event" VALUES('01M7WX3DS1XGF6EB198H241YT9',2,1,'key',1795192633129087265,2473732168126,'6c3087ce-821e-43eb-a8d8-c2df7c3bfef4','{"t_s":null,"t_cli_ms":null,"kind":"key","code":"KeyW","action":"forward","repeat":false}','03d6f87babaf6095adbe8f0f6f2f27ddcdb67f52f90cf6870c13ddc3075c349b','71e93f85bc8962a7f16a88b9369f154a9a7b839bad24cdcd8c9cf7a50878d03d');
INSERT INTO "event" VALUES('01M7WX3DS1XGF6EB198H241YT9',3,1,'giveup',1795192633129087265,2473732168126,'6c3087ce-821e-43eb-a8d8-c2df7c3bfef4','{"t_s":2.0,"t_cli_ms":null,"kind":"giveup"}','71e93f85bc8962a7f16a88b9369f154a9a7b839bad24cdcd8c9cf7a50878d03d','85ffd8640ea55db55ed3da504d9d0ff9f1c661a911314e69f8deed0410582253');
CREATE TABLE outcome(
    trial_id TEXT PRIMARY KEY REFERENCES trial(trial_id),
    end_reason TEXT NOT NULL,
    payload TEXT NOT NULL CHECK(json_valid(payload)),
    head_hash TEXT NOT NULL,
    at_ns INTEGER NOT NULL
) STRICT;
INSERT INTO "outcome" VALUES('01M7WX3DS1XGF6EB198H241YT9','giveup','{"kind":"end","reason":"giveup","measures":null}','85ffd8640ea55db55ed3da504d9d0ff9f1c661a911314e69f8deed0410582253',1795192633133128252);
CREATE TABLE participant(
    code TEXT PRIMARY KEY,
    token_hash TEXT NOT NULL UNIQUE,
    created_ns INTEGER NOT NULL
) STRICT;
INSERT INTO "participant" VALUES('p02','37602b1b603690ab4d14d35a9e42c11ec8b261b0676693810617db9e32ce00aa',1795192633117185549);
CREATE TABLE sitting(
    trial_id TEXT NOT NULL REFERENCES trial(trial_id),
    epoch INTEGER NOT NULL,
    opened_ns INTEGER NOT NULL,
    PRIMARY KEY(trial_id, epoch)
) STRICT, WITHOUT ROWID;
INSERT INTO "sitting" VALUES('01M7WX3DS1XGF6EB198H241YT9',1,1795192633121078701);
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
INSERT INTO "slot" VALUES('01M7WX3DRXXTEKNNZJ18S22RFY','p02',1,'pan','easy','room','0');
INSERT INTO "slot" VALUES('01M7WX3DRX00B0YBZ3RPYMWB19','p02',2,'pan','easy','room','1');
CREATE TABLE study(
    study_version TEXT PRIMARY KEY,
    config TEXT NOT NULL CHECK(json_valid(config)),
    app_version TEXT NOT NULL,
    created_ns INTEGER NOT NULL
) STRICT;
INSERT INTO "study" VALUES('728ec81f65df7527a194c9bdd71c687d69bd2947c5a1cee572c3a76de271c279','{"schema_version":1,"study":"pilot","dataset_digest":"0000000000000000000000000000000000000000000000000000000000000000","scenes":[{"name":"room","kind":"invented"}],"tasks":["pan","pog"],"actions":"paper4","max_steps":500,"query_index":0,"resume_within_s":600.0,"seed":0,"camera":{"width":640,"height":480,"hfov_deg":79.0,"mount_height":0.88}}','0.1.0',1795192633110706681);
CREATE TABLE trial(
    trial_id TEXT PRIMARY KEY,
    slot_id TEXT NOT NULL REFERENCES slot(slot_id),
    attempt INTEGER NOT NULL,
    opened_ns INTEGER NOT NULL,
    UNIQUE(slot_id, attempt)
) STRICT;
INSERT INTO "trial" VALUES('01M7WX3DS1XGF6EB198H241YT9','01M7WX3DRXXTEKNNZJ18S22RFY',1,1795192633121078701);
CREATE TRIGGER event_after_outcome BEFORE INSERT ON event
WHEN EXISTS(SELECT 1 FROM outcome WHERE trial_id = NEW.trial_id)
BEGIN SELECT RAISE(ABORT, 'the trial has ended'); END;
CREATE TRIGGER study_no_update BEFORE UPDATE ON study
BEGIN SELECT RAISE(ABORT, 'study is append-only'); END;
CREATE TRIGGER study_no_delete BEFORE DELETE ON study
BEGIN SELECT RAISE(ABORT, 'study is append-only'); END;
CREATE TRIGGER participant_no_update BEFORE UPDATE ON participant
BEGIN SELECT RAISE(ABORT, 'participant is append-only'); END;
CREATE TRIGGER participant_no_delete BEFORE DELETE ON participant
BEGIN SELECT RAISE(ABORT, 'participant is append-only'); END;
CREATE TRIGGER slot_no_update BEFORE UPDATE ON slot
BEGIN SELECT RAISE(ABORT, 'slot is append-only'); END;
CREATE TRIGGER slot_no_delete BEFORE DELETE ON slot
BEGIN SELECT RAISE(ABORT, 'slot is append-only'); END;
CREATE TRIGGER trial_no_update BEFORE UPDATE ON trial
BEGIN SELECT RAISE(ABORT, 'trial is append-only'); END;
CREATE TRIGGER trial_no_delete BEFORE DELETE ON trial
BEGIN SELECT RAISE(ABORT, 'trial is append-only'); END;
CREATE TRIGGER sitting_no_update BEFORE UPDATE ON sitting
BEGIN SELECT RAISE(ABORT, 'sitting is append-only'); END;
CREATE TRIGGER sitting_no_delete BEFORE DELETE ON sitting
BEGIN SELECT RAISE(ABORT, 'sitting is append-only'); END;
CREATE TRIGGER event_no_update BEFORE UPDATE ON event
BEGIN SELECT RAISE(ABORT, 'event is append-only'); END;
CREATE TRIGGER event_no_delete BEFORE DELETE ON event
BEGIN SELECT RAISE(ABORT, 'event is append-only'); END;
CREATE TRIGGER outcome_no_update BEFORE UPDATE ON outcome
BEGIN SELECT RAISE(ABORT, 'outcome is append-only'); END;
CREATE TRIGGER outcome_no_delete BEFORE DELETE ON outcome
BEGIN SELECT RAISE(ABORT, 'outcome is append-only'); END;
CREATE TRIGGER audit_no_update BEFORE UPDATE ON audit
BEGIN SELECT RAISE(ABORT, 'audit is append-only'); END;
CREATE TRIGGER audit_no_delete BEFORE DELETE ON audit
BEGIN SELECT RAISE(ABORT, 'audit is append-only'); END;
PRAGMA application_id = 0x50565354;
PRAGMA user_version = 1;
COMMIT;
