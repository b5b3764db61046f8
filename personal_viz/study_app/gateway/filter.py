"""Filters a browser's messages to viser: a closed list of types, every field checked, a few messages a second.

Allowed messages are encoded anew, so that viser cannot read them differently than we did.
"""

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import msgspec

MAX_MESSAGE_BYTES = 64 * 1024
"""Largest message that a browser may send; clicks and camera poses need under 1 kB."""
ACTION_RATE = (20.0, 20)
"""Actions of each type: (a second on average, at once). A person presses at most about 10 keys a second
(HUMAN_STUDY.md, section 7), and viser's client sends changed fields at most every 50 ms."""
CAMERA_RATE = (20.0, 5)
"""Camera messages: (a second on average, at once). viser's client sends up to 50 a second while somebody turns the
home; the newest is enough."""
FLOOD_RATE = (200.0, 400)
"""Messages of any kind: (a second on average, at once). No browser sends more; a client that does is disconnected."""
_Id = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9_:./-]{1,64}\Z")]
_Number = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
"""Metres and numbers computed from them; after a minute of zooming out a camera is a million metres away."""
_Vector = tuple[_Number, _Number, _Number]
_Angle = Annotated[float, msgspec.Meta(ge=0.01, le=3.14)]
"""A camera's field of view (radians)."""
_NEAREST = 1e-6
"""Least distance of a camera from its target, and least length of a direction (metres); viser cannot turn below it."""
_Pixels = Annotated[int, msgspec.Meta(ge=0, le=100_000)] | Annotated[float, msgspec.Meta(ge=0, le=100_000)]
_Scalar = bool | int | float | str | None
_Row = Annotated[list[_Scalar], msgspec.Meta(max_length=64)]
CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [3.0, 3.0, 3.0],
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 800,
    "image_width": 880,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}
"""A browser's first message, after which viser begins to send; for clients without a browser."""


class ViewerCameraMessage(msgspec.Struct, tag_field="type", tag=True, frozen=True, forbid_unknown_fields=True):
    """The pose of the browser's camera."""

    wxyz: tuple[_Number, _Number, _Number, _Number]
    position: _Vector
    fov: _Angle
    near: _Number
    far: _Number
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector


class ScenePointerMessage(msgspec.Struct, tag_field="type", tag=True, frozen=True, forbid_unknown_fields=True):
    """A click into the scene; viser's rectangle selections have no ray and are not clicks."""

    event_type: Literal["click"]
    ray_origin: _Vector
    ray_direction: _Vector
    screen_pos: Annotated[list[tuple[_Number, _Number]], msgspec.Meta(min_length=1, max_length=4)]
    modifier: Annotated[str, msgspec.Meta(pattern=r"\A[a-z/+]{1,32}\Z")] | None


class GuiValue(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The only attribute that a browser may set; viser itself would set any attribute."""

    value: _Scalar | Annotated[list[_Scalar | _Row], msgspec.Meta(max_length=64)]


class GuiUpdateMessage(msgspec.Struct, tag_field="type", tag=True, frozen=True, forbid_unknown_fields=True):
    """The press of a button, or a change of a field."""

    uuid: _Id
    updates: GuiValue


class CommandTriggerMessage(msgspec.Struct, tag_field="type", tag=True, frozen=True, forbid_unknown_fields=True):
    """The press of a key."""

    uuid: _Id


BrowserMessage = ViewerCameraMessage | ScenePointerMessage | GuiUpdateMessage | CommandTriggerMessage
"""All messages that a participant's browser may send; tunnel, upload, render and storage messages are not allowed."""
_DECODER = msgspec.msgpack.Decoder(BrowserMessage)
_ENCODER = msgspec.msgpack.Encoder()


def browser_message(data: bytes) -> BrowserMessage | None:
    """A browser's message; None unless it is small, well formed, on the list, complete and finite."""
    if len(data) > MAX_MESSAGE_BYTES:
        return None
    try:
        message = _DECODER.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return message if _is_finite(message) and _has_directions(message) else None


def viser_bytes(message: BrowserMessage) -> bytes:
    """The message in viser's encoding."""
    return _ENCODER.encode(message)


class RateLimit:
    """A token bucket: `rate` a second on average, `burst` at once."""

    def __init__(self, rate: float, burst: int) -> None:
        """Starts full."""
        self._rate, self._burst = rate, burst
        self._left, self._last_s = float(burst), 0.0

    def allows(self, now_s: float) -> bool:
        """Takes one token, and returns whether one was left at this time (seconds on a steady clock)."""
        if not self.has_one(now_s):
            return False
        self._left -= 1
        return True

    def has_one(self, now_s: float) -> bool:
        """Whether a token is left; takes none."""
        self._left = min(self._burst, self._left + (now_s - self._last_s) * self._rate)
        self._last_s = now_s
        return self._left >= 1

    def wait_s(self, now_s: float) -> float:
        """Seconds until a token is left."""
        return 0.0 if self.has_one(now_s) else (1 - self._left) / self._rate


def _has_directions(message: BrowserMessage) -> bool:
    """Whether each vector of a message is long enough to have a direction."""
    match message:
        case ViewerCameraMessage():
            looks = math.dist(message.position, message.look_at)
            return looks > _NEAREST and _length(message.up_direction) > _NEAREST and 0.5 < _length(message.wxyz) < 2
        case ScenePointerMessage():
            return _length(message.ray_direction) > _NEAREST
        case _:
            return True


def _length(vector: Iterable[float]) -> float:
    return math.hypot(*vector)


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return value - value == 0
    if isinstance(value, msgspec.Struct):
        return all(_is_finite(getattr(value, name)) for name in value.__struct_fields__)
    if isinstance(value, (list, tuple)):
        return all(_is_finite(item) for item in value)
    return True
