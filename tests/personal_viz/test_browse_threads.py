"""`personal-viz browse` changes pages from threads of its own: viser's event loop must not be touched by them."""

import threading
from pathlib import Path

import pytest
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from personal_viz.browse import app as browse_app
from personal_viz.browse.library import Library, open_library
from personal_viz.browse.visitor import Visitor
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.worker_door import make_updates_safe

from .gateways import pack
from .invented import invented_dataset


def test_a_visitor_s_page_is_safe_to_change_before_any_other_thread_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[str, int]] = []
    arrived = threading.Event()

    class Noted(Visitor):
        def __init__(self, client: viser.ClientHandle, library: Library) -> None:
            done.append(("visitor", threading.get_ident()))
            super().__init__(client, library)
            arrived.set()

    def noted(client: viser.ClientHandle) -> None:
        done.append(("safe", threading.get_ident()))
        make_updates_safe(client)

    monkeypatch.setattr(browse_app, "Visitor", Noted)
    monkeypatch.setattr(browse_app, "make_updates_safe", noted)
    invented_dataset(tmp_path / "data", name="Small", seed=3)
    with (
        browse_app.browser_app(open_library(tmp_path / "data")) as address,
        connect(
            address.replace("http", "ws"),
            origin=address.rstrip("/"),  # type: ignore[arg-type]
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            proxy=None,
        ) as connection,
    ):
        connection.send(pack(CAMERA))
        assert arrived.wait(60)
        (first, event_loop), (second, thread) = done
        assert (first, second) == ("safe", "visitor")
        assert thread != event_loop
        assert connection.recv(timeout=60)
