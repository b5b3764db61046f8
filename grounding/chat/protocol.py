"""The `Chat` protocol: a model that reads words and pictures and answers in words."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Part = str | NDArray[np.uint8]
"""A text, or an (H, W, 3) picture."""


class NoAnswer(Exception):
    """No answer came: the server failed after every retry, or it refused. Its text says which.

    Callers count it and go on without the model; it never ends a run.
    """


class Chat(Protocol):
    """A chat model. Ours is `grounding.chat.endpoint`."""

    @property
    def name(self) -> str:
        """The model's name, printed beside every result."""
        ...

    def ask(self, system: str, parts: Sequence[Part]) -> str:
        """The answer to one turn of words and pictures; the same question gets the same answer.

        Raises:
            NoAnswer: None came.
            AgentError: The server refuses the key or the model and would refuse every other question too, or the
                budget of calls or tokens is spent. What was done before is kept, and a second run continues there.
        """
        ...
