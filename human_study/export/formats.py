"""Writes a table as JSON lines, CSV and Parquet, with the same bytes for the same rows; reads its JSON lines."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from sim.errors import StudyError, line_from_validation_error

from .data_dictionary import Column, columns_of
from .text_tables import csv_lines, json_text

if TYPE_CHECKING:
    import pyarrow

Row = TypeVar("Row", bound=BaseModel)


def table_bytes(model: type[BaseModel], rows: Sequence[BaseModel]) -> dict[str, bytes]:
    """The table in each format, by file ending; the rows' model gives the columns, even of a table without rows."""
    columns = columns_of(model)
    names = [column.name for column in columns]
    nested = [column.name for column in columns if column.type == "JSON"]
    values = []
    for row in rows:
        value = row.model_dump(mode="json")
        values.append(value | {name: json_text(value[name]) for name in nested if value[name] is not None})
    return {
        "jsonl": "".join(f"{row.model_dump_json()}\n" for row in rows).encode(),
        "csv": csv_lines(names, [[value[name] for name in names] for value in values]).encode(),
        "parquet": _parquet_bytes(columns, values),
    }


def rows_from_jsonl(text: str, model: type[Row], *, path: Path, advice: str) -> tuple[Row, ...]:
    """The rows of a table.

    Raises:
        StudyError: A line is damaged or of another version; the message names it, and ends with `advice`.
    """
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            rows.append(model.model_validate_json(line, strict=True))
        except ValidationError as error:
            raise StudyError(line_from_validation_error(f"{path}:{number}", error, advice=advice)) from None
    return tuple(rows)


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
