"""Agreement of phrases by hand."""

import pytest

from tests.grounding.phrase_scores import phrase_scores

REFERENCE = ["Ada owns a red lamp in the hall", "Bo owns the oak desk in the study"]


def test_the_same_phrases_agree_wholly() -> None:
    scores = phrase_scores([REFERENCE], [REFERENCE[::-1]])
    assert (scores.pair_f1, scores.pair_overlap_f1, scores.owner_f1) == (1.0, 1.0, 1.0)
    assert scores.num_descriptions == 1


def test_one_missing_and_one_wrong_pair_by_hand() -> None:
    found = ["Ada owns a red lamp in the hall", "Cy owns the oak desk in the study"]
    scores = phrase_scores([found], [REFERENCE])
    # 1 of 2 found, 1 of 2 wanted
    assert scores.pair_f1 == pytest.approx(0.5)
    assert scores.owner_f1 == pytest.approx(0.5)


def test_a_longer_phrase_counts_by_overlap_and_not_by_tokens() -> None:
    long = "Ada owns a red lamp, small brass feet, wicker basket, round cushion, striped curtain, in the hall"
    scores = phrase_scores([[long]], [["Ada owns a red lamp in the hall"]])
    assert scores.pair_f1 == 0.0
    assert scores.pair_overlap_f1 == 1.0


def test_each_phrase_matches_one_other_only() -> None:
    scores = phrase_scores([["Ada owns a red lamp"] * 2], [["Ada owns a red lamp"]])
    assert scores.pair_f1 == pytest.approx(2 / 3)


def test_counts_are_taken_over_all_descriptions_together() -> None:
    scores = phrase_scores([REFERENCE, []], [REFERENCE, ["Cy owns a rug", "Cy owns a bed"]])
    assert scores.pair_f1 == pytest.approx(2 * 2 / (2 + 4))
    assert phrase_scores([[]], [[]]).pair_f1 == 1.0
    with pytest.raises(ValueError, match="argument"):
        phrase_scores([[]], [])
