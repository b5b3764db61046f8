"""What agents that see look for: the description's words, the query, or the caption, which is ground truth."""

import dataclasses
from pathlib import Path

import pytest

from grounding.agents.goal_text import GoalText, described_thing, goal_text
from grounding.phrases.rules import RulePhrases
from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.types import Task

DESCRIPTION = (
    "In the hall, Ada owns a red lamp near the door. In the den, Ada owns an old leather chair. "
    "In the den, Bo owns a blue chair."
)


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("Find Ada's chair", "old leather chair"),
        ("Where is Ada's lamp?", "red lamp near the door"),
        ("Find Bo's chair", "blue chair"),
        ("Find Cy's chest of drawers", "chest of drawers"),
        ("Find the red lamp", "Find the red lamp"),
    ],
    ids=["of two things", "another wording", "of two owners", "nothing of the owner's", "no owner"],
)
def test_the_thing_that_the_query_means_has_the_words_of_the_description(query: str, expected: str) -> None:
    assert described_thing(Task("pan", DESCRIPTION, (query,)), RulePhrases()) == expected


@pytest.fixture
def episode(small_root: Path) -> Episode:
    """The search for Ada's table, whose caption the description repeats."""
    return next(PersonalDataset(small_root).episodes(scenes=("HomeOne",), splits=("easy",)))


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("phrase", "red desk"), ("query", "Find Ada's table"), ("caption", "low oak table with a green bowl")],
)
def test_only_the_caption_is_taken_from_the_episode(kind: GoalText, expected: str, episode: Episode) -> None:
    told = Task("pan", "In the hall, Ada owns a red desk.", ("Find Ada's table",))
    assert goal_text(kind, episode, RulePhrases())(told) == expected


def test_a_target_without_a_caption_has_no_caption_to_look_for(episode: Episode) -> None:
    record = episode.record.model_copy(update={"captions": ("", "", "")})
    bare = dataclasses.replace(episode, record=record)
    with pytest.raises(AgentError, match=r"the target has no caption; expected one for --goal-text caption"):
        goal_text("caption", bare, RulePhrases())
