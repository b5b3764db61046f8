"""Clutter: which pieces are added, that they hide and block nothing, and that they look unlike captioned objects."""

from collections import Counter

import numpy as np
import pytest

from personal_viz.bench.homes.sightlines import sights_of, visible_shares
from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.homes.cells import CellGrid, CellRun
from sim.homes.clutter.household import HOUSEHOLDS, household_of
from sim.homes.clutter.plans import with_clutter
from sim.homes.clutter.space import SpareStorey, empty_storeys
from sim.homes.furniture.families import look_of
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import Finish, Furniture, HomePlan, Room, plan_bytes
from sim.homes.recovered.plans import recover_plan
from sim.render.raycast import Raycaster
from sim.walk.floor_grid import FloorGrid
from sim.walk.object_surface import object_surface
from sim.walk.viewpoints import view_points_around

from . import plans
from .plans import GROUND

OAK = Finish(material="wood", rgb=(184, 142, 90))
PALE = Finish(material="plaster", rgb=(220, 220, 210))


@pytest.fixture(scope="module")
def invented() -> HomePlan:
    return invent_plan("Demo", seed=4)


@pytest.fixture(scope="module")
def schematic() -> HomePlan:
    """A room of 5 x 5 m, walked only in the middle, with low blocks around it.

    A table at its north wall and a chair in the east stand on floor.
    """
    walkable = tuple(CellRun(row, 70, 60, 0) for row in range(70, 130))
    low = np.full((200, 200), 45)
    low[50:65, 86:114] = low[95:105, 137:147] = 0
    plinth = tuple(CellRun(row, col, 1, int(low[row, col])) for row in range(50, 150) for col in range(50, 150))
    grid = CellGrid(origin_xz=(-5.0, -5.0), shape=(200, 200), walkable=walkable, plinth=plinth)
    red = Finish(material="wood", rgb=(178, 44, 40))
    table = plans.piece("table_3", (0.0, 0.37, -2.1), (1.4, 0.74, 0.7), finish=OAK, room="kitchen")
    chair = plans.piece("chair_8", (2.1, 0.46, 0.0), (0.46, 0.92, 0.5), yaw=-np.pi / 2, finish=red, room="kitchen")
    rooms = (Room(name="kitchen", storey=0, floor=OAK, wall=PALE),)
    return HomePlan(name="Cells", kind="schematic", storeys=GROUND, rooms=rooms, furniture=(table, chair), cells=grid)


def added(plan: HomePlan, full: HomePlan) -> tuple[Furniture, ...]:
    return full.furniture[len(plan.furniture) :]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["schematic", "invented"])
def test_levels_grow_and_the_same_seed_gives_the_same_bytes(request, name: str) -> None:
    plan: HomePlan = request.getfixturevalue(name)
    assert with_clutter(plan, 0, seed=1) is plan
    some, many = with_clutter(plan, 1, seed=1), with_clutter(plan, 2, seed=1)
    assert (some.clutter, many.clutter) == (1, 2)
    assert 10 <= len(added(plan, some)) < len(added(plan, many))
    assert many.furniture[: len(plan.furniture)] == plan.furniture
    assert plan_bytes(some) == plan_bytes(with_clutter(plan, 1, seed=1))
    assert plan_bytes(some) != plan_bytes(with_clutter(plan, 1, seed=2))
    assert with_clutter(many, 2, seed=5) is many
    with pytest.raises(SceneError, match=r"plan '.*': found clutter level 2 where 1 was asked for; expected a plan"):
        with_clutter(many, 1, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["schematic", "invented"])
def test_numbers_in_names_continue_those_of_the_plan_and_decoys_look_different(request, name: str) -> None:
    plan: HomePlan = request.getfixturevalue(name)
    new = added(plan, with_clutter(plan, 2, seed=0))
    numbers = [int(piece.name.rsplit("_", 1)[1]) for piece in new]
    last = max(int(piece.name.rsplit("_", 1)[1]) for piece in plan.furniture)
    assert numbers == list(range(last + 1, last + 1 + len(new)))
    assert all(piece.caption == "" and piece.name.startswith(f"{piece.category}_") for piece in new)
    captioned = [piece for piece in plan.furniture if piece.role == "captioned"]
    categories = {piece.category for piece in captioned}
    assert {piece.role for piece in new} == {"clutter", "decoy"}
    assert all((piece.role == "decoy") == (piece.category in categories) for piece in new)
    for piece in new:
        family = look_of(piece.category).family
        for other in (other for other in captioned if look_of(other.category).family == family):
            assert np.abs(np.subtract(piece.finish.rgb, other.finish.rgb)).max() >= 60


@pytest.mark.slow
@pytest.mark.parametrize("name", ["schematic", "invented"])
def test_no_piece_overlaps_another_and_every_piece_stands_or_hangs_on_something(request, name: str) -> None:
    plan: HomePlan = request.getfixturevalue(name)
    full = with_clutter(plan, 2, seed=0)
    boxes = np.array([piece.box for piece in full.furniture])
    storeys = [SpareStorey(storey, [], []) for storey in empty_storeys(plan)]
    rooms = {room.name: room.storey for room in plan.rooms}
    for k, piece in enumerate(added(plan, full), start=len(plan.furniture)):
        box = boxes[k]
        overlaps = ((boxes[:, :3] < box[3:] - 0.005) & (boxes[:, 3:] > box[:3] + 0.005)).all(axis=1)
        overlaps[k] = False
        met = {look_of(full.furniture[j].category).family for j in np.flatnonzero(overlaps)}
        assert met <= {"sofa", "armchair", "bed"}, "a piece on a seat or a bed reaches into its box"
        bottom = box[1]
        below = full.furniture[: len(plan.furniture)] + added(plan, full)
        carried = any(
            other.rect.holds(piece.centre[0], piece.centre[2])
            and other.bottom_y < bottom - 0.05
            and bottom <= other.top_y + 0.01
            for other in below
            if other is not piece
        )
        floor_y = storeys[rooms[piece.room]].floor_at(piece.rect.grown(-0.4 * min(piece.size[0], piece.size[2])))
        stands = floor_y is not None and abs(bottom - floor_y) < 0.05
        hangs = floor_y is None or bottom >= plan.storeys[rooms[piece.room]].floor_y + 1.2 - 1e-3
        assert carried or stands or hangs, piece


