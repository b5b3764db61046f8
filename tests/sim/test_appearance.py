"""Captions become finishes: colours, patterns and materials of the object itself, not of its surroundings."""

from pathlib import Path

import pytest

from sim.episodes.dataset import PersonalDataset
from sim.homes.furniture.appearance import finish_from_text
from sim.words.captions import OwnWords, own_words
from sim.words.colours import COLOURS, OF_MATERIAL, colours_in, shaded, tinted

WHITE, RED, BLUE = COLOURS["white"], COLOURS["red"], COLOURS["blue"]


@pytest.mark.parametrize(
    ("text", "category", "colour"),
    [
        ("white sofa with red pillows", "couch", WHITE),
        ("white couch next to the red armchair", "couch", WHITE),
        ("table with a blue vase on it. it is a white table", "table", WHITE),
        ("the chair near the blue rug. it is red", "chair", RED),
        ("brown vase located over a white counter", "counter", WHITE),
        ("the couch is red and it is near a blue curtain", "couch", RED),
        ("mirror with blue frame above the white sink", "mirror", BLUE),
        ("bed with blue sheets near a red chair", "bed", BLUE),
        ("plant with a red pot", "plant", RED),
        ("balck chair", "chair", COLOURS["black"]),
    ],
)
def test_the_colour_is_that_of_the_object_itself(text: str, category: str, colour: tuple[int, int, int]) -> None:
    assert finish_from_text(text, category).rgb == colour


@pytest.mark.parametrize(
    "text", ["chair next to a blue sofa", "the chair under the red picture", "table near it. There is a red rug"]
)
def test_colours_of_other_objects_do_not_count(text: str) -> None:
    assert finish_from_text(text, "table" if text.startswith("table") else "chair").rgb not in (BLUE, RED)


def test_shades_mixtures_and_tints_are_colours_of_their_own() -> None:
    assert colours_in(["dark", "blue"]) == [shaded(BLUE, -0.42)]
    assert sum(colours_in(["light", "grey"])[0]) > sum(COLOURS["grey"])
    red, brown = COLOURS["red"], COLOURS["brown"]
    mixed = tuple((a + b) // 2 for a, b in zip(red, brown, strict=True))
    assert finish_from_text("plaid couch, red-brown", "couch").rgb == mixed
    assert finish_from_text("off-white chair", "chair").rgb == WHITE
    assert tinted((100, 200, 10), 1.5) == (150, 255, 15)


@pytest.mark.parametrize(
    ("text", "category", "material", "pattern"),
    [
        ("plaid couch, red-brown", "couch", "fabric", "plaid"),
        ("blue and white striped towel", "towel", "fabric", "striped"),
        ("pillow with flowers", "pillow", "fabric", "floral"),
        ("red rug with a floral pattern", "rug", "carpet", "floral"),
        ("polka dotted blanket", "blanket", "fabric", "dotted"),
        ("checkered armchair", "armchair", "fabric", "checked"),
        ("brown leather armchair", "armchair", "leather", "plain"),
        ("stainless steel refrigerator near a wooden table", "refrigerator", "metal", "plain"),
        ("oak table", "table", "wood", "plain"),
        ("kitchen counter made of granite", "kitchen counter", "stone", "plain"),
        ("painting of red flowers", "picture", "picture", "plain"),
        ("wicker basket", "basket", "wicker", "plain"),
        ("yellow and blue pillow", "pillow", "fabric", "patterned"),
    ],
)
def test_materials_and_patterns_are_found(text: str, category: str, material: str, pattern: str) -> None:
    finish = finish_from_text(text, category)
    assert (finish.material, finish.pattern) == (material, pattern)


def test_a_pattern_has_both_its_colours_and_a_picture_not_the_colour_of_its_frame() -> None:
    finish = finish_from_text("blue and white striped sofa near a red rug", "couch")
    assert (finish.rgb, finish.rgb2) == (BLUE, WHITE)
    assert finish_from_text("picture with golden frame", "picture").rgb != COLOURS["golden"]


def test_unsaid_finishes_are_usual_ones_and_own_words_leave_out_the_surroundings() -> None:
    assert finish_from_text("", "toilet") == finish_from_text("", "toilet")
    assert finish_from_text("", "toilet").material == "ceramic"
    assert finish_from_text("", "fire extinguisher").rgb == RED
    assert len({finish_from_text(f"number {k}", "chair").rgb for k in range(30)}) >= 5
    words = own_words("the round wooden table next to the L-shaped couch. it has drawers", "table").all
    assert {"round", "wooden"} <= words
    assert "couch" not in words
    assert {"l", "grey"} <= own_words("grey L-shaped couch", "couch").all


@pytest.mark.slow
def test_colours_are_found_in_half_of_the_released_captions(dataset_root: Path) -> None:
    dataset = PersonalDataset(dataset_root)
    captions: dict[tuple[str, str], str] = {}
    categories: dict[tuple[str, str], str] = {}
    for scene in dataset.scenes:
        goals = dataset.goals(scene)
        for episode in dataset.episodes(scenes=(scene,)):
            for name, texts in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
                if texts:
                    captions.setdefault((scene, name), texts[0])
                    categories[(scene, name)] = goals[name].object_category
    found = [_names_colour(own_words(text, categories[key])) for key, text in captions.items()]
    assert len(found) > 800
    # 71 % hold a colour or material word somewhere, but some of these words describe other objects
    assert 0.45 <= sum(found) / len(found) <= 0.65


def _names_colour(said: OwnWords) -> bool:
    is_coloured = any(colours_in(words) for words in (said.noun, said.rest, said.parts))
    return is_coloured or any(word in OF_MATERIAL for word in (*said.noun, *said.rest, *said.parts))
