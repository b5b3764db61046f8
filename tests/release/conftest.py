"""Gives all tests of this folder the marker `release` and prints each difference from a literal on its own line."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks every test of this folder, so that it runs with `make release`, not with `make test`."""
    for item in items:
        if item.path.is_relative_to(HERE) and item.get_closest_marker("bench") is None:
            item.add_marker(pytest.mark.release)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(900))


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """All differences from a literal, one per line."""
    if op == "==" and right == [] and isinstance(left, list):
        return [f"{len(left)} values differ from the literal", *map(str, left)]
    return None
