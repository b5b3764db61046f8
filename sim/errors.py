"""The tree of errors that users can meet; each message says where, what was found, what was expected, what to do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError

_MOST_PROBLEMS = 2000
"""A pydantic error with more problems than this is not searched for the first one."""


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


def line_from_validation_error(where: str | Path, error: ValidationError, *, advice: str) -> str:
    """The first problem of a pydantic error as one line: where, field, what was found, what was expected, what to do.

    Args:
        where: File (and line) with the bad value.
        error: The error that pydantic raised.
        advice: Advice to the reader, a full sentence.
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
    return f"{where}: {field} is {found}; expected: {expected}{more}. {advice}"
