"""One row per attempt: figures from events, visits, exclusions, and why a trial is not counted."""

from pathlib import Path

import pytest

from human_study.design.plan import PlannedTrial, StudyPlan
from human_study.design.secrets import token_hash
from human_study.export.data_dictionary import columns_of
from human_study.export.trial_table import TrialRow, trial_figures
from human_study.store.store import open_store
from human_study.trial.commands import Move, Start
from human_study.trial.events import Confidence, Event, MapOff, MapOn, Moment, Open, Reconnect, Shown
from sim.tasks.run_files import EpisodeEnd
from sim.types import Action

from .finished import SUCCESS, TOO_FAR, do_trial, events_of, study_with_trials
from .small_world import plan, study
from .stores import OPEN, edit, filled, open_small, rows_of


def hidden(t_s: float) -> Event:
    return Moment(kind="hidden", t_s=t_s)


def visible(t_s: float) -> Event:
    return Moment(kind="visible", t_s=t_s)


def begun(*events: Event) -> list[Event]:
    return [OPEN.model_copy(update={"t_s": 0.0}), *events]


def look(*events: Event) -> float | None:
    return trial_figures(begun(*events), None, rule="paper").t_look_s


def test_every_attempt_and_assignment_has_a_row_and_a_trial_that_nobody_ended_is_told_from_one_that_nobody_began(
    finished: Path,
) -> None:
    rows = rows_of(finished / "study")
    assert [(row.attempt_name, row.end_reason, row.left_out) for row in rows] == [
        ("p01/1/1", "click", None),
        ("p01/2/0", None, "not begun"),
        ("p01/3/0", None, "not begun"),
        ("p02/1/1", "stop", None),
        ("p02/2/1", "technical", "technical"),
        ("p02/2/2", None, "not finished"),
        ("p02/3/1", None, "not finished"),
    ]
    right, failed, running = rows[3], rows[4], rows[6]
    assert (right.success, right.spl, right.path_m, right.n_steps) == (True, pytest.approx(0.8), 1.25, 9)
    assert (failed.success, failed.dtg, failed.n_steps) == (None, None, 1)
    assert (running.success, running.n_steps, running.t_total_s) == (None, 1, None)
    assert (right.scene_kind, right.condition, right.rep, right.verification) == ("invented", "none", 1, None)
    assert [row.attempt_name for row in rows_of(finished / "study") if row.is_never_ended] == ["p02/3/1"]


def test_visits_are_counted_from_the_earlier_trials(finished: Path) -> None:
    rows = {row.attempt_name: row for row in rows_of(finished / "study")}
    first, later = rows["p02/1/1"], rows["p02/3/1"]
    assert (first.prior_visits_scene, first.prior_visits_split, first.secs_in_scene_before) == (0, 0, 0.0)
    assert (later.prior_visits_scene or 0) >= 2
    assert later.prior_visits_split == later.prior_visits_scene


def test_practice_and_attention_trials_are_in_the_table_and_never_counted(tmp_path: Path) -> None:
    config = study(task=("pan",))
    drawn = plan(config)
    phases = ("practice", "check", "main")
    trials = tuple(
        PlannedTrial.model_validate(trial.model_dump() | {"phase": phase})
        for trial, phase in zip(drawn.participants[0].trials, phases, strict=True)
    )
    person = drawn.participants[0].model_copy(update={"trials": trials})
    changed = StudyPlan.model_validate(drawn.model_dump() | {"participants": (person.model_dump(),)})
    with open_store(tmp_path, config, changed) as store:
        store.add_participant(person, token_hash("token"))
        for number in (1, 2, 3):
            do_trial(store, "p01", number, SUCCESS)
    assert [(row.phase, row.success, row.left_out) for row in rows_of(tmp_path)] == [
        ("practice", True, "practice"),
        ("check", True, "check"),
        ("main", True, None),
    ]


def test_exclusion_rules_of_person_and_trial_are_listed_once_each(tmp_path: Path) -> None:
    with filled(tmp_path) as store:
        trial_id = do_trial(store, "p02", 1, TOO_FAR)
        store.exclude("participant", "p02", rule_id="attention", reason="two of two missed")
        store.exclude("trial", trial_id, rule_id="disturbed", reason="telephone")
        store.exclude("trial", trial_id, rule_id="disturbed", reason="telephone again")
        undone = store.exclude("trial", trial_id, rule_id="mistake", reason="wrong number")
        store.undo_exclusion(undone)
    row = next(row for row in rows_of(tmp_path) if row.attempt_name == "p02/1/1")
    assert row.excluded == ("attention", "disturbed")
    assert row.left_out == "excluded: attention, disturbed"


