"""The comparison with literals reports every difference and nothing else."""

import pytest

from .differences import differences


@pytest.mark.parametrize(
    ("expected", "found", "line"),
    [
        ({"a": 1}, {"b": 1}, "/a: missing; expected 1"),
        ({"a": {"b": 1.0}}, {"a": {"b": 1.1}}, "/a/b: 1.1; expected 1.0"),
        ([1, 2], [1], ": 1 values; expected 2"),
        (1, True, ": True; expected 1"),
        (0, None, ": None; expected 0"),
        (None, 0.0, ": 0.0; expected None"),
        ({"a": [1]}, {"a": "x"}, "/a: 'x'; expected [1]"),
    ],
)
def test_a_difference_is_named(expected, found, line: str) -> None:
    assert differences(expected, found, rel=0.05) == [line]


def test_new_fields_and_small_differences_pass() -> None:
    assert differences({"a": 100.0, "b": [1]}, {"a": 100.05, "b": (1,), "new": 3}, rel=0.001) == []
    assert differences([1.0], [1.0009], absolute=0.001) == []
    assert differences([1.0], [1.0011], absolute=0.001) != []
