"""Compares values with a literal: every field of the literal must exist and be equal; new fields may be added."""

import math
from typing import Any


def differences(expected: Any, found: Any, *, rel: float = 0.0, absolute: float = 0.0, where: str = "") -> list[str]:
    """One line per value that differs; [] if none does.

    Args:
        expected: JSON values. Objects may have more fields in `found`; lists have the same length.
        found: JSON values that the program returns today.
        rel: Largest relative difference of two numbers.
        absolute: Largest absolute difference of two numbers. It is enough to keep one of the two limits.
        where: Path of the value; each line begins with it.
    """
    if isinstance(expected, dict) and isinstance(found, dict):
        lines = [f"{where}/{key}: missing; expected {expected[key]!r}" for key in expected if key not in found]
        for key in expected.keys() & found.keys():
            lines += differences(expected[key], found[key], rel=rel, absolute=absolute, where=f"{where}/{key}")
        return sorted(lines)
    if isinstance(expected, list) and isinstance(found, list | tuple):
        if len(expected) != len(found):
            return [f"{where}: {len(found)} values; expected {len(expected)}"]
        lines = []
        for number, (one, other) in enumerate(zip(expected, found, strict=True)):
            lines += differences(one, other, rel=rel, absolute=absolute, where=f"{where}[{number}]")
        return lines
    if _is_number(expected) and _is_number(found):
        is_same = expected == found or math.isclose(expected, found, rel_tol=rel, abs_tol=absolute)
    else:
        is_same = expected == found and isinstance(found, bool) == isinstance(expected, bool)
    return [] if is_same else [f"{where}: {found!r}; expected {expected!r}"]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
