"""Articles and plurals of sentences that programs write."""

from sim.words.english import how_many, with_article


def test_a_phrase_gets_its_article() -> None:
    assert with_article("oak desk") == "an oak desk"
    assert with_article("green armchair") == "a green armchair"


def test_one_thing_is_singular_and_all_other_numbers_are_plural() -> None:
    assert [how_many(count, "home") for count in (0, 1, 2, 1200)] == ["0 homes", "1 home", "2 homes", "1,200 homes"]
    assert how_many(1, "person", "people") == "1 person"
    assert how_many(6, "person", "people") == "6 people"
    assert [how_many(metres, "metre") for metres in (0.5, 1.0, 1.5)] == ["0.5 metres", "1 metre", "1.5 metres"]
