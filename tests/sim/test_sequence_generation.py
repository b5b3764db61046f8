"""Generated home sequences: guarantees hold, the same seed gives the same bytes, refusals name their guarantee."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.authoring.annotated import Thing, captioned_goals, phrase_of
from sim.authoring.content import content_file, index_file, packed, write_files
from sim.authoring.edition import OpenedHome, opened_home
from sim.authoring.findable import Finder
from sim.authoring.sequences import generation
from sim.authoring.sequences.checks import validate_sequences
from sim.authoring.sequences.homes import LENGTHS, HomeSequences, SetSoFar
from sim.authoring.sequences.stories import Change, Needs, Setting, StoryError, draw_story
from sim.authoring.sequences.texts import PHRASINGS, Told, message_text, released_intros
from sim.episodes.checks_geometry import GEODESIC_LIMITS
from sim.episodes.dataset import PersonalDataset
from sim.episodes.ownership import queries_for
from sim.episodes.schema import EpisodeInfo, EpisodeRecord, Goal
from sim.episodes.sequence_files import SequenceFile, SequenceSet, search_record
from sim.episodes.sequences import Edge, MessageKind, SequenceRecord
from sim.types import SPLITS

PRONOUNS = re.compile(
    r"\b(?:he|she|it|they|him|her|them|his|hers|its|their|theirs|this|that|these|those)\b", re.IGNORECASE
)


@pytest.fixture(scope="module")
def opened(small_home_root: Path) -> OpenedHome:
    """The invented home Small with its captioned objects."""
    return opened_home(small_home_root, "Small", None)


def drawn(
    opened: OpenedHome, count: int, total: SetSoFar, *, episodes: PersonalDataset | None = None, tries: int = 40
) -> SequenceFile:
    return HomeSequences(opened, episodes, total, starts="released", seed=0).draw(count, tries=tries)


@pytest.fixture(scope="module")
def total() -> SetSoFar:
    return SetSoFar()


@pytest.fixture(scope="module")
def made(opened: OpenedHome, small_home_root: Path, total: SetSoFar) -> SequenceFile:
    """Twelve sequences, counted in `total`."""
    return drawn(opened, 12, total, episodes=PersonalDataset(small_home_root))


@pytest.fixture
def written(made: SequenceFile, tmp_path: Path) -> Path:
    write_files(tmp_path, {"content/Small.json.gz": packed(made)})
    return tmp_path


def test_every_guarantee_holds_and_the_set_is_counted(written: Path, total: SetSoFar) -> None:
    report = validate_sequences(written)
    assert (report.problems, report.broken) == ((), ())
    assert report.num_sequences == 12
    assert report.subtasks == total.needs.kinds
    assert report.messages == total.needs.messages
    assert total.splits == dict.fromkeys(SPLITS, 4)
    assert (total.refused, total.lines) == ({}, [])


def test_kinds_of_searches_have_their_shares(total: SetSoFar) -> None:
    share = {kind: count / total.needs.kinds.total() for kind, count in total.needs.kinds.items()}
    assert 0.35 <= share["fresh"] <= 0.45
    assert 0.15 <= share["revisit"] <= 0.25
    assert 0.2 <= share["changed"] <= 0.32
    assert 0.08 <= share["stale"] <= 0.2


def test_all_kinds_of_messages_and_both_modes_occur(made: SequenceFile, total: SetSoFar) -> None:
    assert set(total.needs.messages) == {"intro", *PHRASINGS}
    assert {subtask.mode for record in made.sequences for subtask in record.subtasks} == {"any", "all"}


def test_the_same_seed_gives_the_same_bytes(opened: OpenedHome, made: SequenceFile, small_home_root: Path) -> None:
    again = drawn(opened, 3, SetSoFar(), episodes=PersonalDataset(small_home_root))
    assert packed(again) == packed(made.model_copy(update={"sequences": made.sequences[:3]}))
    assert again.sequences[0].generator.seed == 0


def test_distances_are_walks_from_the_start_and_from_the_object_before(
    opened: OpenedHome, made: SequenceFile, written: Path
) -> None:
    sequence = next(s for s in SequenceSet(written).sequences() if all(len(t) == 1 for t in s.targets))
    firsts = [np.array(targets[0].view_points[0].agent_state.position) for targets in sequence.targets]
    start = np.array(sequence.record.start_position)
    infos = [subtask.info for subtask in sequence.record.subtasks]
    distances = opened.home.navigation.distances
    assert LENGTHS[0] <= len(infos) <= LENGTHS[1]
    assert infos[0].previous_geodesic is None
    for info, first in zip(infos, firsts, strict=True):
        assert info.geodesic_distance == pytest.approx(distances(start[None], first[None])[0], abs=0.05)
    for info, before, first in zip(infos[1:], firsts, firsts[1:], strict=False):
        assert info.previous_geodesic == pytest.approx(distances(before[None], first[None])[0], abs=0.05)


def test_searches_for_several_objects_say_so(made: SequenceFile) -> None:
    asked = [
        subtask for record in made.sequences for subtask in record.subtasks if not isinstance(subtask.object_id, str)
    ]
    for subtask in asked:
        word = "all of" if subtask.mode == "all" else "one of"
        assert all(f"{word} {subtask.owner}'s {subtask.object_category}s" in query for query in subtask.query)
    assert queries_for("Ada", "chair", all_of=True)[1] == "Where are all of Ada's chairs?"


def test_nothing_is_shared_and_nobody_owns_several_objects_in_easy(made: SequenceFile) -> None:
    for record in made.sequences:
        if record.split == "easy":
            assert {message.kind for message in record.messages}.isdisjoint({"share", "unshare"})
            assert all(subtask.kind != "stale" for subtask in record.subtasks)


def test_what_was_lent_says_for_how_many_searches(made: SequenceFile) -> None:
    loans = [message for record in made.sequences for message in record.messages if message.kind == "lend"]
    assert loans
    for message in loans:
        assert message.until is not None
        number = ("the next search", "the next two searches", "the next three searches")
        assert number[message.until - message.before - 1] in message.text


def thing(name: str) -> Thing:
    goal = Goal(
        position=(0.0, 0.5, 0.0), object_id=1, object_name=name, object_category="cup", floor_id="0", view_points=()
    )
    return Thing(goal, f"red {name} on the shelf", "kitchen", ("", "", ""))


@pytest.mark.parametrize("kind", PHRASINGS)
def test_a_message_has_three_phrasings_without_pronouns_that_say_all(kind: MessageKind) -> None:
    words = Told("Ada", "Bo", ("the red cup in the kitchen", "the blue mug in the hall"), "the next two searches")
    texts = {phrasing(words) for phrasing in PHRASINGS[kind]}
    assert len(texts) == 3
    for text in texts:
        assert not PRONOUNS.search(text)
        assert ("Ada" in text) == (kind != "share")
        assert ("Bo" in text) == (kind not in ("unshare", "leave"))
        assert text.count("the red cup in the kitchen") == (kind != "leave")
        assert text.count("the blue mug in the hall") == (kind == "swap")
        assert ("the next two searches" in text) == (kind == "lend")


def test_a_swap_names_the_object_of_the_giver_first() -> None:
    swap = Change(1, "swap", (Edge("Bo", "cup"), Edge("Ada", "mug")), (Edge("Ada", "cup"), Edge("Bo", "mug")))
    things = {name: thing(name) for name in ("cup", "mug")}
    texts = {message_text(swap, things=things, rng=np.random.default_rng(seed)) for seed in range(20)}
    cup, mug = "the red cup on the shelf in the kitchen", "the red mug on the shelf in the kitchen"
    assert f"Ada gave Bo {cup}; in return, Bo gave Ada {mug}." in texts
    assert len(texts) == 3


def one_refusal(opened: OpenedHome) -> tuple[Counter[str], str]:
    total = SetSoFar()
    assert drawn(opened, 1, total, tries=6).sequences == ()
    return total.refused, total.lines[0]


def changed_things(opened: OpenedHome, things: dict[str, Thing]) -> OpenedHome:
    return opened._replace(home=replace(opened.home, things=things), plan=None)


def test_a_home_without_distractors_is_refused(opened: OpenedHome) -> None:
    single = {thing.goal.object_category: name for name, thing in opened.home.things.items()}
    refused, line = one_refusal(changed_things(opened, {name: opened.home.things[name] for name in single.values()}))
    assert refused == {"distractor": 1}
    assert "scene 'Small', ground floor: guarantee 'distractor': found no category with two objects" in line


def test_a_home_with_two_objects_cannot_keep_a_rule_of_ownership(opened: OpenedHome) -> None:
    counts = Counter(thing.goal.object_category for thing in opened.home.things.values())
    twins = {
        name: thing
        for name, thing in opened.home.things.items()
        if thing.goal.object_category == counts.most_common(1)[0][0]
    }
    refused, line = one_refusal(changed_things(opened, dict(list(twins.items())[:2])))
    assert refused == {"ownership rule": 3}
    assert "guarantee 'ownership rule': everybody owns one object and every object has one owner: found 2" in line


def test_a_home_in_which_all_objects_stand_together_is_refused(opened: OpenedHome) -> None:
    things = {
        name: replace(thing, goal=thing.goal.model_copy(update={"position": (0.0, 1.0, 0.0)}))
        for name, thing in opened.home.things.items()
    }
    refused, line = one_refusal(changed_things(opened, things))
    assert refused == {"2 m apart, reachable": 3}
    assert "found only targets within 2 m of the one before" in line


def test_a_home_that_is_too_small_for_the_first_leg_is_refused(
    opened: OpenedHome, monkeypatch: pytest.MonkeyPatch
) -> None:
    for split in SPLITS:
        monkeypatch.setitem(GEODESIC_LIMITS, split, (90.0, 99.0))
    refused, line = one_refusal(opened._replace(plan=None))
    assert refused == {"start": 3}
    assert "guarantee 'start' (90-99 m): found no start in the split's window; expected a larger storey" in line


def test_a_home_whose_objects_nobody_sees_is_refused(opened: OpenedHome) -> None:
    refused, line = one_refusal(opened._replace(scene=replace(opened.scene, objects=())))
    assert refused == {"findable": 3}
    assert "found objects that nobody can find; expected captions that tell them apart" in line


def test_a_home_whose_objects_nobody_can_tell_apart_is_refused(
    opened: OpenedHome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Finder, "can_find", lambda self, episode: False)
    refused, line = one_refusal(opened)
    assert refused == {"findable": 3}
    assert "guarantee 'findable': found objects that nobody can find" in line


def test_a_scan_gets_the_sequences_that_the_home_before_cannot_carry(
    opened: OpenedHome, small_home_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scan = opened._replace(plan=None, source=opened.source.model_copy(update={"num_edits": 1}))
    single = {thing.goal.object_category: name for name, thing in opened.home.things.items()}
    poor = changed_things(scan, {name: opened.home.things[name] for name in single.values()})
    homes = {"Poor": poor, "Small": scan}
    monkeypatch.setattr(generation, "opened_home", lambda dataset, scene, *_, **__: homes[scene])
    made = generation.draw_sequences(small_home_root, list(homes), scenes_dir=None, count=3, seed=0, starts="released")
    assert {scene: len(content.sequences) for scene, content in made.files.items()} == {"Small": 3}
    assert made.total.refused == {"distractor": 1}, "a scan's objects are the annotated ones alone"


def test_a_story_ends_where_no_search_has_one_answer() -> None:
    setting = Setting(
        split="medium",
        category={"dish_1": "dish", "dish_2": "dish"},
        askable=frozenset({"dish_1", "dish_2"}),
        num_alike={"dish": 2},
        conflicts=frozenset(),
        near=frozenset(),
    )
    edges = [Edge("Ada", "dish_1"), Edge("Ada", "dish_2")]
    with pytest.raises(StoryError, match="unique answer"):  # "dishs" is no word, so nobody asks for both
        draw_story(setting, edges, newcomers=(), num_asks=5, needs=Needs(), rng=np.random.default_rng(0))


def test_sequences_begin_with_what_an_episode_tells(opened: OpenedHome, made: SequenceFile, tmp_path: Path) -> None:
    told = next(record for record in made.sequences if record.split == "medium")
    episode = first_search(told)
    home = content_file(opened.home, [episode], sorted({t.goal.object_category for t in opened.home.things.values()}))
    index = index_file([])
    files = {"medium/content/Small.json.gz": packed(home), "medium/medium.json.gz": packed(index)}
    write_files(tmp_path, files)
    found = drawn(opened, 6, SetSoFar(), episodes=PersonalDataset(tmp_path))
    from_episode = [record for record in found.sequences if record.sources == ("medium/Small/7",)]
    assert from_episode
    for record in from_episode:
        assert record.split == "medium"
        assert record.messages[0].text == episode.summary
        assert record.messages[0].extracted_summary == episode.extracted_summary
        assert set(record.messages[0].adds) == set(told.messages[0].adds)


def first_search(record: SequenceRecord) -> EpisodeRecord:
    """The intro and the first search of a sequence as an episode."""
    geodesic = record.subtasks[0].info.geodesic_distance
    info = EpisodeInfo(geodesic_distance=geodesic, euclidean_distance=3.0, closest_goal_object_id=1)
    return search_record(record, 0, info=info, episode_id="7")


def test_released_episodes_tell_ownerships_of_known_objects(dataset_root: Path, opened: OpenedHome) -> None:
    dataset, scene = PersonalDataset(dataset_root), "q5QZSEeHe5g"
    things = {
        name: Thing(goal, phrase_of(captions[0]), room, captions)
        for name, (goal, captions, room) in captioned_goals(dataset, scene).items()
    }
    storeys = {thing.goal.floor_id: "" for thing in things.values()}
    intros = released_intros(dataset, replace(opened.home, name=scene, things=things, storeys=storeys))
    assert sum(map(len, intros.values())) > 10
    for (split, floor_id), told in intros.items():
        for intro in told:
            episode = dataset.episode(intro.source)
            assert (episode.key.split, episode.record.floor_id) == (split, floor_id)
            assert intro.text == episode.record.summary
            assert {Edge(episode.record.owner, name) for name in episode.record.object_names} <= set(intro.edges)
            assert len(intro.edges) == len(set(intro.edges)) <= len(intro.sentences)
