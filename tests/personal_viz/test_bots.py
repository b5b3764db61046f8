"""Simulated participants: what they see of a page, what they answer, and what is counted of what they did."""

from pathlib import Path

import pytest

from human_study.design.plan import load_plan
from human_study.design.study import load_study
from human_study.store.store import open_store
from human_study.tickets import token_hash
from human_study.trial.events import Act, Dropped, Key, Open
from personal_viz.bots.count import count_keys
from personal_viz.bots.flow import is_the_end, right_answers
from personal_viz.bots.page import BotPage
from personal_viz.bots.run import quantile
from personal_viz.bots.site import copy_plan, cpu_seconds, make_bot_study
from personal_viz.bots.walker import BotLog, Press
from personal_viz.cli.study.bots import StudyBots
from sim.errors import StudyError
from sim.types import PAPER4, Action
from tests.human_study.small_world import SCENE_DIGEST, plan, study
from tests.personal_viz.bot_pages import button, html, wire


def picture(step: int) -> str:
    return f'<img alt="x" data-step="{step}" src="data:image/jpeg;base64,AAAA">'


def walking_page() -> BotPage:
    page = BotPage()
    command = {"type": "RegisterCommandMessage", "uuid": "w", "props": {"label": "forward", "hotkey": "W"}}
    page.apply(wire(html("status", "<b>Step 3 of 500</b>"), html("image", picture(3)), command))
    return page


def test_a_bot_reads_steps_from_counter_and_picture() -> None:
    page = walking_page()
    assert (page.step_counted, page.step_shown, page.is_walking, page.num_frames) == (3, 3, True, 1)
    page.apply(wire({"type": "GuiUpdateMessage", "uuid": "status", "updates": {"content": "<b>Step 4 of 500</b>"}}))
    assert (page.step_counted, page.step_shown) == (4, 3)
    page.apply(wire({"type": "GuiUpdateMessage", "uuid": "image", "updates": {"content": picture(4)}}))
    assert (page.step_shown, page.num_frames) == (4, 2)
    page.apply(wire({"type": "GuiRemoveMessage", "uuid": "image"}))
    assert not page.is_walking


def test_a_bot_finds_buttons_that_a_person_could_press() -> None:
    page = BotPage()
    page.apply(wire(button("1", "Next trial", visible=False), button("2", "Next trial"), button("3", "Give up")))
    found = page.button("^next")
    assert found is not None
    assert found.uuid == "2"
    assert page.button("^start") is None


def test_a_bot_finds_the_letter_box_of_the_pages_script() -> None:
    page = BotPage()
    call = "window.personalPage.begin(&quot;aB-9_&quot;,{},[])"
    box = {"type": "GuiTextMessage", "uuid": "box", "value": "", "props": {"label": "messages of this page"}}
    page.apply(wire(html("script", f'<img onerror="{call}">'), box))
    assert page.seat == "aB-9_"
    assert page.letter_box is not None
    assert page.letter_box.uuid == "box"


def test_the_last_page_is_the_one_without_buttons() -> None:
    page = BotPage()
    page.apply(wire(html("text", "<h1>Thank you!</h1>"), button("1", "Next trial")))
    assert not is_the_end(page)
    page.apply(wire({"type": "GuiRemoveMessage", "uuid": "1"}))
    assert is_the_end(page)


def test_bots_know_one_right_answer_to_each_question() -> None:
    answers = right_answers(study(task=("pan",)))
    assert "Within 1 metre of the middle of the object" in answers
    assert "Anywhere in the same room" not in answers


def test_quantiles_of_nothing_are_not_numbers() -> None:
    assert quantile([], 0.5) is None
    assert quantile([1.0, 3.0], 0.5) == 2.0


def test_every_key_is_looked_for_by_itself(tmp_path: Path) -> None:
    config = study()
    people = plan(config, ("0",))
    with open_store(tmp_path, config, people) as store:
        for person in people.participants:
            store.add_participant(person, token_hash(person.code))
        trial = store.open_trial("p02", 1)
        opened = Open(
            task="pan",
            split="easy",
            scene="room",
            episode_id="0",
            scene_digest=SCENE_DIGEST,
            max_steps=500,
            actions=PAPER4,
        )
        store.append_many(trial.trial_id, trial.epoch, (opened,))
        for mark in (1.5, 2.5, 2.5, 9.5):
            key = Key(t_s=mark, t_cli_ms=mark, code="KeyW", action=Action.FORWARD)
            act = Act(t_s=mark, action=Action.FORWARD, position=(0.0, 0.0, -mark), yaw=0.0)
            store.append_many(trial.trial_id, trial.epoch, (key, act))
        busy = Key(t_s=10.0, t_cli_ms=10.0, code="KeyW", action=Action.FORWARD)
        store.append_many(trial.trial_id, trial.epoch, (busy, Dropped(t_s=10.0, reason="busy")))
    log = BotLog("p02", "random", presses=[Press(mark, 0.0) for mark in (1.5, 2.5, 3.5, 4.5, 10.0)])
    log.presses[3].was_cut_off = True
    found = count_keys(tmp_path, [log])
    assert (found.lost, found.cut_off) == (2, 0), "a later key of the same connection is stored"
    log.ends = [4]
    found = count_keys(tmp_path, [log])
    assert (found.sent, found.stored, found.lost, found.cut_off) == (5, 3, 1, 1)
    assert (found.duplicated, found.unknown, found.dropped) == (1, 1, {"busy": 1})
    assert found.events == 1 + 2 * 4 + 2


def test_a_bot_study_gives_everybody_every_episode(tmp_path: Path, demo_root: Path) -> None:
    make_bot_study(tmp_path, participants=3, seed=1, dataset=demo_root)
    planned = load_plan(tmp_path / "study", load_study(tmp_path / "study"))
    assert [len(person.trials) for person in planned.participants] == [24, 24, 24]
    assert planned.is_pilot
    copy_plan(tmp_path / "study", tmp_path / "copy")
    assert load_plan(tmp_path / "copy", load_study(tmp_path / "copy")) == planned
    assert not (tmp_path / "copy" / "secrets.json").exists()


def test_what_bots_cannot_do_is_said_before_work_starts(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="--rate 9"):
        StudyBots(rate=9.0).work()
    with pytest.raises(StudyError, match="found no --dataset"):
        StudyBots(study=tmp_path).work()
    with pytest.raises(StudyError, match="found no study folder"):
        StudyBots(url="http://127.0.0.1:1").work()


def test_bots_never_stand_among_people(tmp_path: Path) -> None:
    config = study()
    open_store(tmp_path, config, plan(config, ("0",))).close()
    with pytest.raises(StudyError, match="is a study with people; expected a pilot"):
        StudyBots(url="http://127.0.0.1:1", study=tmp_path, dataset=tmp_path).work()


def test_cpu_time_of_a_process_that_is_gone_is_none() -> None:
    assert cpu_seconds(2**22 + 1) == 0
