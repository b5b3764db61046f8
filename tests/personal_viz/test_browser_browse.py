"""The researchers' browser in real Chromium on an invented home: filter, next, graph to home by mouse, and back."""

import re
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest
import viser
from playwright.sync_api import BrowserContext, Page, expect

from human_study.trial.events import Cam
from personal_viz.browse import visitor
from personal_viz.browse.app import browser_app
from personal_viz.browse.layers import Layers, OnObject, Outlined
from personal_viz.browse.library import Library, Wanted, open_library
from personal_viz.cli import browse as browse_verb
from personal_viz.cli.browse import Browse
from personal_viz.cli.runs.run import Run
from sim.episodes.ownership import ownership_graph
from sim.errors import PersonalVizError

from .flow_steps import pixel_of
from .invented import invented_dataset

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An invented home with three episodes, of which the shortest-path agent has walked the first one."""
    root = tmp_path_factory.mktemp("browse")
    invented_dataset(root / "data", name="Demo", seed=7, episodes_per_split=1)
    Run(
        agent="shortest-path", dataset=root / "data", out=root / "runs", split=("easy",), limit=1, run_id="walked"
    ).run()
    return root


class Marks(NamedTuple):
    """The marks that the 3-D view of the newest browser was told, and the browser."""

    outlined: list[list[Outlined]]
    clients: list[viser.ClientHandle]


@pytest.fixture
def marks(monkeypatch: pytest.MonkeyPatch) -> Marks:
    """Fills up while browsers are served."""
    found = Marks([], [])

    class Noted(Layers):
        def __init__(self, client: viser.ClientHandle, on_object: OnObject) -> None:
            found.clients.append(client)
            super().__init__(client, on_object)

        def mark(self, objects: Sequence[Outlined]) -> None:
            found.outlined.append(list(objects))
            super().mark(objects)

    monkeypatch.setattr(visitor, "Layers", Noted)
    return found


@pytest.fixture(scope="module")
def served(made: Path) -> Iterator[tuple[Library, str]]:
    """The library and the address."""
    library = open_library(made / "data", runs=(made / "runs" / "walked",))
    with browser_app(library) as address:
        yield library, address


def opened(browser: BrowserContext, address: str) -> Page:
    """A page that shows its first home."""
    page = browser.new_page()
    page.goto(f"{address}?fixedDpr=0.1")  # Chromium draws without a graphics card here
    expect(page.locator(".bw.home")).to_contain_text("invented home", timeout=120_000)
    return page


def until(page: Page, holds) -> None:
    """Waits for something that happens in this process."""
    for _ in range(200):
        if holds():
            return
        page.wait_for_timeout(100)
    raise AssertionError("the condition never came true")


def test_filter_keys_list_and_slider_lead_through_episodes_and_a_run(
    served: tuple[Library, str], browser: BrowserContext, marks: Marks
) -> None:
    library, address = served
    other, page = opened(browser, address), opened(browser, address)
    first, second, third = library.episodes
    expect(page.get_by_text("For researchers: shows the goal.")).to_be_visible()
    expect(page.get_by_role("heading", name=first.record.query[0])).to_be_visible()
    expect(page.locator(".runs")).to_contain_text("shortest-path")
    picture = page.get_by_alt_text("What the robot saw")
    expect(picture).to_have_js_property("naturalWidth", 640)
    expect(picture).to_have_attribute("data-step", "0")

    shown, camera = picture.get_attribute("src"), marks.clients[-1].camera
    before = tuple(camera.position)
    page.get_by_role("slider").focus()
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    expect(picture).to_have_attribute("data-step", "4")
    assert picture.get_attribute("src") != shown
    expect(page.get_by_text("shortest-path: step 4 of")).to_be_visible()
    for _ in range(20):  # frames in which a turning camera would be reported
        page.evaluate("new Promise(requestAnimationFrame)")
    assert tuple(camera.position) == pytest.approx(before, abs=1e-3)

    page.get_by_role("button", name="next").click()
    expect(page.get_by_role("heading", name=second.record.query[0])).to_be_visible()
    expect(page.locator(".runs")).to_have_count(0)
    expect(picture).to_be_hidden()
    page.keyboard.press("n")
    expect(page.get_by_role("heading", name=third.record.query[0])).to_be_visible()
    expect(other.get_by_role("heading", name=first.record.query[0])).to_be_visible()
    page.locator(".rows .row").first.click()
    expect(page.get_by_role("heading", name=first.record.query[0])).to_be_visible()

    target = third.targets[0].object_name
    search = page.locator("label", has_text="Search").locator("xpath=ancestor::div[.//input][1]").locator("input")
    search.fill(target)
    found = library.matching(Wanted(words=target))
    assert 1 <= len(found) < 3
    expect(page.locator(".rows .row")).to_have_count(len(found))
    search.fill("nothing has these words")
    expect(page.get_by_text("No episode matches")).to_be_visible()


def test_hovering_and_clicking_a_node_shows_its_object_and_a_box_its_node(
    served: tuple[Library, str], browser: BrowserContext, marks: Marks
) -> None:
    library, address = served
    page = opened(browser, address)
    episode = library.episodes[0]
    target = episode.targets[0]
    graph = ownership_graph(episode)
    node = page.locator(".og .node.object.target")
    index = int((node.get_attribute("data-node") or "")[1:])
    owners = {edge.owner for edge in graph.edges if edge.node == graph.objects[index]}

    page.get_by_role("checkbox", name="Show shortest-path").click()
    node.hover()
    until(page, lambda: marks.outlined[-1] != [])
    ((centre, _, text),) = marks.outlined[-1]
    assert centre == pytest.approx(target.position, abs=0.3)
    assert owners == set(text.partition(" (")[0].split(", "))
    expect(page.locator(f'.og [data-ends$=" o{index}"]').first).to_have_class(re.compile("near"))
    page.get_by_role("heading", name=episode.record.query[0]).hover()
    until(page, lambda: marks.outlined[-1] == [])

    client = marks.clients[-1]
    before = tuple(client.camera.position)
    node.click()
    expect(node).to_have_class(re.compile(r"\bon\b"))
    until(page, lambda: tuple(client.camera.position) != before)
    assert tuple(client.camera.look_at) == pytest.approx(centre, abs=0.05)

    page.keyboard.press("n")  # another episode and back: nothing is marked then
    page.keyboard.press("p")
    expect(page.get_by_role("heading", name=episode.record.query[0])).to_be_visible()
    expect(page.locator(".og .node.on")).to_have_count(0)
    found = page.locator("canvas").last.bounding_box()
    box = {side: float(found[side]) for side in ("x", "y", "width", "height")}

    def click_on_the_target() -> bool:
        camera = client.camera
        seen_from = Cam(position=tuple(camera.position), wxyz=tuple(camera.wxyz))
        page.mouse.click(*pixel_of(centre, seen_from, box))
        page.wait_for_timeout(200)
        return page.locator(".og .node.object.target.on").count() == 1

    until(page, click_on_the_target)
    expect(page.locator(f'.og .edge.on[data-ends$=" o{index}"]')).to_have_count(len(owners))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_command_cleanly(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], number: signal.Signals
) -> None:
    class Ended(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            signal.raise_signal(number)
            return super().wait(60)

    monkeypatch.setattr(browse_verb, "threading", SimpleNamespace(Event=Ended))
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert Browse(dataset=made / "data", port=0).run() == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    first, second = capsys.readouterr().out.strip().splitlines()[-2:]
    assert re.fullmatch(r"3 episodes of 1 home: http://127\.0\.0\.1:\d+/", first)
    assert "shows the goals" in second


def test_a_busy_port_is_one_clear_line(served: tuple[Library, str], made: Path) -> None:
    port = int(re.findall(r"\d+", served[1])[-1])
    with pytest.raises(PersonalVizError, match=rf"--port {port}: cannot be used .* 0 for any free one"):
        Browse(dataset=made / "data", port=port).run()
    with pytest.raises(PersonalVizError, match="--port 70000"):
        Browse(dataset=made / "data", port=70_000).run()
