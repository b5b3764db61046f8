"""`generate`: episodes on annotated scans are valid and can be won; what a split's rule forbids is refused by name."""

import datetime
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from grounding.phrases.described import misread
from sim.authoring.annotations import AnnotatedObject, Box, Edit, annotation_path, append_edit
from sim.authoring.captions import caption_of
from sim.authoring.descriptions import OwnedItem
from sim.authoring.edition import Generated
from sim.episodes.dataset import PersonalDataset
from sim.episodes.ownership import ownership_graph
from sim.episodes.schema import Episode
from sim.episodes.validate import validate_dataset
from sim.frames import forward_from_yaw
from sim.homes.open_home import open_scene
from sim.homes.plan import load_plan
from sim.tasks.metrics import metric_rows
from sim.tasks.run_files import read_run
from sim.types import SPLITS, Split

from ..conftest import SHARED
from ..grounding.chat_stub import chat_stub
from ..sim.habitat_schema import read_as_habitat
from .program import Done, assert_one_line, personal_viz

WINDOWS: dict[Split, tuple[float, float]] = {"easy": (2, 4), "medium": (3, 7), "hard": (3, 11)}
POLYROOM = SHARED / "scans" / "Polyroom.glb"
NUM_OBJECTS = 16
"""Of the home's 57 objects: enough for every split, and few to look for view points."""


def annotate(folder: Path, scene: str, objects: Sequence[AnnotatedObject]) -> None:
    utc = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    for item in objects:
        append_edit(annotation_path(folder, scene), Edit(who="ada", utc=utc, id=item.id, before=None, after=item))


def small_objects(root: Path) -> list[AnnotatedObject]:
    """Objects of the invented home Small, known by the ids of its semantics and in sentences as people write them."""
    plan = load_plan(root / "scenes" / "Small.plan.json")
    return [
        AnnotatedObject(
            id=number, category=piece.category, captions=(f"A {caption_of(piece, plan)}.",), room=piece.room, storey=0
        )
        for number, piece in enumerate(plan.furniture, start=1)
    ][::3][:NUM_OBJECTS]


def generate(folder: Path, scans: Path, *options: object) -> Done:
    return personal_viz("generate", folder, "--scenes-dir", scans, *options)


def defects(root: Path) -> list[str]:
    report = validate_dataset(root)
    assert report.problems == ()
    return [check.measure.slug for check in report.checks if check.level != "note" and check.measure.count]


@pytest.fixture(scope="module")
def scans(small_home_root: Path) -> Path:
    return small_home_root / "scenes"


