"""A participant's page as a bot sees it: viser's messages, decoded without a browser."""

import re
from dataclasses import dataclass, field
from typing import Any

import msgspec
import zstandard

from human_study.texts.catalogue import ENGLISH, Catalogue, catalogue_of
from sim.tasks.run_files import Vector3

from ..study_app.page_script import LABEL

_STEP_SHOWN = re.compile(r'data-step="(\d+)"')
_SEAT = re.compile(r"personalPage\.begin\((?:&quot;|\")([\w-]+)(?:&quot;|\")")
_SEARCH = re.compile(r'data-search="(\d+)"')
_TAGS = re.compile(r"<style>.*?</style>|<[^>]*>", re.DOTALL)
_GOES_ON = "personalPage.goOn()"
_HEAD_BYTES = 16
"""Two numbers of 8 bytes come before the compressed part: its size before and after (viser's wire format)."""
_IMAGE_HEAD = 1200
"""Number of characters of an element's HTML that may hold the step; the picture's bytes come after them."""
_END_LOOK, _CONFIRM, _CONFIRM_ALL = "look.home_begin", "pog.confirm", "pog.confirm_all"
"""Words of the buttons that only the look screen and the POG screen have."""
_AFTER_STOREYS = (_END_LOOK, "pog.one_more", "pog.unmark", _CONFIRM, _CONFIRM_ALL)
"""Words of buttons that come after those of storeys."""
_MARK = re.compile(r"/mark\d+/(?:ball|dot)")
"""Names of the nodes at the participant's marks, in the 3-D home and on its map."""
_SURFACES = ("/home", "/map")
"""Names of the nodes at which people point."""


@dataclass(slots=True)
class Element:
    """A button, text, box or command of the page."""

    uuid: str
    kind: str
    """viser's message type: `GuiButtonMessage`, ..., or `RegisterCommandMessage`."""
    props: dict[str, Any]

    @property
    def label(self) -> str:
        """Its label; empty for plain HTML."""
        return str(self.props.get("label") or "")

    @property
    def is_usable(self) -> bool:
        """Whether a person could press it."""
        return bool(self.props.get("visible", True)) and not self.props.get("disabled", False)


