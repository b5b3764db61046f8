"""The ground truth at the end of a recording: centre, success region, shortest path."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recordings.scene import goal_region
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.run_files import Run

from .reading import record

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


def test_the_region_is_a_disc_of_one_metre_radius_and_its_walkable_places(home: Scene, episode: Episode) -> None:
    goal = goal_region(episode, home.navigation)
    assert goal.radii.tolist() == [1.0]
    away = np.hypot(goal.rims[0, :, 0] - 3.1, goal.rims[0, :, 2] + 1.9)
    assert away == pytest.approx(1.0)
    assert goal.rims[0, :, 1] == pytest.approx(0.0)
    stand = np.hypot(goal.places[:, 0] - 3.1, goal.places[:, 2] + 1.9)
    assert len(stand) > 100
    assert stand.max() <= 1.0
    assert goal.path is not None
    assert goal.path[0][[0, 2]] == pytest.approx([-3.0, 1.1])
    assert np.hypot(*(goal.path[-1][[0, 2]] - [3.1, -1.9])) == pytest.approx(1.0, abs=0.05)
    walked = np.linalg.norm(np.diff(goal.path, axis=0), axis=1).sum()
    assert walked == pytest.approx(home.navigation.distances(np.array([episode.start.position]), goal.places)[0])


def test_a_target_without_a_near_view_point_has_the_relaxed_radius(home: Scene, episode: Episode) -> None:
    (target,) = episode.targets
    (point,) = target.view_points
    state = point.agent_state.model_copy(update={"position": (3.1, 0.0, -0.7)})
    far = target.model_copy(update={"view_points": (point.model_copy(update={"agent_state": state}),)})
    assert goal_region(replace(episode, targets=(far,)), home.navigation).radii.tolist() == [1.5]


def test_rim_places_and_path_are_logged_on_floor_and_map(
    tmp_path: Path, home: Scene, episode: Episode, agent_run: Run
) -> None:
    found = record(tmp_path / "a.rrd", [agent_run], episode, home)
    (rim,) = found[("/goal/region", False)]["LineStrips3D:strips"][0]
    goal = goal_region(episode, home.navigation)
    assert np.array(rim) == pytest.approx(goal.rims[0] + np.array([0, 0.15, 0]), abs=1e-5)
    (flat,) = found[("/goal/map/storey_0/region", False)]["LineStrips2D:strips"][0]
    assert np.ptp(np.array(flat), axis=0) == pytest.approx([40, 40], abs=1e-3), "2 m in cells of 5 cm"
    for entity in ("/goal/places", "/goal/map/storey_0/places"):
        (points,) = (column for name, column in found[(entity, False)].items() if name.endswith(":positions"))
        assert len(points[0]) == len(goal.places)
    (path,) = found[("/goal/path", False)]["LineStrips3D:strips"][0]
    assert goal.path is not None
    assert len(path) == len(goal.path)


def test_an_unreachable_goal_has_no_path_and_no_divergence(
    tmp_path: Path, home: Scene, episode: Episode, agent_run: Run
) -> None:
    (target,) = episode.targets
    outside = target.model_copy(update={"position": (50.0, 0.4, 50.0)})
    far = replace(episode, targets=(outside,))
    goal = goal_region(far, home.navigation)
    assert goal.path is None
    assert goal.places.shape == (0, 3)
    found = record(tmp_path / "a.rrd", [agent_run], far, home)
    assert ("/goal/centre", False) in found
    assert ("/goal/path", False) not in found
    assert not [entity for entity, _ in found if "path_deviation" in entity or "departure" in entity]
