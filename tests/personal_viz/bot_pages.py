"""What viser would send to a bot, for tests of what bots understand."""

import msgspec
import zstandard


def wire(*messages: dict) -> bytes:
    """As viser sends messages."""
    inner = msgspec.msgpack.encode({"messages": messages, "timestampSec": 0.0, "binaryBufferLengths": ()})
    compressed = zstandard.ZstdCompressor().compress(inner)
    return len(inner).to_bytes(8, "little") + len(compressed).to_bytes(8, "little") + compressed


def html(uuid: str, content: str) -> dict:
    """An HTML element."""
    return {"type": "GuiHtmlMessage", "uuid": uuid, "container_uuid": "root", "props": {"order": 1, "content": content}}


def button(uuid: str, label: str, **props: object) -> dict:
    """A button."""
    return {"type": "GuiButtonMessage", "uuid": uuid, "value": False, "props": {"order": 2, "label": label, **props}}
