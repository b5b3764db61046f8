"""A trial that failed before its first event `open` can be exported, reported, verified and checked like all others."""

from collections import Counter
from pathlib import Path

import pytest

from human_study.export.import_check import import_check
from human_study.export.study_export import export_study
from human_study.export.verify import verify_trial
from human_study.report.report import study_report
from human_study.report.source import read_source
from human_study.trial.events import Error, Event, Moment
from human_study.trial.outcome import has_begun, unscored_outcome
from sim.tasks.run_files import EpisodeEnd
from sim.types import TaskKind

from .finished import POINT, SUCCESS, do_trial, room
from .small_world import episode
from .stores import filled, rows_of

NOTE = Error(message="connection closed: sent text", is_fatal=False)
BROKEN = Error(message="the home cannot be opened", is_fatal=True)


@pytest.fixture(params=[[BROKEN], [NOTE, BROKEN], [NOTE]], ids=["fatal", "note and fatal", "note"])
def stray(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A study in which p02's second trial failed before it began."""
    folder = tmp_path / "study"
    with filled(folder) as store:
        do_trial(store, "p01", 1, POINT)
        do_trial(store, "p02", 1, SUCCESS)
        trial = store.open_trial("p02", 2)
        store.append_many(trial.trial_id, trial.epoch, request.param)
        store.finish_trial(trial.trial_id, unscored_outcome(trial.key, "pan", reason="technical", participant="p02"))
    return folder


def test_the_row_of_an_unbegun_failure_says_technical_and_has_no_figures(stray: Path) -> None:
    row = next(row for row in rows_of(stray) if (row.participant, row.order_no, row.attempt) == ("p02", 2, 1))
    assert (row.end_reason, row.left_out) == ("technical", "technical")
    assert (row.success, row.n_steps, row.t_total_s, row.t_look_s, row.t_hidden_s) == (None, None, None, None, 0.0)


def test_a_study_with_an_unbegun_failure_is_exported_checked_and_reported(stray: Path, tmp_path: Path) -> None:
    export_study(stray, tmp_path / "out")
    checked = import_check(tmp_path / "out", room)
    assert checked.agrees, checked.problems
    assert checked.num_attempts == 3
    source = read_source([stray])
    report = study_report(source.runs, records=source.records)
    assert Counter({count.reason: count.n for count in report.left_out})["technical failure"] == 1


def test_figures_that_were_put_into_the_row_of_an_unbegun_failure_are_found(stray: Path, tmp_path: Path) -> None:
    from .test_import_check import change

    export_study(stray, tmp_path / "out")
    change(tmp_path / "out", "trials.jsonl", lambda text: text.replace('"path_m":null', '"path_m":0.0'))
    assert any("row.path_m is stored as 0.0" in problem for problem in import_check(tmp_path / "out", room).problems)


@pytest.mark.parametrize("events", [[], [BROKEN], [NOTE], [NOTE, BROKEN]], ids=len)
@pytest.mark.parametrize("task", ["pan", "pog"])
def test_an_unbegun_failure_is_verified(events: list[Event], task: TaskKind) -> None:
    assert not has_begun(events)
    outcome = unscored_outcome(episode().key, task, reason="technical", participant="p02")
    assert verify_trial(events, outcome, episode().key, home=room(), participant="p02").status == "verified"


def test_any_other_end_before_the_beginning_fails() -> None:
    found = verify_trial(
        [Moment(kind="giveup")], EpisodeEnd(reason="giveup"), episode().key, home=room(), participant="p02"
    )
    assert found.status == "failed"
    assert "starts with 'giveup'; expected 'open'" in found.detail


def test_an_error_of_the_connection_waits_for_the_trial_to_begin(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        trial = store.open_trial("p02", 1)
        store.note_error("p02", "sent text")
        assert store.events(trial.trial_id) == ()
        do_trial(store, "p02", 1, SUCCESS)
        assert store.events(trial.trial_id)[0].event.kind == "open"
