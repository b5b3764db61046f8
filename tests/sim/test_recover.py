"""Schematic homes from episode files: small ones with known answers, and released ones if the dataset is present."""

import math
from pathlib import Path

import numpy as np
import pytest

from sim.cache import VARIABLE
from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.frames import T_world_camera, quat_xyzw_from_yaw, yaw_towards
from sim.homes.building.cells.spaces import floor_layers
from sim.homes.cells import cells_from_runs
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.plan import Furniture, HomePlan, load_plan, plan_bytes, save_plan
from sim.homes.recovered.objects import recovered_pieces
from sim.homes.recovered.open_space import BLOCKS, block_cells
from sim.homes.recovered.plans import recover_plan
from sim.render.raycast import Raycaster
from sim.types import AGENT_RADIUS, Camera, Pose
from sim.walk.floor_grid import FloorGrid

from .plans import piece
from .recorded_worlds import GROUND, recorded_goal, recorded_of
from .synthetic import SCENE, example_content, example_episode, example_goal, example_view_point, write_dataset


def dataset_of(root: Path, points: list[tuple[float, float, float]], **goal_changes) -> PersonalDataset:
    """One coffee table at (2, 0.45, -1) seen from (x, y, z) points; the first one is the start too."""
    table = (2.0, -1.0)
    views = [
        example_view_point(x, z, y=y, quat_xyzw=list(quat_xyzw_from_yaw(yaw_towards((x, z), table))), iou=0.5)
        for x, y, z in points
    ]
    content = example_content(
        goals_by_category={f"{SCENE}.basis.glb_coffee table": [example_goal(view_points=views, **goal_changes)]},
        episodes=[example_episode(start_position=list(points[0]))],
    )
    return PersonalDataset(write_dataset(root, {("easy", SCENE): content}))


def walkable_of(plan: HomePlan) -> FloorGrid:
    return scene_from_plan(plan).navigation


LATTICE = [(1.0 + 0.25 * i, 0.0, 0.25 * j) for i in range(9) for j in range(5)]


def test_cells_lie_on_and_between_the_places_of_the_lattice_in_the_room_that_the_sentence_names(tmp_path: Path) -> None:
    plan = recover_plan(dataset_of(tmp_path, LATTICE), SCENE)
    assert plan.cells is not None
    cells = cells_from_runs(plan.cells.walkable)
    xz = plan.cells.grid.xz_from_rc(cells.rc)
    away = np.linalg.norm(xz[:, None] - np.array(LATTICE)[None, :, [0, 2]], axis=2).min(axis=1)
    assert away.max() <= 0.18  # the middle of four places that are 0.25 m apart
    assert not cells.guessed.any()
    assert (cells.y == 0).all()
    # a lattice of 2.0 m by 1.0 m with 5 cm around it
    assert len(cells.y) * 0.05**2 == pytest.approx(2.1 * 1.1, abs=0.1)
    assert [(room.name, room.storey) for room in plan.rooms] == [("lounge", 0)]
    assert plan.furniture[0].room == "lounge"
    assert plan.rooms[0].area


def test_two_storeys_get_one_ramp_of_at_most_40_degrees(tmp_path: Path) -> None:
    upstairs = [(x + 3.0, 2.8, z) for x, _, z in LATTICE]
    plan = recover_plan(dataset_of(tmp_path, LATTICE + upstairs), SCENE)
    assert [storey.floor_y for storey in plan.storeys] == [0.0, 2.8]
    navigation = walkable_of(plan)
    path = navigation.shortest_path(np.array([1.0, 0, 0.0]), np.array([[6.0, 2.8, 0.0]]))
    assert path is not None
    moves = np.diff(path, axis=0)
    assert np.abs(moves[:, 1]).sum() == pytest.approx(2.8, abs=0.1)
    assert (np.abs(moves[:, 1]) <= np.tan(np.radians(40)) * np.hypot(moves[:, 0], moves[:, 2])).all()
    assert navigation.storey_heights == pytest.approx((0.0, 2.8))


def test_the_path_to_the_object_is_open_and_walls_stand_behind_it(tmp_path: Path) -> None:
    plan = recover_plan(dataset_of(tmp_path, LATTICE), SCENE)
    scene = scene_from_plan(plan)
    caster = Raycaster(scene.mesh)
    down = caster.cast(np.array([[2.0, 2.0, -0.4], [2.0, 2.0, 0.5]]), np.array([[0.0, -1, 0], [0, -1, 0]]))
    step, floor = down.positions[:, 1]
    assert floor == pytest.approx(0.0, abs=1e-3)
    assert step == pytest.approx(min(BLOCKS, key=lambda height: abs(step - height)), abs=1e-3)
    behind = caster.cast(np.array([[2.0, 1.5, 0.5]]), np.array([[0.0, 0, -1]]))
    assert 1.5 < behind.range_m[0] < 2.3
    camera = Camera(160, 120)
    frame = caster.render(T_world_camera(Pose((2.0, 0.0, 0.0), 0.0), camera), camera)
    assert (frame.instance_ids == 1).sum() > 50


