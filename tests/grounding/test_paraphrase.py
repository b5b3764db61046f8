"""Paraphrase levels of captions: changed words, kept words, and the same result each time."""

import numpy as np
import pytest

from grounding.encoders.hashed import STOP_WORDS, HashedWords
from grounding.perception.paraphrase import paraphrase
from sim.words.synonyms import REWORDINGS

CAPTION = (
    "Small round wooden table located next to the grey couch and under the window. It has a red vase on top of it."
)
MADE_UP = [
    (CAPTION, "table"),
    ("there is a tall copper lamp. the lamp is located near the striped rug and behind two armchairs", "lamp"),
    ("black leather desk chair in front of the large mirror, which is next to the door", "desk chair"),
    ("The big oval mirror with a golden frame above the white sink", "mirror"),
    ("wide bed with a purple blanket, between two brown nightstands", "bed"),
]


def words(text: str) -> set[str]:
    return {word.strip(",.").lower() for word in text.split()} - STOP_WORDS


def test_level_0_is_the_caption_level_3_the_category_and_no_word_is_its_own_synonym() -> None:
    assert paraphrase(CAPTION, "table", level=0) == CAPTION
    assert paraphrase(CAPTION, "table", level=3) == "table"
    assert all(word not in choices and choices for word, choices in REWORDINGS.items())


def test_level_1_says_the_same_in_other_words_or_another_order() -> None:
    said = paraphrase(CAPTION, "table", level=1)
    assert "table" in words(said)
    assert not words(said) & {"small", "round", "wooden", "grey", "couch", "window", "red"}
    assert "sofa" in words(said)
    assert len(words(said)) >= 8
    turned = {paraphrase("velvet quilted footstool", "footstool", level=1, seed=seed) for seed in range(20)}
    assert turned == {"velvet quilted footstool", "quilted velvet footstool"}


def test_level_2_keeps_half_of_the_attributes_in_the_annotators_words() -> None:
    # three of six attributes stay: small, round, wooden, next to the couch, under the window, a red vase
    for seed in range(10):
        said = paraphrase(CAPTION, "table", level=2, seed=seed)
        own = words(said) & {"small", "round", "wooden"}
        others = [part for part in ("couch", "window", "vase") if part in words(said)]
        assert len(own) + len(others) == 3
        assert words(said) <= words(CAPTION)
        assert "table" in words(said)


@pytest.mark.parametrize("level", [1, 2])
def test_a_category_that_the_caption_lacks_is_added(level) -> None:
    assert paraphrase("the screen above the fireplace", "led tv", level=level).startswith("led tv, ")


@pytest.mark.parametrize("level", [1, 2])
def test_a_category_alone_stays(level) -> None:
    assert paraphrase("desk chair", "desk chair", level=level) == "desk chair"
    assert paraphrase("", "desk chair", level=level) == "desk chair"
    assert paraphrase("the table is there.", "table", level=level) == "the table"


@pytest.mark.parametrize("level", [1, 2])
def test_the_category_is_never_replaced(level) -> None:
    for seed in range(10):
        said = paraphrase("brown couch near the other couch", "couch", level=level, seed=seed)
        assert "couch" in said
        assert "sofa" not in said


def test_the_same_seed_gives_the_same_words_and_another_seed_gives_others() -> None:
    for level in (1, 2):
        first = [paraphrase(text, category, level=level) for text, category in MADE_UP]
        assert first == [paraphrase(text, category, level=level) for text, category in MADE_UP]
        assert first != [paraphrase(text, category, level=level, seed=1) for text, category in MADE_UP]


def test_the_overlap_of_words_falls_as_attributes_are_dropped() -> None:
    encoder = HashedWords()
    exact = encoder.encode_texts([text for text, _ in MADE_UP])
    means = []
    for level in (0, 2, 3):
        said = encoder.encode_texts([paraphrase(text, category, level=level) for text, category in MADE_UP])
        means.append(float(np.mean((exact * said).sum(axis=1))))
    assert means[0] == pytest.approx(1)
    assert means[0] > means[1] + 0.2
    assert means[1] > means[2] + 0.1
