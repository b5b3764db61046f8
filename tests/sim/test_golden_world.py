"""Our grid, steps and pictures against the answers of the real habitat-sim on two houses.

The bounds are what is reached today, with a little room: a grid of 5 cm is no exact copy of a navmesh.
"""

import gzip
import json
import math
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim.frames import T_world_camera
from sim.scenes.glb import load_glb
from sim.types import Camera, Pose
from sim.world.floor_grid import FloorGrid, floor_grid_from_mesh
from sim.world.raycast import Raycaster

HOUSES = ("dev_a", "dev_b")


def read(path: Path):
    return json.loads(gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes())


@pytest.fixture(scope="module")
def grids(golden_root) -> dict[str, FloorGrid]:
    return {name: floor_grid_from_mesh(load_glb(golden_root / f"{name}.glb", up="y")) for name in HOUSES}


@pytest.mark.parametrize("house", HOUSES)
def test_area_and_islands_are_habitats(house, grids, golden_root):
    info = read(golden_root / f"{house}.info.json")["navmeshes"][f"{house}.navmesh"]
    assert grids[house].area == pytest.approx(info["navigable_area"], rel=0.005)
    islands = np.sort(np.bincount(grids[house].islands)) * 0.05**2
    np.testing.assert_allclose(islands, np.sort(info["island_areas"]), rtol=0.01)


@pytest.mark.parametrize(("house", "rel"), [("dev_a", 0.015), ("dev_b", 0.005)])
def test_the_area_for_a_taller_thinner_robot_is_habitats(house, rel, golden_root):
    mesh = load_glb(golden_root / f"{house}.glb", up="y")
    info = read(golden_root / f"{house}.info.json")["navmeshes"][f"{house}.default.navmesh"]
    assert floor_grid_from_mesh(mesh, radius=0.1, height=1.5).area == pytest.approx(info["navigable_area"], rel=rel)


