"""Invented datasets load, keep every rule of their split, and are the same for the same seed."""

import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from personal_viz.cli.invent import Invent
from sim.authoring import generation
from sim.authoring.generation import EPISODES_PER_SPLIT, dataset_files
from sim.episodes.dataset import PersonalDataset
from sim.episodes.ownership import ownership_graph
from sim.episodes.schema import Episode
from sim.episodes.validate import ValidationReport, validate_dataset
from sim.errors import DatasetError, PersonalVizError, SceneError
from sim.homes.open_home import open_scene
from sim.homes.plan import load_plan
from sim.types import SPLITS, Split

WINDOWS: dict[Split, tuple[float, float]] = {"easy": (2, 4), "medium": (3, 7), "hard": (3, 11)}
SEEDS = {"Demo": 1, "Small": 3}
"""Seeds of a home with two storeys and of one with one."""


@pytest.fixture(scope="module")
def root(invented_root: Path) -> Path:
    return invented_root


@pytest.fixture(scope="module")
def episodes(root: Path) -> list[Episode]:
    return list(PersonalDataset(root).episodes())


def found_by(report: ValidationReport) -> list[tuple[int, str]]:
    """All problems (row, slug) except naive plurals, which only mean that a query has several right objects."""
    measures = [
        (check.row, m) for check in report.checks if check.level != "note" for m in (check.measure, *check.also)
    ]
    return [(row, m.slug) for row, m in measures if m.count and m.slug != "query-naive-plural"]


def test_every_split_is_valid_and_asks_for_many_objects_on_every_storey(root: Path, episodes: list[Episode]) -> None:
    report = validate_dataset(root)
    assert report.problems == ()
    assert found_by(report) == []
    assert len(episodes) == 2 * 3 * EPISODES_PER_SPLIT
    for split in SPLITS:
        floors = {(e.key.scene, e.record.floor_id) for e in episodes if e.key.split == split}
        assert floors == {("Demo", "0"), ("Demo", "1"), ("Small", "0")}
    for scene in SEEDS:
        asked = [name for e in episodes if e.key.scene == scene for name in e.record.object_names]
        assert len(set(asked)) >= 0.8 * len(asked)


@pytest.mark.slow
def test_starts_are_in_the_window_of_the_split_and_never_at_the_target(root: Path, episodes: list[Episode]) -> None:
    scene = open_scene(PersonalDataset(root), "Demo")
    for episode in (e for e in episodes if e.key.scene == "Demo"):
        start = np.array(episode.start.position)
        walked = []
        for target in episode.targets:
            first = np.array([target.view_points[0].agent_state.position])
            walked.append(scene.navigation.distances(start[None], first)[0])
            places = np.array([target.position, *(point.agent_state.position for point in target.view_points)])
            assert np.linalg.norm((places - start)[:, [0, 2]], axis=1).min() > 1.0
        low, high = WINDOWS[episode.key.split]
        assert walked[0] == pytest.approx(episode.record.info.geodesic_distance)
        assert walked[0] == min(walked)
        assert low <= walked[0] <= high
        assert abs(start[1] - episode.targets[0].floor_y) < 0.1
    yaws = np.array([episode.start.yaw for episode in episodes])
    assert np.histogram(yaws, bins=4, range=(-np.pi, np.pi))[0].min() > 0


def test_every_piece_is_a_goal_with_view_points_that_see_it(root: Path) -> None:
    dataset = PersonalDataset(root)
    scene = open_scene(dataset, "Small")
    goals = dataset.goals("Small")
    assert set(goals) == {piece.name for piece in load_plan(root / "scenes" / "Small.plan.json").furniture}
    anchor = np.array([next(iter(goals.values())).view_points[0].agent_state.position])
    for goal in goals.values():
        places = np.array([point.agent_state.position for point in goal.view_points])
        assert np.hypot(*(places - goal.position)[:, [0, 2]].T).max() <= 1.5 + 1e-4
        assert np.isfinite(scene.navigation.distances(places, anchor)).all()
        for point in goal.view_points:
            assert scene.navigation.is_navigable(np.array(point.agent_state.position), max_dy=0.05)
            assert point.iou is not None
            assert 0 < point.iou <= 1


def test_ownership_keeps_the_rule_of_the_split_and_targets_belong_to_the_asked_person(episodes: list[Episode]) -> None:
    for episode in episodes:
        graph = ownership_graph(episode)
        shared, several = max(graph.num_owners_of.values()) > 1, max(graph.num_objects_of.values()) > 1
        expected = {"easy": (False, False), "medium": (False, True), "hard": (True, True)}[episode.key.split]
        assert (shared, several) == expected, episode.key
    for episode in episodes:
        captions = [slots[0] for slots in episode.record.captions_per_object]
        owned = [e.phrase for e in ownership_graph(episode).edges if e.owner == episode.record.owner]
        heads = [re.split(r"\b(?:near|next|located|on)\b", phrase, maxsplit=1)[0] for phrase in owned]
        category = re.compile(rf"\b{episode.record.object_category}\b")
        fitting = [phrase.split(" ", 1)[1] for phrase, head in zip(owned, heads, strict=True) if category.search(head)]
        assert sorted(fitting) == sorted(captions), episode.key


