"""Opening a folder of episodes: which files are read, which are not, and one line for every kind of damage."""

import gzip
import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from sim.episodes.dataset import PersonalDataset, sample_keys
from sim.errors import DatasetError
from sim.types import EpisodeKey
from tests.sim.synthetic import (
    SCENE,
    Contents,
    example_content,
    example_episode,
    example_goal,
    write_content,
    write_dataset,
)


def one_line(error: pytest.ExceptionInfo[DatasetError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


def test_a_plain_file_is_read_only_if_there_is_no_gz_beside_it(tmp_path: Path) -> None:
    write_content(tmp_path, "hard", example_content(), plain=True)
    assert [str(episode.key) for episode in PersonalDataset(tmp_path).episodes()] == ["hard/Zz0ExampleZ/3"]
    both = tmp_path / "both"
    write_dataset(both)
    write_content(both, "easy", example_content(episodes=[]), plain=True)
    dataset = PersonalDataset(both)
    assert [path.name for path in dataset.files.values()] == ["Zz0ExampleZ.json.gz"]
    assert [str(episode.key) for episode in dataset.episodes()] == ["easy/Zz0ExampleZ/3"]


def test_episodes_come_in_order_of_split_scene_and_file_and_can_be_chosen(tmp_path: Path) -> None:
    episodes = [example_episode(scene="B", episode_id="9"), example_episode(scene="B", episode_id="1")]
    contents: Contents = {
        ("hard", "A"): example_content(scene="A"),
        ("easy", "B"): example_content(scene="B", episodes=episodes),
        ("easy", "A"): example_content(scene="A"),
    }
    dataset = PersonalDataset(write_dataset(tmp_path, contents))
    assert dataset.scenes == ("A", "B")
    assert [str(e.key) for e in dataset.episodes()] == ["easy/A/3", "easy/B/9", "easy/B/1", "hard/A/3"]
    assert [str(e.key) for e in dataset.episodes(splits=("easy",), scenes=("B",))] == ["easy/B/9", "easy/B/1"]
    assert dataset.episode(EpisodeKey("easy", "B", "1")).key.episode_id == "1"


def test_goals_of_a_scene_come_from_all_splits_and_the_first_counts(tmp_path: Path) -> None:
    key = f"{SCENE}.basis.glb_coffee table"
    easy = example_content(goals_by_category={key: [example_goal()]})
    hard = example_content(
        goals_by_category={key: [example_goal(floor_id="1"), example_goal(object_name="coffee table_8", object_id=8)]}
    )
    goals = PersonalDataset(write_dataset(tmp_path, {("easy", SCENE): easy, ("hard", SCENE): hard})).goals(SCENE)
    assert {name: goal.floor_id for name, goal in goals.items()} == {"coffee table_7": "0", "coffee table_8": "0"}


def test_the_digest_follows_the_content_not_the_compression(tmp_path: Path) -> None:
    content = example_content()
    write_content(tmp_path / "a", "easy", content)
    write_content(tmp_path / "b", "easy", content, plain=True)
    write_content(tmp_path / "c", "easy", example_content(episodes=[]))
    digests = [PersonalDataset(tmp_path / name).digest() for name in "abc"]
    assert digests[0] == digests[1] != digests[2]


def test_a_folder_without_episodes_and_a_file_with_a_wrong_scene_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="found no episode file; expected") as caught:
        PersonalDataset(tmp_path / "nowhere")
    assert str(tmp_path / "nowhere") in one_line(caught)
    path = write_content(tmp_path, "easy", example_content(), scene="Zz0 copy")
    with pytest.raises(DatasetError, match="the scene's name is 'Zz0 copy'; expected 1-64 letters") as caught:
        list(PersonalDataset(tmp_path).episodes())
    assert one_line(caught).startswith(f"{path}: ")


def test_an_unknown_scene_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    dataset = PersonalDataset(write_dataset(tmp_path))
    for ask in (
        lambda: dataset.content("easy", "Atlantis"),
        lambda: dataset.goals("Atlantis"),
        lambda: list(dataset.episodes(scenes=("Atlantis",))),
    ):
        with pytest.raises(DatasetError, match=r"scene 'Atlantis'.*expected one of: Zz0ExampleZ\.") as caught:
            ask()
        one_line(caught)
    with pytest.raises(DatasetError, match=r"is not in split 'hard'; expected one of: no scene\."):
        dataset.content("hard", SCENE)
    with pytest.raises(DatasetError, match="found no episode easy/Zz0ExampleZ/77"):
        dataset.episode(EpisodeKey("easy", SCENE, "77"))


WHOLE = gzip.compress(json.dumps(example_content()).encode())


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (WHOLE[:-40], "cannot be read"),
        (WHOLE[:-40], "expected gzip-compressed JSON"),
        (b"{}", "expected gzip-compressed JSON"),
        *(
            (gzip.compress(text, mtime=0), "is text that is not JSON (")
            for text in (b"", b"not json", b'{"a": [', b"\x00")
        ),
        (gzip.compress(b'{"episodes": "\xff\xfe"}', mtime=0), "is text that is not JSON ("),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, data: bytes, expected: str) -> None:
    path = write_content(tmp_path, "easy", example_content())
    path.write_bytes(data)
    with pytest.raises(DatasetError) as caught:
        list(PersonalDataset(tmp_path).episodes())
    assert one_line(caught).startswith(f"{path}: ")
    assert expected in one_line(caught)


