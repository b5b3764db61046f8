"""The steps of a person in the browser on the way through a study, and the records of them."""

import contextlib
import math
import re
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, expect

from human_study.design.study import load_study
from human_study.journey import Person
from human_study.store.progress import PersonProgress, study_progress
from human_study.store.records import StoredTrial, read_study
from human_study.texts.quiz import questions_for
from human_study.trial.events import Act, Cam
from sim.frames import Rs_from_quats_xyzw
from sim.types import TaskKind

from .flow_studies import PlannedStudy

HOLD_MS = 100
"""Time for which a key or a mouse button is held, as by a person: of two presses within 50 ms, sessions drop the
second and viser sends one."""


VISER_VFOV = math.radians(75)
"""viser's initial vertical field of view, radians."""


def start(page: Page, link: str) -> None:
    """Opens a quick study and leaves its only page."""
    page.goto(link)
    page.get_by_role("button", name="Start", exact=True).click()


def record(study: PlannedStudy, code: str) -> tuple[Person, list[StoredTrial]]:
    """The records of a participant; the hash chains are checked too."""
    with read_study(study.folder) as reader:
        reader.check()
        return reader.participant(code), list(reader.trials(code))


def stages(study: PlannedStudy, code: str) -> list[str]:
    """Names of a participant's stages, oldest first."""
    return [entry.stage for entry in record(study, code)[0].stages]


def events(study: PlannedStudy, code: str, order_no: int) -> list:
    """Events of the newest attempt at a trial."""
    return events_in(study.folder, code, order_no)


def events_in(folder: Path, code: str, order_no: int, attempt: int = -1) -> list:
    """Events of an attempt at a trial, by default the newest."""
    with read_study(folder) as reader:
        trial_id = [trial.trial_id for trial in reader.trials(code) if trial.order_no == order_no][attempt]
        return [stored.event for stored in reader.events(trial_id)] if trial_id is not None else []


def acts(folder: Path, code: str, order_no: int = 1) -> list[Act]:
    """Stored steps of the newest attempt at a trial, after a check of the hash chains."""
    with read_study(folder) as reader:
        reader.check()
    return [event for event in events_in(folder, code, order_no) if isinstance(event, Act)]


def progress(folder: Path, code: str) -> PersonProgress:
    """How far a participant is, as `study status` reads it."""
    with read_study(folder) as reader:
        people = study_progress(reader, now_ns=time.time_ns()).people
    return next(person for person in people if person.code == code)


def come_to_the_trials(page: Page, study: PlannedStudy, code: str, task: TaskKind = "pan") -> None:
    """Does everything up to the first practice trial, by the keyboard alone."""
    page.goto(study.links[code])
    expect(page.get_by_text("Your window has room")).to_be_visible()
    if task == "pan":
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
    config = load_study(study.folder)
    for question in questions_for(config, task, config.conditions(task)):
        expect(page.get_by_text(question.text)).to_be_visible()
        press_by_keyboard(page, question.answers[0])
    press_by_keyboard(page, "Begin to practise")


def take_step(page: Page, number: int, key: str = "a") -> None:
    """Presses a key and waits for the step with this number."""
    page.keyboard.press(key, delay=HOLD_MS)
    see_step(page, number)


def see_step(page: Page, number: int) -> None:
    """Waits for counter and picture: a press before the picture is there is dropped as busy."""
    expect(page.get_by_text(f"Step {number} of 500")).to_be_visible()
    expect(page.get_by_alt_text("What the robot sees")).to_have_attribute("data-step", str(number))


def give_up(page: Page) -> int:
    """Ends a search without an answer; returns the number of presses."""
    button = page.get_by_role("button", name="Give up this search")
    return _end_search(page, button.click, "again to end this search", pause_ms=600)  # a double click is one press


def stop(page: Page) -> int:
    """Ends a walk by Enter; returns the number of presses."""
    enter = partial(page.keyboard.press, "Enter", delay=HOLD_MS)
    return _end_search(page, enter, "Press Enter or STOP again to finish")


def _end_search(page: Page, press: Callable[[], None], sign: str, *, pause_ms: float = 0) -> int:
    """Presses twice; begins anew, as a person would, if the browser stood still and the second press came too late.

    Returns the number of presses: each must be stored, as one that came too late is a first press again.
    """
    for tries in range(1, 6):
        press()
        expect(page.get_by_text(sign)).to_be_visible()
        page.wait_for_timeout(pause_ms)
        press()
        with contextlib.suppress(AssertionError):
            expect(page.get_by_role("button", name="Give up this search")).to_have_count(0, timeout=10_000)
            return 2 * tries
    raise AssertionError("the search goes on after five times two presses")


def point_somewhere(page: Page) -> None:
    """Clicks the home until a mark is there: it is drawn some time after it has arrived."""
    expect(page.get_by_text("Click the middle of the object")).to_be_visible()
    marked = page.get_by_text("Click again to move your mark")
    box = page.locator("canvas").last.bounding_box()
    for attempt in range(60):
        page.mouse.click(box["x"] + box["width"] * (0.4 + 0.01 * (attempt % 10)), box["y"] + box["height"] * 0.45)
        page.wait_for_timeout(500)
        if marked.count():
            return
    raise AssertionError("no click met the home")


def resting_camera(
    page: Page, told: Callable[[], list], is_there: Callable[[Cam], bool] = lambda _: True, *, rests_s: float = 1.0
) -> Cam:
    """The newest camera pose among these events, once it is where it should be and has rested for `rests_s`."""
    last, num_equal = None, 0
    for _ in range(240):
        page.wait_for_timeout(250)  # only waiting shows that no further pose comes
        cams = [event for event in told() if isinstance(event, Cam)]
        num_equal = num_equal + 1 if cams and cams[-1] == last and is_there(cams[-1]) else 0
        if num_equal == 4 * rests_s:
            return cams[-1]
        last = cams[-1] if cams else None
    raise AssertionError(f"found the camera at {last}; expected it at rest where the screen puts it")


def pixel_of(point: tuple[float, float, float], cam: Cam, box: dict[str, float]) -> tuple[float, float]:
    """Place of a world point on the page in pixels, seen by a stored camera."""
    R_world_camera = Rs_from_quats_xyzw(np.array([[*cam.wxyz[1:], cam.wxyz[0]]]))[0]
    x, y, z = R_world_camera.T @ (np.array(point) - np.array(cam.position))
    focal = box["height"] / 2 / math.tan(VISER_VFOV / 2)
    return box["x"] + box["width"] / 2 + focal * x / z, box["y"] + box["height"] / 2 + focal * y / z


def press_by_keyboard(page: Page, name: str) -> None:
    """Reaches a button with the Tab key and presses it with Enter."""
    expect(page.get_by_role("button", name=name, exact=True)).to_be_visible()
    page.wait_for_load_state()  # a page of the gateway has its style sheet then
    for _ in range(40):
        page.keyboard.press("Tab")
        focused = page.evaluate("document.activeElement.textContent.trim()")
        if focused == name:
            width = page.evaluate("parseFloat(getComputedStyle(document.activeElement).outlineWidth)")
            assert width >= 2, "the focus must be visible"
            page.keyboard.press("Enter", delay=HOLD_MS)
            return
    raise AssertionError(f"{name} cannot be reached with the Tab key")
