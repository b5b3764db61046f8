"""Drawing episodes, assigning them to people, and the order in which people meet them."""

import itertools
import json
import math
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from human_study.design.plan import (
    PlannedParticipant,
    PlannedTrial,
    StudyPlan,
    StudyScene,
    load_plan,
    per_person,
    save_plan,
)
from human_study.design.planning import Practice, make_plan
from human_study.design.sampling import sample_episodes
from human_study.design.study import StudyConfig
from sim.errors import StudyError
from sim.types import SPLITS, EpisodeKey

from .small_world import plan, study

HOMES = tuple(f"home{number:02d}" for number in range(31))
POOL = [EpisodeKey(split, home, str(number)) for split in SPLITS for home in HOMES for number in range(10)]
PRACTICE = Practice(
    (StudyScene(name="practice", kind="invented"),),
    tuple(EpisodeKey("easy", "practice", str(number)) for number in range(3)),
    (EpisodeKey("easy", "practice", "0"),),
)


def house_once(**changes: object) -> StudyConfig:
    """The recommended design: 150 episodes of 31 homes, five people each."""
    values = {
        "dataset": {"sha256": "0", "seed": 7},
        "task": ("pan",),
        "design": {"kind": "house-once", "trials_per_person": 30},
    }
    return study(**(values | changes))


def planned(config: StudyConfig, keys: tuple[EpisodeKey, ...]) -> StudyPlan:
    """The plan over all homes of the episodes."""
    scenes = [StudyScene(name=name, kind="schematic") for name in sorted({key.scene for key in keys})]
    return make_plan(config, scenes, keys, practice=PRACTICE)


def main(person: PlannedParticipant) -> list[PlannedTrial]:
    """Counted trials in order."""
    return [trial for trial in person.trials if trial.phase == "main"]


def test_the_draw_has_the_asked_splits_and_few_of_one_home() -> None:
    keys = sample_episodes(house_once(), POOL)
    assert Counter(key.split for key in keys) == dict.fromkeys(SPLITS, 50)
    assert set(Counter(key.scene for key in keys).values()) == {4, 5}
    assert max(Counter((key.split, key.scene) for key in keys).values()) == 2
    assert sample_episodes(house_once(), POOL[::-1]) == keys
    other = house_once(dataset={"sha256": "0", "seed": 8})
    assert sample_episodes(other, POOL) != keys


def test_a_small_draw_takes_each_episode_from_another_home_and_all_of_a_split_can_be_asked_for() -> None:
    config = house_once(dataset={"sha256": "0", "splits": {"easy": 4, "medium": 4, "hard": 4}})
    keys = sample_episodes(config, POOL)
    assert len({key.scene for key in keys}) == len(keys) == 12
    dataset = {"sha256": "0", "splits": {"hard": "all"}, "max_per_scene": None, "scenes": HOMES[:2]}
    keys = sample_episodes(house_once(dataset=dataset), POOL)
    assert keys == tuple(sorted(key for key in POOL if key.split == "hard" and key.scene in HOMES[:2]))


def test_a_draw_that_the_dataset_cannot_give_says_what_it_can() -> None:
    config = house_once(dataset={"sha256": "0", "splits": {"easy": 40}, "max_per_scene": 1})
    with pytest.raises(StudyError, match=r"asks for \{'easy': 40\}.*at most 1 of one home gives \{'easy': 31\}"):
        sample_episodes(config, POOL)
    with pytest.raises(StudyError, match="found no episode of \\['barn'\\]"):
        sample_episodes(house_once(dataset={"sha256": "0", "scenes": ("barn",)}), POOL)


def test_house_once_needs_25_people_of_30_trials_and_shows_nobody_a_home_twice() -> None:
    keys = sample_episodes(house_once(), POOL)
    people = planned(house_once(), keys).participants
    assert len(people) == 25
    raters: Counter[EpisodeKey] = Counter()
    for person in people:
        trials = main(person)
        assert len(trials) == 30
        assert len({trial.scene for trial in trials}) == 30
        raters.update(trial.key for trial in trials)
    assert raters == dict.fromkeys(keys, 5)


def split_counts(made: StudyPlan, condition: str | None = None) -> set[tuple[int, ...]]:
    """Numbers of counted trials by split, of each person who has any."""
    counts = [
        Counter(trial.split for trial in main(person) if condition in (None, trial.condition))
        for person in made.participants
    ]
    return {tuple(found[split] for split in SPLITS) for found in counts if found}


