"""Invented homes: their content, walkable rooms everywhere, and the same home for the same seed."""

from collections import Counter, defaultdict

import numpy as np
import pytest

from sim.errors import SceneError
from sim.homes.invented import plans
from sim.homes.invented.looks import described, looks_of
from sim.homes.invented.plans import invent_plan, invented_plans
from sim.homes.invented.recipes import GROUPS, INSTEAD, NEEDED, RECIPES, SMALL
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan, plan_bytes
from sim.types import AGENT_RADIUS

SEEDS = (0, 1, 2, 3, 10)
ON_FLAT_TOPS = {"rug", "cushion", "throw blanket"}
"""Pieces that lie under or sink into others."""


@pytest.fixture(
    scope="module", params=[1, 3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS if seed not in (1, 3))]
)
def plan(request: pytest.FixtureRequest) -> HomePlan:
    return invent_plan("Demo", seed=request.param)


def test_a_home_has_storeys_rooms_and_furniture(plan: HomePlan) -> None:
    assert [storey.label for storey in plan.storeys] == ["ground floor", "first floor"][: len(plan.storeys)]
    assert len(plan.stairs) == len(plan.storeys) - 1
    assert 5 <= len(plan.rooms) <= 9
    assert 35 <= len(plan.furniture) <= 80
    assert len({room.name for room in plan.rooms}) == len(plan.rooms)
    assert {room.storey for room in plan.rooms} == set(range(len(plan.storeys)))
    assert {"living room", "kitchen", "main bedroom", "bathroom"} <= {room.name for room in plan.rooms}


def test_a_seed_gives_one_home_every_fourth_home_has_one_storey_and_all_patterns_occur() -> None:
    assert [plans.num_storeys(seed) for seed in range(8)] == [2, 2, 2, 1, 2, 2, 2, 1]
    assert len(invent_plan("Demo", seed=3).storeys) == 1
    assert plan_bytes(invent_plan("Demo", seed=5)) == plan_bytes(invent_plan("Demo", seed=5))
    assert plan_bytes(invent_plan("Demo", seed=5)) != plan_bytes(invent_plan("Demo", seed=6))
    patterns = {piece.finish.pattern for seed in SEEDS for piece in invent_plan("Demo", seed=seed).furniture}
    assert patterns >= {"plain", "striped", "floral", "plaid", "patterned", "dotted"}


def test_rooms_hold_the_pieces_that_their_kind_needs_and_have_floors_by_kind(plan: HomePlan) -> None:
    assert [piece.name for piece in plan.furniture] == [f"{p.category}_{k}" for k, p in enumerate(plan.furniture, 1)]
    for room in plan.rooms:
        there = {piece.category for piece in plan.furniture if piece.room == room.name}
        assert there.issuperset(NEEDED.get(room.name, ())), room.name
    floors = {room.name: room.floor.material for room in plan.rooms}
    assert floors["bathroom"] == floors["kitchen"] == "tile"
    assert floors["living room"] == "wood"
    assert len({room.wall.rgb for room in plan.rooms}) >= 4


def test_several_pieces_share_a_category_but_never_look_alike(plan: HomePlan) -> None:
    looks: dict[str, list[tuple]] = defaultdict(list)
    for piece in plan.furniture:
        looks[piece.category].append((piece.finish.rgb, piece.finish.pattern, piece.finish.material, piece.finish.rgb2))
        assert piece.category in piece.caption
    assert sum(len(found) > 1 for found in looks.values()) >= 6
    for category, found in looks.items():
        assert len(set(found)) == len(found), category
    kinds = Counter(piece.category for piece in plan.furniture)
    assert kinds["picture"] >= 2
    assert sum(kinds[name] for name in ("rug", "curtain", "towel", "cushion", "throw blanket")) >= 3
    assert sum(kinds[name] for name in ("vase", "book", "bowl", "table lamp", "photo", "statue")) >= 3


def test_a_seed_gives_more_homes_and_then_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    homes = invented_plans("Demo", seed=3)
    assert plan_bytes(next(homes)) == plan_bytes(invent_plan("Demo", seed=3))
    monkeypatch.setattr(plans, "MIN_PIECES", 70)
    monkeypatch.setattr(plans, "_ATTEMPTS", 3)
    with pytest.raises(SceneError, match=r"'Demo': seed 3 gave 0 homes in 3 tries.*70 to 80 pieces.*another --seed"):
        invent_plan("Demo", seed=3)


