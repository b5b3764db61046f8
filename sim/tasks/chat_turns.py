"""Prompts and answers of a chat model in a run folder: `chat.jsonl`, and the pictures once each as `chat/<sha256>.png`.

A worker's `Transcript` travels with the episode's result; `RunWriter` appends it before the episode's own line.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import RunFileError, line_from_validation_error
from sim.files import bounded_lines
from sim.types import EpisodeKey, Split

CHAT_FILE = "chat.jsonl"
_MODEL = ConfigDict(frozen=True, extra="forbid")
_Count = Annotated[int, Field(ge=0)]


class TextPart(BaseModel):
    """Words of a prompt."""

    model_config = _MODEL
    text: str


class PicturePart(BaseModel):
    """A picture of a prompt, as it was sent."""

    model_config = _MODEL
    picture: str = Field(pattern=r"^chat/[0-9a-f]{64}\.png$")
    """Its file in the run folder."""


class ChatTurn(BaseModel):
    """One question to a chat model and its answer; one line of `chat.jsonl`."""

    model_config = _MODEL
    kind: Literal["chat"] = "chat"
    schema_version: Literal[1] = 1
    split: Split
    scene: str
    episode_id: str
    call: int = Field(ge=1)
    """Number of the question within its episode."""
    model: str
    system: str
    parts: tuple[TextPart | PicturePart, ...]
    answer: str = ""
    """The model's words; "" = none came."""
    problem: str = ""
    """Why no answer came, or why an agent could not use it; "" for an answer that was used."""
    cached: bool = False
    """Whether the answer was kept from an earlier question, and so cost nothing."""
    prompt_tokens: _Count = 0
    completion_tokens: _Count = 0
    """Tokens as the server counted them; 0 for kept answers and where it does not count."""
    retries: _Count = 0
    """Requests after the first."""

    @property
    def key(self) -> EpisodeKey:
        """The episode."""
        return EpisodeKey(self.split, self.scene, self.episode_id)


@dataclass(frozen=True, slots=True)
class Transcript:
    """All that was asked for one or more episodes."""

    turns: tuple[ChatTurn, ...] = ()
    pictures: Mapping[str, bytes] = field(default_factory=dict[str, bytes])
    """PNG files by the name in `PicturePart`. A picture that the same process sent with an earlier transcript may be
    missing."""

    @classmethod
    def joined(cls, parts: Iterable["Transcript"]) -> "Transcript":
        """One transcript of several, in order."""
        found = tuple(parts)
        pictures = {name: png for part in found for name, png in part.pictures.items()}
        return cls(tuple(turn for part in found for turn in part.turns), pictures)


NO_CHAT = Transcript()
"""For episodes without a chat model."""


def picture_name(png: bytes) -> str:
    """The name of a picture in a run folder."""
    return f"chat/{hashlib.sha256(png).hexdigest()}.png"


def read_turns(folder: Path) -> Iterator[ChatTurn]:
    """The turns of a run folder in order; none for a run without a chat model.

    Raises:
        RunFileError: The file is damaged.
    """
    path = folder / CHAT_FILE
    if not path.is_file():
        return
    try:
        for number, line in enumerate(bounded_lines(path), start=1):
            yield turn_from_line(line, where=f"{path}:{number}")
    except OSError as error:
        raise RunFileError(f"{path}: cannot be read ({error}); expected JSON lines. Check the path.") from None


def turn_from_line(line: bytes, *, where: str) -> ChatTurn:
    """The turn of one line; raises RunFileError, which begins with `where`, for a damaged one."""
    try:
        return ChatTurn.model_validate_json(line)
    except ValidationError as error:
        advice = "Delete the line: results do not depend on it."
        raise RunFileError(line_from_validation_error(where, error, advice=advice)) from None