@pytest.mark.parametrize("seed", range(5))
def test_each_of_25_people_gets_ten_trials_of_each_split(seed: int) -> None:
    config = house_once(dataset={"sha256": "0", "seed": seed})
    made = planned(config, sample_episodes(config, POOL))
    assert split_counts(made) == {(10, 10, 10)}
    assert per_person(made.participants) == dict.fromkeys(SPLITS, (10, 10))


def test_conditions_of_a_person_have_equal_shares_of_each_split() -> None:
    config = house_once(memory={"arms": ("none", "topdown")})
    made = planned(config, sample_episodes(config, POOL))
    assert split_counts(made) == {(10, 10, 10)}
    for condition in ("none", "topdown"):
        assert {number for found in split_counts(made, condition) for number in found} <= {4, 5, 6}


def test_people_share_no_more_episodes_than_chance_would_have_it() -> None:
    people = planned(house_once(), sample_episodes(house_once(), POOL)).participants
    episodes = [{trial.key for trial in main(person)} for person in people]
    shared = [len(a & b) for a, b in itertools.combinations(episodes, 2)]
    assert sum(shared) / len(shared) == 5.0  # each of 150 episodes is shared by 10 of 300 pairs of people
    assert max(shared) <= 15


def test_splits_that_few_homes_have_are_dealt_as_evenly_as_possible_and_the_plan_says_so() -> None:
    keys = [EpisodeKey("easy", HOMES[0], str(number)) for number in range(4)]
    keys += [EpisodeKey("hard", HOMES[home], str(number)) for home in (0, 1, 2, 3) for number in range(home and 4)]
    config = house_once(design={"kind": "house-once", "raters_per_episode": 1})
    made = planned(config, tuple(keys))
    assert split_counts(made) == {(1, 0, 3)}
    assert made.changes == ()
    keys = [EpisodeKey("easy", home, str(number)) for home in HOMES[:3] for number in range(2)]
    keys += [EpisodeKey("hard", home, "0") for home in HOMES[3:6]]
    keys += [EpisodeKey("hard", HOMES[6], str(number)) for number in range(9)]
    made = planned(config, tuple(keys))
    assert {len(main(person)) for person in made.participants} == {2}
    assert split_counts(made) == {(1, 0, 1), (0, 0, 2)}
    assert made.changes == ()


