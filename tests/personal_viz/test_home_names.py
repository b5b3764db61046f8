"""Names in a home: none covers another in the window, and they show when the camera rests."""

import asyncio
import contextlib
import itertools
import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from human_study.design.study import StudyPog
from personal_viz.study_app.home.homes import Home
from personal_viz.study_app.home.names import (
    LETTER_PX,
    LINE_PX,
    PADDING_PX,
    HomeNames,
    Name,
    laid_out,
    names_of_objects,
    names_of_rooms,
)
from personal_viz.study_app.screens.camera import NamesButton
from sim.homes.invented.plans import invent_plan
from sim.mesh import SceneObject
from sim.tasks.run_files import Vector3

from .test_camera import ButtonPage

WINDOW = (800.0, 600.0)
RIGHT_ANGLE = math.radians(90)
FOCAL = 300.0
"""Of this window at a right angle, pixels."""
AT_ORIGIN = np.diag([1.0, -1.0, -1.0, 1.0])
"""A camera at the origin that looks along -z with +y up."""


def placed(*names: Name) -> list[Vector3 | None]:
    return laid_out(names, AT_ORIGIN, window=WINDOW, fov=RIGHT_ANGLE)


def pixel(place: Vector3) -> tuple[float, float]:
    """Where the camera sees a place."""
    x, y, z = place
    return WINDOW[0] / 2 + FOCAL * x / -z, WINDOW[1] / 2 + FOCAL * y / z


def test_a_name_alone_stays_at_its_place_and_a_second_one_there_moves_up_by_a_line() -> None:
    first, second = placed(Name("chair", (1.0, 0.5, -5.0)), Name("table", (1.0, 0.5, -5.0)))
    assert first == (1.0, 0.5, -5.0)
    assert second == pytest.approx((1.0, 0.5 + (LINE_PX + 1) * 5 / FOCAL, -5.0))  # in the window, at the same depth


def test_names_behind_the_camera_or_outside_the_window_are_left_out() -> None:
    assert placed(Name("a", (0.0, 0.0, 5.0)), Name("b", (0.0, 0.0, 0.0)), Name("c", (9.0, 0.0, -5.0))) == [None] * 3


def test_where_there_is_no_room_the_least_important_names_are_left_out() -> None:
    found = placed(*[Name("chest of drawers", (0.0, 0.0, -5.0))] * 200)
    shown = [place for place in found if place is not None]
    assert len(shown) == 5  # its place, and one or two lines above or below
    assert None not in found[: len(shown)]


@given(
    st.lists(
        st.tuples(st.text("abc ", min_size=1, max_size=20), *[st.floats(-3, 3)] * 2, st.floats(-9, 2)), max_size=25
    )
)
def test_no_label_covers_another(found: list[tuple[str, float, float, float]]) -> None:
    names = [Name(text, (x, y, z)) for text, x, y, z in found]
    shown = [(name, pixel(place)) for name, place in zip(names, placed(*names), strict=True) if place is not None]
    for (one, a), (other, b) in itertools.combinations(shown, 2):
        wide = (LETTER_PX * (len(one.text) + len(other.text)) / 2) + PADDING_PX
        assert abs(a[0] - b[0]) >= wide - 1e-6 or abs(a[1] - b[1]) >= LINE_PX - 1e-6, (one, other)


class Scene:
    """viser's scene, as far as names use it."""

    def __init__(self) -> None:
        self.labels: dict[str, Any] = {}
        self.root: Any = None

    def add_frame(self, name: str, *, show_axes: bool) -> Any:
        self.root = SimpleNamespace(visible=True, remove=self.labels.clear)
        return self.root

    def add_label(self, name: str, text: str, *, position: Vector3, anchor: str, visible: bool) -> Any:
        self.labels[name] = SimpleNamespace(text=text, position=position, visible=visible)
        return self.labels[name]


class Client:
    """A browser whose camera is at the origin and looks along -z."""

    def __init__(self) -> None:
        self.scene = Scene()
        self.camera = SimpleNamespace(
            wxyz=(0.0, 1.0, 0.0, 0.0), position=(0.0, 0.0, 0.0), image_width=800, image_height=600, fov=RIGHT_ANGLE
        )

    def atomic(self) -> contextlib.nullcontext:
        return contextlib.nullcontext()

    def flush(self) -> None: ...


def test_names_are_away_while_the_camera_moves_and_come_back_for_its_last_place() -> None:
    client: Any = Client()
    names = HomeNames(client)
    names.show([Name("lamp", (0.0, 0.0, -5.0))])
    (label,) = client.scene.labels.values()
    assert (label.visible, client.scene.root.visible) == (True, True)

    async def move() -> None:
        first = asyncio.create_task(names.camera_moved())
        await asyncio.sleep(0)
        assert not client.scene.root.visible
        client.camera.position = (0.0, 0.0, -9.0)  # past the lamp
        await asyncio.gather(first, names.camera_moved())

    asyncio.run(move())
    assert (label.visible, client.scene.root.visible) == (False, True)
    names.remove()
    asyncio.run(names.camera_moved())
    assert not client.scene.labels


