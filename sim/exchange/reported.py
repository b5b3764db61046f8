"""Figures of PAN episodes as another program reported them: VLFM's JSON files, or tables of any program.

They are stored as `Reported` lines under the condition "reported, not recomputed" and are never paired with runs whose
steps were checked here.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from sim.episodes.dataset import PersonalDataset
from sim.errors import RunFileError, line_from_validation_error, short
from sim.homes.kind import common_kind
from sim.types import SPLITS, EpisodeKey, SceneKind, Split

from ..tasks.run_files import REPORTED, Reported
from ..tasks.run_writer import RunWriter
from .episode_names import NumberedBy, key_of_facts, numbered_keys, only_fitting
from .foreign_files import digest_of, files_in, info_of_import
from .pose_readers import text_rows
from .pose_tables import number_of, read_text, truth_of

_NAMES = {
    "scene_id": "scene",
    "distance_to_goal": "dtg",
    "steps": "num_steps",
    "stop_called": "stopped",
    "stop": "stopped",
}
"""Other programs' names of our fields."""
_KEY = ("split", "scene", "episode_id")
_EXPECTED = (
    "success, and where known spl (0 to 1), distance_to_goal (metres), num_steps, stop_called; split, scene_id, "
    "episode_id"
)


def import_reported(
    paths: Sequence[Path],
    *,
    dataset: PersonalDataset,
    out: Path,
    who: str,
    run_id: str | None = None,
    numbered_by: NumberedBy | None = None,
    splits: Sequence[Split] = SPLITS,
) -> list[Path]:
    """Writes the figures in these files as a run folder below `out`; nothing is recomputed, so no home is opened.

    Args:
        paths: VLFM's files (`<number>_<scene>.json`), tables (.csv, .tsv) with a header, or folders of them.
        dataset: The episodes that were played.
        out: Folder that gets `<run_id>/`.
        who: The agent's name in tables.
        run_id: Name of the folder; None = `who` and the digest of the files.
        numbered_by: What the numbers of episodes count; None = ids or places, whichever exist.
        splits: The splits that were played, for files that name none.

    Returns:
        The run folder.

    Raises:
        RunFileError: A file is damaged or has no figures, an episode is unknown, repeated or may be several, or `out`
            cannot be written.
    """
    files = files_in(paths, "*.json", "*.csv", "*.tsv")
    found: dict[EpisodeKey, Reported] = {}
    for path in files:
        for where, row in _rows(path):
            item = _figures(where, path, row, dataset, numbered_by, splits)
            if item.key in found:
                raise RunFileError(f"{where}: {item.key} comes a second time; expected it once. Leave one of them out.")
            found[item.key] = item
    if not found:
        names = ", ".join(map(str, paths)) or "no file"
        raise RunFileError(f"{names}: found no episode; expected {_EXPECTED} of each. Check the files.")
    info = info_of_import(
        paths,
        digest_of(files),
        dataset=dataset,
        kind=_kind(dataset, {key.scene for key in found}),
        who=who,
        run_id=run_id,
        condition=REPORTED,
        declared={"reported": True},
    )
    writer = RunWriter(out / info.run_id, info)
    writer.add_reported([item for key, item in found.items() if key not in writer.done])
    return [writer.folder]


def _kind(dataset: PersonalDataset, scenes: set[str]) -> SceneKind:
    """Invented homes, or scans: no other program plays on homes that are recovered from the episodes."""
    kind = common_kind(dataset, scenes, None)
    return "scan" if kind == "schematic" else kind


def _rows(path: Path) -> Iterator[tuple[str, Mapping[str, object]]]:
    """(place in the file, fields by our names) of each episode of a file."""
    text = read_text(path)
    if path.suffix.lower() == ".json":
        try:
            row = json.loads(text)
        except (ValueError, RecursionError):
            raise RunFileError(f"{path}: is not JSON; expected one episode's figures. Write the file again.") from None
        if not isinstance(row, dict):
            raise RunFileError(f"{path}: found {short(row)}; expected an object with {_EXPECTED}. Write it again.")
        yield str(path), {_NAMES.get(str(name), str(name)): value for name, value in row.items()}
        return
    heads: list[str] = []
    for number, cells in text_rows(text.splitlines()):
        if not heads:
            heads = [_NAMES.get(name, name) for name in (cell.strip().lower() for cell in cells)]
            continue
        if len(cells) != len(heads):
            raise RunFileError(f"{path}:{number}: found {len(cells)} cells; expected {len(heads)}. Write it again.")
        yield f"{path}:{number}", {name: cell for name, cell in zip(heads, cells, strict=True) if cell}
    if not heads:
        raise RunFileError(f"{path}: found no header; expected the columns {_EXPECTED}. Write the file again.")


def _figures(
    where: str,
    path: Path,
    row: Mapping[str, object],
    dataset: PersonalDataset,
    numbered_by: NumberedBy | None,
    splits: Sequence[Split],
) -> Reported:
    if row.get("success") is None:
        raise RunFileError(f"{where}: found no success; expected {_EXPECTED}. Check the file, or leave --reported out.")
    named = {name: row[name] for name in (*_KEY, "episode") if row.get(name) is not None}
    keys = numbered_keys(path, named, dataset, numbered_by=numbered_by, splits=splits)
    if keys:
        key = only_fitting(where, keys, lambda _: None)
    else:
        key = key_of_facts(where, path, named, None, dataset)
        if (key.split, key.scene) not in dataset.files or not _has(dataset, key):
            raise RunFileError(
                f"{where}: found no episode {key} in {dataset.root}; expected one of its content files. "
                "Give --dataset the episodes that were played."
            )
    numbers = {name: _number(where, name, row.get(name)) for name in ("spl", "dtg", "num_steps")}
    if numbers["dtg"] == math.inf:  # habitat-lab's distance where no path leads
        numbers["dtg"] = None
    stopped = row.get("stopped")
    values = {
        **dict(zip(_KEY, key, strict=True)),
        **numbers,
        "success": truth_of(where, "success", row["success"]),
        "stopped": None if stopped is None else truth_of(where, "stop_called", stopped),
    }
    try:
        return Reported.model_validate(values)
    except ValidationError as error:
        raise RunFileError(line_from_validation_error(where, error, advice="Correct the file.")) from None


def _has(dataset: PersonalDataset, key: EpisodeKey) -> bool:
    return any(record.episode_id == key.episode_id for record in dataset.content(key.split, key.scene).episodes)


def _number(where: str, name: str, value: object) -> float | None:
    if value is None or str(value).strip().lower() in ("inf", "infinity"):
        return None if value is None else math.inf
    number = number_of(value)
    if number is None:
        raise RunFileError(f"{where}: {name} is {short(value)}; expected a number. Correct the file.")
    return number
