"""The closed list of events as text, in both directions, and the lines that the first version wrote."""

import numpy as np
import pytest

from human_study.trial.events import (
    Act,
    Clicked,
    Confidence,
    Event,
    MapOff,
    MapOn,
    MapPixel,
    Moment,
    Net,
    Open,
    Resized,
    Shown,
    TimedOut,
    event_from_json,
    event_to_json,
)
from sim.errors import StudyError
from sim.types import Action, GridSpec

from .trials import RAY

VERSION_1 = (
    '{"t_s":0.0,"t_cli_ms":null,"kind":"open","task":"pan","split":"easy","scene":"room","episode_id":"0",'
    '"scene_digest":"dd","max_steps":500,"actions":["stop","forward","left","right"],"position":[0.0,0.0,0.0],'
    '"yaw":0.0}',
    '{"t_s":0.0,"t_cli_ms":null,"kind":"shown","step":0,"frame_hash":null}',
    '{"t_s":0.5,"t_cli_ms":5.5,"kind":"key","code":"KeyW","action":"forward","repeat":false}',
    '{"t_s":0.5,"t_cli_ms":null,"kind":"dropped","reason":"nothing_marked"}',
    '{"t_s":0.5,"t_cli_ms":null,"kind":"act","action":"forward","position":[0.0,0.0,-0.25],"yaw":0.0,"tilt":0.0,'
    '"collided":false}',
    '{"t_s":1.0,"t_cli_ms":null,"kind":"stop_armed"}',
    '{"t_s":1.5,"t_cli_ms":null,"kind":"stop"}',
    '{"t_s":1.0,"t_cli_ms":null,"kind":"cam","position":[0.0,5.0,0.0],"wxyz":[1.0,0.0,0.0,0.0]}',
    '{"t_s":1.0,"t_cli_ms":null,"kind":"storey","storey_y":3.0}',
    '{"t_s":1.0,"t_cli_ms":null,"kind":"click","ray":{"origin":[0.0,2.0,0.0],"direction":[0.0,-1.0,0.0],'
    '"camera_position":[0.0,2.0,0.0],"camera_wxyz":[1.0,0.0,0.0,0.0],"storey_y":0.0},"hit":[1.0,0.0,1.0],'
    '"provisional":true}',
    '{"t_s":2.0,"t_cli_ms":null,"kind":"confirm"}',
    '{"t_s":2.0,"t_cli_ms":null,"kind":"giveup"}',
    '{"t_s":null,"t_cli_ms":null,"kind":"reconnect","epoch":2,"away_s":30.0}',
    '{"t_s":2.0,"t_cli_ms":null,"kind":"abandoned","away_s":700.0}',
    '{"t_s":2.0,"t_cli_ms":null,"kind":"error","message":"renderer died","is_fatal":true}',
)
PIXEL = MapPixel(uv=(10.25, 3.5), origin_xz=(-2.0, 4.0), pixel_m=0.02, shape=(200, 300))
NEW: list[Event] = [
    Shown(t_s=0.0, step=4, frame_hash="a" * 64, blocked=True),
    MapOn(t_s=0.0, what="topdown", min_s=10.0, max_s=60.0),
    MapOn(t_s=0.0, what="home", min_s=0.0, max_s=None),
    Moment(kind="looking", t_s=5.0),
    MapOff(t_s=20.0, what="glb", reason="time", look_s=20.0),
    TimedOut(t_s=300.0, limit_s=300.0),
    Moment(kind="giveup_armed", t_s=1.0),
    Moment(kind="superseded", t_s=1.0),
    Resized(t_s=1.0, width=1350, height=650),
    Net(t_s=1.0, round_trip_ms=40.5),
    Moment(kind="context_lost", t_s=1.0),
    Confidence(t_s=9.0, value=5),
    Confidence(t_s=9.0, value=None),
    Clicked(t_s=1.0, ray=RAY, hit=(1.0, 0.0, 2.0), pixel=PIXEL),
    Clicked(ray=RAY, hit=None, t_cli_ms=12.25),
    Act(action=Action.FORWARD, position=(0.1, 1e-300, -1 / 3), yaw=0.1 + 0.2, collided=True, t_s=1.0),
]


