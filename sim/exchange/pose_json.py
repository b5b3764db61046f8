"""Pose files as JSON: lists of records, habitat-lab's `agent_state`s, or episodes with arrays."""

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import cast

from sim.errors import RunFileError

from .pose_tables import NAMED_QUAT, NAMES, PoseTable, canonical, read_text, short, vector_columns, vector_name

Row = dict[str, object]
_LISTS = ("steps", "trajectory", "agent_states", "states", "observations", "poses")
"""Fields of an episode that may hold one record per pose."""
_NESTED = ("agent_state", "state", "body", "observation", "observations")
"""Fields of a record that hold a part of it."""
_GROUPING = ("split", "scene", "episode_id", "episode")
MAX_VALUES = 2_000_000
"""Of a file: 500 episodes of 500 steps."""
_SHAPES = (
    "a list of records ({'position': [...], 'rotation': [...], 'action': ...}), a list of poses "
    "([x,y,z,qx,qy,qz,qw]), or {'episodes': [{'split', 'scene', 'episode_id', 'poses' or 'positions' and 'rotations', "
    "'actions', 'stopped'}]}"
)


def read_json_tables(path: Path) -> Iterator[PoseTable]:
    """The episodes of a JSON file.

    Raises:
        RunFileError: The file is unreadable or not of a shape that we know; says which element.
    """
    text = read_text(path)
    if sum(map(text.count, ",[{")) > MAX_VALUES:
        raise RunFileError(f"{path}: holds more than {MAX_VALUES} values; expected fewer. Write a file per scene.")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        found = "too deep nesting" if isinstance(error, RecursionError) else str(error)
        raise RunFileError(f"{path}: is not JSON ({found}); expected {_SHAPES}. Write the file again.") from None
    if isinstance(document, list):
        yield from _tables_of_rows(path, str(path), document, {})
    elif isinstance(document, dict) and isinstance(document.get("episodes"), list):
        shared = _facts(document)
        for index, episode in enumerate(document["episodes"]):
            where = f"{path}: episodes[{index}]"
            if not isinstance(episode, dict):
                raise RunFileError(f"{where} is {short(episode)}; expected {_SHAPES}. Write the file again.")
            yield from _episode(path, where, episode, shared)
    elif isinstance(document, dict):
        yield from _episode(path, str(path), document, {})
    else:
        raise RunFileError(f"{path}: found {short(document)}; expected {_SHAPES}. Write the file again.")


def _episode(path: Path, where: str, episode: Row, shared: Row) -> Iterator[PoseTable]:
    facts = {**shared, **_facts(episode)}
    for name in _LISTS:
        rows = episode.get(name)
        if isinstance(rows, list) and rows and isinstance(rows[0], dict):
            ended = _actions(where, episode)
            yield from _tables_of_rows(path, f"{where}: {name}", rows, facts, ended)
            return
    columns: dict[str, list[object]] = {}
    ignored = []
    first_field = ""
    for name, values in episode.items():
        if not isinstance(values, list) or canonical(name) == "action":
            if canonical(name) not in (*NAMES, "action"):
                ignored.append(name)
            continue
        found = _columns(f"{where}: {name}", name, values)
        if found is None:
            ignored.append(name)
            continue
        first_field = first_field or name
        _add_columns(f"{where}: {name}", columns, found)
    if not columns:
        raise RunFileError(f"{where}: found fields {short(list(episode))}; expected {_SHAPES}. Write the file again.")
    length = len(next(iter(columns.values())))
    wheres = tuple(f"{where}: {first_field}[{row}]" for row in range(length))
    yield PoseTable(where, path, wheres, columns, _actions(where, episode), facts, tuple(ignored))


