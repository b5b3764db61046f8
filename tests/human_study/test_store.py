"""The study's store: what it promises, and what it says when it cannot keep a promise."""

import multiprocessing
import os
import resource
import sqlite3
import threading
from pathlib import Path

import pytest

from human_study.design.secrets import new_token, token_hash
from human_study.store.database import require_keys
from human_study.store.records import VerificationEntry, read_study
from human_study.store.store import SupersededError, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.trial.events import Act, Error, Event, Reconnect
from sim.errors import StudyError
from sim.tasks.run_files import EpisodeEnd
from sim.types import Action

from .small_world import plan, study
from .stores import KEY, OPEN, checked, edit, filled, open_small, opened, trials_of


def test_stored_events_come_back_as_they_were(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        act = Act(action=Action.FORWARD, position=(0.1, -1 / 3, 1e-17), yaw=0.1 + 0.2, collided=True, t_s=1.5)
        assert store.append_many(trial.trial_id, trial.epoch, [KEY, act]) == (2, 3)
        stored = store.events(trial.trial_id)
    assert [event.event for event in stored] == [OPEN, KEY, act]
    assert [event.seq for event in stored] == [1, 2, 3]
    assert {event.epoch for event in stored} == {1}
    assert stored[0].t_srv_ns <= stored[1].t_srv_ns == stored[2].t_srv_ns
    assert stored[0].t_srv_mono_ns <= stored[1].t_srv_mono_ns


def test_a_participants_trials_are_in_the_plans_order(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        trials = trials_of(store, "p01")
        assert [trial.key for trial in trials] == [trial.key for trial in plan(study()).participants[0].trials]
        assert [trial.order_no for trial in trials] == [1, 2, 3]
        assert {(trial.task, trial.trial_id, trial.outcome) for trial in trials} == {("pog", None, None)}


def test_a_token_finds_its_owner_and_is_not_in_any_file(tmp_path: Path) -> None:
    token = new_token()
    with open_small(tmp_path) as store:
        store.add_participant(plan(study()).participants[0], token_hash(token))
        assert store.code_of_token(token) == "p01"
        assert store.code_of_token(token[:-1]) is None
    for path in tmp_path.rglob("*"):
        assert token.encode() not in path.read_bytes()


def test_opening_a_trial_again_hands_it_to_the_newest_tab(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, first):
        second = store.open_trial("p02", 1)
        assert (second.trial_id, first.epoch, second.epoch) == (first.trial_id, 1, 2)
        with pytest.raises(SupersededError, match="epoch is 1; expected 2, the newest tab"):
            store.append(first.trial_id, first.epoch, KEY)
        assert store.append(second.trial_id, second.epoch, KEY) == 3
        kinds = [stored.event.kind for stored in store.events(first.trial_id)]
    assert kinds == ["open", "reconnect", "key"]


def test_a_trial_taken_over_before_its_first_event_still_begins_with_open(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        store.open_trial("p02", 1)
        second = store.open_trial("p02", 1)
        assert store.events(second.trial_id) == ()
        assert second.away_s == 0


def test_reloading_does_not_hide_how_long_the_participant_was_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(tmp_path) as (store, _):
        start_ns = store.events(trials_of(store, "p02")[0].trial_id or "")[0].t_srv_mono_ns
        monkeypatch.setattr("time.monotonic_ns", lambda: start_ns + 700 * 10**9)
        monkeypatch.setattr("time.time_ns", lambda: 0)
        first = store.open_trial("p02", 1)
        monkeypatch.setattr("time.monotonic_ns", lambda: start_ns + 701 * 10**9)
        second = store.open_trial("p02", 1)
        last = store.events(first.trial_id)[-1].event
    assert (first.away_s, second.away_s) == (700.0, 701.0)
    assert last == Reconnect(epoch=3, away_s=701.0)


def test_the_first_outcome_stays_and_nothing_comes_after_it(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        assert store.finish_trial(trial.trial_id, EpisodeEnd(reason="stop")).reason == "stop"
        assert store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup")).reason == "stop"
        assert trials_of(store, "p02")[0].outcome == EpisodeEnd(reason="stop")
        with pytest.raises(TrialEndedError, match=r"has ended \(stop\)"):
            store.append(trial.trial_id, trial.epoch, KEY)
        with pytest.raises(TrialEndedError):
            store.open_trial("p02", 1)


def test_a_write_that_the_store_cannot_take_is_named(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        trial = store.open_trial("p02", 1)
        with pytest.raises(StudyError, match="has no events"):
            store.finish_trial(trial.trial_id, EpisodeEnd(reason="stop"))
        with pytest.raises(StudyError, match="found no trial 'T1'"):
            store.append("T1", 1, KEY)
        with pytest.raises(StudyError, match="'p02' has no trial 9"):
            store.open_trial("p02", 9)
        with pytest.raises(StudyError, match="found no participant 'p77'"):
            trials_of(store, "p77")
        with pytest.raises(StudyError, match="'p01' is registered already"):
            store.add_participant(store.plan.participants[0], token_hash("other"))


TABLES = ("study", "participant", "assignment", "release", "claim", "trial", "sitting", "event", "outcome", "stage")
TABLES += ("consent", "verification", "exclusion", "exclusion_undone", "audit", "personal_answer")


def test_no_row_can_be_changed_or_deleted(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.finish_trial(trial.trial_id, EpisodeEnd(reason="stop"))
        assert store.claim_person(None) == "p01"
        store.give_consent("p02", "text", given=True)
        store.undo_exclusion(store.exclude("trial", trial.trial_id, rule_id="r1", reason="because"))
        store.add_verification(VerificationEntry(trial.trial_id, "v1", "verified", 0.0, None, "", "s" * 64, 1))
        store.drop_out("p02", "away")
        store.keep_answer("p02", "survey", "{}")
    database = sqlite3.connect(tmp_path / "study.db")
    for table in TABLES:
        assert database.execute(f"SELECT count(*) FROM {table}").fetchone()[0], table
        column = database.execute(f"SELECT name FROM pragma_table_info('{table}') LIMIT 1").fetchone()[0]
        for sql in (f"UPDATE {table} SET {column} = {column}", f"DELETE FROM {table}"):
            with pytest.raises(sqlite3.IntegrityError, match=f"{table} is append-only"):
                database.execute(sql)
    database.close()


def test_an_event_after_the_outcome_is_refused_by_the_database_itself(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.finish_trial(trial.trial_id, EpisodeEnd(reason="stop"))
    database = sqlite3.connect(tmp_path / "study.db")
    with pytest.raises(sqlite3.IntegrityError, match="the trial has ended"):
        database.execute(f"INSERT INTO event VALUES ('{trial.trial_id}', 2, 1, 'key', 0, 0, '', '{{}}', '', '')")
    database.close()


def test_writes_of_many_threads_get_numbers_without_gaps(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        numbers: list[int] = []

        def write() -> None:
            for _ in range(25):
                numbers.append(store.append(trial.trial_id, trial.epoch, KEY))

        threads = [threading.Thread(target=write) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(numbers) == list(range(2, 202))
        assert checked(store) == 201


def _hold(folder: Path, ready: object, release: object) -> None:
    with open_small(folder):
        ready.set()
        release.wait(20)


def test_a_second_process_is_refused_and_told_who_holds_the_study(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    ready, release = context.Event(), context.Event()
    holder = context.Process(target=_hold, args=(tmp_path, ready, release))
    holder.start()
    try:
        assert ready.wait(20)
        with pytest.raises(StudyError, match=f"is in use by process {holder.pid}; expected") as caught:
            open_small(tmp_path)
        assert "\n" not in str(caught.value)
    finally:
        release.set()
        holder.join(60)
    open_small(tmp_path).close()


def _fill_up(folder: Path, results: object) -> None:
    """Writes until the operating system refuses larger files, then allows them again and writes once more."""
    with opened(folder) as (store, trial):
        size = (folder / "study.db-wal").stat().st_size
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 30_000, resource.RLIM_INFINITY))
        acknowledged = 1
        try:
            while acknowledged < 5000:
                acknowledged = store.append_many(trial.trial_id, trial.epoch, [KEY] * 20)[-1]
        except StoreFullError:
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        after = store.append(trial.trial_id, trial.epoch, KEY)
    results.put((acknowledged, after))


def test_a_file_that_the_system_lets_grow_no_further_loses_nothing_acknowledged(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    results = context.SimpleQueue()
    writer = context.Process(target=_fill_up, args=(tmp_path, results))
    writer.start()
    writer.join(60)
    assert writer.exitcode == 0
    acknowledged, after = results.get()
    assert acknowledged < 5000
    assert after == acknowledged + 1
    with read_study(tmp_path) as reader:
        assert reader.check() == after


def test_a_closed_store_says_so(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.close()
    with pytest.raises(StudyError, match="found a store that is closed"):
        store.append(trial.trial_id, trial.epoch, KEY)


def test_an_unwritable_place_and_a_folder_without_a_study_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="expected a folder that you can write"):
        open_small(tmp_path / "file" / "study")
    with pytest.raises(StudyError, match="personal-viz study serve first"), read_study(tmp_path):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_one_line(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(StudyError, match="expected a folder that you can write"):
        open_small(tmp_path)


def test_the_settings_are_those_of_the_design(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        values = {
            name: store._database.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout", "cell_size_check")
        }
    expected = {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 5000, "cell_size_check": 1}
    assert values == expected


def test_two_trials_in_one_place_of_the_order_are_refused(tmp_path: Path) -> None:
    person = plan(study()).participants[1]
    twice = person.model_copy(update={"trials": (person.trials[0], person.trials[0])})
    with open_small(tmp_path) as store:
        with pytest.raises(StudyError, match="an order without repeats"):
            store.add_participant(twice, token_hash("t"))
        with read_study(tmp_path) as reader:
            assert reader.codes() == ()


def test_a_snapshot_does_not_change_while_the_study_goes_on(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial), read_study(tmp_path) as reader:
        before: list[Event] = [stored.event for stored in reader.events(trial.trial_id)]
        store.append(trial.trial_id, trial.epoch, KEY)
        assert [stored.event for stored in reader.events(trial.trial_id)] == before == [OPEN]


def test_an_error_of_the_connection_is_kept_with_the_running_trial_only(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.note_error("p02", "sent text")
        store.note_error("p01", "nobody is here")
        assert [stored.event for stored in store.events(trial.trial_id)][1:] == [
            Error(message="sent text", is_fatal=False)
        ]
        store.finish_trial(trial.trial_id, EpisodeEnd(reason="stop"))
        store.note_error("p02", "too late")
        assert checked(store) == 2


def test_personal_answers_are_encrypted_and_the_newest_counts(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        store.keep_answer("p01", "survey", "I am 44")
        store.keep_answer("p01", "survey", "I am 45")
        store.keep_answer("p02", "comment", "Fine, thanks")
        with read_study(tmp_path) as reader:
            assert reader.answers("survey") == {"p01": "I am 45"}
            assert reader.answers("comment") == {"p02": "Fine, thanks"}
            require_keys(reader)
            (stored,) = reader.rows("SELECT group_concat(payload) FROM personal_answer")
        assert "I am" not in stored[0]
        assert "Fine" not in stored[0]


def test_personal_answers_go_with_a_withdrawal(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        store.keep_answer("p01", "survey", "I am 44")
        store.withdraw("p01")
        with read_study(tmp_path) as reader:
            assert reader.answers("survey") == {}
        with pytest.raises(StudyError, match="has no key of participant p01"):
            store.keep_answer("p01", "survey", "once more")


def test_a_personal_answer_of_another_person_or_of_any_length_is_refused(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        store.keep_answer("p01", "survey", "I am 44")
        with pytest.raises(StudyError, match="found no participant 'p77'"):
            store.keep_answer("p77", "survey", "hello")
        with pytest.raises(StudyError, match=r"survey has 2001 characters; expected 2000"):
            store.keep_answer("p01", "survey", "x" * 2001)
    edit(tmp_path, "UPDATE personal_answer SET code = 'p02'")
    with read_study(tmp_path) as reader, pytest.raises(StudyError, match="cannot be decrypted"):
        reader.answers("survey")