def test_below_a_line_of_sight_stands_the_highest_block_that_leaves_it_free_and_below_an_object_is_floor(
    tmp_path: Path,
) -> None:
    plan = recover_plan(dataset_of(tmp_path, LATTICE), SCENE)
    assert plan.cells is not None
    place, shoe = (2.0, 0.0, 0.0), piece("shoe_1", (2.0, 0.1, -2.0), (0.3, 0.2, 0.2))
    recorded = recorded_of(recorded_goal("shoe_1", shoe.centre, [place]))

    def heights_at(*zs: float) -> list[float]:
        assert plan.cells is not None
        steps = block_cells(recorded, [shoe], {"shoe_1": "floor"}, GROUND, grid=plan.cells)
        height = dict(zip(map(tuple, steps.rc.tolist()), steps.y.tolist(), strict=True))
        return [height[row, col] for row, col in plan.cells.grid.rc_from_xz(np.array([(2.0, z) for z in zs])).tolist()]

    # from the camera, 0.88 m, to the shoe, 0.17 m, over 2 m: the line is at 0.73, 0.59 and 0.37 m
    assert heights_at(-0.43, -0.83, -1.43) == [0.65, 0.45, 0.0]
    assert heights_at(-2.0) == [0.0]
    steps = block_cells(recorded, [shoe], {"shoe_1": "floor"}, GROUND, grid=plan.cells)
    assert set(steps.y.tolist()) == set(BLOCKS) == {0.0, 0.45, 0.65}
    body = {tuple(rc) for rc in np.argwhere(~np.isnan(floor_layers(plan.cells, GROUND)[0])).tolist()}
    assert not body & {tuple(rc) for rc in steps.rc.tolist()}


def test_a_picture_keeps_a_wall_right_behind_it(tmp_path: Path) -> None:
    cells = recover_plan(dataset_of(tmp_path, LATTICE), SCENE).cells
    assert cells is not None
    recorded = recorded_of(recorded_goal("picture_1", (2.0, 1.6, -0.6), LATTICE))
    steps = block_cells(recorded, *recovered_pieces(recorded, GROUND), GROUND, grid=cells)
    xz = cells.grid.xz_from_rc(steps.rc)
    assert xz[np.abs(xz[:, 0] - 2.0) < 0.25, 1].min() > -0.6 - 0.08
    table = recorded_of(recorded_goal("table_1", (2.0, 0.37, -0.6), LATTICE))
    steps = block_cells(table, *recovered_pieces(table, GROUND), GROUND, grid=cells)
    xz = cells.grid.xz_from_rc(steps.rc)
    assert xz[np.abs(xz[:, 0] - 2.0) < 0.25, 1].min() < -0.6 - 0.2


def test_an_object_leaves_standing_points_free_and_has_the_finish_of_its_caption(tmp_path: Path) -> None:
    points = [*LATTICE, (2.0, 0.0, -0.75)]
    content = dataset_of(tmp_path, points)
    table = recover_plan(content, SCENE).furniture[0]
    assert table.centre == pytest.approx((2.0, 0.45, -1.18))  # the place is 0.25 m in front of the recorded centre
    assert table.rect.z1 <= -0.75 - AGENT_RADIUS + 1e-9
    assert table.finish.material == "wood"  # "low oak coffee table with a green bowl on it"
    assert table.finish.rgb[0] > table.finish.rgb[1] > table.finish.rgb[2]
    assert table.caption == "low oak coffee table with a green bowl on it"


def test_a_plan_stays_in_the_cache_until_the_files_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    first = recover_plan(dataset_of(tmp_path, LATTICE), SCENE)
    assert recover_plan(dataset_of(tmp_path, LATTICE), SCENE) == first
    assert len(list(tmp_path.rglob("*.plan"))) == 1
    recover_plan(dataset_of(tmp_path, LATTICE[:-1]), SCENE)
    recover_plan(dataset_of(tmp_path, LATTICE), SCENE, splits=("easy",))
    assert len(list(tmp_path.rglob("*.plan"))) == 3


