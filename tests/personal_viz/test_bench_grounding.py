"""The grounding benchmark: its reference gives the literal answers, figures have their shape, targets are kept."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from grounding.encoders.by_name import make_encoder
from grounding.methods.rpg import RpgOptions, rpg_dense
from personal_viz.bench import grounding as bench
from personal_viz.bench import grounding_inputs as inputs
from personal_viz.bench.grounding import GroundingSettings, literal_rpg
from personal_viz.bench.grounding_inputs import random_map, scene_inputs, solve_batch
from personal_viz.bench.harness import run_benchmark
from personal_viz.cli.bench import Bench

TINY = GroundingSettings(
    size=8, dim=16, cells=10, phrases=2, batch=3, calls=2, repeats=1, scenes=1, encoders=("hashed",), cold=False
)
KEYS = {"literal_ms", "batch_ms", "packed_ms", "bound_ms", "literal_over_packed"}


@pytest.fixture
def synthetic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the released dataset is missing."""
    monkeypatch.setattr(inputs, "RELEASE", tmp_path / "none")
    monkeypatch.setattr(bench, "RELEASE", tmp_path / "none")
    monkeypatch.setattr(inputs, "_PHRASES_PER_SCENE", 12)


@pytest.mark.parametrize("options", [RpgOptions(), RpgOptions(top_k=4, nhood=0, nms_r=0)])
def test_the_reference_answers_as_the_literal_form(options: RpgOptions) -> None:
    rng = np.random.default_rng(0)
    maps = [random_map(rng, size=9, dim=12, cells=20) for _ in range(6)]
    features = torch.from_numpy(np.stack([memory.dense() for memory in maps]))
    phrases = torch.from_numpy(rng.normal(size=(6, 3, 12)).astype(np.float32))
    queries = torch.from_numpy(rng.normal(size=(6, 12)).astype(np.float32))
    literal = RpgOptions(options.top_k, options.nhood, options.nms_r, literal=True)
    expected = rpg_dense(features, phrases, queries, options=literal).index
    assert literal_rpg(features, phrases, queries, options=options).tolist() == expected.tolist()


def test_without_the_release_inputs_have_its_shape_and_are_called_synthetic(synthetic: None) -> None:
    encoder = make_encoder("hashed")
    kind, scenes = scene_inputs(encoder, limit=2)
    assert kind == "synthetic"
    assert [len(scene.tasks) for scene in scenes] == [65, 65]
    assert 100 < len(scenes[0].memory.rows) <= 175
    assert scenes[0].memory.grid.shape == (50, 50)
    batch = scenes[0].batch(encoder, with_names=False)
    assert len(batch.phrases) <= 12 < len(scenes[0].batch(encoder, with_names=True).phrases)
    assert bool((solve_batch(batch).index >= 0).all())


@pytest.mark.slow
def test_figures_have_the_shape_that_the_command_prints(
    synthetic: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "QUICK", TINY)
    assert Bench("grounding", out=tmp_path, quick=True, json=()).run() == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "bench-grounding.json").read_text())
    assert printed["inputs"] == "synthetic"
    assert [printed[case]["episodes"] for case in ("b1", "b64", "all_episodes")] == [1, 3, 65]
    for case in ("b1", "b64", "all_episodes"):
        assert all(printed[case][key] > 0 for key in KEYS)
        ratio = printed[case]["literal_ms"] / printed[case]["packed_ms"]
        assert printed[case]["literal_over_packed"] == pytest.approx(ratio)
    assert set(printed["query_ms"]) == {"hashed"}
    assert printed["cold_s"] == printed["cold_phrase_s"] == {}
    assert "65 synthetic episodes on 1 maps" in (tmp_path / "bench-grounding.md").read_text()


@pytest.mark.bench
def test_grounding_keeps_its_targets() -> None:
    report = run_benchmark("grounding", lambda: bench.measure(bench.FULL, print), bench.PLAN, quick=False)
    assert report.missed() == []
