"""Whole participants in real Chromium: from the personal link to the completion code, and the ways off that path."""

import re

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.plan import load_plan
from human_study.design.study import load_study
from human_study.texts.quiz import questions_for
from human_study.trial.events import Confidence
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.types import PAPER4, Action

from .flow_steps import (
    HOLD_MS,
    agree,
    answer_questions,
    come_to_the_trials,
    events,
    give_up,
    pass_device_check,
    point_somewhere,
    press_by_keyboard,
    read_instructions,
    record,
    see_step,
    stages,
    stop,
)
from .flow_studies import PlannedStudy

pytestmark = pytest.mark.browser
KEYS = {Action.FORWARD: "w", Action.LEFT: "a", Action.RIGHT: "ArrowRight"}
CODE = re.compile(r"^[0-9A-F]{8}$")


def walk_to_practice_target(page: Page, study: PlannedStudy, code: str) -> None:
    """Walks the shortest way of the practice trial with real keys."""
    plan = load_plan(study.folder, load_study(study.folder))
    dataset = PersonalDataset(study.folder / "practice")
    episode = dataset.episode(plan.participant(code).trials[0].key)
    scene = open_scene(dataset, episode.key.scene)
    env = PanEnv(episode.start, scene.navigation, renderer=None)
    agent = ShortestPathAgent(episode, scene.navigation)
    agent.reset(episode.task("pan", actions=PAPER4), env.camera, seed=0)
    observation, number = env.reset(), 0
    while (action := agent.act(observation)) is not Action.STOP:
        page.keyboard.press(KEYS[action], delay=HOLD_MS)
        number += 1
        see_step(page, number)
        observation = env.step(action)


def test_a_whole_pan_participant_from_link_to_code(full_study: PlannedStudy, browser: BrowserContext) -> None:
    who = full_study.newcomer("pan")
    page = browser.new_page()
    come_to_the_trials(page, full_study, who)
    expect(page.get_by_text("Practice 1 of 1")).to_be_visible()
    walk_to_practice_target(page, full_study, who)
    stop(page)
    expect(page.get_by_role("heading", name="How sure are you?")).to_be_visible()
    page.keyboard.press("4", delay=HOLD_MS)
    expect(page.get_by_role("heading", name="Saved")).to_be_visible()
    expect(page.get_by_text("That was right. An answer is right when the robot stops")).to_be_visible()
    page.get_by_role("button", name="Next search").click()
    expect(page.get_by_role("heading", name="Now it counts")).to_be_visible()
    expect(page.get_by_text("0 of 2 searches done")).to_be_visible()
    page.get_by_role("button", name="Begin", exact=True).click()

    expect(page.get_by_text("Search 1 of 2")).to_be_visible()
    page.keyboard.press("a", delay=HOLD_MS)
    see_step(page, 1)
    page.reload()
    see_step(page, 1)
    stop(page)
    expect(page.get_by_role("heading", name="How sure are you?")).to_be_visible()
    page.keyboard.press("2", delay=HOLD_MS)
    expect(page.get_by_role("heading", name="Time for a break")).to_be_visible()
    expect(page.get_by_text("1 of 2 searches done")).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="Time for a break")).to_be_visible()
    assert page.get_by_label("Completion code").count() == 0
    page.get_by_role("button", name="Go on").click()

    expect(page.get_by_text("Search 2 of 2")).to_be_visible()
    give_up(page)
    expect(page.get_by_role("heading", name="Thank you!")).to_be_visible()
    code = page.get_by_label("Completion code").inner_text()
    assert CODE.match(code)
    page.reload()
    expect(page.get_by_label("Completion code")).to_have_text(code)

    person, trials = record(full_study, who)
    reached = [entry.stage for entry in person.stages]
    assert reached == [
        "arrived",
        "device_ok",
        "consented",
        "instructed",
        "quiz_passed",
        "sitting_started",
        "break_started",
        "break_ended",
        "finished",
    ]
    assert [trial.phase for trial in trials] == ["practice", "main", "main"]
    assert all(trial.has_ended for trial in trials)
    assert [event.value for event in events(full_study, who, 2) if isinstance(event, Confidence)] == [2]
    texts = load_plan(full_study.folder, load_study(full_study.folder)).texts
    assert [(consent.text_hash, consent.given) for consent in person.consents] == [(texts["told/consent-pan.md"], True)]


