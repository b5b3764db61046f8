"""`personal-viz show-map`: a robot's map alone, a map in its home, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from grounding.maps.files import MapSource, save_memory
from grounding.maps.home_map import HomeMemory, OccupancyGrid, StoreyMemory
from grounding.types import map_from_cells
from personal_viz.cli.grounding.show_map import ShowMap
from personal_viz.cli.verbs import parse
from sim.episodes.dataset import PersonalDataset
from sim.errors import RecordingError
from sim.homes.open_home import open_scene
from sim.tasks.observers import FREE
from sim.types import GridSpec

from ..recordings.reading import tables


def memory(frame: str) -> HomeMemory:
    cells = np.full((40, 60), FREE, np.uint8)
    features = map_from_cells(
        np.eye(2, 3), np.array([[0, 0], [1, 2]]), grid=GridSpec((0, 0), 1.0, (2, 3)), floor_y=0.0, encoder="e"
    )
    return HomeMemory((StoreyMemory(OccupancyGrid(cells, GridSpec((0, 0), 0.05, (40, 60))), features),), frame, 3)


def saved(path: Path, *, frame: str = "world", **source: str) -> Path:
    values = {"scene": "HomeOne", "kind": "schematic", "builder": "grid"} | source
    save_memory(path, memory(frame), MapSource.model_validate(values))
    return path


def test_a_robots_map_is_written_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = saved(tmp_path / "lab.npz", frame="robot, y up", kind="robot", scene="lab")
    assert ShowMap(file=file, out=tmp_path / "lab.rrd").run() == 0
    assert ("/memory/lab/map/storey_0/features", True) in tables(tmp_path / "lab.rrd")
    printed = capsys.readouterr().out
    assert "map of lab without its home, made by grid" in printed
    assert "--dataset" not in printed  # which is refused
    with pytest.raises(RecordingError, match="is a robot's map; expected no --dataset"):
        ShowMap(file=file, out=tmp_path / "x.rrd", dataset=tmp_path).run()


@pytest.mark.slow
def test_a_map_is_shown_in_the_home_that_it_was_made_in(tmp_path: Path, small_root: Path) -> None:
    digest = open_scene(PersonalDataset(small_root), "HomeOne").digest
    file = saved(tmp_path / "HomeOne.npz", digest=digest)
    ShowMap(file=file, out=tmp_path / "a.rrd", dataset=small_root).run()
    read = tables(tmp_path / "a.rrd")
    assert ("/scene/mesh/storey_0", True) in read
    assert ("/memory/HomeOne/home/storey_0/features", True) in read
    other = saved(tmp_path / "other.npz", digest="f" * 64)
    with pytest.raises(RecordingError, match="expected the same version of the home"):
        ShowMap(file=other, out=tmp_path / "b.rrd", dataset=small_root).run()


def test_maps_of_scans_need_permission_and_file_names_their_ending(tmp_path: Path) -> None:
    file = saved(tmp_path / "scan.npz", kind="scan")
    with pytest.raises(RecordingError, match="licensed scan HomeOne"):
        ShowMap(file=file, out=tmp_path / "a.rrd").run()
    assert ShowMap(file=file, out=tmp_path / "a.rrd", with_pixels=True).run() == 0
    with pytest.raises(RecordingError, match=r"ends in \.rrd"):
        ShowMap(file=file, out=tmp_path / "a.png").run()


def test_the_verb_takes_a_file() -> None:
    verb = parse(["show-map", "a.npz", "--out", "b.rrd"])
    assert (verb.file, verb.out, verb.dataset) == (Path("a.npz"), Path("b.rrd"), None)
