"""Ownership sentences and graphs: known answers, and the constraints of the splits in the released episodes."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.episodes.dataset import PersonalDataset
from sim.episodes.ownership import (
    OwnershipEdge,
    anonymous_summary,
    graph_from_sentences,
    normalise_phrase,
    ownership_graph,
    parse_ownership,
)
from sim.episodes.schema import EpisodeRecord
from sim.errors import DatasetError
from tests.sim.synthetic import example_episode, write_dataset


@pytest.mark.parametrize(
    ("sentence", "owner", "phrase", "room"),
    [
        ("Ada owns a low oak table in the lounge", "Ada", "a low oak table", "lounge"),
        ("Bo owns a plant in a pot in the study of Ada", "Bo", "a plant in a pot", "study of Ada"),
        ("Bo owns a desk. it is red. in the study. ", "Bo", "a desk. it is red", "study"),
        ("Bo owns a shelf next to the door.", "Bo", "a shelf next to the door", None),
        ("Ada owns a mug that says Bo owns me in the study", "Ada", "a mug that says Bo owns me", "study"),
    ],
)
def test_a_sentence_gives_owner_phrase_and_room(sentence: str, owner: str, phrase: str, room: str | None) -> None:
    assert parse_ownership(sentence) == OwnershipEdge(owner, phrase, room)


@pytest.mark.parametrize(
    "sentence", ["", "Ada has a desk in the study", "Ada owns  in the study", " owns a desk", "Ada owns ."]
)
def test_a_sentence_without_owner_or_object_is_refused_in_one_line(sentence: str) -> None:
    with pytest.raises(DatasetError, match="expected '<Name> owns <object> in the <room>'") as caught:
        parse_ownership(sentence)
    assert repr(sentence) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_leading_articles_case_and_punctuation_do_not_distinguish_objects_but_inner_articles_do() -> None:
    assert normalise_phrase(" The  low, OAK table.") == "low oak table"
    graph = graph_from_sentences(["Ada owns coats in the closet of the hall", "Ada owns coats in the closet of hall"])
    assert graph.objects == ("coats in closet of the hall", "coats in closet of hall")


@pytest.mark.slow
@given(
    owner=st.from_regex(r"[A-Z][a-z]{1,8}", fullmatch=True),
    words=st.from_regex(r"[a-z]{1,6}( [a-z]{3,6}){0,4}", fullmatch=True),
)
def test_parsing_inverts_writing(owner: str, words: str) -> None:
    edge = parse_ownership(f"{owner} owns the {words} in the kitchen")
    assert edge.owner == owner
    assert edge.room == "kitchen"
    assert edge.phrase == f"the {words}"


def test_a_graph_has_the_counts_computed_by_hand_and_an_empty_one_has_zeros() -> None:
    graph = graph_from_sentences(
        [
            "Ada owns a desk in the study",
            "Ada owns the lamp in the hall",
            "Bo owns A Lamp in the Hall.",
            "Bo owns a lamp in the hall",
            "Cy owns a rug",
        ]
    )
    assert graph.people == ("Ada", "Bo", "Cy")
    assert graph.objects == ("desk in study", "lamp in hall", "rug")
    assert len(graph.edges) == 4
    assert graph.num_objects_of == {"Ada": 2, "Bo": 1, "Cy": 1}
    assert graph.num_owners_of == {"desk in study": 1, "lamp in hall": 2, "rug": 1}
    assert graph.shared == ("lamp in hall",)
    assert graph.density == pytest.approx(4 / 9)
    assert graph.degree_per_person == pytest.approx(4 / 3)
    assert graph.degree_per_object == pytest.approx(4 / 3)
    assert graph.overlap_ratio == pytest.approx(1 / 3)
    graph = graph_from_sentences([])
    assert (graph.density, graph.degree_per_person, graph.degree_per_object, graph.overlap_ratio) == (0, 0, 0, 0)


def test_an_error_about_a_bad_sentence_names_the_episode(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    episode = next(PersonalDataset(tmp_path).episodes())
    assert ownership_graph(episode).people == ("Ada", "Bo")
    bad = type(episode)(episode.key, episode.record.model_copy(update={"extracted_summary": ("nobody",)}), ())
    with pytest.raises(DatasetError, match=r"easy/Zz0ExampleZ/3: ownership sentence: found 'nobody'"):
        ownership_graph(bad)


def test_descriptions_that_differ_only_in_names_are_the_same_when_anonymous() -> None:
    first = EpisodeRecord.model_validate(example_episode(owner="Ada"))
    second = EpisodeRecord.model_validate(example_episode(owner="Eve"))
    assert anonymous_summary(first)[0] == anonymous_summary(second)[0]
    assert anonymous_summary(second)[1] == {"Eve": 1, "Bo": 2}
    record = EpisodeRecord.model_validate(
        example_episode(
            summary="Jackson owns the desk and Jack's rug is red.",
            extracted_summary=["Jack owns a rug in the hall", "Jackson owns a desk in the hall"],
        )
    )
    assert anonymous_summary(record) == ("<1> owns the desk and <2>'s rug is red.", {"Jackson": 1, "Jack": 2})


@pytest.mark.slow
def test_released_episodes_keep_the_constraints_of_section_9_except_for_known_ones(dataset_root: Path) -> None:
    graphs = {str(episode.key): ownership_graph(episode) for episode in PersonalDataset(dataset_root).episodes()}
    of_split = {s: {k: g for k, g in graphs.items() if k.startswith(s)} for s in ("easy", "medium", "hard")}

    assert {k for k, g in of_split["easy"].items() if g.shared} == {"easy/y9hTuugGdiq/48", "easy/y9hTuugGdiq/50"}
    assert all(max(g.num_objects_of.values()) == 1 for g in of_split["easy"].values())
    assert not [k for k, g in of_split["medium"].items() if g.shared]
    assert sum(max(g.num_objects_of.values()) == 1 for g in of_split["medium"].values()) == 37
    assert {k for k, g in of_split["hard"].items() if max(g.num_objects_of.values()) == 1 or not g.shared} == {
        "hard/h1zeeAwLh9Z/934",
        "hard/h1zeeAwLh9Z/935",
    }
    assert max(max(g.num_objects_of.values()) for g in graphs.values()) == 3
    assert max(max(g.num_owners_of.values()) for g in graphs.values()) == 8