def test_the_label_of_the_mark_keeps_its_room() -> None:
    client: Any = Client()
    names = HomeNames(client)
    names.show([Name("lamp", (0.0, 0.0, -5.0))])
    (label,) = client.scene.labels.values()
    names.keep_free([Name("your mark", (0.0, 0.0, -5.0))])
    assert label.position[1] > 0.1
    names.keep_free([])
    assert label.position == (0.0, 0.0, -5.0)


def test_names_that_go_while_they_are_laid_out_are_not_changed_afterwards() -> None:
    client: Any = Client()
    names = HomeNames(client)
    names.show([Name("lamp", (0.0, 0.0, -5.0)), Name("sofa", (0.0, 0.0, -9.0))])
    going, is_gone, changed_after = threading.Thread(target=names.remove), threading.Event(), list[bool]()

    def gone(clear: Callable[[], None] = client.scene.root.remove) -> None:
        is_gone.set()
        clear()

    def atomic() -> contextlib.nullcontext:
        going.start()  # the participant's thread, in the middle of a lay-out
        going.join(0.2)
        changed_after.append(is_gone.is_set())
        return contextlib.nullcontext()

    client.scene.root.remove, client.atomic = gone, atomic
    asyncio.run(names.camera_moved())
    going.join()
    assert (changed_after, client.scene.labels) == ([False], {})


def thing(category: str, width: float) -> SceneObject:
    return SceneObject(3, f"{category}_3", category, (1.0, 0.5, 2.0), (width, 1.0, 1.0))


def test_large_things_are_named_first_and_parts_of_the_building_never() -> None:
    parts = [thing(category, 9.0) for category in ("Wall", "shower wall", "door frame", "unknown")]
    found = names_of_objects([thing("vase", 0.2), *parts, thing("sofa", 2.0)])
    assert [name.text for name in found] == ["sofa", "vase"]
    assert found[0].place == pytest.approx((1.0, 1.1, 2.0))


def test_every_room_of_a_plan_is_named_on_its_storey_in_its_middle() -> None:
    plan = invent_plan("Home", seed=4)
    heights = [storey.floor_y for storey in plan.storeys]
    found = names_of_rooms(plan, heights)
    assert [len(names) for names in found] == [
        sum(room.storey == k for room in plan.rooms) for k in range(len(heights))
    ]
    room = plan.rooms[0]
    assert room.rect is not None
    (name,) = [name for name in found[room.storey] if (name.place[0], name.place[2]) == room.rect.centre]
    assert name.text.lower() == room.name.lower()
    assert not names_of_rooms(plan, [50.0])[0]


@pytest.mark.parametrize(
    ("kind", "choices", "shown", "asked"),
    [
        ("schematic", {}, ["sofa"], ["sofa"]),
        ("scan", {}, [], []),
        ("scan", {"object_names": "on"}, ["sofa"], ["sofa"]),
        ("schematic", {"object_names": "off", "room_names": "on"}, ["Kitchen"], ["Kitchen"]),
        ("schematic", {"object_names": "demand", "room_names": "demand"}, [], ["Kitchen", "sofa"]),
        ("schematic", {"room_names": "demand"}, ["sofa"], ["Kitchen", "sofa"]),
    ],
)
def test_a_home_has_the_names_that_the_study_shows(
    kind: str, choices: dict[str, Any], shown: list[str], asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    names_of: list[Any] = []
    monkeypatch.setattr(
        "personal_viz.study_app.home.homes.SceneView", lambda client, copies, found: names_of.append(found)
    )
    fields: dict[str, Any] = dict.fromkeys(Home.__dataclass_fields__)
    fields |= {"scene": SimpleNamespace(kind=kind), "view": "browser", "rooms": ((Name("Kitchen", (0.0, 0.0, 0.0)),),)}
    fields |= {"copies": SimpleNamespace(objects=lambda _: [thing("sofa", 2.0)])}
    Home(**fields).shown_in(Client(), StudyPog(**choices))  # type: ignore[arg-type]
    for is_asked, expected in ((False, shown), (True, asked)):
        assert [name.text for name in names_of[0](0, is_asked)] == expected


def test_the_button_for_names_says_what_it_does_next(monkeypatch: pytest.MonkeyPatch) -> None:
    page, sent, told = ButtonPage(), list[Any](), list[bool]()
    surface = SimpleNamespace(ask_names=lambda *, is_asked: told.append(is_asked))
    monkeypatch.setattr("personal_viz.study_app.screens.camera.HomeSurface", SimpleNamespace)

    async def send(command: Any) -> None:
        sent.append(command)

    button = NamesButton(page, surface, send, is_there=True)  # type: ignore[arg-type]
    button.show(is_shown=False)
    asyncio.run(page.buttons[0].press())
    button.show(is_shown=True)
    asyncio.run(page.buttons[0].press())
    assert ([command.is_shown for command in sent], told) == ([True, False], [False, True])
    assert page.buttons[0].label == "Hide labels in the home"
    NamesButton(page, surface, send, is_there=False).show(is_shown=True)  # type: ignore[arg-type]
    assert len(page.buttons) == 1
