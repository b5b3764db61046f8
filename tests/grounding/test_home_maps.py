"""Grounding on maps of homes that our explorer walks: from the command line to map files, reuse, and refused files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grounding.evaluation.evaluate import SceneGrounder
from grounding.evaluation.home_maps import MapFolders
from grounding.evaluation.settings import GroundSettings
from grounding.maps.files import load_memory, read_map_header
from grounding.maps.home_map import ObjectMap
from grounding.types import FeatureMap
from personal_viz.cli.grounding.ground import Ground
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, RunFileError
from sim.tasks.run_files import read_run

pytestmark = pytest.mark.release  # a whole home is explored and mapped: 45 s


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, small_home_root: Path) -> Path:
    """The folder in which the home was explored and mapped once, for the run `first`."""
    out = tmp_path_factory.mktemp("runs")
    assert (
        Ground(dataset=small_home_root, method="phrase", map="explore", out=out, run_id="first", json=True).run() == 0
    )
    return out


def folders(runs: Path) -> MapFolders:
    info = read_run(runs / "first").info
    return MapFolders(runs / str(info.config["maps"]), runs / "explorations")


def test_most_queries_are_answered_in_an_explored_home_and_the_run_states_its_condition(runs: Path) -> None:
    run = read_run(runs / "first")
    assert run.info.scene_kind == "invented"
    assert run.info.condition == "explore map, hashed+oracle-perception encoder, phrases dataset, storey given"
    assert len(run.answers) == 24
    right = [answer for answer in run.answers if answer.measures is not None and answer.measures.success]
    assert len(right) >= 18  # perception is perfect; the rest fails by the resolution of the map and unseen objects


def test_maps_name_their_encoder_home_and_kind_and_are_refused_for_other_ones(
    runs: Path, small_home_root: Path, tmp_path: Path
) -> None:
    header = read_map_header(folders(runs).map_file("Small"))
    assert header.encoder.endswith("+oracle-perception")
    assert (header.source.scene, header.source.kind) == ("Small", "invented")
    assert "oracle-perception" in header.source.builder
    assert [storey.grid.cell for storey in header.storeys if storey.grid] == [1.0]
    with pytest.raises(AgentError, match=r"Small\.npz: holds 768-d vectors of encoder .*the query is 384-d"):
        Ground(dataset=small_home_root, method="qs", map=str(folders(runs).maps), encoder="minilm", out=tmp_path).run()
    with pytest.raises(RunFileError, match=r"Small\.npz: found no file"):
        Ground(dataset=small_home_root, method="qs", map=str(tmp_path), out=tmp_path / "out").run()


def test_a_folder_of_maps_gives_the_same_answers(
    runs: Path, small_home_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maps = folders(runs).maps
    options = {"dataset": small_home_root, "method": "phrase", "out": runs, "run_id": "again", "json": True}
    assert Ground(**options, map=str(maps), encoder="hashed").run() == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scene_kind"] == "invented"
    first, again = read_run(runs / "first"), read_run(runs / "again")
    assert [item.candidates for item in first.answers] == [item.candidates for item in again.answers]


def test_a_second_layout_does_not_explore_again(runs: Path, small_home_root: Path) -> None:
    (exploration,) = (runs / "explorations").iterdir()
    before = exploration.stat().st_mtime_ns
    options = {"dataset": small_home_root, "map": "explore", "out": runs, "json": True, "limit": 2}
    assert Ground(**options, method="object-phrase", layout="objects", run_id="things").run() == 0
    assert exploration.stat().st_mtime_ns == before
    info = read_run(runs / "things").info
    home = load_memory(runs / str(info.config["maps"]) / "Small.npz")
    assert isinstance(home.storeys[0].memory, ObjectMap)
    assert len(home.storeys[0].memory.objects) > 10


def test_all_storeys_of_a_one_storey_home_merge_into_the_same_map(runs: Path, small_home_root: Path) -> None:
    dataset = PersonalDataset(small_home_root)
    settings = GroundSettings("phrase", map="explore")
    episode = next(iter(dataset.episodes()))
    one = SceneGrounder(dataset, "Small", settings, folders=folders(runs)).memory(episode)
    merged = SceneGrounder(dataset, "Small", replace(settings, all_storeys=True), folders=folders(runs)).memory(episode)
    assert isinstance(one, FeatureMap)
    assert isinstance(merged, FeatureMap)
    np.testing.assert_allclose(merged.rows, one.rows, atol=1e-6)
