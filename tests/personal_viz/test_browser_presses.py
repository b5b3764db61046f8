"""Every button of the trial screens, pressed twice at one pixel: nothing moves, and no other button is met."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from human_study.design.study import Condition
from human_study.trial.events import Shown
from personal_viz.study_app.home import homes as homes_module
from personal_viz.study_app.home.homes import Home
from sim.types import TaskKind

from .fake_play import EmptySurface, MemoryLink, meshless_home
from .flow_steps import HOLD_MS, see_step
from .stage import Stage, staged

pytestmark = pytest.mark.browser


SIZES = ((1000, 600), (1280, 720), (1366, 768), (1600, 900), (1920, 1080))
"""The first is the smallest that the device check lets pass."""
_ENDING = ("STOP", "Give up", "Confirm")
_NAMES = ("Highlight names", "Remove highlights")
_TOOLS = ("Keys", "Larger text", "Leave the study")
_BUTTONS = """() => [...document.querySelectorAll('button')].filter((button) => button.offsetParent).map((button) => {
    const box = button.getBoundingClientRect();
    return { label: button.textContent.trim(), at: [box.x, box.y, box.width, box.height] };
})"""
_SCROLL_TO = """(number) => [...document.querySelectorAll('button')].filter((button) => button.offsetParent)[number]
    .scrollIntoView({ block: 'center' })"""
_IN_VIEW = """(element) => {
    const box = element.getBoundingClientRect();
    const met = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
    const isInside = box.left >= 0 && box.top >= 0 && box.right <= innerWidth && box.bottom <= innerHeight;
    return isInside && element.contains(met);
}"""
_SCROLL_PANEL = """(share) => { for (const view of document.querySelectorAll('.mantine-ScrollArea-viewport'))
    view.scrollTop = share * view.scrollHeight; }"""
_NUM_SCROLLING = """() => [...document.querySelectorAll('*')].filter((element) =>
    /auto|scroll/.test(getComputedStyle(element).overflowY) && element.scrollHeight > element.clientHeight).length"""
_LETTERS_IN_LINE = """(paragraph) => {
    const pen = document.createElement('canvas').getContext('2d'), text = paragraph.textContent;
    pen.font = getComputedStyle(paragraph).font;
    return paragraph.clientWidth / (pen.measureText(text).width / text.length);
}"""
_KEEP_PRESSED = """() => { window.met = []; window.addEventListener('click', (event) => {
    window.met.push(event.target instanceof Element && event.target.closest('button')); }, true); }"""
_MET_TWICE = "() => window.met.length > 1 && window.met.at(-1) !== null && window.met.at(-1) === window.met.at(-2)"


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch) -> Home:
    """A home without a mesh, because only the buttons beside it are tested; its thing has a long name."""
    monkeypatch.setattr(homes_module, "SceneView", EmptySurface)
    return meshless_home(category="chest of drawers with two glass doors")


@dataclass(frozen=True, slots=True)
class Button:
    """A button and its place, pixels of the window."""

    label: str
    at: tuple[float, float, float, float]
    """x, y, width, height."""

    @property
    def middle(self) -> tuple[float, float]:
        """The point at which a person presses it."""
        x, y, width, height = self.at
        return x + width / 2, y + height / 2


def buttons(page: Page) -> list[Button]:
    """All that can be seen now, in the page's order."""
    return [Button(found["label"], tuple(found["at"])) for found in page.evaluate(_BUTTONS)]


def scrolled_to(page: Page, number: int) -> list[Button]:
    """All buttons, after the panel was scrolled, if it must be, so that this one can be pressed."""
    page.evaluate(_SCROLL_TO, number)
    return buttons(page)


def rectangles(page: Page) -> list[tuple[float, float, float, float]]:
    """Of all buttons."""
    return [button.at for button in buttons(page)]


def events_of(link: MemoryLink, *kinds: str) -> int:
    """Number of stored events of these kinds."""
    return sum(event.kind in kinds for event in link.events())


