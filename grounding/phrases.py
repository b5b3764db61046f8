"""Where a grounder's phrases ("X owns Y in Z") come from. The source's name is printed in every row of results."""

from collections.abc import Iterable
from typing import Protocol

from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.types import Task


class PhraseSource(Protocol):
    """Short phrases of who owns what, taken from a task."""

    @property
    def name(self) -> str:
        """Printed beside every result."""
        ...

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The phrases of the task's description, each once, in order; may be empty."""
        ...


class DatasetPhrases:
    """The dataset's own `extracted_summary`: ground truth, allowed for grounding only (DESIGN.md)."""

    name = "dataset"

    def __init__(self, episodes: Iterable[Episode]) -> None:
        """Knows the phrases of these episodes' tasks."""
        self._phrases = {
            (episode.record.summary, query): tuple(dict.fromkeys(episode.record.extracted_summary))
            for episode in episodes
            for query in episode.record.query
        }

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The stored phrases of the episode that the task is of.

        Raises:
            AgentError: The task is of none of the episodes.
        """
        try:
            return self._phrases[(task.description, task.queries[0])]
        except KeyError:
            raise AgentError(
                f"phrases: found no episode with query {task.queries[0]!r} and this description; expected a task of "
                "the episodes given. Build DatasetPhrases from the task's own scene."
            ) from None
