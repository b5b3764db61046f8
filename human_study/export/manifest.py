"""`manifest.json` of an export folder: every file with its hash, and facts about the study and its records."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.errors import StudyError, line_from_validation_error
from sim.homes.plan import HOMES_VERSION
from sim.types import TaskKind

from ..design.plan import StudyScene, facts_of_version_2
from ..store.records import StudyDates
from .rows import OPTIONAL_TABLES

MANIFEST_FILE = "manifest.json"
_MODEL = ConfigDict(frozen=True, extra="forbid")


class ExportedFile(BaseModel):
    """One file of an export."""

    model_config = _MODEL
    sha256: str
    num_bytes: int
    num_rows: int | None
    """Rows of a table, results of a run file; None for other files."""


class LeftOutTrial(BaseModel):
    """An attempt that is in the tables but in no run folder."""

    model_config = _MODEL
    attempt: str
    """Name of the attempt: participant/order_no/attempt."""
    reason: str


class Manifest(BaseModel):
    """`manifest.json`."""

    model_config = _MODEL
    schema_version: Literal[2, 3] = 3
    """Version 2 did not say anything about labels and versions of homes."""
    study: str
    study_version: str
    """sha256 of the study's choices; all hash chains begin with it."""
    plan_version: str
    is_pilot: bool
    """Whether the study was served without an ethics id."""
    dates: StudyDates | None = None
    """Days of the study as a whole; those of single people are in no file. None in exports of earlier versions."""
    plan_changes: tuple[str, ...] = ()
    """Wishes of the study file that the plan could not fulfil, each with the reason."""
    dataset_digest: str
    app_version: str
    """Version of personal-viz that took the records."""
    homes_version: int = HOMES_VERSION
    made_by: str = "the release that planned the study"
    """Both as in the study's plan."""
    tasks: tuple[TaskKind, ...]
    scenes: tuple[StudyScene, ...]
    practice_scenes: tuple[StudyScene, ...]
    """Homes of practice trials; their episodes are in the folder `practice`."""
    num_participants: int
    """Number of links with rows in the tables, used or not."""
    num_deleted: int
    """Number of people who withdrew and whose records were deleted; nothing else about them is in the export."""
    num_not_begun: int
    """Number of assigned trials that nobody opened."""
    left_out: tuple[LeftOutTrial, ...]
    """Every begun attempt that is in no run folder, with the reason."""
    head_hashes: dict[str, str]
    """Hash of each attempt's last event; together with the database it proves that nothing was changed since."""
    files: dict[str, ExportedFile] = Field(min_length=1)
    """All files except the manifest itself, by path inside the folder."""
    scene_labels: tuple[str, ...] = ()
    """Labels that results in these homes must carry; () for scans, and in exports of older programs."""
    scene_terms: tuple[str, ...] = ()
    """Terms that may apply to the homes; () for invented homes and scans, and in exports of older programs."""

    @model_validator(mode="after")
    def _read_version_2(self) -> "Manifest":
        """Reads version 2."""
        if self.schema_version == 3:
            return self
        return self.model_copy(update=facts_of_version_2(self.scenes, self.practice_scenes))


def exported_file(content: bytes, num_rows: int | None) -> ExportedFile:
    """The manifest's entry for a file."""
    return ExportedFile(sha256=hashlib.sha256(content).hexdigest(), num_bytes=len(content), num_rows=num_rows)


def read_manifest(folder: Path) -> Manifest:
    """The manifest of an export folder.

    Raises:
        StudyError: There is no manifest, or it is damaged.
    """
    path = folder / MANIFEST_FILE
    try:
        return Manifest.model_validate_json(path.read_bytes(), strict=True)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be read ({error.strerror}); expected an export. Give a folder that "
            "personal-viz study export wrote."
        ) from None
    except ValidationError as error:
        raise StudyError(line_from_validation_error(path, error, advice="Export the study again.")) from None


def require_unchanged(folder: Path, manifest: Manifest) -> dict[str, bytes]:
    """The content of every file, by path, if all files are as they were written; files that are kept apart may be gone.

    Raises:
        StudyError: A file is missing, was changed, or does not belong to the export; the message names the first one.
    """
    contents = {}
    for name, entry in manifest.files.items():
        path = folder / name
        if name.partition(".")[0] in OPTIONAL_TABLES and not path.exists():
            continue
        try:
            contents[name] = path.read_bytes()
        except OSError as error:
            raise StudyError(
                f"{path}: cannot be read ({error.strerror}); expected a file with sha256 {entry.sha256[:12]}. "
                "Export the study again."
            ) from None
        found = exported_file(contents[name], entry.num_rows)
        if found != entry:
            raise StudyError(
                f"{path}: has sha256 {found.sha256[:12]} and {found.num_bytes} bytes; expected {entry.sha256[:12]} and "
                f"{entry.num_bytes}. It was changed after the export: export the study again."
            )
    extra = sorted(strangers(folder, manifest.files))
    if extra:
        raise StudyError(f"{folder / extra[0]}: is not in {MANIFEST_FILE}; expected only exported files. Move it away.")
    return contents


def strangers(folder: Path, files: Mapping[str, ExportedFile]) -> set[str]:
    """Paths of files in the folder that an export with these files did not write."""
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}
    return found - set(files) - {MANIFEST_FILE}
