"""Phrases from a chat model (`grounding.chat`).

The model gets the description of a task and nothing else. If its answer is missing or unreadable, the rules answer
instead, with a count and a warning.
"""

import re
import sys
from collections.abc import Callable

from pydantic import BaseModel, Field

from sim.types import Task

from ..chat.answers import read_answer
from ..chat.protocol import Chat, NoAnswer
from .rules import RulePhrases

PROMPT = """You read a paragraph about a home and list who owns what.
Answer with one JSON object and nothing else:
{"ownership": [{"owner": "<first name>", "object": "<object with its article and looks>", "room": "<room or empty>"}]}
One entry per owner and object: an object shared by three people gives three entries. Write names as the paragraph has
them. Describe each object as fully as the paragraph does (colour, material, what it is near), in its words. Replace
"it", "both" and "the same room" by what they stand for. Leave out objects without an owner."""


class _Owned(BaseModel):
    """One entry of an answer."""

    owner: str = Field(min_length=1)
    object: str = Field(min_length=1)
    room: str | None = None


class _Reply(BaseModel):
    """The answer that the prompt asks for; more fields are ignored."""

    ownership: tuple[_Owned, ...]


class ChatPhrases:
    """A `PhraseSource` that asks a model once per description."""

    def __init__(self, chat: Chat, *, warn: Callable[[str], None] | None = None) -> None:
        """Asks nothing yet; `warn` gets each problem in one line, by default it goes to stderr."""
        self.name = f"llm:{chat.name}"
        self.num_fallbacks = 0
        """Calls in this process that the rules answered instead; a run counts its own from its answers."""
        self.num_dropped = 0
        """Entries left out because their owner is not named in the text."""
        self._chat = chat
        self._rules = RulePhrases()
        self._warn = warn or (lambda line: print(line, file=sys.stderr, flush=True))

    def phrases(self, task: Task) -> tuple[str, ...]:
        """The model's phrases "X owns Y in the Z"; the phrases of the rules if the model gives none.

        Raises:
            AgentError: The server refuses the key or the model, or the budget is spent.
        """
        try:
            entries = read_answer(self._chat.ask(PROMPT, [task.description], is_json=True), _Reply).ownership
        except NoAnswer as error:
            return self._fall_back(task, str(error))
        known = [entry for entry in entries if _stands_in(entry.owner, task.description)]
        if len(known) < len(entries):
            self.num_dropped += len(entries) - len(known)
            strangers = sorted({entry.owner for entry in entries} - {entry.owner for entry in known})
            self._warn(f"phrases: {self.name} named owners that the text does not: {', '.join(strangers)}; left out")
        if not known:
            return self._fall_back(task, "the answer names no owner of the text")
        return tuple(dict.fromkeys(map(_sentence, known)))

    def _fall_back(self, task: Task, reason: str) -> tuple[str, ...]:
        self.num_fallbacks += 1
        self._warn(f"phrases: {self.name} gave no answer ({reason}); read by rules instead")
        return self._rules.phrases(task)


def _stands_in(owner: str, text: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(owner)}(?!\w)", text) is not None


def _sentence(entry: _Owned) -> str:
    room = re.sub(r"^(?:in\s+)?(?:the\s+)?", "", (entry.room or "").strip(), flags=re.IGNORECASE).rstrip(".")
    return f"{entry.owner} owns {entry.object.strip().rstrip('.')}" + (f" in the {room}" if room else "")
