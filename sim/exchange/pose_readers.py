"""One reader per format of pose files (CSV, TUM, JSON, npz): each gives the `PoseTable`s of a file, unconverted."""

import csv
import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunFileError, short
from sim.files import TooLargeError, npy_array, require_small_archive

from .pose_tables import (
    ADVERTISED,
    NAMED_QUAT,
    NAMES,
    PoseTable,
    canonical,
    number_of,
    read_limited,
    read_text,
    vector_columns,
    vector_name,
)

Row = dict[str, object]
TUM_SUFFIXES = (".tum", ".txt")
TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Columns of a TUM file that does not name them."""
IGNORED = "-"
"""Name of a column that is left out."""
MAX_VALUES = 2_000_000
"""Most values in a JSON file: 500 episodes of 500 steps."""
MAX_UNPACKED = 16 << 20
"""Most bytes of all arrays of an npz file; an episode of 500 steps has 60 kB."""
MAX_ARRAYS = 100
_GROUPING = ("split", "scene", "episode_id", "episode")
_LISTS = ("steps", "trajectory", "agent_states", "states", "observations", "poses")
"""Fields of a JSON episode that may hold one record per pose."""
_NESTED = ("agent_state", "state", "body", "observation", "observations")
"""Fields of a JSON record that hold a record or vector of their own."""
_JSON = (
    "a list of records ({'position': [...], 'rotation': [...], 'action': ...}), a list of poses "
    "([x,y,z,qx,qy,qz,qw]), or {'episodes': [{'split', 'scene', 'episode_id', 'poses' or 'positions' and 'rotations', "
    "'actions', 'stopped'}]}"
)
_ARRAYS = (
    "arrays positions (T, 3) with rotations (T, 4) or yaw (T,), or poses (T, 7) or (T, 4, 4); and, if you have them, "
    "actions, t_s, tilt, stopped, split, scene, episode_id"
)


def text_rows(lines: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Yields (line number from 1, cells) of each line that is neither blank nor a `#` comment.

    The first such line decides the separator: tabs, `;`, `,` or white space.
    """
    first = next((line for line in lines if _is_row(line)), "")
    separator = next((mark for mark in ("\t", ";", ",") if mark in first), None)
    return ((number, _cells(line, separator)) for number, line in enumerate(lines, start=1) if _is_row(line))


def read_csv_tables(path: Path, *, columns: Sequence[str] = ()) -> Iterator[PoseTable]:
    """The episodes of a text file, one after the other; a row of a different episode begins the next one.

    Args:
        path: The file. `#` begins a comment. Comments above the rows may say `# episode: SPLIT/SCENE/ID` or
            `# stopped: yes`; in TUM files the last one may name the columns.
        columns: Names in the order of the file; () = the file's own header. `-` leaves a column out.

    Raises:
        RunFileError: The file is unreadable, has no header, or a row has a wrong number of cells; names the line.
    """
    lines = read_text(path).splitlines()
    rows = text_rows(lines)
    first, head = next(rows, (0, []))
    if not first:
        raise RunFileError(f"{path}: found no row; expected a header and one row per pose. Check the path.")
    above = lines[: first - 1]
    names: Sequence[str] = columns
    if not columns and path.suffix.lower() in TUM_SUFFIXES and _are_numbers(head):
        names = _named_in_comment(above, len(head)) or TUM_COLUMNS
    if _are_numbers(head) or (columns and any(number_of(cell) is not None for cell in head)):
        rows = text_rows(lines)  # there is no header: the first row is a pose
    kept, ignored = _kept_columns(f"{path}:{first}", names or head)
    records = _records(path, rows, kept, width=len(names or head))
    tables = _tables_of_records(path, records, _commented_facts(above), ignored=ignored)
    table = None
    for table in tables:
        yield table
    if table is None:
        raise RunFileError(f"{path}: found no row below its header; expected one per pose. Write the file again.")


