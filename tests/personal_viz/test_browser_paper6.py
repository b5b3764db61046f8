"""All six actions of the paper in Chromium: keys and buttons tilt the head, the record says so, and it verifies."""

import math
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, Page

from human_study.export.verify import TrialHome, verify_trial
from human_study.trial.events import Act
from personal_viz.study_app.home.homes import Home
from sim.types import TURN_STEP, Action

from ..human_study.small_world import study
from .flow_steps import HOLD_MS, see_step, stop
from .stage import invented_home, staged

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Home]:
    """One home for all tests."""
    home = invented_home(tmp_path_factory.mktemp("home"), study())
    yield home
    home.close()


def click(page: Page, button: str) -> None:
    """A click, and as long as a key is held: sessions drop presses within 50 ms, and the picture is quicker."""
    page.get_by_role("button", name=button).click()
    page.wait_for_timeout(HOLD_MS)


def test_looking_up_and_down_by_key_and_button_is_stored_and_verified(home: Home, browser: BrowserContext) -> None:
    with staged(home, "pan", "none", actions="paper6") as stage:
        page = browser.new_page()
        page.goto(stage.url)
        picture = page.get_by_alt_text("What the robot sees")
        see_step(page, 0)
        pictures = [picture.get_attribute("src")]
        for number, press in enumerate(
            (
                lambda: page.keyboard.press("r", delay=HOLD_MS),
                lambda: click(page, "Look down (F)"),
                lambda: page.keyboard.press("f", delay=HOLD_MS),
                lambda: page.keyboard.press("w", delay=HOLD_MS),
            ),
            start=1,
        ):
            press()
            see_step(page, number)
            pictures.append(picture.get_attribute("src"))
        stop(page)
        outcome = stage.link.wait_for_outcome()
        events = stage.link.events("")
    acts = [event for event in events if isinstance(event, Act)]
    assert [act.action for act in acts] == [
        Action.LOOK_UP,
        Action.LOOK_DOWN,
        Action.LOOK_DOWN,
        Action.FORWARD,
        Action.STOP,
    ]
    assert [act.tilt for act in acts] == pytest.approx([TURN_STEP, 0, -TURN_STEP, -TURN_STEP, -TURN_STEP], abs=1e-9)
    assert math.isclose(TURN_STEP, math.radians(30))
    assert pictures[0] == pictures[2]
    assert len(set(pictures)) == 4
    replayed = TrialHome(home.scene.navigation, home.scene.digest, home.storeys, home.episodes.__getitem__)
    found = verify_trial(events, outcome, stage.key, home=replayed, participant="p01")
    assert (found.status, found.max_position_error) == ("verified", pytest.approx(0.0, abs=1e-9)), found
