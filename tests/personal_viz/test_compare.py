"""`personal-viz compare` from run folders to a folder that people open: files, resuming, licensed pixels, the page."""

import json
import os
from collections.abc import Iterator
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import BrowserContext, Page
from rerun.chunk import RrdReader

from personal_viz.cli.runs.compare import Compare
from personal_viz.compare.app import write_comparison
from sim.errors import PersonalVizError, RecordingError, RunFileError
from sim.tasks.run_files import Run

from .compared_runs import EVIL, Compared, written

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Compared:
    """The invented home with all its runs."""
    found = Compared(tmp_path_factory.mktemp("compared"))
    found.write_runs()
    return found


@pytest.fixture(scope="module")
def out(made: Compared, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `compare` wrote from them."""
    folder = tmp_path_factory.mktemp("page")
    written_now = write_comparison([made.runs], dataset=made.data, out=folder, picture_width=32)
    assert (written_now.num_episodes, written_now.num_made, written_now.num_runs) == (6, 6, 5)
    return folder


def episode_folder(out: Path, made: Compared, index: int = 0) -> Path:
    key = made.episodes[index].key
    return out / "episodes" / f"{key.split}-{key.scene}-{key.episode_id}"


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(str(path)).stream()}


def times_of(out: Path) -> dict[str, int]:
    return {str(path.relative_to(out)): path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}


def test_every_episode_has_a_recording_of_all_its_runs_a_sheet_and_a_thumbnail(made: Compared, out: Path) -> None:
    assert len(list((out / "episodes").iterdir())) == 6
    folder = episode_folder(out, made)
    shown = entities(folder / "replay.rrd")
    assert {"/runs/study-P01/camera", "/runs/study-P02/camera", "/runs/idle/camera", "/runs/evil/camera"} <= shown
    assert {"/runs/study-P01-2/candidates", "/runs/grounder/candidates", "/runs/oracle/candidates"} <= shown
    with Image.open(folder / "sheet.png") as sheet:
        assert sheet.format == "PNG"
        assert sheet.width == 1900
    with Image.open(folder / "thumb.jpg") as thumb:
        assert max(thumb.size) == 240


def test_the_page_says_who_succeeded_and_how_far_people_are_ahead(made: Compared, out: Path) -> None:
    text = (out / "index.md").read_text()
    assert text.count("## PAN ") == 1
    assert text.count("## POG ") == 2  # in the invented home, and on oracle maps
    assert "no human baseline for PersONAL" in text
    key = made.episodes[0].key
    pan, home, oracle = (line for line in text.splitlines() if f"{key.split}/{key.scene}/{key.episode_id}" in line)
    assert "| 100 |" in pan
    assert pan.split("|")[15].strip() == "+50"
    assert home.split("|")[7].strip() == "100"
    assert "oracle: 0.50 m" in oracle
    assert EVIL not in (out / "index.html").read_text()


def test_a_second_call_keeps_what_was_made_and_writes_the_same_page(made: Compared, out: Path) -> None:
    before, page = times_of(out), (out / "index.html").read_bytes()
    again = write_comparison([made.runs], dataset=made.data, out=out, picture_width=32)
    assert again.num_made == 0
    after = times_of(out)
    assert [name for name in after if after[name] != before[name]] == ["index.html", "index.md"]
    assert (out / "index.html").read_bytes() == page


def test_only_what_changed_or_is_not_whole_is_made_again(made: Compared, out: Path, tmp_path: Path) -> None:
    first, second, third = (episode_folder(out, made, index) for index in (0, 1, 2))
    (first / "sheet.png").unlink()
    (second / "made.json").write_text('{"inp')
    before = times_of(out)
    assert write_comparison([made.runs], dataset=made.data, out=out, picture_width=32).num_made == 2
    assert times_of(out)[f"{third.relative_to(out)}/replay.rrd"] == before[f"{third.relative_to(out)}/replay.rrd"]
    more = made.walk(made.episodes[2], to_goal=False, turns=3)
    written(Run(info=made.info("late"), episodes=(more,)), tmp_path)
    later = write_comparison([made.runs, tmp_path], dataset=made.data, out=out, picture_width=32)
    assert later.num_made == 1
    assert "/runs/late/camera" in entities(third / "replay.rrd")
    assert json.loads((third / "made.json").read_text())["scene_digest"] == made.scene.digest


def test_worker_processes_write_the_same_page_as_one(made: Compared, out: Path, tmp_path: Path) -> None:
    told: list[int] = []
    write_comparison([made.runs], dataset=made.data, out=out, picture_width=32)
    write_comparison([made.runs], dataset=made.data, out=tmp_path, picture_width=0, jobs=2, on_plan=told.append)
    assert told == [6]
    assert (tmp_path / "index.html").read_bytes() == (out / "index.html").read_bytes()
    name = episode_folder(tmp_path, made).relative_to(tmp_path)
    assert (tmp_path / name / "sheet.png").read_bytes() == (out / name / "sheet.png").read_bytes()
    assert not [path for path in tmp_path.rglob("*") if path.name.endswith(".part")]


def test_the_command_says_where_it_wrote_and_refuses_bad_options(
    made: Compared, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Compare(runs=(made.runs,), dataset=made.data, out=out, picture_width=32).run() == 0
    printed = capsys.readouterr()
    assert printed.out == f"{out / 'index.html'}: 6 episodes of 5 runs, 6 made before\n"
    assert printed.err == ""
    with pytest.raises(PersonalVizError, match="--picture-width is 7; expected 32 to 640, or 0"):
        Compare(runs=(made.runs,), dataset=made.data, out=out, picture_width=7).run()
    with pytest.raises(PersonalVizError, match="--jobs is 0"):
        Compare(runs=(made.runs,), dataset=made.data, out=out, jobs=0).run()


def test_runs_that_cannot_be_compared_are_refused_before_anything_is_written(made: Compared, tmp_path: Path) -> None:
    scan = Run(info=made.info("scanned", scene_kind="scan"), episodes=(made.walk(made.episodes[0], to_goal=True),))
    written(scan, tmp_path / "scan")
    with pytest.raises(RunFileError, match="scanned: was made on a home of kind 'scan', Demo can only be opened as"):
        write_comparison([tmp_path / "scan"], dataset=made.data, out=tmp_path / "out")
    cluttered = Run(info=made.info("full", config={"clutter": 1}), episodes=scan.episodes)
    written(cluttered, tmp_path / "clutter")
    with pytest.raises(RecordingError, match="Demo: the runs were made on scene_digest"):
        write_comparison([tmp_path / "clutter"], dataset=made.data, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_an_error_in_one_line(made: Compared, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(RecordingError, match=r"out/episodes/.*cannot be written"):
        write_comparison([made.runs / "idle"], dataset=made.data, out=tmp_path / "out", picture_width=0)


def test_without_permission_only_paths_and_goal_of_a_scan_are_written(tmp_path: Path) -> None:
    scanned = Compared(tmp_path, kind="scan")
    run = Run(info=scanned.info("walker"), episodes=(scanned.walk(scanned.episodes[0], to_goal=True),))
    written(run, scanned.runs)
    shown: dict[bool, tuple[set[str], set[tuple[int, ...]]]] = {}
    for with_pixels in (False, True):
        out = tmp_path / f"out-{with_pixels}"
        result = write_comparison(
            [scanned.runs], dataset=scanned.data, out=out, scenes_dir=scanned.scans, with_pixels=with_pixels,
            picture_width=32,
        )  # fmt: skip
        assert result.has_left_out_pixels is not with_pixels
        folder = episode_folder(out, scanned)
        with Image.open(folder / "sheet.png") as sheet:
            colors = set(map(tuple, np.asarray(sheet).reshape(-1, 3).tolist()))
        shown[with_pixels] = entities(folder / "replay.rrd"), colors
        text = unescape((out / "index.html").read_text())
        assert ("under HM3D's terms of use" in text) is with_pixels
        assert ("are left out; --with-pixels writes them" in text) is not with_pixels
    wall, goal = (0xC9, 0xCC, 0xD1), (0xD8, 0x1B, 0x60)
    assert any(name.startswith("/scene/mesh") for name in shown[True][0])
    assert not any(name.startswith(("/scene/mesh", "/scene/topdown")) for name in shown[False][0])
    assert wall in shown[True][1]
    assert wall not in shown[False][1]
    assert goal in shown[False][1]


@pytest.fixture
def page(out: Path, browser: BrowserContext) -> Iterator[Page]:
    """The page, opened from its file; ends with a check that it asked for nothing outside its folder."""
    asked: list[str] = []
    problems: list[str] = []
    opened = browser.new_page()
    opened.on("request", lambda request: asked.append(request.url))
    opened.on("pageerror", lambda error: problems.append(str(error)))
    opened.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    opened.goto(f"file://{out}/index.html")
    yield opened
    assert problems == []
    assert asked
    assert [url for url in asked if not url.startswith((f"file://{out}/", "data:"))] == []


def names(page: Page) -> list[str]:
    """Episodes of the first table, from the top."""
    return page.locator("section").first.locator(".episodes tbody tr .episode b").all_inner_texts()


@pytest.mark.browser
def test_the_page_sorts_filters_and_shows_its_pictures_from_a_file(page: Page, made: Compared) -> None:
    section = page.locator("section").first
    shown = [" / ".join(episode.key) for episode in made.episodes]
    assert names(page)[-1] == shown[0]  # people lead by 50 there and by 100 elsewhere
    section.locator('th button[data-key="difference-sr"]').click()
    assert names(page)[0] == shown[0]
    assert section.locator('th[aria-sort="ascending"]').count() == 1
    section.locator('[data-filter="split"]').select_option("hard")
    assert sorted(names(page)) == sorted(name for name in shown if name.startswith("hard"))
    assert section.locator(".count").inner_text() == "2 of 6 episodes"
    section.locator('[data-filter="split"]').select_option("")
    section.locator('[data-filter="text"]').fill(made.episodes[3].record.query[0].upper())
    assert shown[3] in names(page)
    section.locator('[data-filter="text"]').fill("no such words")
    assert names(page) == []
    section.locator('[data-filter="text"]').fill("")
    picture = section.locator(".picture img").first
    picture.scroll_into_view_if_needed()
    page.wait_for_function("picture => picture.naturalWidth > 0", arg=picture.element_handle())


@pytest.mark.browser
def test_the_means_can_be_taken_of_one_agent(page: Page, made: Compared) -> None:
    section = page.locator("section").first
    first = section.locator("tbody tr").filter(has_text=" / ".join(made.episodes[0].key))
    assert first.locator('td[data-key="agents-sr"]').inner_text() == "50"
    section.locator("[data-agents]").select_option(EVIL)
    assert first.locator('td[data-key="agents-sr"]').inner_text() == "100"
    assert first.locator('td[data-key="difference-sr"]').inner_text() == "0"
    section.locator('[data-filter="outcome"]').select_option("people")
    assert len(names(page)) == 5


@pytest.mark.browser
def test_on_a_phone_the_page_is_no_wider_than_the_screen(page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.locator("[data-sort]").first.is_visible()


@pytest.mark.browser
def test_served_rows_open_their_recording_in_the_viewer(out: Path, made: Compared, browser: BrowserContext) -> None:
    from recordings.viewer.web import serve_folder

    with serve_folder(out) as site:
        page = browser.new_page()
        page.goto(site.address)
        link = page.locator("a.replay").first.get_attribute("href")
        assert link.startswith("/viewer/?url=http%3A%2F%2F127.0.0.1%3A")
        assert link.endswith("%2Freplay.rrd&hide_welcome_screen=1&persist=0")
        assert page.goto(site.address + link).ok
        with page.expect_response(lambda reply: reply.url.endswith("/replay.rrd")) as reply:
            page.goto(site.address + link)
        assert reply.value.ok
    assert os.path.getsize(episode_folder(out, made) / "replay.rrd") > 1000
