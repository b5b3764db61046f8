"""Files that a person writes in YAML: read strictly, as JSON text for a model to check, and written with comments."""

import json
import re
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from sim.errors import StudyError
from sim.files import bounded_bytes

MAX_BYTES = 128 << 10
"""Largest file; a study has 3 kB, and reading a megabyte takes seconds."""
MAX_NODES = 20_000
"""Most values in a file, including those that an alias repeats."""
_WIDTH = 110
"""Columns of a comment."""
_LONGEST_SHOWN = 40
"""Most characters of a bad value in a message."""


def json_from_yaml(path: Path, *, expected: str, advice: str) -> str:
    """The fields of a YAML file as a JSON object; messages name the `expected` fields and end with the advice.

    Raises:
        OSError: The file cannot be read.
        StudyError: The file is not YAML, repeats a field, has keys that are not text, or values that JSON cannot hold.
    """
    content = bounded_bytes(path, MAX_BYTES)
    try:
        choices = yaml.load(content, Loader=_StrictLoader)
        if not isinstance(choices, dict):
            raise StudyError(f"{path}: holds {type(choices).__name__}; expected {expected}. {advice}")
        return json.dumps(choices, default=str)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = getattr(error, "problem_mark", None)
        line = f", line {where.line + 1}" if where is not None else ""
        raise StudyError(f"{path}{line}: is not YAML ({getattr(error, 'problem', error)}). {advice}") from None
    except RecursionError:
        raise StudyError(f"{path}: is nested too deeply; expected {expected}. {advice}") from None
    except ValueError as error:  # JSON cannot hold a list that contains itself, and Python does not print huge integers
        problem = str(error).partition(";")[0]
        raise StudyError(
            f"{path}: holds a value that cannot be used ({problem}); expected {expected}. {advice}"
        ) from None


def commented_yaml(values: BaseModel) -> str:
    """Every field of a model as YAML, each below its meaning, its possible values and its default as comments.

    The comments are the docstrings and types of the model (`schema_of`), so they cannot differ from what is read.
    """
    schema = schema_of(type(values))
    text = "\n".join(_lines(schema, values.model_dump(mode="json"), schema.get("$defs", {})))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def field_told(schema: Mapping[str, Any], place: str) -> tuple[str, str]:
    """The meaning and the allowed values of a field such as `design.kind`, both in words."""
    defs, field = schema.get("$defs", {}), schema
    for name in place.split("."):
        field = _resolved(_block(field), defs)["properties"][name]
    return field.get("description", ""), _allowed(field, defs)


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON schema of a model, with the docstrings of its fields in YAML's words."""

    def told(part: Any) -> Any:
        if isinstance(part, list):
            return [told(each) for each in part]
        if not isinstance(part, dict):
            return part
        return {
            name: _in_yaml_words(value) if name == "description" and isinstance(value, str) else told(value)
            for name, value in part.items()
            if not (name == "title" and isinstance(value, str))  # the field's name in capitals
        }

    return told(model.model_json_schema())


def _in_yaml_words(text: str) -> str:
    """A docstring as one line, with `null` and `[]` for Python's `None` and `()`."""
    return re.sub(r"(?<![\w)])\(\)", "[]", re.sub(r"\bNone\b", "null", " ".join(text.split())))


def _lines(schema: Mapping[str, Any], values: Mapping[str, Any], defs: Mapping[str, Any]) -> Iterator[str]:
    """Lines of an object's fields, in the order of the schema."""
    for name, field in schema["properties"].items():
        inner = _resolved(_block(field), defs)
        meaning = field.get("description") or inner.get("description", "")
        if "properties" in inner and values[name] is None:
            continue  # a block that is left out
        if "properties" in inner:
            yield ""
            yield from _comment(meaning)
            yield f"{name}:"
            yield from (textwrap.indent(line, "  ") for line in _lines(inner, values[name], defs))
            yield ""
            continue
        yield from _comment(meaning)
        default = f"; default {_written(field['default'])}" if "default" in field else ""
        yield from _comment(f"{_allowed(field, defs)}{default}", mark="#   ")
        yield f"{name}: {_written(values[name])}"


def _block(field: Mapping[str, Any]) -> Mapping[str, Any]:
    """The schema of a block that may be left out; other schemas are returned as they are."""
    parts = [part for part in field.get("anyOf", ()) if part.get("type") != "null"]
    return parts[0] if len(parts) == 1 and "$ref" in parts[0] else field


