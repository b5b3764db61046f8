"""POG in a home sequence: what is told when, right, wrong and no answers, all objects, and the object that was right
before."""

from dataclasses import replace
from pathlib import Path

import pytest

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Vector3
from sim.episodes.sequence_files import HomeSequence, sequence_from_episode
from sim.homes.open_home import open_scene
from sim.sequences.figures import sequence_figures
from sim.sequences.pointing import PointSearches
from sim.sequences.runs import SearchEnd, SequenceRun
from sim.sequences.searches import prompts_of
from sim.tasks.pan import PanEnv
from sim.tasks.rules import scene_storeys, score_answer
from sim.types import Action

from .home_story import MESSAGES, SCENE, SUBTASKS, told_in

NOWHERE = (500.0, 0.0, 500.0)


@pytest.fixture(scope="module")
def dataset(small_home_root: Path) -> PersonalDataset:
    return PersonalDataset(small_home_root)


@pytest.fixture(scope="module")
def story(small_home_root: Path, tmp_path_factory: pytest.TempPathFactory) -> HomeSequence:
    return told_in(small_home_root, tmp_path_factory.mktemp("set"), messages=MESSAGES, subtasks=SUBTASKS)


@pytest.fixture
def storeys(dataset: PersonalDataset) -> list[tuple[float, float]]:
    return scene_storeys(dataset.goals(SCENE).values())


@pytest.fixture
def searches(story: HomeSequence, storeys: list[tuple[float, float]]) -> PointSearches:
    return PointSearches(story, storeys=storeys)


def place(story: HomeSequence, name: str) -> Vector3:
    """Where an object is."""
    return next(goal.position for goal in story.goals if goal.object_name == name)


def answered(searches: PointSearches, story: HomeSequence, *answers: list[str | Vector3]) -> SequenceRun:
    """The run in which these are the answers, points or names of objects; where none is left nobody answers."""
    for points in answers:
        searches.answer([place(story, point) if isinstance(point, str) else point for point in points])
    while not searches.is_over:
        searches.answer(())
    return searches.run()


def test_message_and_query_are_those_of_observations(
    dataset: PersonalDataset, story: HomeSequence, searches: PointSearches
) -> None:
    navigation = open_scene(dataset, SCENE).navigation
    env = PanEnv(story.start, navigation, renderer=None, prompts=prompts_of(story))
    observation = env.reset()
    for search in range(6):
        assert (searches.message, searches.query, searches.index) == (observation.message, observation.query, search)
        searches.answer(())
        for _ in range(2 if search == 1 else 1):  # all are wanted
            observation = env.step(Action.FOUND)
    assert env.is_over
    assert searches.is_over


def test_a_task_tells_what_was_told_so_far_and_nothing_of_later_searches(
    story: HomeSequence, searches: PointSearches
) -> None:
    told = [message["text"] for message in MESSAGES]
    numbers = (1, 1, 2, 3, 3, 3)
    for search, number in enumerate(numbers):
        task = searches.task
        assert (task.kind, task.description) == ("pog", "\n".join(told[:number]))
        assert task.queries == (SUBTASKS[search]["query"][0],)
        assert [(news.text, news.searches_ago) for news in task.news] == [
            (told[1], search - 2),
            (told[2], search - 3),
        ][: number - 1]
        assert searches.is_for_all == (search == 1)
        searches.answer([NOWHERE])


def test_where_messages_are_ignored_only_the_intro_is_told(
    story: HomeSequence, storeys: list[tuple[float, float]]
) -> None:
    searches = PointSearches(story, storeys=storeys, ignores_messages=True, query_index=1)
    for subtask in SUBTASKS:
        assert (searches.message, searches.query) == (None, subtask["query"][1])
        assert (searches.task.description, searches.task.news) == (MESSAGES[0]["text"], ())
        searches.answer(())


RIGHT = [["towel_7"], ["armchair_50", "armchair_35"], ["armchair_50"], ["bed_46"], ["towel_7"], ["armchair_35"]]


def test_right_answers_have_the_known_figures(story: HomeSequence, searches: PointSearches) -> None:
    run = answered(searches, story, *RIGHT)
    assert [search.succeeds("paper") for search in run.end.searches] == 6 * [True]
    assert [search.reason for search in run.end.searches] == 6 * ["found"]
    figures = sequence_figures([run])
    assert (figures.sr, figures.composite, figures.csr, figures.progress) == (1, 1, 1, 1)
    assert (figures.sr_fresh, figures.sr_revisit, figures.sr_changed, figures.sr_stale) == (1, 1, 1, 1)
    assert (figures.stale, figures.lag, figures.recall, figures.precision) == (0, 0, 1, 1)
    assert (figures.spl, figures.ppl, figures.cgt, figures.steps, figures.dtg) == 5 * (None,)
    assert SequenceRun.model_validate_json(run.model_dump_json()) == run