def test_a_whole_pog_participant_from_link_to_code(full_study: PlannedStudy, browser: BrowserContext) -> None:
    who = full_study.newcomer("pog")
    page = browser.new_page()
    come_to_the_trials(page, full_study, who, "pog")
    assert page.get_by_role("button", name="Keys", exact=True).count() == 0
    for title in ("Practice 1 of 1", "Search 1 of 2", "Search 2 of 2"):
        expect(page.get_by_text(title)).to_be_visible()
        point_somewhere(page)
        page.get_by_role("button", name="Confirm the mark").click()
        expect(page.get_by_role("heading", name="How sure are you?")).to_be_visible()
        page.keyboard.press("3", delay=HOLD_MS)
        if title.startswith("Practice"):
            page.get_by_role("button", name="Next search").click()
            page.get_by_role("button", name="Begin", exact=True).click()
        elif title == "Search 1 of 2":
            page.get_by_role("button", name="Go on").click()
    expect(page.get_by_role("heading", name="Thank you!")).to_be_visible()
    assert CODE.match(page.get_by_label("Completion code").inner_text())
    trials = record(full_study, who)[1]
    assert [trial.outcome.reason for trial in trials if trial.outcome is not None] == ["click"] * 3


def test_declining_is_an_answer_that_is_stored_and_stays(full_study: PlannedStudy, browser: BrowserContext) -> None:
    who = full_study.newcomer("pan")
    page = browser.new_page()
    page.goto(full_study.links[who])
    pass_device_check(page)
    page.get_by_role("button", name="I do not agree").click()
    expect(page.get_by_role("heading", name="Thank you for reading")).to_be_visible()
    page.goto("about:blank")
    page.goto(full_study.links[who])
    expect(page.get_by_role("heading", name="Thank you for reading")).to_be_visible()
    assert page.get_by_role("button", name="Leave the study").count() == 0
    person, trials = record(full_study, who)
    assert [consent.given for consent in person.consents] == [False]
    assert all(trial.is_released for trial in trials if trial.phase == "main")


def test_wrong_answers_are_explained_and_a_reload_stays_at_the_question(
    full_study: PlannedStudy, browser: BrowserContext
) -> None:
    who = full_study.newcomer("pan")
    config = load_study(full_study.folder)
    questions = questions_for(config, "pan", config.conditions("pan"))
    page = browser.new_page()
    page.goto(full_study.links[who])
    pass_device_check(page)
    agree(page)
    page.reload()
    read_instructions(page)
    page.get_by_role("button", name=questions[0].answers[0], exact=True).click()
    expect(page.get_by_text("Question 2 of")).to_be_visible()
    page.get_by_role("button", name=questions[1].answers[1], exact=True).click()
    expect(page.get_by_role("alert").filter(has_text="Not quite")).to_be_visible()
    page.reload()
    expect(page.get_by_text(questions[1].text)).to_be_visible()
    for question in questions[1:]:
        expect(page.get_by_text(question.text)).to_be_visible()
        page.get_by_role("button", name=question.answers[0], exact=True).click()
    expect(page.get_by_text("answer these questions once more")).to_be_visible()
    expect(page.get_by_text("Question 1 of 1")).to_be_visible()  # the second round asks only what was wrong
    page.get_by_role("button", name=questions[1].answers[2], exact=True).click()
    expect(page.get_by_role("alert").filter(has_text="Not quite")).to_be_visible()
    page.get_by_role("button", name=questions[1].answers[0], exact=True).click()
    expect(page.get_by_text("Please read this once more")).to_be_visible()
    assert stages(full_study, who)[-2:] == ["quiz_failed", "quiz_failed"]
    read_instructions(page)
    answer_questions(page, full_study, "pan")
    expect(page.get_by_role("heading", name="Practice")).to_be_visible()


def test_larger_text_stays_and_the_tools_are_reached_by_keyboard(
    full_study: PlannedStudy, browser: BrowserContext
) -> None:
    who = full_study.newcomer("pan")
    page = browser.new_page()
    page.goto(full_study.links[who])
    expect(page.get_by_text("Your window has room")).to_be_visible()
    before = page.evaluate("parseFloat(getComputedStyle(document.querySelector('.personal-page')).fontSize)")
    page.keyboard.press("w", delay=HOLD_MS)
    expect(page.get_by_text("The key arrived")).to_be_visible()
    press_by_keyboard(page, "Larger text")
    expect(page.get_by_role("button", name="Larger text")).to_have_attribute("aria-pressed", "true")
    after = page.evaluate("parseFloat(getComputedStyle(document.querySelector('.personal-page')).fontSize)")
    assert after == pytest.approx(1.25 * before)
    page.reload()
    expect(page.get_by_text("Your window has room")).to_be_visible()
    expect(page.get_by_role("button", name="Larger text")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("w", delay=HOLD_MS)
    expect(page.get_by_text("The key arrived")).to_be_visible()
    press_by_keyboard(page, "Continue")
    press_by_keyboard(page, "I agree and take part")
    expect(page.get_by_text("Page 1 of")).to_be_visible()
