"""The tree of errors that users can meet; each message says where, what was found, what was expected, what to do."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

_MOST_PROBLEMS = 2000
"""A pydantic error with more problems than this is not searched for the first one."""
_LONGEST_NAME = 100
"""Characters of a wrong name that are compared with the known ones."""


class PersonalVizError(Exception):
    """Base of every error that the command line prints as one line with exit code 1."""


class DatasetError(PersonalVizError):
    """An episode file is missing, damaged or not in the PersONAL format."""


class SceneError(PersonalVizError):
    """A scene file is missing, damaged or cannot be used (no faces, unknown scene)."""


class NoFloorError(SceneError):
    """A scene in which the robot can stand nowhere."""


class TaskStateError(PersonalVizError):
    """An action or answer came when the task could not take it (after the end, before the start)."""


class AgentError(PersonalVizError):
    """A plug-in (agent, grounder, encoder) raised or broke its contract."""


class RunFileError(PersonalVizError):
    """A run file is damaged, holds impossible steps, or lacks something that was asked for."""


class StudyError(PersonalVizError):
    """A study is misconfigured, locked by another process, or its store cannot be used."""


class RecordingError(PersonalVizError):
    """A recording cannot be written or read."""


class MissingDependencyError(PersonalVizError, ImportError):
    """An optional package is needed; the message names it and the extra that brings it."""


def short(value: object, *, most: int = 60) -> str:
    """`repr` of a value, cut to fit in an error line."""
    text = repr(value)
    return text if len(text) <= most else text[: most - 3] + "..."


def did_you_mean(found: object, known: Iterable[object]) -> str:
    """A sentence with the known name that is most like the one found, after a space; "" where none is alike.

    Capitals and dashes in front do not count: `Easy` is like `easy`, and `--scene` unlike `--json`.
    """
    names = {str(name).lstrip("-").casefold(): str(name) for name in known}
    alike = difflib.get_close_matches(str(found)[:_LONGEST_NAME].lstrip("-").casefold(), names, n=1)
    return f" Did you mean {names[alike[0]]!r}?" if alike else ""


def line_from_validation_error(
    where: str | Path, error: ValidationError, *, advice: str, model: type[BaseModel] | None = None
) -> str:
    """The first problem of a pydantic error as one line: where, field, what was found, what was expected, what to do.

    Args:
        where: File (and line) with the bad value.
        error: The error that pydantic raised.
        advice: Advice to the reader, a full sentence.
        model: The model that raised it, where a person writes its fields: for a field that it lacks, the line names
            the most similar one.
    """
    if error.error_count() > _MOST_PROBLEMS:  # looking at all of them would take a kilobyte each
        return (
            f"{where}: found {error.error_count()} values that do not fit; expected the fields of its format. {advice}"
        )
    first = error.errors()[0]
    field = ".".join(str(part) for part in first["loc"]) or "(top level)"
    found = "nothing" if first["type"] == "missing" else short(first["input"], most=80)
    expected = first["msg"]
    if first["type"] == "json_invalid":
        found, expected = f"text that is not JSON ({first.get('ctx', {}).get('error', expected)})", "whole JSON"
    more = f" (and {error.error_count() - 1} more problems)" if error.error_count() > 1 else ""
    meant = ""
    if first["type"] == "literal_error":
        meant = did_you_mean(first["input"], re.findall(r"'([^']*)'", first.get("ctx", {}).get("expected", "")))
    elif first["type"] == "extra_forbidden" and model is not None:
        meant = did_you_mean(first["loc"][-1], _fields_beside(model, first["loc"]))
    return f"{where}: {field} is {found}; expected: {expected}{more}.{meant} {advice}"


def _fields_beside(model: Any, place: tuple[int | str, ...]) -> Iterable[str]:
    """Names of the fields that could stand at a place in a model; none where the place leads through other types."""
    for part in place[:-1]:
        kind = getattr(model, "model_fields", {}).get(part)
        kinds = () if kind is None else (kind.annotation, *get_args(kind.annotation))
        model = next((inner for inner in kinds if hasattr(inner, "model_fields")), None)
    return getattr(model, "model_fields", ())
