"""Free-text answers in a map's recording: marks on the storeys of the answers, scores of cells and things."""

from pathlib import Path

import numpy as np
import pytest

from grounding.maps.home_map import HomeMemory, merged_storeys
from grounding.methods.free_text import FoundPlace, Reply
from grounding.types import Grounding, Layers
from recordings.replay import record_memory

from .reading import Tables, tables
from .test_memory import cells_memory, objects_memory

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


def recorded(memory: HomeMemory, replies: list[Reply], out: Path) -> Tables:
    searched = merged_storeys(memory)
    return tables(
        record_memory(memory, name="m", out=out, scene=None, with_pixels=False, asked=replies, searched=searched)
    )


def reply(layers: Layers | None, *positions: tuple[float, float, float]) -> Reply:
    places = tuple(FoundPlace(position, 0, position[1], 0.5) for position in positions)
    return Reply("the red table", "", places, Grounding((), layers))


def test_marks_and_scores_of_cells(tmp_path: Path) -> None:
    memory = cells_memory()
    rc = merged_storeys(memory).rc  # type: ignore[union-attr]
    layers = Layers(rc, (8, 10), final=np.array([0.1, 0.9, -np.inf], np.float32))
    found = recorded(memory, [reply(layers, (2.5, 0.0, -0.5), (-2.5, 0.0, -0.5)), reply(None)], tmp_path / "a.rrd")
    marks = found[("/memory/m/home/storey_0/asked_1/places", True)]
    np.testing.assert_allclose(np.array(marks["Points3D:positions"][0])[:, [0, 2]], [[2.5, -0.5], [-2.5, -0.5]])
    assert marks["Points3D:labels"][0] == ["1 the red table", "2 the red table"]
    assert ("/memory/m/map/storey_0/asked_1/places", True) in found
    assert ("/memory/m/map/storey_0/asked_1/scores", True) in found
    assert ("/memory/m/map/storey_0/asked_2/scores", True) not in found


def test_scores_of_things_are_boxes(tmp_path: Path) -> None:
    memory = objects_memory()
    layers = Layers(np.array([[1, 1], [2, 2]], np.int16), (4, 4), final=np.array([0.1, 0.9], np.float32))
    found = recorded(memory, [reply(layers, (3.1, 0.4, -1.9))], tmp_path / "a.rrd")
    boxes = found[("/memory/m/map/storey_0/asked_1/scores", True)]
    assert len(boxes["Boxes2D:half_sizes"][0]) == 2