@pytest.mark.parametrize("line", VERSION_1)
def test_a_line_of_the_first_version_still_reads(line: str) -> None:
    event = event_from_json(line)
    assert f'"kind":"{event.kind}"' in line
    assert event_from_json(event_to_json(event)) == event


def test_the_first_version_had_all_of_its_kinds_and_no_condition() -> None:
    events = [event_from_json(line) for line in VERSION_1]
    assert len({event.kind for event in events}) == 15
    assert isinstance(events[0], Open)
    assert events[0].condition is None


@pytest.mark.parametrize("event", NEW, ids=lambda event: event.kind)
def test_a_new_kind_comes_back_as_it_was(event: Event) -> None:
    assert event_from_json(event_to_json(event)) == event


def test_an_unknown_kind_is_refused_with_every_kind_of_the_specification() -> None:
    expected = "open shown key act cam click confirm stop giveup map_on map_off focus blur hidden visible resize net"
    expected += " reconnect superseded error confidence timeout context_lost"
    with pytest.raises(StudyError, match="'kind': 'teleport'") as caught:
        event_from_json('{"kind": "teleport"}')
    assert all(f"'{kind}'" in str(caught.value) for kind in expected.split())


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('{"kind": "confidence", "value": 6}', "value is 6"),
        ('{"kind": "confidence", "value": 0}', "value is 0"),
        ('{"kind": "map_on", "what": "goal", "min_s": 0.0, "max_s": null}', "what is 'goal'"),
        ('{"kind": "net", "round_trip_ms": -1.0}', "round_trip_ms is -1.0"),
        ('{"kind": "resize", "width": 1e9, "height": 1}', "width"),
        ('{"kind": "hidden", "ip": "127.0.0.1"}', "ip is"),
        ("{", "found text that is not JSON|is text that is not JSON"),
        ("[]", "expected"),
        ('{"code": "KeyW"}', "expected: Unable to extract tag using discriminator 'kind'"),
        ('{"kind": "key", "code": "KeyW", "action": "fly"}', "action is 'fly'"),
        ('{"kind": "key", "code": "KeyW", "action": "stop", "goal": 1}', "goal is 1"),
        ('{"kind": "act", "action": "stop", "position": [0, 0, NaN], "yaw": 0}', "expected"),
        ('{"kind": "act", "action": "stop", "position": [0, 0, 1e999], "yaw": 0}', "finite number"),
        ('{"kind": "act", "action": "stop", "position": [0, 0, "1"], "yaw": 0}', "position.2 is '1'"),
    ],
)
def test_text_that_is_no_event_is_refused_in_one_line(line: str, message: str) -> None:
    with pytest.raises(StudyError, match=message) as caught:
        event_from_json(line, where="study.db: T1/4")
    assert str(caught.value).startswith("study.db: T1/4: ")
    assert "\n" not in str(caught.value)


def test_a_pixel_with_its_picture_is_a_place_in_the_world() -> None:
    assert PIXEL.point(0.5) == pytest.approx((-2.0 + 10.25 * 0.02, 0.5, 4.0 + 3.5 * 0.02), abs=1e-12)
    grid = PIXEL.grid
    assert grid == GridSpec((-2.0, 4.0), 0.02, (200, 300))
    assert grid.uv_from_xz(grid.xz_from_uv(np.array([10.25, 3.5]))) == pytest.approx([10.25, 3.5], abs=1e-9)
    assert grid.rc_from_xz(grid.xz_from_uv(np.array([10.25, 3.5]))).tolist() == [3, 10]
    assert grid.xz_from_uv(np.array([10.5, 3.5])) == pytest.approx(grid.xz_from_rc(np.array([3, 10])), abs=1e-12)
