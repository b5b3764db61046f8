"""Which family draws which category, how large a piece is and where it is mounted."""

from pathlib import Path
from typing import get_args

import pytest

from sim.episodes.dataset import PersonalDataset
from sim.homes.furniture.families import UNKNOWN, Family, Mounting, look_of
from sim.homes.furniture.parts import BUILDERS

from .furniture_catalogue import README, RELEASE_CATEGORIES, WORDS, catalogue


@pytest.mark.slow
def test_the_list_holds_all_released_categories(dataset_root: Path) -> None:
    dataset = PersonalDataset(dataset_root)
    found = {goal.object_category for scene in dataset.scenes for goal in dataset.goals(scene).values()}
    assert tuple(sorted(found)) == RELEASE_CATEGORIES
    assert len(found) == 143


def test_every_released_category_has_a_family_and_every_family_has_a_builder_a_word_and_a_readme_line() -> None:
    assert [category for category in RELEASE_CATEGORIES if look_of(category) is UNKNOWN] == []
    assert set(BUILDERS) == set(get_args(Family))
    assert {look_of(word).family for word in WORDS} == set(get_args(Family))
    assert README.read_text(encoding="utf-8") == catalogue()


@pytest.mark.parametrize(
    ("category", "family"),
    [
        ("sink cabinet", "cabinet"),  # the longest known word counts, not the first one
        ("shower dial", "dial"),
        ("clothes dryer", "washing machine"),
        ("flower vase", "flowers"),
        ("tv stand", "cabinet"),
        ("refrigerator cabinet", "wardrobe"),
        ("garden chair", "chair"),  # not in the table itself
        ("Washer-Dryer", "washing machine"),
        ("bookcases", "shelf"),
        ("never seen", "box"),
    ],
)
def test_a_category_is_drawn_by_its_longest_known_words(category: str, family: str) -> None:
    assert look_of(category).family == family


@pytest.mark.parametrize(
    ("category", "mounting"),
    [("picture", "wall"), ("chandelier", "ceiling"), ("microwave", "on"), ("couch", "floor"), ("never seen", "floor")],
)
def test_objects_are_mounted_where_they_usually_are(category: str, mounting: Mounting) -> None:
    assert look_of(category).mounting == mounting


def test_usual_sizes_are_plausible_in_a_home() -> None:
    for word in WORDS:
        width, height, depth = look_of(word).size
        assert 0.05 <= width <= 2.1, word
        assert 0.01 <= height <= 2.5, word
        assert 0.02 <= depth <= 2.1, word
    assert look_of("dining table").size == (1.5, 0.75, 0.9)
    assert look_of("couch").size[0] > 2 * look_of("armchair").size[0]
