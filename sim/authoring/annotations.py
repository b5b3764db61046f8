"""Annotations of a scan's objects as a list of edits: each is one appended line, so nothing is ever overwritten.

`<dataset>/annotations/<Scene>.jsonl` -> `Edit`s -> the present objects, from which annotated.py makes goals.
"""

import fcntl
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, BinaryIO, Literal, NamedTuple, Self

from pydantic import AllowInfNan, AwareDatetime, BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.errors import DatasetError, line_from_validation_error
from sim.files import MAX_LINE_BYTES, append_whole, bounded_lines

from ..episodes.schema import LARGEST_M, NAME_PATTERN, Place

VERSION = 1
MAX_ID = 999_999
"""Largest number of an object; those of semantics end at 65,535."""
MOST_CAPTIONS = 3
"""Slots for captions in the release's episodes."""
_FOLDER = "annotations"
_MODEL = ConfigDict(frozen=True, extra="forbid")
_ADVICE = "Correct the line, or restore the file."

Extent = Annotated[float, AllowInfNan(False), Field(gt=0, le=LARGEST_M)]
Caption = Annotated[str, Field(min_length=1, max_length=400, pattern=r"^\S(?:[^\n\r]*\S)?$")]
"""One line without spaces at its ends."""


class Box(BaseModel):
    """A box along the world's axes."""

    model_config = _MODEL
    centre: Place
    """World metres, y up."""
    size: tuple[Extent, Extent, Extent]
    """Extents along world x, y and z, metres."""


class AnnotatedObject(BaseModel):
    """An object of a scan in an annotator's words."""

    model_config = _MODEL
    id: int = Field(gt=0, le=MAX_ID)
    """Its number, unique in the scene; without a box, its instance id in the scan's semantics."""
    category: str = Field(min_length=1, max_length=60, pattern=r"^[^\W_A-Z]+(?:[ '/-]{1,2}[^\W_A-Z]+)*$")
    """Lower case, singular: the word of the queries."""
    captions: tuple[Caption, ...] = Field(default=(), max_length=MOST_CAPTIONS)
    """What a person would say to tell it from others; the first one counts."""
    room: str = Field(default="", max_length=60, pattern=r"^(?:[^\W_](?:[^\n\r]*\S)?)?$")
    """Name of its room without an article; empty = not named yet."""
    storey: int = Field(default=0, ge=-3, lt=20)
    """Number of its storey; 0 is the ground floor."""
    flagged: bool = False
    """Whether people want to talk about it first; episodes do not ask for it."""
    box: Box | None = None
    """Its place; None = that of the semantics' object with this id."""

    @property
    def is_complete(self) -> bool:
        """Whether episodes can ask for it: it has a caption and a room, and is not flagged."""
        return bool(self.captions and self.room) and not self.flagged


class Edit(BaseModel):
    """One line of the file: an object before and after."""

    model_config = _MODEL
    version: Literal[1] = VERSION
    who: str = Field(min_length=1, max_length=80, pattern=r"^\S(?:[^\n\r]*\S)?$")
    """Name of the annotator."""
    utc: AwareDatetime
    """Time of the edit."""
    id: int = Field(gt=0, le=MAX_ID)
    """The object's number."""
    before: AnnotatedObject | None
    """None = the object is new."""
    after: AnnotatedObject | None
    """None = the object is removed."""
    is_undo: bool = False
    """Whether it takes back the annotator's last edit that was not taken back yet."""

    @model_validator(mode="after")
    def _is_about_one_object(self) -> Self:
        if any(item is not None and item.id != self.id for item in (self.before, self.after)):
            raise ValueError(f"the same id before and after as the edit's own, {self.id}")
        if self.before == self.after:
            raise ValueError("an edit that changes something")
        return self


class Change(NamedTuple):
    """The sum of several edits of one object."""

    id: int
    who: tuple[str, ...]
    """The annotators, each once, in order of their first edit."""
    before: AnnotatedObject | None
    after: AnnotatedObject | None


def annotation_path(dataset: Path, scene: str) -> Path:
    """The file of a scene's edits; it need not exist.

    Raises:
        DatasetError: The name cannot be that of a scene.
    """
    if not re.fullmatch(NAME_PATTERN, scene):
        raise DatasetError(
            f"scene {scene!r}: found other characters; expected 1-64 letters, digits, _ or -. Rename it."
        )
    return dataset / _FOLDER / f"{scene}.jsonl"


def annotated_scenes(dataset: Path) -> tuple[str, ...]:
    """Names of the scenes that have edits, sorted; a refused first edit leaves an empty file."""
    return tuple(sorted(path.stem for path in (dataset / _FOLDER).glob("*.jsonl") if path.stat().st_size))


def read_edits(path: Path) -> tuple[Edit, ...]:
    """All whole edits in order; () where there is no file. A last line that was cut off is ignored with a warning.

    Raises:
        DatasetError: A line is damaged, or does not start from the state that the lines above it give.
    """
    if not path.is_file():
        return ()
    with _opened(path, "rb", fcntl.LOCK_SH):
        return _read(path)[0]


