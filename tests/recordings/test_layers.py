"""The layers of a grounder on a small home with two storeys: their places, and when they are left out."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from grounding.evaluation.evaluate import GroundSettings, SceneGrounder
from grounding.report.asked_again import settings_of
from recordings.layers import outline, reground
from recordings.maps import on_map
from recordings.traces import select_traces
from sim.episodes.dataset import PersonalDataset
from sim.mesh import Scene
from sim.plan_view.storey import StoreyMap
from sim.tasks.run_files import Run
from sim.types import EpisodeKey, GridSpec

from ..sim.grids import level_floors
from .conftest import info
from .reading import Tables, record, tables

KEY = EpisodeKey("easy", "HomeOne", "0")
CONFIG: dict[str, Any] = {"map": "oracle", "encoder": "hashed", "all_storeys": False}
pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


@pytest.fixture(scope="module")
def dataset(small_root: Path) -> PersonalDataset:
    """Two homes; the target of episode 0 in HomeOne is a table at x, z = (2.25, 7.75)."""
    return PersonalDataset(small_root)


@pytest.fixture(scope="module")
def two_storeys(home: Scene) -> Scene:
    """HomeOne as a scan without pictures, with 12 m x 10 m of free floor on both storeys."""
    return Scene("HomeOne", "scan", home.mesh, (), level_floors((200, 240), 0.0, 3.0), "d" * 64)


def grounded(dataset: PersonalDataset, method: Any, **config: object) -> Run:
    """The run that `personal-viz ground` makes of the episode."""
    settings = GroundSettings(method, all_storeys=bool(config.get("all_storeys", False)))
    answer = SceneGrounder(dataset, KEY.scene, settings).answer(dataset.episode(KEY))
    changes = {"who": method, "scene_kind": "oracle-map", "seed": 0, "config": CONFIG | config}
    return Run(info=info(f"ground-{method}", **changes), answers=(answer,))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory, dataset: PersonalDataset, two_storeys: Scene) -> Tables:
    """The answers of RPG, QS and the map centre in one recording."""
    out = tmp_path_factory.mktemp("rrd") / "pog.rrd"
    runs = [grounded(dataset, "rpg"), grounded(dataset, "qs"), grounded(dataset, "center")]
    record(out, runs, dataset.episode(KEY), two_storeys, dataset=dataset)
    return tables(out) | {("blueprint", True): {"views": list(tables(out, kind="blueprints").values())}}


def test_every_layer_is_logged_on_map_and_floor_when_the_answer_appears(found: Tables) -> None:
    layers = {f"{name}_{number}" for name in ("similarity", "peaks") for number in range(5)} | {"gate", "final"}
    on_maps = {e.rsplit("/", 1)[1]: c for (e, _), c in found.items() if "/ground-rpg/map/storey_0/layers/" in e}
    in_home = {e.split("/")[4]: c for (e, _), c in found.items() if e.startswith("/runs/ground-rpg/layers/")}
    assert set(on_maps) == set(in_home) == layers
    assert {tuple(columns["step"]) for columns in (*on_maps.values(), *in_home.values())} == {(1,)}
    assert {e for e, _ in found if "/ground-qs/" in e and "layers" in e} == {
        "/runs/ground-qs/map/storey_0/layers/final",
        "/runs/ground-qs/layers/final/storey_0",
    }
    assert not [e for e, _ in found if "ground-center" in e and "layers" in e]


def test_the_similarity_of_a_phrase_lies_on_the_cells_of_objects(found: Tables) -> None:
    columns = found[("/runs/ground-rpg/map/storey_0/layers/similarity_0", False)]
    picture = np.asarray(Image.open(io.BytesIO(bytes(columns["EncodedImage:blob"][0][0]))).convert("RGBA"))
    assert picture.shape == (200, 240, 4)
    shown = picture[..., 3] > 0
    wanted = np.zeros((200, 240), bool)
    for x, z in ((2, 7), (5, 7), (9, 2)):  # cells of the table, the grey sofa, the yellow sofa with the lamp, metres
        wanted[20 * z : 20 * z + 20, 20 * x : 20 * x + 20] = True
    assert (shown == wanted).all()
    assert tuple(picture[150, 50, :3]) == (253, 231, 37), "the first phrase names the table"


def test_the_layer_on_the_floor_has_a_square_per_cell_facing_up(found: Tables) -> None:
    columns = found[("/runs/ground-rpg/layers/similarity_0/storey_0", False)]
    points = np.array(columns["Mesh3D:vertex_positions"][0])
    faces = np.array(columns["Mesh3D:triangle_indices"][0])
    assert (points.shape, faces.shape) == ((12, 3), (6, 3))
    assert points[:, 1] == pytest.approx(0.075)
    edges = points[faces[:, 1:]] - points[faces[:, :1]]
    assert np.cross(edges[:, 0], edges[:, 1]) == pytest.approx(np.array([[0, 1, 0]] * 6))
    yellow = np.array(columns["Mesh3D:vertex_colors"][0]) == 0xFDE725FF
    assert {tuple(point) for point in points[yellow][:, [0, 2]].tolist()} == {(2, 7), (3, 7), (2, 8), (3, 8)}


def test_each_phrase_has_a_peak_a_line_in_the_document_and_a_view_of_the_map(found: Tables) -> None:
    peaks = found[("/runs/ground-rpg/layers/peaks_0/storey_0", False)]["Points3D:positions"][0]
    assert peaks[0] == pytest.approx([2.5, 0.15, 7.5])
    best = found[("/runs/ground-rpg/candidates", False)]["Points3D:positions"][0][0]
    assert best == pytest.approx([2.5, 0.0, 7.5])
    gate = found[("/runs/ground-rpg/layers/gate/storey_0", False)]["LineStrips3D:strips"][0]
    around = {tuple(point) for piece in gate for point in np.round(np.array(piece)[:, [0, 2]], 3).tolist()}
    assert {(2.0, 7.0), (3.0, 7.0), (2.0, 8.0), (3.0, 8.0)} <= around
    text = found[("/task", True)]["TextDocument:text"][0][0]
    assert "| rpg's phrase | least and most alike |" in text
    assert "| 1. Ada owns a low oak table with a green bowl in the room |" in text
    views = found[("blueprint", True)]["views"]
    names = {row[0] for c in views for row in c.get("ViewBlueprint:display_name", []) if row}
    assert {f"{number}. " for number in range(1, 6)} <= {name[:3] for name in names}
    assert any(name.endswith("...") and len(name) <= 3 + 44 for name in names)
    hidden = [c for c in views if c.get("EntityBehavior:visible") == [[False]]]
    assert len(hidden) == 2 * (5 + 1), "five phrases of rpg and the scores of qs, both on the map and in the home"


def test_a_grounder_that_now_gives_another_answer_shows_no_layers(dataset: PersonalDataset) -> None:
    run = grounded(dataset, "rpg")
    moved = run.answers[0].model_copy(update={"candidates": ((0.5, 0.0, 0.5),)})
    changed = run.model_copy(update={"answers": (moved,)})
    (item,) = reground(select_traces([changed], KEY), dataset.episode(KEY), dataset)
    assert item.layers is None
    assert item.problem == "gives other points now than its run file holds"


def test_a_grounder_of_another_program_is_named_in_the_document(
    tmp_path: Path, dataset: PersonalDataset, two_storeys: Scene
) -> None:
    run = grounded(dataset, "rpg")
    foreign = run.model_copy(update={"info": run.info.model_copy(update={"who": "their_model"})})
    read = record(tmp_path / "a.rrd", [foreign], dataset.episode(KEY), two_storeys, dataset=dataset)
    text = read[("/task", True)]["TextDocument:text"][0][0]
    assert "No layers of their\\_model: it is none of our grounders, so it cannot be asked again." in text


def test_merged_storeys_have_layers_on_each(tmp_path: Path, dataset: PersonalDataset, two_storeys: Scene) -> None:
    run = grounded(dataset, "rpg", all_storeys=True)
    upstairs = run.answers[0].model_copy(update={"candidates": ((6.5, 4.2, 2.5),), "participant": "P01"})
    click = Run(info=info("study", who="human", who_kind="human", scene_kind="scan"), answers=(upstairs,))
    read = record(tmp_path / "a.rrd", [run, click], dataset.episode(KEY), two_storeys, dataset=dataset)
    shown = []
    for storey in ("storey_0", "storey_1"):
        columns = read[(f"/runs/ground-rpg/map/{storey}/layers/similarity_3", False)]
        picture = Image.open(io.BytesIO(bytes(columns["EncodedImage:blob"][0][0]))).convert("RGBA")
        shown.append(int((np.asarray(picture)[..., 3] > 0).sum()) // 400)
    assert shown == [3, 1], "the table and the bed share a cell, which belongs to the lower storey"


@pytest.mark.parametrize("change", [{"map": "camera"}, {"encoder": None}, {"all_storeys": None}])
def test_settings_of_other_programs_are_not_guessed(change: dict[str, Any]) -> None:
    assert settings_of(info("a", who="rpg", seed=3, config=CONFIG)) == GroundSettings("rpg", seed=3)
    assert settings_of(info("a", who="rpg", seed=3, config=CONFIG | change)) is None
    assert settings_of(info("a", who="rpg", config=CONFIG)) is None


def test_values_fill_the_pixels_of_their_cells_and_two_cells_have_an_outline_of_six_sides() -> None:
    grid = GridSpec((-1.0, -1.0), 1.0, (2, 3))
    storey = StoreyMap(0, 0.0, np.ones((4, 8), bool), GridSpec((-0.5, -1.0), 0.5, (4, 8)))
    found = on_map(np.array([[0, 1, 2], [3, 4, 5]], np.float32), grid, storey)
    nan = np.nan
    assert np.array_equal(found[0], [0, 1, 1, 2, 2, nan, nan, nan], equal_nan=True)
    assert np.array_equal(found[3], [3, 4, 4, 5, 5, nan, nan, nan], equal_nan=True)
    inside = np.zeros((3, 3), bool)
    inside[1, 1:] = True
    edges = outline(inside, GridSpec((10.0, 20.0), 2.0, (3, 3)))
    assert edges.shape == (6, 2, 2)
    corners = {tuple(corner) for edge in edges.tolist() for corner in edge}
    assert corners == {(x, z) for x in (12.0, 14.0, 16.0) for z in (22.0, 24.0)}
    assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) == pytest.approx(2.0)