def test_answers_of_somebody_who_knows_the_intro_alone(story: HomeSequence, searches: PointSearches) -> None:
    run = answered(searches, story, *RIGHT[:2], ["armchair_35"], ["bed_11"], ["towel_7"], ["bed_46"])
    figures = sequence_figures([run])
    assert (figures.sr_fresh, figures.sr_revisit, figures.sr_changed, figures.sr_stale) == (1, 1, 0, 0)
    assert [search.is_at_old for search in run.end.searches] == [None, None, True, True, None, None]
    assert (figures.stale, figures.progress, figures.composite) == (1, 2 / 6, 0)


def test_the_first_point_counts_and_a_later_right_one_is_among_the_first_three(
    story: HomeSequence, searches: PointSearches
) -> None:
    second, old = [NOWHERE, "towel_7"], [NOWHERE, "armchair_35", "armchair_50"]
    first, _, stale, *_ = answered(searches, story, second, [], old).end.searches
    assert (first.succeeds("paper"), first.reason) == (False, "found")
    assert first.answer is not None
    assert first.answer.top3_success
    assert first.points == (NOWHERE, place(story, "towel_7"))
    assert (stale.succeeds("paper"), stale.is_at_old) == (False, False), "a second point is at the old one"


def test_giving_up_is_wrong_and_not_at_the_old_object(story: HomeSequence, searches: PointSearches) -> None:
    run = answered(searches, story)
    assert {search.reason for search in run.end.searches} == {"giveup"}
    figures = sequence_figures([run])
    assert (figures.sr, figures.stale, figures.recall, figures.precision, figures.top3) == (0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("points", "recall", "precision"),
    [
        (["armchair_35", "armchair_50"], 1, 1),
        (["armchair_50"], 0.5, 1),
        (["armchair_50", "armchair_50"], 0.5, 0.5),
        (["armchair_50", NOWHERE, "armchair_35"], 1, 2 / 3),
        ([NOWHERE, "towel_7"], 0, 0),
        ([], 0, 0),
    ],
)
def test_where_all_are_wanted_each_object_counts_once(
    story: HomeSequence, searches: PointSearches, points: list[str | Vector3], recall: float, precision: float
) -> None:
    end = answered(searches, story, [], points).end.searches[1]
    assert end.all is not None
    assert (end.all.recall, end.all.precision) == pytest.approx((recall, precision))
    assert end.succeeds("paper") == (recall == precision == 1)


def test_where_all_are_wanted_any_mark_may_be_at_the_old_object(
    small_home_root: Path, storeys: list[tuple[float, float]], tmp_path: Path
) -> None:
    ends = {}
    story = told_in(small_home_root, tmp_path, messages=MESSAGES[:2], subtasks=all_after_a_gift())
    for marks in (["armchair_50", "armchair_35"], ["armchair_50"]):
        run = answered(PointSearches(story, storeys=storeys), story, [], [], marks)
        ends[len(marks)] = run.end.searches[2]
    assert (ends[2].is_at_old, ends[2].succeeds("paper")) == (True, False)
    assert (ends[1].is_at_old, ends[1].succeeds("paper")) == (False, True)


def all_after_a_gift() -> list[dict]:
    """The story up to the gift, with the search after it for all objects, which are one."""
    return [*SUBTASKS[:2], {**SUBTASKS[2], "mode": "all"}]


def test_one_search_has_the_measures_of_its_episode(
    dataset: PersonalDataset, story: HomeSequence, storeys: list[tuple[float, float]]
) -> None:
    for episode in list(dataset.episodes())[::7]:
        sequence = replace(
            story, record=sequence_from_episode(episode), targets=(episode.targets,), goals=episode.targets
        )
        points = (episode.targets[-1].position, NOWHERE)
        searches = PointSearches(sequence, storeys=storeys)
        assert searches.task == episode.task("pog")
        searches.answer(points)
        (end,) = searches.run().end.searches
        assert end.answer == score_answer(episode, points, storeys=storeys)
        assert isinstance(end, SearchEnd)
        assert (end.succeeds("paper"), end.kind, end.is_at_old) == (True, "fresh", None)