def test_doors_and_steps_fit_the_robot_and_pieces_fit_their_rooms_without_overlap(plan: HomePlan) -> None:
    doors = [opening for wall in plan.walls for opening in wall.openings if opening.kind == "door"]
    assert len(doors) >= len(plan.rooms) - 5
    assert min(door.width for door in doors) >= 0.9
    for stair in plan.stairs:
        rise = (plan.storeys[1].floor_y - plan.storeys[0].floor_y) / stair.num_steps
        assert rise <= 0.18
    chairs = {"chair", "desk chair", "stool"}
    for i, first in enumerate(plan.furniture):
        for second in plan.furniture[i + 1 :]:
            pair = {first.category, second.category}
            gap_y = abs(first.centre[1] - second.centre[1]) - (first.size[1] + second.size[1]) / 2
            if gap_y < -1e-3 and not pair & (chairs | ON_FLAT_TOPS) and not {"bag", "plush toy"} & pair:
                assert not first.rect.grown(-1e-3).overlaps(second.rect), (first.name, second.name)
    rects = {room.name: room.rect for room in plan.rooms}
    for piece in plan.furniture:
        rect = rects[piece.room]
        assert rect is not None
        assert rect.grown(-0.05).holds_rect(piece.rect), piece.name


@pytest.mark.slow
def test_every_room_and_every_piece_can_be_reached(plan: HomePlan) -> None:
    navigation = scene_from_plan(plan).navigation
    assert navigation.storey_heights == pytest.approx((0.0, 2.8)[: len(plan.storeys)], abs=0.05)
    first = plan.rooms[0].rect
    assert first is not None
    start = navigation.points_within(np.array([[first.centre[0], 0.0, first.centre[1]]]), 2.0, max_dy=0.1)[:1]
    for piece in plan.furniture:
        storey = next(room.storey for room in plan.rooms if room.name == piece.room)
        floor_y = plan.storeys[storey].floor_y
        reach = max(piece.world_size[0], piece.world_size[2]) / 2 + 3 * AGENT_RADIUS
        places = navigation.points_within(
            np.array([[piece.centre[0], floor_y, piece.centre[2]]]), max(1.5, reach), max_dy=0.1
        )
        assert np.isfinite(navigation.distances(places, start)).any(), piece.name
    for room in plan.rooms:
        assert room.rect is not None
        floor_y = plan.storeys[room.storey].floor_y
        inside = navigation.points_within(
            np.array([[room.rect.centre[0], floor_y, room.rect.centre[1]]]), 1.5, max_dy=0.1
        )
        assert np.isfinite(navigation.distances(inside, start)).mean() > 0.8, room.name


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 7, 8, 11))])
def test_the_home_can_be_walked_from_every_random_point(seed: int) -> None:
    navigation = scene_from_plan(invent_plan("Demo", seed=seed)).navigation
    rng = np.random.default_rng(seed)
    for height in (None, *navigation.storey_heights):
        points = np.array([navigation.random_point(rng, storey_y=height) for _ in range(300)])
        for goal in navigation.storey_heights:
            ends = navigation.random_point(rng, storey_y=goal)[None]
            assert np.isfinite(navigation.distances(points, ends)).all()


def test_a_home_has_few_triangles_and_a_small_plan(plan: HomePlan) -> None:
    scene = scene_from_plan(plan)
    assert len(scene.mesh.faces) < 300_000
    assert len(plan_bytes(plan)) < 80_000
    assert scene.kind == "invented"
    assert {item.instance_id for item in scene.objects} == set(np.unique(scene.mesh.face_instance)) - {0}


def test_recipes_name_only_groups_and_pieces_that_exist() -> None:
    groups = {group for recipe in RECIPES.values() for group, _ in recipe}
    assert groups | set(INSTEAD) | set(INSTEAD.values()) <= set(GROUPS)
    placed = {member.category for members in GROUPS.values() for member in members}
    for room, things in SMALL.items():
        assert room in RECIPES
        for small in things:
            assert set(small.supports) <= placed, small


def test_looks_have_different_words_that_name_colour_and_pattern() -> None:
    for category in sorted({member.category for members in GROUPS.values() for member in members}):
        looks = looks_of(category)
        assert len({look.words for look in looks}) == len(looks) >= 4, category
        for look in looks:
            assert look.words.startswith(look.colour)
            assert (look.finish.pattern == "plain") == (look.finish.rgb2 is None or "abstract" in look.words)
            assert look.finish.pattern == "plain" or f" {look.finish.pattern}" in look.words, look.words
    assert described("armchair", "green velvet") == "green velvet armchair"
    assert described("lamp", "orange paper") == "lamp with an orange paper shade"
    assert described("plant", "blue ceramic", "small") == "small plant with a blue ceramic pot"
    assert described("bed", "red") == "bed with a red cover"
