"""Several editions of a dataset together give the facts of a home, and the plan counts the facts of each edition."""

from pathlib import Path
from typing import Any

import pytest

from sim.cache import VARIABLE
from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError
from sim.homes.plan import Source, load_plan, save_plan
from sim.homes.recovered.names import room_texts
from sim.homes.recovered.plans import recover_plan
from sim.homes.recovered.recorded import recorded_facts
from sim.types import Split

from .synthetic import SCENE, Content, example_content, example_episode, example_goal, example_view_point, write_dataset

AHEAD = [0.0, 0.0, 0.0, 1.0]


def view(x: float, z: float, *, iou: float | None = 0.4) -> Content:
    return example_view_point(x, z, quat_xyzw=AHEAD, iou=iou)


def thing(name: str, x: float, *views: Content, category: str = "lamp") -> Content:
    """A lamp at (x, 0.45, -1)."""
    number = int(name.rpartition("_")[2])
    return example_goal(
        object_name=name, object_id=number, object_category=category, position=[x, 0.45, -1.0], view_points=list(views)
    )


def asks(name: str, start_x: float, *, category: str = "lamp", room: str = "study", **changes: Any) -> Content:
    """An episode that starts at (start_x, 0, 2) and asks for Ada's lamp."""
    return example_episode(
        object_id=name,
        object_category=category,
        start_position=[start_x, 0.0, 2.0],
        extracted_summary=[f"Ada owns the {category} in the {room}"],
        description=[f"red {category}", "", ""],
        **changes,
    )


def edition(root: Path, goals: list[Content], episodes: list[Content], *, split: Split = "easy") -> Path:
    by_category: dict[str, list[Content]] = {}
    for goal in goals:
        by_category.setdefault(f"{SCENE}.basis.glb_{goal['object_category']}", []).append(goal)
    numbered = [{**episode, "episode_id": str(number)} for number, episode in enumerate(episodes)]
    return write_dataset(root, {(split, SCENE): example_content(goals_by_category=by_category, episodes=numbered)})


@pytest.fixture
def first(tmp_path: Path) -> Path:
    """A lamp at x = 1 seen from (1, 0) with a place beside it at (1, 1); an episode from (1, 2)."""
    return edition(tmp_path / "first", [thing("lamp_1", 1.0, view(1, 0), view(1, 1, iou=None))], [asks("lamp_1", 1.0)])


@pytest.fixture
def second(tmp_path: Path) -> Path:
    """The same lamp seen from (1, 0) and (1.25, 0), another one at x = 3, the same episode again and a new one."""
    goals = [thing("lamp_1", 1.0, view(1, 0), view(1.25, 0)), thing("lamp_2", 3.0, view(3, 0))]
    return edition(tmp_path / "second", goals, [asks("lamp_1", 1.0, owner="Bo"), asks("lamp_2", 3.0, room="hall")])


def test_starts_view_points_objects_and_texts_of_all_editions_count_once(first: Path, second: Path) -> None:
    dataset = PersonalDataset(first, evidence=[second])
    facts = recorded_facts(dataset, SCENE)
    assert facts.standing.tolist() == [[1, 0, 0], [1, 0, 2], [1.25, 0, 0], [3, 0, 0], [3, 0, 2]]
    assert facts.extras.tolist() == [[1, 0, 1]]
    assert sorted(facts.goals) == ["lamp_1", "lamp_2"]
    assert len(facts.goals["lamp_1"].original_view_points) == 2
    assert [length.start for length in facts.lengths] == [(1, 0, 2), (3, 0, 2)]
    assert facts.captions == {"lamp_1": "red lamp", "lamp_2": "red lamp"}
    own, more = facts.sources
    assert own == Source(digest=PersonalDataset(first).scene_digest(SCENE), starts=1, view_points=2, objects=1)
    assert more == Source(digest=PersonalDataset(second).scene_digest(SCENE), starts=1, view_points=2, objects=1)
    assert recover_plan(dataset, SCENE).sources == facts.sources
    assert {name: set(rooms) for name, rooms in room_texts(facts.episodes).items()} == {
        "lamp_1": {"study"},
        "lamp_2": {"hall"},
    }
    assert [str(episode.key) for episode in dataset.episodes()] == [f"easy/{SCENE}/0"]  # none comes from the evidence


def test_the_plan_keeps_its_sources_on_disk(first: Path, second: Path, tmp_path: Path) -> None:
    plan = recover_plan(PersonalDataset(first, evidence=[second]), SCENE)
    save_plan(plan, tmp_path / "a.plan.json")
    assert load_plan(tmp_path / "a.plan.json") == plan