def test_the_paragraph_names_every_owner_object_room_and_the_floor(episodes: list[Episode]) -> None:
    for episode in episodes:
        text = episode.record.summary
        assert re.search(r"\b(ground|first) floor\b", text), text
        for edge in ownership_graph(episode).edges:
            assert re.search(rf"\b{edge.owner}\b", text)
            assert re.sub(r"^an? ", "", edge.phrase) in text
            assert edge.room is not None
            assert edge.room in text


@pytest.mark.slow
@pytest.mark.parametrize("name", SEEDS)
def test_the_scan_shows_the_same_objects_as_the_plan(root: Path, name: str) -> None:
    dataset = PersonalDataset(root)
    planned, scanned = open_scene(dataset, name), open_scene(dataset, name, scenes_dir=root / "scenes")
    assert planned.kind == scanned.kind == "invented"
    assert [(o.instance_id, o.name, o.category) for o in scanned.objects] == [
        (o.instance_id, o.name, o.category) for o in planned.objects
    ]
    for found, wanted in zip(scanned.objects, planned.objects, strict=True):
        assert found.centre == pytest.approx(wanted.centre, abs=1e-5)
        assert found.size == pytest.approx(wanted.size, abs=1e-5)
    assert set(dataset.goals(name)) == {item.name for item in scanned.objects}
    assert scanned.navigation.storey_heights == pytest.approx(planned.navigation.storey_heights, abs=1e-3)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_in_another_process(root: Path) -> None:
    program = (
        "import hashlib\nfrom sim.authoring.generation import dataset_files\n"
        "for path, data in sorted(dataset_files('Small', seed=3).items()):\n"
        "    print(path, hashlib.sha256(data).hexdigest())"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    paths = [line.split()[0] for line in done.stdout.splitlines()]
    assert len(paths) == 11
    assert done.stdout.splitlines() == [f"{p} {hashlib.sha256((root / p).read_bytes()).hexdigest()}" for p in paths]


@pytest.mark.parametrize(
    ("scene", "digest"),
    [
        ("Small", "c2b34fdddbcb8699"),
        ("Demo", "355d97236df74d49"),
    ],
)
def test_the_episodes_of_a_seed_are_those_of_earlier_versions(episodes: list[Episode], scene: str, digest: str) -> None:
    facts = [
        (
            str(episode.key),
            episode.record.object_names,
            episode.record.summary,
            episode.record.extracted_summary,
            [round(value, 2) + 0.0 for value in episode.record.start_position],
            round(episode.start.yaw, 2),
        )
        for episode in episodes
        if episode.key.scene == scene
    ]
    assert hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16] == digest


@pytest.mark.slow
def test_the_number_of_episodes_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.authoring.searches.ONE_OF_SHARE", 1.0)
    generation.write_files(tmp_path, dataset_files("Many", seed=3, episodes_per_split=5))
    found = list(PersonalDataset(tmp_path).episodes())
    assert [e.key.split for e in found] == ["easy"] * 5 + ["medium"] * 5 + ["hard"] * 5
    several = [episode for episode in found if len(episode.targets) > 1]
    assert len(several) >= 6
    assert not any(episode.key.split == "easy" for episode in several)
    for episode in several:
        assert {goal.object_category for goal in episode.targets} == {episode.record.object_category}
        assert f"one of {episode.record.owner}'s {episode.record.object_category}s" in episode.record.query[0]
    assert found_by(validate_dataset(tmp_path)) == []
    with pytest.raises(DatasetError, match=r"episodes_per_split is 0; expected 1 to 300\. Give another"):
        dataset_files("Many", seed=3, episodes_per_split=0)


@pytest.mark.slow
def test_a_home_in_which_a_piece_cannot_be_seen_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generation, "view_points_around", lambda *_, **__: [])
    monkeypatch.setattr("sim.homes.invented.plans._ATTEMPTS", 2)
    with pytest.raises(SceneError, match=r"'Demo': seed 3 gave \d homes in 2 tries, none fit to be used"):
        dataset_files("Demo", seed=3)


def test_a_folder_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "medium").write_text("a file where a folder must be")
    files = {f"{split}/content/Demo.json.gz": b"x" for split in SPLITS}
    with pytest.raises(DatasetError, match="cannot be written"):
        generation.write_files(tmp_path, files)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["medium"]


@pytest.mark.slow
def test_the_invent_verb_writes_whole_homes_and_says_what_is_next(tmp_path: Path, capsys) -> None:
    assert Invent(homes=1, seed=7, out=tmp_path / "homes").run() == 0
    names = sorted(str(path.relative_to(tmp_path / "homes")) for path in (tmp_path / "homes").rglob("*.*"))
    episodes = [f"{split}/{file}.json.gz" for split in SPLITS for file in ("content/Invented7", split)]
    kinds = ("glb", "plan.json", "semantic.glb", "semantic.txt", "stage_config.json")
    scene = [f"scenes/Invented7.{kind}" for kind in kinds]
    assert names == sorted(episodes + scene)
    assert "personal-viz validate --dataset" in capsys.readouterr().out
    with pytest.raises(PersonalVizError, match="--homes is 0; expected a whole number from 1"):
        Invent(homes=0, seed=7, out=tmp_path / "none").run()
    assert not (tmp_path / "none").exists()
