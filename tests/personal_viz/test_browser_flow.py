"""Whole participants in real Chromium: from the personal link to the completion code, by keyboard, with larger text."""

import re

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.plan import PRACTICE_FOLDER, load_plan
from human_study.design.study import load_study
from human_study.export.verify import verify_trial
from human_study.journey import ConsentEntry
from human_study.trial.events import Act, Confidence
from personal_viz.study_app.home.trial_homes import open_trial_home
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.tasks.run_files import EpisodeEnd
from sim.types import PAPER4, Action, EpisodeKey

from .flow_steps import (
    HOLD_MS,
    come_to_the_trials,
    events,
    give_up,
    point_somewhere,
    press_by_keyboard,
    record,
    see_step,
    stop,
)
from .flow_studies import PlannedStudy

pytestmark = pytest.mark.browser
KEYS = {Action.FORWARD: "w", Action.LEFT: "a", Action.RIGHT: "ArrowRight"}
CODE = re.compile(r"^[0-9A-F]{8}$")


def practise(page: Page, study: PlannedStudy, key: EpisodeKey) -> list[Action]:
    """Walks to the target of the only practice trial and begins the trials that count; returns the practice actions."""
    expect(page.get_by_text("Practice 1 of 1")).to_be_visible()
    expect(page.get_by_alt_text("What the robot sees")).to_have_js_property("naturalWidth", 640)
    walked = walk_to_practice_target(page, study, key)
    stop(page)
    expect(page.get_by_role("heading", name="How sure are you?")).to_be_visible()
    page.keyboard.press("4", delay=HOLD_MS)
    expect(page.get_by_role("heading", name="Saved")).to_be_visible()
    expect(page.get_by_text("That was right. An answer is right when the robot stops")).to_be_visible()
    press_by_keyboard(page, "Next search")
    expect(page.get_by_role("heading", name="Now it counts")).to_be_visible()
    expect(page.get_by_text("0 of 2 searches done")).to_be_visible()
    press_by_keyboard(page, "Begin")
    return [*walked, Action.STOP]


def walk_to_practice_target(page: Page, study: PlannedStudy, key: EpisodeKey) -> list[Action]:
    """Walks the shortest way of the practice trial with real keys; returns its actions."""
    dataset = PersonalDataset(study.folder / PRACTICE_FOLDER)
    episode, scene = dataset.episode(key), open_scene(dataset, key.scene)
    expect(page.get_by_text(episode.record.query[0])).to_be_visible()
    env = PanEnv(episode.start, scene.navigation, renderer=None)
    agent = ShortestPathAgent(episode, scene.navigation)
    agent.reset(episode.task("pan", actions=PAPER4), env.camera, seed=0)
    observation, actions = env.reset(), []
    while (action := agent.act(observation)) is not Action.STOP:
        page.keyboard.press(KEYS[action], delay=HOLD_MS)
        actions.append(action)
        see_step(page, len(actions))
        observation = env.step(action)
    return actions


def test_a_whole_pan_participant_from_link_to_code_by_keyboard_alone(
    full_study: PlannedStudy, browser: BrowserContext
) -> None:
    who = full_study.newcomer("pan")
    plan = load_plan(full_study.folder, load_study(full_study.folder))
    page = browser.new_page()
    come_to_the_trials(page, full_study, who)
    practised_actions = practise(page, full_study, plan.participant(who).trials[0].key)

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
    press_by_keyboard(page, "Go on")

    expect(page.get_by_text("Search 2 of 2")).to_be_visible()
    see_step(page, 0)
    give_up(page)
    expect(page.get_by_role("heading", name="Thank you!")).to_be_visible()
    code = page.get_by_label("Completion code").inner_text()
    assert CODE.match(code)
    page.reload()
    expect(page.get_by_label("Completion code")).to_have_text(code)

    person, stored = record(full_study, who)
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
    assert [trial.phase for trial in stored] == ["practice", "main", "main"]
    assert all(trial.has_ended for trial in stored)
    assert [event.value for event in events(full_study, who, 2) if isinstance(event, Confidence)] == [2]
    assert person.consent == ConsentEntry(plan.texts["told/consent-pan.md"], given=True)

    practice, outcome = events(full_study, who, stored[0].order_no), stored[0].outcome
    assert [event.action for event in practice if isinstance(event, Act)] == practised_actions
    assert isinstance(outcome, EpisodeEnd)
    assert outcome.measures.rules["paper"].success
    practised = PersonalDataset(full_study.folder / PRACTICE_FOLDER)
    home = open_trial_home(practised, plan.scene(stored[0].key.scene), None)
    assert verify_trial(practice, outcome, stored[0].key, home=home, participant=who).status == "verified"


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
