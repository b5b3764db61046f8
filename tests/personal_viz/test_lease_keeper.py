"""People who leave in the middle of a served study: when others get their trials, and when not."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from human_study.design.plan import save_plan
from human_study.design.study import save_study
from human_study.journey import Stage, has_dropped_out
from human_study.store.database import BACKUP_FOLDER, require_free_space
from human_study.store.progress import study_progress
from human_study.store.records import read_study
from human_study.store.store import StudyStore
from personal_viz.cli.study.exclude import StudyExclude
from personal_viz.cli.study.withdraw import StudyWithdraw
from personal_viz.study_app.gateway.lease_keeper import LeaseKeeper
from personal_viz.study_app.gateway.upkeep import Upkeep, upkeep
from sim.errors import StudyError
from tests.human_study.stores import do_next, started

CROSSED = {"kind": "crossed", "raters_per_episode": 2}
LEASE_S = 900.0


class Kept:
    """A store and its keeper, with a steady clock that the test moves, and what the keeper tells."""

    def __init__(self, store: StudyStore) -> None:
        self.store, self.now_s, self.told = store, 0.0, list[str]()
        self.keeper = LeaseKeeper(store, tell=self.told.append, clock=lambda: self.now_s)

    def gives_away_after(self, seconds: float, code: str = "p01") -> bool:
        """Whether others have the participant's trials this much later."""
        self.now_s += seconds
        self.keeper.tick()
        return has_dropped_out(self.store.participant(code).stages)


@contextlib.contextmanager
def kept(folder: Path, *stages: Stage, **changes: object) -> Iterator[Kept]:
    """A study of three homes in which p01 has reached these stages and the keeper has looked around once."""
    with started(folder, **changes) as store:
        for stage in stages:
            store.enter_stage("p01", stage)
        found = Kept(store)
        found.keeper.tick()
        yield found


def test_a_person_who_leaves_in_the_middle_gives_the_rest_to_others_once(tmp_path: Path) -> None:
    with kept(tmp_path) as study:
        with study.keeper.present("p01"):
            study.store.enter_stage("p01", "arrived")
            study.keeper.tick()
        assert not study.gives_away_after(LEASE_S)
        assert study.gives_away_after(1)
        study.keeper.tick()
        assert study.told == ["p01 has been away for 15 minutes: others get what is left"]
        assert study.store.next_trial("p03") is not None


def test_a_living_tab_keeps_everything_however_long(tmp_path: Path) -> None:
    with kept(tmp_path, "arrived") as study:
        with study.keeper.present("p01"):
            with study.keeper.present("p01"):
                assert study.keeper.people_here() == {"p01"}
            assert not study.gives_away_after(100 * LEASE_S)
        assert study.keeper.people_here() == frozenset()
        assert not study.gives_away_after(0)


def test_people_who_never_came_or_have_finished_lose_nothing(tmp_path: Path) -> None:
    with kept(tmp_path) as study:
        study.store.enter_stage("p02", "finished")
        assert not study.gives_away_after(0)
        assert not study.gives_away_after(10 * LEASE_S, "p02")
        assert not study.gives_away_after(0)
        assert study.told == []


def test_a_claimed_place_to_which_nobody_came_is_given_back(tmp_path: Path) -> None:
    with kept(tmp_path) as study:
        assert study.store.claim_person(None) == "p01"
        assert not study.gives_away_after(0)
        assert study.gives_away_after(LEASE_S + 1)


