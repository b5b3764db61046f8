"""What an agent that sees looks for, in words: the query, the phrase that the description has for it, or a caption."""

from collections.abc import Callable
from typing import Literal

from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.types import Task

from ..encoders.hashed import HashedWords
from ..phrases.ownership_text import asked_thing, parse_query
from ..phrases.sources import PhraseSource

GoalText = Literal["phrase", "query", "caption"]
"""`phrase` = "red chair", as the description names what the query asks for; `query` = "Find Mira's chair"; `caption` =
the target's caption, which the authors' runs gave their agents. That is ground truth: allowed where it is asked for by
name, and printed in every row."""


def goal_text(kind: GoalText, episode: Episode, phrases: PhraseSource) -> Callable[[Task], str]:
    """The function that turns a task into the text to look for; `episode` is read for `caption` only.

    Raises:
        AgentError: The target has no caption.
    """
    if kind == "caption":
        caption = first_caption(episode)
        return lambda task: caption
    if kind == "query":
        return lambda task: task.queries[0]
    return lambda task: described_thing(task, phrases)


def first_caption(episode: Episode) -> str:
    """The first caption of the first target: ground truth.

    Raises:
        AgentError: It has none.
    """
    captions = episode.record.captions_per_object[0]
    if not captions:
        raise AgentError(
            f"{episode.key}: the target has no caption; expected one for --goal-text caption. Use phrase or query."
        )
    return captions[0]


def described_thing(task: Task, phrases: PhraseSource) -> str:
    """The thing that the query means as the description has it, without owner, article and room.

    The query's category where the phrases hold nothing of the owner's, and the query where it names no category.
    """
    query = task.queries[0]
    asked = asked_thing(phrases.phrases(task), query, HashedWords())
    if asked is not None:
        return asked.things[asked.chosen].thing
    wanted = parse_query(query)
    return query if wanted is None else wanted.category
