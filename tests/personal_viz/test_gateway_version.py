"""Pages of another version of the program: their websocket is refused in words of its own, and a new page is sent."""

import urllib.request
from pathlib import Path

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.page_script import SUBPROTOCOL, is_other_viser, page_of, page_version

from .gateways import PRESS, Running, enter, pack, running

FIRST, SECOND = ServeOptions(port=0, page_version="first"), ServeOptions(port=0, page_version="second")


def refusal(url: str, headers: dict[str, str], *protocols: str) -> tuple[int, str]:
    """Status and words with which a websocket is refused."""
    asked = [Subprotocol(name) for name in protocols] or None
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(url, additional_headers=headers, subprotocols=asked, proxy=None),
    ):
        pytest.fail("taken nevertheless")
    return refused.value.response.status_code, (refused.value.response.body or b"").decode()


def got(gateway: Running, path: str) -> tuple[str, str]:
    """(address that it leads to, text) of a page."""
    with urllib.request.urlopen(gateway.address + path, timeout=30) as reply:
        return reply.url, reply.read().decode()


def test_a_page_of_another_version_is_refused_with_words_of_its_own(tmp_path: Path) -> None:
    with running(tmp_path, options=SECOND) as gateway:
        url, headers = enter(gateway.address, "good")
        assert url.endswith("/second")
        expected = (409, "the study's program was updated; load the page again")
        assert refusal(url.removesuffix("second") + "first", headers) == expected
        assert refusal(url.removesuffix("/second"), headers) == expected, "a page of before pages had a version"
        assert gateway.viser.received == {}
        with connect(url, additional_headers=headers, proxy=None) as own:
            own.send(pack(PRESS))
            assert own.recv(timeout=20) == b"GuiUpdateMessage"
    assert gateway.told == []


def test_who_has_no_ticket_does_not_learn_the_version(tmp_path: Path) -> None:
    with running(tmp_path, options=SECOND) as gateway:
        url, headers = enter(gateway.address, "good")
        for address, own in ((url.replace("/ws/", "/ws/x"), headers), (url, {"Origin": gateway.address})):
            for version in ("first", "second"):
                assert refusal(address.removesuffix("second") + version, own) == (403, "")


@pytest.mark.parametrize("offered", [("viser-v0.0.1",), ("viser-v0.0.1", "viser-v9.9.9")])
def test_another_viser_is_refused_alike(tmp_path: Path, offered: tuple[str, ...]) -> None:
    with running(tmp_path) as gateway:
        url, headers = enter(gateway.address, "good")
        assert refusal(url, headers, *offered)[0] == 409


def test_the_version_that_counts_is_that_of_the_installed_viser() -> None:
    assert f"viser-v{viser.__version__}" == SUBPROTOCOL
    assert not is_other_viser([SUBPROTOCOL])
    assert not is_other_viser(["viser-v0.0.1", SUBPROTOCOL])
    assert not is_other_viser([])


def test_an_old_page_that_is_loaded_again_gets_the_page_of_today_with_the_same_ticket(tmp_path: Path) -> None:
    with running(tmp_path, options=SECOND) as gateway:
        url, _ = enter(gateway.address, "good")
        for old in (url.removesuffix("second") + "first", url.removesuffix("/second"), url + "/x"):
            address, text = got(gateway, f"/view/?websocket={old}")
            assert address == f"{gateway.address}/view/?websocket={url}"
            assert "const MINE = 'second'" in text
        address, text = got(gateway, "/view/?websocket=ws://127.0.0.1/ws/unknown/first")
        assert "enter.js" in text, "no ticket, no page"


def test_pages_can_ask_which_version_is_served(tmp_path: Path) -> None:
    with running(tmp_path, options=FIRST) as gateway:
        assert got(gateway, "/page-version")[1] == "first"
    with running(tmp_path) as gateway:
        assert got(gateway, "/page-version")[1] == page_version()


def test_a_page_is_viser_s_client_with_our_script_before_it() -> None:
    page = page_of("0123456789ab").decode()
    assert page.index("const MINE = '0123456789ab'") < page.index("<script data-p=")
    assert page_of("a").replace(b"'a'", b"") == page_of("b").replace(b"'b'", b"")
    with pytest.raises(AssertionError):
        page_of("'; alert(1); '")
