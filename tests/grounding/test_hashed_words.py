"""Hashed words: published hashes, terms, and cosines computed by hand."""

import numpy as np
import pytest

from grounding.checks import check_encoder
from grounding.encoders.by_name import make_encoder
from grounding.encoders.hashed import HashedWords, murmur3, terms


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("foo", 0xF6A5C420),
        ("hello", 0x248BFA47),
        ("hello, world", 0x149BBB7F),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_murmur3_gives_the_published_hashes(text: str, expected: int) -> None:
    assert murmur3(text.encode()) == expected


def test_terms_are_words_without_stop_words_and_pairs_of_neighbours() -> None:
    assert terms("Find Ada's RED chair, on the left.") == [
        "ada",
        "red",
        "chair",
        "left",
        "ada red",
        "red chair",
        "chair left",
    ]


def test_places_and_cosines_equal_those_computed_by_hand_and_stop_words_give_a_zero_row() -> None:
    # murmur3("foo") = 0xF6A5C420 is -156908512 as a signed number, and 156908512 % 768 = 736
    vector = HashedWords().encode_texts(["foo"])[0]
    assert vector[736] == -1
    assert np.count_nonzero(vector) == 1
    # red, chair, "red chair" and red, sofa, "red sofa" share one of three terms
    first, second = HashedWords().encode_texts(["a red chair", "the red sofa"])
    assert float(first @ second) == pytest.approx(1 / 3)
    assert not HashedWords().encode_texts(["where is the", ""]).any()


def test_word_order_matters_but_case_and_punctuation_do_not() -> None:
    upper, lower, turned = HashedWords().encode_texts(["Oak TABLE!", "oak table", "table oak"])
    assert np.array_equal(upper, lower)
    assert float(lower @ turned) == pytest.approx(2 / 3)


@pytest.mark.slow
def test_hashed_words_keep_the_contract_of_encoders() -> None:
    assert check_encoder(make_encoder("hashed")) == []
