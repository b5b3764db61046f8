"""Recovered objects: their places, sizes and directions, in worlds with known answers."""

import math
from pathlib import Path

import numpy as np
import pytest

from personal_viz.bench.homes.sightlines import sights_of, view_points_ok
from sim.episodes.dataset import PersonalDataset
from sim.homes.furniture.families import look_of
from sim.homes.open_home import scene_from_plan
from sim.homes.recovered.footprints import fitted_footprint, kept_clear
from sim.homes.recovered.plans import recover_plan
from sim.homes.recovered.recorded import recorded_facts
from sim.homes.recovered.unhidden import made_way, unhidden
from sim.types import AGENT_RADIUS, CAMERA_HEIGHT

from .plans import piece
from .recorded_worlds import objects_of, recorded_goal, recorded_of

NO_POINTS = np.zeros((0, 2))
SOUTH = [(0.25 * k, 0.0, 1.2) for k in range(-2, 3)]
"""Places on the +z side of the origin."""


@pytest.mark.parametrize(
    ("side", "yaw"), [((0, 1), 0.0), ((1, 0), math.pi / 2), ((0, -1), math.pi), ((-1, 0), -math.pi / 2)]
)
def test_the_front_faces_the_view_points(side: tuple[int, int], yaw: float) -> None:
    across = np.array(side)[::-1]
    offsets = np.array([1.2 * np.array(side) + step * across for step in (-0.5, -0.25, 0, 0.25, 0.5)])
    found = fitted_footprint(offsets, offsets, usual=(0.9, 0.5), blocked=NO_POINTS)
    assert found.yaw == pytest.approx(yaw)
    assert found.size == (0.9, 0.5)
    assert found.middle == (0.0, 0.0)


def test_boxes_stretch_towards_far_view_points_and_shrink_away_from_blind_and_standing_places() -> None:
    row = np.array([(x, 0.9) for x in np.arange(-1.75, 1.76, 0.25)] + [(-1.75, 0.0), (1.75, 0.0)])
    found = fitted_footprint(row, row, usual=(1.2, 0.6), blocked=NO_POINTS)
    assert found.yaw == 0.0
    assert found.size == pytest.approx((2 * (0.75 + 0.0625), 0.6))
    seen = np.array([(x, 0.0) for x in (-1.25, 1.25)] + [(0.0, 0.7), (0.0, 1.0)])
    others = np.array([(x, 0.0) for x in (-1.75, -1.625, 1.625, 1.75)])
    found = fitted_footprint(seen, np.concatenate([seen, others]), usual=(1.5, 0.5), blocked=NO_POINTS)
    assert found.size[0] == pytest.approx(2 * (0.25 + 0.125), abs=0.2)
    assert found.size[0] < 1.5


LEAST = np.array([0.36, 0.36])


@pytest.mark.parametrize(
    ("places", "bounds"),
    [
        pytest.param([[0.5, 0.1], [-0.2, 0.45]], [[-0.25, -0.2], [0.25, 0.2]], id="thinner on both sides"),
        pytest.param([[x, 0.2] for x in (-0.3, 0.0, 0.3)], [[-0.3, -0.41], [0.3, -0.05]], id="it moves behind a front"),
        pytest.param([[0.02, 0.2 * k] for k in range(-6, 7)], [[-0.63, -0.18], [-0.27, 0.18]], id="to a side of a way"),
        pytest.param([[0.0, 0.0]], [[-0.18, -0.63], [0.18, -0.27]], id="away from a place on its centre"),
        pytest.param([[0.0, 0.2], [0.0, -0.55]], [[-0.63, -0.18], [-0.27, 0.18]], id="beside a way that is too narrow"),
    ],
)
def test_a_box_keeps_its_least_size_beside_the_places_where_somebody_stood(
    places: list[list[float]], bounds: list[list[float]]
) -> None:
    # the body takes 0.2 m in whole cells, and a map of the box loses one cell
    found = kept_clear(np.array([0.3, 0.3]), np.array(places), least=LEAST)
    assert found == pytest.approx(np.array(bounds), abs=0.05)
    assert all((found[0] - place).max() > 0.24 or (place - found[1]).max() > 0.24 for place in np.array(places))


