"""Agreement against published answers."""

import numpy as np
import pytest

from human_study.report.agreement import common_place, counts_of, gwet_ac1, krippendorff_alpha

FOUR_CODERS = ("123321412...", "1233224125.3", ".3332342251.", "12332441251.")
"""Krippendorff, "Computing Krippendorff's alpha-reliability" (2011), section C: 12 units, 5 categories, gaps."""


def example() -> np.ndarray:
    labels = [(unit, int(value) - 1) for coder in FOUR_CODERS for unit, value in enumerate(coder) if value != "."]
    return counts_of([label for _, label in labels], np.array([unit for unit, _ in labels]), num_categories=5)


def test_the_published_example() -> None:
    assert krippendorff_alpha(example()) == pytest.approx(0.743, abs=5e-4)
    assert gwet_ac1(example()) == pytest.approx(0.775, abs=1e-3)


def test_perfect_agreement_is_one_and_nothing_to_compare_is_nothing() -> None:
    alike = np.array([[3, 0], [0, 3], [3, 0]])
    assert krippendorff_alpha(alike) == pytest.approx(1)
    assert gwet_ac1(alike) == pytest.approx(1)
    assert krippendorff_alpha(np.array([[3, 0], [3, 0]])) is None  # nobody ever differs: chance cannot be told
    assert gwet_ac1(np.array([[3, 0], [3, 0]])) == pytest.approx(1)
    assert krippendorff_alpha(np.array([[1, 0], [0, 1]])) is None
    assert gwet_ac1(np.array([[1, 0], [0, 1]])) is None


def test_a_common_place_needs_its_share() -> None:
    points = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.6], [7.0, 7.0]])
    place = common_place(points, radius=1.0, share=0.75)
    assert place is not None
    assert np.linalg.norm(place) <= 0.6
    assert common_place(points, radius=1.0, share=0.8) is None
