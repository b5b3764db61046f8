"""Maps on disk: equal to the last bit when read back; missing, damaged, old and foreign files are refused."""

import io
import json
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.evaluation.home_maps import require_map_of
from grounding.maps.files import MapSource, load_memory, read_map_header, save_memory
from grounding.maps.home_map import HomeMemory, ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory
from grounding.types import map_from_cells
from sim.errors import AgentError, RunFileError
from sim.types import GridSpec

SOURCE = MapSource(scene="Demo", kind="invented", digest="ab12", builder="1 m cells of patches")


def vectors(count: int) -> np.ndarray:
    return np.random.default_rng(count).normal(size=(count, 768)).astype(np.float32)


def occupancy() -> OccupancyGrid:
    return OccupancyGrid(np.arange(48, dtype=np.uint8).reshape(6, 8) % 3, GridSpec((-1.0, 0.1), 0.05, (6, 8)))


def grid_memory(*, encoder: str = "hashed") -> HomeMemory:
    name = HashedWords().name if encoder == "hashed" else encoder
    storeys = []
    for floor_y, count in ((0.1, 3), (2.9, 0), (5.7, 1)):
        cells = np.array([[0, 3], [2, 1], [5, 5]])[:count]
        found = map_from_cells(
            vectors(count),
            cells,
            grid=GridSpec((-2.0, 3.0), 0.25, (6, 8)),
            floor_y=floor_y,
            encoder=name,
            centre_xz=(1 / 3, 0.1),
            weights=np.arange(1, count + 1) / 3,
        )
        storeys.append(StoreyMemory(occupancy(), found))
    return HomeMemory(tuple(storeys), "world", 17)


def object_memory() -> HomeMemory:
    rows = vectors(2) / np.linalg.norm(vectors(2), axis=1, keepdims=True)
    points = np.random.default_rng(1).normal(size=(7, 3)).astype(np.float32)
    objects = (
        ObjectInstance(points[:5], rows[0], "red “café” chair", 3.0),
        ObjectInstance(points[5:], rows[1], "", 1.0),
    )
    maps = [ObjectMap(found, y, "own", 768, (0.1, 0.2), 0.1) for found, y in ((objects, 0.0), ((), 2.8))]
    return HomeMemory(tuple(StoreyMemory(occupancy(), found) for found in maps), "robot, z up", 2)


def assert_same(first: HomeMemory, second: HomeMemory) -> None:
    assert (first.frame, first.num_frames, len(first.storeys)) == (second.frame, second.num_frames, len(second.storeys))
    for one, other in zip(first.storeys, second.storeys, strict=True):
        assert one.occupancy.grid == other.occupancy.grid
        assert one.occupancy.cells.tobytes() == other.occupancy.cells.tobytes()
        assert type(one.memory) is type(other.memory)
        for name in ("floor_y", "encoder", "dim", "centre_xz", "grid", "merge_m"):
            assert getattr(one.memory, name, None) == getattr(other.memory, name, None)
        for name in ("rows", "rc", "cell_y", "weights"):
            before, after = getattr(one.memory, name, np.empty(0)), getattr(other.memory, name, np.empty(0))
            assert (before.dtype, before.shape, before.tobytes()) == (after.dtype, after.shape, after.tobytes())
        pairs = zip(getattr(one.memory, "objects", ()), getattr(other.memory, "objects", ()), strict=True)
        for before, after in pairs:
            assert (before.caption, before.weight) == (after.caption, after.weight)
            assert before.points.tobytes() == after.points.tobytes()
            assert before.feature.tobytes() == after.feature.tobytes()


@pytest.mark.parametrize("memory", [grid_memory(), object_memory()], ids=["grid", "objects"])
def test_a_map_is_equal_to_the_last_bit_when_read_back(memory: HomeMemory, tmp_path: Path) -> None:
    path = tmp_path / "maps" / "Demo.npz"
    save_memory(path, memory, SOURCE)
    assert_same(load_memory(path), memory)
    assert [file.name for file in path.parent.iterdir()] == ["Demo.npz"]
    first = path.read_bytes()
    save_memory(path, load_memory(path), SOURCE)
    assert path.read_bytes() == first