@pytest.mark.parametrize(
    ("field", "value", "found", "expected"),
    [
        ("owner", ["Ada"], "['Ada']", "valid string"),
        ("start_position", [2.0, "0", 3.0], "'0'", "valid number"),
        ("summary", None, "None", "valid string"),
        ("summary", "", "''", "at least 1 character"),
        ("episode_id", 3, "3", "valid string"),
        ("pet", "cat", "'cat'", "not permitted"),
        ("episode_id", "a/b", "'a/b'", "should match pattern"),
        ("start_position", [2.0, 0.0, 3e4], "30000.0", "less than or equal to 10000"),
        ("start_position", [2.0, 0.0, 10**308], "1" + "0" * 76 + "...", "less than or equal to 10000"),
        ("start_rotation", [0, 0, 0, 0], "[0, 0, 0, 0]", "a unit quaternion [x, y, z, w]; its norm is 0, not 1"),
        ("query", ["Find it", ""], "''", "at least 1 character"),
    ],
)
def test_an_error_about_a_wrong_value_names_file_field_found_and_expected(
    tmp_path: Path, field: str, value: Any, found: str, expected: str
) -> None:
    path = write_content(tmp_path, "medium", example_content(episodes=[example_episode(**{field: value})]))
    with pytest.raises(DatasetError) as caught:
        PersonalDataset(tmp_path).content("medium", SCENE)
    line = one_line(caught)
    assert line.startswith(f"{path}: episodes.0.{field}")
    assert f"is {found}; expected: " in line
    assert expected in line


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    episode = example_episode()
    del episode["query"]
    write_content(tmp_path, "easy", example_content(episodes=[episode]))
    with pytest.raises(DatasetError, match=r"episodes\.0\.query is nothing; expected: Field required") as caught:
        PersonalDataset(tmp_path).content("easy", SCENE)
    one_line(caught)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_a_number_that_is_not_finite_is_refused(tmp_path: Path, number: str) -> None:
    text = json.dumps(example_content()).replace("3.25", number)
    write_content(tmp_path, "easy", text)
    with pytest.raises(DatasetError, match=r"episodes\.0\.info\.geodesic_distance is .*finite number") as caught:
        PersonalDataset(tmp_path).content("easy", SCENE)
    one_line(caught)


def test_an_error_about_a_target_missing_from_the_goals_names_the_episode(tmp_path: Path) -> None:
    path = write_content(tmp_path, "easy", example_content(episodes=[example_episode(object_id="coffee table_77")]))
    with pytest.raises(
        DatasetError, match=r"episodes\[0\]: object_id \['coffee table_77'\] resolves to \[\]"
    ) as caught:
        list(PersonalDataset(tmp_path).episodes())
    assert one_line(caught).startswith(str(path))