@dataclass(slots=True)
class BotPage:
    """The present elements, the steps of the PAN screen, and the mark and surface of the POG screen."""

    words: Catalogue = field(default_factory=lambda: catalogue_of(ENGLISH))
    """The study's language, by which buttons are found."""
    elements: dict[str, Element] = field(default_factory=dict)
    """By viser's uuid, in the order in which they came."""
    step_shown: int | None = None
    """Number of actions before the shown picture; None without a picture."""
    step_counted: int | None = None
    """Number of actions on the counter."""
    num_frames: int = 0
    """Number of pictures received."""
    search: int = 0
    """Index of the present search of a home sequence; 0 in an episode."""
    mark: Vector3 | None = None
    """Place of the participant's newest mark, world metres; None without a mark."""
    num_marks: int = 0
    """Number of times that a mark was shown."""
    num_surfaces: int = 0
    """Number of times that a storey of the home or of its map was shown; where the server draws it, of pictures."""
    has_surface: bool = False
    """Whether a storey is shown on the present screen."""
    hears_clicks: bool = False
    """Whether viser's client would send a click into the scene."""

    def apply(self, data: bytes) -> None:
        """Applies one websocket message of viser."""
        for message in decoded(data):
            self._apply(message)

    @property
    def is_walking(self) -> bool:
        """Whether the PAN screen is there, on which keys move the robot."""
        return self.step_shown is not None and self.command("W") is not None

    def has_gone_on(self, search: int, step: int | None) -> bool:
        """Whether the trial has ended, the next search has begun, or an object was marked in a search for all.

        Args:
            search: The search in which STOP or FOUND was pressed.
            step: The step that was shown then.
        """
        if not self.is_walking or self.step_shown is None:
            return True
        if search != self.search:
            return self.step_shown == 0
        # The last picture of a trial, too, bears the next step: then FOUND cannot be pressed again.
        marked = self.button("pan.twice", action=self.words("pan.found_last"))
        return self.step_shown == (step or 0) + 1 and marked is not None

    @property
    def is_looking(self) -> bool:
        """Whether the home is shown before the texts that say what to find."""
        return self.has_surface and self.button(_END_LOOK) is not None

    @property
    def is_pointing(self) -> bool:
        """Whether the POG screen is there, on which clicks set the mark."""
        return self.has_surface and self.hears_clicks and self.confirm_button is not None

    @property
    def confirm_button(self) -> Element | None:
        """The button that makes the mark, or all marks, the answer."""
        return self.button(_CONFIRM) or self.button(_CONFIRM_ALL)

    @property
    def goes_on(self) -> bool:
        """Whether the browser is told to open the next page without 3-D."""
        return any(_GOES_ON in str(element.props.get("content", "")) for element in self.elements.values())

    @property
    def seat(self) -> str | None:
        """Name of this connection, which each message of the page's script carries; None before it came."""
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

    def button(self, key: str, **places: object) -> Element | None:
        """The first usable button whose label is this word, with anything in the places that are not given."""
        pattern = self.words.pattern(key, **places)
        buttons = self.of_kind("GuiButtonMessage")
        return next((element for element in buttons if re.fullmatch(pattern, element.label)), None)

    def says(self, key: str) -> bool:
        """Whether the page shows this text."""
        return re.search(self.words.pattern(key), self.text) is not None

    def storey_button(self, index: int) -> Element | None:
        """The button of a storey, counted from the lowest, whatever its name; None where there is only one storey.

        The buttons of storeys are the first ones of the screens on which one sees a home.
        """
        buttons = list(self.of_kind("GuiButtonMessage"))
        ends = tuple(self.words(key) for key in _AFTER_STOREYS)
        count = next((place for place, button in enumerate(buttons) if button.label in ends), 0)
        return buttons[index] if index < count else None

    @property
    def text(self) -> str:
        """All HTML texts of the page without tags and pictures."""
        contents = (element.props.get("content", "") for element in self.elements.values())
        return " ".join(_TAGS.sub(" ", content) for content in contents if "data:image" not in content)

    def _apply(self, message: dict[str, Any]) -> None:
        kind, uuid = message["type"], message.get("uuid")
        if uuid is None:
            self._apply_to_scene(kind, message)
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
            if self.elements[uuid].label in (self.words(_END_LOOK), self.words(_CONFIRM)):
                self.has_surface = False  # it comes after the buttons; what is there is the last screen's
            self._read(message["props"].get("content"))

    def _apply_to_scene(self, kind: str, message: dict[str, Any]) -> None:
        """Applies a message about the home, the mark or clicks."""
        if kind == "SetPositionMessage" and _MARK.fullmatch(message["name"]):
            x, y, z = (float(value) for value in message["position"])
            self.mark, self.num_marks = (x, y, z), self.num_marks + 1
        elif kind == "RemoveSceneNodeMessage" and _MARK.fullmatch(message["name"]):
            self.mark = None
        elif kind == "RemoveSceneNodeMessage" and message["name"] in _SURFACES:
            self.has_surface = False
        elif kind in ("GlbMessage", "ImageMessage") and message["name"] in _SURFACES:
            self.has_surface, self.num_surfaces = True, self.num_surfaces + 1
        elif kind == "BackgroundImageMessage":  # a home that the server draws
            self.has_surface = message["rgb_data"] is not None
            self.num_surfaces += self.has_surface
        elif kind == "ScenePointerEnableMessage" and message["event_type"] == "click":
            self.hears_clicks = bool(message["modifiers"])

    def _read(self, content: Any) -> None:
        """Reads steps from an element's new HTML."""
        if not isinstance(content, str):
            return
        if "data:image/jpeg" in content and (shown := _STEP_SHOWN.search(content[:_IMAGE_HEAD])):
            self.step_shown = int(shown.group(1))
            self.num_frames += 1
        elif counted := re.search(self.words.pattern("pan.step"), content):
            self.step_counted = int(counted.group(1))
        elif search := _SEARCH.search(content):
            self.search = int(search.group(1))


def decoded(data: bytes) -> list[dict[str, Any]]:
    """The messages of one websocket message (sizes, compressed msgpack, raw buffers) without the buffers."""
    size = int.from_bytes(data[8:_HEAD_BYTES], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[_HEAD_BYTES : _HEAD_BYTES + size])
    return list(msgspec.msgpack.decode(inner)["messages"])
