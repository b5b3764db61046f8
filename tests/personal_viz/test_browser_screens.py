"""The screens of a trial in real Chromium, without gateway and store: looks, walks, a home and a map to point at."""

import dataclasses
import io
import math
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import BrowserContext, Page, expect

from human_study.export.verify import TrialHome, verify_trial
from human_study.trial.events import Act, Cam, Clicked, Confidence, Event, MapOff
from human_study.trial.outcome import end_reason
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.home.surfaces import MARK_COLOR
from personal_viz.study_app.home.top_view import STRIP
from sim.tasks.run_files import Answer, EpisodeEnd
from sim.types import TURN_STEP, Action, EpisodeKey

from ..human_study.small_world import study
from .flow_steps import HOLD_MS, give_up, pixel_of, resting_camera, see_step, stop
from .stage import Stage, invented_home, staged

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Home]:
    """An invented home with two storeys."""
    opened = invented_home(tmp_path_factory.mktemp("dataset"), study())
    yield opened
    opened.close()


def kinds(events: list[Event]) -> list[str]:
    """Kinds of all events but reports of the page and camera poses."""
    of_page = {"resize", "net", "focus", "blur", "visible", "hidden", "cam", "looking"}
    return [event.kind for event in events if event.kind not in of_page]


def texts_of(stage: Stage, key: EpisodeKey) -> tuple[str, str]:
    """Query and description of the trial."""
    record = stage.home.episodes[key].record
    return record.query[0], record.summary


def test_a_walk_begins_after_a_look_at_the_map(home: Home, browser: BrowserContext) -> None:
    memory = {"arms": ["topdown"], "min_s": 6, "max_s": 120}
    with staged(home, "pan", "topdown", memory=memory, confidence=True) as stage:
        page = browser.new_page()
        page.goto(stage.url)
        picture = page.get_by_alt_text("The home from above, storey 1 of 2")
        expect(picture).to_have_js_property("naturalWidth", home.copies.maps[0].grid.shape[1])
        expect(page.get_by_text(texts_of(stage, stage.key)[0])).to_have_count(0)
        expect(page.get_by_text("You can go on in")).to_be_visible()
        page.get_by_role("button", name="Show storey 2 of 2").click()
        expect(page.get_by_alt_text("The home from above, storey 2 of 2")).to_be_visible()
        expect(page.get_by_text("You can go on in")).to_have_count(0)
        page.keyboard.press("Enter", delay=HOLD_MS)
        see_step(page, 0)
        expect(page.get_by_text(texts_of(stage, stage.key)[0])).to_be_visible()
        expect(page.get_by_alt_text("The home from above")).to_have_count(0)
        page.keyboard.press("a", delay=HOLD_MS)
        see_step(page, 1)
        presses = stop(page)
        expect(page.get_by_role("heading", name="How sure are you?")).to_be_visible()
        page.keyboard.press("4", delay=HOLD_MS)
        expect(page.get_by_role("heading", name="Saved")).to_be_visible()
        events = stage.link.events()
        assert isinstance(stage.link.outcome, EpisodeEnd)
        assert stage.link.outcome.reason == "stop"
    expected = (
        f"open map_on storey map_off shown key act shown {'key stop_armed ' * (presses - 1)}key act stop confidence"
    )
    assert [kind for kind in kinds(events) if kind != "dropped"] == expected.split()
    off = next(event for event in events if isinstance(event, MapOff))
    assert (off.reason, off.what) == ("left", "topdown")
    assert 6 <= off.look_s < 120
    assert next(event.value for event in events if isinstance(event, Confidence)) == 4


