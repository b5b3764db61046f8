"""Checks of the numbers of a dataset: view points, starts, distances, storeys (DATA_FORMAT.md section 8)."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from sim.frames import forward_from_yaw, planar_distance, yaw_from_quat_xyzw
from sim.types import RELAXED_RADIUS, STOREY_GAP, SUCCESS_RADIUS, EpisodeKey, Split

from .schema import Episode, Goal, Vector3, goals_of
from .survey import Find, Hit, Rule, Survey, splits_in_order

GEODESIC_LIMITS: dict[Split, tuple[float, float]] = {"easy": (2.0, 4.0), "medium": (3.0, 7.0), "hard": (3.0, 11.0)}
"""Limits of the generator for the distance between start and target, metres, per split (DATA_FORMAT.md, row 32)."""
_EQUAL = 1e-6
_AWAY_DEG = 135.0


def positions_of(goal: Goal) -> NDArray[np.float64]:
    """Feet positions (N, 3) of the goal's view points, world metres."""
    return np.array([point.agent_state.position for point in goal.view_points], float).reshape(-1, 3)


def is_extra_of(goal: Goal) -> NDArray[np.bool_]:
    """Whether the generator added each view point (no `iou`), (N,)."""
    return np.array([point.iou is None for point in goal.view_points], bool)


def is_other_storey_of(goal: Goal) -> NDArray[np.bool_]:
    """Whether each view point is on another storey than the first one, (N,)."""
    heights = positions_of(goal)[:, 1]
    return np.abs(heights - heights[:1]) > STOREY_GAP


def planar_distances_of(goal: Goal) -> NDArray[np.float64]:
    """Planar distances (N,) from the view points to the goal's centre, metres."""
    return np.hypot(*(positions_of(goal) - goal.position)[:, [0, 2]].T)


def is_looking_away_of(goal: Goal) -> NDArray[np.bool_]:
    """Whether each view point has the goal's centre behind it (more than 90 degrees off), (N,)."""
    yaws = [yaw_from_quat_xyzw(point.agent_state.rotation) for point in goal.view_points]
    forwards = np.array([forward_from_yaw(yaw) for yaw in yaws]).reshape(-1, 3)
    towards = np.asarray(goal.position) - positions_of(goal)
    return (forwards[:, 0] * towards[:, 0] + forwards[:, 2] * towards[:, 2]) < 0


def _episodes_where(is_hit: Callable[[Episode], bool]) -> Find:
    """A finder of episodes with targets for which `is_hit` is true."""
    return lambda survey: (Hit((e.key.split,), str(e.key)) for e in survey.episodes if is_hit(e))


def _points_where(is_hit: Callable[[Goal], NDArray[np.bool_]]) -> Find:
    """A finder of view points; one hit per goal entry, counting its view points."""

    def find(survey: Survey) -> Iterator[Hit]:
        for entry in survey.goal_entries:
            if count := int(np.count_nonzero(is_hit(entry.goal))):
                yield Hit((entry.split,), entry.name, count)

    return find


def _goals_where(is_hit: Callable[[Goal], NDArray[np.bool_]]) -> Find:
    """A finder of goal entries with at least one view point for which `is_hit` is true."""
    return lambda survey: (Hit((e.split,), e.name) for e in survey.goal_entries if is_hit(e.goal).any())


def _with_non_targets(survey: Survey) -> Iterator[Hit]:
    for episode in survey.episodes:
        split, scene, _ = episode.key
        record, content = episode.record, survey.contents[(split, scene)]
        listed = goals_of(scene, record.object_category, content.goals_by_category, suffix=record.scan_suffix)
        if listed is not None and len(listed) > len(episode.targets):
            yield Hit((split,), str(episode.key))


def _never_targeted(survey: Survey) -> Iterator[Hit]:
    asked = {(e.key.split, e.key.scene, name) for e in survey.records for name in e.record.object_names}
    for entry in survey.goal_entries:
        if (entry.split, entry.scene, entry.goal.object_name) not in asked:
            yield Hit((entry.split,), entry.name)


