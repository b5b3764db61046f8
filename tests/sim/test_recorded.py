"""The facts of a scene that its episode files record."""

from pathlib import Path

import numpy as np
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.errors import DatasetError
from sim.frames import quat_xyzw_from_yaw
from sim.homes.recovered.recorded import PathLength, recorded_facts

from .synthetic import SCENE, Content, example_content, example_episode, example_goal, example_view_point, write_dataset

_YAW_0 = list(quat_xyzw_from_yaw(0.0))


def content_with(start_x: float, extra_x: float, *, geodesic: float = 3.25) -> Content:
    """A table seen from (1, 0, 0), with an extra view point at (extra_x, 0, 2); an episode from (start_x, 0, 3)."""
    views = [
        example_view_point(1.0, 0.0, quat_xyzw=_YAW_0, iou=0.5),
        example_view_point(extra_x, 2.0, quat_xyzw=_YAW_0, iou=None),
    ]
    info = {"geodesic_distance": geodesic, "euclidean_distance": 4.0, "closest_goal_object_id": 7}
    episode = example_episode(start_position=[start_x, 0.0, 3.0], info=info)
    return example_content(
        goals_by_category={f"{SCENE}.basis.glb_coffee table": [example_goal(view_points=views)]}, episodes=[episode]
    )


def test_standing_places_extra_places_and_lengths_are_kept_apart(tmp_path: Path) -> None:
    facts = recorded_facts(PersonalDataset(write_dataset(tmp_path, {("easy", SCENE): content_with(1.5, 2.5)})), SCENE)
    assert facts.standing.tolist() == [[1.0, 0.0, 0.0], [1.5, 0.0, 3.0]]
    assert facts.extras.tolist() == [[2.5, 0.0, 2.0]]
    assert facts.places.tolist() == [[1.0, 0.0, 0.0], [1.5, 0.0, 3.0], [2.5, 0.0, 2.0]]
    (length,) = facts.lengths
    assert (length.start, length.end, length.length) == ((1.5, 0.0, 3.0), (1.0, 0.0, 0.0), 3.25)
    assert length.split == "easy"
    assert length.target in facts.goals


def test_only_the_files_of_the_named_splits_are_read(tmp_path: Path) -> None:
    root = write_dataset(tmp_path, {("easy", SCENE): content_with(1.5, 2.5), ("medium", SCENE): content_with(4.0, 5.0)})
    damaged = next((root / "hard").parent.glob("medium/content/*"))
    both = recorded_facts(PersonalDataset(root), SCENE)
    assert {length.split for length in both.lengths} == {"easy", "medium"}
    assert both.extras[:, 0].tolist() == [2.5, 5.0]
    damaged.write_bytes(b"no gzip")
    easy = recorded_facts(PersonalDataset(root), SCENE, splits=("easy",))
    assert {length.split for length in easy.lengths} == {"easy"}
    assert easy.extras[:, 0].tolist() == [2.5]
    with pytest.raises(DatasetError):
        recorded_facts(PersonalDataset(root), SCENE)


def test_a_length_below_the_straight_line_is_impossible() -> None:
    assert PathLength("easy", "table_1", (0.0, 0.0, 0.0), (3.0, 0.0, 4.0), 5.0).is_possible
    assert not PathLength("easy", "table_1", (0.0, 0.0, 0.0), (3.0, 0.0, 4.0), 4.9).is_possible


def test_an_unknown_scene_is_refused(tmp_path: Path) -> None:
    dataset = PersonalDataset(write_dataset(tmp_path, {("easy", SCENE): content_with(1.5, 2.5)}))
    with pytest.raises(DatasetError, match="found no scene 'Nowhere'"):
        recorded_facts(dataset, "Nowhere")


@pytest.mark.slow
def test_released_episodes_hold_2000_lengths_and_12_of_them_are_impossible(dataset_root: Path) -> None:
    dataset = PersonalDataset(dataset_root)
    facts = [recorded_facts(dataset, scene) for scene in dataset.scenes]
    lengths = [length for fact in facts for length in fact.lengths]
    assert len(lengths) == 2000
    assert sum(not length.is_possible for length in lengths) == 12
    assert all(np.isfinite(fact.places).all() for fact in facts)