def read_json_tables(path: Path) -> Iterator[PoseTable]:
    """The episodes of a JSON file: records, habitat-lab's `agent_state`s, or episodes with arrays.

    Raises:
        RunFileError: The file is unreadable or has an unknown form; the message names the element.
    """
    text = read_text(path)
    if sum(map(text.count, ",[{")) > MAX_VALUES:
        raise RunFileError(f"{path}: holds more than {MAX_VALUES} values; expected fewer. Write a file per scene.")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        found = "too deep nesting" if isinstance(error, RecursionError) else str(error)
        raise RunFileError(f"{path}: is not JSON ({found}); expected {_JSON}. Write the file again.") from None
    if isinstance(document, list):
        yield from _tables_of_list(path, str(path), document, {})
    elif isinstance(document, dict) and isinstance(document.get("episodes"), list):
        shared = _facts(document)
        for index, episode in enumerate(document["episodes"]):
            where = f"{path}: episodes[{index}]"
            if not isinstance(episode, dict):
                raise RunFileError(f"{where} is {short(episode)}; expected {_JSON}. Write the file again.")
            yield from _tables_of_episode(path, where, episode, shared)
    elif isinstance(document, dict):
        yield from _tables_of_episode(path, str(path), document, {})
    else:
        raise RunFileError(f"{path}: found {short(document)}; expected {_JSON}. Write the file again.")


def read_npz_table(path: Path) -> PoseTable:
    """The episode of a `.npz` file; nothing pickled is ever loaded.

    Raises:
        RunFileError: The file is not an archive of plain arrays, is too large, or its arrays do not fit together.
    """
    fields: Row = {}
    for name, array in _read_arrays(path).items():
        is_fact = canonical(name) in NAMES and array.size == 1
        fields[name] = array.reshape(-1)[0].item() if is_fact else array.tolist()
    return next(_tables_of_arrays(path, str(path), fields, {}, expected=_ARRAYS))


