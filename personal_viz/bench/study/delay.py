"""A far-away participant on this machine: a TCP proxy that hands on every byte, but later."""

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

_CHUNK = 64 * 1024


@contextmanager
def delayed(link: str, *, one_way_s: float) -> Iterator[str]:
    """The link by way of a proxy on loopback that delays both directions by so much, until the end of the block."""
    parts = urlsplit(link)
    assert parts.port is not None, link
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True, name="delay")
    thread.start()
    proxy = _Proxy(parts.port, one_way_s)
    server = asyncio.run_coroutine_threadsafe(asyncio.start_server(proxy.join, "127.0.0.1", 0), loop).result()
    port = server.sockets[0].getsockname()[1]
    try:
        yield link.replace(f":{parts.port}", f":{port}", 1)
    finally:
        asyncio.run_coroutine_threadsafe(proxy.close(server), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


class _Proxy:
    """Joins each connection to the port behind."""

    def __init__(self, port: int, one_way_s: float) -> None:
        self._port, self._one_way_s = port, one_way_s
        self._tasks: set[asyncio.Task] = set()

    async def join(self, near_in: asyncio.StreamReader, near_out: asyncio.StreamWriter) -> None:
        """One connection from its beginning to its end."""
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        far_in, far_out = await asyncio.open_connection("127.0.0.1", self._port)
        try:
            await asyncio.gather(self._hand_on(near_in, far_out), self._hand_on(far_in, near_out))
        except (OSError, asyncio.CancelledError):
            pass  # one side hung up, or the proxy ends
        finally:
            self._tasks.discard(task)
            for writer in (near_out, far_out):
                writer.close()

    async def close(self, server: asyncio.Server) -> None:
        """Ends every connection."""
        server.close()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _hand_on(self, source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
        """Bytes in order, each `one_way_s` after it came; the way holds as many as are under way."""
        loop = asyncio.get_running_loop()
        way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()

        async def arrive() -> None:
            while True:
                due_s, data = await way.get()
                await asyncio.sleep(max(0.0, due_s - loop.time()))
                if not data:
                    with contextlib.suppress(OSError, NotImplementedError):
                        target.write_eof()
                    return
                target.write(data)
                await target.drain()

        arriving = asyncio.create_task(arrive())
        try:
            while True:
                data = await source.read(_CHUNK)
                way.put_nowait((loop.time() + self._one_way_s, data))
                if not data:
                    break
            await arriving
        finally:
            arriving.cancel()
