"""Somebody who takes over what another person left, in real Chromium and with the keyboard alone."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.plan import load_plan
from human_study.design.secrets import make_secrets, token_hash
from human_study.design.study import StudyDesign, load_study
from human_study.store.store import open_store
from human_study.texts.quiz import questions_for

from .flow_steps import HOLD_MS, press_by_keyboard, record, stages
from .flow_studies import plan_small, served

pytestmark = pytest.mark.browser


def stop_with_keys(page: Page) -> None:
    """Steps once and stops."""
    expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", "0")
    page.keyboard.press("a", delay=HOLD_MS)
    expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", "1")
    page.keyboard.press("Enter", delay=HOLD_MS)
    expect(page.get_by_text("Press Enter or STOP again to finish")).to_be_visible()
    page.keyboard.press("Enter", delay=HOLD_MS)


def leave_everything(folder: Path, code: str) -> None:
    """Registers all people as `study serve` does; this one came, and has been away for too long."""
    config = load_study(folder)
    plan = load_plan(folder, config)
    secrets = make_secrets(folder, [person.code for person in plan.participants])
    with open_store(folder, config, plan) as store:
        for person in plan.participants:
            store.add_participant(person, token_hash(secrets.tokens[person.code]))
        store.enter_stage(code, "arrived")
        assert store.drop_out(code, "away")


def test_who_takes_over_trials_has_pages_breaks_and_the_end_like_others(
    tmp_path: Path, browser: BrowserContext
) -> None:
    folder = plan_small(tmp_path, design=StudyDesign(kind="crossed", raters_per_episode=1, overbook=2.0))
    leave_everything(folder, "p01")
    config = load_study(folder)
    plan = load_plan(folder, config)
    spare = next(person.code for person in plan.participants if all(t.phase == "practice" for t in person.trials))
    with served(folder, tmp_path / "dataset") as study:
        page = browser.new_page()
        page.goto(study.links[spare])
        expect(page.get_by_text("Your window has room")).to_be_visible()
        page.keyboard.press("w", delay=HOLD_MS)
        expect(page.get_by_text("The key arrived")).to_be_visible()
        press_by_keyboard(page, "Continue")
        press_by_keyboard(page, "I agree and take part")
        expect(page.get_by_text("Page 1 of")).to_be_visible()
        num_pages = int(page.get_by_text(re.compile(r"Page 1 of (\d+)")).inner_text().split()[-1])
        for number in range(2, num_pages + 1):
            press_by_keyboard(page, "Next")
            expect(page.get_by_text(f"Page {number} of")).to_be_visible()
        press_by_keyboard(page, "I have read this")
        for question in questions_for(config, "pan", config.conditions("pan")):
            expect(page.get_by_text(question.text)).to_be_visible()
            press_by_keyboard(page, question.answers[0])
        press_by_keyboard(page, "Begin to practise")
        stop_with_keys(page)
        press_by_keyboard(page, "Next search")
        expect(page.get_by_role("heading", name="Now it counts")).to_be_visible()
        press_by_keyboard(page, "Begin")
        stop_with_keys(page)
        expect(page.get_by_role("heading", name="Time for a break")).to_be_visible()
        press_by_keyboard(page, "Go on")
        stop_with_keys(page)
        expect(page.get_by_role("heading", name="Thank you!")).to_be_visible()
    reached = stages(study, spare)
    counted = [trial for trial in record(study, spare)[1] if trial.phase == "main"]
    assert [trial.has_ended for trial in counted] == [True, True]
    assert reached.count("break_ended") == 1
    assert reached[-1] == "finished"
