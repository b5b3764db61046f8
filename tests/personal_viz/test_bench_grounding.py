"""The grounding benchmark: its reference gives the literal answers, figures have their shape, targets are kept."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from grounding.encoders.by_name import make_encoder
from grounding.methods.rpg import RpgOptions, rpg_dense
from personal_viz.bench import grounding as bench
from personal_viz.bench import harness
from personal_viz.bench.grounding import GroundingSettings, literal_rpg
from personal_viz.bench.grounding_inputs import random_map, scene_inputs, solve_batch
from personal_viz.bench.harness import run_benchmark
from personal_viz.cli.bench import Bench

TINY = GroundingSettings(
    size=8, dim=16, cells=10, phrases=2, batch=3, calls=2, repeats=1, scenes=1, encoders=("hashed",), cold=False
)
KEYS = {"literal_ms", "batch_ms", "packed_ms", "bound_ms", "literal_over_packed"}


@pytest.fixture
def invented(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hides the released dataset."""
    monkeypatch.setattr(harness, "RELEASE", tmp_path / "none")


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


def test_without_the_release_an_invented_homes_episodes_are_answered(invented: None) -> None:
    encoder = make_encoder("hashed")
    kind, (scene,) = scene_inputs(encoder)
    assert kind == "invented"
    assert len(scene.tasks) == 24
    assert len(scene.memory.rows) > 20
    batch = scene.batch(encoder)
    assert 0 < len(batch.phrases) <= len({phrase for phrases in scene.phrases for phrase in phrases})
    assert bool((solve_batch(batch).index >= 0).all())


@pytest.mark.slow
def test_figures_have_the_shape_that_the_command_prints(
    invented: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "QUICK", TINY)
    assert Bench("grounding", out=tmp_path, quick=True, json=()).run() == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "bench-grounding.json").read_text())
    assert printed["inputs"] == "invented"
    assert [printed[case]["episodes"] for case in ("b1", "b64", "all_episodes")] == [1, 3, 24]
    for case in ("b1", "b64", "all_episodes"):
        assert all(printed[case][key] > 0 for key in KEYS)
        ratio = printed[case]["literal_ms"] / printed[case]["packed_ms"]
        assert printed[case]["literal_over_packed"] == pytest.approx(ratio)
    assert set(printed["query_ms"]) == {"hashed"}
    cases = ("first_time_s", "afterwards_s", "first_time_phrase_s", "afterwards_phrase_s")
    assert [printed[case] for case in cases] == [{}, {}, {}, {}]
    assert "24 invented episodes on 1 maps" in (tmp_path / "bench-grounding.md").read_text()


@pytest.mark.bench
def test_grounding_keeps_its_targets() -> None:
    report = run_benchmark("grounding", lambda: bench.measure(bench.FULL, print), bench.PLAN, quick=False)
    assert report.missed() == []
