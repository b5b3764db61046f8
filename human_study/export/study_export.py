"""A study's records as files for analysis: run folders like those of agents, tables in three formats, a manifest.

The export is written from one read transaction, so it works while the study is served. The same records give the same
bytes.
"""

import os
import shutil
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import get_args

import yaml
from pydantic import BaseModel

from sim.errors import StudyError
from sim.files import write_whole
from sim.homes.kind import scene_labels, scene_terms

from ..design.plan import PRACTICE_FOLDER
from ..design.study import STUDY_FILE, HistoryCondition
from ..store.records import StudyReader, read_study
from .collect import Collected, collect, event_rows
from .data_dictionary import dictionary_text
from .formats import table_bytes
from .manifest import MANIFEST_FILE, LeftOutTrial, Manifest, exported_file, read_manifest, strangers
from .rows import OPTIONAL_TABLES, EventRow, ExclusionRow, ParticipantRow, VerificationRow
from .runs import run_files, sequence_files
from .search_table import MEANING, SEARCHES, SearchRow
from .trial_table import TrialRow

DICTIONARY_FILE = "data_dictionary.md"
TABLES: dict[str, tuple[str, type[BaseModel]]] = {
    "trials": (
        "One row per attempt at an assigned trial; assigned trials that nobody opened have attempt 0.",
        TrialRow,
    ),
    "events": ("One row per event of an attempt, in order.", EventRow),
    "participants": ("One row per link to the study.", ParticipantRow),
    "exclusions": ("One row per use of a rule that leaves something out of the figures.", ExclusionRow),
    "verifications": ("One row per time that an attempt was done again and compared.", VerificationRow),
}
"""(meaning of one row, row model) by file name without ending."""


def export_study(folder: Path, out: Path) -> list[Path]:
    """Writes a study's records to a folder, whole or not at all.

    `out` is new, empty, or an earlier export of this study, which is replaced. The export works while the study is
    served. Returns the run folders, by run id.

    Raises:
        StudyError: The store cannot be read or was changed; or `out` cannot be written or holds anything else.
    """
    with read_study(folder) as reader:
        reader.check()
        _require_replaceable(out, reader.study_version)
        found = collect(reader)
        asked = {"survey": reader.config.survey.questions, "comments": reader.config.comments}
        tables = TABLES | ({} if reader.config.sequences is None else {SEARCHES: (MEANING, SearchRow)})
        tables |= {name: table for name, table in OPTIONAL_TABLES.items() if asked[name]}
        unused = get_args(HistoryCondition) if reader.config.sequences is None else ()
        files = _table_files(found, tables, unused=unused) | _study_files(reader, folder)
        for _, run in sorted(found.runs.items()):
            files |= run_files(run)
        for _, (info, walks) in sorted(found.sequences.items()):
            files |= sequence_files(info, walks)
        manifest = _manifest(reader, found, files)
    _write_folder(out, {name: content for name, (content, _) in files.items()}, manifest)
    return [out / name.removesuffix("/run.json") for name in sorted(files) if name.endswith("/run.json")]


def _table_files(
    found: Collected, tables: Mapping[str, tuple[str, type[BaseModel]]], *, unused: Collection[str]
) -> dict[str, tuple[bytes, int | None]]:
    """Content and number of rows of each table in each format, and of the data dictionary.

    `unused` are possible values of columns that this study cannot have.
    """
    files: dict[str, tuple[bytes, int | None]] = {}
    events = [line for row, stored in found.events for line in event_rows(row, stored)]
    rows_of = {"events": events, **{name: getattr(found, name) for name in tables if name != "events"}}
    for name, (_, model) in tables.items():
        rows = rows_of[name]
        for ending, content in table_bytes(model, rows).items():
            files[f"{name}.{ending}"] = (content, len(rows))
    files[DICTIONARY_FILE] = (dictionary_text("Data dictionary", tables, without=unused).encode(), None)
    return files


