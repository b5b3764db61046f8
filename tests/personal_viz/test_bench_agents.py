"""The benchmark of agents: its literal forms give the same maps, and it prints its six figures."""

import json
from pathlib import Path

import pytest

from personal_viz.bench import agents as bench
from personal_viz.cli.bench import Bench
from sim.types import Pose

from ..grounding.two_rooms import two_room_scene

TINY = bench.AgentSettings(width=64, height=48, steps=20, memory_steps=20, rounds=1, literal_views=3)


def test_it_prints_six_figures_after_comparing_the_maps_with_their_literal_forms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "QUICK", TINY)
    monkeypatch.setattr(bench, "bench_home", lambda: (two_room_scene(), Pose((1.0, 0.0, 1.0), 0.5)))
    assert Bench("agents", out=tmp_path, quick=True, json=()).run() == 0
    printed = json.loads(capsys.readouterr().out)
    names = {"vlfm_ms", "onemap_ms", "literal_over_vlfm", "literal_over_onemap", "planner_ms", "mb"}
    assert {figure["name"] for figure in printed["figures"]} == names
    assert all(printed[name] > 0 for name in names)
    assert printed["planner_ms"] < printed["vlfm_ms"] + printed["onemap_ms"]
    assert printed["literal_over_vlfm"] > 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench-agents.json", "bench-agents.md"]
