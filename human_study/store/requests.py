"""A researcher's changes to a study, even while another process serves it, through files in the study's folder.

`change_study` writes into `requests/` and waits; the serving process calls `take_requests` now and then. A file is
`ID.json` (asked), `ID.taken` (being done) and `ID.done` (the answer: empty, or the refusal), and then it is removed.
"""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import StudyError, line_from_validation_error

from ..design.plan import load_plan
from ..design.secrets import new_id
from ..design.study import load_study
from ..private_files import write_private
from .lock import StudyInUseError
from .store import StudyStore, open_store

REQUEST_FOLDER = "requests"
WAIT_S = 60.0
"""Longest wait for an answer; the serving process looks every 15 s."""
_LOOK_EVERY_S = 0.1
_MODEL = ConfigDict(frozen=True, extra="forbid")


class Withdrawal(BaseModel):
    """A participant asked the researcher to withdraw."""

    model_config = _MODEL
    kind: Literal["withdrawal"] = "withdrawal"
    participant: str


class Exclusion(BaseModel):
    """A rule leaves a trial or a participant out of the figures."""

    model_config = _MODEL
    kind: Literal["exclusion"] = "exclusion"
    target_kind: Literal["trial", "participant"]
    target: str
    """Trial id or participant code."""
    rule_id: str
    reason: str


class UndoneExclusion(BaseModel):
    """An exclusion is taken back."""

    model_config = _MODEL
    kind: Literal["undone"] = "undone"
    exclusion_id: str


Change = Annotated[Withdrawal | Exclusion | UndoneExclusion, Field(discriminator="kind")]


class _Request(BaseModel):
    model_config = _MODEL
    changes: tuple[Change, ...]


def change_study(folder: Path, changes: Sequence[Change], *, wait_s: float = WAIT_S) -> None:
    """Makes changes to a study, through the serving process if there is one. They are on disk when this returns.

    Raises:
        StudyError: A change is refused, or another process has the study open and does not answer within `wait_s`.
    """
    config = load_study(folder)
    try:
        with open_store(folder, config, load_plan(folder, config)) as store:
            _apply(store, changes)
    except StudyInUseError as in_use:
        _ask(folder, changes, in_use, wait_s)


def take_requests(store: StudyStore) -> list[str]:
    """Does the requested changes to a study that this process serves; returns a line per request for the terminal.

    Raises:
        StudyError: An answer cannot be written; the request is done again the next time.
    """
    folder = store.folder / REQUEST_FOLDER
    told = []
    for path in sorted([*folder.glob("*.json"), *folder.glob("*.taken")]):
        taken = path.with_suffix(".taken")
        try:
            os.replace(path, taken)
        except FileNotFoundError:
            continue  # the other process stopped waiting
        try:
            request = _Request.model_validate_json(taken.read_bytes(), strict=True)
            _apply(store, request.changes)
            answer, line = "", f"done as asked from outside: {', '.join(map(_described, request.changes))}"
        except ValidationError as error:
            answer = line = line_from_validation_error(path, error, advice="Ask with this version of personal-viz.")
        except StudyError as error:
            answer = line = str(error)
        write_private(path.with_suffix(".done"), answer)
        taken.unlink()
        told.append(line)
    return told


def _apply(store: StudyStore, changes: Sequence[Change]) -> None:
    for change in changes:
        match change:
            case Withdrawal():
                store.withdraw(change.participant)
            case Exclusion():
                store.exclude(change.target_kind, change.target, rule_id=change.rule_id, reason=change.reason)
            case UndoneExclusion():
                store.undo_exclusion(change.exclusion_id)


def _described(change: Change) -> str:
    match change:
        case Withdrawal():
            return f"{change.participant} has withdrawn"
        case Exclusion():
            return f"rule {change.rule_id} leaves {change.target_kind} {change.target} out"
        case UndoneExclusion():
            return f"exclusion {change.exclusion_id} is undone"


def _ask(folder: Path, changes: Sequence[Change], in_use: StudyInUseError, wait_s: float) -> None:
    """Leaves a request and waits for its answer."""
    asked = folder / REQUEST_FOLDER / f"{new_id()}.json"
    try:
        asked.parent.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise StudyError(
            f"{asked.parent}: cannot be made ({error.strerror}); expected a folder that you can write. "
            "Give the command as the user who serves the study."
        ) from None
    write_private(asked, _Request(changes=tuple(changes)).model_dump_json())
    if not _is_answered(asked, wait_s):
        try:
            asked.unlink()
        except FileNotFoundError:  # it was taken at the last moment
            if _is_answered(asked, wait_s):
                return
            raise StudyError(
                f"{asked.with_suffix('.taken')}: process {in_use.holder} has begun with the request and not answered "
                f"in {wait_s:g} s; expected an answer. Look at its terminal, and at study status, before you ask again."
            ) from None
        raise StudyError(
            f"{folder}: process {in_use.holder} has the study open and has not taken the request up in {wait_s:g} s; "
            "expected a process of study serve. Nothing was changed: let that process end, or end it with Ctrl-C, and "
            "give the command again."
        )


def _is_answered(asked: Path, wait_s: float) -> bool:
    """Whether the answer came in time. Raises StudyError if it is a refusal."""
    done = asked.with_suffix(".done")
    end_s = time.monotonic() + wait_s
    while not done.exists():
        if time.monotonic() >= end_s:
            return False
        time.sleep(_LOOK_EVERY_S)
    refusal = done.read_text(encoding="utf-8")
    done.unlink()
    if refusal:
        raise StudyError(refusal)
    return True