def test_the_papers_order_shows_the_home_first_and_its_texts_after_that(home: Home, browser: BrowserContext) -> None:
    with staged(home, "pog", "map_first", pog={"conditions": ["map_first"], "look_max_s": 90}) as stage:
        page = browser.new_page()
        page.goto(stage.url)
        query, description = texts_of(stage, stage.key)
        button = page.get_by_role("button", name="Show what to find")
        expect(button).to_be_visible()
        stage.link.wait_for("cam")
        expect(page.get_by_text(query)).to_have_count(0)
        assert description[:40] not in page.content()
        box = page.locator("canvas").last.bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        button.click()
        expect(page.get_by_text(query)).to_be_visible()
        presses = give_up(page)
        expect(page.get_by_role("heading", name="Saved")).to_be_visible()
        events = stage.link.events()
    assert kinds(events) == ["open", "map_on", "map_off", *["giveup_armed"] * (presses - 1), "giveup"]
    assert end_reason(events) == "giveup"


def camera_above(page: Page, stage: Stage, centre: tuple[float, float]) -> Cam:
    """The stored camera pose, once it has come to rest over a place (x, z)."""
    return resting_camera(
        page, stage.link.events, lambda cam: math.dist((cam.position[0], cam.position[2]), centre) < 0.01
    )


def middle_of_picture(stage: Stage) -> tuple[float, float]:
    """World (x, z) of the middle of the lowest storey's picture with its strip."""
    grid = stage.home.copies.maps[0].grid
    x, z = grid.xz_from_uv(np.array([grid.shape[1], grid.shape[0] + STRIP]) / 2).tolist()
    return x, z


def wait_for_mark(page: Page, at: tuple[float, float]) -> None:
    """Waits until the page has the mark's colour there."""
    col, row = (round(side) for side in at)
    for _ in range(100):
        shot = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
        seen = shot[row - 2 : row + 3, col - 2 : col + 3].reshape(-1, 3).mean(axis=0)
        if seen[0] > 180 and seen[1] < 120 and seen[2] > 80:  # MARK_COLOR in the light of the scene
            return
        page.wait_for_timeout(200)
    raise AssertionError(f"found {seen}; expected the mark's colour {MARK_COLOR} at {at}")


def test_a_click_on_the_map_is_the_place_that_the_participant_sees_there(home: Home, browser: BrowserContext) -> None:
    with staged(home, "pog", "map_2d", pog={"conditions": ["map_2d"]}) as stage:
        page = browser.new_page()
        page.goto(stage.url)
        view = home.copies.maps[0]
        cam = camera_above(page, stage, middle_of_picture(stage))
        box = page.locator("canvas").last.bounding_box()
        rows, cols = view.grid.shape
        for number, (u, v) in enumerate([(0.31 * cols, 0.52 * rows), (0.77 * cols, 0.18 * rows)], start=1):
            x, z = view.grid.xz_from_uv(np.array([u, v])).tolist()
            on_page = pixel_of((x, view.floor_y, z), cam, box)
            page.mouse.click(*on_page, delay=HOLD_MS)
            wait_for_mark(page, on_page)
            clicked = [event for event in stage.link.wait_for("click", count=number) if isinstance(event, Clicked)][-1]
            assert clicked.hit == clicked.pixel.point(view.floor_y)
            metres_per_page_pixel = (cam.position[1] - view.floor_y) / (
                box["height"] / 2 / math.tan(math.radians(37.5))
            )
            assert math.dist((clicked.hit[0], clicked.hit[2]), (x, z)) < 1.5 * metres_per_page_pixel
        page.keyboard.press("ArrowRight", delay=HOLD_MS)
        moved = [event for event in stage.link.wait_for("click", count=3) if isinstance(event, Clicked)][-1]
        assert np.subtract(moved.hit, clicked.hit) == pytest.approx((0.1, 0.0, 0.0), abs=1e-6)
        page.get_by_role("button", name="Confirm the mark").click()
        expect(page.get_by_role("heading", name="Saved")).to_be_visible()
        outcome = stage.link.wait_for_outcome()
        assert isinstance(outcome, Answer)
        assert outcome.candidates == (moved.hit,)


