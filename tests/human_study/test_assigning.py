"""Who gets which episode while a study runs: leases, drop-outs, refills and their order, open links, withdrawal."""

import json
import threading
from collections import Counter
from pathlib import Path

import pytest

from human_study.design.planning import make_plan
from human_study.design.secrets import token_hash
from human_study.journey import has_dropped_out
from human_study.store.records import read_study
from human_study.store.store import StudyStore, TrialEndedError
from sim.errors import StudyError
from sim.tasks.run_files import EpisodeEnd
from sim.types import SPLITS, EpisodeKey

from .small_world import study
from .stores import HOMES, KEY, begin_next, checked, do_next, open_planned, plan_homes, started, trials_of


def homes_done(store: StudyStore, code: str) -> list[str]:
    """Homes in which the participant finished a trial and kept it."""
    return sorted(trial.key.scene for trial in trials_of(store, code) if trial.has_ended and not trial.is_released)


def test_a_trial_that_is_due_stays_the_same_until_it_ends(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        first = store.next_trial("p01")
        store.open_trial("p01", first.order_no)
        again = store.next_trial("p01")
        assert (again.order_no, again.key) == (first.order_no, first.key)
        assert [do_next(store, "p01") for _ in range(4)][-1] is None
        assert homes_done(store, "p01") == list(HOMES)


def test_the_episodes_of_a_drop_out_go_to_a_spare_person_once(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        assert store.next_trial("p03") is None
        done = do_next(store, "p01")
        assert store.drop_out("p01", "away") == 2
        assert store.drop_out("p01", "away") == 0
        given = [do_next(store, "p03"), do_next(store, "p03"), do_next(store, "p03")]
        assert given[2] is None
        assert sorted(key.scene for key in given if key) == sorted(set(HOMES) - {done.scene if done else ""})
        assert {trial.made_by for trial in trials_of(store, "p03")} == {"fill"}
        assert store.next_trial("p01") is None
        assert not has_dropped_out(store.participant("p01").stages)  # asked for more: has returned


def test_a_drop_out_who_comes_back_in_time_gets_the_same_episodes_again(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        store.drop_out("p01", "away")
        assert has_dropped_out(store.participant("p01").stages)
        assert sorted(key.scene for key in iter(lambda: do_next(store, "p01"), None)) == list(HOMES)
        assert store.next_trial("p03") is None


def test_an_abandoned_trial_goes_to_somebody_who_has_not_met_the_home(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        left = do_next(store, "p01", reason="abandoned")
        assert left is not None
        assert do_next(store, "p03") == left
        assert len(list(iter(lambda: do_next(store, "p01"), None))) == 2
        visited = [trial.key.scene for trial in trials_of(store, "p01") if trial.trial_id]
        assert sorted(visited) == list(HOMES)


def test_a_technical_failure_is_queued_once_more(tmp_path: Path) -> None:
    crossed = {"kind": "crossed", "raters_per_episode": 1}
    with started(tmp_path / "crossed", design=crossed) as store:
        first = do_next(store, "p01", reason="technical")
        assert do_next(store, "p01", reason="technical") == first
        assert do_next(store, "p01") != first
        attempts = [trial for trial in trials_of(store, "p01") if trial.key == first]
        assert [(trial.attempt, trial.prior_visits_scene) for trial in attempts] == [(1, 0), (2, 1)]
    with started(tmp_path / "once") as store:
        first = do_next(store, "p01", reason="technical")
        assert do_next(store, "p01") != first
        assert do_next(store, "p03") == first


def test_fifty_people_who_come_at_once_get_different_places(tmp_path: Path) -> None:
    config = study(task=("pan",), design={"kind": "crossed", "raters_per_episode": 50})
    with open_planned(tmp_path, config, plan_homes(config, "A")) as store:
        barrier, got = threading.Barrier(50), []

        def arrive() -> None:
            barrier.wait()
            got.append(store.claim_person(None))

        threads = [threading.Thread(target=arrive) for _ in range(50)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(got) == sorted(person.code for person in store.plan.participants)
        assert store.claim_person(None) is None
        slots = [(trial.key, trial.rep) for code in got for trial in trials_of(store, code)]
        assert len(set(slots)) == len(slots) == 50


def test_the_same_person_of_a_platform_gets_the_same_place(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        assert store.claim_person("a" * 64) == "p01"
        assert store.claim_person("a" * 64) == "p01"
        assert store.claim_person("b" * 64) == "p02"
        assert store.claim_person("c" * 64) is None  # nothing is left for the spare person
        store.drop_out("p02", "away")
        assert store.claim_person("c" * 64) == "p03"


def test_nobody_can_hold_an_episode_that_somebody_has(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        person = store.plan.participants[0]
        double = person.model_copy(update={"code": "p99"})
        with pytest.raises(StudyError, match="somebody has this episode; expected episodes that nobody else has"):
            store.add_participant(double, token_hash("p99"))
        with read_study(tmp_path) as reader:
            assert "p99" not in reader.codes()


def test_withdrawal_deletes_what_was_done_and_the_chain_still_verifies(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        key = do_next(store, "p01")
        running = begin_next(store, "p01")
        store.append(running.trial_id, running.epoch, KEY)
        backup = store.back_up()
        store.withdraw("p01")
        with pytest.raises(TrialEndedError, match="was given back"):
            store.append(running.trial_id, running.epoch, KEY)
        with pytest.raises(StudyError, match=r"'p01' has left \(withdrawn\)"):
            store.next_trial("p01")
        assert checked(store) == 4
        with read_study(tmp_path) as reader:
            assert reader.is_shredded("p01")
            for trial in reader.trials("p01"):
                assert trial.outcome is None
                assert reader.events(trial.trial_id or "") == ()
        given = {do_next(store, "p03"), do_next(store, "p03"), do_next(store, "p03")}
        assert key in given
    for path in (tmp_path / "study.db", backup):
        assert b"KeyW" not in path.read_bytes()
    assert json.loads((tmp_path / "keys.json").read_text())["p01"] is None
    (tmp_path / "study.db").write_bytes(backup.read_bytes())  # somebody puts the backup back
    with read_study(tmp_path) as reader:
        assert not reader.participant("p01").is_withdrawn
        assert {trial.is_shredded for trial in reader.trials("p01")} == {True}


def test_a_withdrawal_that_was_cut_short_is_finished_at_the_next_start(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        do_next(store, "p01")
        keys = (tmp_path / "keys.json").read_bytes()
        store.withdraw("p01")
    (tmp_path / "keys.json").write_bytes(keys)  # as if the program had ended before the key was deleted
    started(tmp_path).close()
    assert json.loads((tmp_path / "keys.json").read_text())["p01"] is None


def test_records_kept_after_a_withdrawal_can_still_be_read(tmp_path: Path) -> None:
    with started(tmp_path, privacy={"on_withdraw": "keep"}) as store:
        do_next(store, "p01")
        store.withdraw("p01")
        assert [trial.outcome for trial in trials_of(store, "p01") if trial.has_ended] == [EpisodeEnd(reason="giveup")]
        assert sum(trial.is_released for trial in trials_of(store, "p01")) == 2


def test_no_trial_begins_before_consent(tmp_path: Path) -> None:
    with started(tmp_path, flow=("consent",)) as store:
        with pytest.raises(StudyError, match="'p01' has not consented"):
            store.open_trial("p01", 1)
        store.give_consent("p01", "text", given=True)
        assert store.open_trial("p01", 1).order_no == 1
        store.give_consent("p02", "text", given=False)
        with pytest.raises(StudyError, match=r"has left \(declined\)"):
            store.next_trial("p02")
        assert not store.participant("p02").consent.given


def test_a_lost_key_is_an_error_and_not_a_withdrawal(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        do_next(store, "p01")
    (tmp_path / "keys.json").unlink()
    with read_study(tmp_path) as reader, pytest.raises(StudyError, match="has no key of participant p01"):
        reader.trials("p01")


def test_the_trials_of_a_screened_out_person_go_to_others(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        store.enter_stage("p01", "screened_out")
        assert all(trial.is_released for trial in trials_of(store, "p01"))
        assert sorted(key.scene for key in iter(lambda: do_next(store, "p03"), None)) == list(HOMES)
        with pytest.raises(StudyError, match=r"has left \(screened_out\)"):
            store.next_trial("p01")


def twelve_homes(folder: Path) -> StudyStore:
    """An episode of each split in each home; p01 to p03 do one episode of each home and p04 is spare."""
    config = study(task=("pan",), design={"kind": "house-once", "raters_per_episode": 1, "overbook": 1.3})
    return open_planned(folder, config, plan_homes(config, "ABCDEFGHIJKL", splits=SPLITS))


def test_a_person_who_comes_back_goes_on_in_the_order_of_the_plan(tmp_path: Path) -> None:
    with twelve_homes(tmp_path) as store:
        planned = [trial.key for trial in store.plan.participant("p01").trials]
        done = [do_next(store, "p01") for _ in range(3)]
        store.drop_out("p01", "away")
        done += [do_next(store, "p01") for _ in range(9)]
        assert done == planned
        assert store.next_trial("p01") is None


def test_a_spare_person_gets_as_many_of_each_split_as_the_others(tmp_path: Path) -> None:
    with twelve_homes(tmp_path) as store:
        for code in ("p01", "p02", "p03"):
            store.drop_out(code, "away")
        keys = [key for key in (do_next(store, "p04") for _ in range(12)) if key is not None]
    assert len({key.scene for key in keys}) == 12
    for done in (3, 6, 9, 12):
        assert Counter(key.split for key in keys[:done]) == dict.fromkeys(SPLITS, done // 3)


def test_a_replacement_takes_splits_in_the_proportion_of_the_study(tmp_path: Path) -> None:
    config = study(task=("pan",), design={"kind": "house-once", "raters_per_episode": 1, "overbook": 2.0})
    drawn = plan_homes(config, "ABCDEF", splits=("easy",))
    episodes = [EpisodeKey("easy" if home < "E" else "hard", home, "0") for home in "ABCDEF"]
    with open_planned(tmp_path, config, make_plan(config, drawn.scenes, episodes)) as store:
        store.drop_out("p01", "away")
        splits = [key.split for key in (do_next(store, "p02") for _ in range(6)) if key is not None]
    assert Counter(splits) == {"easy": 4, "hard": 2}
    assert set(splits[:3]) == {"easy", "hard"}  # the first of each, then twice as many easy ones
    assert Counter(splits[:3])["easy"] == 2 or splits[2:4] == ["easy", "easy"]


def test_people_who_replace_several_drop_outs_get_splits_as_even_as_those_who_stay(tmp_path: Path) -> None:
    config = study(task=("pan",), design={"kind": "house-once", "raters_per_episode": 2, "overbook": 1.5})
    with open_planned(tmp_path, config, plan_homes(config, "ABCDEFGHIJKL", splits=SPLITS)) as store:
        for code, num_done in (("p01", 2), ("p03", 5), ("p06", 0)):
            assert len([do_next(store, code) for _ in range(num_done)]) == num_done
            store.drop_out(code, "away")
        tried = [[do_next(store, code) for _ in range(13)] for code in ("p07", "p08", "p09")]
    done = [[key for key in keys if key is not None] for keys in tried]
    assert sum(map(len, done)) == 10 + 7 + 12
    for keys in done:
        assert len({key.scene for key in keys}) == len(keys)
        counts = [sum(key.split == split for key in keys) for split in SPLITS]
        assert max(counts) - min(counts) <= 2
