"""Schematic homes from episode files: small ones with known answers, and released ones if the dataset is present."""

from pathlib import Path

import numpy as np
import pytest

from sim.cache import VARIABLE
from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.frames import T_world_camera, quat_xyzw_from_yaw, yaw_towards
from sim.homes.cells import cells_from_runs
from sim.homes.open_home import open_scene, scene_from_plan
from sim.homes.plan import HomePlan, load_plan, plan_bytes, save_plan
from sim.homes.recovered.objects import recovered_pieces
from sim.homes.recovered.open_space import LOW_STEP, STEP, step_cells
from sim.homes.recovered.plans import recover_plan
from sim.render.raycast import Raycaster
from sim.types import AGENT_RADIUS, Camera, Pose
from sim.walk.floor_grid import FloorGrid

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


def test_cells_lie_within_the_robots_radius_of_the_lattice_in_the_room_that_the_sentence_names(tmp_path: Path) -> None:
    plan = recover_plan(dataset_of(tmp_path, LATTICE), SCENE)
    assert plan.cells is not None
    cells = cells_from_runs(plan.cells.walkable)
    xz = plan.cells.grid.xz_from_rc(cells.rc)
    away = np.linalg.norm(xz[:, None] - np.array(LATTICE)[None, :, [0, 2]], axis=2).min(axis=1)
    assert away.max() <= 0.22  # the radius around points, and around the midpoint of two that are 0.25 m apart
    assert not cells.guessed.any()
    assert (cells.y == 0).all()
    # a lattice of 2.0 m by 1.0 m, grown by the radius: 2.36 m * 1.36 m less the corners
    assert len(cells.y) * 0.05**2 == pytest.approx(3.0, abs=0.2)
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
    assert 0.0 <= step <= STEP + 1e-3
    behind = caster.cast(np.array([[2.0, 1.5, 0.5]]), np.array([[0.0, 0, -1]]))
    assert 1.5 < behind.range_m[0] < 2.3
    camera = Camera(160, 120)
    frame = caster.render(T_world_camera(Pose((2.0, 0.0, 0.0), 0.0), camera), camera)
    assert (frame.instance_ids == 1).sum() > 50


def test_steps_are_low_near_the_object_and_higher_elsewhere(tmp_path: Path) -> None:
    far = [(2.0, 0.0, 4.0 + 0.25 * j) for j in range(3)]
    plan = recover_plan(dataset_of(tmp_path, LATTICE + far), SCENE)
    assert plan.cells is not None
    steps = cells_from_runs(plan.cells.plinth)
    heights = dict(zip(map(tuple, steps.rc.tolist()), steps.y.tolist(), strict=True))
    spec = plan.cells.grid
    below = spec.rc_from_xz(np.array([[2.0, -1.0], [1.9, -1.1]]))
    assert [heights[row, col] for row, col in below.tolist()] == [LOW_STEP, LOW_STEP]
    assert set(heights.values()) <= {LOW_STEP, STEP}
    walked = {tuple(rc) for rc in cells_from_runs(plan.cells.walkable).rc.tolist()}
    assert not walked & set(heights)


def test_a_picture_keeps_a_wall_right_behind_it(tmp_path: Path) -> None:
    cells = recover_plan(dataset_of(tmp_path, LATTICE), SCENE).cells
    assert cells is not None
    recorded = recorded_of(recorded_goal("picture_1", (2.0, 1.6, -0.6), LATTICE))
    steps = step_cells(recorded, *recovered_pieces(recorded, GROUND), GROUND, grid=cells)
    xz = cells.grid.xz_from_rc(steps.rc)
    assert xz[np.abs(xz[:, 0] - 2.0) < 0.25, 1].min() > -0.6 - 0.08
    table = recorded_of(recorded_goal("table_1", (2.0, 0.37, -0.6), LATTICE))
    steps = step_cells(table, *recovered_pieces(table, GROUND), GROUND, grid=cells)
    xz = cells.grid.xz_from_rc(steps.rc)
    assert xz[np.abs(xz[:, 0] - 2.0) < 0.25, 1].min() < -0.6 - 0.2


def test_an_object_leaves_standing_points_free_and_has_the_finish_of_its_caption(tmp_path: Path) -> None:
    points = [*LATTICE, (2.0, 0.0, -0.75)]
    content = dataset_of(tmp_path, points)
    piece = recover_plan(content, SCENE).furniture[0]
    assert piece.centre == (2.0, 0.45, -1.0)
    assert piece.rect.z1 <= -0.75 - AGENT_RADIUS + 1e-9
    assert piece.finish.material == "wood"  # "low oak coffee table with a green bowl on it"
    assert piece.finish.rgb[0] > piece.finish.rgb[1] > piece.finish.rgb[2]
    assert piece.caption == "low oak coffee table with a green bowl on it"


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


def test_one_standing_point_is_enough(tmp_path: Path) -> None:
    plan = recover_plan(dataset_of(tmp_path, [(2.0, 0.1, 0.0)]), SCENE)
    assert walkable_of(plan).is_navigable(np.array([2.0, 0.1, 0.0]))


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
    for episode in dataset.episodes(scenes=(scene,)):
        start = np.array(episode.record.start_position)
        points = [np.array(p.agent_state.position) for goal in episode.targets for p in goal.original_view_points]
        assert all(home.navigation.is_navigable(point) for point in (start, *points)), episode.key
        first = episode.targets[0].view_points[0].agent_state.position
        walked = home.navigation.distances(start[None], np.array([first]))[0]
        assert np.isfinite(walked), episode.key
        ratios.append(walked / episode.record.info.geodesic_distance)
        centre = episode.targets[0].position
        pose = Pose(first, yaw_towards((first[0], first[2]), (centre[0], centre[2])))
        frame = caster.render(T_world_camera(pose, camera), camera)
        seen.append((frame.instance_ids == ids[episode.targets[0].object_name]).sum() >= 10)
    off = np.abs(np.array(ratios) - 1)
    assert abs(np.median(ratios) - 1) < 0.02
    assert np.mean(off <= 0.1) >= 0.5
    assert np.mean(seen) >= 0.85
