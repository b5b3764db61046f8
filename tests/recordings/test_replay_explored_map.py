"""Answers on the map of an explored home, replayed: the map, the layers, the click, and the goal only at the end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.by_name import make_encoder
from grounding.evaluation.evaluate import SceneGrounder
from grounding.evaluation.home_maps import MapFolders
from grounding.evaluation.settings import GroundSettings
from grounding.maps.files import MapSource, save_memory
from grounding.maps.home_map import HomeMemory, ObjectInstance, ObjectMap, OccupancyGrid, StoreyMemory
from grounding.maps.oracle_map import objects_map, oracle_home
from grounding.methods.by_name import GrounderName
from grounding.types import FeatureMap
from recordings.layers import reground
from recordings.traces import select_traces
from sim.episodes.dataset import PersonalDataset
from sim.mesh import Scene
from sim.tasks.observers import FREE, UNKNOWN
from sim.tasks.run_files import Answer, ClickRay, Run
from sim.types import EpisodeKey, GridSpec

from ..sim.grids import level_floors
from .conftest import info
from .reading import Tables, record

KEY = EpisodeKey("easy", "HomeOne", "0")
MAPS = "map-hashed-invented/maps"
MAP = "/memory/map-hashed-invented/map/storey_0"
pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


@pytest.fixture(scope="module")
def dataset(small_root: Path) -> PersonalDataset:
    """Two homes; the target of episode 0 in HomeOne is a table at x, z = (2.25, 7.75)."""
    return PersonalDataset(small_root)


@pytest.fixture(scope="module")
def scene(home: Scene) -> Scene:
    """The ground floor of HomeOne, 12 m x 10 m of free floor, with the mesh of the box house."""
    return Scene("HomeOne", "invented", home.mesh, (), level_floors((200, 240), 0.0), "d" * 64)


ALL_FREE = np.full((200, 240), FREE, np.uint8)


def save_map(
    folder: Path, *memories: FeatureMap | ObjectMap, num_frames: int = 40, cells: np.ndarray = ALL_FREE
) -> None:
    """Writes a map of HomeOne with these storeys into a folder of runs."""
    occupancy = OccupancyGrid(cells, GridSpec((0.0, 0.0), 0.05, (200, 240)))
    home = HomeMemory(tuple(StoreyMemory(occupancy, memory) for memory in memories), "world", num_frames)
    save_memory(folder / MAPS / "HomeOne.npz", home, MapSource(scene="HomeOne", kind="invented", digest="d" * 64))


def oracle_map(dataset: PersonalDataset, floor_id: str) -> FeatureMap:
    return objects_map(oracle_home(dataset, "HomeOne"), make_encoder(settings("rpg").map_encoder), floor_id=floor_id)


@pytest.fixture(scope="module")
def runs_folder(tmp_path_factory: pytest.TempPathFactory, dataset: PersonalDataset) -> Path:
    """A folder of runs with a map of HomeOne: cells hold texts, and the right half of the floor is free."""
    out = tmp_path_factory.mktemp("runs")
    cells = np.where(np.arange(240) < 120, np.uint8(UNKNOWN), ALL_FREE)
    save_map(out, oracle_map(dataset, "0"), cells=cells)
    return out


def settings(method: GrounderName) -> GroundSettings:
    return GroundSettings(method, map="explore")


def answered(dataset: PersonalDataset, folder: Path, method: GrounderName, *, key: EpisodeKey = KEY) -> Run:
    """The run that `personal-viz ground --map explore` makes of the episode."""
    chosen = settings(method)
    grounder = SceneGrounder(dataset, KEY.scene, chosen, folders=MapFolders(folder / MAPS, folder))
    config = chosen.config | {"maps": MAPS, "frame": "non-empty cells"}
    config["phrases"] = "dataset" if method == "rpg" else "none"
    changes = {"who": method, "scene_kind": "invented", "seed": 0, "config": config}
    return Run(info=info(f"ground-{method}", **changes), answers=(grounder.answer(dataset.episode(key)),))


def click() -> Run:
    """The run of a person who marks the sofa."""
    ray = ClickRay(
        origin=(5.5, 3.0, 5.0),
        direction=(0.0, -0.7, 0.7),
        camera_position=(5.5, 6.0, 4.0),
        camera_wxyz=(1.0, 0.0, 0.0, 0.0),
        storey_y=0.0,
    )
    answer = Answer(**KEY._asdict(), candidates=((5.5, 0.4, 7.5),), participant="P01", ray=ray, t_s=8.5)
    return Run(info=info("study", who="human", who_kind="human"), answers=(answer,))


@pytest.fixture(scope="module")
def found(
    tmp_path_factory: pytest.TempPathFactory, dataset: PersonalDataset, scene: Scene, runs_folder: Path
) -> Tables:
    runs = [answered(dataset, runs_folder, "rpg"), answered(dataset, runs_folder, "qs"), click()]
    out = tmp_path_factory.mktemp("rrd") / "pog.rrd"
    return record(out, runs, dataset.episode(KEY), scene, dataset=dataset, beside=[runs_folder])


def test_the_map_of_the_answers_is_recorded_once_and_shown_at_all_times(found: Tables) -> None:
    ours = {(entity, is_static) for entity, is_static in found if entity.startswith("/memory/")}
    layers = ("coverage", "occupancy", "features", "evidence")
    assert ours == {(f"{MAP}/{layer}", True) for layer in layers} | {
        ("/memory/map-hashed-invented/home/storey_0/features", True)
    }
    assert len(found[(f"{MAP}/features", True)]["EncodedImage:blob"]) == 1
    text = found[("/task", True)]["TextDocument:text"][-1][0]
    assert "**Map map-hashed-invented** of 40 views, frame world." in text


def test_similarity_gate_and_answers_share_one_map_and_the_goal_comes_after_them(found: Tables) -> None:
    rpg = {entity.rsplit("/", 1)[1] for entity, _ in found if "/ground-rpg/map/storey_0/layers/" in entity}
    assert {"similarity_0", "similarity_4", "peaks_0", "gate", "final"} <= rpg
    for entity in ("/runs/ground-rpg/map/storey_0/layers/gate", "/runs/ground-rpg/map/storey_0/candidates"):
        assert found[(entity, False)]["step"] == [1]
    assert found[("/runs/study-P01/map/storey_0/click_ray", False)]["step"] == [1]
    best = found[("/runs/ground-rpg/candidates", False)]["Points3D:positions"][0][0]
    assert best == pytest.approx([2.5, 0.0, 7.5])
    goal = {entity: columns for (entity, _), columns in found.items() if entity.startswith("/goal")}
    assert len(goal) >= 4
    assert not [entity for entity, is_static in found if is_static and entity.startswith("/goal")]
    assert {step for columns in goal.values() for step in columns["step"]} == {2}
    others = [c["step"] for (e, is_static), c in found.items() if not is_static and e.startswith("/runs")]
    assert max(step for steps in others for step in steps) == 1


def test_an_answer_upstairs_lies_on_the_upper_storey_of_a_map_of_two(
    tmp_path: Path, dataset: PersonalDataset, scene: Scene
) -> None:
    save_map(tmp_path, oracle_map(dataset, "0"), oracle_map(dataset, "1"))
    tall = replace(scene, navigation=level_floors((200, 240), 0.0, 3.0))
    bed = EpisodeKey("easy", "HomeOne", "3")
    run = answered(dataset, tmp_path, "rpg", key=bed)
    read = record(tmp_path / "a.rrd", [run], dataset.episode(bed), tall, dataset=dataset, beside=[tmp_path])
    ours = {entity for entity, _ in read if entity.startswith("/memory/")}
    upper = {entity.replace("storey_0", "storey_1") for entity in (f"{MAP}/features", f"{MAP}/occupancy")}
    assert upper < ours
    assert not [entity for entity in ours if "storey_0" in entity], "the episode is upstairs only"
    assert ("/runs/ground-rpg/map/storey_1/layers/final", False) in read
    best = read[("/runs/ground-rpg/candidates", False)]["Points3D:positions"][0][0]
    assert best == pytest.approx([2.5, 3.0, 7.5])


def test_a_missing_map_is_reported_and_not_made_again(
    tmp_path: Path, dataset: PersonalDataset, scene: Scene, runs_folder: Path
) -> None:
    run = answered(dataset, runs_folder, "rpg")
    read = record(tmp_path / "a.rrd", [run], dataset.episode(KEY), scene, dataset=dataset, beside=[tmp_path])
    assert not [entity for entity, _ in read if entity.startswith("/memory")]
    text = read[("/task", True)]["TextDocument:text"][-1][0]
    assert "No layers of rpg: it cannot be asked again: its map of HomeOne is no longer beside its run folder." in text
    assert {path.name for path in tmp_path.iterdir()} == {"a.rrd"}


def test_maps_of_scans_are_left_out_without_permission(
    tmp_path: Path, dataset: PersonalDataset, scene: Scene, runs_folder: Path
) -> None:
    run = answered(dataset, runs_folder, "rpg")
    on_scan = run.model_copy(update={"info": run.info.model_copy(update={"scene_kind": "scan"})})
    scan = replace(scene, kind="scan")
    out = tmp_path / "a.rrd"
    read = record(out, [on_scan], dataset.episode(KEY), scan, dataset=dataset, beside=[runs_folder])
    assert not [entity for entity, _ in read if entity.startswith(("/memory", "/scene")) or "/layers/" in entity]
    assert ("/runs/ground-rpg/candidates", False) in read


def test_an_object_map_has_a_coloured_box_per_object_and_phrase(
    tmp_path: Path, dataset: PersonalDataset, scene: Scene
) -> None:
    chosen = GroundSettings("object-phrase", map="explore", layout="objects")
    encoder = make_encoder(chosen.map_encoder)
    known = [item for item in oracle_home(dataset, "HomeOne").objects if item.floor_id == "0"]
    features = encoder.encode_texts([item.text for item in known])
    corners = np.array([[-0.5, -0.25, -0.5], [0.5, 0.25, 0.5]], np.float32)
    things = tuple(
        ObjectInstance(np.array(item.position, np.float32) + corners, row, item.text, 3.0)
        for item, row in zip(known, features, strict=True)
    )
    save_map(tmp_path, ObjectMap(things, 0.0, encoder.name, encoder.dim, (5.0, 5.0), 0.1), num_frames=9)
    grounder = SceneGrounder(dataset, KEY.scene, chosen, folders=MapFolders(tmp_path / MAPS, tmp_path))
    config = chosen.config | {"maps": MAPS}
    changes = {"who": "object-phrase", "scene_kind": "invented", "seed": 0, "config": config}
    run = Run(info=info("ground-objects", **changes), answers=(grounder.answer(dataset.episode(KEY)),))
    out = tmp_path / "a.rrd"
    read = record(out, [run], dataset.episode(KEY), scene, dataset=dataset, beside=[tmp_path])
    layers = read[("/runs/ground-objects/layers/final/storey_0", False)]
    assert layers["step"] == [1]
    assert len(layers["Boxes3D:half_sizes"][0]) == len(things) == 4
    yellow = [index for index, colour in enumerate(layers["Boxes3D:colors"][0]) if colour == 0xFDE725FF]
    assert [known[index].name for index in yellow] == ["table_1"], "the object that Ada's phrase describes"
    flat = read[("/runs/ground-objects/map/storey_0/layers/similarity_0", False)]
    assert np.array(flat["Boxes2D:half_sizes"][0]) == pytest.approx(np.full((4, 2), 10.0), abs=1e-3)
    assert ("/memory/map-hashed-invented/home/storey_0/objects", True) in read


def test_answers_of_people_are_not_grounded_again(dataset: PersonalDataset) -> None:
    assert reground(select_traces([click()], KEY), dataset.episode(KEY), dataset) == []
