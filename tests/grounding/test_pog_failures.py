"""Kinds of wrong answers, and the reasons that the layers of the grounder give, on homes with known objects."""

from pathlib import Path

import numpy as np
import pytest

from grounding.evaluation.evaluate import GroundSettings, SceneGrounder
from grounding.report.asked_again import AnswerAgain, AskAgain, settings_of
from grounding.report.failures import failure_of, reasons
from grounding.types import Candidate, Grounding, Layers, map_from_cells
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.tasks.rules import scene_storeys, score_answer
from sim.tasks.run_files import Answer
from sim.types import EpisodeKey, GridSpec

from .pog_runs import answer_to, run_of

SOFA = EpisodeKey("easy", "HomeOne", "1")
"""Bo's grey sofa at (5.5, 7.5), storey 0; Ada's yellow sofa is at (9.5, 2.5), the table at (2.25, 7.75)."""


@pytest.fixture(scope="module")
def dataset(small_root: Path) -> PersonalDataset:
    return PersonalDataset(small_root)


@pytest.fixture(scope="module")
def sofa(dataset: PersonalDataset) -> Episode:
    return dataset.episode(SOFA)


def answered(dataset: PersonalDataset, episode: Episode, *points: tuple[float, float, float]) -> Answer:
    storeys = scene_storeys(dataset.goals(SOFA.scene).values())
    found = answer_to(SOFA, None).model_copy(update={"candidates": points})
    return found.model_copy(update={"measures": score_answer(episode, points, storeys=storeys)})


@pytest.mark.parametrize(
    ("points", "kind", "name"),
    [
        ([(9.0, 0.0, 2.5)], "another instance", "sofa_3"),
        ([(5.5, 0.0, 6.0)], "near miss", ""),
        ([(2.5, 0.0, 7.5)], "another object", "table_1"),
        ([(0.5, 0.0, 0.5)], "nothing known there", ""),
        ([(5.5, 3.0, 7.5)], "another storey", ""),
        ([(2.5, 3.0, 7.5)], "another storey", "bed_5"),
        ([], "no answer", ""),
    ],
)
def test_the_place_of_a_wrong_answer_decides_its_kind(
    dataset: PersonalDataset, sofa: Episode, points: list, kind: str, name: str
) -> None:
    goals = tuple(dataset.goals(SOFA.scene).values())
    answer = answered(dataset, sofa, *points)
    found = failure_of(sofa, answer, goals=goals, storeys=scene_storeys(goals))
    assert (found.kind, found.object_name) == (kind, name)


def again(final: list[float], cells: list[tuple[int, int]]) -> AnswerAgain:
    """The answer of a grounder on a map with these cells of 1 m and these final scores."""
    grid = GridSpec((0.0, 0.0), 1.0, (10, 12))
    memory = map_from_cells(np.eye(len(cells), 4), np.array(cells), grid=grid, floor_y=0.0, encoder="e")
    layers = Layers(memory.rc, grid.shape, final=np.array(final, np.float32))
    return AnswerAgain(memory, Grounding((Candidate((2.5, 0.0, 7.5), 1.0, 7, 2, 86),), layers))


def test_the_reason_is_a_tie_a_rank_a_gate_or_an_unmapped_object(sofa: Episode) -> None:
    table_sofa = [(7, 2), (7, 5)]
    assert reasons(sofa, again([0.5, 0.5], table_sofa))[0].startswith("A tie: the right place scores as high")
    assert reasons(sofa, again([0.5, 0.25], table_sofa)) == ["The right place is 2. of 2, with 0.250 against 0.500."]
    assert reasons(sofa, again([0.5, -np.inf], table_sofa)) == ["The phrases' gate is closed around the right object."]
    assert reasons(sofa, again([0.5], [(7, 2)]))[0].startswith("The right object is not on the map")
    assert reasons(sofa, AnswerAgain(problem="is none of ours")) == ["The method is none of ours."]


def test_an_episode_is_grounded_again_with_the_settings_of_its_run(dataset: PersonalDataset, sofa: Episode) -> None:
    answer = SceneGrounder(dataset, SOFA.scene, GroundSettings("rpg")).answer(sofa)
    info = run_of("rpg", [], config={"phrases": "dataset"}).info
    assert settings_of(info) == GroundSettings("rpg")
    asking = AskAgain(dataset)
    found = asking.ask(info, answer, sofa)
    assert found.problem == ""
    assert found.grounding is not None
    assert found.grounding.layers is not None
    moved = answer.model_copy(update={"candidates": ((0.5, 0.0, 0.5),)})
    assert asking.ask(info, moved, sofa).problem == "gives other points now than its run file holds"
    foreign = info.model_copy(update={"who": "theirs"})
    assert asking.ask(foreign, answer, sofa).problem.startswith("is none of our grounders")
