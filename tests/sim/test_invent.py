"""Invented homes: what they hold, that one can walk everywhere, and that a seed is a home."""

import numpy as np
import pytest

from sim.scenes.invent import invent_plan
from sim.scenes.plan import HomePlan, plan_bytes
from sim.scenes.sources import scene_from_plan
from sim.types import AGENT_RADIUS

SEEDS = (0, 1, 2)


@pytest.fixture(scope="module", params=SEEDS)
def plan(request: pytest.FixtureRequest) -> HomePlan:
    return invent_plan("Demo", seed=request.param)


def test_a_home_has_two_storeys_rooms_and_furniture(plan: HomePlan) -> None:
    assert [storey.label for storey in plan.storeys] == ["ground floor", "first floor"]
    assert 5 <= len(plan.rooms) <= 9
    assert 25 <= len(plan.furniture) <= 40
    assert len({room.name for room in plan.rooms}) == len(plan.rooms)
    assert len({piece.name for piece in plan.furniture}) == len(plan.furniture)
    assert {room.storey for room in plan.rooms} == {0, 1}


def test_some_category_has_pieces_that_only_their_look_tells_apart(plan: HomePlan) -> None:
    captions: dict[str, list[str]] = {}
    for piece in plan.furniture:
        captions.setdefault(piece.category, []).append(piece.caption)
    assert sum(len(found) > 1 for found in captions.values()) >= 4
    for category, found in captions.items():
        assert len(set(found)) == len(found), category


def test_the_same_seed_gives_the_same_bytes_and_another_one_another_home() -> None:
    assert plan_bytes(invent_plan("Demo", seed=5)) == plan_bytes(invent_plan("Demo", seed=5))
    assert plan_bytes(invent_plan("Demo", seed=5)) != plan_bytes(invent_plan("Demo", seed=6))


def test_doors_and_steps_fit_the_robot(plan: HomePlan) -> None:
    doors = [opening for wall in plan.walls for opening in wall.openings if opening.kind == "door"]
    assert len(doors) >= len(plan.rooms) - 2
    assert min(door.width for door in doors) >= 0.9
    for stair in plan.stairs:
        rise = (plan.storeys[1].floor_y - plan.storeys[0].floor_y) / stair.num_steps
        assert rise <= 0.18


def test_pieces_do_not_cut_into_each_other(plan: HomePlan) -> None:
    for i, first in enumerate(plan.furniture):
        for second in plan.furniture[i + 1 :]:
            gap_y = abs(first.centre[1] - second.centre[1]) - (first.size[1] + second.size[1]) / 2
            is_chair_at_table = {"chair", "desk chair"} & {first.category, second.category}
            if gap_y < -1e-3 and not is_chair_at_table and "rug" not in (first.category, second.category):
                assert not first.rect.grown(-1e-3).overlaps(second.rect), (first.name, second.name)


def test_every_room_and_every_piece_can_be_walked_up_to(plan: HomePlan) -> None:
    navigation = scene_from_plan(plan).navigation
    assert navigation.storey_heights == pytest.approx((0.0, 2.8), abs=0.05)
    hall = plan.rooms[0]
    assert hall.rect is not None
    start = navigation.snap(np.array([hall.rect.x0 + 1.2, 0.0, hall.rect.z1 - 0.6]))
    assert start is not None
    for piece in plan.furniture:
        storey = next(room.storey for room in plan.rooms if room.name == piece.room)
        floor_y = plan.storeys[storey].floor_y
        reach = max(piece.world_size[0], piece.world_size[2]) / 2 + 3 * AGENT_RADIUS
        places = navigation.points_within(
            np.array([[piece.centre[0], floor_y, piece.centre[2]]]), max(1.0, reach), max_dy=0.1
        )
        walked = navigation.distances(places, start[None])
        assert np.isfinite(walked).any(), piece.name
    for room in plan.rooms:
        assert room.rect is not None
        floor_y = plan.storeys[room.storey].floor_y
        inside = navigation.points_within(
            np.array([[room.rect.centre[0], floor_y, room.rect.centre[1]]]), 1.5, max_dy=0.1
        )
        assert np.isfinite(navigation.distances(inside, start[None])).mean() > 0.9, room.name


def test_a_home_is_light(plan: HomePlan) -> None:
    scene = scene_from_plan(plan)
    assert len(scene.mesh.faces) < 20_000
    assert len(plan_bytes(plan)) < 50_000
    assert scene.kind == "invented"
    assert {item.instance_id for item in scene.objects} == set(np.unique(scene.mesh.face_instance)) - {0}
