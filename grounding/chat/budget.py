"""What a run spends on a chat model, and the most that it may spend.

One small file in the run folder, `chat_usage.json`, which all worker processes of the run and all later calls that
continue it add to; `chat_usage.lock` beside it keeps them apart.
"""

import fcntl
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import AgentError, RunFileError
from sim.files import write_whole

USAGE_FILE = "chat_usage.json"
_MILLION = 1e6
_Count = Annotated[int, Field(ge=0)]


class ChatUsage(BaseModel):
    """Sums over questions."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    calls: _Count = 0
    """Questions that were sent to the server, also those that it did not answer."""
    cached: _Count = 0
    """Questions whose kept answer was taken; they cost nothing."""
    no_answer: _Count = 0
    """Questions that got no answer."""
    retries: _Count = 0
    """Requests after the first for one question."""
    prompt_tokens: _Count = 0
    completion_tokens: _Count = 0
    """As the server counts them."""

    def __add__(self, other: "ChatUsage") -> "ChatUsage":
        names = type(self).model_fields
        return ChatUsage(**{name: getattr(self, name) + getattr(other, name) for name in names})

    @property
    def tokens(self) -> int:
        """Tokens of prompts and answers."""
        return self.prompt_tokens + self.completion_tokens

    def cost(self, price: tuple[float, float]) -> float:
        """Money for all tokens.

        Args:
            price: For a million tokens of prompts, and for a million tokens of answers.
        """
        return (self.prompt_tokens * price[0] + self.completion_tokens * price[1]) / _MILLION


@dataclass(frozen=True, slots=True)
class Budget:
    """The usage of one run, and its limits."""

    folder: Path
    """The run folder."""
    max_calls: int | None = None
    """Most calls of the run; None = no limit."""
    max_tokens: int | None = None
    """Most tokens of the run; None = no limit. Questions that are on their way may go over it."""

    @property
    def file(self) -> Path:
        """The file that holds the usage."""
        return self.folder / USAGE_FILE

    def used(self) -> ChatUsage:
        """The usage so far; zero for a new run.

        Raises:
            RunFileError: The file is damaged.
        """
        return self._change(ChatUsage())

    def add(self, more: ChatUsage) -> None:
        """Adds to the usage.

        Raises:
            RunFileError: The file is damaged or cannot be written.
        """
        self._change(more)

    def take_call(self) -> None:
        """Counts one call before it is sent.

        Raises:
            AgentError: The budget is spent.
            RunFileError: The file is damaged or cannot be written.
        """
        self._change(ChatUsage(calls=1), is_limited=True)

    def _change(self, more: ChatUsage, *, is_limited: bool = False) -> ChatUsage:
        """Adds to the file under a lock; returns the new sums."""
        try:
            if more == ChatUsage():
                return self._read()
            self.folder.mkdir(parents=True, exist_ok=True)
            with self.file.with_suffix(".lock").open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                used = self._read()
                if is_limited:
                    self._require_left(used)
                write_whole(self.file, (used + more).model_dump_json() + "\n")
                return used + more
        except OSError as error:
            raise RunFileError(
                f"{self.file}: cannot be written ({error}); expected the run's folder. Give "
                "another --out, or make room."
            ) from None

    def _read(self) -> ChatUsage:
        if not self.file.exists():
            return ChatUsage()
        text = self.file.read_bytes()
        try:
            return ChatUsage.model_validate_json(text)
        except ValidationError:
            raise RunFileError(
                f"{self.file}: found {text[:60]!r}; expected the run's chat usage. Delete the file to count from zero."
            ) from None

    def _require_left(self, used: ChatUsage) -> None:
        for option, spent, most in (
            ("--max-calls", used.calls, self.max_calls),
            ("--max-tokens", used.tokens, self.max_tokens),
        ):
            if most is not None and spent >= most:
                raise AgentError(
                    f"{option}: the run has used {spent} of {most}; expected some left for the next question. What is "
                    f"done is kept in {self.folder}: run the same command with a larger {option} to go on."
                )
