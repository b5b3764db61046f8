"""The dataset tables of the paper: figures computed by hand, and those of DATA_FORMAT.md sections 10 and 11."""

import gzip
import json
import math
from pathlib import Path

import pytest

from personal_viz.cli.stats import Stats
from sim.episodes.dataset import PersonalDataset
from sim.episodes.statistics import (
    CaptionMetrics,
    CaptionStatistics,
    NetworkStatistics,
    caption_metrics,
    caption_statistics,
    goat_metrics,
    network_statistics,
)
from sim.errors import DatasetError
from tests.sim.synthetic import SCENE, Contents, example_content, example_episode, example_goal, write_dataset

# DATA_FORMAT.md section 10, released episodes: easy, medium, hard, total.
NETWORK = {
    "people": (3.94, 3.31, 6.15, 4.47),
    "objects": (3.94, 5.71, 7.10, 5.58),
    "shared_objects": (0.00, 0.00, 4.00, 1.34),
    "categories": (58, 87, 114, 132),
    "summary_words": (105.9, 139.6, 168.9, 138.2),
    "edges": (3.94, 5.71, 15.01, 8.22),
    "degree_per_person": (1.00, 1.80, 2.43, 1.74),
    "degree_per_object": (1.00, 1.00, 2.17, 1.39),
    "density": (0.28, 0.33, 0.36, 0.32),
    "overlap_ratio": (0.00, 0.00, 0.58, 0.19),
    "episodes": (600, 700, 700, 2000),
    "geodesic": (3.05, 5.06, 6.72, 4.94),
    "euclidean": (3.00, 4.49, 5.68, 4.39),
}
NETWORK_PER_SUMMARY = {
    "people": (3.65, 3.14, 5.95),
    "objects": (3.64, 5.34, 7.00),
    "edges": (3.65, 5.34, 14.17),
    "shared_objects": (0, 0, 3.76),
    "density": (0.31, 0.36, 0.35),
    "overlap_ratio": (0, 0, 0.55),
    "summary_words": (100.5, 133.9, 167.2),
    "episodes": (220, 237, 308),
}


def tolerance(field: str) -> float:
    """Half a unit of the last digit that the document prints."""
    return 0 if field in ("categories", "episodes") else 0.051 if field == "summary_words" else 0.0051


@pytest.fixture(scope="module")
def network(dataset_root: Path) -> NetworkStatistics:
    return network_statistics(PersonalDataset(dataset_root))


@pytest.fixture(scope="module")
def captions(dataset_root: Path) -> CaptionStatistics:
    return caption_statistics(PersonalDataset(dataset_root))


@pytest.mark.release
@pytest.mark.parametrize("field", NETWORK)
def test_the_released_network_table_equals_section_10(network: NetworkStatistics, field: str) -> None:
    assert [column.column for column in network.per_episode] == ["easy", "medium", "hard", "total"]
    found = [getattr(column, field) for column in network.per_episode]
    assert found == pytest.approx(NETWORK[field], abs=tolerance(field))


@pytest.mark.release
@pytest.mark.parametrize("field", NETWORK_PER_SUMMARY)
def test_the_released_network_table_per_summary_equals_section_10(network: NetworkStatistics, field: str) -> None:
    found = [getattr(column, field) for column in network.per_summary[:3]]
    assert found == pytest.approx(NETWORK_PER_SUMMARY[field], abs=tolerance(field))


def assert_captions(metrics: CaptionMetrics, figures: tuple[int, float, float, int, float]) -> None:
    captions, mean, sd, vocabulary, entropy = figures
    assert (metrics.captions, metrics.vocabulary) == (captions, vocabulary)
    assert (metrics.words_mean, metrics.words_sd) == pytest.approx((mean, sd), abs=0.0051)
    assert metrics.entropy_bits == pytest.approx(entropy, abs=0.0051)