def fold(edits: Sequence[Edit], *, where: str = "annotations") -> dict[int, AnnotatedObject]:
    """The objects after these edits by id, in order of their ids.

    Args:
        edits: All edits of a scene, in order.
        where: The file, for errors.

    Raises:
        DatasetError: An edit does not start from the state that those before it give.
    """
    objects: dict[int, AnnotatedObject] = {}
    for number, edit in enumerate(edits, start=1):
        _require_present(objects, edit, where=f"{where}: line {number}", advice=_ADVICE)
        _apply(objects, edit)
    return dict(sorted(objects.items()))


def append_edit(path: Path, edit: Edit) -> None:
    """Appends one edit; it is on disk when this returns. Any number of processes may append to one file.

    A last line that was cut off, by a crash or a full disk, was never acknowledged: it is removed first.

    Raises:
        DatasetError: The object is no longer as the edit's `before` says, or the file is damaged or cannot be written.
    """
    try:
        is_new = not path.exists()
        path.parent.mkdir(parents=True, exist_ok=True)
        with _opened(path, "a+b", fcntl.LOCK_EX) as file:
            edits, num_whole = _read(path)
            file.truncate(num_whole)
            objects = fold(edits, where=str(path))
            last = next((other for other in reversed(edits) if other.id == edit.id), None)
            by = f"; {last.who!r} edited it at {last.utc:%Y-%m-%d %H:%M:%S} UTC" if last else ""
            advice = f"Load object {edit.id} again, then repeat the edit"
            _require_present(objects, edit, where=f"{path}: edit of {edit.who!r}", advice=f"{advice}{by}.")
            append_whole(path, edit.model_dump_json() + "\n")
        if is_new:
            _sync_folder(path.parent)
    except OSError as error:
        raise DatasetError(
            f"{path}: cannot be written ({error.strerror}); expected a file to append to. Give another folder."
        ) from None


def undo_of(edit: Edit, *, who: str, utc: AwareDatetime) -> Edit:
    """The edit that takes this one back; `append_edit` refuses it where the object was edited since."""
    return Edit(who=who, utc=utc, id=edit.id, before=edit.after, after=edit.before, is_undo=True)


def changes_since(edits: Sequence[Edit], num_edits: int) -> tuple[Change, ...]:
    """The objects that differ from the state after the first `num_edits` edits, in order of their ids."""
    later: dict[int, list[Edit]] = {}
    for edit in edits[num_edits:]:
        later.setdefault(edit.id, []).append(edit)
    changes = (
        Change(number, tuple(dict.fromkeys(edit.who for edit in found)), found[0].before, found[-1].after)
        for number, found in sorted(later.items())
    )
    return tuple(change for change in changes if change.before != change.after)


def _apply(objects: dict[int, AnnotatedObject], edit: Edit) -> None:
    if edit.after is None:
        objects.pop(edit.id, None)
    else:
        objects[edit.id] = edit.after


def _require_present(objects: dict[int, AnnotatedObject], edit: Edit, *, where: str, advice: str) -> None:
    """Raises DatasetError where the edit does not start from the object's present state."""
    present = objects.get(edit.id)
    if present != edit.before:
        raise DatasetError(
            f"{where}: object {edit.id} is {_called(present)}; expected {_called(edit.before)}, from which the edit "
            f"starts. {advice}"
        )


def _called(item: AnnotatedObject | None) -> str:
    return "not there" if item is None else item.model_dump_json(exclude={"id"}, exclude_defaults=True)


def _read(path: Path) -> tuple[tuple[Edit, ...], int]:
    """The whole edits, whose order has been checked, and the number of their bytes."""
    edits: list[Edit] = []
    num_whole = 0
    try:
        for number, line in enumerate(bounded_lines(path), start=1):
            if not line.endswith(b"\n"):
                warnings.warn(
                    f"{path}: line {number} is cut off and was never acknowledged; it is ignored.", stacklevel=3
                )
                break
            try:
                edits.append(Edit.model_validate_json(line))
            except ValidationError as error:
                raise DatasetError(
                    line_from_validation_error(f"{path}: line {number}", error, advice=_ADVICE)
                ) from None
            num_whole += len(line)
    except OSError as error:
        raise DatasetError(
            f"{path}: cannot be read ({error}); expected lines of at most {MAX_LINE_BYTES >> 20} MB. {_ADVICE}"
        ) from None
    fold(edits, where=str(path))
    return tuple(edits), num_whole


@contextmanager
def _opened(path: Path, mode: Literal["rb", "a+b"], lock: int) -> Iterator[BinaryIO]:
    """The open file, locked against other processes until the block ends."""
    with path.open(mode) as file:
        fcntl.flock(file, lock)
        yield file


def _sync_folder(folder: Path) -> None:
    """Puts the names in a folder on disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