def _is_euclidean_wrong(episode: Episode) -> bool:
    planar = planar_distance(episode.record.start_position, episode.targets[0].position)
    return abs(planar - episode.record.info.euclidean_distance) > _EQUAL


def _is_geodesic_too_short(episode: Episode) -> bool:
    points = episode.targets[0].view_points
    if not points:
        return False
    straight = math.dist(episode.record.start_position, points[0].agent_state.position)
    return episode.record.info.geodesic_distance < straight - _EQUAL


def _is_outside_limits(episode: Episode) -> bool:
    low, high = GEODESIC_LIMITS[episode.key.split]
    return not low <= episode.record.info.geodesic_distance <= high


def _starts_beyond_limits(episode: Episode) -> bool:
    """Whether the straight line (3-D) from the start to every view point is longer than the split's upper limit.

    No walk is shorter than the straight line, so no stored distance can make such a start right.
    """
    gaps = [np.linalg.norm(positions_of(goal) - episode.record.start_position, axis=1) for goal in episode.targets]
    nearest = min((float(gap.min()) for gap in gaps if len(gap)), default=0.0)
    return nearest > GEODESIC_LIMITS[episode.key.split][1]


def _looks_away(episode: Episode) -> bool:
    """Whether the start looks 135 degrees or more away from the target's centre."""
    towards = np.subtract(episode.targets[0].position, episode.record.start_position)[[0, 2]]
    forward = forward_from_yaw(episode.start.yaw)[[0, 2]]
    return bool(forward @ towards <= math.cos(math.radians(_AWAY_DEG)) * np.linalg.norm(towards))


def _starts_near_centre(episode: Episode) -> bool:
    return planar_distance(episode.record.start_position, episode.targets[0].position) <= SUCCESS_RADIUS


def _starts_near_view_point(episode: Episode, *, num_targets: int | None) -> bool:
    """Whether a view point of the first `num_targets` targets (None = all) is within 1 m of the start, in 3-D."""
    gaps = [positions_of(goal) - episode.record.start_position for goal in episode.targets[:num_targets]]
    return any((np.linalg.norm(gap, axis=1) <= SUCCESS_RADIUS).any() for gap in gaps)


def _objects_on_wrong_storey(survey: Survey) -> Iterator[Hit]:
    """Objects whose floor is nearer to the usual height of a different storey label in their scene."""
    usable = {key: value for key, value in survey.objects.items() if value[0].original_view_points}
    heights: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (scene, _), (goal, _) in usable.items():
        heights[scene][goal.floor_id].append(goal.floor_y)
    for (scene, name), (goal, splits) in usable.items():
        usual = {label: median(of_label) for label, of_label in heights[scene].items()}
        if min(usual, key=lambda label: abs(usual[label] - goal.floor_y)) != goal.floor_id:
            yield Hit(splits, f"{scene}/{name}")


def _categories_with_several_ids(survey: Survey) -> Iterator[Hit]:
    ids: dict[str, dict[int, set[Split]]] = defaultdict(lambda: defaultdict(set))
    for (split, _), content in survey.contents.items():
        for category, number in content.category_to_task_category_id.items():
            ids[category][number].add(split)
    for category, splits_of_id in ids.items():
        if len(splits_of_id) > 1:
            yield Hit(splits_in_order(split for splits in splits_of_id.values() for split in splits), category)


def _starts_in_several_splits(survey: Survey) -> Iterator[Hit]:
    keys: dict[tuple[str, Vector3], list[EpisodeKey]] = defaultdict(list)
    for episode in survey.records:
        keys[(episode.key.scene, episode.record.start_position)].append(episode.key)
    for same in keys.values():
        splits = splits_in_order(key.split for key in same)
        if len(splits) > 1:
            yield Hit(splits, " = ".join(map(str, same)))


def _is_extra_on_other_storey(goal: Goal) -> NDArray[np.bool_]:
    return is_extra_of(goal) & is_other_storey_of(goal)


