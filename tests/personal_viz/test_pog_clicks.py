"""From rays and moves of the mark to clicks: on the map exact to the rounding, on the home where the ray meets it."""

import math
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from human_study.trial.outcome import HIT_TOLERANCE
from human_study.trial.views import Mark, PogView
from personal_viz.study_app.home.surfaces import map_click
from personal_viz.study_app.home.top_view import TopView
from personal_viz.study_app.screens.pog import Nudge, click_of
from sim.copies.cut import StoreyCut
from sim.episodes.dataset import PersonalDataset
from sim.homes.open_home import open_scene
from sim.mesh import SceneObject
from sim.render.raycast import Raycaster
from sim.tasks.pog import PogScene
from sim.tasks.run_files import ClickRay, Vector3
from sim.types import GridSpec

from ..human_study.small_world import episode, study

GRID = GridSpec((-4.0, -3.0), 0.01, (600, 800))
MAPS = tuple(TopView(GRID, floor_y, f"Storey {number} of 2", b"") for number, floor_y in enumerate((0.0, 3.0), start=1))


def ray_to(point: Vector3, eye: Vector3, *, storey_y: float) -> ClickRay:
    """A ray from an eye through a point, with a direction of arbitrary length."""
    direction = tuple(0.7 * (to - at) for at, to in zip(eye, point, strict=True))
    return ClickRay(
        origin=eye,
        direction=direction,
        camera_position=eye,
        camera_wxyz=(1.0, 0.0, 0.0, 0.0),
        storey_y=storey_y,
    )


LAMP = SceneObject(7, "lamp_7", "lamp", (1.4, 0.5, 0.9), (1.0, 1.0, 1.0))


def view(*, storey: int = 0, mark: Vector3 | None = None, point: Vector3 | None = None) -> PogView:
    """A view with a mark on the ground floor, at the click's place or at another point."""
    task = study().task_for(episode(), "pog")
    return PogView(task, (0.0, 3.0), storey, mark and Mark(point or mark, mark, storey=0), is_over=False)


