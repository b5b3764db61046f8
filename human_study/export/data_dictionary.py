"""The meaning of every exported column, from the rows' models: its type, its unit and the line under its field."""

import types
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from .text_tables import markdown_table, one_cell


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of a column, as an annotation: `Annotated[float, Unit("s")]`."""

    name: str


ColumnType = Literal["text", "integer", "number", "boolean", "list of text", "JSON"]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of an exported table."""

    name: str
    type: ColumnType
    unit: str
    """The unit; empty where a column has none."""
    is_optional: bool
    choices: tuple[str, ...]
    """All possible values, where these are a closed set; else ()."""
    meaning: str


def columns_of(model: type[BaseModel]) -> tuple[Column, ...]:
    """The columns of a table whose rows are of this model, in order."""
    return tuple(_column(name, field) for name, field in model.model_fields.items())


def dictionary_text(
    title: str, tables: Mapping[str, tuple[str, type[BaseModel]]], *, without: Collection[str] = ()
) -> str:
    """The text of `data_dictionary.md`.

    Args:
        title: First line.
        tables: (meaning of one row, row model) by table name.
        without: Possible values of columns that these tables cannot have.
    """
    parts = [
        f"# {title}",
        "Each table is written three times: as Parquet, CSV and JSON lines. Empty cells (CSV) and `null` (JSON) mean "
        "that there is no such value. Text that a spreadsheet would take for a formula begins with a single quote in "
        "CSV. `participant`, `order_no` and `attempt` together name an attempt in every table.",
    ]
    for name, (meaning, model) in tables.items():
        parts.append(f"## {name}\n\n{meaning}\n\n" + _table(columns_of(model), without))
    return "\n\n".join(parts) + "\n"


def _table(columns: tuple[Column, ...], without: Collection[str]) -> str:
    lines = []
    for column in columns:
        possible = ", ".join(f"`{choice}`" for choice in column.choices if choice not in without)
        choices = f" One of: {possible}." if possible else ""
        optional = "yes" if column.is_optional else "no"
        lines.append(
            (f"`{column.name}`", column.type, column.unit or "-", optional, one_cell(column.meaning + choices))
        )
    return markdown_table(("Column", "Type", "Unit", "May be empty", "Meaning"), lines)


def _column(name: str, field: FieldInfo) -> Column:
    assert field.description, f"{name} has no line under it"
    options = _options(field.annotation)
    kept = [option for option in options if option is not type(None)]
    units = [item.name for item in (*field.metadata, *_metadata(kept)) if isinstance(item, Unit)]
    choices = tuple(str(value) for option in kept if get_origin(option) is Literal for value in get_args(option))
    return Column(
        name=name,
        type=_type_name(kept),
        unit=units[0] if units else "",
        is_optional=len(kept) < len(options),
        choices=choices,
        meaning=field.description.replace("\n", " "),
    )


def _options(annotation: Any) -> list[Any]:
    """The members of a union and of unions inside it; the type itself where it is not a union."""
    if get_origin(annotation) in (Union, types.UnionType):
        return [option for member in get_args(annotation) for option in _options(member)]
    return [annotation]


def _metadata(options: list[Any]) -> list[Any]:
    return [item for option in options for item in getattr(option, "__metadata__", ())]


def _type_name(options: list[Any]) -> ColumnType:
    """The name of the type for people and file formats."""
    bare = [get_args(option)[0] if hasattr(option, "__metadata__") else option for option in options]
    if all(get_origin(option) is Literal or option is str for option in bare):
        return "text"
    (found,) = set(bare)
    if get_origin(found) is tuple and get_args(found)[0] is str:
        return "list of text"
    names: dict[Any, ColumnType] = {bool: "boolean", int: "integer", float: "number"}
    return names.get(found, "JSON")