def test_a_restart_takes_nobodys_place_away(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        store.enter_stage("p01", "arrived")
    with started(tmp_path) as store:
        study = Kept(store)
        assert not study.gives_away_after(50_000.0)  # the steady clock of a machine that has run for long
        assert not study.gives_away_after(LEASE_S)
        assert study.gives_away_after(1)


def test_a_person_who_was_asked_to_come_back_later_has_that_much_more_time(tmp_path: Path) -> None:
    with kept(tmp_path, "arrived", "instructed", breaks={"sitting_max": 1, "sitting_gap_s": 3600.0}) as study:
        do_next(study.store, "p01")
        assert not study.gives_away_after(0)
        assert not study.gives_away_after(LEASE_S + 3600.0)
        assert study.gives_away_after(1)


def test_nothing_is_given_away_if_nobody_could_take_it(tmp_path: Path) -> None:
    with kept(tmp_path, "arrived", design=CROSSED) as study:
        assert not study.gives_away_after(10 * LEASE_S)


def test_a_wall_clock_that_jumps_takes_nobodys_place_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with kept(tmp_path, "arrived") as study:
        now_ns = time.time_ns()
        for jump_h in (24, -24):
            monkeypatch.setattr("time.time_ns", lambda jump_h=jump_h: now_ns + jump_h * 3600 * 10**9)
            assert not study.gives_away_after(LEASE_S / 2)


def test_a_second_absence_is_counted_anew(tmp_path: Path) -> None:
    with kept(tmp_path, "arrived") as study:
        assert study.gives_away_after(LEASE_S + 1)
        with study.keeper.present("p01"):
            assert study.store.next_trial("p01") is not None
            study.keeper.tick()
        assert not study.gives_away_after(LEASE_S)
        assert study.gives_away_after(1)
        assert len(study.told) == 2


STEPS = st.lists(
    st.tuples(st.sampled_from(["here", "left"]), st.sampled_from(["p01", "p02"]), st.floats(0, 500)), max_size=40
)


@pytest.fixture(scope="module")
def awaiting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[StudyStore, list[str]]]:
    """A store in which p01 and p02 have begun, and the people whom a keeper let drop out, which is not stored."""
    with started(tmp_path_factory.mktemp("awaiting")) as store, pytest.MonkeyPatch.context() as patch:
        dropped: list[str] = []
        for code in ("p01", "p02"):
            store.enter_stage(code, "arrived")
        patch.setattr(store, "drop_out", lambda code, reason: dropped.append(code))
        yield store, dropped


@settings(deadline=None)
@given(STEPS, st.floats(0, 2000))
def test_only_people_without_a_tab_who_left_long_ago_are_out(
    awaiting: tuple[StudyStore, list[str]], steps: list[tuple[str, str, float]], later_s: float
) -> None:
    store, dropped = awaiting
    dropped.clear()
    study = Kept(store)
    study.keeper.tick()
    open_tabs: dict[str, list[contextlib.ExitStack]] = {"p01": [], "p02": []}
    left_s = dict.fromkeys(open_tabs, 0.0)
    for what, code, passed_s in steps:
        study.now_s += passed_s
        if what == "here":
            open_tabs[code].append(contextlib.ExitStack())
            open_tabs[code][-1].enter_context(study.keeper.present(code))
        elif open_tabs[code]:
            open_tabs[code].pop().close()
            left_s[code] = study.now_s
    study.now_s += later_s
    study.keeper.tick()
    assert dropped == [code for code, left in left_s.items() if not open_tabs[code] and study.now_s - left > LEASE_S]


def test_a_store_that_cannot_be_written_is_told_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(code: str, reason: str) -> int:
        raise StudyError("the disk is full")

    with kept(tmp_path, "arrived") as study:
        with monkeypatch.context() as patch:
            patch.setattr(study.store, "drop_out", full)
            assert not study.gives_away_after(LEASE_S + 1)
        assert study.told == ["the disk is full"]
        assert study.gives_away_after(0)


def test_backups_are_made_only_after_something_was_written(tmp_path: Path) -> None:
    with kept(tmp_path, design=CROSSED) as study:  # a design in which leases give nothing away
        store = study.store
        rounds = Upkeep(store, study.keeper, tell=print, clock=lambda: study.now_s)

        def backups(now_s: float) -> list[Path]:
            study.now_s = now_s
            rounds.tick()
            return sorted((tmp_path / BACKUP_FOLDER).glob("*.db"))

        assert backups(700.0) == []
        store.enter_stage("p01", "arrived")
        (first,) = backups(701.0)
        store.enter_stage("p01", "instructed")
        assert backups(1300.0) == [first]
        assert len(backups(1301.0)) == 2
        assert len(backups(5000.0)) == 2
    folder = tmp_path / "copy"
    folder.mkdir()
    first.rename(folder / "study.db")
    with read_study(folder) as reader:
        assert [entry.stage for entry in reader.participant("p01").stages] == ["arrived"]