def test_an_object_that_contradicts_an_earlier_edition_is_left_out_with_its_episodes(
    first: Path, tmp_path: Path
) -> None:
    own = [thing("lamp_1", 1.0, view(1, 0)), thing("lamp_2", 3.0, view(3, 0)), thing("lamp_3", 5.0, view(5, 0))]
    base = edition(tmp_path / "base", own, [asks("lamp_1", 1.0)])
    goals = [
        thing("lamp_1", 1.04, view(1, 0)),  # 4 cm away: the same
        thing("lamp_2", 3.06, view(3, 0.5)),  # 6 cm away: moved
        thing("lamp_30", 5.0, view(5, 0.5)),  # the same object under another name
        thing("box_31", 5.0, view(5, 0.75), category="box"),  # another object at the same place
    ]
    names = ["lamp_1", "lamp_2", "lamp_30"]
    episodes = [asks(name, 7.0 + place) for place, name in enumerate(names)]
    other = edition(tmp_path / "other", goals, [*episodes, asks("box_31", 10.0, category="box")])
    facts = recorded_facts(PersonalDataset(base, evidence=[other]), SCENE)
    assert sorted(facts.goals) == ["box_31", "lamp_1", "lamp_2", "lamp_3"]
    assert facts.goals["lamp_1"].position == (1.0, 0.45, -1.0)
    assert facts.standing.tolist() == [[1, 0, 0], [1, 0, 2], [3, 0, 0], [5, 0, 0], [5, 0, 0.75], [7, 0, 2], [10, 0, 2]]
    assert facts.sources[1].model_dump(exclude={"digest"}) == {
        "starts": 2,
        "view_points": 1,
        "objects": 1,
        "left_out": ("lamp_2", "lamp_30"),
    }


def test_an_edition_in_which_most_objects_are_elsewhere_is_refused_in_one_line(first: Path, tmp_path: Path) -> None:
    other = edition(tmp_path / "other", [thing("lamp_1", 2.5, view(2.5, 0))], [asks("lamp_1", 2.5)])
    dataset = PersonalDataset(first, evidence=[other])
    with pytest.raises(
        DatasetError, match=rf"other: scene '{SCENE}': 1 of 1 objects are elsewhere .*'lamp_1' by 1\.50 m; expected"
    ) as error:
        recover_plan(dataset, SCENE)
    assert "\n" not in str(error.value)


def test_an_edition_without_the_scene_or_with_the_same_facts_adds_nothing(
    first: Path, second: Path, tmp_path: Path
) -> None:
    def own(plan):
        return plan.model_copy(update={"sources": ()})

    goals = {"Other.basis.glb_coffee table": [example_goal(view_points=[view(0, 0)])]}
    content = example_content(scene="Other", goals_by_category=goals)
    wider = write_dataset(first, {("easy", "Other"): content})
    alone = recover_plan(PersonalDataset(wider), "Other")
    with_evidence = recover_plan(PersonalDataset(wider, evidence=[second]), "Other")
    assert own(with_evidence) == own(alone)
    assert (with_evidence.sources[1].starts, with_evidence.sources[1].objects) == (0, 0)
    copied = edition(tmp_path / "copied", [thing("lamp_1", 1.0, view(1, 0))], [asks("lamp_1", 1.0)])
    again = recover_plan(PersonalDataset(first, evidence=[copied]), SCENE)
    assert own(again) == own(recover_plan(PersonalDataset(first), SCENE))


def test_other_evidence_changes_the_digest_of_the_dataset_and_the_cached_home(
    first: Path, second: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    plain, both = PersonalDataset(first), PersonalDataset(first, evidence=[second])
    assert plain.digest() != both.digest()
    assert both.digest() != PersonalDataset(second, evidence=[first]).digest()
    assert recover_plan(plain, SCENE) != recover_plan(both, SCENE)
    assert recover_plan(PersonalDataset(first, evidence=[second]), SCENE) == recover_plan(both, SCENE)
    assert len(list(tmp_path.rglob("*.plan"))) == 2


def test_only_the_named_splits_of_an_edition_count(first: Path, second: Path) -> None:
    (second / "easy").rename(second / "hard")
    dataset = PersonalDataset(first, evidence=[second])
    assert recorded_facts(dataset, SCENE, splits=("easy",)).sources[1].objects == 0
    assert recorded_facts(dataset, SCENE).sources[1].objects == 1


def test_a_path_that_is_not_another_edition_is_refused_in_one_line(first: Path, second: Path, tmp_path: Path) -> None:
    elsewhere = write_dataset(tmp_path / "elsewhere", {("easy", "Other"): example_content(scene="Other")})
    for evidence, wanted in (
        ([first / ".." / "first"], "is the dataset itself; expected another edition"),
        ([second, second], "is named twice; expected another edition"),
        ([elsewhere], "holds none of the scenes of"),
        ([tmp_path / "nowhere"], "nowhere: found no episode file"),
    ):
        with pytest.raises(DatasetError, match=wanted) as error:
            PersonalDataset(first, evidence=evidence)
        assert "\n" not in str(error.value)
