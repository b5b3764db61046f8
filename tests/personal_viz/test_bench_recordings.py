"""The recordings' benchmark: its walkers and figures are what they say; costs are judged only when asked for."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import personal_viz.bench.recordings as bench
from personal_viz.bench.recordings import LIMITS, RecordingFigures, RecordingSettings, figure_rows, markdown
from personal_viz.bench.walkers import RecordedHome, recorded_home, walked
from personal_viz.cli.bench import Bench
from sim.errors import PersonalVizError
from sim.types import Action

TINY = RecordingSettings(agent_steps=12, person_steps=5, num_people=2, num_agents=1, repeats=1)
KEYS = {"steps_per_s", "encode_only_steps_per_s", "mb_with_pixels", "mb_without", "compare_build_s", "compare_open_s"}
"""What the issue asks for."""


@pytest.fixture(scope="module")
def home() -> RecordedHome:
    return recorded_home()


@pytest.fixture(scope="module")
def figures() -> RecordingFigures:
    return bench.measure_recordings(TINY, progress=lambda _: None)


@pytest.mark.slow
def test_a_walker_takes_the_steps_asked_for_and_stops(home: RecordedHome) -> None:
    agent = walked(home, "agent", who_kind="agent", num_steps=60, seed=3)
    (run,) = agent.episodes
    assert len(run.steps) == 60
    assert [index for index, step in enumerate(run.steps) if step.action is Action.STOP] == [59]
    assert run.end.measures is not None
    assert run.end.measures.path_m > 4
    assert all(step.t_s == 0 for step in run.steps)
    again = walked(home, "agent", who_kind="agent", num_steps=60, seed=3).episodes
    assert again == agent.episodes


@pytest.mark.slow
def test_people_take_time_and_have_a_code(home: RecordedHome) -> None:
    (run,) = walked(home, "person", who_kind="human", num_steps=4, seed=1).episodes
    assert run.start.participant == "P01"
    assert [step.t_s for step in run.steps] == pytest.approx([0.8, 1.6, 2.4, 3.2])


@pytest.mark.slow
def test_figures_belong_together(figures: RecordingFigures) -> None:
    ratio = figures.encode_only_steps_per_s / figures.steps_per_s
    assert figures.cost_over_encoding == pytest.approx(ratio)
    assert figures.cost_over_fast_encoding == pytest.approx(figures.encode_only_fast_steps_per_s / figures.steps_per_s)
    assert 0 < figures.mb_without < figures.mb_with_pixels
    assert figures.compare_pictures == 2 * 6 + 13
    assert figures.compare_mb > 0
    assert set(figures.model_dump()) >= KEYS


def test_both_encoders_make_the_same_bytes() -> None:
    small = np.random.default_rng(0).integers(0, 255, (12, 16, 3), dtype=np.uint8)
    picture = np.asarray(Image.fromarray(small).resize((47, 33), Image.Resampling.BICUBIC))
    assert bench._pillow_jpeg(picture) == bench.jpeg_bytes(picture)


@pytest.mark.slow
def test_the_command_writes_and_prints_the_same_json(
    figures: RecordingFigures, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "measure_recordings", lambda settings, progress: figures)
    assert Bench("recordings", out=tmp_path, quick=True, json=True).work() == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "bench-recordings.json").read_text())
    assert RecordingFigures.model_validate(printed) == figures
    assert (tmp_path / "bench-recordings.md").read_text() == markdown(figures)


def test_a_missed_target_is_said() -> None:
    values = {name: 1.0 for name, field in RecordingFigures.model_fields.items() if field.annotation is float}
    some = RecordingFigures(
        settings=TINY, compare_pictures=3, compare_open_s=None, **{**values, "compare_build_s": 10.01}
    )
    rows = {row[0]: row[1:] for row in figure_rows(some)[1:]}
    assert rows["compare_build_s"] == ("10.01", "<= 10", "no")
    assert rows["mb_without"] == ("1.00", "<= 2", "yes")
    assert rows["compare_mb"] == ("1.00", "", "")


def test_a_folder_that_cannot_be_made_is_found_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(PersonalVizError, match="expected a folder"):
        Bench("recordings", out=tmp_path / "file", quick=True).work()


@pytest.mark.bench
def test_recordings_keep_their_targets() -> None:
    found = bench.measure_recordings(bench.FULL, progress=print)
    assert {name: value for name in LIMITS if (value := getattr(found, name)) is None or value > LIMITS[name]} == {}
