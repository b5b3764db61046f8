"""The private parts of viser that we use, at the pinned version: connections, no tunnel, pages changed by threads."""

import asyncio
import threading
from importlib.metadata import version

import pytest
import viser
from viser import _messages
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.exceptions import InvalidStatus

from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.server import address_of
from personal_viz.study_app.worker_door import SECRET_HEADER, open_door, wake_on_loop_only

from .gateways import pack, raw
from .wire import line_to

PUSHES = 300


def test_a_worker_knows_ticket_and_number_of_a_connection_and_opens_no_tunnel() -> None:
    server, door = open_door()
    asked, arrived, tickets = [], threading.Event(), []
    server.request_share_url = lambda *_, **__: asked.append(True)

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        tickets.append(address_of(server, client.client_id))
        arrived.set()

    try:
        assert _messages.GuiUpdateMessage in server._websock_server._incoming_handlers
        assert not server._websock_server._incoming_handlers.get(_messages.ShareUrlRequest)
        url = f"ws://127.0.0.1:{server.get_port()}/?connection=7&ticket=abc-123"
        with line_to(url, additional_headers={SECRET_HEADER: door.secret}) as connection:
            connection.send(pack({"type": "ShareUrlRequest"}))
            connection.send(pack(CAMERA))
            assert arrived.wait(30)
    finally:
        server.stop()
    assert tickets == [("abc-123", 7)]
    assert asked == []


def test_a_worker_lets_nobody_in_without_the_gateways_secret(capfd: pytest.CaptureFixture[str]) -> None:
    (server, door), (other, others_door) = open_door(), open_door()
    arrived: list[int] = []
    server.on_client_connect(lambda client: arrived.append(client.client_id))
    try:
        assert len({door.secret, others_door.secret}) == 2
        for headers in ({}, {SECRET_HEADER: ""}, {SECRET_HEADER: others_door.secret}, {SECRET_HEADER: "\xe9" * 43}):
            with pytest.raises(InvalidStatus) as refused:
                line_to(f"ws://127.0.0.1:{door.port}/", additional_headers=headers)
            assert refused.value.response.status_code == 403
        head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{door.port}\r\nConnection: close\r\n"
        twice = f"{SECRET_HEADER}: {door.secret}\r\n" * 2
        for asked in (head, head + twice):
            page = raw(door.port, f"{asked}\r\n".encode())
            assert page.split()[1] == b"403", page[:200]
            assert b"<html" not in page
        raw(door.port, b"\x16\x03\x01 this is no HTTP\r\n\r\n")
        let_in = raw(door.port, f"{head}{SECRET_HEADER}: {door.secret}\r\n\r\n".encode())
        assert b"<html" in let_in
    finally:
        server.stop()
        other.stop()
    assert arrived == []
    assert "Traceback" not in "".join(capfd.readouterr())


def test_the_patched_viser_is_the_pinned_one() -> None:
    assert version("viser") == "1.1.1"  # look at AsyncMessageBuffer.push again before this is raised
    assert "message_event" in AsyncMessageBuffer.__dataclass_fields__


def test_only_the_event_loop_wakes_the_task_that_waits_for_messages() -> None:
    async def waits() -> None:
        loop = asyncio.get_running_loop()
        buffer = AsyncMessageBuffer(loop, persistent_messages=False)
        wake_on_loop_only(buffer)
        waiting = asyncio.create_task(buffer.message_event.wait())
        await asyncio.sleep(0)
        thread = threading.Thread(target=buffer.message_event.set)
        thread.start()
        thread.join()
        assert not buffer.message_event.is_set()
        loop.call_soon_threadsafe(buffer.message_event.set)
        assert await asyncio.wait_for(waiting, 30)

    asyncio.run(waits())


def test_a_waiting_task_hears_of_every_set_by_another_thread() -> None:
    async def hears() -> int:
        loop = asyncio.get_running_loop()
        buffer = AsyncMessageBuffer(loop, persistent_messages=False)
        wake_on_loop_only(buffer)
        heard = threading.Semaphore(0)

        def push() -> None:
            for _ in range(PUSHES):
                buffer.message_event.set()  # as viser's push does: at once, and on the loop
                loop.call_soon_threadsafe(buffer.message_event.set)
                assert heard.acquire(timeout=30)

        thread = threading.Thread(target=push)
        thread.start()
        for _ in range(PUSHES):
            await asyncio.wait_for(buffer.message_event.wait(), 30)
            buffer.message_event.clear()
            heard.release()
        await asyncio.to_thread(thread.join)
        return PUSHES

    assert asyncio.run(hears()) == PUSHES
