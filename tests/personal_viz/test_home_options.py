"""`--clutter` and `--labels` on their way from the command line into scenes, run files and studies; never mixed."""

from pathlib import Path

import numpy as np
import pytest

from human_study.design.study import StudyConfig, StudyDataset
from personal_viz.cli.refusals import require_no_scan
from personal_viz.cli.runs.replay import Replay
from personal_viz.cli.runs.run import Run
from personal_viz.cli.study.serve import StudyServe
from personal_viz.cli.verbs import parse
from sim.episodes.dataset import PersonalDataset
from sim.errors import PersonalVizError, RecordingError, RunFileError
from sim.homes.open_home import open_scene
from sim.tasks.gym_env import PanGymEnv
from sim.tasks.metrics import metric_rows
from sim.tasks.run_files import read_run
from sim.types import Camera

from .invented import invented_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("clutter")
    invented_dataset(root, name="Demo", seed=5, episodes_per_split=1)
    return root


@pytest.fixture(scope="module")
def folders(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Run folders of one episode without clutter and with level 1."""
    out = tmp_path_factory.mktemp("runs")
    common = ["run", "--agent", "shortest-path", "--dataset", str(dataset), "--out", str(out)]
    for level in ("0", "1"):
        assert parse([*common, "--split", "easy", "--limit", "1", "--clutter", level]).run() == 0
    return [out / "shortest-path-invented-seed0", out / "shortest-path-invented-clutter1-seed0"]


@pytest.mark.slow
def test_run_files_name_the_level_and_tables_keep_levels_apart(dataset: Path, folders: list[Path]) -> None:
    runs = [read_run(folder) for folder in folders]
    assert [run.info.config["clutter"] for run in runs] == [0, 1]
    assert [run.info.condition for run in runs] == ["none", "clutter 1"]
    rows = metric_rows(runs)
    assert {(row.condition, row.n) for row in rows if row.split == "easy"} == {("none", 1), ("clutter 1", 1)}
    (end,) = (episode.end.measures for episode in runs[1].episodes)
    assert end.scene_digest == open_scene(PersonalDataset(dataset), "Demo", clutter=1).digest


@pytest.mark.slow
def test_labels_are_drawn_and_written_down_only_on_request(
    dataset: Path, folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["run", "--agent", "random", "--dataset", str(dataset), "--out", str(tmp_path), "--limit", "1"]
    assert parse([*common, "--split", "easy", "--labels", "on"]).run() == 0
    named = tmp_path / "random-invented-labels-seed0"
    assert [read_run(folder).info.labels for folder in (named, folders[0])] == [True, False]
    with pytest.raises(RunFileError, match=r"labels is True, this run has False; expected the same to resume"):
        parse([*common, "--split", "easy", "--run-id", named.name]).run()
    with pytest.raises(RunFileError, match="expected one of the two per table"):
        parse(["metrics", str(named), str(folders[0])]).run()
    with pytest.raises(RecordingError, match=r"written on them \(random.*\) and without \(shortest.*\).*Leave"):
        Replay(runs=(named, folders[0]), out=tmp_path / "b.rrd", dataset=dataset).run()
    assert Replay(runs=(named,), out=tmp_path / "a.rrd", dataset=dataset).run() == 0
    assert "Demo (invented home, labels)" in capsys.readouterr().out


def test_an_agent_sees_words_on_objects_only_in_a_home_with_labels(dataset: Path) -> None:
    episodes = PersonalDataset(dataset)
    camera = Camera(width=160, height=120)
    pictures = {}
    for labels in (False, True):
        env = PanGymEnv(episodes, splits=("easy",), camera=camera, labels=labels, render_mode="rgb_array")
        observation, _ = env.reset(seed=0)
        pictures[labels] = [observation["rgb"], *(env.step(2)[0]["rgb"] for _ in range(11))]
        assert np.array_equal(env.render(), pictures[labels][-1])
    assert any(not np.array_equal(*pair) for pair in zip(pictures[False], pictures[True], strict=True))


@pytest.mark.slow
def test_a_recording_is_made_in_the_home_of_its_runs(dataset: Path, folders: list[Path], tmp_path: Path) -> None:
    assert Replay(runs=(folders[1],), out=tmp_path / "a.rrd", dataset=dataset).run() == 0
    with pytest.raises(RecordingError, match=r"found clutter levels 0 \(.*\), 1 \(.*clutter1.*\); expected one"):
        Replay(runs=tuple(folders), out=tmp_path / "b.rrd", dataset=dataset).run()


def test_a_study_freezes_its_level_and_older_studies_keep_their_hash() -> None:
    def study(**choice) -> StudyConfig:
        return StudyConfig(study="s", dataset=StudyDataset(sha256="d"), task=("pan",), **choice)

    assert study(clutter=0).study_version == study().study_version
    assert "clutter" not in study().canonical_json()
    assert study(clutter=2).study_version != study().study_version
    assert "labels" not in study().canonical_json()
    assert study(labels=True).study_version != study().study_version


def test_scans_take_no_clutter() -> None:
    require_no_scan("scan", clutter=0)
    require_no_scan("schematic", clutter=2)
    with pytest.raises(PersonalVizError, match="--clutter is 1 beside --scenes-dir"):
        require_no_scan("scan", clutter=1)


def test_the_options_parse() -> None:
    verb = parse(["run", "--dataset", "d", "--agent", "random", "--clutter", "1"])
    assert isinstance(verb, Run)
    assert verb.clutter == 1
    verb = parse(["study", "serve", "--dataset", "d", "--scene", "A", "--clutter", "2", "--labels", "on"])
    assert isinstance(verb, StudyServe)
    assert (verb.clutter, verb.labels) == (2, "on")
    verb = parse(["run", "--dataset", "d", "--agent", "random", "--label", "mine"])
    assert isinstance(verb, Run)
    assert (verb.label, verb.labels) == ("mine", "off")