def test_splits_and_files_without_any_standing_place_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="in hard"):
        recover_plan(dataset_of(tmp_path, LATTICE), SCENE, splits=("hard",))
    content = example_content(episodes=[])
    goals = content["goals_by_category"][f"{SCENE}.basis.glb_coffee table"]
    for point in goals[0]["view_points"]:
        point.pop("iou", None)
    root = write_dataset(tmp_path, {("easy", SCENE): content})
    with pytest.raises(SceneError, match="no original view point and no episode"):
        recover_plan(PersonalDataset(root), SCENE)


def test_a_plan_corrected_by_hand_is_opened_instead_of_a_recovered_one(tmp_path: Path) -> None:
    dataset = dataset_of(tmp_path, LATTICE)
    plan = recover_plan(dataset, SCENE)
    table = plan.furniture[0].model_copy(update={"size": (0.5, 0.9, 0.3)})
    corrected = plan.model_copy(update={"furniture": (table, *plan.furniture[1:])})
    path = tmp_path / "scenes" / f"{SCENE}.plan.json"
    save_plan(corrected, path)
    assert load_plan(path) == corrected
    opened = open_scene(dataset, SCENE)
    assert opened.objects[0].size == pytest.approx((0.5, 0.9, 0.3))
    assert opened.kind == "schematic"


def test_one_square_metre_of_places_is_enough_and_one_place_is_refused(tmp_path: Path) -> None:
    few = [place for place in LATTICE if place[0] <= 2.25]
    navigation = walkable_of(recover_plan(dataset_of(tmp_path / "few", few), SCENE))
    assert all(navigation.is_navigable(np.array(place)) for place in few)
    plan = recover_plan(dataset_of(tmp_path / "one", [(2.0, 0.1, 0.0)]), SCENE)
    with pytest.raises(SceneError, match=f"home '{SCENE}': its records make 0.00 m2 of floor; expected at least 1 m2"):
        scene_from_plan(plan)


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param("mL8ThkuaVTM", marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.release) for name in ("XB4GS9ShBRE", "QaLdnwvtxbs")),
    ],
)
def test_a_released_home_is_walkable_and_shows_its_objects(dataset_root: Path, scene: str) -> None:
    dataset = PersonalDataset(dataset_root)
    plan = recover_plan(dataset, scene)
    assert plan_bytes(plan) == plan_bytes(recover_plan(dataset, scene))
    home = scene_from_plan(plan)
    assert len(home.mesh.faces) <= 150_000
    caster = Raycaster(home.mesh)
    ids = {item.name: item.instance_id for item in home.objects}
    camera = Camera(160, 120)
    ratios, seen = [], []
    places: set[tuple[float, ...]] = set()
    for episode in dataset.episodes(scenes=(scene,)):
        start = np.array(episode.record.start_position)
        points = [np.array(p.agent_state.position) for goal in episode.targets for p in goal.original_view_points]
        places.update(tuple(point.tolist()) for point in (start, *points))
        first = episode.targets[0].view_points[0].agent_state.position
        walked = home.navigation.distances(start[None], np.array([first]))[0]
        assert np.isfinite(walked), episode.key
        ratios.append(walked / episode.record.info.geodesic_distance)
        centre = episode.targets[0].position
        pose = Pose(first, yaw_towards((first[0], first[2]), (centre[0], centre[2])))
        frame = caster.render(T_world_camera(pose, camera), camera)
        seen.append((frame.instance_ids == ids[episode.targets[0].object_name]).sum() >= 10)
    on_floor = [place for place in places if not any(_is_on(place, piece) for piece in plan.furniture)]
    assert len(on_floor) >= 0.9 * len(places), "the others are on top of beds, which are no floor"
    snapped = [home.navigation.snap(np.array(place)) for place in on_floor]
    away = [
        np.inf if at is None else math.hypot(at[0] - x, at[2] - z)
        for at, (x, _, z) in zip(snapped, on_floor, strict=True)
    ]
    assert max(away) <= 0.1
    assert np.mean([home.navigation.is_navigable(np.array(place)) for place in on_floor]) >= 0.99
    off = np.abs(np.array(ratios) - 1)
    assert abs(np.median(ratios) - 1) < 0.02
    assert np.mean(off <= 0.05) >= 0.75
    assert np.mean(off <= 0.1) >= 0.9
    assert np.mean(seen) >= 0.85


def _is_on(place: tuple[float, ...], piece: Furniture) -> bool:
    """Whether a place is on top of a piece; one that was only reached from its top is narrower than it was."""
    x, y, z = place
    return piece.rect.grown(0.1).holds(x, z) and piece.bottom_y + 0.2 < y < piece.top_y + 0.2