def test_a_mark_can_be_made_moved_and_confirmed_without_a_mouse(home: Home, browser: BrowserContext) -> None:
    with staged(home, "pog", "map_open", pog={"conditions": ["map_open"]}) as stage:
        page = browser.new_page()
        page.goto(stage.url)
        expect(page.get_by_role("button", name="Confirm the mark")).to_be_visible()
        resting_camera(
            page, stage.link.events, lambda cam: max(map(abs, cam.wxyz[2:])) < 1e-3
        )  # north is up on the screen
        for number, key in enumerate(["ArrowUp", "ArrowUp", "ArrowLeft"], start=1):
            page.keyboard.press(key, delay=HOLD_MS)
            stage.link.wait_for("click", count=number)
        button = page.get_by_role("button", name="Confirm the mark")
        button.focus()
        expect(button).to_be_focused()
        button.press("Enter", delay=HOLD_MS)
        outcome = stage.link.wait_for_outcome()
        hits = [event.hit for event in stage.link.events() if isinstance(event, Clicked)]
    assert isinstance(outcome, Answer)
    assert all(hit is not None for hit in hits)
    assert outcome.candidates == (hits[-1],)
    first, second, third = (np.array(hit) for hit in hits)
    x, z = home.copies.middle(0)
    assert first[[0, 2]] == pytest.approx((x, z), abs=1e-5)
    assert (second - first)[[0, 2]] == pytest.approx((0, -0.1), abs=1e-3)
    assert (third - second)[[0, 2]] == pytest.approx((-0.1, 0), abs=1e-3)


def test_page_up_shows_the_storey_above_and_the_mark_stays_below(home: Home, browser: BrowserContext) -> None:
    pog = {"conditions": ["map_open"], "pointing": "snap", "object_names": "demand"}
    with staged(home, "pog", "map_open", pog=pog, storey_names="british") as stage:
        page = browser.new_page()
        page.goto(stage.url)
        expect(page.get_by_role("button", name="Ground floor: shown now")).to_be_visible()
        resting_camera(page, stage.link.events, lambda cam: max(map(abs, cam.wxyz[2:])) < 1e-3)
        page.keyboard.press("ArrowUp", delay=HOLD_MS)
        stage.link.wait_for("click")
        page.keyboard.press("PageUp", delay=HOLD_MS)
        expect(page.get_by_role("button", name="First floor: shown now")).to_be_visible()
        expect(page.get_by_role("button", name="Show ground floor: your mark is there")).to_be_visible()
        page.get_by_role("button", name="Show labels in the home").click()
        expect(page.get_by_role("button", name="Hide labels in the home")).to_be_visible()
        page.keyboard.press("PageDown", delay=HOLD_MS)
        expect(page.get_by_role("button", name="Ground floor: shown now")).to_be_visible()
        shown = [event.kind for event in stage.link.events() if event.kind in ("storey", "names_on")]
    assert shown == ["storey", "names_on", "storey"]


def click(page: Page, button: str) -> None:
    """Clicks a button and waits as for a held key: sessions drop presses within 50 ms, and the picture is quicker."""
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
        events = stage.link.events()
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


def test_the_servers_pictures_show_what_a_browser_would_draw_and_clicks_hit_the_same(
    home: Home, browser: BrowserContext
) -> None:
    pictures, hits = [], []
    for view in ("browser", "server"):
        drawn = dataclasses.replace(home, view=view)
        with staged(drawn, "pog", "map_open", pog={"conditions": ["map_open"]}) as stage:
            page = browser.new_page()
            page.goto(stage.url)
            expect(page.get_by_role("button", name="Confirm the mark")).to_be_visible()
            page.get_by_role("button", name="Left", exact=True).first.click()
            cam = resting_camera(page, stage.link.events)
            canvas = page.locator("canvas").first
            shown = Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")
            pictures.append(np.asarray(shown.resize((160, 120)), float))
            box = canvas.bounding_box()
            assert box is not None
            x, z = home.copies.middle(0)
            page.mouse.click(*pixel_of((x, home.copies.storeys[0], z), cam, box))
            hits += [event.hit for event in stage.link.wait_for("click") if isinstance(event, Clicked)]
            page.close()
    first, second = pictures
    assert np.abs(first - first.mean(axis=(0, 1))).mean() > 10, "there is something to see"
    assert np.abs(first - second).mean() < 6
    assert hits[0] is not None
    assert hits[1] == pytest.approx(hits[0], abs=0.02)
