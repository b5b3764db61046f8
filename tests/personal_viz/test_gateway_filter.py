"""The browser's messages that reach viser: their fields and their number."""

import dataclasses
import math

import msgspec
import pytest
from viser import _messages

from personal_viz.study_app.gateway.filter import (
    ACTION_RATE,
    CAMERA,
    CommandTriggerMessage,
    GuiUpdateMessage,
    RateLimit,
    ScenePointerMessage,
    ViewerCameraMessage,
    browser_message,
    viser_bytes,
)

from .gateways import CLICK, KEY_PRESS, PRESS, pack


@pytest.mark.parametrize("message", [CAMERA, CLICK, PRESS, KEY_PRESS])
def test_viser_gets_the_browsers_message_unchanged(message: dict) -> None:
    passed = browser_message(pack(message))
    assert passed is not None
    assert msgspec.msgpack.decode(viser_bytes(passed)) == message
    assert type(_messages.Message.deserialize(viser_bytes(passed))).__name__ == message["type"]


@pytest.mark.parametrize("kind", [ViewerCameraMessage, ScenePointerMessage, CommandTriggerMessage])
def test_our_fields_are_those_of_the_pinned_viser(kind: type[msgspec.Struct]) -> None:
    theirs = {item.name for item in dataclasses.fields(getattr(_messages, kind.__name__))}
    assert set(kind.__struct_fields__) == theirs
    assert {item.name for item in dataclasses.fields(_messages.GuiUpdateMessage)} == set(
        GuiUpdateMessage.__struct_fields__
    )


@pytest.mark.parametrize("value", [1.5, -3, "yes", "", None, False, [1.0, 2.0], [[1, 2], [3, 4]]])
def test_values_of_buttons_sliders_and_fields_pass(value: object) -> None:
    assert browser_message(pack({**PRESS, "updates": {"value": value}})) is not None


@pytest.mark.parametrize(
    "message",
    [
        {"type": "ShareUrlRequest"},
        {"type": "FileTransferStartUpload", "uuid": "b-1"},
        {"type": "GetRenderResponseMessage", "payload": b""},
        {"type": "LocalStorageGetItemResponseMessage", "value": "", "error": None, "request_uuid": "x"},
        {"no": "type"},
        {"type": ["CommandTriggerMessage"], "uuid": "c-1"},
        [1, 2],
        "CommandTriggerMessage",
        {**PRESS, "updates": {"update_cb": []}},
        {**PRESS, "updates": {"value": 1, "is_button": False}},
        {**PRESS, "updates": {}},
        {**PRESS, "updates": {"value": {"a": 1}}},
        {**PRESS, "updates": {"value": [[[1]]]}},
        {**PRESS, "updates": {"value": [0] * 1000}},
        {**PRESS, "uuid": 7},
        {**PRESS, "uuid": None},
        {**PRESS, "uuid": ""},
        {**PRESS, "uuid": "x" * 65},
        {**PRESS, "uuid": "<img src=x>"},
        {**KEY_PRESS, "target": "everybody"},
        {**CAMERA, "position": [math.nan, 0.0, 0.0]},
        {**CAMERA, "fov": math.inf},
        {**CAMERA, "fov": 0.0},
        {**CAMERA, "position": [1.0, 2.0]},
        {**CAMERA, "position": "here"},
        {**CAMERA, "image_height": -1},
        {**CAMERA, "extra": 1},
        {**CLICK, "screen_pos": [[0.5, math.nan]]},
        {**CAMERA, "position": CAMERA["look_at"]},
        {**CAMERA, "wxyz": [0.0, 0.0, 0.0, 0.0]},
        {**CAMERA, "up_direction": [0.0, 0.0, 0.0]},
        {**CAMERA, "position": [1e300, 0.0, 0.0]},
        {**CLICK, "ray_origin": None, "ray_direction": None},
        {**CLICK, "ray_direction": None},
        {**CLICK, "ray_direction": [0.0, 0.0, 0.0]},
        {**CLICK, "event_type": "rect-select"},
        {**CLICK, "screen_pos": []},
        {**CLICK, "screen_pos": [[0.5, 0.5]] * 100},
        {**CLICK, "modifier": "cmd'); drop"},
        {**PRESS, "updates": {"value": "x" * 70_000}},
    ],
)
def test_no_other_message_passes(message: object) -> None:
    assert browser_message(pack(message)) is None


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        bytes(range(256)),
        pack(CAMERA)[:-3],
        pack(CAMERA) + b"\x00",
        b"\x91" * 50_000,
        b"\x81\xa4type" * 10_000,
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff\xa4type",
        b"\x81\xa4type\xa2\xff\xfe",
    ],
)
def test_bytes_that_are_no_message_are_refused_and_not_an_error(data: bytes) -> None:
    assert browser_message(data) is None


def test_messages_over_the_rate_are_dropped_and_allowed_again_later() -> None:
    limit = RateLimit(*ACTION_RATE)
    assert sum(limit.allows(100.0) for _ in range(100)) == 20
    assert limit.wait_s(100.0) == pytest.approx(0.05)
    assert sum(limit.allows(101.0) for _ in range(100)) == 20
    assert limit.wait_s(102.0) == 0.0
