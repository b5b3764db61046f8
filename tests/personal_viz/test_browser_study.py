"""A participant in real Chromium: real keys, real clicks, and what can happen to a page; then the store is read."""

import math
import re

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.plan import load_plan
from human_study.design.study import load_study
from human_study.export.verify import verify_trial
from human_study.trial.events import Clicked, Dropped, Key, Reconnect
from personal_viz.study_app.home.trial_homes import open_trial_home
from personal_viz.study_app.page_script import LABEL
from sim.copies.cut import storey_mesh
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.tasks.run_files import Answer
from sim.types import Action, TaskKind
from sim.walk.storeys import storey_of

from .flow_steps import (
    HOLD_MS,
    acts,
    events,
    events_in,
    give_up,
    pixel_of,
    record,
    resting_camera,
    see_step,
    stages,
    start,
    take_step,
)
from .flow_studies import Line, PlannedStudy
from .gateways import wait_until

pytestmark = pytest.mark.browser


def arrived(study: PlannedStudy, browser: BrowserContext, task: TaskKind = "pan") -> tuple[Page, str]:
    """The page of a newcomer whose first trial has begun, and the newcomer's code."""
    code, page = study.newcomer(task), browser.new_page()
    start(page, study.links[code])
    if task == "pan":
        see_step(page, 0)
        expect(page.get_by_text(LABEL)).to_be_hidden()  # the page has heard of the participant's keys
    return page, code


def actions(study: PlannedStudy, code: str) -> list[Action]:
    """Actions of the stored steps of a participant's first trial."""
    return [act.action for act in acts(study.folder, code)]


