"""The `Chat` protocol: a model that reads words and pictures and answers in words."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Part = str | NDArray[np.uint8]
"""A text, or an (H, W, 3) picture."""


class NoAnswer(Exception):
    """No answer came that can be read: the server failed after every retry, the model refused, or its words are
    not those asked for. Its text says which.

    Callers count it and go on without the model; it never ends a run.
    """


class NoWords(NoAnswer):
    """The server works, and the model refused or said nothing: another question may get an answer."""


class Chat(Protocol):
    """A chat model. Ours is `grounding.chat.endpoint`."""

    @property
    def name(self) -> str:
        """The model's name, printed beside every result."""
        ...

    def ask(self, system: str, parts: Sequence[Part], *, is_json: bool = False) -> str:
        """The answer to one turn of words and pictures; the same question gets the same answer.

        Args:
            system: What the model shall do.
            parts: The question.
            is_json: Whether the server shall hold the model to JSON; `system` must contain the word.

        Raises:
            NoAnswer: None came.
            AgentError: The server refuses the key or the model and would refuse every other question too, or the
                budget of calls or tokens is spent. What was done before is kept, and a second run continues there.
        """
        ...
