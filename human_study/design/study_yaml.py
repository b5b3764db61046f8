"""Reads a YAML file that a person wrote as JSON text for a model to check; each error is one line."""

import json
from pathlib import Path
from typing import Any

import yaml

from sim.errors import StudyError
from sim.files import bounded_bytes

MAX_BYTES = 128 << 10
"""Largest file; a study has 3 kB, and reading a megabyte takes seconds."""
MAX_NODES = 20_000
"""Most values in a file, including those that an alias repeats."""
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