def test_an_id_used_twice_in_a_file_is_refused_before_its_first_episode(tmp_path: Path) -> None:
    episodes = [example_episode(), example_episode(episode_id="4"), example_episode()]
    path = write_content(tmp_path, "easy", example_content(episodes=episodes))
    with pytest.raises(
        DatasetError, match=r"episodes\[2\]\.episode_id is '3', as in episodes\[0\]; expected"
    ) as caught:
        next(PersonalDataset(tmp_path).episodes())
    assert one_line(caught).startswith(str(path))


@pytest.fixture(scope="module")
def release(dataset_root: Path) -> PersonalDataset:
    return PersonalDataset(dataset_root)


@pytest.mark.slow
def test_all_2000_released_episodes_load(release: PersonalDataset) -> None:
    episodes = list(release.episodes())
    assert Counter(episode.key.split for episode in episodes) == {"easy": 600, "medium": 700, "hard": 700}
    assert len({episode.key for episode in episodes}) == 2000
    assert len(release.files) == 93
    assert len(release.scenes) == 31
    assert sum(len(episode.targets) for episode in episodes) == 2035


def test_the_released_plain_twin_is_not_loaded_and_targets_are_found_by_exact_name(release: PersonalDataset) -> None:
    twin = release.root / "medium" / "content" / "4ok3usBNeis.json"
    assert twin.is_file()
    assert release.files[("medium", "4ok3usBNeis")].name == "4ok3usBNeis.json.gz"
    assert len(release.content("medium", "4ok3usBNeis").episodes) == 28
    episode = release.episode(EpisodeKey("hard", "Dd4bFSTQ8gi", "643"))
    listed = release.content("hard", "Dd4bFSTQ8gi").goals_by_category["Dd4bFSTQ8gi.basis.glb_flower vase"]
    assert {"flower vase_20", "flower vase_203"} <= {goal.object_name for goal in listed}
    assert [goal.object_name for goal in episode.targets] == ["flower vase_203"]
    for episode in release.episodes():
        assert tuple(goal.object_name for goal in episode.targets) == episode.record.object_names


def test_released_lists_of_objects_come_with_one_caption_list_each(release: PersonalDataset) -> None:
    lists = [episode for episode in release.episodes() if not isinstance(episode.record.object_id, str)]
    assert Counter(episode.key.split for episode in lists) == {"medium": 15, "hard": 20}
    assert {len(episode.targets) for episode in lists} == {2}
    assert all(len(episode.record.captions_per_object) == 2 for episode in lists)
    assert all(all(captions) for episode in lists for captions in episode.record.captions_per_object)


def many_keys() -> list[EpisodeKey]:
    """Twenty episodes of each of three scenes in easy, five of one in hard, in file order."""
    easy = [EpisodeKey("easy", scene, str(number)) for scene in ("A", "B", "C") for number in range(20)]
    return easy + [EpisodeKey("hard", "A", str(number)) for number in range(5)]


def test_a_sample_is_spread_over_scenes_and_splits_and_changes_with_the_seed() -> None:
    drawn = sample_keys(many_keys(), per_split=7, seed=0)
    counts = Counter((key.split, key.scene) for key in drawn)
    assert sorted(counts[("easy", scene)] for scene in "ABC") == [2, 2, 3]
    assert counts[("hard", "A")] == 5
    assert drawn == [key for key in many_keys() if key in set(drawn)]  # in the given order
    assert {key.episode_id for key in drawn if key.split == "easy"} - {"0", "1", "2"}
    assert sample_keys(many_keys(), per_split=9, seed=3) == sample_keys(many_keys(), per_split=9, seed=3)
    assert sample_keys(many_keys(), per_split=9, seed=3) != sample_keys(many_keys(), per_split=9, seed=4)


@pytest.mark.parametrize("seed", range(3))
def test_a_larger_sample_holds_the_smaller_one_and_does_not_depend_on_other_splits(seed: int) -> None:
    small, large = (set(sample_keys(many_keys(), per_split=count, seed=seed)) for count in (4, 11))
    assert small < large
    easy = [key for key in many_keys() if key.split == "easy"]
    assert set(sample_keys(easy, per_split=4, seed=seed)) == {key for key in small if key.split == "easy"}
    assert sample_keys(many_keys(), per_split=None, seed=seed) == many_keys()