def press_twice(page: Page, stage: Stage, number: int) -> None:
    """Presses a button that ends nothing, two times at one pixel; the second waits for what the first has led to."""
    before = scrolled_to(page, number)
    link, kinds = stage.link, ("act", "storey", "click")
    is_answered = number not in cameras(before) and before[number].label not in _NAMES
    for _ in range(2):
        num_answers = events_of(link, *kinds)
        page.mouse.click(*before[number].middle, delay=HOLD_MS)
        if is_answered:
            with link.changed:
                assert link.changed.wait_for(lambda seen=num_answers: events_of(link, *kinds) > seen, timeout=30)
            if link.trial.task == "pan":
                see_step(page, events_of(link, "act"))
        assert rectangles(page) == [button.at for button in before], before[number].label
    assert page.evaluate(_MET_TWICE), before[number].label


def cameras(found: Sequence[Button]) -> range:
    """Numbers of the buttons that turn the view, of which nothing is stored at once."""
    first = max((number + 1 for number, button in enumerate(found) if "torey 2 of 2" in button.label), default=0)
    return range(first, first + 6 if first else 0)


def press_tools(page: Page) -> None:
    """Presses the page's own buttons: a window that opens is not over them, and larger text leaves them in place."""
    for button in buttons(page):
        if button.label in ("Keys", "Leave the study"):
            page.mouse.click(*button.middle, delay=HOLD_MS)
            expect(page.get_by_role("dialog")).to_be_visible()
            page.mouse.click(*button.middle, delay=HOLD_MS)
            assert page.evaluate("() => window.met.at(-1) === null"), button.label
            expect(page.get_by_role("dialog")).to_be_visible()
            page.locator("dialog [data-key=close]").click(delay=HOLD_MS)
            expect(page.get_by_role("dialog")).to_have_count(0)
        elif button.label == "Larger text":
            before = rectangles(page)
            page.mouse.click(*button.middle, delay=HOLD_MS)
            assert button.at in rectangles(page)
            page.mouse.click(*button.middle, delay=HOLD_MS)
            assert page.evaluate(_MET_TWICE), button.label
            assert [at[2:] for at in rectangles(page)] == [at[2:] for at in before]


def end_twice(page: Page, stage: Stage, label: str, kind: Literal["stop", "giveup"]) -> None:
    """Ends the trial by a button that asks once more, at one pixel; then the next one begins."""
    number = next(index for index, button in enumerate(buttons(page)) if button.label.startswith(label))
    before = scrolled_to(page, number)
    page.mouse.click(*before[number].middle, delay=HOLD_MS)
    expect(page.get_by_role("button", name=f"{label}: press again")).to_be_visible()
    expect(page.get_by_role("alert").filter(has_text="again to")).to_be_visible()
    assert rectangles(page) == [button.at for button in before], label
    page.wait_for_timeout(550)  # a person's pace: of a double click on "Give up" the second press does not count
    page.mouse.click(*before[number].middle, delay=HOLD_MS)
    stage.link.wait_for_outcome()
    assert stage.link.events()[-1].kind == kind
    assert page.evaluate(_MET_TWICE), label
    go_on(page)


def confirm_twice(page: Page, stage: Stage) -> None:
    """Confirms a mark with a double click: it is the answer, and the next screen stays as it is."""
    page.get_by_role("button", name="Right", exact=True).last.click(delay=HOLD_MS)
    stage.link.wait_for("click")
    page.get_by_role("button", name="Confirm the mark").dblclick()
    stage.link.wait_for_outcome()
    assert stage.link.events()[-1].kind == "confirm"
    go_on(page)


def go_on(page: Page) -> None:
    """Goes from the notice after a trial to the next trial; the second press of a double click meets no new button."""
    page.get_by_role("button", name="Once more").click(delay=HOLD_MS)
    expect(page.get_by_role("button", name="Begin")).to_be_visible()
    page.mouse.down(click_count=2)
    page.mouse.up(click_count=2)
    assert page.evaluate("() => window.met.at(-1).textContent.trim()") == "Begin"
    page.get_by_role("button", name="Begin").click(delay=HOLD_MS)
    expect(page.get_by_role("button", name="Give up this search")).to_be_visible()


