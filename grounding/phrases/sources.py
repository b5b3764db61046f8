"""The sources of a grounder's phrases ("X owns Y in Z"). Every row of results prints the source's name."""

from collections.abc import Iterable
from typing import Protocol

from sim.episodes.schema import Episode
from sim.errors import AgentError, did_you_mean
from sim.plugins import build_plugin, is_plugin, own_name
from sim.types import Task

from ..chat.protocol import Chat

PhraseSourceName = str
"""`dataset`, `rules`, `llm`, or a user's own as `package.module:factory`."""


class PhraseSource(Protocol):
    """Finds the short phrases in a task that say who owns what. `grounding.checks.check_phrases` tests a plug-in."""

    @property
    def name(self) -> str:
        """Printed beside every result."""
        ...

    @property
    def num_fallbacks(self) -> int:
        """Number of calls so far that another source had to answer instead; the answers' files say so."""
        ...

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The phrases of the task's description, each once, in order; may be empty."""
        ...


class DatasetPhrases:
    """The dataset's own `extracted_summary`: ground truth, allowed for grounding only (DESIGN.md)."""

    name = "dataset"
    num_fallbacks = 0

    def __init__(self, episodes: Iterable[Episode]) -> None:
        """Keeps the phrases of these episodes' tasks."""
        self._phrases = {
            (episode.record.summary, query): tuple(dict.fromkeys(episode.record.extracted_summary))
            for episode in episodes
            for query in episode.record.query
        }

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The stored phrases of the task's episode.

        Raises:
            AgentError: The task belongs to none of the episodes.
        """
        try:
            return self._phrases[(task.description, task.queries[0])]
        except KeyError:
            raise AgentError(
                f"phrases: found no episode with query {task.queries[0]!r} and this description; expected a task of "
                "the episodes given. Build DatasetPhrases from the task's own scene."
            ) from None


def make_phrases(name: PhraseSourceName, *, episodes: Iterable[Episode] = (), chat: Chat | None = None) -> PhraseSource:
    """The phrase source of this name.

    Args:
        name: `dataset` knows the phrases; `rules`, `llm` and a user's own read the description.
        episodes: The episodes whose phrases `dataset` knows; the others never see an episode.
        chat: The model for `llm`.

    Raises:
        AgentError: The name is unknown, `llm` has no model, or a plug-in cannot be built.
    """
    match name:
        case "dataset":
            return DatasetPhrases(episodes)
        case "rules":
            from .rules import RulePhrases

            return RulePhrases()
        case "llm":
            if chat is None:
                raise AgentError(
                    "phrases: 'llm' has no endpoint; expected its URL and a model. Give --llm-url and --llm-model."
                )
            from .llm import ChatPhrases

            return ChatPhrases(chat)
        case _ if is_plugin(name):
            return build_plugin(name, option="--phrases", methods=("phrases",))
        case _:
            raise AgentError(
                f"--phrases is {name!r}; expected dataset, rules, llm, or your own as package.module:factory."
                f"{did_you_mean(name, ('dataset', 'rules', 'llm'))}"
            )


def phrases_called(name: PhraseSourceName) -> str:
    """The phrase source's name in runs and tables: that of the option, or the `name` of a user's own source.

    Raises:
        AgentError: The name is unknown, or the plug-in cannot be built.
    """
    return own_name(make_phrases(name), name) if name not in ("dataset", "rules", "llm") else name
