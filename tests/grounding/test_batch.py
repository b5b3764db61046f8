"""Many episodes at once: the same answers as one by one, on shared and on different maps."""

from pathlib import Path

import numpy as np
import pytest

from grounding.encoders.by_name import make_encoder
from grounding.maps.oracle_map import objects_map, oracle_home
from grounding.methods.batch import ground_batch, make_batch, solve_batch
from grounding.methods.rpg import PRESETS, RegionGated, RpgOptions
from grounding.phrases.sources import DatasetPhrases
from grounding.types import FeatureMap, Grounding, map_from_cells
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError
from sim.types import GridSpec, Task

WORDS = ("red", "blue", "oak", "tall", "lamp", "sofa", "desk", "mirror", "rug", "door", "window", "vase")


def random_map(rng: np.random.Generator, *, cells: int) -> FeatureMap:
    encoder = make_encoder("hashed")
    texts = [" ".join(rng.choice(WORDS, 4, replace=False)) for _ in range(cells)]
    index = rng.choice(100, cells, replace=False)
    rc = np.column_stack([index // 10, index % 10])
    grid = GridSpec((0.0, 0.0), 1.0, (10, 10))
    return map_from_cells(encoder.encode_texts(texts), rc, grid=grid, floor_y=0.0, encoder=encoder.name)


def random_episodes(rng: np.random.Generator, count: int) -> tuple[list[Task], list[tuple[str, ...]]]:
    tasks, phrases = [], []
    for _ in range(count):
        told = [f"{rng.choice(['Ada', 'Bo'])} owns {' '.join(rng.choice(WORDS, 3))}" for _ in range(rng.integers(0, 5))]
        tasks.append(Task("pog", ". ".join(told), (f"Find Ada's {rng.choice(WORDS)}",)))
        phrases.append(tuple(told))
    return tasks, phrases


def cells_of(grounding: Grounding) -> list[int]:
    return [candidate.index for candidate in grounding.candidates]


@pytest.mark.parametrize("options", [PRESETS["paper"], PRESETS["authors"], RpgOptions(2, 2, 2)])
def test_a_batch_on_several_maps_answers_as_one_by_one(options: RpgOptions) -> None:
    rng = np.random.default_rng(1)
    encoder = make_encoder("hashed")
    maps = [random_map(rng, cells=cells) for cells in (25, 1, 60, 0)]
    tasks, phrases = random_episodes(rng, 60)
    memories = [maps[k] for k in rng.integers(0, len(maps), len(tasks))]
    together = ground_batch(memories, tasks, phrases, encoder, options=options)
    single = RegionGated(encoder, options=options)
    for memory, task, told, grounding in zip(memories, tasks, phrases, together, strict=True):
        alone = single.ground(memory, task, told)
        assert cells_of(grounding) == cells_of(alone)
        assert [c.position for c in grounding.candidates] == [c.position for c in alone.candidates]
        scores = [candidate.score for candidate in alone.candidates]
        assert [c.score for c in grounding.candidates] == pytest.approx(scores, abs=1e-6)
        assert bool(grounding.candidates) == bool(len(memory.rows))


def test_a_phrase_that_many_episodes_share_is_encoded_and_looked_for_once() -> None:
    memory = random_map(np.random.default_rng(2), cells=20)
    told = ("Ada owns a red lamp", "Bo owns an oak desk")
    tasks = [Task("pog", "", (f"Find Ada's {word}",)) for word in WORDS]
    batch = make_batch(memory, tasks, [told] * 6 + [told[::-1]] * 5 + [()], make_encoder("hashed"))
    assert batch.phrases.shape == (2, 768)
    assert batch.queries.shape == (12, 768)
    assert batch.uses.sum(dim=1).tolist() == [2] * 11 + [0]
    result = solve_batch(batch)
    assert result.peaks.shape == (2, 3)
    # an episode without phrases may answer anywhere
    assert bool(result.gate[11].all())


def test_a_whole_small_dataset_in_one_call_answers_as_the_evaluation(small_root: Path) -> None:
    dataset = PersonalDataset(small_root)
    encoder = make_encoder("hashed")
    maps: dict[tuple[str, str], FeatureMap] = {}
    episodes = list(dataset.episodes())
    for episode in episodes:
        key = (episode.key.scene, episode.record.floor_id)
        maps[key] = maps.get(key) or objects_map(oracle_home(dataset, key[0]), encoder, floor_id=key[1])
    source = DatasetPhrases(episodes)
    tasks = [episode.task("pog") for episode in episodes]
    memories = [maps[(episode.key.scene, episode.record.floor_id)] for episode in episodes]
    phrases = [source.phrases(task) for task in tasks]
    single = RegionGated(encoder)
    alone = [single.ground(*inputs) for inputs in zip(memories, tasks, phrases, strict=True)]
    together = ground_batch(memories, tasks, phrases, encoder)
    assert [cells_of(one) for one in together] == [cells_of(one) for one in alone]


def test_no_episodes_give_no_answers_and_other_encoders_and_the_literal_form_are_refused() -> None:
    encoder = make_encoder("hashed")
    assert ground_batch([], [], [], encoder) == []
    grid = GridSpec((0.0, 0.0), 1.0, (2, 2))
    other = map_from_cells(np.ones((1, 4)), np.array([[0, 0]]), grid=grid, floor_y=0.0, encoder="other")
    task = Task("pog", "", ("Find Ada's lamp",))
    with pytest.raises(AgentError, match="encoder 'other'"):
        ground_batch([other], [task], [()], encoder)
    memory = random_map(np.random.default_rng(3), cells=3)
    with pytest.raises(ValueError, match="call rpg_dense"):
        ground_batch([memory], [task], [()], encoder, options=RpgOptions(literal=True))
