"""People who leave in the middle of a trial, and failures: an outcome of its own, a bounded number of new attempts."""

from pathlib import Path

import pytest

from human_study.export.verify import verify_trial
from human_study.store.progress import SlotCount, study_progress
from human_study.store.records import read_study
from human_study.store.store import StudyStore, TrialEndedError
from human_study.trial.events import Abandoned, Error, Moment
from sim.tasks.run_files import Answer, EpisodeEnd
from sim.types import TaskKind

from .finished import BEGUN, POINT, events_of, room
from .small_world import episode, plan, study
from .stores import begin_next, checked, do_next, filled, open_planned, plan_homes, started

CROSSED = {"kind": "crossed", "raters_per_episode": 1}


def crossed(folder: Path, *, overbook: float = 1.0) -> StudyStore:
    """Everybody does the room's two episodes; p02 is spare where the plan has more people than needed."""
    config = study(task=("pan",), design=CROSSED | {"overbook": overbook})
    return open_planned(folder, config, plan(config, ("0", "1")))


def ends(store: StudyStore, code: str) -> list[tuple[int, str | None, bool]]:
    """(attempt, end, given back) of every counted attempt, in order."""
    with read_study(store.folder) as reader:
        return [
            (trial.attempt, trial.outcome.reason if trial.outcome else None, trial.is_released)
            for trial in reader.trials(code)
        ]


def slots(store: StudyStore) -> SlotCount:
    with read_study(store.folder) as reader:
        (found,) = study_progress(reader, now_ns=0).slots
    return found


def test_a_trial_left_in_the_middle_for_good_is_abandoned(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        trial = begin_next(store, "p01")
        assert store.drop_out("p01", "away") == 3
        assert store.drop_out("p01", "away") == 0
        last = store.events(trial.trial_id)[-1].event
        assert isinstance(last, Abandoned)
        assert last.t_s is None
        assert ends(store, "p01")[0] == (1, "abandoned", True)
        assert ends(store, "p01")[1:] == [(0, None, True)] * 2
        with pytest.raises(TrialEndedError, match="has ended"):
            store.open_trial("p01", 1)
        assert trial.key in {do_next(store, "p03") for _ in range(3)}
        assert checked(store) >= 2
        with read_study(tmp_path) as reader:
            assert study_progress(reader, now_ns=0).people[0].num_abandoned == 1


def test_a_trial_that_was_opened_and_not_begun_is_only_given_back(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        store.open_trial("p01", store.next_trial("p01").order_no)
        assert store.drop_out("p01", "away") == 3
        assert ends(store, "p01")[0] == (1, None, True)


def test_an_end_that_waits_for_its_outcome_is_not_called_abandoned(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        trial = begin_next(store, "p01")
        store.append(trial.trial_id, trial.epoch, Moment(kind="giveup"))
        store.drop_out("p01", "away")
        assert [stored.event.kind for stored in store.events(trial.trial_id)] == ["open", "giveup"]
        assert ends(store, "p01")[0] == (1, None, True)


@pytest.mark.parametrize(("code", "task", "commands"), [("p02", "pan", BEGUN), ("p01", "pog", POINT[:2])])
def test_an_abandoned_trial_is_verified(tmp_path: Path, code: str, task: TaskKind, commands: list) -> None:
    with filled(tmp_path) as store:
        trial = store.open_trial(code, 1)
        store.append_many(trial.trial_id, trial.epoch, events_of(trial.key, commands, task=task))
        store.drop_out(code, "away")
        events = [stored.event for stored in store.events(trial.trial_id)]
        with read_study(tmp_path) as reader:
            outcome = reader.outcome(trial.trial_id)
    assert isinstance(outcome, EpisodeEnd if task == "pan" else Answer)
    assert (outcome.reason, outcome.measures) == ("abandoned", None)
    found = verify_trial(events, outcome, trial.key, home=room(), participant=code)
    assert (found.status, found.detail) == ("verified", "")


def test_an_abandoned_trial_that_nobody_else_can_take_goes_to_the_same_person_once_more(tmp_path: Path) -> None:
    with crossed(tmp_path) as store:
        first = do_next(store, "p01", reason="abandoned")
        assert do_next(store, "p01", reason="abandoned") == first
        assert do_next(store, "p01") != first
        assert store.next_trial("p01") is None
        assert ends(store, "p01") == [(1, "abandoned", False), (2, "abandoned", False), (1, "giveup", False)]
        assert slots(store) == SlotCount("pan", "none", "easy", num_done=1, num_held=0, num_free=0, num_failed=1)


def test_an_abandoned_trial_goes_to_a_spare_person_who_can_take_it(tmp_path: Path) -> None:
    with crossed(tmp_path, overbook=2.0) as store:
        first = do_next(store, "p01", reason="abandoned")
        assert do_next(store, "p01") != first
        assert store.next_trial("p01") is None
        assert do_next(store, "p02") == first


def test_a_person_who_comes_back_to_a_crossed_study_finds_the_abandoned_trial_again(tmp_path: Path) -> None:
    with crossed(tmp_path) as store:
        key = begin_next(store, "p01").key
        assert store.drop_out("p01", "away") == 2
        assert store.drop_out("p01", "away") == 0
        assert {do_next(store, "p01"), do_next(store, "p01")} == {key, episode("1").key, episode("0").key}
        assert store.next_trial("p01") is None
        assert slots(store).num_done == 2


def test_the_second_attempt_of_a_person_who_left_goes_to_a_spare_person(tmp_path: Path) -> None:
    with crossed(tmp_path, overbook=2.0) as store:
        first = do_next(store, "p01", reason="technical")
        assert store.drop_out("p01", "away") == 2
        assert first in {do_next(store, "p02"), do_next(store, "p02")}
        assert slots(store).num_done == 2


def house_once(folder: Path) -> StudyStore:
    """One episode, one person for it, and three spare people."""
    config = study(task=("pan",), design={"kind": "house-once", "raters_per_episode": 1, "overbook": 3.0})
    return open_planned(folder, config, plan_homes(config, "A"))


def test_an_episode_that_failed_twice_is_given_to_nobody_else(tmp_path: Path) -> None:
    with house_once(tmp_path) as store:
        assert do_next(store, "p01", reason="technical") is not None
        assert slots(store).num_free == 1
        assert do_next(store, "p02", reason="technical") is not None
        assert do_next(store, "p03") is None
        assert slots(store) == SlotCount("pan", "none", "easy", num_done=0, num_held=0, num_free=0, num_failed=1)
        store.withdraw("p02")
        assert do_next(store, "p03") is None
        assert slots(store).num_failed == 1


def test_leaving_is_no_failure_and_is_queued_again_each_time(tmp_path: Path) -> None:
    with house_once(tmp_path) as store:
        assert do_next(store, "p01", reason="abandoned") is not None
        assert do_next(store, "p02", reason="technical") is not None
        assert do_next(store, "p03") is not None
        assert slots(store).num_done == 1


def test_an_error_after_leaving_changes_no_end(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        trial = begin_next(store, "p01")
        store.drop_out("p01", "away")
        store.note_error("p01", "sent text")
        assert not any(isinstance(stored.event, Error) for stored in store.events(trial.trial_id))
