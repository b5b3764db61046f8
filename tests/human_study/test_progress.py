"""Progress of a running study: where people are, which places are free, and never how well anybody did."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from human_study.export.collect import collect
from human_study.report.counts import flow_counts
from human_study.store.progress import (
    MOST_TIMES,
    STUCK_AFTER_S,
    PersonProgress,
    SlotCount,
    StudyProgress,
    study_progress,
)
from human_study.store.records import read_study
from sim.tasks.run_files import EpisodeEnd

from .finished import study_with_trials
from .small_world import CANARY
from .stores import KEY, begun_trial, do_next, edit, filled, opened, started

S = 10**9
FLOW = {"flow": ("device", "consent", "instructions", "quiz")}


def progress_of(folder: Path, *, after_s: float = 0.0) -> StudyProgress:
    """The study's progress, `after_s` after the newest stored entry."""
    with read_study(folder) as reader:
        newest = reader.rows(
            "SELECT max(max(coalesce((SELECT max(at_ns) FROM stage), 0)),"
            " coalesce((SELECT max(t_srv_ns) FROM event), 0), coalesce((SELECT max(at_ns) FROM outcome), 0),"
            " coalesce((SELECT max(opened_ns) FROM sitting), 0))"
        )[0][0]
        return study_progress(reader, now_ns=newest + int(after_s * S))


def person(folder: Path, code: str, *, after_s: float = 0.0) -> PersonProgress:
    """One participant's."""
    return next(known for known in progress_of(folder, after_s=after_s).people if known.code == code)


def leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Every field and value in a nest of values."""
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from leaves(getattr(value, field.name), f"{path}.{field.name}")
    elif isinstance(value, tuple | list):
        for part in value:
            yield from leaves(part, path)
    else:
        yield path, value


def test_the_small_study_is_counted_by_hand(tmp_path: Path) -> None:
    study_with_trials(tmp_path)
    found = progress_of(tmp_path)
    assert (found.num_done, found.num_all, found.is_pilot) == (2, 6, False)
    assert found.slots == (
        SlotCount("pan", "none", "easy", num_done=1, num_held=2, num_free=0, num_failed=0),
        SlotCount("pog", "map_open", "easy", num_done=1, num_held=2, num_free=0, num_failed=0),
    )
    walker = person(tmp_path, "p02")
    assert (walker.place, walker.trial_no, walker.num_done, walker.num_planned) == ("trial", 2, 1, 3)
    assert (walker.num_technical, walker.num_abandoned, walker.num_reconnects) == (1, 0, 0)
    assert [point.num_done for point in found.timeline] == [1, 2]


def test_no_field_and_no_value_says_how_anybody_did(tmp_path: Path) -> None:
    study_with_trials(tmp_path)
    with read_study(tmp_path) as reader:
        outcomes = [trial.outcome for code in reader.codes() for trial in reader.trials(code) if trial.outcome]
        found = study_progress(reader, now_ns=0)
    names = {path.rpartition(".")[2] for path, _ in leaves(found)}
    assert names == {
        *("study", "study_version", "is_pilot", "now_ns", "num_done", "num_all", "at_ns"),
        *("code", "task", "place", "state", "num_planned", "trial_no", "order_no", "is_in_trial", "last_activity_s"),
        *("num_reconnects", "num_technical", "num_abandoned"),
        *("condition", "split", "num_held", "num_free", "num_failed"),
        *("free_mb", "used_mb", "num_backups", "last_backup_s"),
    }
    text = json.dumps([str(value) for _, value in leaves(found)])
    told = [str(number) for outcome in outcomes for number in _numbers(outcome.model_dump()) if number not in (0, 1)]
    assert len(told) >= 4
    for word in ("stop", "click", "giveup", "timeout", "steps", "success", "spl", CANARY, *told):
        assert f'"{word}"' not in text


def _numbers(value: object) -> Iterator[float]:
    if isinstance(value, dict):
        for part in value.values():
            yield from _numbers(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _numbers(part)
    elif isinstance(value, float):
        yield value


def test_the_summary_is_the_same_whether_people_do_well_or_badly(tmp_path: Path) -> None:
    for name, reason in (("well", "stop"), ("badly", "giveup")):
        with opened(tmp_path / name) as (store, trial):
            store.finish_trial(trial.trial_id, EpisodeEnd(reason=reason))
    well, badly = (progress_of(tmp_path / name) for name in ("well", "badly"))
    assert well.people == tuple(
        dataclasses.replace(one, last_activity_s=other.last_activity_s)
        for one, other in zip(badly.people, well.people, strict=True)
    )
    assert well.slots == badly.slots


WAY: list[tuple[tuple[str, dict[str, Any]], str]] = [
    (("arrived", {}), "device"),
    (("device_ok", {}), "consent"),
    (("consented", {}), "instructions"),
    (("instructed", {}), "quiz"),
    (("quiz_failed", {}), "quiz"),
    (("quiz_failed", {}), "instructions"),
    (("instructed", {}), "quiz"),
    (("quiz_passed", {}), "trial"),
    (("dropped_out", {}), "dropped_out"),
    (("returned", {}), "trial"),
    (("finished", {}), "finished"),
]


def test_every_stage_has_its_place(tmp_path: Path) -> None:
    with started(tmp_path, **FLOW) as store:
        with read_study(tmp_path) as reader:
            before = study_progress(reader, now_ns=0).people[0]
        places = []
        for (stage, detail), _ in WAY:
            store.enter_stage("p01", stage, detail)
            places.append(person(tmp_path, "p01").place)
        assert (before.place, before.state, before.last_activity_s) == ("not_arrived", "not_arrived", None)
    assert places == [place for _, place in WAY]


@pytest.mark.parametrize("stage", ["declined", "screened_out", "full"])
def test_a_person_who_is_out_is_shown_as_out(tmp_path: Path, stage: str) -> None:
    with filled(tmp_path) as store:
        store.enter_stage("p01", stage)
        found = person(tmp_path, "p01", after_s=1e6)
    assert (found.place, found.state, found.trial_no) == (stage, "out", None)


def test_a_device_that_failed_is_refused_until_another_one_passes(tmp_path: Path) -> None:
    with started(tmp_path, **FLOW) as store:
        store.enter_stage("p01", "arrived")
        assert person(tmp_path, "p01").state == "active"
        store.enter_stage("p01", "device_failed", {"width": 400})
        found = progress_of(tmp_path, after_s=1e6)
        assert (found.num_in("refused"), found.num_in("active", "away")) == (1, 0)
        store.enter_stage("p01", "device_ok")
        assert person(tmp_path, "p01").state == "active"


@pytest.mark.parametrize("end", ["dropped_out", "screened_out", "withdrawn"])
def test_a_person_whose_device_was_refused_counts_once_and_alike_in_status_and_report(tmp_path: Path, end: str) -> None:
    with started(tmp_path, **FLOW, privacy={"on_withdraw": "keep"}) as store:
        for code in ("p01", "p02"):
            store.enter_stage(code, "arrived")
        store.enter_stage("p01", "device_failed", {"width": 400})
        store.enter_stage("p02", "device_failed", {"width": 400})
        store.enter_stage("p02", "device_ok")
        for code in ("p01", "p02"):
            match end:
                case "dropped_out":
                    store.drop_out(code, "away")
                case "withdrawn":
                    store.withdraw(code)
                case _:
                    store.enter_stage(code, end)
        shown = progress_of(tmp_path)
        with read_study(tmp_path) as reader:
            found = collect(reader)
    counts = {count.point: count.n for count in flow_counts(found.participants, found.trials, num_deleted=0)}
    num_refused = 0 if end == "withdrawn" else 1
    point = {"dropped_out": "dropped out", "screened_out": "screened out", "withdrawn": "withdrew"}[end]
    assert (shown.num_in("refused"), shown.num_in("out")) == (num_refused, 2 - num_refused)
    assert (counts["device refused"], counts[point]) == (num_refused, 2 - num_refused)


def test_withdrawn_and_dropped_out_people_give_their_slots_back(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        do_next(store, "p01")
        do_next(store, "p02")
        store.withdraw("p01")
        store.drop_out("p02", "away")
        found = progress_of(tmp_path)
    assert [(one.place, one.state, one.num_done) for one in found.people[:2]] == [
        ("withdrawn", "out", 0),
        ("dropped_out", "out", 1),
    ]
    assert found.slots == (SlotCount("pan", "none", "easy", num_done=1, num_held=0, num_free=5, num_failed=0),)
    assert (found.num_in("out"), found.num_in("not_arrived")) == (2, 1)


def test_a_spare_person_who_takes_over_is_counted_from_then_on(tmp_path: Path) -> None:
    with started(tmp_path) as store:
        store.drop_out("p01", "away")
        do_next(store, "p03")
        found = progress_of(tmp_path)
    spare = found.people[2]
    assert (spare.num_done, spare.num_planned) == (1, 1)
    assert found.slots[0] == SlotCount("pan", "none", "easy", num_done=1, num_held=3, num_free=2, num_failed=0)


def test_a_trial_with_two_technical_failures_counts_as_failed_and_not_as_done(tmp_path: Path) -> None:
    with started(tmp_path, design={"kind": "crossed", "raters_per_episode": 1}) as store:
        do_next(store, "p01", reason="technical")
        assert progress_of(tmp_path).slots[0].num_held == 3
        do_next(store, "p01", reason="technical")
        found = progress_of(tmp_path)
    assert found.slots[0] == SlotCount("pan", "none", "easy", num_done=0, num_held=2, num_free=0, num_failed=1)
    assert (found.people[0].num_technical, found.people[0].num_done, found.people[0].trial_no) == (2, 0, 2)


def test_silence_in_a_trial_is_stuck_and_a_long_one_away(tmp_path: Path) -> None:
    begun_trial(tmp_path)
    states = {
        after_s: person(tmp_path, "p02", after_s=after_s).state
        for after_s in (0.0, STUCK_AFTER_S, STUCK_AFTER_S + 1, 900.0, 901.0)
    }
    assert list(states.values()) == ["active", "active", "stuck", "stuck", "away"]
    assert person(tmp_path, "p02", after_s=42.0).last_activity_s == 42.0


def test_silence_between_trials_is_not_stuck(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        store.finish_trial(trial.trial_id, EpisodeEnd(reason="stop"))
    found = person(tmp_path, "p02", after_s=STUCK_AFTER_S + 1)
    assert (found.state, found.is_in_trial) == ("active", False)


def test_a_wall_clock_that_went_back_gives_no_negative_ages(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, _):
        store.back_up()
    found = progress_of(tmp_path, after_s=-3600.0)
    assert (found.people[1].last_activity_s, found.people[1].state) == (0.0, "active")
    assert found.disk.last_backup_s == 0.0
    assert found.disk.num_backups == 1


def test_trials_that_were_opened_again_are_counted(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, _):
        store.open_trial("p02", 1)
        store.append(store.open_trial("p02", 1).trial_id, 3, KEY)
    assert person(tmp_path, "p02").num_reconnects == 2


def test_a_long_timeline_is_thinned_out_and_keeps_its_end(tmp_path: Path) -> None:
    study_with_trials(tmp_path)
    rows = ", ".join(
        f"('a{n}', 'p02', {n + 10}, 'pan', 'easy', 'room', 'x{n}', 'main', 'none', 1, 'plan', 0)" for n in range(500)
    )
    trials = ", ".join(f"('t{n}', 'a{n}', 1, 0, NULL, NULL, NULL)" for n in range(500))
    ends = ", ".join(f"('t{n}', 'stop', '{{}}', '', {n + 1})" for n in range(500))
    edit(
        tmp_path,
        f"INSERT INTO assignment VALUES {rows}; INSERT INTO trial VALUES {trials};INSERT INTO outcome VALUES {ends}",
    )
    found = progress_of(tmp_path).timeline
    assert len(found) <= MOST_TIMES
    assert found[-1].num_done == 502
    assert [point.at_ns for point in found] == sorted(point.at_ns for point in found)