def _study_files(reader: StudyReader, folder: Path) -> dict[str, tuple[bytes, int | None]]:
    """Content of the study file, and of the practice homes' episodes, which are in no public dataset."""
    choices = reader.reported_config().model_dump(mode="json", exclude_defaults=True)
    files: dict[str, tuple[bytes, int | None]] = {
        STUDY_FILE: (yaml.safe_dump(choices, sort_keys=False, allow_unicode=True).encode(), None)
    }
    practice = folder / PRACTICE_FOLDER
    for path in sorted(practice.rglob("*")) if reader.plan.practice_scenes else ():
        if path.is_file():
            files[path.relative_to(folder).as_posix()] = (path.read_bytes(), None)
    return files


def _manifest(reader: StudyReader, found: Collected, files: Mapping[str, tuple[bytes, int | None]]) -> Manifest:
    """The content of `manifest.json`."""
    config, plan = reader.config, reader.plan
    begun = [row for row in found.trials if row.attempt > 0]
    return Manifest(
        study=config.study,
        study_version=reader.study_version,
        plan_version=plan.plan_version,
        is_pilot=reader.is_pilot,
        dates=reader.dates(),
        plan_changes=plan.changes,
        dataset_digest=config.dataset.sha256,
        app_version=reader.app_version,
        homes_version=plan.homes_version,
        made_by=plan.made_by,
        tasks=config.task,
        scenes=plan.scenes,
        practice_scenes=plan.practice_scenes,
        num_participants=len(found.participants),
        num_deleted=found.num_deleted,
        num_not_begun=len(found.trials) - len(begun),
        left_out=tuple(
            LeftOutTrial(attempt=row.attempt_name, reason=row.left_out) for row in begun if row.left_out is not None
        ),
        head_hashes={row.attempt_name: row.head_hash for row in begun if row.head_hash is not None},
        files={name: exported_file(content, num_rows) for name, (content, num_rows) in sorted(files.items())},
        scene_labels=scene_labels(scene.kind for scene in plan.scenes),
        scene_terms=tuple(dict.fromkeys(terms for scene in plan.scenes if (terms := scene_terms(scene.kind)))),
    )


def _require_replaceable(out: Path, study_version: str) -> None:
    """Raises StudyError unless `out` is new, empty, or an earlier export of this study and nothing else."""
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not (out / MANIFEST_FILE).is_file():
        raise StudyError(
            f"{out}: is not empty and holds no {MANIFEST_FILE}; expected a new or empty folder, or an earlier export "
            "of this study. Give another --out."
        )
    earlier = read_manifest(out)
    if earlier.study_version != study_version:
        raise StudyError(
            f"{out}: holds study {earlier.study} ({earlier.study_version[:12]}); expected {study_version[:12]}. "
            "Give another --out."
        )
    extra = sorted(strangers(out, earlier.files))
    if extra:
        raise StudyError(
            f"{out / extra[0]}: was not written by an export; expected only exported files, because the folder is "
            "replaced. Move it away, or give another --out."
        )


def _write_folder(out: Path, files: Mapping[str, bytes], manifest: Manifest) -> None:
    """Writes all files beside `out`, then puts the new folder in its place.

    Raises:
        StudyError: The folder cannot be written; an earlier export stays.
    """
    out = out.resolve()
    beside, old = out.with_name(f".{out.name}.part"), out.with_name(f".{out.name}.old")
    try:
        for leftover in (beside, old):
            shutil.rmtree(leftover, ignore_errors=True)
        for name, content in files.items():
            write_whole(beside / name, content)
        write_whole(beside / MANIFEST_FILE, manifest.model_dump_json(indent=2) + "\n")
        if out.exists():
            os.replace(out, old)
        os.replace(beside, out)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        shutil.rmtree(beside, ignore_errors=True)
        raise StudyError(
            f"{out}: cannot be written ({error.strerror}); expected a folder with space that you can write. "
            "Make room, or give another --out."
        ) from None