class Home:
    """A home of two storeys whose floors are all that rays meet."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, tuple, tuple]] = []
        self.pog_scene = self
        self.copies: Any = SimpleNamespace(
            maps=MAPS, cuts=(StoreyCut(-0.4, 1.9), StoreyCut(2.6, 4.9)), middle=lambda index: (0.5, 0.25)
        )

    def hit(self, storey: int, origin: Vector3, direction: Vector3) -> Vector3 | None:
        self.asked.append((storey, tuple(origin), tuple(direction)))
        return (origin[0], (0.0, 3.0)[storey], origin[2])

    def object_at(self, storey: int, origin: Vector3, direction: Vector3) -> SceneObject | None:
        """A lamp stands in one quarter of the lower storey."""
        return LAMP if storey == 0 and origin[0] > 0.9 and origin[2] > 0.4 else None

    def middle_of(self, storey: int, item: SceneObject) -> Vector3:
        return item.centre


@given(
    uv=st.tuples(st.floats(0.01, 799.99), st.floats(0.01, 599.99)),
    eye=st.tuples(st.floats(-20, 20), st.floats(0.1, 50), st.floats(-20, 20)),
    storey=st.sampled_from([0, 1]),
)
def test_a_ray_to_a_place_on_the_map_is_a_click_on_that_place(
    uv: tuple[float, float], eye: Vector3, storey: int
) -> None:
    floor_y = MAPS[storey].floor_y
    x, z = GRID.xz_from_uv(np.array(uv)).tolist()
    click = map_click(MAPS[storey], ray_to((x, floor_y, z), (eye[0], floor_y + eye[1], eye[2]), storey_y=floor_y))
    assert click.hit == click.pixel.point(floor_y)  # as outcomes require, to the last bit
    assert math.dist(click.hit, (x, floor_y, z)) < HIT_TOLERANCE
    assert click.pixel.uv == pytest.approx(uv, abs=1e-4)


@pytest.mark.parametrize(
    "direction", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (9.0, -1.0, 0.0), (0.0, -1.0, -9.0)]
)
def test_a_ray_that_leaves_the_map_hits_nothing(direction: Vector3) -> None:
    ray = ray_to((0.0, 0.0, 0.0), (0.0, 2.0, 0.0), storey_y=0.0).model_copy(update={"direction": direction})
    click = map_click(MAPS[0], ray)
    assert (click.hit, click.pixel) == (None, None)
    assert click.ray == ray


def test_a_ray_counts_on_the_storey_that_the_browser_showed_when_it_was_sent() -> None:
    ray = ray_to((1.0, 0.0, 1.0), (1.0, 9.0, 1.0), storey_y=0.0)
    home: Any = Home()
    assert click_of(ray, view(storey=1), home, is_map=True).hit == pytest.approx((1.0, 0.0, 1.0))
    assert click_of(ray, view(storey=1), home, is_map=False).hit == (1.0, 0.0, 9.0 - 8.0)
    assert home.asked == [(0, ray.origin, ray.direction)]


@pytest.mark.parametrize("is_map", [True, False])
def test_a_mark_is_moved_over_the_ground(is_map: bool) -> None:
    home: Any = Home()
    click = click_of(Nudge(0.1, -0.2), view(mark=(1.0, 0.7, 1.0)), home, is_map=is_map)
    assert click.hit == pytest.approx((1.1, 0.0, 0.8))
    assert (click.pixel is not None) == is_map
    assert click.ray.direction == (0.0, -1.0, 0.0)
    if not is_map:
        assert home.asked[0][1] == pytest.approx((1.1, 1.89, 0.8))  # from just under the cut: over all that is shown


@pytest.mark.parametrize("mark", [None, (2.0, 0.5, 2.0)])
@pytest.mark.parametrize("is_map", [True, False])
def test_a_storey_without_a_mark_gets_it_in_its_middle(mark: Vector3 | None, is_map: bool) -> None:
    home: Any = Home()
    click = click_of(Nudge(0.1, 0.0), view(storey=1, mark=mark), home, is_map=is_map)
    assert click.hit == pytest.approx((0.5, 3.0, 0.25))
    assert click.ray.storey_y == 3.0


def test_a_mark_cannot_be_moved_off_the_map() -> None:
    home: Any = Home()
    click = click_of(Nudge(0.1, 0.0), view(mark=(3.95, 0.0, 0.0)), home, is_map=True)
    assert click.hit is None


@pytest.mark.parametrize("is_map", [True, False])
def test_a_mark_goes_to_the_middle_of_the_clicked_object_only_where_the_study_says_so(is_map: bool) -> None:
    home: Any = Home()
    on_lamp, beside = (ray_to((x, 0.0, 1.0), (x, 9.0, 1.0), storey_y=0.0) for x in (1.2, 0.2))
    snapped = click_of(on_lamp, view(), home, is_map=is_map, snaps=True)
    assert (snapped.object_name, snapped.snapped) == ("lamp_7", LAMP.centre)
    assert snapped.hit == pytest.approx((1.2, 0.0, 1.0))  # the raw place is kept
    free = click_of(on_lamp, view(), home, is_map=is_map)
    assert (free.object_name, free.snapped, free.hit) == ("lamp_7", None, snapped.hit)
    missed = click_of(beside, view(), home, is_map=is_map, snaps=True)
    assert (missed.object_name, missed.snapped) == (None, None)


def test_a_click_on_the_floor_of_a_scan_is_known_as_one_and_stays_where_it_is(
    tmp_path: Path, small_home_root: Path
) -> None:
    for file in (small_home_root / "scenes").glob("Small.*"):
        shutil.copy(file, tmp_path)
    text = tmp_path / "Small.semantic.txt"
    lines = text.read_text(encoding="utf-8").splitlines(keepends=True)
    number, colour, _, region = lines[1].split(",")
    text.write_text("".join([lines[0], f'{number},{colour},"Shower floor",{region}', *lines[2:]]), encoding="utf-8")
    scene = open_scene(PersonalDataset(small_home_root), "Small", scenes_dir=tmp_path)
    pog_scene = PogScene(scene, make_renderer=Raycaster)
    home: Any = SimpleNamespace(pog_scene=pog_scene)
    clicks = []
    for item in scene.objects[:2]:
        (x, y, z), task = item.centre, study().task_for(episode(), "pog")
        shown = PogView(task, pog_scene.storeys, 0, None, is_over=False)
        ray = ray_to((x, y, z), (x, y + 9.0, z), storey_y=pog_scene.storeys[0])
        clicks.append(click_of(ray, shown, home, is_map=False, snaps=True))
    floor, other = clicks
    assert (floor.object_name, floor.snapped) == (f"Shower floor_{number}", None)
    assert floor.hit is not None
    assert (other.object_name, other.snapped) == (scene.objects[1].name, pog_scene.middle_of(0, scene.objects[1]))


def test_a_place_on_the_map_is_the_object_under_it_however_the_browsers_camera_stands() -> None:
    home: Any = Home()
    slanted = ray_to((1.2, 0.0, 1.0), (-3.0, 9.0, -3.0), storey_y=0.0)
    assert click_of(slanted, view(), home, is_map=True).object_name == "lamp_7"


def test_a_mark_on_an_object_is_moved_from_the_clicked_place_so_that_it_can_leave() -> None:
    home: Any = Home()
    shown = view(mark=(1.0, 0.7, 1.0), point=LAMP.centre)
    moved = click_of(Nudge(-0.15, 0.0), shown, home, is_map=False, snaps=True)
    assert moved.hit == pytest.approx((0.85, 0.0, 1.0))
    assert moved.snapped is None
