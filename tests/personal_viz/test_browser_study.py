"""A participant in real Chromium on the invented home: real keys, real clicks, then the store against the simulator."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.plan import StudyPlan
from human_study.export.verify import TrialHome, verify_trial
from human_study.store.records import StoredTrial, read_study
from human_study.trial.events import Act, Cam, Clicked, Dropped, Key
from sim.copies.cut import storey_mesh
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.tasks.agents import ShortestPathAgent
from sim.tasks.pan import PanEnv
from sim.tasks.rules import scene_storeys
from sim.tasks.run_files import Answer, EpisodeEnd
from sim.types import PAPER4, Action, EpisodeKey
from sim.walk.storeys import storey_of

from .flow_steps import HOLD_MS
from .flow_studies import PlannedStudy

pytestmark = pytest.mark.browser
KEYS = {Action.FORWARD: "w", Action.LEFT: "ArrowLeft", Action.RIGHT: "d"}
VISER_VFOV = math.radians(75)
"""viser's vertical field of view at first, radians."""


def home_of(study: PlannedStudy, code: str) -> tuple[Episode, Scene, PersonalDataset]:
    """The first episode of a participant's plan, and the home."""
    plan = StudyPlan.model_validate_json((study.folder / "plan.json").read_bytes())
    trial = next(person for person in plan.participants if person.code == code).trials[0]
    dataset = PersonalDataset(study.folder.parent / "dataset")
    episode = dataset.episode(EpisodeKey(trial.split, trial.scene, trial.episode_id))
    return episode, open_scene(dataset, trial.scene), dataset


def way_to_the_target(episode: Episode, scene: Scene) -> list[Action]:
    """Actions of the shortest-path agent, STOP left out."""
    env = PanEnv(episode.start, scene.navigation, renderer=None)
    agent = ShortestPathAgent(episode, scene.navigation)
    agent.reset(episode.task("pan", actions=PAPER4), env.camera, seed=0)
    observation = env.reset()
    actions = []
    while (action := agent.act(observation)) is not Action.STOP:
        actions.append(action)
        observation = env.step(action)
    return actions


def first_trial(folder: Path, code: str) -> tuple[StoredTrial, list]:
    """A participant's first trial and its events, as stored."""
    with read_study(folder) as reader:
        reader.check()
        status = reader.trials(code)[0]
        assert status.trial_id is not None
        return status, [stored.event for stored in reader.events(status.trial_id)]


def verified(status: StoredTrial, events: list, episode: Episode, scene: Scene, dataset: PersonalDataset) -> str:
    """What doing the stored trial again says."""
    assert status.outcome is not None
    storeys = scene_storeys(dataset.goals(scene.name).values())
    home = TrialHome(scene.navigation, scene.digest, storeys, lambda _: episode)
    return verify_trial(events, status.outcome, episode.key, home=home, participant=status.code).status


def begin(page: Page, link: str) -> None:
    """Opens the personal link and presses Start."""
    page.goto(link)
    page.get_by_role("button", name="Start").click()


def see_step(page: Page, number: int) -> None:
    """Waits for the counter and the picture of a step: a key that comes before the picture counts as busy."""
    expect(page.get_by_text(f"Step {number} of 500")).to_be_visible()
    expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", str(number))


def test_a_pan_trial_with_real_key_presses(quick_study: PlannedStudy, browser: BrowserContext) -> None:
    code = quick_study.newcomer("pan")
    episode, scene, dataset = home_of(quick_study, code)
    actions = way_to_the_target(episode, scene)
    page = browser.new_page()
    begin(page, quick_study.links[code])
    see_step(page, 0)
    expect(page.get_by_text(episode.record.query[0])).to_be_visible()
    image = page.get_by_alt_text("What the robot sees")
    expect(image).to_have_js_property("naturalWidth", 640)
    for number, action in enumerate(actions, start=1):
        page.keyboard.press(KEYS[action], delay=HOLD_MS)
        see_step(page, number)
    page.keyboard.press("Enter", delay=HOLD_MS)
    expect(page.get_by_text("Press Enter or STOP again to finish")).to_be_visible()
    page.keyboard.press("Enter", delay=HOLD_MS)
    expect(page.get_by_role("heading", name="Saved")).to_be_visible()
    assert page.get_by_text(re.compile("success|correct|right answer", re.IGNORECASE)).count() == 0

    status, events = first_trial(quick_study.folder, code)
    acts = [event for event in events if isinstance(event, Act)]
    assert [act.action for act in acts] == [*actions, Action.STOP]
    env = PanEnv(episode.start, scene.navigation, renderer=None)
    for act in acts:
        env.step(act.action)
        assert act.position == pytest.approx(env.pose.position, abs=1e-9)
        assert act.yaw == pytest.approx(env.pose.yaw, abs=1e-9)
    assert isinstance(status.outcome, EpisodeEnd)
    assert status.outcome.measures is not None
    assert status.outcome.measures.rules["paper"].success
    assert verified(status, events, episode, scene, dataset) == "verified"


