"""Writes a table as JSON lines, CSV and Parquet, with the same bytes for the same rows; and any table as CSV."""

import io
import json
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from .data_dictionary import Column, columns_of

if TYPE_CHECKING:
    import pyarrow

FORMATS = ("jsonl", "csv", "parquet")
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters that make a spreadsheet read text as a formula."""
_NEEDS_QUOTES = re.compile(r'[",\r\n]')


def table_bytes(model: type[BaseModel], rows: Sequence[BaseModel]) -> dict[str, bytes]:
    """The table in each format, by file ending.

    Args:
        model: Model of each row; gives the columns, even for a table without rows.
        rows: The rows, in the order in which they are written.
    """
    columns = columns_of(model)
    names = [column.name for column in columns]
    nested = [column.name for column in columns if column.type == "JSON"]
    values = []
    for row in rows:
        value = row.model_dump(mode="json")
        values.append(value | {name: _json(value[name]) for name in nested if value[name] is not None})
    return {
        "jsonl": "".join(f"{row.model_dump_json()}\n" for row in rows).encode(),
        "csv": csv_lines(names, [[value[name] for name in names] for value in values]).encode(),
        "parquet": _parquet_bytes(columns, values),
    }


def csv_lines(heads: Iterable[str], lines: Iterable[Sequence[object]]) -> str:
    """CSV text whose cells no spreadsheet reads as formulas; a cell without value is empty."""
    return "".join(",".join(_quoted(_csv_cell(value)) for value in line) + "\n" for line in (list(heads), *lines))


def _quoted(text: str) -> str:
    """A cell, in quotes where it needs them; the csv module does not quote a bare carriage return."""
    return '"' + text.replace('"', '""') + '"' if _NEEDS_QUOTES.search(text) else text


def _csv_cell(value: Any) -> str:
    """A value as text: numbers at full precision, lists and objects as JSON, nothing that a spreadsheet executes."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    text = value if isinstance(value, str) else _json(value)
    return f"'{text}" if text.startswith(_FORMULA) else text


def _parquet_bytes(columns: Sequence[Column], rows: Sequence[dict[str, Any]]) -> bytes:
    import pyarrow
    from pyarrow import parquet

    arrays = [pyarrow.array([row[column.name] for row in rows], type=_arrow_type(column)) for column in columns]
    schema = pyarrow.schema(
        pyarrow.field(column.name, _arrow_type(column), nullable=column.is_optional) for column in columns
    )
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=schema), buffer, compression="zstd")
    return buffer.getvalue()


def _arrow_type(column: Column) -> "pyarrow.DataType":
    import pyarrow

    return {
        "text": pyarrow.string(),
        "integer": pyarrow.int64(),
        "number": pyarrow.float64(),
        "boolean": pyarrow.bool_(),
        "list of text": pyarrow.list_(pyarrow.string()),
        "JSON": pyarrow.string(),
    }[column.type]


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