@pytest.fixture(scope="module")
def annotated(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with annotations only."""
    folder = tmp_path_factory.mktemp("annotated")
    annotate(folder, "Small", small_objects(small_home_root))
    return folder


@pytest.fixture(scope="module")
def made(annotated: Path, scans: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with annotations and the episodes made from them."""
    folder = tmp_path_factory.mktemp("made") / "dataset"
    shutil.copytree(annotated, folder)
    done = generate(folder, scans, "--seed", 3, "--easy", 4, "--medium", 4, "--hard", 4)
    assert done.returncode == 0, done.stderr
    assert f"Written to {folder}" in done.stdout
    assert "12 templates" in done.stdout
    return folder


@pytest.fixture(scope="module")
def episodes(made: Path) -> list[Episode]:
    return list(PersonalDataset(made).episodes())


@pytest.mark.slow
def test_episodes_are_valid_and_their_paragraphs_are_read_back(made: Path, episodes: list[Episode]) -> None:
    assert [sum(e.key.split == split for e in episodes) for split in SPLITS] == [4, 4, 4]
    assert defects(made) == []
    for episode in episodes:
        graph = ownership_graph(episode)
        shared, several = max(graph.num_owners_of.values()) > 1, max(graph.num_objects_of.values()) > 1
        assert (shared, several) == {"easy": (False, False), "medium": (False, True), "hard": (True, True)}[
            episode.key.split
        ]
        owners = {edge.node: (edge, [e.owner for e in graph.edges if e.node == edge.node]) for edge in graph.edges}
        items = [OwnedItem(edge.phrase, edge.room or "", tuple(people)) for edge, people in owners.values()]
        assert not misread(episode.record.summary, items)
        assert episode.record.captions_per_object[0][0].startswith("A ")


@pytest.mark.slow
def test_starts_are_in_the_window_to_the_nearest_view_point(made: Path, scans: Path, episodes: list[Episode]) -> None:
    navigation = open_scene(PersonalDataset(made), "Small", scenes_dir=scans).navigation
    for episode in episodes:
        start = np.array([episode.start.position])
        points = np.array([p.agent_state.position for goal in episode.targets for p in goal.view_points])
        low, high = WINDOWS[episode.key.split]
        assert low <= navigation.distances(start, points)[0] <= episode.record.info.geodesic_distance <= high


@pytest.mark.slow
def test_an_agent_that_knows_the_goals_wins_every_episode(made: Path, scans: Path, tmp_path: Path) -> None:
    run = ["--agent", "shortest-path", "--dataset", made, "--scenes-dir", scans, "--out", tmp_path, "--run-id", "r"]
    assert personal_viz("run", *run).returncode == 0
    assert {row.split: row.k for row in metric_rows([read_run(tmp_path / "r")]) if row.n == 4} == dict.fromkeys(
        SPLITS, 4
    )


@pytest.mark.slow
def test_habitats_own_class_reads_the_copy_for_it(made: Path, scans: Path, episodes: list[Episode]) -> None:
    for split in SPLITS:
        read = read_as_habitat(made / "objectnav" / split / f"{split}.json.gz", scenes_dir=scans)
        ours = [episode.record for episode in episodes if episode.key.split == split]
        assert [(e["start_position"], e["object_category"]) for e in read] == [
            (list(record.start_position), record.object_category) for record in ours
        ]
        for one, record in zip(read, ours, strict=True):
            assert Path(one["scene_id"]).is_file()
            assert record.object_names[0] in {goal["object_name"] for goal in one["goals"]}
            assert one["info"]["summary"] == record.summary
            assert one["info"]["object_id"] == record.object_id
        with pytest.raises(AssertionError, match="floor_id"):  # as the release's own files
            read_as_habitat(made / split / f"{split}.json.gz", scenes_dir=scans)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_other_starts_look_away(
    annotated: Path, made: Path, scans: Path, tmp_path: Path
) -> None:
    options = ["--easy", 4, "--medium", 4, "--hard", 4, "--json"]
    done = generate(annotated, scans, "--seed", 3, "--out", tmp_path / "again", *options)
    assert json.loads(done.stdout)["descriptions"] == {"templates": 12}
    files = sorted(path.relative_to(tmp_path / "again") for path in (tmp_path / "again").rglob("*") if path.is_file())
    assert len(files) == 15
    assert all((tmp_path / "again" / path).read_bytes() == (made / path).read_bytes() for path in files)
    options = ["--easy", 3, "--medium", 3, "--hard", 3]
    assert generate(annotated, scans, "--starts", "paper", "--out", tmp_path / "away", *options).returncode == 0
    assert defects(tmp_path / "away") == []
    for episode in PersonalDataset(tmp_path / "away").episodes():
        towards = np.subtract(episode.targets[0].position, episode.record.start_position)[[0, 2]]
        forward = forward_from_yaw(episode.start.yaw)[[0, 2]]
        assert forward @ towards / np.linalg.norm(towards) <= np.cos(np.radians(134.999))
    record = Generated.model_validate_json((tmp_path / "away" / "generated.json").read_bytes())
    assert (record.starts, record.scenes["Small"].num_edits) == ("paper", NUM_OBJECTS)


def test_episodes_that_exist_are_never_overwritten_or_mixed_unasked(
    annotated: Path, scans: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "dataset"
    shutil.copytree(annotated, folder)
    there = folder / "easy" / "content" / "Small.json.gz"
    there.parent.mkdir(parents=True)
    there.write_bytes(b"episodes")
    assert_one_line(generate(folder, scans), f"{there}: found episodes; expected none", "--replace")
    assert_one_line(generate(folder, scans, "--easy", 0, "--replace"), "that the new edition does not have")
    assert_one_line(generate(folder, scans, "--easy", 0, "--medium", 0, "--hard", 0), "0 episodes are asked for")
    assert there.read_bytes() == b"episodes"


def test_the_episodes_of_an_edition_are_not_replaced_by_those_made_from_them(small_home_root: Path) -> None:
    done = personal_viz("generate", small_home_root, "--replace")
    assert_one_line(done, "found the episodes from which new ones are made", "Give --out")


@pytest.mark.slow
def test_an_edition_gives_new_episodes_about_its_captioned_objects(small_home_root: Path, tmp_path: Path) -> None:
    old = PersonalDataset(small_home_root)
    done = personal_viz("generate", small_home_root, "--out", tmp_path, "--easy", 3, "--medium", 3, "--hard", 3)
    assert done.returncode == 0, done.stderr
    assert defects(tmp_path) == []
    asked = {name: e.record.captions_per_object[0] for e in old.episodes() for name in e.record.object_names[:1]}
    for episode in PersonalDataset(tmp_path).episodes():
        assert episode.record.scene_id == "invented/Small/Small.basis.glb"
        if len(episode.targets) == 1:
            assert episode.record.captions_per_object[0] == asked[episode.record.object_names[0]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "options", "part"),
    [
        (
            "two",
            ["--medium", 0, "--hard", 0],
            "scene 'Small': split 'easy' cannot be made, ground floor: everybody owns one object and every object has "
            "one owner: found 2 objects, needs 3.",
        ),
        (
            "one category",
            ["--easy", 0, "--hard", 0],
            "split 'medium' cannot be made, ground floor: somebody owns several objects: any two of the 5 could answer "
            "one query, needs two that cannot. Annotate more objects there, or ask for 0 episodes of medium.",
        ),
        ("no words", ["--hard", 0], "split 'easy' cannot be made, no object has words"),
        (
            "no such object",
            [],
            "annotations of 'Small': object 999 (chair) has no box, and the scan's semantics no object with this id",
        ),
    ],
)
def test_a_request_that_cannot_be_met_names_the_split_and_the_rule(
    changes: str, options: list, part: str, small_home_root: Path, scans: Path, tmp_path: Path
) -> None:
    objects = small_objects(small_home_root)
    picked = {
        "two": objects[:2],
        "one category": [item.model_copy(update={"category": "chair"}) for item in objects[:5]],
        "no words": [item.model_copy(update={"captions": ()}) for item in objects[:5]],
        "no such object": [objects[0].model_copy(update={"id": 999, "category": "chair"})],
    }[changes]
    annotate(tmp_path, "Small", picked)
    assert_one_line(generate(tmp_path, scans, *options), part)
    assert not list(tmp_path.rglob("*.gz"))


@pytest.mark.parametrize(
    "half",
    [
        ("--describe", "llm", "--llm-url", "http://127.0.0.1:1/v1"),
        ("--describe", "llm", "--llm-model", "small"),
        ("--describe", "llm", "--llm-url", "http://127.0.0.1:1/v1", "--llm-key-env", "KEY"),
        ("--llm-url", "http://127.0.0.1:1/v1", "--llm-model", "small"),
        ("--llm-key-env", "KEY"),
    ],
    ids=["no model", "no address", "a key for a model", "templates", "templates with a key"],
)
def test_half_of_a_language_model_s_options_is_refused_in_one_line(
    half: tuple[str, ...], annotated: Path, scans: Path, tmp_path: Path
) -> None:
    done = generate(annotated, scans, "--out", tmp_path / "x", *half)
    assert_one_line(done, "--describe is '", "expected both for llm, and none for templates. Add or leave them out.")
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
def test_a_language_model_describes_or_templates_do_and_the_summary_says_which(
    annotated: Path, scans: Path, tmp_path: Path
) -> None:
    pytest.importorskip("openai", reason="extra llm is not installed")
    few = ["--easy", 2, "--medium", 0, "--hard", 0]
    with chat_stub() as stub:
        stub.content = "Ada owns everything here."
        llm = ["--describe", "llm", "--llm-url", stub.url, "--llm-model", "small"]
        done = generate(annotated, scans, "--out", tmp_path / "told", *few, *llm)
        assert done.returncode == 0, done.stderr
        assert "6 llm refused, 2 templates" in done.stdout
        assert len(stub.requests) == 6
        assert defects(tmp_path / "told") == []
    assert_one_line(generate(annotated, scans, "--out", tmp_path / "x", "--describe", "llm"), "expected both for llm")
    assert_one_line(
        generate(annotated, scans, "--out", tmp_path / "x", *few, *llm[:2], "--llm-url", "http://127.0.0.1:1/v1",
                 "--llm-model", "other"),
        "gave no answer", "use --describe templates",
    )  # fmt: skip
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*read as y-up")
def test_a_real_scan_gets_easy_episodes_that_can_be_won_and_is_too_small_for_medium(tmp_path: Path) -> None:
    if not POLYROOM.is_file():
        pytest.skip(f"the scan is not at {POLYROOM}")
    # corners of a room of 2.7 x 3.7 m, floor at -1.6 m
    places = {
        "shelf": (1.1, -1.3, 0.8),
        "box": (0.5, -1.3, -1.6),
        "lamp": (-1.0, -1.3, -1.6),
        "chair": (0.8, -1.3, 1.1),
    }
    objects = [
        AnnotatedObject(
            id=number, category=category, captions=(f"{category} in a corner of the room",), room="studio",
            box=Box(centre=centre, size=(0.3, 0.4, 0.3)),
        )
        for number, (category, centre) in enumerate(places.items(), start=1)
    ]  # fmt: skip
    annotate(tmp_path, "Polyroom", objects)
    scans = POLYROOM.parent
    done = generate(tmp_path, scans, "--easy", 3, "--medium", 0, "--hard", 0)
    assert done.returncode == 0, done.stderr
    assert defects(tmp_path) == []
    (read,) = read_as_habitat(tmp_path / "objectnav/easy/easy.json.gz", scenes_dir=scans)[:1]
    assert read["scene_id"] == str(POLYROOM)
    run = ["--agent", "shortest-path", "--dataset", tmp_path, "--scenes-dir", scans, "--out", tmp_path / "runs"]
    assert personal_viz("run", *run, "--run-id", "r").returncode == 0
    assert [row.k for row in metric_rows([read_run(tmp_path / "runs" / "r")]) if row.split == "easy"] == [3]
    done = generate(tmp_path, scans, "--easy", 0, "--medium", 1, "--hard", 0, "--out", tmp_path / "medium")
    assert_one_line(
        done, "split 'medium', start 3-7 m from the nearest view point", "the longest walk to an object is 2."
    )