def test_a_held_key_is_one_step_and_a_reload_resumes_at_the_same_step(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    page, code = arrived(quick_study, browser)
    for _ in range(6):  # Playwright marks all but the first as repeats until keyup
        page.keyboard.down("a")
    page.keyboard.up("a")
    see_step(page, 1)
    page.get_by_role("button", name="Turn right").click()
    see_step(page, 2)
    before = page.get_by_alt_text("What the robot sees").get_attribute("src")
    page.reload()
    see_step(page, 2)
    assert page.get_by_alt_text("What the robot sees").get_attribute("src") == before
    stored = events(quick_study, code, 1)
    assert actions(quick_study, code) == [Action.LEFT, Action.RIGHT]
    assert sum(isinstance(event, Key) for event in stored) - sum(isinstance(event, Dropped) for event in stored) == 2


def test_a_pog_trial_with_real_clicks(quick_study: PlannedStudy, browser: BrowserContext) -> None:
    code = quick_study.newcomer("pog")
    plan, dataset = load_plan(quick_study.folder, load_study(quick_study.folder)), PersonalDataset(quick_study.dataset)
    episode = dataset.episode(plan.participant(code).trials[0].key)
    scene = open_scene(dataset, episode.key.scene)
    target, storeys = episode.targets[0], scene.navigation.storey_heights
    storey = storey_of(target.floor_y, [(height, height) for height in storeys])
    page = browser.new_page()
    start(page, quick_study.links[code])
    expect(page.get_by_text(episode.record.query[0])).to_be_visible()
    page.get_by_role("button", name=re.compile(rf"storey {storey + 1} of", re.IGNORECASE)).click()
    cam = resting_camera(page, lambda: events(quick_study, code, 1), rests_s=2.0)
    box = page.locator("canvas").last.bounding_box()
    page.mouse.click(*pixel_of(target.position, cam, box))
    expect(page.get_by_text("Click again to move your mark, or confirm it.")).to_be_visible()
    page.get_by_role("button", name="Confirm the mark").click()
    expect(page.get_by_role("heading", name="Saved")).to_be_visible()
    assert page.get_by_text(re.compile("success|correct|right answer", re.IGNORECASE)).count() == 0

    stored, trial = events(quick_study, code, 1), record(quick_study, code)[1][0]
    clicked = [event for event in stored if isinstance(event, Clicked)][-1]
    assert isinstance(trial.outcome, Answer)
    assert trial.outcome.candidates == (clicked.hit,)
    assert math.dist(clicked.hit, ray_meets(scene, storeys[storey], clicked)) < 1e-3
    assert trial.outcome.measures.success
    home = open_trial_home(dataset, plan.scene(scene.name), None)
    assert verify_trial(stored, trial.outcome, episode.key, home=home, participant=code).status == "verified"


def ray_meets(scene: Scene, floor_y: float, clicked: Clicked) -> NDArray[np.float64]:
    """Where a stored ray meets the cut storey first, by Moeller and Trumbore's formula instead of our raycaster."""
    mesh = storey_mesh(scene, floor_y)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(float) for corner in range(3))
    origin, direction = np.array(clicked.ray.origin), np.array(clicked.ray.direction)
    normal = np.cross(direction, c - a)
    scale = np.einsum("ij,ij->i", b - a, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", origin - a, normal) / scale
        side = np.cross(origin - a, b - a)
        v = side @ direction / scale
        t = np.einsum("ij,ij->i", c - a, side) / scale
    hit = (np.abs(scale) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return origin + t[hit].min() * direction


def test_leaving_in_the_middle_of_a_trial_deletes_what_was_done(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    page, code = arrived(quick_study, browser)
    take_step(page, 1)
    page.get_by_role("button", name="Leave the study").click()
    expect(page.get_by_text("will be deleted and cannot be brought back")).to_be_visible()
    page.get_by_role("button", name="No, go on").click()
    take_step(page, 2)
    page.get_by_role("button", name="Leave the study").click()
    page.get_by_role("button", name="Yes, leave the study").click()
    expect(page.get_by_role("heading", name="You have left the study")).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="You have left the study")).to_be_visible()
    person, trials = record(quick_study, code)
    assert person.is_withdrawn
    assert all(trial.is_shredded for trial in trials if trial.trial_id is not None)


def press_place(page: Page, code: str, key: str) -> None:
    """Presses a key, given by its place on the keyboard (code) and the letter that the layout gives it."""
    page.evaluate(
        """([code, key]) => document.body.dispatchEvent(
            new KeyboardEvent('keydown', {code: code, key: key, bubbles: true, cancelable: true}))""",
        [code, key],
    )
    page.wait_for_timeout(HOLD_MS)


def test_the_time_of_a_press_arrives_on_a_busy_page(quick_study: PlannedStudy, browser: BrowserContext) -> None:
    page, code = arrived(quick_study, browser)
    page.evaluate(
        """() => {
            const key = (code) => new KeyboardEvent('keydown', {code: code, bubbles: true});
            const press = (code) => document.body.dispatchEvent(key(code));
            press('KeyA');
            press('KeyD');
            for (const end = performance.now() + 300; performance.now() < end;);
            press('KeyW');
        }"""
    )

    def keys() -> list[Key]:
        return [event for event in events(quick_study, code, 1) if isinstance(event, Key)]

    wait_until(lambda: len(keys()) == 3)
    assert [key.code for key in keys()] == ["KeyA", "KeyD", "KeyW"]
    left, right, forward = [key.t_cli_ms for key in keys()]
    assert left is not None
    assert right is not None
    assert forward is not None
    assert left <= right <= forward - 300


def test_keys_are_places_on_the_keyboard_and_can_be_chosen(quick_study: PlannedStudy, browser: BrowserContext) -> None:
    page, code = arrived(quick_study, browser)
    press_place(page, "KeyQ", "a")  # AZERTY: the letter A stands where Q is on other keyboards
    press_place(page, "KeyA", "q")
    see_step(page, 1)
    press_place(page, "KeyD", "\u0432")  # Cyrillic
    see_step(page, 2)
    press_place(page, "KeyA", "A")  # CapsLock
    see_step(page, 3)

    page.get_by_role("button", name="Keys", exact=True).click()
    page.get_by_role("button", name="Change the key of: Turn left").click()
    page.keyboard.press("j", delay=HOLD_MS)
    expect(page.get_by_text("Saved.", exact=True)).to_be_visible()
    page.get_by_role("button", name="Change the key of: Turn right").click()
    page.keyboard.press("j", delay=HOLD_MS)
    expect(page.get_by_text("already used for: Turn left")).to_be_visible()
    page.get_by_role("button", name="Close").click()
    page.keyboard.press("a", delay=HOLD_MS)
    take_step(page, 4, "j")
    expect(page.get_by_role("button", name="Turn left (J)")).to_be_visible()
    page.reload()
    see_step(page, 4)
    expect(page.get_by_role("button", name="Turn left (J)")).to_be_visible()
    expect(page.get_by_text(LABEL)).to_be_hidden()  # the script hides it when it has heard of the participant's keys
    take_step(page, 5, "j")

    assert actions(quick_study, code) == [Action.LEFT, Action.RIGHT, Action.LEFT, Action.LEFT, Action.LEFT]
    pressed = [event for event in events(quick_study, code, 1) if isinstance(event, Key)]
    assert [event.code for event in pressed] == ["KeyA", "KeyD", "KeyA", "KeyJ", "KeyJ"]
    times = [event.t_cli_ms for event in pressed[:4]]
    assert times == sorted(time for time in times if time is not None)
    assert "keys_changed" in stages(quick_study, code)


def test_the_newest_tab_drives_and_the_back_button_and_a_copied_tab_count_no_step_twice(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    code = quick_study.newcomer("pan")
    page = browser.new_page()
    page.goto("about:blank")
    start(page, quick_study.links[code])
    see_step(page, 0)
    take_step(page, 1)
    page.go_back()
    page.go_forward()
    see_step(page, 1)
    copy = browser.new_page()
    copy.goto(page.url)
    see_step(copy, 1)
    page.bring_to_front()
    expect(page.get_by_text("This page is no longer used")).to_be_visible()
    page.keyboard.press("w", delay=HOLD_MS)
    copy.bring_to_front()
    take_step(copy, 2, "d")
    assert actions(quick_study, code) == [Action.LEFT, Action.RIGHT]


def test_a_form_is_sent_when_the_server_answers_whatever_the_browser_says_of_the_network(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    code = quick_study.newcomer("pan")
    address, token = quick_study.links[code].split("/#")
    line = Line(int(address.rsplit(":")[-1]))
    browser.grant_permissions(["clipboard-read", "clipboard-write"])
    browser.add_init_script("Object.defineProperty(Navigator.prototype, 'onLine', { get: () => false })")
    try:
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{line.port}/#{token}")
        begin, offline = page.get_by_role("button", name="Start", exact=True), page.locator("[data-offline]")
        # The script that asks the server first shows this; before it has come, the browser sends the form by itself.
        expect(page.get_by_role("button", name="Larger text")).to_be_visible()
        line.cut()
        begin.click()
        expect(offline).to_have_text(re.compile("^No connection."))
        expect(begin).to_be_visible()
        line.mend()
        expect(offline).to_be_hidden()  # by itself
        begin.click()
        see_step(page, 0)
        expect(page).to_have_title(re.compile("^Search 1 of 2 .* - PersONAL study$"))
        give_up(page)
        page.get_by_role("button", name="Next search").click()
        see_step(page, 0)
        give_up(page)
        expect(page).to_have_title("Thank you! - PersONAL study")
        page.get_by_role("button", name="Copy the code").click()
        expect(page.locator("[data-copied]")).to_have_text("The code is copied.")
        assert page.evaluate("navigator.clipboard.readText()") == page.get_by_label("Completion code").inner_text()
    finally:
        line.close()


def test_a_lost_connection_is_announced_and_the_trial_goes_on_at_the_same_step(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    code = quick_study.newcomer("pan")
    address, token = quick_study.links[code].split("/#")
    line = Line(int(address.rsplit(":")[-1]))
    try:
        page = browser.new_page()
        start(page, f"http://127.0.0.1:{line.port}/#{token}")
        see_step(page, 0)
        take_step(page, 1)
        line.cut()
        expect(
            page.get_by_role("alert").filter(has_text="No connection. Presses of the last seconds may not have counted")
        ).to_be_visible(timeout=60_000)
        expect(page.get_by_alt_text("What the robot sees")).to_be_visible()  # the last picture stays
        page.keyboard.press("a", delay=HOLD_MS)  # reaches nobody, and must not count when the line is back
        line.mend()
        expect(
            page.get_by_role("alert").filter(has_text="No connection. Presses of the last seconds may not have counted")
        ).to_be_hidden(timeout=60_000)
        see_step(page, 1)
        expect(page.get_by_alt_text("What the robot sees")).to_be_visible()
        take_step(page, 2)
        assert actions(quick_study, code) == [Action.LEFT, Action.LEFT]
        assert any(isinstance(event, Reconnect) for event in events(quick_study, code, 1))
    finally:
        line.close()


def test_a_lost_3d_picture_ends_the_trial_as_technical_and_it_comes_again(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    page, code = arrived(quick_study, browser, "pog")
    expect(page.get_by_role("button", name="Give up this search")).to_be_visible()  # the instructions have none
    expect(page.locator("canvas").last).to_be_visible()
    page.evaluate(
        """() => { const canvas = [...document.querySelectorAll('canvas')].pop();
        canvas.getContext('webgl2').getExtension('WEBGL_lose_context').loseContext(); }"""
    )
    expect(page.get_by_role("heading", name="The 3-D picture was lost")).to_be_visible()
    page.get_by_role("button", name="Load the page again").click()
    expect(page.get_by_text("Click the middle of the object")).to_be_visible()
    trials = [trial for trial in record(quick_study, code)[1] if trial.trial_id is not None]
    lost = events_in(quick_study.folder, code, trials[0].order_no, attempt=0)
    assert any(event.kind == "context_lost" for event in lost)
    assert trials[0].outcome.reason == "technical"
    assert [trial.attempt for trial in trials] == [1, 2]
    assert trials[0].key == trials[1].key


def test_graphics_that_are_lost_before_the_page_has_begun_load_it_again(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    code, page, loaded = quick_study.newcomer("pan"), browser.new_page(), list[str]()
    page.on("request", lambda request: loaded.append(request.url) if "/view/?" in request.url else None)
    page.add_init_script(
        """const own = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
            const context = own.call(this, kind, ...more);
            if (context && kind === 'webgl2' && this.isConnected && !sessionStorage.getItem('lost')) {
                sessionStorage.setItem('lost', 'once');
                context.getExtension('WEBGL_lose_context').loseContext();
            }
            return context;
        };"""
    )
    start(page, quick_study.links[code])
    see_step(page, 0)
    assert len(loaded) == 2
