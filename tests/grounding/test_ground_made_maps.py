"""`ground --map PATH`: map files give their layout and cells, and options for making maps are refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.by_name import make_encoder
from grounding.evaluation.settings import GroundSettings
from grounding.maps.files import MapSource, save_memory
from grounding.maps.home_map import HomeMemory, ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory
from grounding.maps.oracle_map import oracle_home
from grounding.types import map_from_cells
from personal_viz.cli.grounding.ground import Ground
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, RunFileError
from sim.tasks.run_files import read_run
from sim.types import GridSpec

FLOOR = OccupancyGrid(np.ones((4, 4), np.uint8), GridSpec((0.0, 0.0), 0.05, (4, 4)))
SPACE = "hashed+oracle-perception"


def write_map(folder: Path, root: Path, scene: str, *, cell: float | None) -> None:
    """Writes a grid map of all objects of a home on one storey, with cells of `cell` metres; None = an object map."""
    home, encoder = oracle_home(PersonalDataset(root), scene), make_encoder(SPACE)
    rows = encoder.encode_texts([item.text for item in home.objects])
    places = np.array([item.position for item in home.objects])
    if cell is None:
        things = [
            ObjectInstance(np.array([place], np.float32), row, item.text, 1.0)
            for place, row, item in zip(places, rows, home.objects, strict=True)
        ]
        memory = ObjectMap(tuple(things), 0.0, encoder.name, encoder.dim, (0.0, 0.0), 0.1)
    else:
        grid = GridSpec((-20.0, -20.0), cell, (round(40 / cell), round(40 / cell)))
        memory = map_from_cells(
            rows.astype(np.float64), grid.rc_from_xz(places[:, [0, 2]]), grid=grid, floor_y=0.0, encoder=encoder.name
        )
    source = MapSource(scene=scene, kind="schematic")
    save_memory(folder / f"{scene}.npz", HomeMemory((StoreyMemory(FLOOR, memory),), "world", 5), source)


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory, small_root: Path) -> Path:
    """Folders with a map of HomeTwo each: grid, fine, half (cells of 0.5 m) and objects."""
    root = tmp_path_factory.mktemp("maps")
    for name, cell in (("grid", 1.0), ("fine", 0.25), ("half", 0.5), ("objects", None)):
        write_map(root / name, small_root, "HomeTwo", cell=cell)
    return root


def call(small_root: Path, maps: Path, out: Path, **options) -> int:
    settings = {"method": "qs", "scene": ("HomeTwo",), "json": True, **options}
    return Ground(dataset=small_root, map=str(maps), out=out, **settings).run()


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *{"view_noise": 0.3, "object_noise": 0.3, "confusion": 0.1, "background": True, "paraphrase": 2}.items(),
        *{"clutter": 1, "features": "images", "blur": 0.5}.items(),
        *(("sweep", sweep) for sweep in ("view-noise=0,0.3", "object-noise=0,0.3", "paraphrase=0,1,2")),
    ],
)
def test_options_for_making_maps_are_refused_with_map_files(
    option: str, value: object, small_root: Path, maps: Path, tmp_path: Path
) -> None:
    name = f"{value}".partition("=")[0] if option == "sweep" else option.replace("_", "-")
    with pytest.raises(AgentError, match=rf"--{name} is .* with --map PATH, whose maps are made; expected it with"):
        call(small_root, maps / "grid", tmp_path / "runs", **{option: value})
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("name", "method"), [("grid", "qs"), ("fine", "dual"), ("objects", "object-phrase")])
def test_the_layout_comes_from_the_files(name: str, method: str, small_root: Path, maps: Path, tmp_path: Path) -> None:
    assert call(small_root, maps / name, tmp_path, method=method, run_id="run") == 0
    run = read_run(tmp_path / "run")
    assert run.info.config["layout"] == name
    assert "cell" not in run.info.config
    assert len(run.answers) == 6


def test_an_unusual_cell_size_is_shown_and_maps_of_different_cells_cannot_share_a_run(
    small_root: Path, maps: Path, tmp_path: Path, capsys
) -> None:
    assert call(small_root, maps / "half", tmp_path) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["config"]["cell"] == 0.5
    expected = "files map, hashed+oracle-perception encoder, cells of 0.5 m, phrases none, storey given"
    assert found["condition"] == expected
    assert found["encoder"] == SPACE
    write_map(tmp_path / "maps", small_root, "HomeOne", cell=None)
    write_map(tmp_path / "maps", small_root, "HomeTwo", cell=1.0)
    with pytest.raises(RunFileError, match=r"HomeTwo\.npz: has cells of 1 m, HomeOne\.npz has objects; expected the"):
        call(small_root, tmp_path / "maps", tmp_path / "runs", scene=())


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("grid", {"method": "object-dual"}, r"grid: holds grid maps with --method object-dual; expected maps of obj"),
        ("objects", {}, r"objects: holds maps of objects with --method qs; expected grid maps\. Give another"),
        ("grid", {"layout": "fine"}, r"--layout is 'fine' with --map .*grid; expected 'grid', as its files say"),
    ],
)
def test_a_layout_that_differs_from_the_files_is_refused(
    name: str, options: dict, message: str, small_root: Path, maps: Path, tmp_path: Path
) -> None:
    with pytest.raises(AgentError, match=message):
        call(small_root, maps / name, tmp_path / "runs", **options)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"encoder": "clip:a/b", "view_noise": 0.1}, r"--view-noise is 0.1 with --encoder clip:a/b; expected it"),
        ({"encoder": "clip:a/b", "paraphrase": 2}, r"--paraphrase is 2 with --encoder clip:a/b"),
        ({"autocast": "bfloat16"}, r"--autocast is 'bfloat16' with --encoder hashed; expected it with a model"),
    ],
)
def test_options_that_the_encoder_does_not_have_are_refused(options: dict, message: str) -> None:
    with pytest.raises(AgentError, match=message):
        GroundSettings("qs", map="explore", **options)


def test_features_of_whole_pictures_are_refused_except_on_explored_grid_maps() -> None:
    with pytest.raises(AgentError, match=r"--features is 'images' with --map oracle"):
        GroundSettings("qs", features="images")
    with pytest.raises(AgentError, match=r"--features is 'images' with --layout objects"):
        GroundSettings("object-dual", map="explore", layout="objects", features="images")
    assert GroundSettings("qs", map="explore", features="images").features == "images"