def test_a_box_stays_thin_where_people_walked_all_around_and_through_it() -> None:
    steps = np.arange(-1.5, 1.6, 0.25)
    found = kept_clear(
        np.array([0.5, 0.3]), np.array([(x, z) for x in steps for z in steps]), least=np.array([0.6, 0.36])
    )
    assert found[1] - found[0] == pytest.approx([0.08, 0.08])


def test_a_dishwasher_reaches_back_from_the_front_that_the_record_calls_its_centre() -> None:
    near = [(0.1 * k, 0.0, 0.21) for k in range(-6, 7)]
    found = objects_of(recorded_of(recorded_goal("dishwasher_1", (0.0, 0.43, 0.0), SOUTH + near)))["dishwasher_1"].piece
    assert found.size == pytest.approx((0.6, 0.86, 0.36))
    assert found.rect.z1 == pytest.approx(0.21 - 0.25)
    assert found.centre[:2] == pytest.approx((0.0, 0.43))


def test_a_couch_is_twice_as_high_as_its_centre_and_a_picture_hangs_flat_on_the_wall() -> None:
    found = objects_of(recorded_of(recorded_goal("couch_4", (0.0, 0.41, 0.0), SOUTH)))["couch_4"]
    assert found.mounting == "floor"
    assert found.piece.centre == (0.0, 0.41, 0.0)
    assert found.piece.size[1] == pytest.approx(0.82)
    assert found.piece.yaw == 0.0
    found = objects_of(recorded_of(recorded_goal("picture_4", (0.3, 1.6, -0.1), SOUTH)))["picture_4"]
    assert found.mounting == "wall"
    assert found.piece.centre == (0.3, 1.6, -0.1)
    assert found.piece.size[2] == look_of("picture").size[2]
    assert found.piece.yaw == 0.0


def test_a_vase_above_a_table_stands_on_it_and_a_vase_in_the_air_gets_a_table() -> None:
    table = recorded_goal("table_1", (0.0, 0.37, 0.0), SOUTH)
    vase = recorded_goal("vase_2", (0.1, 0.93, 0.05), SOUTH)
    found = objects_of(recorded_of(table, vase))
    assert set(found) == {"table_1", "vase_2"}
    assert found["vase_2"].mounting == "on"
    assert found["vase_2"].piece.bottom_y == pytest.approx(0.74)
    assert found["vase_2"].piece.centre == (0.1, 0.93, 0.05)
    found = objects_of(recorded_of(recorded_goal("vase_2", (0.1, 0.93, 0.05), SOUTH)))
    support = found.pop("console table_3").piece
    assert support.role == "clutter"
    assert support.caption == ""
    assert support.top_y == pytest.approx(found["vase_2"].piece.bottom_y)
    assert support.bottom_y == pytest.approx(0.0)
    assert support.rect.holds(0.1, 0.05)


def test_a_lamp_high_up_hangs_from_the_ceiling_and_a_low_vase_stands_on_the_floor() -> None:
    lamp, vase = recorded_goal("lamp_1", (0.0, 2.1, 0.0), SOUTH), recorded_goal("vase_2", (2.0, 0.2, 0.0), SOUTH)
    found = objects_of(recorded_of(lamp, vase))
    assert found["lamp_1"].mounting == "ceiling"
    assert (found["vase_2"].mounting, found["vase_2"].piece.bottom_y) == ("floor", pytest.approx(0.0))


def test_a_hanging_lamp_leaves_headroom_above_the_places_below_it() -> None:
    low = objects_of(recorded_of(recorded_goal("lamp_1", (0.0, 2.1, 0.0), SOUTH), more=[(0.1, 0.0, 0.2)]))["lamp_1"]
    free = objects_of(recorded_of(recorded_goal("lamp_1", (0.0, 2.1, 0.0), SOUTH)))["lamp_1"]
    high = objects_of(recorded_of(recorded_goal("lamp_1", (0.0, 2.4, 0.0), SOUTH), more=[(0.1, 0.0, 0.2)]))["lamp_1"]
    assert free.piece.size[1] == pytest.approx(1.55)
    assert high.piece.bottom_y == pytest.approx(2.0)
    assert low.piece.size[1] == pytest.approx(0.55)
    assert low.piece.centre == free.piece.centre == (0.0, 2.1, 0.0)
    assert low.piece.size[0] == free.piece.size[0]


