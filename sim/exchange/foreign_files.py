"""Files of other programs, by name or in folders, and the `run.json` of their import."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from sim.episodes.dataset import PersonalDataset
from sim.errors import RunFileError, line_from_validation_error
from sim.types import SceneKind

from ..tasks.provenance import make_run_info
from ..tasks.run_files import RunInfo


def files_in(paths: Sequence[Path], *patterns: str) -> list[Path]:
    """The files that are named, and for each folder those inside that match, sorted by name.

    Args:
        paths: Files and folders.
        patterns: Patterns below a folder, such as `*.json`; `**/` looks in its folders too.

    Raises:
        RunFileError: A folder holds no such file.
    """
    found: list[Path] = []
    for path in paths:
        inside = sorted({file for pattern in patterns for file in path.glob(pattern) if file.is_file()})
        if path.is_dir() and not inside:
            expected = " or ".join(patterns)
            raise RunFileError(f"{path}: found no file {expected}; expected runs of one program. Check the folder.")
        found += inside if path.is_dir() else [path]
    return found


def digest_of(files: Sequence[Path]) -> str:
    """sha256 over the bytes of all files, in the given order.

    Raises:
        RunFileError: A file cannot be read.
    """
    total = hashlib.sha256()
    for path in files:
        try:
            total.update(path.read_bytes())
        except OSError as error:
            raise RunFileError(f"{path}: cannot be read ({error}); expected steps or poses. Check the path.") from None
    return total.hexdigest()


def info_of_import(
    paths: Sequence[Path],
    digest: str,
    *,
    dataset: PersonalDataset,
    kind: SceneKind,
    who: str,
    run_id: str | None,
    condition: str,
    declared: Mapping[str, str | int | float | bool | None],
) -> RunInfo:
    """The `run.json` of files of another program.

    Args:
        paths: Files and folders as they were named.
        digest: `digest_of` all files.
        dataset: The episodes that were played.
        kind: Kind of the homes that they were played in.
        who: The agent's name in tables.
        run_id: Name of the run's folder; None = from `who` and the digest.
        condition: Condition in tables.
        declared: What the person said about the files.

    Raises:
        RunFileError: A name cannot stand in `run.json`.
    """
    slug = re.sub(r"[^A-Za-z0-9._-]+", "-", who).strip("-.")[:60] or "run"
    try:
        return make_run_info(
            run_id or f"{slug}-{digest[:8]}",
            who=who,
            who_kind="agent",
            scene_kind=kind,
            condition=condition,
            dataset_digest=dataset.digest(),
            config={"imported": " ".join(path.name for path in paths), "imported_digest": digest, **declared},
        )
    except ValidationError as error:
        advice = "Give another --run-id (letters, digits, '.', '_', '-') or --who."
        raise RunFileError(line_from_validation_error("import", error, advice=advice)) from None
