"""Which floor each storey is: by the numbers of the objects on it, in the habit that the study chose."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim.homes.storey_names import StoreyNaming, floors_above_ground, storey_labels


def goals(*found: tuple[str, float]) -> list[Any]:
    """Objects with this number of their storey, on a floor at this height."""
    return [SimpleNamespace(floor_id=number, floor_y=y) for number, y in found]


@pytest.mark.parametrize(
    ("heights", "found", "labels"),
    [
        ((0.0, 3.0), [("0", 0.1), ("1", 2.9)], (0, 1)),
        ((0.0, 3.0), [("1", 0.0), ("2", 3.0)], (1, 2)),  # the American habit
        ((0.0, 3.0), [("0", 0.0), ("1", 3.0), ("0", 3.1), ("1", 3.0)], (0, 1)),  # most say 1
        ((-2.7, 0.0, 2.9), [("0", -2.7), ("2", 2.9)], (0, 1, 2)),  # nothing is known of the one between
        ((-2.7, 2.9), [("0", -2.7), ("2", 2.9)], (0, 2)),  # a storey that nobody recorded
        ((-3.0, 0.0, 3.0), [("-1", -3.0), ("0", 0.0)], (-1, 0, 1)),
        ((0.0, 3.0), [("1", 0.0), ("0", 3.0)], (0, 1)),  # numbers that fall say nothing
        ((0.0, 3.0), [("upper", 3.0)], (0, 1)),
        ((0.0, 3.0), [], (0, 1)),
    ],
)
def test_a_storey_has_the_number_of_its_objects(
    heights: tuple[float, ...], found: list[tuple[str, float]], labels: tuple[int, ...]
) -> None:
    assert storey_labels(heights, goals(*found)) == labels


@pytest.mark.parametrize(
    ("labels", "naming", "floors"),
    [
        ((0, 1), "british", (0, 1)),
        ((0, 1), "american", (1, 2)),
        ((0, 1), "texts", (0, 1)),
        ((1, 2), "british", (0, 1)),
        ((1, 2), "american", (1, 2)),
        ((1, 2), "texts", (1, 2)),
        ((-1, 0, 1), "british", (-1, 0, 1)),
        ((-1, 0, 1), "american", (-1, 1, 2)),
        ((-2, -1), "american", (-2, -1)),
        ((0, 2), "british", (0, 2)),
        ((5, 7), "numbers", (0, 1)),
    ],
)
def test_each_habit_counts_from_its_own_ground(
    labels: tuple[int, ...], naming: StoreyNaming, floors: tuple[int, ...]
) -> None:
    assert floors_above_ground(labels, naming) == floors