def test_the_walked_floor_of_a_schematic_home_does_not_change_and_nothing_stands_on_it(schematic: HomePlan) -> None:
    full = with_clutter(schematic, 2, seed=3)
    assert full.cells == schematic.cells
    maps = [scene_from_plan(plan).navigation for plan in (schematic, full)]
    before, after = (grid for grid in maps if isinstance(grid, FloorGrid))
    assert before.grid == after.grid
    walked = [  # without the tops of blocks, which are islands that nobody reaches
        np.stack([grid.cells.row, grid.cells.col], axis=1)[grid.node_y < 0.2].tolist() for grid in (before, after)
    ]
    assert walked[0] == walked[1]
    assert len(walked[0]) >= 60 * 60
    low = [piece for piece in added(schematic, full) if piece.bottom_y < 0.5]
    assert len(low) >= 5
    for piece in low:  # 3 x 3 m are walkable; the robot's sides reach 4 cells farther
        x0, z0, x1, z1 = piece.rect
        aside = np.maximum.reduce([(x0 - 1.5, z0 - 1.5), (-1.5 - x1, -1.5 - z1), (0.0, 0.0)])
        assert np.hypot(*aside) > 0.18, piece
        assert piece.bottom_y == pytest.approx(0.45, abs=1e-3), "on top of a block, not inside it"


@pytest.mark.slow
def test_all_paths_of_an_invented_home_keep_their_lengths(invented: HomePlan) -> None:
    before, after = (scene_from_plan(plan).navigation for plan in (invented, with_clutter(invented, 2, seed=0)))
    rng = np.random.default_rng(0)
    starts = np.array([before.random_point(rng) for _ in range(40)])
    goals = np.array([before.random_point(rng) for _ in range(40)])
    assert all(after.is_navigable(point) for point in (*starts, *goals)), "starts of episodes stay walkable"
    pairs = [(start[None], goal[None]) for start, goal in zip(starts, goals, strict=True)]
    old = np.array([before.distances(*pair)[0] for pair in pairs])
    new = np.array([after.distances(*pair)[0] for pair in pairs])
    is_joined = np.isfinite(old)  # the mesh has places that cannot be reached, such as the tops of beds
    assert is_joined.sum() >= 20
    np.testing.assert_allclose(new[is_joined], old[is_joined], rtol=0.1, atol=0.1)


@pytest.mark.slow
def test_captioned_objects_stay_visible_in_an_invented_home(invented: HomePlan) -> None:
    before, after = (scene_from_plan(plan) for plan in (invented, with_clutter(invented, 2, seed=0)))
    casters = [Raycaster(scene.mesh) for scene in (before, after)]
    kept = []
    for item in before.objects[::5]:
        seen = view_points_around(item, before.mesh, navigation=before.navigation, renderer=casters[0])
        assert seen, item.name
        places = np.array([place.position for place in seen])
        targets = object_surface(before.mesh, item.instance_id, centre=item.centre, size=item.size, count=48)
        shares = visible_shares(places, targets, item.instance_id, mesh=after.mesh, caster=casters[1])
        assert all(after.navigation.is_navigable(place) for place in places)
        kept += [share / place.visible_share for share, place in zip(shares.tolist(), seen, strict=True)]
    assert np.mean(np.array(kept) > 0) > 0.99
    assert np.mean(kept) > 0.85


@pytest.mark.slow
def test_captioned_objects_stay_visible_in_released_homes(dataset_root) -> None:
    dataset = PersonalDataset(dataset_root)
    name = dataset.scenes[0]
    plan, goals = recover_plan(dataset, name), dataset.goals(name)
    before = sights_of(scene_from_plan(plan), goals)
    full = with_clutter(plan, 2, seed=0)
    assert len(added(plan, full)) > 3 * len(plan.furniture)
    assert full.cells == plan.cells
    after = sights_of(scene_from_plan(full), goals)
    lost = Counter({key: int((sights.ok & ~after[key].ok).sum()) for key, sights in before.items()})
    total = sum(int(sights.ok.sum()) for sights in before.values())
    assert total > 500
    assert sum(lost.values()) <= 0.002 * total, lost.most_common(3)
    shares = [
        (after[key].visible_share[s.ok].mean(), s.visible_share[s.ok].mean()) for key, s in before.items() if s.ok.any()
    ]
    assert np.mean([new / old for new, old in shares]) > 0.85


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("master bedroom bathroom", "bathroom"),
        ("kitchen 2", "kitchen"),
        ("children bedroom", "bedroom"),
        ("tv room", "living room"),
        ("hallway corridor", "hallway"),
        ("stairs", "hallway"),
        ("studio", "office"),
        ("laundry room", "laundry room"),
        ("ground floor", "room"),
    ],
)
def test_rooms_get_the_clutter_of_their_kind(name: str, kind: str) -> None:
    assert household_of(name) == HOUSEHOLDS[kind]
