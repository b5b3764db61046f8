"""Parts of the sentences that the program writes."""

import pytest

from sim.words.english import age, countdown, disk_size, duration, how_many, length, waiting_time, with_article


def test_phrases_get_their_article_and_lengths_and_sizes_the_usual_unit() -> None:
    assert with_article("oak desk") == "an oak desk"
    assert with_article("green armchair") == "a green armchair"
    assert [length(metres) for metres in (0.1, 1.0, 1.5)] == ["10 centimetres", "1 metre", "1.5 metres"]
    assert [disk_size(mb) for mb in (512, 2048)] == ["512 MB", "2.0 GB"]


def test_one_object_is_singular_and_durations_are_whole_minutes_or_seconds() -> None:
    assert [how_many(count, "home") for count in (0, 1, 2, 1200)] == ["0 homes", "1 home", "2 homes", "1,200 homes"]
    assert how_many(1, "person", "people") == "1 person"
    assert how_many(6, "person", "people") == "6 people"
    assert [how_many(metres, "metre") for metres in (0.5, 1.0, 1.5)] == ["0.5 metres", "1 metre", "1.5 metres"]
    assert [duration(seconds) for seconds in (1, 59, 60, 90)] == ["1 second", "59 seconds", "1 minute", "90 seconds"]
    assert [countdown(seconds) for seconds in (1, 59, 65)] == ["1 second", "59 seconds", "1:05 minutes"]
    assert [waiting_time(seconds) for seconds in (1, 61, 7200)] == ["one minute", "2 minutes", "2 hours"]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, "–"), (0.4, "0 s"), (119.0, "119 s"), (120.0, "2 min"), (7200.0, "2 h"), (200_000.0, "2 d")],
)
def test_ages_are_written_in_the_largest_unit_that_fits(seconds: float | None, words: str) -> None:
    assert age(seconds) == words
