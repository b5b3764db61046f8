"""Contact sheets: the places of their parts, views worth seeing, and crops that do not reveal their object."""

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from personal_viz.bench.homes.playability import home_facts
from personal_viz.contact_sheet.plan import storey_picture
from personal_viz.contact_sheet.sheet import PER_ROW, WIDTH, contact_sheet_picture, portraits, write_crops
from personal_viz.contact_sheet.views import CROP_SIDE, category_crops, object_crop, room_views, view_faults
from sim.frames import T_world_camera
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.types import Camera

from .program import assert_one_line, personal_viz


@pytest.fixture(scope="module")
def plan() -> HomePlan:
    return invent_plan("Invented3", seed=3)


@pytest.fixture(scope="module")
def scene(plan: HomePlan) -> Scene:
    return scene_from_plan(plan)


@pytest.fixture(scope="module")
def sheet(scene: Scene, plan: HomePlan) -> Image.Image:
    return contact_sheet_picture(scene, plan, facts=home_facts(scene, plan))


def rooms_of(scene: Scene, plan: HomePlan) -> dict[int, str]:
    return {item.instance_id: piece.room for item, piece in zip(scene.objects, plan.furniture, strict=True)}


@pytest.mark.slow
def test_four_views_show_different_rooms_and_no_wall(scene: Scene, plan: HomePlan) -> None:
    caster = Raycaster(scene.mesh)
    views = room_views(scene, caster, rooms=rooms_of(scene, plan), count=4)
    assert len(views) == 4
    assert len({view.room for view in views}) == 4
    for view in views:
        assert scene.navigation.is_navigable(np.array(view.pose.position))
        frame = caster.render(T_world_camera(view.pose, Camera(160, 120)), Camera(160, 120))
        assert np.median(frame.depth_m) > 1.2
        assert len(np.unique(frame.instance_ids)) >= 3
    again = room_views(scene, caster, rooms=rooms_of(scene, plan), count=4)
    assert again == views


def test_homes_whose_rooms_have_no_names_get_views_of_different_places(scene: Scene) -> None:
    views = room_views(scene, Raycaster(scene.mesh), rooms={}, count=4)
    assert [view.room for view in views] == [""] * 4
    assert len({view.pose.position for view in views}) >= 2


def test_a_crop_shows_its_object_and_nothing_is_written_on_it(scene: Scene) -> None:
    caster = Raycaster(scene.mesh)
    couch = next(item for item in scene.objects if item.category in ("couch", "bed"))
    found = object_crop(couch, scene, caster)
    pixels, crop = found
    assert pixels > 2000
    assert crop.rgb.shape == (CROP_SIDE, CROP_SIDE, 3)
    inside_a_wall = type(couch)(999, "ghost_1", "ghost", couch.centre, couch.size)
    assert object_crop(inside_a_wall, scene, caster) is None


def test_the_best_view_shows_an_object_whole_then_large_and_never_hardly_at_all() -> None:
    whole, larger, cut, sliver, nothing = np.zeros((5, 120, 160), bool)
    whole[50:60, 50:60] = larger[40:70, 40:70] = cut[20:120, 20:140] = sliver[5:7, 5:7] = True
    ranked = sorted([nothing, sliver, cut, whole, larger], key=view_faults)
    assert [int(view.sum()) for view in ranked] == [900, 100, 12_000, 4, 0]


def test_the_storey_is_to_scale_and_names_stand_on_it(scene: Scene, plan: HomePlan) -> None:
    named = storey_picture(scene, plan, plan.storeys[0].floor_y, size=(800, 600))
    bare = storey_picture(scene, plan.model_copy(update={"rooms": ()}), plan.storeys[0].floor_y, size=(800, 600))
    assert named.size == bare.size
    assert max(named.width / 800, named.height / 600) == pytest.approx(1.0, abs=0.01)
    rects = [room.rect for room in plan.rooms if room.storey == 0 and room.rect is not None]
    wide = max(rect.x1 for rect in rects) - min(rect.x0 for rect in rects)
    deep = max(rect.z1 for rect in rects) - min(rect.z0 for rect in rects)
    border = 2 * 0.3
    assert named.width / named.height == pytest.approx((wide + border) / (deep + border), rel=0.08)
    assert (np.asarray(named) != np.asarray(bare)).any(axis=2).mean() > 0.005


@pytest.mark.slow
def test_there_is_one_portrait_of_each_category(plan: HomePlan) -> None:
    tiles = portraits(plan)
    assert len(tiles) == len({piece.category for piece in plan.furniture})
    for picture, words in tiles:
        assert picture.size == (CROP_SIDE, CROP_SIDE)
        assert words
        assert len(picture.getcolors(CROP_SIDE**2) or []) > 1


@pytest.mark.slow
def test_the_sheet_has_titles_views_and_portraits(sheet: Image.Image, plan: HomePlan) -> None:
    assert sheet.width == WIDTH
    num_rows = -(-len({piece.category for piece in plan.furniture}) // PER_ROW)
    assert sheet.height > 480 + num_rows * CROP_SIDE + 300
    assert np.asarray(sheet)[:64].min() < 100  # the title
    assert np.asarray(sheet)[-34:].min() < 100  # the facts


@pytest.mark.slow
def test_a_home_without_a_plan_gets_crops_instead_of_portraits(scene: Scene) -> None:
    crops = category_crops(scene, Raycaster(scene.mesh))
    categories = [crop.item.category for crop in crops]
    assert categories == sorted(set(categories))
    assert len(categories) >= 0.7 * len({item.category for item in scene.objects})
    sheet = contact_sheet_picture(scene, None)
    assert sheet.width == WIDTH


@pytest.mark.slow
def test_crops_are_numbered_in_an_order_that_tells_nothing(scene: Scene, tmp_path: Path) -> None:
    count = write_crops(tmp_path, scene)
    with (tmp_path / "Invented3-key.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == count > 5
    assert max(Counter(row["category"] for row in rows).values()) == 1
    names = [row["category"] for row in rows]
    assert names != sorted(names)
    for row in rows:
        assert row["category"] not in row["file"]
        assert Image.open(tmp_path / row["file"]).size == (CROP_SIDE, CROP_SIDE)


@pytest.mark.slow
def test_the_command_draws_the_same_picture_of_an_invented_home_every_time(tmp_path: Path, sheet: Image.Image) -> None:
    out = tmp_path / "sheet.png"
    done = personal_viz("contact-sheet", "--invent", 3, "--out", out)
    assert done.returncode == 0
    assert f"{out}: Invented3 (invented home)" in done.stdout
    assert np.array_equal(np.asarray(Image.open(out)), np.asarray(sheet))


def test_mistakes_are_one_line(tmp_path: Path) -> None:
    assert_one_line(personal_viz("contact-sheet", "--out", str(tmp_path / "a.png")), "SCENE with --dataset DIR")
    assert_one_line(personal_viz("contact-sheet", "--invent", "1", "--out", str(tmp_path / "a.jpg")), "ends in .png")
    out = ("--out", tmp_path / "a.png")
    assert_one_line(personal_viz("contact-sheet", "A", "--invent", 1, *out), "--invent: found a SCENE")
    assert_one_line(personal_viz("contact-sheet", "--invent=-1", *out), "--invent is -1")
