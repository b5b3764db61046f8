"""One table in three formats: cells that spreadsheets leave alone, numbers at full precision, empty tables."""

import csv
import io
from typing import Annotated, Literal

import pyarrow.parquet as parquet
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, JsonValue

from human_study.export.data_dictionary import Unit, columns_of, dictionary_text
from human_study.export.formats import table_bytes


class Row(BaseModel):
    """A row with a column of each type."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)
    text: str
    """Words."""
    kind: Literal["a", "b"] | None = None
    """A choice | or none."""
    count: int = 0
    """How many."""
    length: Annotated[float, Unit("m")] | None = None
    """How long."""
    is_right: bool = True
    """Whether."""
    names: tuple[str, ...] = ()
    """Several."""
    more: dict[str, JsonValue] = {}
    """Anything."""


def cells_of(*rows: Row) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(table_bytes(Row, rows)["csv"].decode(), newline="")))


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"])
def test_text_that_a_spreadsheet_would_execute_gets_a_prefix(text: str) -> None:
    assert cells_of(Row(text=text))[0]["text"] == f"'{text}"


def test_numbers_stay_numbers() -> None:
    (cell,) = cells_of(Row(text="x", count=-3, length=-0.1 - 0.2))
    assert (cell["count"], cell["length"]) == ("-3", "-0.30000000000000004")
    assert (cell["is_right"], cell["kind"], cell["names"], cell["more"]) == ("true", "", "[]", "{}")


@settings(deadline=None, max_examples=50)
@example("a\r\nb", 0.0, ["\r"])
@given(st.text(), st.floats(allow_nan=False, allow_infinity=False), st.lists(st.text(max_size=3), max_size=3))
def test_any_value_survives_all_three_formats(text: str, length: float, names: list[str]) -> None:
    row = Row(text=text, length=length, names=tuple(names), more={"key": [text, length, None]})
    content = table_bytes(Row, [row])
    assert Row.model_validate_json(content["jsonl"]) == row
    (stored,) = parquet.read_table(io.BytesIO(content["parquet"])).to_pylist()
    assert (stored["text"], stored["length"], stored["names"]) == (text, length, names)
    (cell,) = cells_of(row)
    assert cell["text"].removeprefix("'") == text.removeprefix("'")
    assert float(cell["length"]) == length


def test_an_empty_table_has_its_columns() -> None:
    content = table_bytes(Row, [])
    assert content["jsonl"] == b""
    assert content["csv"] == b"text,kind,count,length,is_right,names,more\n"
    table = parquet.read_table(io.BytesIO(content["parquet"]))
    types = {field.name: str(field.type) for field in table.schema}
    assert types == {
        "text": "string",
        "kind": "string",
        "count": "int64",
        "length": "double",
        "is_right": "bool",
        "names": "list<element: string>",
        "more": "string",
    }


def test_the_dictionary_says_type_unit_choices_and_meaning() -> None:
    text = dictionary_text("Columns", {"things": ("One row per thing.", Row)})
    assert "# Columns" in text
    assert "## things\n\nOne row per thing.\n\n" in text
    assert "| `kind` | text | - | yes | A choice \\| or none. One of: `a`, `b`. |" in text
    assert "| `length` | number | m | yes | How long. |" in text
    assert [column.type for column in columns_of(Row)] == [
        "text",
        "text",
        "integer",
        "number",
        "boolean",
        "list of text",
        "JSON",
    ]
