"""`personal-viz browse` gives only its own pages a visitor, on a thread that may change the page."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
from websockets.sync.client import ClientConnection
from websockets.typing import Origin

from personal_viz.browse import app as browse_app
from personal_viz.browse.app import browser_app, is_own_page
from personal_viz.browse.library import Library, open_library
from personal_viz.browse.visitor import Visitor
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.worker_door import make_updates_safe

from .gateways import pack
from .invented import invented_dataset
from .wire import line_to


@contextlib.contextmanager
def page_from(origin: str, address: str) -> Iterator[ClientConnection]:
    """A connection to the app from a page of this origin."""
    with line_to(address, origin=Origin(origin)) as connection:
        connection.send(pack(CAMERA))
        yield connection


def test_only_our_own_page_gets_a_visitor_and_is_safe_to_change_before_any_other_thread_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[str, int]] = []
    judged: list[tuple[str | None, bool]] = []
    told, arrived = threading.Event(), threading.Event()

    class Noted(Visitor):
        def __init__(self, client: viser.ClientHandle, library: Library) -> None:
            done.append(("visitor", threading.get_ident()))
            super().__init__(client, library)
            arrived.set()

    def noted(client: viser.ClientHandle) -> None:
        done.append(("safe", threading.get_ident()))
        make_updates_safe(client)

    def judge(origin: str | None, port: int) -> bool:
        judged.append((origin, is_own_page(origin, port)))
        told.set()
        return judged[-1][1]

    monkeypatch.setattr(browse_app, "Visitor", Noted)
    monkeypatch.setattr(browse_app, "make_updates_safe", noted)
    monkeypatch.setattr(browse_app, "is_own_page", judge)
    invented_dataset(tmp_path / "data", name="Small", seed=3)
    with browser_app(open_library(tmp_path / "data")) as address:
        with page_from("http://127.0.0.1:1", address):
            assert told.wait(60)
        with page_from(address.rstrip("/"), address) as ours:
            assert arrived.wait(60)
            assert ours.recv(timeout=60)
        assert judged == [("http://127.0.0.1:1", False), (address.rstrip("/"), True)]
        (first, event_loop), (second, thread) = done
        assert (first, second) == ("safe", "visitor")
        assert thread != event_loop


def test_only_pages_of_this_port_and_host_are_ours() -> None:
    assert is_own_page("http://127.0.0.1:8090", 8090)
    assert is_own_page("http://localhost:8090", 8090)
    for origin in (None, "", "null", "http://127.0.0.1:8091", "https://127.0.0.1:8090", "http://127.0.0.1.evil:8090"):
        assert not is_own_page(origin, 8090)
