"""Whole participants in real Chromium: from the personal link to the completion code, and the ways off that path."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.events import Confidence
from human_study.plan import load_plan
from human_study.study import StudyPog, load_study
from personal_viz.flow_quiz import questions_for
from sim.episodes.dataset import PersonalDataset
from sim.scenes.sources import open_scene
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
from .flow_studies import PlannedStudy, plan_small, served

pytestmark = pytest.mark.browser
KEYS = {Action.FORWARD: "w", Action.LEFT: "a", Action.RIGHT: "ArrowRight"}
CODE = re.compile(r"^[0-9A-F]{8}$")


@pytest.fixture(scope="module")
def pan_study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannedStudy]:
    """PAN participants of two trials each, with every page."""
    root = tmp_path_factory.mktemp("pan")
    folder = plan_small(root, confidence=True)
    with served(folder, root / "dataset") as study:
        yield study


@pytest.fixture(scope="module")
def pog_study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannedStudy]:
    """POG participants of two trials each, with every page; texts and home side by side."""
    root = tmp_path_factory.mktemp("pog")
    folder = plan_small(root, task=("pog",), pog=StudyPog(conditions=("map_open",)))
    with served(folder, root / "dataset") as study:
        yield study


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


def test_a_whole_pan_participant_from_link_to_code(pan_study: PlannedStudy, browser: BrowserContext) -> None:
    page = browser.new_page()
    come_to_the_trials(page, pan_study, "p01")
    expect(page.get_by_text("Practice 1 of 1")).to_be_visible()
    walk_to_practice_target(page, pan_study, "p01")
    stop(page)
    expect(page.get_by_role("heading", name="How sure are you?")).to_be_visible()
    page.keyboard.press("4", delay=HOLD_MS)
    expect(page.get_by_role("heading", name="Saved")).to_be_visible()
    expect(page.get_by_text("within one metre of it: that is how it is done")).to_be_visible()
    page.get_by_role("button", name="Next trial").click()
    expect(page.get_by_role("heading", name="Now it counts")).to_be_visible()
    expect(page.get_by_text("0 of 2 searches done")).to_be_visible()
    page.get_by_role("button", name="Begin", exact=True).click()

    expect(page.get_by_text("Trial 1 of 2")).to_be_visible()
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

    expect(page.get_by_text("Trial 2 of 2")).to_be_visible()
    give_up(page)
    expect(page.get_by_role("heading", name="Thank you!")).to_be_visible()
    code = page.get_by_label("Completion code").inner_text()
    assert CODE.match(code)
    page.reload()
    expect(page.get_by_label("Completion code")).to_have_text(code)

    person, trials = record(pan_study, "p01")
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
    assert [event.value for event in events(pan_study, "p01", 2) if isinstance(event, Confidence)] == [2]
    texts = load_plan(pan_study.folder, load_study(pan_study.folder)).texts
    assert [(consent.text_hash, consent.given) for consent in person.consents] == [(texts["consent.md"], True)]


def test_a_whole_pog_participant_from_link_to_code(pog_study: PlannedStudy, browser: BrowserContext) -> None:
    page = browser.new_page()
    come_to_the_trials(page, pog_study, "p01", "pog")
    assert page.get_by_role("button", name="Keys", exact=True).count() == 0
    for title in ("Practice 1 of 1", "Trial 1 of 2", "Trial 2 of 2"):
        expect(page.get_by_text(title)).to_be_visible()
        point_somewhere(page)
        page.get_by_role("button", name="Confirm the mark").click()
        if title.startswith("Practice"):
            page.get_by_role("button", name="Next trial").click()
            page.get_by_role("button", name="Begin", exact=True).click()
        elif title == "Trial 1 of 2":
            page.get_by_role("button", name="Go on").click()
    expect(page.get_by_role("heading", name="Thank you!")).to_be_visible()
    assert CODE.match(page.get_by_label("Completion code").inner_text())
    trials = record(pog_study, "p01")[1]
    assert [trial.outcome.reason for trial in trials if trial.outcome is not None] == ["click"] * 3


def test_declining_is_an_answer_that_is_stored_and_stays(pan_study: PlannedStudy, browser: BrowserContext) -> None:
    page = browser.new_page()
    page.goto(pan_study.links["p02"])
    pass_device_check(page)
    page.get_by_role("button", name="I do not agree").click()
    expect(page.get_by_role("heading", name="Thank you for reading")).to_be_visible()
    page.goto("about:blank")
    page.goto(pan_study.links["p02"])
    expect(page.get_by_role("heading", name="Thank you for reading")).to_be_visible()
    assert page.get_by_role("button", name="Leave the study").count() == 0
    person, trials = record(pan_study, "p02")
    assert [consent.given for consent in person.consents] == [False]
    assert all(trial.is_released for trial in trials if trial.phase == "main")


def test_wrong_answers_are_explained_and_a_reload_stays_at_the_question(
    pan_study: PlannedStudy, browser: BrowserContext
) -> None:
    config = load_study(pan_study.folder)
    questions = questions_for(config, "pan", config.conditions("pan"))
    page = browser.new_page()
    page.goto(pan_study.links["p03"])
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
    page.get_by_role("button", name="Continue", exact=True).click()
    expect(page.get_by_text("Question 1 of 1")).to_be_visible()  # the second round asks only what was wrong
    page.get_by_role("button", name=questions[1].answers[2], exact=True).click()
    expect(page.get_by_role("alert").filter(has_text="Not quite")).to_be_visible()
    page.get_by_role("button", name=questions[1].answers[0], exact=True).click()
    page.get_by_role("button", name="Continue", exact=True).click()
    expect(page.get_by_text("Please read this once more")).to_be_visible()
    assert stages(pan_study, "p03")[-2:] == ["quiz_failed", "quiz_failed"]
    read_instructions(page)
    answer_questions(page, pan_study, "pan")
    expect(page.get_by_role("heading", name="Practice")).to_be_visible()


def test_larger_text_stays_and_the_tools_are_reached_by_keyboard(
    pan_study: PlannedStudy, browser: BrowserContext
) -> None:
    page = browser.new_page()
    page.goto(pan_study.links["p04"])
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
