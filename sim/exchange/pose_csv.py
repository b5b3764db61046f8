"""Pose files as text: CSV with `,`, `;` or tabs, and TUM trajectories (`timestamp tx ty tz qx qy qz qw`)."""

import csv
import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from sim.errors import RunFileError

from .pose_tables import ADVERTISED, NAMES, PoseTable, canonical, number_of, read_text, short

TUM_SUFFIXES = (".tum", ".txt")
TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Order of a TUM file that does not name its columns."""
IGNORED = "-"
"""Name of a column that is to be left out."""
_GROUPING = ("split", "scene", "episode_id", "episode")


def read_csv_tables(path: Path, *, columns: Sequence[str] = ()) -> Iterator[PoseTable]:
    """The episodes of a text file, one after the other; a row of another episode begins the next one.

    Args:
        path: The file. `#` begins a comment. Those above the rows may say `# episode: SPLIT/SCENE/ID` or
            `# stopped: yes`; in TUM files the last one may name the columns.
        columns: Names in the order of the file; () = the file's own header. `-` leaves a column out.

    Raises:
        RunFileError: The file is unreadable, has no header, or a row has another number of columns; says which line.
    """
    lines = read_text(path).splitlines()
    comment, first = _first_row(path, lines)
    separator = _separator(lines[first])
    head = _cells(lines[first], separator)
    names: Sequence[str] = columns
    if not columns and path.suffix.lower() in TUM_SUFFIXES and _are_numbers(head):
        named = _cells(comment, separator)
        known = len(named) == len(head) and sum(canonical(name) is not None for name in named) >= 3
        names = named if known else TUM_COLUMNS
    if not _are_numbers(head) and (not columns or not any(number_of(cell) is not None for cell in head)):
        names, first = columns or head, first + 1
    kept, ignored = _kept_columns(f"{path}:{first or 1}", names or head)
    facts = _commented_facts(lines[:first])
    rows = _rows(path, lines, first, separator, kept, width=len(names))
    grouping = [name for name in _GROUPING if name in kept.values()]
    is_empty = True
    for _, group in groupby(rows, key=lambda row: tuple(row[1][name] for name in grouping)):
        is_empty = False
        yield _table(path, list(group), facts, ignored)
    if is_empty:
        raise RunFileError(f"{path}: found no row below its header; expected one per pose. Write the file again.")


def _first_row(path: Path, lines: Sequence[str]) -> tuple[str, int]:
    """(the comment right before it, without #; index) of the first line that is neither blank nor a comment."""
    comment = ""
    for index, line in enumerate(lines):
        if line.lstrip().startswith("#"):
            comment = line.lstrip().lstrip("#")
        elif line.strip():
            return comment, index
    raise RunFileError(f"{path}: found no row; expected a header and one row per pose. Check the path.")


def _separator(line: str) -> str | None:
    """What stands between cells; None = any white space."""
    return next((mark for mark in ("\t", ";", ",") if mark in line), None)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _are_numbers(cells: Sequence[str]) -> bool:
    return all(number_of(cell) is not None or cell.lower() in ("nan", "inf", "-inf") for cell in cells)


def _kept_columns(where: str, names: Sequence[str]) -> tuple[dict[int, str], tuple[str, ...]]:
    """(our name by place, names that mean nothing to us)."""
    if names and _are_numbers(names):
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


def _rows(
    path: Path, lines: Sequence[str], first: int, separator: str | None, kept: dict[int, str], *, width: int
) -> Iterator[tuple[str, dict[str, str | None]]]:
    """(`file:line`, cells by our names; None where empty) of each row."""
    for index in range(first, len(lines)):
        line = lines[index]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        where = f"{path}:{index + 1}"
        try:
            cells = _cells(line, separator)
        except csv.Error as error:
            raise RunFileError(f"{where}: cannot be split ({error}); expected {width} cells. Write it again.") from None
        if len(cells) != width:
            raise RunFileError(
                f"{where}: found {len(cells)} cells; expected {width}, as many as there are columns. "
                "Write the row again; decimal commas need ';' or tabs between cells and are not understood."
            )
        yield where, {name: cells[place] or None for place, name in kept.items()}


def _commented_facts(lines: Sequence[str]) -> dict[str, str]:
    """What comments above the rows say of the whole episode, as `# stopped: yes`."""
    found = (re.fullmatch(r"\s*#\s*(\w+)\s*:\s*(\S+)\s*", line) for line in lines)
    return {match[1].lower(): match[2] for match in found if match and match[1].lower() in NAMES}


def _table(
    path: Path, rows: list[tuple[str, dict[str, str | None]]], facts: dict[str, str], ignored: tuple[str, ...]
) -> PoseTable:
    wheres = tuple(where for where, _ in rows)
    columns = {name: [row[name] for _, row in rows] for name in rows[0][1]}
    return PoseTable(
        where=wheres[0],
        path=path,
        wheres=wheres,
        columns={name: values for name, values in columns.items() if name not in NAMES and name != "action"},
        actions=tuple(columns["action"]) if "action" in columns else None,
        facts=facts | {name: columns[name][-1] for name in NAMES if name in columns and columns[name][-1] is not None},
        ignored=ignored,
    )
