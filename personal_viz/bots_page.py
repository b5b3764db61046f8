"""A participant's page as a bot knows it: what viser has sent, decoded, without a browser."""

import re
from dataclasses import dataclass, field
from typing import Any

import msgspec
import zstandard

from .page_script import LABEL

_STEP_SHOWN = re.compile(r'data-step="(\d+)"')
_STEP_COUNTED = re.compile(r"Step (\d+) of (\d+)")
_SEAT = re.compile(r"personalPage\.begin\((?:&quot;|\")([\w-]+)(?:&quot;|\")")
_TAGS = re.compile(r"<[^>]*>")
_HEAD_BYTES = 16
"""Two numbers of 8 bytes stand before the compressed part: its size before and after (viser's wire format)."""
_IMAGE_HEAD = 1200
"""Characters of an element's HTML in which the step is looked for; the picture's bytes come after that."""


@dataclass(slots=True)
class Element:
    """A button, text, box or command of the page."""

    uuid: str
    kind: str
    """viser's message type: `GuiButtonMessage`, ..., or `RegisterCommandMessage`."""
    props: dict[str, Any]

    @property
    def label(self) -> str:
        """What stands on it; empty for plain HTML."""
        return str(self.props.get("label") or "")

    @property
    def is_usable(self) -> bool:
        """Whether a person could press it."""
        return bool(self.props.get("visible", True)) and not self.props.get("disabled", False)


@dataclass(slots=True)
class BotPage:
    """The elements that are there now, and what the PAN screen says."""

    elements: dict[str, Element] = field(default_factory=dict)
    """By viser's uuid, in the order in which they came."""
    step_shown: int | None = None
    """Actions before the picture that is shown; None without a picture."""
    step_counted: int | None = None
    """Actions that the counter says."""
    num_frames: int = 0
    """Pictures received."""

    def apply(self, data: bytes) -> None:
        """Takes one websocket message of viser."""
        for message in decoded(data):
            self._apply(message)

    @property
    def is_walking(self) -> bool:
        """Whether the PAN screen is there: keys move the robot."""
        return self.step_shown is not None and self.command("W") is not None

    @property
    def seat(self) -> str | None:
        """Name of this connection, with which the page's script begins each letter; None before it was told."""
        for element in self.elements.values():
            if found := _SEAT.search(str(element.props.get("content", ""))[:_IMAGE_HEAD]):
                return found.group(1)
        return None

    @property
    def letter_box(self) -> Element | None:
        """The hidden input in which the page's script writes."""
        return next((element for element in self.of_kind("GuiTextMessage") if element.label == LABEL), None)

    def command(self, hotkey: str) -> Element | None:
        """The command of a key, as viser names keys."""
        for element in self.elements.values():
            if element.kind == "RegisterCommandMessage" and element.props.get("hotkey") == hotkey:
                return element
        return None

    def of_kind(self, kind: str) -> list[Element]:
        """Elements of a viser type that can be used, in their order on the page."""
        found = [element for element in self.elements.values() if element.kind == kind and element.is_usable]
        return sorted(found, key=lambda element: element.props.get("order", 0))

    def button(self, pattern: str) -> Element | None:
        """The first usable button whose label matches, upper and lower case alike."""
        for element in self.of_kind("GuiButtonMessage"):
            if re.search(pattern, element.label, re.IGNORECASE):
                return element
        return None

    @property
    def text(self) -> str:
        """All HTML texts of the page, tags taken away, pictures left out."""
        contents = (element.props.get("content", "") for element in self.elements.values())
        return " ".join(_TAGS.sub(" ", content) for content in contents if "data:image" not in content)

    def _apply(self, message: dict[str, Any]) -> None:
        kind, uuid = message["type"], message.get("uuid")
        if uuid is None:
            return
        if kind in ("GuiRemoveMessage", "RemoveCommandMessage"):
            removed = self.elements.pop(uuid, None)
            if removed is not None and _STEP_SHOWN.search(str(removed.props.get("content", ""))[:_IMAGE_HEAD]):
                self.step_shown = None
        elif kind in ("GuiUpdateMessage", "CommandUpdateMessage"):
            if uuid in self.elements:
                self.elements[uuid].props |= message["updates"]
                self._read(message["updates"].get("content"))
        elif "props" in message:
            self.elements[uuid] = Element(uuid, kind, dict(message["props"]))
            self._read(message["props"].get("content"))

    def _read(self, content: Any) -> None:
        """Takes steps from an element's new HTML."""
        if not isinstance(content, str):
            return
        if "data:image/jpeg" in content and (shown := _STEP_SHOWN.search(content[:_IMAGE_HEAD])):
            self.step_shown = int(shown.group(1))
            self.num_frames += 1
        elif counted := _STEP_COUNTED.search(content):
            self.step_counted = int(counted.group(1))


def decoded(data: bytes) -> list[dict[str, Any]]:
    """The messages of one websocket message: sizes, compressed msgpack, raw buffers, which are left out."""
    size = int.from_bytes(data[8:_HEAD_BYTES], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[_HEAD_BYTES : _HEAD_BYTES + size])
    return list(msgspec.msgpack.decode(inner)["messages"])
