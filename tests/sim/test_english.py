"""Parts of the sentences that the program writes."""

import pytest

from sim.words.english import age, disk_size, how_many, with_article


def test_phrases_get_their_article_and_sizes_the_usual_unit() -> None:
    assert with_article("oak desk") == "an oak desk"
    assert with_article("green armchair") == "a green armchair"
    assert [disk_size(mb) for mb in (512, 2048)] == ["512 MB", "2.0 GB"]


def test_one_object_is_singular() -> None:
    assert [how_many(count, "home") for count in (0, 1, 2, 1200)] == ["0 homes", "1 home", "2 homes", "1,200 homes"]
    assert how_many(1, "person", "people") == "1 person"
    assert how_many(6, "person", "people") == "6 people"
    assert [how_many(metres, "metre") for metres in (0.5, 1.0, 1.5)] == ["0.5 metres", "1 metre", "1.5 metres"]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, "–"), (0.4, "0 s"), (119.0, "119 s"), (120.0, "2 min"), (7200.0, "2 h"), (200_000.0, "2 d")],
)
def test_ages_are_written_in_the_largest_unit_that_fits(seconds: float | None, words: str) -> None:
    assert age(seconds) == words