@pytest.mark.release
def test_the_released_caption_table_equals_section_11(captions: CaptionStatistics) -> None:
    assert_captions(captions.all_targets, (884, 16.78, 6.01, 1178, 7.09))
    assert captions.all_targets.tokens == 14_834
    assert captions.all_targets.words_range == (2, 42)
    assert captions.all_targets.type_token_ratio == pytest.approx(0.0794, abs=0.00005)
    assert captions.stripped.vocabulary == 880
    assert captions.stripped.type_token_ratio == pytest.approx(0.0591, abs=0.00005)
    assert captions.stripped.entropy_bits == pytest.approx(6.79, abs=0.0051)
    assert captions.faulty == ("MHPLjHsuG27/painting_113", "q3zU7Yy5E5s/picture_464")


@pytest.mark.release
def test_the_released_caption_table_per_split_equals_section_11(captions: CaptionStatistics) -> None:
    assert [metrics.source for metrics in captions.per_split] == ["easy", "medium", "hard"]
    assert_captions(captions.per_split[0], (408, 17.06, 5.81, 797, 7.01))
    assert_captions(captions.per_split[1], (497, 17.67, 6.04, 878, 6.99))
    assert_captions(captions.per_split[2], (517, 16.50, 6.10, 883, 7.03))


def test_the_network_table_of_three_invented_episodes_has_the_figures_computed_by_hand(tmp_path: Path) -> None:
    twice = [example_episode(episode_id="1", owner="Ada"), example_episode(episode_id="2", owner="Eve")]
    shared = example_episode(
        episode_id="3",
        summary="Ada and Bo share it.",
        extracted_summary=[
            "Ada owns a low oak coffee table in the lounge",
            "Bo owns the low oak coffee table in the lounge",
            "Bo owns a rug in the hall",
        ],
        info={"geodesic_distance": 9.0, "euclidean_distance": 6.0, "closest_goal_object_id": 7},
    )
    contents: Contents = {
        ("easy", SCENE): example_content(episodes=twice),
        ("hard", SCENE): example_content(episodes=[shared]),
    }
    statistics = network_statistics(PersonalDataset(write_dataset(tmp_path, contents)))
    easy, hard, total = statistics.per_episode
    assert (easy.column, hard.column, total.column) == ("easy", "hard", "total")
    assert (easy.people, easy.objects, easy.edges, easy.shared_objects, easy.episodes) == (2, 2, 2, 0, 2)
    assert (easy.density, easy.degree_per_person, easy.summary_words) == (0.5, 1, 18)
    assert (hard.people, hard.objects, hard.edges, hard.shared_objects) == (2, 2, 3, 1)
    assert (hard.density, hard.degree_per_person, hard.degree_per_object, hard.overlap_ratio) == (0.75, 1.5, 1.5, 0.5)
    assert (hard.summary_words, hard.geodesic, hard.euclidean) == (5, 9, 6)
    assert (total.edges, total.density, total.categories, total.episodes) == (2.5, 0.625, 1, 3)
    assert [column.episodes for column in statistics.per_summary] == [1, 1, 2]


def test_caption_metrics_of_two_captions_and_of_none_have_the_values_computed_by_hand() -> None:
    metrics = caption_metrics("two", [["a", "red", "a", "b"], ["a", "red"]])
    assert (metrics.captions, metrics.tokens, metrics.vocabulary, metrics.words_range) == (2, 6, 3, (2, 4))
    assert (metrics.words_mean, metrics.words_sd, metrics.type_token_ratio) == (3, 1, 0.5)
    assert metrics.entropy_bits == pytest.approx(0.5 + math.log2(3) / 3 + math.log2(6) / 6)
    assert caption_metrics("none", []) == CaptionMetrics("none", 0.0, 0.0, 0, 0.0, 0.0, 0, 0, (0, 0))


def test_a_target_of_two_splits_counts_once_and_splits_without_episodes_are_left_out(tmp_path: Path) -> None:
    goals = {f"{SCENE}.basis.glb_coffee table": [example_goal()]}
    easy = example_content(goals_by_category=goals)
    hard = example_content(
        goals_by_category=goals, episodes=[example_episode(description=["NOTA: the table's leg, table", "", ""])]
    )
    statistics = caption_statistics(
        PersonalDataset(write_dataset(tmp_path, {("hard", SCENE): hard, ("easy", SCENE): easy}))
    )
    assert statistics.all_targets.captions == 1
    assert statistics.all_targets.tokens == 10
    assert [(metrics.source, metrics.tokens) for metrics in statistics.per_split] == [("easy", 10), ("hard", 5)]
    assert statistics.faulty == ()