def test_storeys_are_found_and_roofs_are_not(grids):
    # Floors of info.json and objects.json: 0.0171 and 2.8471 (dev_a), 0.0371 with a platform (dev_b).
    assert grids["dev_a"].storey_heights == pytest.approx((0.0171, 2.8471), abs=0.001)
    assert grids["dev_b"].storey_heights == pytest.approx((0.0371,), abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize("house", HOUSES)
def test_distances_are_within_a_percent_of_habitats_on_average(house, grids, golden_root):
    pairs = [
        pair
        for pair in read(golden_root / f"{house}.geodesic.json.gz")["pairs"]
        if pair["navmesh"] == f"{house}.navmesh"
    ]
    ours = np.array([grids[house].distances(np.array([p["start"]]), np.array([p["goal"]]))[0] for p in pairs])
    theirs = np.array([np.inf if p["distance"] is None else p["distance"] for p in pairs])
    assert np.mean(np.isfinite(ours) == np.isfinite(theirs)) >= 0.99
    kinds = np.array([pair["kind"] for pair in pairs])
    both = np.isfinite(ours) & np.isfinite(theirs)
    error = np.abs(ours[both] - theirs[both]) / np.maximum(theirs[both], 0.5)
    on_mesh = np.isin(kinds[both], ["on_mesh", "any_islands"])
    assert error[on_mesh].mean() <= 0.007
    assert np.percentile(error[on_mesh], 95) <= 0.02
    # Off the mesh Detour counts a point's own height (habitat-golden README); we count from the floor.
    assert error.mean() <= 0.015


@pytest.mark.parametrize("house", HOUSES)
def test_the_nearest_of_several_goals_is_as_far_as_in_habitat(house, grids, golden_root):
    queries = [
        query
        for query in read(golden_root / f"{house}.geodesic.json.gz")["multi_goal"]
        if query["navmesh"] == f"{house}.navmesh"
    ]
    ours = np.array([grids[house].distances(np.array([q["start"]]), np.array(q["goals"]))[0] for q in queries])
    theirs = np.array([np.inf if q["distance"] is None else q["distance"] for q in queries])
    assert (np.isfinite(ours) == np.isfinite(theirs)).all()
    both = np.isfinite(ours)
    assert np.abs(ours[both] - theirs[both]).mean() <= 0.05


@pytest.mark.parametrize(("house", "share", "agreement"), [("dev_a", 0.95, 0.96), ("dev_b", 0.985, 0.99)])
@pytest.mark.parametrize(("rule", "slide"), [("no_slide_le_0_3_3", False), ("slide", True)])
def test_single_steps_end_where_habitats_do(house, share, agreement, rule, slide, grids, golden_root):
    steps = [step for step in read(golden_root / f"{house}.steps.json.gz")["steps"] if not step["sensitive"]]
    away, same_flag = [], []
    for step in steps:
        position, collided = grids[house].step(
            np.array(step["start_used"]), np.array(step["requested_end"]), slide=slide
        )
        theirs = step[rule]["position"]
        away.append(math.hypot(position[0] - theirs[0], position[2] - theirs[2]))
        same_flag.append(collided == step[rule]["collided"])
    assert np.median(away) < 1e-4
    assert np.mean(np.array(away) < 0.05) >= share - (0.03 if slide else 0)
    assert np.mean(same_flag) >= agreement - (0.015 if slide else 0)


@pytest.mark.parametrize("house", HOUSES)
def test_points_snap_to_the_places_that_habitat_finds(house, grids, golden_root):
    queries = read(golden_root / f"{house}.snap.json")["queries"]
    exists, away, navigable = [], [], []
    for query in queries:
        found, theirs = grids[house].snap(np.array(query["point"])), query["snap"]
        exists.append((found is None) == (theirs is None))
        if found is not None and theirs is not None:
            away.append(np.hypot(*(found - theirs)[[0, 2]]))
        navigable.append(grids[house].is_navigable(np.array(query["point"])) == query["is_navigable"])
    assert np.mean(exists) >= 0.98
    assert np.median(away) < 1e-4
    assert np.percentile(away, 90) < 0.06
    assert np.mean(navigable) >= 0.94


@pytest.mark.parametrize("house", HOUSES)
def test_depth_is_habitats_to_a_millimetre(house, golden_root):
    raycaster = Raycaster(load_glb(golden_root / f"{house}.glb", up="y"))
    with np.load(golden_root / f"{house}.depth.npz") as stored:
        theirs = stored["depth_u16"] * float(stored["scale_m"])
    poses = read(golden_root / f"{house}.poses.json")["poses"]
    for index, pose in enumerate(poses):
        where = Pose(tuple(pose["body_position"]), pose["yaw"], math.radians(pose["tilt_deg"]))
        frame = raycaster.render(T_world_camera(where, Camera()), Camera())
        assert ((frame.depth_m > 0) == (theirs[index] > 0)).all()
        error = np.abs(frame.depth_m - theirs[index])
        assert np.median(error) <= 1e-4
        assert np.mean(error < 1e-3) >= 0.9999


@pytest.mark.parametrize("house", HOUSES)
def test_colours_are_habitats(house, golden_root):
    raycaster = Raycaster(load_glb(golden_root / f"{house}.glb", up="y"))
    for pose in read(golden_root / f"{house}.poses.json")["poses"]:
        if pose["rgb"] is None:
            continue
        where = Pose(tuple(pose["body_position"]), pose["yaw"], math.radians(pose["tilt_deg"]))
        frame = raycaster.render(T_world_camera(where, Camera()), Camera())
        theirs = np.asarray(Image.open(golden_root / pose["rgb"]).convert("RGB")).astype(int)
        seen = frame.depth_m > 0
        assert np.mean(np.abs(frame.rgb - theirs).max(axis=-1)[seen] <= 2) >= 0.999


@pytest.mark.bench
@pytest.mark.parametrize("house", HOUSES)
def test_a_grid_takes_at_most_a_core_second_and_a_frame_120_core_ms(house, golden_root):
    mesh = load_glb(golden_root / f"{house}.glb", up="y")
    floor_grid_from_mesh(mesh)
    begin = time.process_time()
    floor_grid_from_mesh(mesh)
    assert time.process_time() - begin < 1.0
    raycaster = Raycaster(mesh)
    view = T_world_camera(Pose((5.0, 0.1, 2.0), 0.0), Camera())
    raycaster.render(view, Camera())
    times = []
    for _ in range(9):
        begin = time.process_time()
        raycaster.render(view, Camera())
        times.append(time.process_time() - begin)
    assert np.median(times) < 0.12