def _columns(where: str, name: str, values: list[object]) -> dict[str, list[object]] | None:
    """The columns that an array of an episode gives, None for one that means nothing to us."""
    vector, scalar = vector_name(name), canonical(name)
    if vector is None:
        if scalar is None or scalar in NAMES:
            return None
        return {scalar: [value[0] if isinstance(value, list) and len(value) == 1 else value for value in values]}
    rows = [_vector(f"{where}[{index}]", vector, value) for index, value in enumerate(values)]
    names = list(rows[0]) if rows else []
    for index, row in enumerate(rows):
        if list(row) != names:
            raise RunFileError(
                f"{where}[{index}]: found {len(row)} numbers; expected {len(names)} as in the first. "
                "Write the row again."
            )
    return {column: [row[column] for row in rows] for column in names}


def _add_columns(where: str, columns: dict[str, list[object]], more: Mapping[str, list[object]]) -> None:
    length = len(next(iter(columns.values()))) if columns else None
    for name, values in more.items():
        if name in columns:
            raise RunFileError(f"{where}: gives {name} a second time; expected it once. Leave one of the fields out.")
        if length is not None and len(values) != length:
            raise RunFileError(f"{where}: has {len(values)} rows; expected {length} as before. Write the file again.")
        columns[name] = values


def _tables_of_rows(
    path: Path, where: str, values: Sequence[object], facts: Row, actions: tuple[object, ...] | None = None
) -> Iterator[PoseTable]:
    """Tables of a list with one record or vector per pose; a record of another episode begins the next table."""
    rows = [(f"{where}[{index}]", _row(f"{where}[{index}]", value)) for index, value in enumerate(values)]
    if not rows:
        raise RunFileError(f"{where}: is an empty list; expected {_SHAPES}. Write the file again.")
    for _, items in groupby(rows, key=lambda item: tuple(str(item[1].get(name)) for name in _GROUPING)):
        group = list(items)
        names = list(dict.fromkeys(name for _, row in group for name in row))
        columns = {name: [row.get(name) for _, row in group] for name in names}
        own = {name: columns.pop(name)[-1] for name in NAMES if name in columns}
        listed = tuple(columns.pop("action")) if "action" in columns else actions
        ignored = [name for name in names if canonical(name) is None and vector_name(name) is None]
        kept = {name: column for name, column in columns.items() if name not in ignored}
        yield PoseTable(group[0][0], path, tuple(at for at, _ in group), kept, listed, {**facts, **own}, tuple(ignored))


def _row(where: str, value: object) -> Row:
    """One record, flat; fields that mean nothing to us keep their names."""
    if isinstance(value, list):
        return _vector(where, "pose", value)
    if not isinstance(value, dict):
        raise RunFileError(f"{where} is {short(value)}; expected a record or a list of numbers. Write the row again.")
    row: Row = {}
    for name, field in cast(Row, value).items():
        vector = vector_name(name)
        if name in _NESTED and isinstance(field, dict):
            parts = _row(where, field)
        elif vector is not None:
            parts = _vector(f"{where}.{name}", vector, field)
        else:
            single = field[0] if isinstance(field, list) and len(field) == 1 else field
            parts = {canonical(name) or name: single}
        for part, content in parts.items():
            if part in row and canonical(part) is not None:
                raise RunFileError(f"{where}: gives {part} a second time; expected it once. Leave one field out.")
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
            raise RunFileError(f"{where}: is no 4x4 matrix; expected 4 rows of 4 numbers. Write the row again.")
        value = [number for part in value for number in part]
    return dict(zip(vector_columns(where, name, len(value)), value, strict=True))


def _facts(fields: Row) -> Row:
    """What an object says of a whole episode."""
    named = ((canonical(name), value) for name, value in fields.items())
    return {name: value for name, value in named if name in NAMES and not isinstance(value, (list, dict))}


def _actions(where: str, episode: Row) -> tuple[object, ...] | None:
    for name, value in episode.items():
        if canonical(name) == "action":
            if not isinstance(value, list):
                raise RunFileError(f"{where}: {name} is {short(value)}; expected a list. Write the file again.")
            return tuple(value)
    return None
