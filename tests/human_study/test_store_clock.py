"""Clocks that jump: durations stay right, order is by number, nothing is lost."""

import time
from pathlib import Path

import pytest

from human_study.store.people import KEPT_BACKUPS
from human_study.store.records import read_study
from human_study.store.store import StudyStore, Trial
from human_study.trial.events import Moment, Reconnect
from sim.tasks.run_files import EpisodeEnd

from .clocks import HOUR_S, Clocks, S
from .stores import KEY, OPEN, begun_trial, checked, open_small, opened, trials_of


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    """Clocks that stand still."""
    found = Clocks()
    monkeypatch.setattr("time.time_ns", lambda: found.wall_ns)
    monkeypatch.setattr("time.monotonic_ns", lambda: found.steady_ns)
    monkeypatch.setattr("human_study.store.store._boot_id", lambda: found.boot)
    return found


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S, -50 * 365 * 24 * HOUR_S])
def test_an_absence_is_as_long_as_it_was_whatever_the_wall_clock_does(
    tmp_path: Path, clocks: Clocks, jump_s: int
) -> None:
    with opened(tmp_path) as (store, _):
        clocks.wall_ns += jump_s * S
        clocks.pass_s(90.0)
        again = store.open_trial("p02", 1)
        assert again.away_s == 90.0
        assert store.events(again.trial_id)[-1].event == Reconnect(epoch=2, away_s=90.0)


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_events_are_in_the_order_of_their_numbers_not_of_the_wall_clock(
    tmp_path: Path, clocks: Clocks, jump_s: int
) -> None:
    with opened(tmp_path) as (store, trial):
        for _ in range(3):
            clocks.pass_s(1.0)
            store.append(trial.trial_id, trial.epoch, KEY)
            clocks.wall_ns += jump_s * S
        stored = store.events(trial.trial_id)
        assert checked(store) == 4
    assert [line.seq for line in stored] == [1, 2, 3, 4]
    walls = [line.t_srv_ns for line in stored]
    assert walls == sorted(walls, reverse=jump_s < 0) or jump_s < 0
    assert [line.t_srv_mono_ns - stored[0].t_srv_mono_ns for line in stored] == [0, S, 2 * S, 3 * S]


def test_summer_time_changes_nothing(tmp_path: Path, clocks: Clocks, monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(tmp_path) as (store, trial):
        before = store.events(trial.trial_id)[0].t_srv_ns
        monkeypatch.setenv("TZ", "Pacific/Apia")
        time.tzset()
        try:
            clocks.pass_s(2.0)
            store.append(trial.trial_id, trial.epoch, KEY)
            assert store.open_trial("p02", 1).away_s == 0.0
            assert store.events(trial.trial_id)[1].t_srv_ns - before == 2 * S
        finally:
            monkeypatch.undo()
            time.tzset()


@pytest.mark.parametrize(
    ("passed_s", "steady_s", "away_s"),
    [
        pytest.param(300.0, 10.0, 300.0, id="the wall clock says how long"),
        pytest.param(-HOUR_S, 1e6, 0.0, id="one that went back makes nobody late"),
    ],
)
def test_over_a_reboot_an_absence_is_told_by_the_wall_clock(
    tmp_path: Path, clocks: Clocks, passed_s: float, steady_s: float, away_s: float
) -> None:
    begun_trial(tmp_path)
    clocks.pass_s(passed_s)
    clocks.reboot(steady_s=steady_s)
    with open_small(tmp_path) as store:
        assert store.open_trial("p02", 1).away_s == away_s
        assert checked(store) == 2


def test_a_steady_clock_that_starts_again_is_compared_within_its_boot_only(tmp_path: Path, clocks: Clocks) -> None:
    begun_trial(tmp_path)
    clocks.reboot(steady_s=4_990.0)
    with open_small(tmp_path) as store:
        trial = store.open_trial("p02", 1)
        store.append(trial.trial_id, trial.epoch, KEY)
        clocks.pass_s(20.0)
        assert store.open_trial("p02", 1).away_s == 20.0


def secs_before_the_next(store: StudyStore, trial: Trial) -> float | None:
    """Gives the trial up; returns `secs_in_scene_before` of the participant's next trial."""
    store.append(trial.trial_id, trial.epoch, Moment(kind="giveup"))
    store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup"))
    store.open_trial(trial.code, trial.order_no + 1)
    return trials_of(store, trial.code)[trial.order_no].secs_in_scene_before


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_the_time_spent_in_a_home_is_counted_by_the_steady_clock(tmp_path: Path, clocks: Clocks, jump_s: int) -> None:
    with opened(tmp_path) as (store, trial):
        clocks.pass_s(30.0)
        clocks.wall_ns += jump_s * S
        assert secs_before_the_next(store, trial) == 30.0


def test_an_absence_is_no_time_spent_in_a_home(tmp_path: Path, clocks: Clocks) -> None:
    with opened(tmp_path) as (store, trial):
        clocks.pass_s(30.0)
        store.append(trial.trial_id, trial.epoch, KEY)
        clocks.pass_s(500.0)
        again = store.open_trial("p02", 1)
        clocks.pass_s(7.0)
        assert secs_before_the_next(store, again) == 37.0


def test_the_time_spent_in_a_home_over_a_reboot_is_that_of_both_parts(tmp_path: Path, clocks: Clocks) -> None:
    with opened(tmp_path) as (store, trial):
        clocks.pass_s(30.0)
        store.append(trial.trial_id, trial.epoch, KEY)
    clocks.reboot()
    with open_small(tmp_path) as store:
        again = store.open_trial("p02", 1)
        clocks.pass_s(12.0)
        assert secs_before_the_next(store, again) == 42.0


def test_backups_made_after_the_wall_clock_went_back_are_the_newest(tmp_path: Path, clocks: Clocks) -> None:
    with opened(tmp_path) as (store, trial):
        for _ in range(KEPT_BACKUPS):
            clocks.pass_s(1.0)
            store.back_up()
        clocks.wall_ns -= HOUR_S * S
        store.append(trial.trial_id, trial.epoch, KEY)
        newest = store.back_up()
    assert newest.is_file()
    kept = sorted((tmp_path / "backups").glob("study-*.db"))
    assert (len(kept), kept[-1]) == (KEPT_BACKUPS, newest)
    newest.rename(tmp_path / "study.db")
    with read_study(tmp_path) as reader:
        assert [line.event for line in reader.events(trial.trial_id)] == [OPEN, KEY]
