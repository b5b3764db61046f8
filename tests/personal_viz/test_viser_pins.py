"""What we use of viser's private parts, at the pinned version: who a connection belongs to, and no public tunnel."""

import threading

import viser
from viser import _messages
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from personal_viz.first_camera import CAMERA
from personal_viz.server import refuse_tunnels, ticket_of

from .gateways import pack


def test_a_worker_knows_the_ticket_of_a_connection_and_opens_no_tunnel() -> None:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    asked, arrived, tickets = [], threading.Event(), []
    server.request_share_url = lambda *_, **__: asked.append(True)  # type: ignore[method-assign]

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        tickets.append(ticket_of(server, client.client_id))
        arrived.set()

    try:
        assert _messages.ShareUrlRequest in server._websock_server._incoming_handlers
        refuse_tunnels(server)
        assert not server._websock_server._incoming_handlers.get(_messages.ShareUrlRequest)
        with connect(
            f"ws://127.0.0.1:{server.get_port()}/?ticket=abc-123",
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            proxy=None,
        ) as connection:
            connection.send(pack({"type": "ShareUrlRequest"}))
            connection.send(pack(CAMERA))
            assert arrived.wait(30)
    finally:
        server.stop()
    assert tickets == ["abc-123"]
    assert asked == []
