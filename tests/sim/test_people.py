"""Drawn ownership graphs keep the rule of their split, and a graph that cannot be drawn is an error."""

import itertools

import numpy as np
import pytest

from sim.authoring.generation import CATEGORIES
from sim.authoring.people import NAMES, Edge, broken_rule, draw_ownership
from sim.errors import DatasetError
from sim.types import SPLITS, Split


@pytest.mark.parametrize("split", SPLITS)
def test_drawn_graphs_keep_the_rule_for_many_seeds(split: Split) -> None:
    conflicts = np.eye(12, dtype=bool)
    conflicts[0, 1] = conflicts[1, 0] = True
    for seed in range(60):
        edges = draw_ownership(split, conflicts, rng=np.random.default_rng(seed))
        assert broken_rule(split, edges) is None
        assert {edge.item for edge in edges} == set(range(max(edge.item for edge in edges) + 1))
        assert {edge.person for edge in edges} == set(range(max(edge.person for edge in edges) + 1))
        owned = [{edge.item for edge in edges if edge.person == person} for person in range(8)]
        assert not any({0, 1} <= items for items in owned)


def test_graphs_are_about_as_large_as_in_the_released_episodes() -> None:
    # people, objects and edges per released episode (DATA_FORMAT.md section 10)
    sizes: dict[Split, tuple[float, float, float]] = {
        "easy": (3.94, 3.94, 3.94),
        "medium": (3.31, 5.71, 5.71),
        "hard": (6.15, 7.10, 15.01),
    }
    for split, wanted in sizes.items():
        drawn = [draw_ownership(split, np.eye(12, dtype=bool), rng=np.random.default_rng(s)) for s in range(300)]
        people = np.mean([len({edge.person for edge in edges}) for edges in drawn])
        items = np.mean([len({edge.item for edge in edges}) for edges in drawn])
        assert people == pytest.approx(wanted[0], rel=0.15)
        assert items == pytest.approx(wanted[1], rel=0.15)
        assert np.mean([len(edges) for edges in drawn]) == pytest.approx(wanted[2], rel=0.15)


@pytest.mark.parametrize(
    ("split", "edges", "wanted"),
    [
        ("easy", [Edge(0, 0), Edge(1, 0)], "an object has several owners"),
        ("easy", [Edge(0, 0), Edge(0, 1)], "somebody owns several objects"),
        ("medium", [Edge(0, 0), Edge(1, 1)], "nobody owns several objects"),
        ("hard", [Edge(0, 0), Edge(0, 1)], "no object has several owners"),
        ("hard", [Edge(0, 0), Edge(1, 0)], "nobody owns several objects"),
        ("medium", [Edge(0, k) for k in range(4)], "somebody owns more than 3 objects"),
        ("easy", [Edge(0, 0), Edge(0, 0)], "an edge appears twice"),
        ("hard", [Edge(0, 0), Edge(0, 1), Edge(1, 1)], None),
    ],
)
def test_broken_rules_are_named(split: Split, edges: list[Edge], wanted: str | None) -> None:
    assert broken_rule(split, edges) == wanted


@pytest.mark.parametrize("split", SPLITS)
def test_a_graph_that_cannot_be_drawn_is_an_error(split: Split) -> None:
    with pytest.raises(DatasetError, match=f"found no graph for split '{split}' over 2 objects"):
        draw_ownership(split, np.zeros((2, 2), bool), rng=np.random.default_rng(0))
    if split != "easy":  # all objects have one category, so no person may own two
        with pytest.raises(DatasetError, match="found no graph"):
            draw_ownership(split, np.ones((8, 8), bool), rng=np.random.default_rng(0))


def test_no_name_is_the_beginning_of_another_or_a_word_of_a_category() -> None:
    assert len(NAMES) == len(set(NAMES)) >= 90
    assert not any(a != b and b.startswith(a) for a, b in itertools.product(NAMES, NAMES))
    assert not {name.lower() for name in NAMES} & {word for category in CATEGORIES for word in category.split()}
