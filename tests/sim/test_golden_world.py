"""Our navigation, pictures and measures, compared with the real habitat-sim and habitat-lab on two houses.

tests/release/test_frozen_habitat.py checks every figure to the last digit. The grid is made from the mesh alone and
does not copy a navmesh: the bounds here are the agreement that it reaches, with a small margin.
"""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from personal_viz.bench.habitat.agreement import agreement, targets_met
from sim.frames import T_world_camera
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.types import Camera, Pose
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh

HOUSES = ("dev_a", "dev_b")


def read(path: Path):
    return json.loads(gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes())


@pytest.fixture(scope="module")
def grids(golden_root) -> dict[str, FloorGrid]:
    return {name: floor_grid_from_mesh(load_glb(golden_root / f"{name}.glb", up="y")) for name in HOUSES}


@pytest.mark.release
def test_every_target_is_met_and_nothing_is_missing(golden_root):
    found = agreement(golden_root)
    assert found.missing == ()
    assert [key for key, met in targets_met(found).items() if not met] == []


@pytest.mark.parametrize("house", HOUSES)
def test_area_and_islands_agree_with_habitat(house, grids, golden_root):
    info = read(golden_root / f"{house}.info.json")["navmeshes"][f"{house}.navmesh"]
    assert grids[house].area == pytest.approx(info["navigable_area"], rel=0.005)
    islands = np.sort(np.bincount(grids[house].islands)) * 0.05**2
    np.testing.assert_allclose(islands, np.sort(info["island_areas"]), rtol=0.01)


@pytest.mark.parametrize("house", HOUSES)
def test_the_area_for_a_taller_thinner_robot_agrees_with_habitat(house, golden_root):
    mesh = load_glb(golden_root / f"{house}.glb", up="y")
    info = read(golden_root / f"{house}.info.json")["navmeshes"][f"{house}.default.navmesh"]
    found = floor_grid_from_mesh(mesh, radius=0.1, height=1.5)
    assert found.surface_area == pytest.approx(info["navigable_area"], rel=0.01)


def test_storeys_are_found_and_roofs_are_not(grids):
    # Floors of info.json and objects.json: 0.0171 and 2.8471 (dev_a), 0.0371 with a platform (dev_b).
    assert grids["dev_a"].storey_heights == pytest.approx((0.0171, 2.8471), abs=0.001)
    assert grids["dev_b"].storey_heights == pytest.approx((0.0371,), abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize("house", HOUSES)
def test_distances_to_the_nearest_of_several_goals_agree_with_habitat(house, grids, golden_root):
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
def test_single_steps_end_where_they_do_in_habitat(house, share, agreement, rule, slide, grids, golden_root):
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
def test_points_snap_to_the_same_places_as_in_habitat(house, grids, golden_root):
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
def test_colours_and_depth_agree_with_habitat(house, golden_root):
    stored = np.load(golden_root / f"{house}.depth.npz")
    raycaster = Raycaster(load_glb(golden_root / f"{house}.glb", up="y"))
    for pose in read(golden_root / f"{house}.poses.json")["poses"]:
        if pose["rgb"] is None:
            continue
        where = Pose(tuple(pose["body_position"]), pose["yaw"], math.radians(pose["tilt_deg"]))
        frame = raycaster.render(T_world_camera(where, Camera()), Camera())
        theirs = np.asarray(Image.open(golden_root / pose["rgb"]).convert("RGB")).astype(int)
        seen = frame.depth_m > 0
        depth_m = stored["depth_u16"][pose["index"]] * stored["scale_m"]
        off = np.abs(frame.depth_m - depth_m)[seen & (depth_m > 0)]
        assert np.median(off) <= 1e-4
        assert np.mean(off <= 1e-3) >= 0.9999
        assert np.mean(np.abs(frame.rgb - theirs).max(axis=-1)[seen] <= 2) >= 0.999