def test_punctuation_joins_words_until_it_is_stripped(tmp_path: Path) -> None:
    episode = example_episode(description=["Oak table, table's leg. oak-brown", "", ""])
    dataset = PersonalDataset(write_dataset(tmp_path, {("easy", SCENE): example_content(episodes=[episode])}))
    statistics = caption_statistics(dataset)
    assert (statistics.all_targets.tokens, statistics.all_targets.vocabulary) == (5, 5)
    assert (statistics.stripped.tokens, statistics.stripped.vocabulary) == (6, 5)


def test_statistics_refuse_a_damaged_file_in_one_line(tmp_path: Path) -> None:
    path = write_dataset(tmp_path) / "easy" / "content" / f"{SCENE}.json.gz"
    path.write_bytes(b"?")
    with pytest.raises(DatasetError, match="cannot be read"):
        Stats(dataset=tmp_path, json=False).run()


def test_stats_prints_both_tables_beside_the_papers_figures_or_one_json_document(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_dataset(tmp_path)
    assert Stats(dataset=tmp_path, json=False).run() == 0
    text = capsys.readouterr().out
    assert "4.52 | 2.00 | 2.00" in text
    assert "GOAT (paper)" in text
    assert "20.65 ± 13.10" in text
    write_dataset(tmp_path)
    assert Stats(dataset=tmp_path, json=True).run() == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"edition", "network", "captions"}
    assert document["network"]["per_episode"][0]["people"] == 2
    assert document["network"]["paper"][3]["episodes"] == 2020
    assert document["captions"]["all_targets"]["captions"] == 1


def goat_file(folder: Path, scene: str, goals: object) -> None:
    content = folder / "val_unseen" / "content"
    content.mkdir(parents=True, exist_ok=True)
    (content / f"{scene}.json.gz").write_bytes(gzip.compress(json.dumps({"episodes": [], "goals": goals}).encode()))


def test_goat_bench_gets_its_column_from_its_own_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sofa = {"object_category": "sofa", "object_id": "sofa_3", "lang_desc": "The red sofa, near the red lamp"}
    lamp = {"object_category": "lamp", "object_id": "lamp_4", "lang_desc": "the lamp"}
    goals = {"A.basis.glb_sofa": [sofa, sofa | {"object_id": "sofa_9", "lang_desc": None}], "A.basis.glb_lamp": [lamp]}
    goat_file(tmp_path / "goat", "A", goals)
    goat_file(tmp_path / "goat", "B", {"B.basis.glb_lamp": [lamp | {"lang_desc": "a lamp"}]})
    found = goat_metrics(tmp_path / "goat")
    assert (found.captions, found.tokens, found.vocabulary, found.words_range) == (3, 11, 6, (2, 7))
    write_dataset(tmp_path / "own", {("easy", SCENE): example_content()})
    Stats(tmp_path / "own", goat=tmp_path / "goat", json=True).run()
    document = json.loads(capsys.readouterr().out)
    assert (document["edition"], document["goat"]["captions"]) == ("own", 3)
    Stats(tmp_path / "own", goat=tmp_path / "goat").run()
    assert "GOAT-Bench" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        ([], "found AttributeError"),
        ({"c": [{"lang_desc": "a cup"}]}, "found KeyError"),
        ({}, "found no description in 1 content file"),
    ],
)
def test_other_files_than_goat_benchs_are_refused(tmp_path: Path, goals: object, message: str) -> None:
    goat_file(tmp_path, "A", goals)
    with pytest.raises(DatasetError, match=message):
        goat_metrics(tmp_path)
    (tmp_path / "val_unseen" / "content" / "A.json.gz").write_bytes(b"no gzip")
    with pytest.raises(DatasetError, match="expected JSON"):
        goat_metrics(tmp_path)
