"""`personal-viz browse` changes pages from threads of its own: viser's event loop must not be touched by them."""

import threading
from pathlib import Path

import pytest
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from personal_viz.browse import app as browse_app
from personal_viz.browse.library import open_library
from personal_viz.browse.visitor import Visitor
from personal_viz.study_app.first_camera import CAMERA

from .gateways import pack
from .invented import invented_dataset


def test_a_visitor_s_page_is_safe_to_change_before_any_other_thread_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[tuple[bool, int, viser.ClientHandle]] = []
    arrived = threading.Event()

    class Noted(Visitor):
        def __init__(self, client: viser.ClientHandle, library: object) -> None:
            event = client._websock_connection.get_message_buffer().message_event
            found.append(("set" in vars(event), threading.get_ident(), client))
            super().__init__(client, library)  # type: ignore[arg-type]
            arrived.set()

    monkeypatch.setattr(browse_app, "Visitor", Noted)
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
        ((is_safe, thread, client),) = found
        assert is_safe
        assert thread != client._viser_server._websock_server._server_thread.ident  # type: ignore[union-attr]
        assert connection.recv(timeout=60)