def test_a_low_table_is_too_high_to_step_on_and_a_box_stays_low() -> None:
    for name, top in (("coffee table_1", 0.42), ("box_2", 0.35)):
        found = objects_of(recorded_of(recorded_goal(name, (0.0, 0.15, 0.0), SOUTH)))[name].piece
        assert found.top_y == pytest.approx(top)
        assert found.centre[1] == 0.15


def test_places_on_top_of_a_bed_or_tub_do_not_shrink_it_and_do_not_count_as_its_floor() -> None:
    on_top = [(0.25 * k, 0.6, 0.1) for k in range(-2, 3)]
    around = [(x, 0.0, z) for x in (-1.3, 1.3) for z in (-0.5, 0.0, 0.5)]
    bed = objects_of(recorded_of(recorded_goal("bed_1", (0.0, 0.45, 0.0), on_top + around)))["bed_1"].piece
    assert bed.size[1] == pytest.approx(0.9)
    assert bed.top_y > 0.66
    assert min(bed.size[0], bed.size[2]) > 1.2
    places = [(0.1, 0.4, 0.1), *((x, 0.0, 1.2) for x in (-0.5, -0.25, 0.0, 0.25, 0.5))]
    tub = objects_of(recorded_of(recorded_goal("bathtub_1", (0.0, 0.16, 0.0), places)))["bathtub_1"].piece
    assert tub.top_y == pytest.approx(0.4 + 0.06)
    assert tub.centre[1] == 0.16


def test_boxes_keep_clear_of_places_on_the_floor() -> None:
    near = [(0.0, 0.0, 0.45), (0.5, 0.0, 0.3), (0.75, 0.0, -0.1)]
    added = [(-0.6, 0.0, 0.1)]
    recorded = recorded_of(recorded_goal("dresser_1", (0.0, 0.4, 0.0), SOUTH + near), more=added)
    found = objects_of(recorded)["dresser_1"].piece
    inside = [found.rect.grown(0.25 - 1e-6).holds(x, z) for x, _, z in (*near, *added)]
    assert inside == [False] * 4


@pytest.mark.parametrize("y", [-0.05, 0.0, 0.03])
def test_a_rug_shows_above_the_floor_at_any_height_of_its_centre(y: float) -> None:
    rug = objects_of(recorded_of(recorded_goal("rug_1", (0.0, y, 0.0), SOUTH)))["rug_1"].piece
    assert rug.centre[1] == y
    assert 0.003 < rug.top_y < 0.12


def test_the_colour_comes_from_the_caption() -> None:
    recorded = recorded_of(recorded_goal("couch_4", (0.0, 0.4, 0.0), SOUTH), captions={"couch_4": "a red couch"})
    finish = objects_of(recorded)["couch_4"].piece.finish
    assert finish.rgb[0] > 1.5 * max(finish.rgb[1:])


def test_an_oven_stands_out_of_its_cabinet_and_a_piece_in_front_shrinks_to_its_least_size() -> None:
    cabinet = piece("cabinet_1", (0.0, 1.0, 0.0), (1.0, 2.0, 0.6))
    oven, same = made_way(piece("oven_2", (0.0, 1.1, 0.05), (0.6, 0.6, 0.3)), cabinet, least=(0.1, 0.1))
    assert same == cabinet
    assert 0.3 < oven.centre[2] + oven.size[2] / 2 < 0.33
    assert oven.centre == (0.0, 1.1, 0.05)
    mirror, cabinet = piece("mirror_1", (0.0, 0.7, -0.5), (0.6, 0.9, 0.04)), piece("b_2", (0.0, 0.9, 0), (1, 1.8, 0.5))
    same, smaller = made_way(mirror, cabinet, least=(0.9, 0.2))
    assert same == mirror
    assert smaller.size == pytest.approx((0.9, 1.8, 0.4))
    assert smaller.centre == cabinet.centre