def test_a_held_key_is_one_step_and_a_reload_resumes_at_the_same_step(
    quick_study: PlannedStudy, browser: BrowserContext
) -> None:
    code = quick_study.newcomer("pan")
    page = browser.new_page()
    begin(page, quick_study.links[code])
    see_step(page, 0)
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
    _, events = first_trial(quick_study.folder, code)
    assert [event.action for event in events if isinstance(event, Act)] == [Action.LEFT, Action.RIGHT]
    assert sum(isinstance(event, Key) for event in events) - sum(isinstance(event, Dropped) for event in events) == 2


def test_the_newest_tab_drives_and_the_older_one_says_so(quick_study: PlannedStudy, browser: BrowserContext) -> None:
    code = quick_study.newcomer("pan")
    old = browser.new_page()
    begin(old, quick_study.links[code])
    see_step(old, 0)
    new = browser.new_page()
    new.goto(quick_study.links[code])
    see_step(new, 0)
    old.bring_to_front()
    expect(old.get_by_text("This page is no longer used")).to_be_visible()
    old.keyboard.press("w", delay=HOLD_MS)
    new.bring_to_front()
    new.keyboard.press("a", delay=HOLD_MS)
    see_step(new, 1)
    _, events = first_trial(quick_study.folder, code)
    assert [event.action for event in events if isinstance(event, Act)] == [Action.LEFT]


def pixel_of(point: tuple[float, float, float], cam: Cam, box: dict[str, float]) -> tuple[float, float]:
    """Where a world point is on the page, seen by a stored camera."""
    w, x, y, z = cam.wxyz
    R_world_camera = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    p_camera = R_world_camera.T @ (np.array(point) - np.array(cam.position))
    focal = box["height"] / 2 / math.tan(VISER_VFOV / 2)
    return (
        box["x"] + box["width"] / 2 + focal * p_camera[0] / p_camera[2],
        box["y"] + box["height"] / 2 + focal * p_camera[1] / p_camera[2],
    )


def test_a_pog_trial_with_real_clicks(quick_study: PlannedStudy, browser: BrowserContext) -> None:
    code = quick_study.newcomer("pog")
    episode, scene, dataset = home_of(quick_study, code)
    page = browser.new_page()
    begin(page, quick_study.links[code])
    expect(page.get_by_text(episode.record.query[0])).to_be_visible()
    target = episode.targets[0]
    storeys = scene.navigation.storey_heights
    storey = storey_of(target.floor_y, [(height, height) for height in storeys])
    page.get_by_role("button", name=f"Show storey {storey + 1}").click()
    canvas = page.locator("canvas").last
    cam = wait_for_camera(page, quick_study.folder, code)
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.click(*pixel_of(target.position, cam, box))
    expect(page.get_by_text("Click again to move your mark, or confirm it.")).to_be_visible()
    page.get_by_role("button", name="Confirm the mark").click()
    expect(page.get_by_role("heading", name="Saved")).to_be_visible()
    assert page.get_by_text(re.compile("success|correct|right answer", re.IGNORECASE)).count() == 0

    status, events = first_trial(quick_study.folder, code)
    clicked = [event for event in events if isinstance(event, Clicked)][-1]
    assert isinstance(status.outcome, Answer)
    assert status.outcome.candidates == (clicked.hit,)
    assert clicked.hit is not None
    assert math.dist(clicked.hit, ray_meets(scene, storeys[storey], clicked)) < 1e-3
    assert status.outcome.measures is not None
    assert status.outcome.measures.success
    assert verified(status, events, episode, scene, dataset) == "verified"


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


def wait_for_camera(page: Page, folder: Path, code: str) -> Cam:
    """The last stored camera pose, once it has been the same for two seconds: poses are stored twice a second."""
    last, num_equal = None, 0
    for _ in range(200):
        page.wait_for_timeout(250)
        _, events = first_trial(folder, code)
        cams = [event for event in events if isinstance(event, Cam)]
        num_equal = num_equal + 1 if cams and cams[-1] == last else 0
        if cams and num_equal == 8:
            return cams[-1]
        last = cams[-1] if cams else None
    raise AssertionError("the browser never told its camera")
