"""Invented episodes: they load, keep every rule of their split, and are the same for the same seed."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from personal_viz.commands.homes import invent
from sim.episodes.captions import (
    OwnedItem,
    are_mixed_up,
    caption_of,
    ownership_sentence,
    queries_for,
    with_article,
    write_description,
)
from sim.episodes.dataset import PersonalDataset
from sim.episodes.generation import CATEGORIES, EPISODES_PER_SPLIT, dataset_files, invent_dataset
from sim.episodes.ownership import ownership_graph
from sim.episodes.people import NAMES, Edge, broken_rule, draw_ownership
from sim.episodes.schema import Episode
from sim.episodes.validate import validate_dataset
from sim.errors import DatasetError
from sim.scenes.invent import invent_plan
from sim.scenes.plan import load_plan
from sim.scenes.sources import open_scene
from sim.types import SPLITS, Split

WINDOWS: dict[Split, tuple[float, float]] = {"easy": (2, 4), "medium": (3, 7), "hard": (3, 11)}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("invented")
    invent_dataset(root, name="DemoA", seed=0)
    invent_dataset(root, name="DemoB", seed=1)
    return root


@pytest.fixture(scope="module")
def episodes(root: Path) -> list[Episode]:
    return list(PersonalDataset(root).episodes())


def test_a_validator_finds_no_error_and_no_defect(root: Path) -> None:
    report = validate_dataset(root)
    assert report.problems == ()
    found = [(c.row, m.slug) for c in report.checks if c.level != "note" for m in (c.measure, *c.also) if m.count]
    assert found == []


def test_every_split_has_its_episodes_on_both_storeys(episodes: list[Episode]) -> None:
    assert len(episodes) == 2 * 3 * EPISODES_PER_SPLIT
    for split in SPLITS:
        assert {e.record.floor_id for e in episodes if e.key.split == split} == {"0", "1"}


def test_starts_are_in_the_splits_window_and_on_the_targets_storey(root: Path, episodes: list[Episode]) -> None:
    scene = open_scene(PersonalDataset(root), "DemoA")
    for episode in (e for e in episodes if e.key.scene == "DemoA"):
        target = episode.targets[0]
        first = np.array([target.view_points[0].agent_state.position])
        walked = scene.navigation.distances(np.array([episode.start.position]), first)[0]
        assert walked == pytest.approx(episode.record.info.geodesic_distance)
        low, high = WINDOWS[episode.key.split]
        assert low <= walked <= high
        assert abs(episode.start.position[1] - target.floor_y) < 0.1
    yaws = np.array([episode.start.yaw for episode in episodes])
    assert np.histogram(yaws, bins=4, range=(-np.pi, np.pi))[0].min() > 0


def test_view_points_are_near_face_the_object_and_stand_on_the_floor(root: Path) -> None:
    dataset = PersonalDataset(root)
    scene = open_scene(dataset, "DemoB")
    plan = load_plan(root / "scenes" / "DemoB.plan.json")
    goals = dataset.goals("DemoB")
    assert len(goals) >= 0.9 * len(plan.furniture)
    for goal in goals.values():
        for point in goal.view_points:
            x, _, z = point.agent_state.position
            assert np.hypot(x - goal.position[0], z - goal.position[2]) <= 1.5 + 1e-6
            assert scene.navigation.is_navigable(np.array(point.agent_state.position), max_dy=0.05)
            assert point.iou is not None
            assert 0 < point.iou <= 1


def test_ownership_keeps_the_rule_of_the_split(episodes: list[Episode]) -> None:
    for episode in episodes:
        graph = ownership_graph(episode)
        shared, several = max(graph.num_owners_of.values()) > 1, max(graph.num_objects_of.values()) > 1
        expected = {"easy": (False, False), "medium": (False, True), "hard": (True, True)}[episode.key.split]
        assert (shared, several) == expected, episode.key


def test_the_paragraph_holds_every_edge_the_room_and_the_floor(episodes: list[Episode]) -> None:
    for episode in episodes:
        text = episode.record.summary
        assert re.search(r"\b(ground|first) floor\b", text), text
        for edge in ownership_graph(episode).edges:
            assert re.search(rf"\b{edge.owner}\b", text)
            assert re.sub(r"^an? ", "", edge.phrase) in text
            assert edge.room is not None
            assert edge.room in text


def test_paragraphs_differ_in_syntax(episodes: list[Episode]) -> None:
    openings = {" ".join(episode.record.summary.split()[:4]) for episode in episodes}
    assert len(openings) >= 3


def test_queries_are_the_six_of_the_release() -> None:
    assert queries_for("Ada", "coffee table") == (
        "Find Ada's coffee table",
        "Where is Ada's coffee table?",
        "Locate Ada's coffee table",
        "Retrieve Ada's coffee table position",
        "Identify the position of Ada's coffee table",
        "Give me the coordinates of Ada's coffee table",
    )


def test_the_same_seed_gives_the_same_bytes(root: Path) -> None:
    again = dataset_files("DemoA", seed=0)
    assert {path: (root / path).read_bytes() for path in again} == again
    assert again["easy/content/DemoA.json.gz"] != (root / "easy/content/DemoB.json.gz").read_bytes()


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "medium").write_text("a file where a folder must be")
    with pytest.raises(DatasetError, match="cannot be written"):
        invent_dataset(tmp_path, name="Demo", seed=0)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["medium"]


@pytest.mark.parametrize("split", SPLITS)
def test_drawn_graphs_keep_the_rule_for_many_seeds(split: Split) -> None:
    conflicts = np.eye(12, dtype=bool)
    conflicts[0, 1] = conflicts[1, 0] = True
    for seed in range(60):
        edges = draw_ownership(split, conflicts, rng=np.random.default_rng(seed))
        assert broken_rule(split, edges) is None
        assert {edge.item for edge in edges} == set(range(max(edge.item for edge in edges) + 1))
        assert {edge.person for edge in edges} == set(range(max(edge.person for edge in edges) + 1))
        owned = [{edge.item for edge in edges if edge.person == person} for person in range(8)]
        assert not any({0, 1} <= items for items in owned)


@pytest.mark.parametrize(
    ("split", "edges", "wanted"),
    [
        ("easy", [Edge(0, 0), Edge(1, 0)], "an object has several owners"),
        ("easy", [Edge(0, 0), Edge(0, 1)], "somebody owns several objects"),
        ("medium", [Edge(0, 0), Edge(1, 1)], "nobody owns several objects"),
        ("hard", [Edge(0, 0), Edge(0, 1)], "no object has several owners"),
        ("hard", [Edge(0, 0), Edge(1, 0)], "nobody owns several objects"),
        ("medium", [Edge(0, k) for k in range(4)], "somebody owns more than 3 objects"),
        ("easy", [Edge(0, 0), Edge(0, 0)], "an edge stands twice"),
        ("hard", [Edge(0, 0), Edge(0, 1), Edge(1, 1)], None),
    ],
)
def test_broken_rules_are_named(split: Split, edges: list[Edge], wanted: str | None) -> None:
    assert broken_rule(split, edges) == wanted


@pytest.mark.parametrize("split", SPLITS)
def test_a_graph_that_cannot_be_drawn_is_an_error(split: Split) -> None:
    with pytest.raises(DatasetError, match=f"found no graph for split '{split}' over 2 objects"):
        draw_ownership(split, np.zeros((2, 2), bool), rng=np.random.default_rng(0))
    if split != "easy":  # all objects of one category: nobody may own two
        with pytest.raises(DatasetError, match="found no graph"):
            draw_ownership(split, np.ones((8, 8), bool), rng=np.random.default_rng(0))


def test_captions_say_what_a_thing_stands_on_or_beside() -> None:
    plan = invent_plan("Demo", seed=0)
    captions = {piece.name: caption_of(piece, plan) for piece in plan.furniture}
    lamp = next(piece for piece in plan.furniture if piece.category == "table lamp")
    assert re.fullmatch(r"\w+ paper table lamp on the .+", captions[lamp.name])
    assert len(set(captions.values())) == len(captions)
    assert not any(" in " in caption or "." in caption for caption in captions.values())
    assert min(len(caption.split()) for caption in captions.values()) >= 4


def test_words() -> None:
    assert with_article("oak desk") == "an oak desk"
    assert with_article("green armchair") == "a green armchair"
    assert ownership_sentence("Ada", "oak desk", "study") == "Ada owns an oak desk in the study"
    assert are_mixed_up("chair", "desk chair")
    assert are_mixed_up("bed", "bed")
    assert not are_mixed_up("chair", "armchair")
    assert not are_mixed_up("table", "tv stand")


def test_a_description_joins_several_owners() -> None:
    items = [OwnedItem("oak desk", "study", ("Ada", "Bo", "Cy")), OwnedItem("red lamp", "study", ("Bo",))]
    for seed in range(12):
        text = write_description(items, floor="ground floor", rng=np.random.default_rng(seed))
        assert "Ada, Bo and Cy" in text
        assert "ground floor" in text
        assert "study" in text


def test_no_name_begins_another_or_is_a_word_of_an_object() -> None:
    assert not any(a != b and b.startswith(a) for a, b in itertools.product(NAMES, NAMES))
    assert not {name.lower() for name in NAMES} & {word for category in CATEGORIES for word in category.split()}


def test_the_invent_verb_writes_whole_homes_and_says_what_is_next(tmp_path: Path, capsys) -> None:
    assert invent(homes=1, seed=7, out=tmp_path / "homes") == 0
    names = sorted(str(path.relative_to(tmp_path / "homes")) for path in (tmp_path / "homes").rglob("*.*"))
    assert names == [
        "easy/content/Invented7.json.gz",
        "easy/easy.json.gz",
        "hard/content/Invented7.json.gz",
        "hard/hard.json.gz",
        "medium/content/Invented7.json.gz",
        "medium/medium.json.gz",
        "scenes/Invented7.glb",
        "scenes/Invented7.plan.json",
    ]
    assert "personal-viz validate --dataset" in capsys.readouterr().out
    with pytest.raises(DatasetError, match="homes is 0; expected at least 1"):
        invent(homes=0, seed=7, out=tmp_path / "none")
    assert not (tmp_path / "none").exists()