def set_up(page: Page, size: tuple[int, int], *, large: bool) -> None:
    """Sets the size of the window and of the text."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.evaluate("(large) => document.documentElement.classList.toggle('personal-large', large)", large)
    page.wait_for_function("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.mark.parametrize(
    ("task", "condition", "choices", "sizes"),
    [
        ("pan", "none", {}, SIZES),
        ("pog", "map_open", {}, SIZES),
        ("pog", "map_open", {"pog": {"conditions": ["map_open"], "pointing": "snap"}}, SIZES[:1]),
    ],
    ids=["pan", "pog", "pog snap"],
)
def test_no_second_press_meets_another_button(
    home: Home,
    browser: BrowserContext,
    task: TaskKind,
    condition: Condition,
    choices: dict[str, Any],
    sizes: Sequence[tuple[int, int]],
) -> None:
    page = browser.new_page()
    with staged(home, task, condition, again=True, **choices) as stage:
        page.goto(stage.url)
        page.evaluate(_KEEP_PRESSED)
        expect(page.get_by_role("button", name="Give up this search")).to_be_visible()
        for size, large in (*((size, False) for size in sizes), (sizes[0], True)):
            set_up(page, size, large=large)
            labels = [button.label for button in buttons(page)]
            for number, label in enumerate(labels):
                if not label.startswith(_ENDING + _TOOLS):
                    press_twice(page, stage, number)
            press_tools(page)
            end_twice(page, stage, "Give up this search", "giveup")
            if task == "pan":
                end_twice(page, stage, "STOP here", "stop")
            else:
                confirm_twice(page, stage)


@pytest.mark.parametrize(
    ("task", "condition", "ending"), [("pan", "none", "STOP here"), ("pog", "map_open", "Confirm the mark")]
)
def test_the_query_and_the_buttons_that_end_a_search_are_always_in_view(
    home: Home, browser: BrowserContext, task: TaskKind, condition: Condition, ending: str
) -> None:
    page = browser.new_page()
    with staged(home, task, condition) as stage:
        page.goto(stage.url)
        needed = [page.get_by_role("button", name=name) for name in (ending, "Give up this search")]
        needed.append(page.locator(".personal-query"))
        expect(needed[0]).to_be_visible()
        for font, large in (("100%", False), ("100%", True), ("200%", False)):
            page.evaluate("(size) => { document.documentElement.style.fontSize = size; }", font)
            set_up(page, (1024, 700), large=large)
            for share in (0, 1):
                page.evaluate(_SCROLL_PANEL, share)
                found = [element.evaluate(_IN_VIEW) for element in needed]
                assert found == [True] * 3, (font, large, share)
            assert page.evaluate(_NUM_SCROLLING) <= 1, (font, large)
            assert page.locator(".personal-description p").evaluate(_LETTERS_IN_LINE) <= 90, (font, large)
            assert [button for button in buttons(page) if button.at[3] < 32] == [], (font, large)


def test_a_blocked_step_says_so_and_bumps_the_picture_and_moves_nothing(home: Home, browser: BrowserContext) -> None:
    page = browser.new_page()
    picture, sign = page.get_by_alt_text("What the robot sees"), page.get_by_text("Blocked: something is in the way")
    moving = "(picture) => getComputedStyle(picture).animationName"
    with staged(home, "pan", "none") as stage:
        page.goto(stage.url)
        for step in range(6):
            expect(picture).to_have_attribute("data-step", str(step))
            expect(sign).to_have_count(int(step > 3))
            assert picture.evaluate(moving) == ("personal-bump" if step > 3 else "none")
            if step == 3:
                before = rectangles(page)
            page.keyboard.press("w" if step < 5 else "a", delay=HOLD_MS)
        expect(sign).to_have_count(0)
        assert rectangles(page) == before
        page.emulate_media(reduced_motion="reduce")
        for step, key in ((6, "d"), (7, "w")):
            expect(picture).to_have_attribute("data-step", str(step))
            page.keyboard.press(key, delay=HOLD_MS)
        expect(sign).to_be_visible()
        assert picture.evaluate(moving) == "none"
        page.keyboard.press("a", delay=HOLD_MS)  # that a picture was shown is stored with the next step
        expect(picture).to_have_attribute("data-step", "9")
        events = stage.link.events()
    assert [event.step for event in events if isinstance(event, Shown) and event.blocked] == [4, 5, 8]
