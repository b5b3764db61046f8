"""Maps in recordings: layers, colours, storeys, and refusals."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.maps.home_map import HomeMemory, ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory
from grounding.types import map_from_cells
from recordings.maps import GREY, vector_rgb
from recordings.memory import memory_markdown, storeys_of_memory
from recordings.replay import record_memory
from sim.errors import RecordingError
from sim.mesh import Scene
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import GridSpec

from ..sim.grids import level_floors
from .reading import Tables, tables

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")
FINE = GridSpec((-5.0, -4.0), 0.05, (160, 200))
COARSE = GridSpec((-5.0, -4.0), 1.0, (8, 10))
RED_ROOM, BLUE_ROOM = (3, 7), (3, 2)
"""Cells with their middles at x, z = (2.5, -0.5) and (-2.5, -0.5)."""


def occupancy() -> OccupancyGrid:
    """Occupancy in which the right room is free, the table in it occupied, and the left room unknown."""
    cells = np.full(FINE.shape, UNKNOWN, np.uint8)
    cells[30:130, 102:180] = FREE  # z from -2.5 to 2.5 m, x from 0.1 to 4 m
    cells[34:50, 152:172] = OCCUPIED
    return OccupancyGrid(cells, FINE)


def cells_memory() -> HomeMemory:
    vectors = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], float)
    rc = np.array([BLUE_ROOM, RED_ROOM, (4, 7)])
    features = map_from_cells(vectors, rc, grid=COARSE, floor_y=0.0, encoder="e", weights=np.array([1.0, 9.0, 3.0]))
    return HomeMemory((StoreyMemory(occupancy(), features),), "world", 12)


def objects_memory() -> HomeMemory:
    points = np.array([[2.6, 0.0, -2.3], [3.6, 0.75, -1.5]], np.float32)
    table = ObjectInstance(points, np.array([1, 0, 0, 0], np.float32), "a red table " + "very " * 10 + "low", 4.0)
    bed = ObjectInstance(points - [6, 0, 0], np.array([0, 1, 0, 0], np.float32), "", 1.0)
    return HomeMemory((StoreyMemory(occupancy(), ObjectMap((table, bed), 0.0, "e", 4, (0.0, 0.0), 0.1)),), "world", 7)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory, home: Scene) -> Tables:
    out = tmp_path_factory.mktemp("map") / "map.rrd"
    return tables(record_memory(cells_memory(), name="box map", out=out, scene=home, with_pixels=False))


def picture(found: Tables, layer: str, *, of: str = "box\\ map", storey: int = 0) -> np.ndarray:
    blob = found[(f"/memory/{of}/map/storey_{storey}/{layer}", True)]["EncodedImage:blob"][0][0]
    return np.asarray(Image.open(io.BytesIO(bytes(blob))).convert("RGBA"))


def test_a_grid_map_has_four_layers_and_its_features_lie_on_the_floor_of_the_home(found: Tables, home: Scene) -> None:
    ours = {entity for entity, _ in found if entity.startswith("/memory/")}
    base = "/memory/box\\ map"
    layers = ("coverage", "occupancy", "features", "evidence")
    assert ours == {f"{base}/map/storey_0/{layer}" for layer in layers} | {f"{base}/home/storey_0/features"}
    assert len({picture(found, layer).shape for layer in layers}) == 1
    assert not [entity for entity, _ in found if entity.startswith("/goal")]
    shown = picture(found, "occupancy")
    assert (shown[..., 3] > 0).any(axis=0).nonzero()[0][0] > shown.shape[1] / 2 - 2, "the left room is unknown"
    brown = (shown[..., :3] == (176, 96, 60)).all(axis=-1)
    assert brown.sum() == pytest.approx(16 * 20, abs=40), "the table is 0.8 m x 1 m"


def test_different_vectors_have_different_colours_and_cells_with_more_evidence_are_brighter(found: Tables) -> None:
    colours = found[("/memory/box\\ map/home/storey_0/features", True)]["Mesh3D:vertex_colors"][0]
    points = np.array(found[("/memory/box\\ map/home/storey_0/features", True)]["Mesh3D:vertex_positions"][0])
    assert len(set(colours)) == 3
    assert points.shape == (12, 3)
    assert {tuple(p) for p in points[:4, [0, 2]].tolist()} == {(-3, -1), (-2, -1), (-2, 0), (-3, 0)}
    shown = picture(found, "evidence")
    assert (shown[..., :3] == (253, 231, 37)).all(axis=-1).any(), "the cell of weight 9"
    assert (shown[..., :3] == (68, 1, 84)).all(axis=-1).any(), "the cell of weight 1"


def test_objects_are_boxes_with_captions(tmp_path: Path, home: Scene) -> None:
    read = tables(record_memory(objects_memory(), name="m", out=tmp_path / "o.rrd", scene=home, with_pixels=False))
    boxes = read[("/memory/m/home/storey_0/objects", True)]
    labels = boxes["Boxes3D:labels"][0]
    assert labels[1] == "(no caption)"
    assert labels[0].startswith("a red table")
    assert len(labels[0]) == 40
    assert np.array(boxes["Boxes3D:half_sizes"][0])[0] == pytest.approx([0.5, 0.375, 0.4])
    assert len(read[("/memory/m/home/storey_0/objects/points", True)]["Points3D:positions"][0]) == 4
    flat = np.array(read[("/memory/m/map/storey_0/objects", True)]["Boxes2D:half_sizes"][0])
    assert flat == pytest.approx(np.array([[10.0, 8.0]] * 2), abs=1e-4)


def test_the_map_of_a_robot_is_shown_without_a_home(tmp_path: Path, home: Scene) -> None:
    memory = replace(cells_memory(), frame="robot, turned y-up")
    out = record_memory(memory, name="lab", out=tmp_path / "lab.rrd", scene=None, with_pixels=False)
    read = tables(out)
    assert ("/scene/topdown/storey_0", True) in read
    assert not [entity for entity, _ in read if entity.startswith("/scene/mesh")]
    (shown,) = storeys_of_memory(memory)
    assert shown.grid.shape == (100 + 20, 78 + 20), "0.5 m around the known area"
    with pytest.raises(RecordingError, match="is in frame 'robot, turned y-up'; expected 'world'"):
        record_memory(memory, name="lab", out=tmp_path / "x.rrd", scene=home, with_pixels=False)


def test_maps_of_scans_need_permission_empty_maps_are_refused_and_missing_storeys_left_out(
    tmp_path: Path, home: Scene
) -> None:
    scan = replace(home, kind="scan")
    with pytest.raises(RecordingError, match="--with-pixels"):
        record_memory(cells_memory(), name="m", out=tmp_path / "x.rrd", scene=scan, with_pixels=False)
    with pytest.raises(RecordingError, match="without storeys"):
        record_memory(HomeMemory((), "world", 0), name="m", out=tmp_path / "x.rrd", scene=None, with_pixels=False)
    (storey,) = cells_memory().storeys
    upstairs = replace(storey, memory=replace(storey.memory, floor_y=3.0))
    memory = HomeMemory((storey, upstairs), "world", 3)
    out = record_memory(memory, name="m", out=tmp_path / "two.rrd", scene=home, with_pixels=False)
    assert {entity.split("/")[4] for entity, _ in tables(out) if entity.startswith("/memory/m/map/")} == {"storey_0"}


def test_both_storeys_of_a_map_are_shown_on_their_own_floors(tmp_path: Path, home: Scene) -> None:
    (below,) = cells_memory().storeys
    left = replace(below.occupancy, cells=below.occupancy.cells[:, ::-1].copy())
    above = StoreyMemory(left, replace(below.memory, floor_y=3.0))
    out = tmp_path / "two.rrd"
    record_memory(HomeMemory((below, above), "world", 3), name="m", out=out, scene=two_floors(home), with_pixels=False)
    read = tables(out)
    layers = ("coverage", "occupancy", "features", "evidence")
    ours = {entity for entity, _ in read if entity.startswith("/memory/m/map/")}
    assert ours == {f"/memory/m/map/storey_{number}/{layer}" for number in (0, 1) for layer in layers}
    for number, (height, is_known_right) in enumerate([(0.0, True), (3.0, False)]):
        squares = np.array(read[(f"/memory/m/home/storey_{number}/features", True)]["Mesh3D:vertex_positions"][0])
        assert squares[:, 1] == pytest.approx(height, abs=0.2)
        shown = picture(read, "occupancy", of="m", storey=number)[..., 3] > 0
        half = shown.shape[1] // 2
        assert (shown[:, half:].sum() > shown[:, :half].sum()) == is_known_right
    alone = record_memory(
        HomeMemory((below, above), "world", 3), name="m", out=tmp_path / "a.rrd", scene=None, with_pixels=False
    )
    assert {entity for entity, _ in tables(alone) if entity.startswith("/memory/m/map/")} == ours


def two_floors(home: Scene) -> Scene:
    """The box house with its floor twice, 3 m apart."""
    return replace(home, navigation=level_floors((100, 160), 0.0, 3.0, corner=(-4.0, -2.5)))


def test_colours_are_the_same_for_the_same_map_and_grey_if_all_vectors_are_equal() -> None:
    rows = np.random.default_rng(0).normal(size=(40, 16)).astype(np.float32)
    first, second = vector_rgb([rows[:30], rows[30:]])
    assert len(first) == 30
    assert len(second) == 10
    assert (vector_rgb([rows])[0] == np.concatenate([first, second])).all()
    assert (vector_rgb([np.ones((3, 16), np.float32)])[0] == GREY).all()
    assert vector_rgb([]) == []
    assert vector_rgb([rows[:0]])[0].shape == (0, 3)


def test_the_text_counts_floor_and_cells() -> None:
    text = memory_markdown("m", cells_memory())
    assert "of 12 views, frame world" in text
    free = (100 * 78 - 16 * 20) * 0.05**2
    assert f"| 0.00 m | {free:.1f} | 0.8 | 3 cells of 1 m | e |" in text
