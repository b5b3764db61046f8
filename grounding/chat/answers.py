"""Reads the JSON that a chat model was asked for out of its words."""

import re
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from .protocol import NoAnswer

Wanted = TypeVar("Wanted", bound=BaseModel)


def read_answer(answer: str, wanted: type[Wanted]) -> Wanted:
    """The answer as a value of `wanted`; code fences and thoughts around the JSON are ignored.

    Raises:
        NoAnswer: There is no such JSON.
    """
    said = said_in(answer)
    found = re.search(r"\{.*\}", said, re.DOTALL)
    try:
        return wanted.model_validate_json(found[0] if found else said)
    except ValidationError as error:
        raise NoAnswer(f"the answer is not the JSON asked for: {error.errors()[0]['msg']}") from None


def said_in(answer: str) -> str:
    """An answer without the model's reasoning before it; some servers send only the end of its mark."""
    return answer.rpartition("</think>")[2].strip()
