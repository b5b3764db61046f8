"""Random cell, map centre, query scoring, the ranking of cells, and phrases of the dataset."""

from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.hashed import HashedWords
from grounding.methods.baselines import MapCentre, QueryScoring, RandomCell, rank_cells
from grounding.methods.rpg import RegionGated, RpgOptions
from grounding.phrases.sources import DatasetPhrases
from grounding.types import FeatureMap, map_from_cells
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError
from sim.types import GridSpec, Task

WORDS = HashedWords()
TASK = Task("pog", "Ada owns the oak table. Bo owns the grey sofa.", ("Find Bo's sofa",))


def small_map(*texts: str, encoder: str = WORDS.name) -> FeatureMap:
    """A 4 x 6 grid with cells of 0.5 m, whose cells (1, 0), (1, 2), (1, 4) hold the texts."""
    return map_from_cells(
        WORDS.encode_texts(texts),
        np.array([[1, 2 * index] for index in range(len(texts))]),
        grid=GridSpec((10.0, -2.0), 0.5, (4, 6)),
        floor_y=3.0,
        encoder=encoder,
        centre_xz=(11.2, -0.9),
    )


def test_ranking_is_best_first_with_ties_by_cell_and_drops_neighbours() -> None:
    line = np.array([[0, col] for col in range(5)])
    scores = np.array([0.1, 0.9, 0.8, -np.inf, 0.7])
    assert rank_cells(scores, line) == [1, 4]
    assert rank_cells(scores, line, nms_r=0) == [1, 2, 4]
    assert rank_cells(scores, line, nms_r=0, count=1) == [1]
    line = np.array([[0, col] for col in range(4)])
    assert rank_cells(np.array([0.2, 0.5, 0.1, 0.5 + 1e-8]), line, nms_r=0) == [1, 3, 0]
    assert rank_cells(np.empty(0), np.empty((0, 2), int)) == []
    assert rank_cells(np.full(3, -np.inf), np.array([[0, 0], [0, 1], [0, 2]])) == []


def test_query_scoring_answers_with_the_cell_most_similar_to_the_query() -> None:
    grounding = QueryScoring(WORDS).ground(small_map("oak table", "grey sofa", "tall lamp"), TASK, ())
    first = grounding.candidates[0]
    # column 2 of 0.5 m cells from x = 10, row 1 from z = -2
    assert first.position == (11.25, 3.0, -1.25)
    assert (first.row, first.col, first.index) == (1, 2, 8)
    # "bo", "sofa", "bo sofa" and "grey", "sofa", "grey sofa" share one of three terms
    assert first.score == pytest.approx(1 / 3)
    assert len(grounding.candidates) == 3


def test_the_centre_is_the_middle_of_the_home_on_the_floor_of_the_map() -> None:
    (candidate,) = MapCentre().ground(small_map("oak table"), TASK, ()).candidates
    assert candidate.position == (11.2, 3.0, -0.9)
    assert (candidate.row, candidate.col, candidate.index) == (2, 2, 14)


def test_random_cells_are_three_distinct_ones_and_always_the_same_for_a_task() -> None:
    memory = small_map("oak table")
    first = RandomCell(seed=0).ground(memory, TASK, ()).candidates
    assert len({candidate.index for candidate in first}) == 3
    assert RandomCell(seed=0).ground(memory, TASK, ()).candidates == first
    assert RandomCell(seed=1).ground(memory, TASK, ()).candidates != first


def test_random_cells_cover_the_whole_grid_evenly() -> None:
    memory = small_map("oak table")
    grounder = RandomCell(seed=0)
    tasks = [Task("pog", f"home {number}", ("Find it",)) for number in range(2400)]
    first = [grounder.ground(memory, task, ()).candidates[0].index for task in tasks]
    counts = np.bincount(first, minlength=24)
    # 100 are expected per cell, with a standard deviation of 10
    assert counts.min() > 60
    assert counts.max() < 140


def test_rpg_shows_its_layers_on_the_cells_of_the_map() -> None:
    phrases = ("Ada owns the oak table", "Bo owns the grey sofa")
    grounder = RegionGated(WORDS, options=RpgOptions(top_k=1, nhood=0))
    grounding = grounder.ground(small_map("oak table", "grey sofa", "tall lamp"), TASK, phrases)
    layers = grounding.layers
    assert layers is not None
    assert layers.phrases == phrases
    assert layers.peaks.tolist() == [[0], [1]]
    assert layers.gate is not None
    assert layers.gate.tolist() == [True, True, False]
    assert layers.final[2] == -np.inf
    picture = layers.on_grid(layers.similarity)
    assert picture.shape == (2, 4, 6)
    assert int(np.isfinite(picture[0]).sum()) == 3
    assert picture[1, 1, 2] == layers.similarity[1, 1]
    assert [candidate.col for candidate in grounding.candidates] == [2, 0]


def test_the_literal_form_shows_its_layers_on_all_cells_and_an_empty_map_has_no_answer() -> None:
    grounder = RegionGated(WORDS, options=RpgOptions(top_k=1, nhood=0, literal=True))
    grounding = grounder.ground(small_map("oak table", "grey sofa"), TASK, ("Bo owns the grey sofa",))
    assert grounding.layers is not None
    assert grounding.layers.final.shape == (24,)
    assert grounding.candidates[0].position == (11.25, 3.0, -1.25)
    for options in (RpgOptions(), RpgOptions(literal=True)):
        assert RegionGated(WORDS, options=options).ground(small_map(), TASK, ("Bo owns the sofa",)).candidates == ()
    assert QueryScoring(WORDS).ground(small_map(), TASK, ()).candidates == ()


def test_rpg_and_query_scoring_refuse_a_map_of_another_encoder() -> None:
    other = small_map("oak table", encoder="blip2-hidden768")
    for grounder in (QueryScoring(WORDS), RegionGated(WORDS)):
        with pytest.raises(AgentError) as refusal:
            grounder.ground(other, TASK, ())
        assert str(refusal.value) == (
            "map: holds 768-d vectors of encoder 'blip2-hidden768', the query is 768-d from 'hashed-words-768'; "
            "expected one encoder. Encode the query with 'blip2-hidden768', or build the map with 'hashed-words-768'."
        )


def test_phrases_of_the_dataset_are_found_by_task(small_root: Path) -> None:
    episodes = list(PersonalDataset(small_root).episodes(scenes=("HomeTwo",)))
    source = DatasetPhrases(episodes)
    assert source.name == "dataset"
    assert source.phrases(episodes[0].task("pog")) == (
        "Carl owns a white plastic chair in the room",
        "Dee owns a carved wooden chair with armrests in the room",
        "Carl owns a oval mirror with a golden frame in the room",
    )
    assert source.phrases(episodes[0].task("pog", query_index=3)) == source.phrases(episodes[0].task("pog"))
    with pytest.raises(AgentError, match='found no episode with query "Find Bo\'s sofa"'):
        DatasetPhrases([]).phrases(TASK)