GEOMETRY_RULES = (
    Rule(4, "target-without-view-points", "error", "episodes", "a target has no view point",
         _episodes_where(lambda episode: not all(goal.view_points for goal in episode.targets))),
    Rule(5, "target-without-original-view-points", "defect", "episodes", "a target has no view point with an iou",
         _episodes_where(lambda episode: not all(goal.original_view_points for goal in episode.targets))),
    Rule(6, "same-category-non-targets", "note", "episodes", "the goal list also holds wrong objects: filter by name",
         _with_non_targets),
    Rule(7, "goal-never-targeted", "note", "goal entries", "no episode asks for the object", _never_targeted),
    Rule(29, "euclidean-distance-wrong", "defect", "episodes", "euclidean_distance is not the planar distance",
         _episodes_where(_is_euclidean_wrong)),
    Rule(30, "geodesic-below-euclidean", "note", "episodes", "the two stored distances have different end points",
         _episodes_where(lambda e: e.record.info.geodesic_distance < e.record.info.euclidean_distance)),
    Rule(31, "geodesic-below-straight-line", "defect", "episodes", "geodesic_distance does not end at view_points[0]",
         _episodes_where(_is_geodesic_too_short)),
    Rule(32, "geodesic-outside-limits", "defect", "episodes", "geodesic_distance is outside the split's limits",
         _episodes_where(_is_outside_limits),
         also=(("start-beyond-limits", "episodes", _episodes_where(_starts_beyond_limits)),)),
    Rule(33, "start-looks-away", "note", "episodes", "the start looks at least 135 degrees away from the target",
         _episodes_where(_looks_away)),
    Rule(34, "target-with-other-storey-view-points", "defect", "episodes",
         "the first target has view points on another storey",
         _episodes_where(lambda episode: bool(is_other_storey_of(episode.targets[0]).any())),
         also=(("any-target-with-other-storey-view-points", "episodes",
                _episodes_where(lambda episode: any(is_other_storey_of(goal).any() for goal in episode.targets))),)),
    Rule(35, "extra-view-point-on-other-storey", "defect", "extra view points",
         "an added view point lies on another storey", _points_where(_is_extra_on_other_storey),
         also=(("goal-with-such-view-point", "goal entries", _goals_where(_is_extra_on_other_storey)),)),
    Rule(36, "extra-view-point-looks-away", "defect", "extra view points", "an added view point has the goal behind it",
         _points_where(lambda goal: is_extra_of(goal) & is_looking_away_of(goal))),
    Rule(37, "view-point-far", "note", "view points",
         f"a view point is more than {RELAXED_RADIUS} m from the goal (planar)",
         _points_where(lambda goal: planar_distances_of(goal) > RELAXED_RADIUS),
         also=(("view-point-beyond-1-m", "view points",
                _points_where(lambda goal: planar_distances_of(goal) > SUCCESS_RADIUS)),)),
    Rule(38, "start-near-centre", "note", "episodes", "the start is within 1 m of the target's centre (planar)",
         _episodes_where(_starts_near_centre)),
    Rule(39, "start-near-view-point", "note", "episodes", "the start is within 1 m of the first target's view points",
         _episodes_where(partial(_starts_near_view_point, num_targets=1)),
         also=(("start-near-view-point-of-any-target", "episodes",
                _episodes_where(partial(_starts_near_view_point, num_targets=None))),)),
    Rule(40, "storey-label-wrong", "defect", "objects", "the storey label disagrees with the object's height",
         _objects_on_wrong_storey),
    Rule(41, "iou-above-1", "note", "original view points", "iou is a coverage score, not a ratio",
         _points_where(lambda goal: np.array([(point.iou or 0.0) > 1 for point in goal.view_points], bool))),
    Rule(42, "category-id-differs", "note", "categories", "a category has a different id in another split",
         _categories_with_several_ids),
    Rule(43, "start-reused", "note", "pairs of starts", "the same start position is used in two splits",
         _starts_in_several_splits),
)  # fmt: skip
