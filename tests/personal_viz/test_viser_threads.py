"""viser's pages change from other threads without its event loop being touched by them."""

import asyncio
import threading
from importlib.metadata import version

from viser.infra._async_message_buffer import AsyncMessageBuffer

from personal_viz.study_app.worker_door import wake_on_loop_only

PUSHES = 300


def test_the_patched_viser_is_the_pinned_one() -> None:
    assert version("viser") == "1.1.1"  # look at AsyncMessageBuffer.push again before this is raised
    assert "message_event" in AsyncMessageBuffer.__dataclass_fields__


def test_only_the_event_loop_wakes_who_waits_for_messages() -> None:
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


def test_who_waits_hears_of_every_set_of_another_thread() -> None:
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
