"""`personal-viz show-exploration`: a stored walk done again in its home, and what is refused."""

from pathlib import Path

import pytest

from grounding.agents.exploration import load_exploration, save_exploration
from grounding.agents.explore import Exploration, explore, start_on_storey
from personal_viz.cli.grounding import same_home
from personal_viz.cli.grounding.show_exploration import ShowExploration
from personal_viz.cli.verbs import parse
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.homes.open_home import open_scene
from sim.mesh import Scene
from sim.types import Camera

from ..recordings.reading import tables

NAME = "HomeTwo"


@pytest.fixture(scope="module")
def scene(small_root: Path) -> Scene:
    return open_scene(PersonalDataset(small_root), NAME)


@pytest.fixture(scope="module")
def exploration(scene: Scene) -> Exploration:
    """Five steps with a small picture."""
    start = start_on_storey(scene, scene.navigation.storey_heights[0], 1)
    return explore(scene, start, seed=1, max_steps=5, camera=Camera(width=96, height=72))


def test_the_walk_is_shown_with_its_figures(
    exploration: Exploration,
    scene: Scene,
    small_root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(same_home, "open_scene", lambda *_, **__: scene)
    save_exploration(tmp_path / "a.json", exploration)
    assert ShowExploration(file=tmp_path / "a.json", dataset=small_root, out=tmp_path / "a.rrd").run() == 0
    read = tables(tmp_path / "a.rrd")
    assert len(read[("/runs/frontier/camera", False)]["EncodedImage:blob"]) == 6
    assert ("/runs/frontier/map/storey_0/occupancy", False) in read
    text = read[("/task", True)]["TextDocument:text"][-1][0]
    assert "| stop reason | steps |" in text
    assert "another action" not in text
    assert "5 steps in HomeTwo" in capsys.readouterr().out


def test_another_version_of_the_home_and_other_files_are_refused(
    exploration: Exploration, scene: Scene, small_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(same_home, "open_scene", lambda *_, **__: scene)
    save_exploration(tmp_path / "b.json", exploration.model_copy(update={"scene_digest": "f" * 64}))
    with pytest.raises(RecordingError, match="expected the same version of the home"):
        ShowExploration(file=tmp_path / "b.json", dataset=small_root, out=tmp_path / "b.rrd").run()
    with pytest.raises(RecordingError, match=r"ends in \.rrd"):
        ShowExploration(file=tmp_path / "b.json", dataset=small_root, out=tmp_path / "b.json").run()


@pytest.mark.slow
def test_an_invented_home_is_made_again_from_its_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    explored = ["explore", "--homes", "1", "--width", "48", "--height", "36", "--max-steps", "4"]
    assert parse([*explored, "--out", str(tmp_path / "walks")]).run() == 0
    (file,) = (tmp_path / "walks").glob("Invented0*.json")
    assert parse(["show-exploration", str(file), "--out", str(tmp_path / "a.rrd")]).run() == 0
    assert len(tables(tmp_path / "a.rrd")[("/runs/frontier/camera", False)]["EncodedImage:blob"]) == 5
    assert "4 steps in" in capsys.readouterr().out
    other = load_exploration(file).model_copy(update={"scene_digest": "f" * 64})
    save_exploration(tmp_path / "other.json", other)
    with pytest.raises(RecordingError, match=r"the home invented now has .*Give its --dataset, or explore it again"):
        ShowExploration(file=tmp_path / "other.json", out=tmp_path / "b.rrd").run()


def test_a_home_that_is_not_made_from_its_name_needs_its_dataset(exploration: Exploration, tmp_path: Path) -> None:
    save_exploration(tmp_path / "c.json", exploration)
    words = r"c\.json: home 'HomeTwo': is not the name of an invented home; expected .* give --dataset"
    with pytest.raises(RecordingError, match=words):
        ShowExploration(file=tmp_path / "c.json", out=tmp_path / "c.rrd").run()
    assert not (tmp_path / "c.rrd").exists()


def test_the_verb_takes_a_file() -> None:
    verb = parse(["show-exploration", "a.json", "--dataset", "d", "--out", "b.rrd"])
    assert (verb.file, verb.dataset, verb.out) == (Path("a.json"), Path("d"), Path("b.rrd"))
