"""Words of invented homes: captions that are true, and descriptions that say who owns what in varied sentences."""

import re

import numpy as np
import pytest

from sim.authoring.captions import are_mixed_up, caption_of, ownership_sentence
from sim.authoring.descriptions import OwnedItem, write_description
from sim.episodes.ownership import parse_ownership, queries_for
from sim.homes.invented.plans import invent_plan
from sim.homes.plan import Furniture, HomePlan, Opening, Rect, Wall

from . import plans
from .plans import GROUND, Vec


def piece(category: str, look: str, centre: Vec, size: Vec) -> Furniture:
    return plans.piece(f"{category}_1", centre, size, caption=f"{look} {category}", room="study")


def room_with(*pieces: Furniture) -> HomePlan:
    """A study of 6 x 6 m with a window in the wall at z = 0, x = 5."""
    window = Opening(kind="window", offset=5.0, width=1.0, sill=0.9, top=2.1)
    wall = Wall(storey=0, start=(0.0, 0.0), end=(6.0, 0.0), height=2.5, openings=(window,))
    rooms = (plans.room("study", Rect(0, 0, 6, 6)),)
    return HomePlan(name="Study", kind="invented", storeys=GROUND, rooms=rooms, walls=(wall,), furniture=pieces)


DESK = piece("desk", "oak", (1.5, 0.375, 0.4), (1.2, 0.75, 0.6))


@pytest.mark.parametrize(
    ("thing", "wanted"),
    [
        (piece("vase", "blue glass", (1.2, 0.9, 0.4), (0.2, 0.3, 0.2)), "on the oak desk"),
        (piece("picture", "red", (1.5, 1.5, 0.1), (0.6, 0.5, 0.04)), "located above the oak desk"),
        (piece("chair", "red", (2.5, 0.45, 0.4), (0.5, 0.9, 0.5)), "next to the oak desk"),
        (piece("chair", "red", (3.2, 0.45, 0.4), (0.5, 0.9, 0.5)), "near the oak desk"),
        (piece("rug", "red woven", (1.5, 0.01, 0.5), (2.0, 0.02, 1.0)), "located under the oak desk"),
        (piece("plant", "green", (5.0, 0.45, 0.4), (0.4, 0.9, 0.4)), "near the window"),
        (piece("bench", "white", (5.8, 0.2, 4.0), (0.3, 0.4, 1.0)), "located against the wall"),
        (piece("bench", "white", (3.0, 0.2, 3.5), (0.3, 0.4, 1.0)), "located with space all around it"),
        (piece("desk", "white", (2.9, 0.375, 0.4), (1.2, 0.75, 0.6)), "located against the wall"),
    ],
)
def test_captions_say_where_an_object_is(thing: Furniture, wanted: str) -> None:
    assert caption_of(thing, room_with(DESK, thing)) == f"{thing.caption} {wanted}"


def test_captions_name_at_most_two_neighbours_and_none_twice() -> None:
    shelf = piece("shelf", "teal wooden", (0.5, 0.45, 1.6), (0.5, 0.9, 0.4))
    lamp = piece("lamp", "red", (1.2, 0.7, 1.4), (0.3, 1.4, 0.3))
    vase = piece("vase", "blue glass", (1.2, 0.9, 0.4), (0.2, 0.3, 0.2))
    assert (
        caption_of(lamp, room_with(DESK, shelf, lamp)) == "red lamp next to the teal wooden shelf and near the oak desk"
    )
    assert caption_of(shelf, room_with(DESK, shelf)) == "teal wooden shelf near the oak desk"
    assert caption_of(vase, room_with(DESK, vase, lamp)) == "blue glass vase on the oak desk and near the red lamp"


@pytest.mark.parametrize("seed", [0, 3])
def test_captions_of_a_home_differ_and_fit_ownership_sentences(seed: int) -> None:
    plan = invent_plan("Demo", seed=seed)
    captions = {item.name: caption_of(item, plan) for item in plan.furniture}
    assert len(set(captions.values())) == len(captions)
    assert min(len(caption.split()) for caption in captions.values()) >= 4
    for item in plan.furniture:
        caption = captions[item.name]
        assert item.category in re.split(r"\b(?:near|next|located|on)\b", caption, maxsplit=1)[0]
        edge = parse_ownership(ownership_sentence("Ada", caption, item.room))
        assert (edge.owner, edge.room) == ("Ada", item.room)
        assert edge.phrase.split(" ", 1)[1] == caption


def test_the_queries_are_the_six_of_the_released_episodes() -> None:
    assert queries_for("Ada", "coffee table") == (
        "Find Ada's coffee table",
        "Where is Ada's coffee table?",
        "Locate Ada's coffee table",
        "Retrieve Ada's coffee table position",
        "Identify the position of Ada's coffee table",
        "Give me the coordinates of Ada's coffee table",
    )
    assert queries_for("Ada", "chair", one_of=True)[1] == "Where is one of Ada's chairs?"


def test_two_categories_that_one_query_could_mean_count_as_mixed_up() -> None:
    assert are_mixed_up("chair", "desk chair")
    assert are_mixed_up("armchair", "chair")
    assert are_mixed_up("bed", "bed")
    assert are_mixed_up("table", "table lamp")
    assert not are_mixed_up("table", "tv stand")
    assert not are_mixed_up("rug", "drug store")


ITEMS = (
    OwnedItem("oak desk near the window", "study", ("Ada", "Bo", "Cy")),
    OwnedItem("red lamp on the oak desk", "study", ("Bo",)),
    OwnedItem("blue rug near the bed", "main bedroom", ("Dee",)),
    OwnedItem("white bed near the window", "main bedroom", ("Dee",)),
    OwnedItem("green towel near the sink", "bathroom", ("Eli",)),
)


@pytest.mark.parametrize("seed", range(40))
def test_a_description_names_every_object_once_with_its_room_and_owners(seed: int) -> None:
    text = write_description(ITEMS, floor="ground floor", rng=np.random.default_rng(seed))
    assert "ground floor" in text
    sentences = re.split(r"(?<=\.) ", text)
    for item in ITEMS:
        assert text.count(item.phrase) == 1
        sentence = next(sentence for sentence in sentences if item.phrase in sentence)
        assert item.room in sentence
        for owner in item.owners:
            assert re.search(rf"\b{owner}\b", sentence), (owner, sentence)
    assert text[0].isupper()
    assert all(sentence[0].isupper() and sentence.endswith(".") for sentence in sentences)
    assert not re.search(r"  |\.\.|a oak|an red|an? the", text)


def test_descriptions_vary() -> None:
    texts = [write_description(ITEMS, floor="ground floor", rng=np.random.default_rng(seed)) for seed in range(60)]
    assert len(set(texts)) == 60
    shapes = set()
    for text in texts:
        for sentence in re.split(r"(?<=\.) ", text):
            for item in ITEMS:
                sentence = sentence.replace(item.phrase, "_").replace(item.room, "_")
            shapes.add(re.sub(r"\b(?:Ada|Bo|Cy|Dee|Eli)\b", "N", sentence))
    assert len(shapes) >= 40