def test_the_header_describes_the_home_the_encoder_and_the_builder(tmp_path: Path) -> None:
    save_memory(tmp_path / "a.npz", grid_memory(), SOURCE)
    header = read_map_header(tmp_path / "a.npz")
    assert header.source == SOURCE
    assert (header.layout, header.encoder, header.dim, header.frame) == ("grid", HashedWords().name, 768, "world")
    assert [storey.floor_y for storey in header.storeys] == [0.1, 2.9, 5.7]
    assert header.storeys[0].grid is not None
    assert header.storeys[0].grid == GridSpec((-2.0, 3.0), 0.25, (6, 8))


def test_queries_of_another_encoder_and_empty_or_mixed_memories_are_refused(tmp_path: Path) -> None:
    save_memory(tmp_path / "own.npz", grid_memory(encoder="hashed"), SOURCE)
    assert load_memory(tmp_path / "own.npz", encoder=HashedWords()).num_frames == 17
    save_memory(tmp_path / "other.npz", grid_memory(encoder="clip"), SOURCE)
    with pytest.raises(AgentError, match=r"other.npz: holds 768-d vectors of encoder 'clip', the query is 768-d from"):
        load_memory(tmp_path / "other.npz", encoder=HashedWords())
    with pytest.raises(RunFileError, match=r"the map has 0 storeys .*; expected at least one storey"):
        save_memory(tmp_path / "a.npz", HomeMemory((), "world", 0), SOURCE)
    mixed = HomeMemory((grid_memory().storeys[0], object_memory().storeys[0]), "world", 0)
    with pytest.raises(RunFileError, match=r"layouts \['grid', 'objects'\]"):
        save_memory(tmp_path / "a.npz", mixed, SOURCE)
    assert {path.name for path in tmp_path.iterdir()} == {"other.npz", "own.npz"}


