"""Writes descriptions for generated episodes that `rules` reads back: by templates, or by a language model.

Objects with their owners -> paragraph -> phrases -> the same pairs of owner and object, or the paragraph is refused.
"""

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from sim.authoring.descriptions import OwnedItem, write_description
from sim.errors import AgentError
from sim.words.english import with_article

from ..chat.answers import said_in
from ..chat.protocol import Chat, NoAnswer, NoWords
from ..encoders.hashed import STOP_WORDS
from .ownership_text import parse_phrase
from .rules import phrases_in

PROMPT = """You write one paragraph about a home that says who owns what. You get the floor and a list of objects.
Say the floor once. Name every object with all the words that the list gives it, say in which room it is, and name all
of its owners and nobody else. Vary the sentences: some begin with the person, some with the object or the room. Use
"owns", "belongs to" or "is shared by" so that it is always clear who owns which object. Add no other facts, people or
objects. Answer with the paragraph and nothing else."""
ANSWERS = 3
"""Answers of the model that are tried for one description before templates write it."""
_TEMPLATE_TRIES = 20
_SAME = 0.5
"""A phrase means the object with which it shares the most words, if that is at least this much (F1)."""
_MOST_WORDS = 600
"""An answer with more words is no paragraph; the longest released one has 245."""


class Describer:
    """Writes the paragraph of one episode after the other (`sim.authoring.descriptions.Describe`), and counts how."""

    def __init__(self, chat: Chat | None = None) -> None:
        """Describes by templates, or with `chat` by a language model where its answers are read back."""
        self.counts: Counter[str] = Counter()
        """Paragraphs by `templates` and by `llm`; `llm refused` = answers that were not read back."""
        self._chat = chat

    def __call__(self, items: Sequence[OwnedItem], *, floor: str, rng: np.random.Generator) -> str | None:
        """A paragraph that is read back; None where the rules read no template with these words.

        Raises:
            AgentError: The model gives no answer.
        """
        text = self._asked(items, floor) if self._chat is not None else None
        if text is not None:
            self.counts["llm"] += 1
            return text
        for _ in range(_TEMPLATE_TRIES):
            text = write_description(items, floor=floor, rng=rng)
            if not misread(text, items):
                self.counts["templates"] += 1
                return text
        return None

    def _asked(self, items: Sequence[OwnedItem], floor: str) -> str | None:
        """The model's first answer that is read back; None after ANSWERS others."""
        parts = [_facts(items, floor)]
        for _ in range(ANSWERS):
            answer = self._answer(parts)
            problem = misread(answer, items) if len(answer.split()) <= _MOST_WORDS else "it is no single paragraph"
            if not problem:
                return answer
            self.counts["llm refused"] += 1
            parts += [f"You wrote: {answer}", f"That was refused: {problem}. Write the whole paragraph again."]
        return None

    def _answer(self, parts: Sequence[str]) -> str:
        """One answer as one line; the same seed asks the same questions, and so gives the same episodes."""
        assert self._chat is not None
        try:
            answer = self._chat.ask(PROMPT, parts)
        except NoWords:
            return ""
        except NoAnswer as error:
            raise AgentError(
                f"--llm-url: model {self._chat.name!r} gave no answer ({error}); expected a paragraph. Start the "
                "server, or use --describe templates."
            ) from None
        return " ".join(said_in(answer).strip('`"').split())


def misread(text: str, items: Sequence[OwnedItem]) -> str:
    """How the pairs that `rules` reads from a paragraph differ from the true ones, in words; empty where they agree."""
    people = dict.fromkeys(owner for item in items for owner in item.owners)
    words = [_words(f"{item.phrase} {item.room}") for item in items]
    wanted = {(owner, index) for index, item in enumerate(items) for owner in item.owners}
    found: set[tuple[str, int]] = set()
    for phrase in phrases_in(text, also=tuple(people)):
        thing = parse_phrase(phrase)
        index = _meant(_words(thing.text), words)
        if index is None:
            return f"{phrase!r} is about none of the objects, or about several"
        found.add((thing.owner, index))
    for owner, index in sorted(wanted - found):
        return f"it does not say that {owner} owns the {items[index].phrase}"
    for owner, index in sorted(found - wanted):
        return f"it says that {owner} owns the {items[index].phrase}"
    return ""


def _meant(words: frozenset[str], objects: Sequence[frozenset[str]]) -> int | None:
    """Index of the object that shares the most words; None where none shares enough, or two share as many."""
    scores = [2 * len(words & other) / max(1, len(words) + len(other)) for other in objects]
    best = int(np.argmax(scores))
    return best if scores[best] >= _SAME and scores.count(scores[best]) == 1 else None


def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", text.lower())) - STOP_WORDS


def _facts(items: Sequence[OwnedItem], floor: str) -> str:
    """The list that the model gets."""
    lines = [f"- {' and '.join(item.owners)}: {with_article(item.phrase)}, in the {item.room}" for item in items]
    return "\n".join([f"Floor: {floor}", "Owners and objects:", *lines])