def test_people_whose_records_were_deleted_are_not_in_the_table(folder: Path) -> None:
    with open_small(folder / "study") as store:
        store.withdraw("p02")
    assert {row.participant for row in rows_of(folder / "study")} == {"p01"}


def test_people_who_withdrew_are_kept_where_the_study_says_so(tmp_path: Path) -> None:
    config = study(privacy={"on_withdraw": "keep"})
    study_with_trials(tmp_path, config)
    with open_small(tmp_path, config) as store:
        store.withdraw("p02")
    rows = [row for row in rows_of(tmp_path) if row.participant == "p02" and row.left_out is None]
    assert [row.success for row in rows] == [True]


def test_a_damaged_record_is_named(folder: Path) -> None:
    edit(folder / "study", "UPDATE outcome SET payload = '\"AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\"'")
    with pytest.raises(Exception, match="cannot be decrypted"):
        rows_of(folder / "study")


def test_a_look_at_a_map_lasts_until_its_end_or_until_its_last_event_if_it_was_cut_off() -> None:
    map_on = MapOn(t_s=1.0, what="topdown", min_s=0.0, max_s=60.0)
    off = MapOff(t_s=13.5, what="topdown", reason="left", look_s=12.5)
    assert look(map_on, Moment(kind="looking", t_s=6.0), off, Shown(t_s=13.6, step=0, frame_hash=None)) == 12.5
    assert look(map_on, Moment(kind="looking", t_s=6.0), Moment(kind="looking", t_s=11.0)) == 10.0
    assert look(Shown(t_s=0.1, step=0, frame_hash=None)) is None


def test_time_in_the_background_ends_with_the_page_on_screen_or_opened_again() -> None:
    def hidden_s(*events: Event) -> float:
        return trial_figures(begun(*events), None, rule="paper").t_hidden_s

    returned = Reconnect(t_s=4.0, epoch=2, away_s=30.0)
    assert hidden_s(hidden(2.0), visible(5.0), hidden(8.0), visible(9.0)) == 4.0
    assert hidden_s(hidden(2.0), hidden(3.0), visible(5.0)) == 3.0
    assert hidden_s(hidden(2.0), returned, Shown(t_s=9.0, step=0, frame_hash=None)) == 2.0
    assert hidden_s(hidden(2.0), Shown(t_s=9.0, step=0, frame_hash=None)) == 7.0


def test_confidence_after_the_end_changes_no_time() -> None:
    events = [
        *events_of(plan(study()).participants[1].trials[0].key, SUCCESS, task="pan"),
        Confidence(t_s=40.0, value=4),
    ]
    figures = trial_figures(events, EpisodeEnd(reason="stop"), rule="paper")
    assert (figures.confidence, figures.t_total_s) == (4, 10.0)
    assert trial_figures(events[:-1], None, rule="paper").confidence is None


def test_a_page_in_the_background_for_too_long_is_flagged(tmp_path: Path) -> None:
    away = [(hidden(1.0), visible(61.0)), (hidden(1.0), visible(61.5))]
    for limit_s, flags in ((60.0, [False, True]), (None, [False, False]), (0.0, [True, True])):
        folder = tmp_path / str(limit_s)
        with filled(folder, study(hidden_max_s=limit_s)) as store:
            for number, pair in enumerate(away, start=1):
                trial = store.open_trial("p02", number)
                store.append_many(trial.trial_id, trial.epoch, begun(*pair))
        rows = [row for row in rows_of(folder) if row.attempt]
        assert [row.is_long_hidden for row in rows] == flags
        assert [row.t_hidden_s for row in rows] == [60.0, 60.5]


def test_visits_count_every_attempt_and_the_dictionary_says_so() -> None:
    texts = {column.name: column.meaning for column in columns_of(TrialRow)}
    assert texts["prior_visits_scene"].startswith("Attempts of this person at trials in this home before this one")
    assert "time to decision is this minus `t_look_s`" in texts["t_total_s"]


def test_figures_of_a_trial_without_events_are_empty() -> None:
    figures = trial_figures([], None, rule="paper")
    assert figures.model_dump(exclude={"t_hidden_s"}) == dict.fromkeys(set(type(figures).model_fields) - {"t_hidden_s"})


def test_an_undefined_rule_leaves_its_figures_empty(tmp_path: Path) -> None:
    study_with_trials(tmp_path, study(success="habitat"))
    row = next(row for row in rows_of(tmp_path) if row.attempt_name == "p02/1/1")
    assert (row.success, row.dtg) == (True, pytest.approx(0.0, abs=1e-9))  # the view point itself was reached
    events = events_of(plan(study()).participants[1].trials[0].key, [Start(), Move(Action.FORWARD, "KeyW")], task="pan")
    assert isinstance(events[0], Open)
    assert trial_figures(events, EpisodeEnd(reason="giveup"), rule="habitat").success is None