def _is_row(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:  # a cell longer than the module's limit
        return [line]


def _are_numbers(cells: Sequence[str]) -> bool:
    return all(number_of(cell) is not None or cell.lower() in ("nan", "inf", "-inf") for cell in cells)


def _named_in_comment(above: Sequence[str], width: int) -> list[str] | None:
    """The columns named in the last comment above the rows, or None when it holds other text."""
    comments = [line.lstrip().lstrip("#") for line in above if line.strip()]
    named = comments[-1].replace(",", " ").split() if comments else []
    return named if len(named) == width and sum(canonical(name) is not None for name in named) >= 3 else None


def _kept_columns(where: str, names: Sequence[str]) -> tuple[dict[int, str], tuple[str, ...]]:
    """Our name of each known column by its place, and the unknown names."""
    if _are_numbers(names):
        raise RunFileError(
            f"{where}: the first row is numbers only; expected names such as {ADVERTISED}. "
            "Add a header, or name the columns with --columns x,y,z,yaw."
        )
    kept: dict[int, str] = {}
    ignored = []
    for place, name in enumerate(names):
        ours = canonical(name)
        if ours is None:
            ignored += [name] if name != IGNORED else []
        elif ours in kept.values():
            raise RunFileError(
                f"{where}: column {name!r} gives {ours} a second time; expected one of them. "
                f"Name the others {IGNORED!r} with --columns."
            )
        else:
            kept[place] = ours
    if not kept:
        raise RunFileError(
            f"{where}: found columns {short(list(names))}, none of which is known; expected {ADVERTISED}. "
            "Name them with --columns."
        )
    return kept, tuple(ignored)


def _records(
    path: Path, rows: Iterable[tuple[int, list[str]]], kept: Mapping[int, str], *, width: int
) -> Iterator[tuple[str, Row]]:
    """Yields (`file:line`, cells by our names) of each row; an empty cell is None."""
    for number, cells in rows:
        if len(cells) != width:
            raise RunFileError(
                f"{path}:{number}: found {len(cells)} cells; expected {width}, one per column. "
                "Write the row again; decimal commas need ';' or tabs between cells and are not understood."
            )
        yield f"{path}:{number}", {name: cells[place] or None for place, name in kept.items()}


def _commented_facts(above: Sequence[str]) -> Row:
    """Facts about the whole episode in comments above the rows, such as `# stopped: yes`."""
    found = (re.fullmatch(r"\s*#\s*(\w+)\s*:\s*(\S+)\s*", line) for line in above)
    return {match[1].lower(): match[2] for match in found if match and match[1].lower() in NAMES}


def _tables_of_records(
    path: Path,
    records: Iterable[tuple[str, Row]],
    facts: Row,
    *,
    actions: tuple[object, ...] | None = None,
    ignored: Sequence[str] = (),
) -> Iterator[PoseTable]:
    """Tables of records (place, values by our names), one per pose; each new episode begins a table."""
    for _, items in groupby(records, key=lambda item: [str(item[1].get(name)) for name in _GROUPING]):
        group = list(items)
        names = dict.fromkeys(name for _, row in group for name in row)
        columns = {name: [row.get(name) for _, row in group] for name in names}
        own = {name: columns.pop(name)[-1] for name in NAMES if name in columns}
        listed = tuple(columns.pop("action")) if "action" in columns else actions
        unknown = [name for name in columns if canonical(name) is None]
        yield PoseTable(
            where=group[0][0],
            path=path,
            wheres=tuple(where for where, _ in group),
            columns={name: values for name, values in columns.items() if name not in unknown},
            actions=listed,
            facts=facts | {name: value for name, value in own.items() if value is not None},
            ignored=(*ignored, *unknown),
        )


def _tables_of_list(
    path: Path, where: str, values: Sequence[object], facts: Row, actions: tuple[object, ...] | None = None
) -> Iterator[PoseTable]:
    """Tables of a JSON list with one record or vector per pose."""
    if not values:
        raise RunFileError(f"{where}: is an empty list; expected {_JSON}. Write the file again.")
    places = ((f"{where}[{index}]", value) for index, value in enumerate(values))
    return _tables_of_records(path, ((at, _record(at, value)) for at, value in places), facts, actions=actions)


def _tables_of_episode(path: Path, where: str, episode: Row, shared: Row) -> Iterator[PoseTable]:
    facts = shared | _facts(episode)
    for name in _LISTS:
        rows = episode.get(name)
        if isinstance(rows, list) and rows and isinstance(rows[0], dict):
            return _tables_of_list(path, f"{where}: {name}", rows, facts, _actions(where, episode))
    return _tables_of_arrays(path, where, episode, facts, expected=_JSON)


def _tables_of_arrays(path: Path, where: str, fields: Row, facts: Row, *, expected: str) -> Iterator[PoseTable]:
    """The table of an episode that has one list per column or vector; other fields are facts, or unknown."""
    lists: dict[str, list[object]] = {}
    ignored = []
    for name, values in fields.items():
        ours = canonical(name)
        if isinstance(values, list) and (vector_name(name) or ours not in (None, "action", *NAMES)):
            lists[name] = values
        elif ours != "action" and (ours not in NAMES or isinstance(values, list)):
            ignored.append(name)
    if not lists:
        raise RunFileError(f"{where}: found {short(list(fields))}; expected {expected}. Write the file again.")
    first, *_ = lists
    count = len(lists[first])
    if not count:
        raise RunFileError(f"{where}: found no pose; expected at least the start. Write the file again.")
    records: list[tuple[str, Row]] = []
    for name, values in lists.items():
        if len(values) != count:
            raise RunFileError(f"{where}: {name}: has {len(values)} rows; expected {count} as before. Write it again.")
    for index in range(count):
        at = f"{where}: {first}[{index}]"
        row = _flat((f"{where}: {name}[{index}]", name, values[index]) for name, values in lists.items())
        if records and list(row) != list(records[0][1]):
            columns = ", ".join(records[0][1])
            raise RunFileError(f"{at}: gives {', '.join(row)}; expected {columns} as in the first. Write it again.")
        records.append((at, row))
    facts = facts | _facts(fields)
    return _tables_of_records(path, records, facts, actions=_actions(where, fields), ignored=ignored)


def _record(where: str, value: object) -> Row:
    """One JSON record or vector, flat; unknown fields keep their names."""
    if isinstance(value, list):
        return _vector(where, "pose", value)
    if not isinstance(value, dict):
        raise RunFileError(f"{where} is {short(value)}; expected a record or a list of numbers. Write the row again.")
    return _flat((f"{where}.{name}", name, field) for name, field in cast(Row, value).items())


def _flat(fields: Iterable[tuple[str, str, object]]) -> Row:
    """The columns in fields (place, name, value) of one pose."""
    row: Row = {}
    for where, name, field in fields:
        vector = vector_name(name)
        if name in _NESTED and isinstance(field, dict):
            parts = _record(where, field)
        elif vector is not None:
            parts = _vector(where, vector, field)
        else:
            parts = {canonical(name) or name: field[0] if isinstance(field, list) and len(field) == 1 else field}
        for part, content in parts.items():
            if part in row and canonical(part) is not None:
                raise RunFileError(f"{where}: gives {part} a second time; expected it once. Leave one of them out.")
            row[part] = content
    return row


def _vector(where: str, name: str, value: object) -> Row:
    """The columns of a vector, a 4x4 matrix or a quaternion with named parts."""
    if name == "rotation" and isinstance(value, dict) and set(value) == set("xyzw"):
        return {column: value[column[1]] for column in NAMED_QUAT}
    if not isinstance(value, list):
        raise RunFileError(f"{where} is {short(value)}; expected a list of numbers. Write the row again.")
    if value and all(isinstance(part, list) for part in value):
        if len(value) != 4 or any(len(part) != 4 for part in value):
            raise RunFileError(f"{where}: is not a 4x4 matrix; expected 4 rows of 4 numbers. Write the row again.")
        value = [number for part in value for number in part]
    return dict(zip(vector_columns(where, name, len(value)), value, strict=True))


def _facts(fields: Row) -> Row:
    """Facts about a whole episode in a JSON object."""
    named = ((canonical(name), value) for name, value in fields.items())
    return {name: value for name, value in named if name in NAMES and not isinstance(value, (list, dict))}


def _actions(where: str, fields: Row) -> tuple[object, ...] | None:
    for name, value in fields.items():
        if canonical(name) == "action":
            if not isinstance(value, list):
                raise RunFileError(f"{where}: {name} is {short(value)}; expected a list. Write the file again.")
            return tuple(one[0] if isinstance(one, list) and len(one) == 1 else one for one in value)
    return None


def _read_arrays(path: Path) -> dict[str, NDArray[np.generic]]:
    try:
        with zipfile.ZipFile(io.BytesIO(read_limited(path))) as archive:
            require_small_archive(archive, most=MAX_UNPACKED, most_members=MAX_ARRAYS)
            return {info.filename.removesuffix(".npy"): _array(path, archive, info) for info in archive.infolist()}
    except TooLargeError as error:
        raise RunFileError(
            f"{path}: {error}; expected one episode's poses, {MAX_UNPACKED >> 20} MB at most in {MAX_ARRAYS} arrays. "
            "Save pictures elsewhere."
        ) from None
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise RunFileError(f"{path}: is not an .npz file ({error}); expected {_ARRAYS}. Write it again.") from None


def _array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[np.generic]:
    try:
        return npy_array(archive.read(info))
    except (ValueError, SyntaxError, TypeError) as error:
        raise RunFileError(
            f"{path}: {info.filename} is not a NumPy array ({error}); expected {_ARRAYS}. Write it again."
        ) from None
