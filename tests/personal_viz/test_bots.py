"""Simulated participants: their knowledge, and the counts of what they did."""

from pathlib import Path

import pytest

from human_study.design.plan import load_plan
from human_study.design.study import load_study
from human_study.trial.events import Act, Dropped, Key
from personal_viz.bots.forms import right_answers
from personal_viz.bots.page import BotPage, Element
from personal_viz.bots.records import BotLog, Press, count_bots
from personal_viz.bots.server import cpu_seconds
from personal_viz.bots.site import copy_plan, make_bot_study
from personal_viz.cli.study.bots import StudyBots
from sim.errors import StudyError
from sim.types import Action
from tests.human_study.small_world import study
from tests.human_study.stores import open_small, opened


def test_bots_know_one_right_answer_to_each_question() -> None:
    answers = right_answers(study(task=("pan",)))
    assert "Within 1 metre of the middle of the object" in answers
    assert "Anywhere in the same room" not in answers


def test_a_bot_that_said_found_waits_for_the_mark_the_next_search_or_the_end_not_for_the_last_picture() -> None:
    page = BotPage(step_shown=4)
    page.elements["w"] = Element("w", "RegisterCommandMessage", {"hotkey": "W"})
    page.elements["found"] = button = Element("found", "GuiButtonMessage", {"label": "FOUND here (Enter twice)"})
    seen = [page.has_gone_on(0, 3)]  # the last picture of the trial
    button.props["label"] = "FOUND again: that is all (Enter twice)"
    seen.append(page.has_gone_on(0, 3))
    page.search, page.step_shown = 1, 0
    seen.append(page.has_gone_on(0, 3))
    del page.elements["w"]
    page.search = 0
    assert [*seen, page.has_gone_on(0, 3)] == [False, True, True, True]


def test_every_key_is_looked_for_by_itself(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        for mark in (1.5, 2.5, 2.5, 9.5):
            key = Key(t_s=mark, t_cli_ms=mark, code="KeyW", action=Action.FORWARD)
            act = Act(t_s=mark, action=Action.FORWARD, position=(0.0, 0.0, -mark), yaw=0.0)
            store.append_many(trial.trial_id, trial.epoch, (key, act))
        busy = Key(t_s=10.0, t_cli_ms=10.0, code="KeyW", action=Action.FORWARD)
        store.append_many(trial.trial_id, trial.epoch, (busy, Dropped(t_s=10.0, reason="busy")))
    log = BotLog("p02", "random", presses=[Press(0.0, mark) for mark in (1.5, 2.5, 3.5, 4.5, 10.0)])
    log.presses[3].was_cut_off = True
    found = count_bots(tmp_path, [log])
    assert (len(found.lost), found.cut_off) == (2, 0), "a later key of the same connection is stored"
    log.ends = [4]
    found = count_bots(tmp_path, [log])
    assert (found.sent, found.stored, found.lost, found.cut_off) == (5, 3, ("p02 (random): key 3 of 5",), 1)
    assert (found.duplicated, found.unknown, found.dropped) == (1, 1, {"busy": 1})


def test_a_key_that_is_stored_without_the_pages_time_is_not_lost(tmp_path: Path) -> None:
    with opened(tmp_path) as (store, trial):
        for mark in (1.0, None, 3.0):
            key = Key(t_s=1.0, t_cli_ms=mark, code="KeyW", action=Action.FORWARD)
            act = Act(t_s=1.0, action=Action.FORWARD, position=(0.0, 0.0, 0.0), yaw=0.0)
            store.append_many(trial.trial_id, trial.epoch, (key, act))
    found = count_bots(tmp_path, [BotLog("p02", "random", presses=[Press(0.0, mark) for mark in (1.0, 2.0, 3.0)])])
    assert (found.stored, found.lost, found.untimed, found.unknown) == (3, (), 1, 0)


def test_a_bot_study_gives_everybody_every_episode(tmp_path: Path, demo_root: Path) -> None:
    make_bot_study(tmp_path, participants=3, seed=1, dataset=demo_root)
    config = load_study(tmp_path / "study")
    planned = load_plan(tmp_path / "study", config)
    assert [len(person.trials) for person in planned.participants] == [24, 24, 24]
    assert planned.is_pilot
    assert config.storey_names == "texts"
    copy_plan(tmp_path / "study", tmp_path / "copy")
    assert load_plan(tmp_path / "copy", load_study(tmp_path / "copy")) == planned
    assert not (tmp_path / "copy" / "secrets.json").exists()


def test_impossible_bot_studies_are_refused_before_work_starts_and_bots_never_stand_among_people(
    tmp_path: Path,
) -> None:
    with pytest.raises(StudyError, match="--rate 9"):
        StudyBots(rate=9.0).run()
    with pytest.raises(StudyError, match="found no --dataset"):
        StudyBots(study=tmp_path).run()
    with pytest.raises(StudyError, match="found no study folder"):
        StudyBots(url="http://127.0.0.1:1").run()
    config = study()
    open_small(tmp_path, config).close()
    with pytest.raises(StudyError, match="is a study with people; expected a pilot"):
        StudyBots(url="http://127.0.0.1:1", study=tmp_path, dataset=tmp_path).run()


def test_cpu_time_of_a_process_that_is_gone_is_none() -> None:
    assert cpu_seconds(2**22 + 1) == 0
