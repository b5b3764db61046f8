"""Figures from known lengths, error lines, and, where Recast is installed, a home whose lengths it confirms."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from personal_viz.bench.homes.recast_lab import Figures, Lengths, figures, main, measure, pooled
from sim.homes.open_home import scene_from_plan
from tests.sim.cell_plans import two_storeys
from tests.sim.plans import two_rooms

MODULES = os.environ.get("RECAST_MODULES", "")
"""The folder node_modules of a computer that has recast-navigation."""
needs_recast = pytest.mark.skipif(
    not MODULES or shutil.which("node") is None, reason="needs Node.js and RECAST_MODULES, a folder node_modules"
)
INF = np.inf


def lengths(ours: list[float], recast: list[float], between_storeys: list[float]) -> Lengths:
    return Lengths(np.array(ours), np.array(recast), np.array(between_storeys))


def test_figures_of_known_lengths() -> None:
    found = figures(lengths([10.2, 5.5, 3, INF, 0, 8], [10, 5, INF, 4, 0, 8], [6, INF, 7, 8]))
    assert found.pairs == 6
    assert found.reached == 5 / 6
    assert found.ratio_median == pytest.approx(1.02)  # 1.02, 1.1 and 1; two are not joined, one has no length
    assert found.within_5 == 2 / 3
    assert (found.storey_pairs, found.storey_pairs_joined) == (4, 0.75)


def test_a_home_without_pairs_has_no_shares() -> None:
    assert figures(lengths([], [], [])) == Figures(
        pairs=0, reached=None, ratio_median=None, within_5=None, storey_pairs=0, storey_pairs_joined=None
    )


def test_homes_are_pooled_by_pairs() -> None:
    together = figures(pooled([lengths([2], [2], []), lengths([3, 4, 5], [INF, 4, 5], [1, INF])]))
    assert (together.pairs, together.reached) == (4, 0.75)
    assert (together.storey_pairs, together.storey_pairs_joined) == (2, 0.5)


def test_a_missing_module_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "node").touch(mode=0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit) as stopped:
        main(["dataset", "--node-modules", "nowhere"])
    assert stopped.value.code == (
        "--node-modules is 'nowhere'; expected a folder node_modules with recast-navigation. Make one with "
        '"npm install recast-navigation".'
    )


def test_a_missing_node_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit) as stopped:
        main(["dataset", "--node-modules", str(tmp_path)])
    assert stopped.value.code == "PATH: found no program 'node'; expected Node.js 18 or newer. Install it."


@needs_recast
def test_recast_confirms_the_lengths_of_a_simple_home() -> None:
    walks = np.array([[(1.0, 0.0, 1.0), (7.0, 0.0, 1.0)], [(1.0, 0.0, 3.5), (3.0, 0.0, 0.5)]])
    found = measure(scene_from_plan(two_rooms()), walks, node_modules=Path(MODULES))
    assert found.recast == pytest.approx(found.ours, rel=0.03)
    shut = measure(scene_from_plan(two_rooms(door=None)), walks, node_modules=Path(MODULES))
    assert np.isfinite(shut.recast).tolist() == [False, True]


@needs_recast
def test_recast_climbs_the_flight_between_two_storeys() -> None:
    found = figures(measure(scene_from_plan(two_storeys()), np.empty((0, 2, 3)), node_modules=Path(MODULES)))
    assert 30 < found.storey_pairs < 60  # the floor below the flight is an island, from which our map joins nothing
    assert found.storey_pairs_joined == 1
