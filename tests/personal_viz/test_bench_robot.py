"""The benchmark of robot recordings: its truth is that of the mesh, figures have their shape, targets are kept."""

import json
from pathlib import Path

import numpy as np
import pytest

from grounding.maps.occupancy import OccupancyMapper
from personal_viz.bench.harness import run_benchmark
from personal_viz.bench.robot import figures as bench
from personal_viz.bench.robot.figures import RobotSettings
from personal_viz.bench.robot.free_floor import TrueFloor, cells_seen, map_score
from personal_viz.bench.robot.walks import NEAREST, WAYS, handheld_walk
from personal_viz.cli.bench import Bench
from sim.tasks.observers import FREE, OCCUPIED
from sim.types import GridSpec

TINY = RobotSettings(seeds=1, rotations=1, num_frames=120, looked_at=30, other_seeds=0)


def test_a_walk_gives_the_same_pictures_again_and_a_sensor_sees_less_than_there_is() -> None:
    walk = handheld_walk(7, num_frames=3)
    first, again = list(walk.frames()), list(walk.frames())
    assert all((one.depth_m == other.depth_m).all() for one, other in zip(first, again, strict=True))
    assert first[0].ids is None
    for true, sensed in walk.pairs():
        seen = sensed.depth_m > 0
        assert 0.2 < seen.mean() < 0.97
        assert np.median(np.abs(sensed.depth_m - true.depth_m)[seen]) < 0.02
    heights = walk.Ts_world_camera[:, 1, 3] - walk.floor_y
    assert (heights > 1.2).all()
    assert (heights < 1.65).all()


@pytest.mark.parametrize("way", WAYS)
def test_each_way_of_carrying_gives_poses(way: str) -> None:
    walk = handheld_walk(3, num_frames=20, carrying=WAYS[way])
    ups_camera = walk.Ts_world_camera[:, 1, :3]
    assert ups_camera.shape == (20, 3)
    is_upright = np.abs(ups_camera[:, 0]).mean() > 0.5
    assert is_upright == ("portrait" in way)


def test_free_floor_and_edges_are_scored_by_hand() -> None:
    truth = TrueFloor(GridSpec((0.0, 0.0), 0.02, (100, 100)), np.ones((100, 100), bool))
    truth.is_free[:, 50:] = False  # a thing from x = 1 m on
    grid = GridSpec((0.0, 0.0), 0.05, (40, 40))
    cells = np.full((40, 40), FREE, np.uint8)
    cells[:, 22:] = OCCUPIED  # 10 cm too late
    cells[0] = OCCUPIED
    seen = [np.argwhere(np.ones((40, 40), bool))]
    score = map_score(cells, grid, seen, truth)
    assert (score.num_free, score.num_recalled) == (40 * 20, 39 * 20)
    assert np.median(score.edges) == pytest.approx(0.125, abs=0.03)


@pytest.mark.slow
def test_a_maps_free_floor_is_free_in_the_mesh() -> None:
    walk = handheld_walk(1, num_frames=40)
    mapper = OccupancyMapper(floor_y=walk.floor_y)
    seen = []
    for true, _ in walk.pairs():  # without noise, the mesh and the map agree
        seen.append(cells_seen(true, mapper.grid, walk.floor_y, nearest=NEAREST))
        mapper.add(true.depth_m, true.T_world_camera, true.camera)
    score = map_score(mapper.cells, mapper.grid, seen, TrueFloor.of(walk.scene, walk.floor_y))
    assert score.num_recalled > 0.97 * score.num_free > 1000
    assert np.quantile(score.edges, 0.95) < 0.1


@pytest.mark.slow
def test_figures_have_the_shape_that_the_command_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "QUICK", TINY)
    assert Bench("robot", out=tmp_path, quick=True, json=()).run() == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "bench-robot.json").read_text())
    assert printed["up"]["within_2_deg"] == 1.0
    assert printed["up"]["wrong"] == printed["up"]["refused"] == 0.0
    assert printed["floor"]["within_3_cm"] == 1.0
    assert 0.9 <= printed["floor"]["free_recall"] <= 1.0
    assert 0 < printed["floor"]["edge_p95_cm"] <= 10
    assert printed["ways"] == {}
    assert "1 handheld walks of 120 frames" in (tmp_path / "bench-robot.md").read_text()


@pytest.mark.bench
def test_robot_recordings_keep_their_targets() -> None:
    report = run_benchmark("robot", lambda: bench.measure(bench.FULL, print), bench.PLAN, quick=False)
    assert report.missed() == []
