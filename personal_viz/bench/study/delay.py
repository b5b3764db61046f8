"""A far-away participant on this machine: a TCP proxy that hands on every byte, but later."""

import asyncio
import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

from ..harness import background_loop

_CHUNK = 64 * 1024


@contextmanager
def delayed(link: str, *, one_way_s: float) -> Iterator[str]:
    """The link by way of a proxy on loopback that delays both directions by so much, until the end of the block."""
    parts = urlsplit(link)
    assert parts.port is not None, link

    async def join(near_in: asyncio.StreamReader, near_out: asyncio.StreamWriter) -> None:
        """One connection from its beginning to its end."""
        far_in, far_out = await asyncio.open_connection("127.0.0.1", parts.port)
        with contextlib.suppress(OSError):  # one side hung up
            await asyncio.gather(_hand_on(near_in, far_out, one_way_s), _hand_on(far_in, near_out, one_way_s))
        for writer in (near_out, far_out):
            writer.close()

    with background_loop("delay") as loop:
        server = asyncio.run_coroutine_threadsafe(asyncio.start_server(join, "127.0.0.1", 0), loop).result()
        port = server.sockets[0].getsockname()[1]
        yield link.replace(f":{parts.port}", f":{port}", 1)
        loop.call_soon_threadsafe(server.close)


async def _hand_on(source: asyncio.StreamReader, target: asyncio.StreamWriter, one_way_s: float) -> None:
    """Bytes in order, each `one_way_s` after it came; the way holds as many as are under way."""
    loop = asyncio.get_running_loop()
    while data := await source.read(_CHUNK):
        loop.call_later(one_way_s, target.write, data)
    await asyncio.sleep(2 * one_way_s)  # all that is under way has arrived
    with contextlib.suppress(OSError, NotImplementedError):
        target.write_eof()
