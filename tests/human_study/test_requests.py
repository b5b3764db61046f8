"""A researcher's requests to a study that another process serves: done by that process, answered, or refused."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from human_study.design.plan import PlannedTrial, save_plan
from human_study.design.secrets import token_hash
from human_study.design.study import save_study
from human_study.store.records import read_study
from human_study.store.requests import (
    REQUEST_FOLDER,
    Exclusion,
    UndoneExclusion,
    Withdrawal,
    change_study,
    take_requests,
)
from human_study.store.store import StudyStore, TrialEndedError, open_store
from sim.errors import StudyError

from .finished import SUCCESS, do_trial
from .small_world import episode, plan, study
from .stores import KEY, OPEN, filled, trials_of


def prepared(folder: Path) -> StudyStore:
    """A served study in which p02 has done a trial."""
    save_study(folder, study())
    save_plan(folder, plan(study()))
    store = filled(folder)
    do_trial(store, "p02", 1, SUCCESS)
    return store


@contextmanager
def answered(take: Callable[[], list[str]]) -> Iterator[list[str]]:
    """Takes up requests, as upkeep does, until the block ends; yields the lines that it tells."""
    told: list[str] = []
    is_over = threading.Event()

    def run() -> None:
        while not is_over.is_set():
            told.extend(take())
            is_over.wait(0.01)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield told
    finally:
        is_over.set()
        thread.join()


def left(folder: Path) -> list[str]:
    return [path.name for path in (folder / REQUEST_FOLDER).iterdir()]


def test_a_withdrawal_is_done_by_the_process_that_serves_the_study(tmp_path: Path) -> None:
    with prepared(tmp_path) as store:
        with answered(lambda: take_requests(store)) as told:
            change_study(tmp_path, [Withdrawal(participant="p02")])
        assert told == ["done as asked from outside: p02 has withdrawn"]
        assert trials_of(store, "p02")[0].is_shredded
        with pytest.raises(StudyError, match="has left"):
            store.next_trial("p02")
        assert left(tmp_path) == []


def test_exclusions_are_made_and_taken_back_while_the_study_is_served(tmp_path: Path) -> None:
    with prepared(tmp_path) as store, answered(lambda: take_requests(store)):
        ids = [trial.trial_id or "" for trial in trials_of(store, "p02") if trial.trial_id]
        asked = [Exclusion(target_kind="trial", target=name, rule_id="disturbed", reason="phone") for name in ids]
        change_study(tmp_path, [*asked, Exclusion(target_kind="participant", target="p01", rule_id="own", reason="x")])
        with read_study(tmp_path) as reader:
            found = reader.exclusions()
        assert [(entry.target, entry.rule_id, entry.reason) for entry in found] == [
            (ids[0], "disturbed", "phone"),
            ("p01", "own", "x"),
        ]
        change_study(tmp_path, [UndoneExclusion(exclusion_id=found[0].exclusion_id)])
        with read_study(tmp_path) as reader:
            assert [entry.is_undone for entry in reader.exclusions()] == [True, False]


def test_a_refusal_comes_back_as_it_was_said(tmp_path: Path) -> None:
    with prepared(tmp_path) as store, answered(lambda: take_requests(store)) as told:
        with pytest.raises(StudyError, match="found no participant 'p99'"):
            change_study(tmp_path, [Withdrawal(participant="p99")])
        assert left(tmp_path) == []
    assert len(told) == 1


def test_a_process_that_takes_up_no_request_is_named_and_no_request_is_left(tmp_path: Path) -> None:
    with prepared(tmp_path) as store:
        with pytest.raises(
            StudyError, match=r"process \d+ has the study open .* Nothing was changed: let that process"
        ):
            change_study(tmp_path, [Withdrawal(participant="p02")], wait_s=0.0)
        assert left(tmp_path) == []
        assert take_requests(store) == []
        assert not store.participant("p02").is_withdrawn


def test_a_request_begun_when_the_process_ended_is_done_at_its_next_start(tmp_path: Path) -> None:
    with prepared(tmp_path) as store:
        with pytest.raises(StudyError, match="Nothing was changed"):
            change_study(tmp_path, [Withdrawal(participant="p02")], wait_s=0.0)
        text = '{"changes": [{"kind": "withdrawal", "participant": "p02"}]}'
        (tmp_path / REQUEST_FOLDER / "01X.taken").write_text(text)
    with open_store(tmp_path, study(), plan(study())) as store:
        take_requests(store)
        assert store.participant("p02").is_withdrawn
        assert left(tmp_path) == ["01X.done"]


def test_a_file_that_is_no_request_is_refused_and_told(tmp_path: Path) -> None:
    with prepared(tmp_path) as store:
        folder = tmp_path / REQUEST_FOLDER
        folder.mkdir()
        (folder / "01X.json").write_text('{"changes": [{"kind": "drop table"}]}')
        (line,) = take_requests(store)
        assert "01X.json: changes.0 is" in line
        assert (folder / "01X.done").read_text() == line


def test_without_a_process_that_serves_it_the_change_is_made_here(tmp_path: Path) -> None:
    prepared(tmp_path).close()
    change_study(tmp_path, [Withdrawal(participant="p02")], wait_s=0.0)
    with read_study(tmp_path) as reader:
        assert reader.participant("p02").is_withdrawn
    assert not (tmp_path / REQUEST_FOLDER).exists()


def test_a_person_withdrawn_in_a_practice_trial_finds_it_ended(tmp_path: Path) -> None:
    made = plan(study())
    key = episode().key
    practice = PlannedTrial(
        order_no=9,
        phase="practice",
        task="pan",
        condition="none",
        split=key.split,
        scene=key.scene,
        episode_id=key.episode_id,
        rep=0,
    )
    with open_store(tmp_path, study(), made) as store:
        person = made.participant("p02")
        store.add_participant(person.model_copy(update={"trials": (*person.trials, practice)}), token_hash("p02"))
        trial = store.open_trial("p02", 9)
        store.append(trial.trial_id, trial.epoch, OPEN)
        store.withdraw("p02")
        with pytest.raises(TrialEndedError, match=r"was given back \(withdrawn\)"):
            store.append(trial.trial_id, trial.epoch, KEY)
