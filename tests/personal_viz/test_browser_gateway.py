"""The gateway's own pages in real Chromium: the open link, a full study, links that do not work, the device."""

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, expect

from .conftest import Profiles
from .gateways import running

pytestmark = pytest.mark.browser


def test_the_open_link_leads_to_a_place_and_the_same_person_back_to_it(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path, recruit="link") as gateway:
        for answer in (None, "Yes: go on where I stopped", "No: I am somebody else"):
            page = browser.new_page()
            page.goto(f"{gateway.address}/join")
            if answer is not None:
                page.get_by_role("button", name=answer).click()
            page.wait_for_url("**/view/**")
            page.close()
            assert set(gateway.people.claimed) == ({"p01", "p02"} if answer and answer.startswith("No") else {"p01"})


def test_a_full_study_says_so_and_shows_the_code(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path, recruit="prolific") as gateway:
        gateway.people.claimed.update({"p01": "a", "p02": "b", "p03": "c"})
        page = browser.new_page()
        page.goto(f"{gateway.address}/join?PROLIFIC_PID=5f1e0c9a7b3d&STUDY_ID=64aa&SESSION_ID=77bb")
        expect(page.get_by_text("The study is full")).to_be_visible()
        expect(page.get_by_text("You will be paid")).to_be_visible()
        expect(page.get_by_text("FULL-1")).to_be_visible()
        page.get_by_role("button", name="Copy the code").click()
        expect(page.get_by_text(re.compile("The code is (copied|marked)"))).to_be_visible()


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("/#wrong", "This link is not known"),
        ("/", "This page needs your personal link"),
        ("/join", "This link is incomplete"),
        ("/join?PROLIFIC_PID=%3Cimg%20src%3Dx%20onerror%3Dalert(1)%3E", "This link is incomplete"),
    ],
)
def test_a_page_explains_why_a_link_does_not_work(
    tmp_path: Path, browser: BrowserContext, path: str, text: str
) -> None:
    with running(tmp_path, recruit="prolific") as gateway:
        page = browser.new_page()
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("dialog", lambda dialog: problems.append(dialog.message))
        page.goto(gateway.address + path)
        expect(page.get_by_text(text)).to_be_visible()
        assert problems == []


PHONE = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}
SMALL = {"viewport": {"width": 900, "height": 560}}
AT_200_PERCENT = {"viewport": {"width": 960, "height": 540}, "device_scale_factor": 2}
"""A screen of 1920 x 1080 pixels on which the system shows everything twice as large."""
ZOOMED_OUT = {
    "viewport": {"width": 2039, "height": 970},
    "screen": {"width": 1366, "height": 768},
    "device_scale_factor": 0.67,
}
"""A small laptop whose page is at 67 %: Chrome's zoom changes the ratio and the window, not the screen."""
TABLET = {"viewport": {"width": 1366, "height": 1024}, "is_mobile": True, "has_touch": True}


@pytest.mark.parametrize("choices", [PHONE, SMALL, TABLET], ids=["phone", "small", "tablet"])
def test_a_phone_is_turned_away_before_anything_is_sent_and_the_link_stays_good(
    tmp_path: Path, chromium: Profiles, choices: dict[str, Any]
) -> None:
    with running(tmp_path, recruit="link") as gateway:
        for path in ("/join", "/#good"):
            with chromium(**choices) as phone:
                page, posts = phone.new_page(), []
                page.on(
                    "request", lambda request, posts=posts: posts.append(request) if request.method == "POST" else None
                )
                page.goto(f"{gateway.address}{path}")
                expect(page.get_by_role("heading", name="Please open your link on a computer")).to_be_visible()
                expect(page.get_by_text("your link stays valid")).to_be_visible()
                expect(page).to_have_title("Please open your link on a computer - PersONAL study")
                assert posts == []
        assert gateway.people.claimed == {}
        for computers_own in ({}, AT_200_PERCENT, ZOOMED_OUT):
            with chromium(**computers_own) as computer:
                page = computer.new_page()
                page.goto(f"{gateway.address}/#good")
                page.wait_for_url("**/view/**")


def test_a_phone_with_a_pen_is_turned_away_too(tmp_path: Path, chromium: Profiles) -> None:
    with running(tmp_path, recruit="link") as gateway, chromium(**PHONE, device_scale_factor=3) as phone:
        phone.add_init_script(  # Chromium's emulated phones have no pen
            "const found = ['(pointer: coarse)', '(any-pointer: fine)'];"
            "window.matchMedia = (query) => ({ matches: found.includes(query) });"
        )
        page = phone.new_page()
        page.goto(f"{gateway.address}/#good")
        expect(page.get_by_role("heading", name="Please open your link on a computer")).to_be_visible()
        assert gateway.people.claimed == {}


def test_the_profile_of_the_device_is_coarse(tmp_path: Path, browser: BrowserContext) -> None:
    with running(tmp_path) as gateway:
        page = browser.new_page()
        page.goto(f"{gateway.address}/#good")
        page.wait_for_url("**/view/**")
        profile = gateway.tickets.client_profile("p01")
        assert profile == {"webgl2": True, "width": 1300, "height": 800, "dpr": 1.0, "touch": False}