def test_a_hidden_object_can_be_seen_after_the_hiding_one_shrinks() -> None:
    picture = recorded_goal("picture_1", (0.0, 0.95, -0.6), SOUTH)
    wardrobe = recorded_goal("wardrobe_2", (0.0, 1.0, -0.1), SOUTH)
    recorded = recorded_of(picture, wardrobe)
    before = [found.piece for found in objects_of(recorded).values()]
    after = {piece.name: piece for piece in unhidden(before, recorded.goals)}
    assert set(after) == {"picture_1", "wardrobe_2"}
    assert after["wardrobe_2"].size[0] < before[1].size[0]
    line = after["wardrobe_2"].rect
    # from the outermost place, the edge of the picture shows past the near corner of the wardrobe
    assert line.x1 < 0.5
    assert unhidden(before, recorded.goals) == unhidden(before, recorded.goals)


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param("mL8ThkuaVTM", marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.release) for name in ("XB4GS9ShBRE", "QaLdnwvtxbs")),
    ],
)
def test_every_goal_of_a_released_home_is_near_its_recorded_centre_and_visible(dataset_root: Path, scene: str) -> None:
    dataset = PersonalDataset(dataset_root)
    goals, plan = dataset.goals(scene), recover_plan(dataset, scene)
    captioned = {item.name: item for item in plan.furniture if item.role == "captioned"}
    away = np.array([np.subtract(captioned[name].centre, goal.position) for name, goal in goals.items()])
    assert len(captioned) == len(goals)
    assert (away[:, 1] == 0).all()
    assert np.hypot(*away[:, [0, 2]].T).max() <= 0.8
    assert (away != 0).any(axis=1).mean() < 0.5
    assert [item.category for item in captioned.values()] == [goals[name].object_category for name in captioned]
    recorded = recorded_facts(dataset, scene)
    for item in captioned.values():
        # boxes are at least 8 cm thick, even if a place is too near to the recorded centre for that
        if look_of(item.category).family == "flat" or min(item.size[0], item.size[2]) < 0.081:
            continue
        near_floor = np.abs(recorded.places[:, 1] - goals[item.name].floor_y) < 0.2
        reached = (recorded.places[:, 1] + CAMERA_HEIGHT > item.bottom_y) & (recorded.places[:, 1] < item.top_y - 0.1)
        rect = item.rect.grown(AGENT_RADIUS - 0.02)
        inside = [rect.holds(x, z) for x, _, z in recorded.places[near_floor & reached]]
        assert not any(inside), item.name
    home = scene_from_plan(plan)
    num_ok, num = view_points_ok(home, goals)
    assert num == sum(len(goal.original_view_points) for goal in goals.values())
    assert num_ok >= 0.95 * num
    sights = sights_of(home, goals)
    assert [name for name, found in sights.items() if len(found.ok) and not found.ok.any()] == []


@pytest.mark.release
@pytest.mark.timeout(1200)
def test_things_of_released_homes_are_at_least_as_wide_and_deep_as_the_least_of_their_kind(dataset_root: Path) -> None:
    dataset = PersonalDataset(dataset_root)
    own = [
        (f"{scene} {item.name}", item, np.array(item.size)[[0, 2]] / np.array(look_of(item.category).size)[[0, 2]])
        for scene in dataset.scenes
        for item in recover_plan(dataset, scene).furniture
        if item.role == "captioned"
    ]
    built_in = [(name, item) for name, item, _ in own if look_of(item.category).family in ("dishwasher", "wardrobe")]
    assert len(built_in) > 30
    assert [name for name, item in built_in if min(item.size[0], item.size[2]) < 0.35] == []
    # a few stand where the record says that people walked all around and through them
    assert len([name for name, _, share in own if share.min() < 0.59]) <= 0.01 * len(own)