def _comment(text: str, *, mark: str = "# ") -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=mark, subsequent_indent=mark, break_on_hyphens=False)


def _written(value: Any) -> str:
    """A JSON value as YAML on one line."""
    if isinstance(value, str) and "\n" in value:
        return json.dumps(value)  # YAML's own quoting would take several lines
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, sort_keys=False, width=float("inf"))
    return text.removesuffix("\n").removesuffix("\n...")


def _resolved(field: Mapping[str, Any], defs: Mapping[str, Any]) -> Mapping[str, Any]:
    """The schema that a field refers to, or its own."""
    return defs[field["$ref"].rsplit("/", 1)[1]] if "$ref" in field else field


def _allowed(field: Mapping[str, Any], defs: Mapping[str, Any]) -> str:
    """The values that a schema allows, in words."""
    field = _resolved(field, defs)
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(_allowed(part, defs) for part in field["anyOf"]))
    if "enum" in field or "const" in field:
        return " | ".join(map(_written, field.get("enum", [field.get("const")])))
    match field.get("type"):
        case "array" if "items" in field or "prefixItems" in field:
            counts = "".join(f", {word} {field[key]}" for key, word in _COUNTS.items() if key in field)
            return f"list of {_allowed(field.get('items') or {'anyOf': field['prefixItems']}, defs)}{counts}"
        case "object" if "properties" in field:
            return f"fields {', '.join(field['properties'])}"
        case "object":
            key, value = field.get("propertyNames", {"type": "string"}), field.get("additionalProperties", {})
            return f"{{{_allowed(key, defs)}: {_allowed(value, defs)}, ...}}"
        case "integer" | "number" as kind:
            bounds = [f"{word} {field[key]:g}" for key, word in _BOUNDS.items() if key in field]
            return " ".join(["whole number" if kind == "integer" else "number", *bounds])
        case "string" if field.get("format") == "date":
            return "day such as 2027-12-31"
        case "string":
            return f"text that matches {field['pattern']}" if "pattern" in field else "text"
        case "boolean":
            return "true | false"
        case kind:
            return str(kind or "any")


_COUNTS = {"minItems": "at least", "maxItems": "at most"}
_BOUNDS = {"minimum": "from", "exclusiveMinimum": "above", "maximum": "to", "exclusiveMaximum": "below"}


class _StrictLoader(yaml.SafeLoader):
    """YAML that refuses duplicate keys and keys that are not text."""

    def get_single_node(self) -> yaml.Node | None:
        """The whole document, unless it has too many values.

        Raises:
            yaml.YAMLError: With its aliases, the document has more than MAX_NODES values.
        """
        document = super().get_single_node()
        if document is not None and _num_nodes(document, {}) > MAX_NODES:
            raise yaml.constructor.ConstructorError(
                problem=f"found more than {MAX_NODES} values, with what its aliases repeat",
                problem_mark=document.start_mark,
            )
        return document

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """The mapping.

        Raises:
            yaml.YAMLError: A key is repeated, or is not text.
        """
        seen: set[str] = set()
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            if key_node.tag != "tag:yaml.org,2002:str":
                is_scalar = isinstance(key_node, yaml.ScalarNode)
                found = str(key_node.value)[:_LONGEST_SHOWN] if is_scalar else key_node.id
                raise yaml.constructor.ConstructorError(
                    problem=f"found key {found!r}, which is no text; expected a field's name, in quotes if need be",
                    problem_mark=key_node.start_mark,
                )
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    problem=f"found {key_node.value!r} twice; expected each field once",
                    problem_mark=key_node.start_mark,
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep=deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """The value of a node; an impossible value, such as the 32nd of May, is reported with its line."""
        try:
            return super().construct_object(node, deep=deep)
        except ValueError:
            found = str(node.value)[:_LONGEST_SHOWN]
            raise yaml.constructor.ConstructorError(
                problem=f"found {found!r}, which cannot be read as a value", problem_mark=node.start_mark
            ) from None


def _num_nodes(node: yaml.Node, known: dict[int, int]) -> int:
    """Number of values in a node with every alias written out; `known` holds the nodes that were counted before."""
    if id(node) not in known:
        known[id(node)] = 1  # for a list that contains itself, which JSON refuses
        inner = node.value if isinstance(node, yaml.CollectionNode) else ()
        parts = [part for item in inner for part in (item if isinstance(item, tuple) else (item,))]
        known[id(node)] = 1 + sum(_num_nodes(part, known) for part in parts)
    return known[id(node)]