def test_the_thread_ends_with_the_block_and_leaves_a_last_copy(tmp_path: Path) -> None:
    with kept(tmp_path) as study:
        with upkeep(study.store, study.keeper, tell=study.told.append, tick_s=0.01):
            study.store.enter_stage("p01", "arrived")
        assert study.told == []
        with read_study(tmp_path) as reader:
            assert study_progress(reader, now_ns=0).disk.num_backups == 1


def test_a_failure_stops_neither_the_rest_of_a_round_nor_the_next_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def vanished() -> None:
        raise FileNotFoundError("study.db-wal")

    with kept(tmp_path) as study:
        rounds = Upkeep(study.store, study.keeper, tell=study.told.append)
        monkeypatch.setattr(study.keeper, "tick", vanished)
        monkeypatch.setattr("personal_viz.study_app.gateway.upkeep.free_mb", lambda _: 3)
        rounds.tick()
        rounds.tick()
    assert [line.split("failed")[0].split(":")[1].strip() for line in study.told] == [
        "looking after the study",
        "its disk has 3 MB free; free some space soon. The study goes on.",
        "looking after the study",
    ]


def test_each_time_that_the_log_is_taken_away_is_told(tmp_path: Path) -> None:
    with kept(tmp_path, "arrived") as study:
        rounds = Upkeep(study.store, study.keeper, tell=study.told.append)
        line = f"{tmp_path / 'study.db'}-wal: was taken"
        for told in (1, 2):
            (tmp_path / "study.db-wal").unlink()
            rounds.tick()
            rounds.tick()
            assert len(study.told) == told
        (tmp_path / "study.db-wal").unlink()
        rounds.end()
        assert [said[: len(line)] for said in study.told] == [line] * 3


def test_a_disk_that_gets_full_is_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with kept(tmp_path) as study:
        rounds = Upkeep(study.store, study.keeper, tell=study.told.append)
        monkeypatch.setattr("personal_viz.study_app.gateway.upkeep.free_mb", lambda _: 3)
        rounds.tick()
        rounds.tick()
    assert study.told == [f"{tmp_path}: its disk has 3 MB free; free some space soon. The study goes on."]


def test_a_study_is_not_served_from_a_disk_that_is_nearly_full(tmp_path: Path) -> None:
    require_free_space(tmp_path, least_mb=1)
    with pytest.raises(StudyError, match=r"MB free; expected at least \d+ MB before a study is served\. Free some"):
        require_free_space(tmp_path, least_mb=10**9)
    with pytest.raises(StudyError, match="expected a study's folder"):
        require_free_space(tmp_path / "none")


def test_commands_of_the_researcher_work_while_the_study_is_served(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with started(tmp_path) as store:
        save_study(tmp_path, store.config)
        save_plan(tmp_path, store.plan)
        trial, study = store.open_trial("p02", 1), Kept(store)
        with upkeep(store, study.keeper, tell=study.told.append, tick_s=0.01):
            assert StudyWithdraw(study=tmp_path, participant="p01").run() == 0
            names = {"study": tmp_path, "who": "p02/1", "rule": "disturbed"}
            assert StudyExclude(**names, reason="somebody came in").run() == 0
            assert StudyExclude(**names, undo=True).run() == 0
        assert store.participant("p01").is_withdrawn
        with read_study(tmp_path) as reader:
            assert [(entry.target, entry.is_undone) for entry in reader.exclusions()] == [(trial.trial_id, True)]
    assert [line.partition(": ")[2].split()[0] for line in study.told] == ["p01", "rule", "exclusion"]
    assert "p01 has withdrawn; everything done is deleted" in capsys.readouterr().out
