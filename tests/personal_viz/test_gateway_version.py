"""Pages of another version of the program: their websocket is refused in words of its own, and a new page is sent."""

import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from human_study.texts.catalogue import catalogue_of
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.page_script import SUBPROTOCOL, is_other_viser, page_of, page_version

from .gateways import PRESS, Running, enter, pack, running

ENGLISH = catalogue_of("en")


@pytest.fixture(scope="module")
def second(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A gateway that serves the pages of version `second`."""
    with running(tmp_path_factory.mktemp("second"), options=ServeOptions(port=0, page_version="second")) as gateway:
        yield gateway


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


def test_a_page_of_another_version_is_refused_with_words_of_its_own(second: Running) -> None:
    url, headers = enter(second.address, "good")
    assert url.endswith("/second")
    expected = (409, "the study's program was updated; load the page again")
    assert refusal(url.removesuffix("second") + "first", headers) == expected
    assert refusal(url.removesuffix("/second"), headers) == expected, "a page from before pages had a version"
    assert second.viser.received == {}
    with connect(url, additional_headers=headers, proxy=None) as own:
        own.send(pack(PRESS))
        assert own.recv(timeout=20) == b"GuiUpdateMessage"
    assert second.told == []


def test_without_a_ticket_nobody_learns_the_version(second: Running) -> None:
    url, headers = enter(second.address, "good")
    for address, own in ((url.replace("/ws/", "/ws/x"), headers), (url, {"Origin": second.address})):
        for version in ("first", "second"):
            assert refusal(address.removesuffix("second") + version, own) == (403, "")


@pytest.mark.parametrize("offered", [("viser-v0.0.1",), ("viser-v0.0.1", "viser-v9.9.9")])
def test_another_viser_is_refused_alike(second: Running, offered: tuple[str, ...]) -> None:
    url, headers = enter(second.address, "good")
    assert refusal(url, headers, *offered)[0] == 409


def test_the_version_that_counts_is_that_of_the_installed_viser() -> None:
    assert f"viser-v{viser.__version__}" == SUBPROTOCOL
    assert not is_other_viser([SUBPROTOCOL])
    assert not is_other_viser(["viser-v0.0.1", SUBPROTOCOL])
    assert not is_other_viser([])


def test_an_old_page_that_is_loaded_again_gets_the_current_page_with_the_same_ticket(second: Running) -> None:
    url, _ = enter(second.address, "good")
    for old in (url.removesuffix("second") + "first", url.removesuffix("/second"), url + "/x"):
        address, text = got(second, f"/view/?websocket={old}")
        assert address == f"{second.address}/view/?websocket={url}"
        assert "const MINE = 'second'" in text
    address, text = got(second, "/view/?websocket=ws://127.0.0.1/ws/unknown/first")
    assert "enter.js" in text, "no ticket, no page"


def test_pages_can_ask_which_version_is_served(second: Running, tmp_path: Path) -> None:
    assert got(second, "/page-version")[1] == "second"
    with running(tmp_path) as gateway:
        assert got(gateway, "/page-version")[1] == page_version()


def test_a_page_is_viser_s_client_with_our_script_before_it() -> None:
    page = page_of("0123456789ab", ENGLISH).decode()
    assert page.index("const MINE = '0123456789ab'") < page.index("<script data-p=")
    assert page_of("a", ENGLISH).replace(b"'a'", b"") == page_of("b", ENGLISH).replace(b"'b'", b"")
    with pytest.raises(AssertionError):
        page_of("'; alert(1); '", ENGLISH)