@settings(max_examples=30, deadline=None)
@given(
    homes=st.lists(st.tuples(*[st.integers(0, 3)] * 3).filter(any), min_size=1, max_size=7),
    raters=st.integers(1, 3),
    most=st.none() | st.integers(1, 7),
)
def test_every_house_once_plan_is_as_even_as_its_splits_allow_or_says_that_it_is_not(
    homes: list[tuple[int, int, int]], raters: int, most: int | None
) -> None:
    keys = [
        EpisodeKey(split, HOMES[home], str(number))
        for home, counts in enumerate(homes)
        for split, count in zip(SPLITS, counts, strict=True)
        for number in range(count)
    ]
    config = house_once(
        design={"kind": "house-once", "raters_per_episode": raters, "trials_per_person": most}, checks={"every": None}
    )
    made = planned(config, tuple(keys))
    people = [main(person) for person in made.participants]
    num_slots = raters * len(keys)
    largest_home = max(map(sum, homes))
    assert len(people) == max(raters * largest_home, math.ceil(num_slots / min(most or 99, len(homes))))
    assert {len(trials) for trials in people} <= {num_slots // len(people), math.ceil(num_slots / len(people))}
    assert all(len({trial.scene for trial in trials}) == len(trials) for trials in people)
    assert Counter(trial.key for trials in people for trial in trials) == dict.fromkeys(keys, raters)
    for split, (least, largest) in per_person(made.participants).items():
        mean = sum(trial.split == split for trials in people for trial in trials) / len(people)
        is_even = mean - 1 <= least and largest <= mean + 1
        told = [line for line in made.changes if line.startswith("splits of each person") and f" {split} " in line]
        assert len(told) == (not is_even)


@pytest.mark.parametrize("arms", [("none",), ("none", "topdown")])
def test_nobody_has_more_to_do_than_others_when_the_study_does_not_say_how_much(arms: tuple[str, ...]) -> None:
    config = house_once(memory={"arms": arms}, design={"kind": "house-once", "trials_per_person": None})
    people = planned(config, sample_episodes(config, POOL)).participants
    assert {len(main(person)) for person in people} == {30}


def test_memory_arms_are_counterbalanced_over_halves_of_the_homes() -> None:
    config = house_once(memory={"arms": ("none", "topdown")})
    made = planned(config, sample_episodes(config, POOL))
    assert len(made.participants) == 50
    raters: Counter[tuple[str, EpisodeKey]] = Counter()
    for person in made.participants:
        conditions = made.conditions_of(config, person)
        assert {trial.condition for trial in main(person)} == {"none", "topdown"}
        assert all(trial.condition == conditions[trial.scene] for trial in main(person))
        raters.update((trial.condition, trial.key) for trial in main(person))
    assert set(raters.values()) == {5}
    assert Counter(person.arm for person in made.participants) == {0: 25, 1: 25}
    by_home = {home: {made.conditions_of(config, person)[home] for person in made.participants} for home in HOMES}
    assert all(found == {"none", "topdown"} for found in by_home.values())


def test_crossed_gives_everybody_everything_and_counts_raters() -> None:
    config = house_once(design={"kind": "crossed", "raters_per_episode": 5})
    keys = sample_episodes(config, POOL)
    people = planned(config, keys).participants
    assert len(people) == 5
    assert all({trial.key for trial in main(person)} == set(keys) for person in people)
    assert len({tuple(trial.key for trial in main(person)) for person in people}) == 5
    reps = Counter((trial.key, trial.rep) for person in people for trial in main(person))
    assert set(reps.values()) == {1}
    assert {rep for _, rep in reps} == {1, 2, 3, 4, 5}


def test_splits_are_interleaved_and_homes_are_not_neighbours() -> None:
    config = house_once(design={"kind": "crossed", "raters_per_episode": 1})
    (person,) = planned(config, sample_episodes(config, POOL)).participants
    trials = main(person)
    assert all(a.scene != b.scene for a, b in itertools.pairwise(trials))
    for place in range(3, 150, 3):
        counts = Counter(trial.split for trial in trials[:place])
        assert max(counts.values()) - min(counts.get(split, 0) for split in SPLITS) <= 4


def test_practice_comes_first_and_attention_trials_between() -> None:
    config = house_once(practice={"pan": 2}, checks={"every": 10})
    person = planned(config, sample_episodes(config, POOL)).participants[0]
    assert [trial.order_no for trial in person.trials] == list(range(1, 36))
    assert "".join(trial.phase[0] for trial in person.trials) == "pp" + ("m" * 10 + "c") * 3
    assert {trial.scene for trial in person.trials if trial.phase != "main"} == {"practice"}
    assert {trial.rep for trial in person.trials if trial.phase != "main"} == {0}


def test_spare_people_have_practice_only() -> None:
    config = house_once(practice={"pan": 1}, design={"kind": "house-once", "trials_per_person": 30, "overbook": 1.15})
    people = planned(config, sample_episodes(config, POOL)).participants
    assert len(people) == 29
    assert [[trial.phase for trial in person.trials] for person in people[25:]] == [["practice"]] * 4


def test_two_tasks_take_turns_and_use_the_same_episodes() -> None:
    config = house_once(task=("pan", "pog"), design={"kind": "crossed", "raters_per_episode": 2})
    people = planned(config, sample_episodes(config, POOL)).participants
    assert [person.task for person in people] == ["pan", "pog", "pan", "pog"]
    assert {trial.condition for trial in people[1].trials} == {"map_open"}
    assert {trial.key for trial in main(people[0])} == {trial.key for trial in main(people[1])}


def test_the_plan_follows_from_the_seed_alone() -> None:
    config = house_once()
    keys = sample_episodes(config, POOL)
    scenes = [StudyScene(name=name, kind="schematic") for name in HOMES]
    assert make_plan(config, scenes[::-1], keys[::-1]) == make_plan(config, scenes, keys)
    other = house_once(dataset={"sha256": "0", "seed": 8})
    assert make_plan(other, scenes, keys).participants != make_plan(config, scenes, keys).participants


def test_a_plan_comes_back_as_it_was_and_belongs_to_one_study(tmp_path: Path) -> None:
    made = plan(study())
    save_plan(tmp_path, made)
    assert load_plan(tmp_path, study()) == made
    assert load_plan(tmp_path, study()).plan_version == made.plan_version
    with pytest.raises(StudyError, match=r"study\.yaml was changed after the plan"):
        load_plan(tmp_path, study(steps=9))


IN_NO_VERSION_2 = {
    "changes": True,
    "homes_version": True,
    "made_by": True,
    "scenes": {"__all__": {"labels", "plan_digest"}},
}


@pytest.mark.parametrize("kind", ["invented", "schematic"])
def test_a_plan_of_version_2_keeps_its_hash_and_had_labels_in_schematic_homes(tmp_path: Path, kind: str) -> None:
    raw = plan(study()).model_dump(mode="json", exclude=IN_NO_VERSION_2)
    raw = json.loads(json.dumps(raw | {"schema_version": 2}).replace("invented", kind))
    (tmp_path / "plan.json").write_text(json.dumps(raw))
    found = load_plan(tmp_path, study())
    assert [scene.labels for scene in found.scenes] == [kind == "schematic"]
    assert (found.homes_version, found.made_by[:18]) == (2, "the personal-viz 0")
    if kind == "invented":
        assert found.plan_version == "393b93a07a21ee35099de0998e5d0f3a0b6bf7cbadb4b66ced06c3b2cc544fda"
    again = StudyPlan.model_validate_json(found.canonical_json(), strict=True)  # as a database keeps it
    assert (again, again.plan_version) == (found, found.plan_version)


@pytest.mark.parametrize(
    ("config", "keys", "message"),
    [
        (study(), [], "found 0 episodes"),
        (study(), [POOL[0], POOL[0]], "found 2 episodes, 1 of them different"),
        (study(), [POOL[0]._replace(scene="barn")], r"episodes lie in \['barn'\]"),
        (study(practice={"pan": 1}), [POOL[0]], "practice asks for trials"),
        (study(checks={"every": 2}), POOL[:3], "checks asks for trials"),
        (study(design={"kind": "crossed", "trials_per_person": 2}), POOL[:3], "trials_per_person is 2; expected 3"),
    ],
)
def test_an_impossible_plan_is_refused(config: StudyConfig, keys: list[EpisodeKey], message: str) -> None:
    with pytest.raises(StudyError, match=message):
        make_plan(config, [StudyScene(name=name, kind="scan") for name in HOMES], keys)


def test_a_plan_may_mix_scene_kinds_and_knows_which_is_which() -> None:
    scenes = [StudyScene(name="a", kind="scan"), StudyScene(name="b", kind="invented")]
    made = make_plan(study(), scenes, [EpisodeKey("easy", "a", "0"), EpisodeKey("easy", "b", "0")])
    assert (made.scene("a").kind, made.scene("b").kind) == ("scan", "invented")
    with pytest.raises(StudyError, match="scene is 'c'; expected one of: a, b"):
        made.scene("c")


@settings(max_examples=30, deadline=None)
@given(
    per_home=st.lists(st.integers(1, 4), min_size=1, max_size=6),
    raters=st.integers(1, 4),
    arms=st.sampled_from([("none",), ("none", "topdown"), ("none", "topdown", "glb")]),
)
def test_every_house_once_plan_fills_all_places_and_keeps_the_rule(
    per_home: list[int], raters: int, arms: tuple[str, ...]
) -> None:
    keys = [EpisodeKey("easy", HOMES[home], str(n)) for home, count in enumerate(per_home) for n in range(count)]
    config = house_once(memory={"arms": arms}, design={"kind": "house-once", "raters_per_episode": raters})
    made = planned(config, tuple(keys))
    filled: Counter[tuple[str, EpisodeKey]] = Counter()
    for person in made.participants:
        trials = main(person)
        assert len({trial.scene for trial in trials}) == len(trials)
        filled.update((trial.condition, trial.key) for trial in trials)
    assert filled == {(arm, key): raters for arm in arms for key in keys}


def test_a_plan_that_cannot_give_what_was_asked_says_so_and_why(tmp_path: Path) -> None:
    asked = house_once(design={"kind": "house-once", "trials_per_person": 40})
    drawn = planned(asked, sample_episodes(asked, POOL))
    assert drawn.changes == (
        "design.trials_per_person: 40 asked, 30 planned, because 25 people, the fewest among whom nobody meets a home "
        "twice, share 750 counted trials evenly (31 homes, up to 5 episodes in one)",
    )
    save_plan(tmp_path, drawn)
    assert load_plan(tmp_path, asked) == drawn
    as_asked = house_once()
    assert planned(as_asked, sample_episodes(as_asked, POOL)).changes == ()
    without_checks = study(checks={"every": 15})
    assert plan(without_checks).changes == (
        "checks.every: 15 asked, no attention trial planned, because nobody has that many trials",
    )