def rewritten(path: Path, edit) -> None:
    """Rewrites a file with every part passed through `edit(name, data)`; None leaves the part out."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in parts.items():
            changed = edit(name, data)
            if changed is not None:
                archive.writestr(name, changed)


def array_bytes(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def with_array(name: str, array: np.ndarray):
    return lambda part, data: array_bytes(array) if part == f"storey0/{name}.npy" else data


def with_header(value: object, *path: str | int):
    """An edit that puts a value into the header at this path."""

    def rewrite(part: str, data: bytes) -> bytes | str:
        if part != "header.json":
            return data
        header = place = json.loads(data)
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        return json.dumps(header)

    return rewrite


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda part, data: None if part == "header.json" else data, r"holds .* and no header.json; expected a map"),
        (lambda part, data: None if part.endswith("0/rc.npy") else data, r"no storey0/rc.npy; expected a map"),
        (lambda part, data: data[:90] if part.endswith("0/rows.npy") else data, r"storey0/rows is no plain array"),
        (lambda part, data: b"{" if part == "header.json" else data, r"header.json: .*expected: whole JSON"),
        (with_header(0, "schema_version"), r"schema_version is 0; expected 1 to 2. Build the map again"),
        (with_header(9, "schema_version"), r"is 9; expected 1 to 2. It was made by a newer version of .*; update."),
        (with_header(3, "dim"), r"storey0/rows is float32 of shape \(3, 768\); expected float32 of shape \('any', 3\)"),
        (with_header("objects", "layout"), r"header.json: storey0 is without merge_m or captions"),
        (with_header(1, "secret"), r"header.json: secret is 1; expected: Extra inputs"),
        (with_header([], "storeys"), r"header.json: storeys is .*; expected: Tuple should have at least 1 item"),
        (
            with_header(1, "storeys", 0, "grid", "secret"),
            r"header.json: storeys.0.grid.secret is 1; expected: Unexpected keyword argument",
        ),
        (
            with_header([-1.0, 3.0], "storeys", 1, "grid", "origin_xz"),
            r"header.json: storey1 is of another grid than storey0; expected one grid for all storeys",
        ),
        (with_array("rows", vectors(3) * np.nan), r"storey0/rows is with nan or inf in it; expected finite numbers"),
        (with_array("rows", vectors(3)), r"storey0/rows is up to .* off length 1; expected unit vectors"),
        (with_array("rows", vectors(3).astype(float)), r"storey0/rows is float64 of shape"),
        (with_array("rc", np.array([[0, 3], [0, 3], [5, 5]], np.int16)), r"storey0/rc is out of the grid or out of"),
        (with_array("rc", np.array([[0, 3], [2, 1], [5, 8]], np.int16)), r"storey0/rc is out of the grid"),
        (with_array("occupancy", np.full((6, 8), 7, np.uint8)), r"storey0/occupancy is up to 7; expected values 0"),
    ],
)
def test_a_damaged_map_is_refused_with_its_fault(edit, message: str, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    save_memory(path, grid_memory(), SOURCE)
    rewritten(path, edit)
    with pytest.raises(RunFileError, match=message) as caught:
        load_memory(path)
    assert str(path) in str(caught.value)


def test_a_map_of_version_1_is_read(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    save_memory(path, grid_memory(), SOURCE)

    def as_version_1(part: str, data: bytes) -> bytes | str:
        if part != "header.json":
            return data
        header = json.loads(data)
        assert header["schema_version"] == 2
        del header["source"]["encoder"], header["source"]["recording"]
        return json.dumps({**header, "schema_version": 1})

    rewritten(path, as_version_1)
    assert_same(load_memory(path), grid_memory())
    assert read_map_header(path).source == SOURCE
    with zipfile.ZipFile(path) as archive:  # what version 1 wrote
        assert set(json.loads(archive.read("header.json"))["source"]) == {"scene", "kind", "digest", "builder"}


def test_pickled_arrays_are_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    save_memory(path, grid_memory(), SOURCE)

    class Bomb:
        def __reduce__(self):
            return (Path.write_text, (tmp_path / "exploded", "boom"))

    bombs = np.array([Bomb()], object)
    rewritten(path, with_array("rows", bombs))
    with pytest.raises(RunFileError, match="storey0/rows is no plain array"):
        load_memory(path)
    assert pickle.dumps(bombs)
    assert not (tmp_path / "exploded").exists()


def test_missing_truncated_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match=r"none.npz: found no file; expected a map .* Check the path"):
        load_memory(tmp_path / "none.npz")
    foreign = tmp_path / "foreign.npz"
    np.savez(foreign, features=np.zeros(3))
    with pytest.raises(RunFileError, match=r"holds \['features.npy'\] and no header.json; expected a map written by"):
        load_memory(foreign)
    cut = tmp_path / "cut.npz"
    save_memory(cut, grid_memory(), SOURCE)
    cut.write_bytes(cut.read_bytes()[:-200])
    with pytest.raises(RunFileError, match=r"cut.npz: is no .npz file .* Build the map again"):
        load_memory(cut)
    flipped = tmp_path / "flipped.npz"
    save_memory(flipped, grid_memory(), SOURCE)
    data = bytearray(flipped.read_bytes())
    data[len(data) // 2] ^= 0xFF
    flipped.write_bytes(bytes(data))
    with pytest.raises(RunFileError, match=r"flipped.npz: storey0/\w+.npy is damaged"):
        load_memory(flipped)
    with pytest.raises(RunFileError, match="cannot be read"):
        load_memory(tmp_path)


@pytest.mark.parametrize(
    ("kind", "advice"),
    [
        ("robot", "Make it again with personal-viz map --scene HomeTwo if it was recorded there"),
        ("invented", "Name it Demo.npz, and put the map of HomeTwo here"),
    ],
)
def test_a_map_of_another_place_says_how_to_put_it_right(kind, advice: str, tmp_path: Path) -> None:
    path = tmp_path / "HomeTwo.npz"
    save_memory(path, grid_memory(), SOURCE.model_copy(update={"kind": kind}))
    require_map_of(path, "Demo")
    with pytest.raises(RunFileError, match=rf"HomeTwo.npz: says that it is of 'Demo'; expected 'HomeTwo', .* {advice}"):
        require_map_of(path, "HomeTwo")
