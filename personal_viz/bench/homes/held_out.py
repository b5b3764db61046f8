"""Measures whether recovery does more than memorise: a home from two splits must give the path lengths of the third,
and a home from one edition of the dataset must serve the episodes of another.

Episode files -> path length ratios of places that the home's files never connected. Reported by `personal-viz homes`.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.homes.cells import cells_from_runs
from sim.homes.plan import HomePlan
from sim.homes.recovered.plans import recover_plan
from sim.homes.recovered.recorded import asked
from sim.homes.recovered.walkable import PLAN_CLIMB
from sim.types import FORWARD_STEP, SPLITS, EpisodeKey, Split
from sim.walk.floor_grid import FloorGrid
from sim.walk.navigation_map import NavigationMap
from sim.walk.storeys import same_storey

SNAP_TOLERANCE = FORWARD_STEP
"""Largest distance of a start from the map (planar metres); farther off it would be another place."""
NEAR_TRAINING = 0.5
"""A start within this distance of a place that the two splits know can be judged (metres; issue 4)."""


class Served(NamedTuple):
    """How a home serves the episodes of an edition that it was not made from, one value per episode."""

    ratios: NDArray[np.float64]
    """(N,) `path_ratios`."""
    on_floor: NDArray[np.bool_]
    """(N,) `starts_on_floor`."""


class Walk(NamedTuple):
    """The two places whose path length an episode records."""

    key: EpisodeKey
    start: tuple[float, float, float]
    """Feet, world metres."""
    end: tuple[float, float, float]
    """First view point of the (first) target, world metres."""
    recorded: float
    """Metres along the shortest path in the scan."""


def recorded_walk(episode: Episode) -> Walk:
    """Start, first view point and recorded length of an episode.

    In 12 of the release's 2,000 episodes the recorded length is below the straight line, so it belongs to another,
    unnamed view point. In homes they stay in every denominator and count against us; `check-scans` counts them apart.
    """
    end = episode.targets[0].view_points[0].agent_state.position
    return Walk(episode.key, episode.record.start_position, end, episode.record.info.geodesic_distance)


def path_ratios(walks: Iterable[Walk], navigation: NavigationMap) -> NDArray[np.float64]:
    """(N,) length of each walk on this map over the recorded one; inf if there is no path, or none was recorded."""
    walks = list(walks)
    lengths = np.full(len(walks), np.inf)
    ends = sorted({walk.end for walk in walks})
    for end in ends:
        chosen = [index for index, walk in enumerate(walks) if walk.end == end]
        lengths[chosen] = navigation.distances(np.array([walks[index].start for index in chosen]), np.array([end]))
    recorded = np.array([walk.recorded for walk in walks], float).reshape(-1)
    return np.where(recorded > 0, lengths / np.where(recorded > 0, recorded, 1.0), np.inf)


def starts_on_floor(starts: Sequence[tuple[float, float, float]], navigation: NavigationMap) -> NDArray[np.bool_]:
    """(N,) whether a place of the map is within SNAP_TOLERANCE of each start, on its storey."""
    found = np.zeros(len(starts), bool)
    for index, start in enumerate(np.array(starts, float).reshape(-1, 3)):
        snapped = navigation.snap(start)
        if snapped is not None:
            away = np.hypot(*(snapped - start)[[0, 2]])
            found[index] = away <= SNAP_TOLERANCE and same_storey(float(snapped[1]), float(start[1]))
    return found


def served(edition: PersonalDataset, dataset: PersonalDataset, scene: str, navigation: NavigationMap) -> Served:
    """How a home of `dataset` and its evidence serves another edition's episodes in the scene, except those that they
    hold too.

    Raises:
        DatasetError: A file is damaged.
    """
    known = {
        asked(episode) for made_from in (dataset, *dataset.evidence) for episode in _all_episodes(made_from, scene)
    }
    episodes = [episode for episode in _all_episodes(edition, scene) if asked(episode) not in known]
    starts = [episode.record.start_position for episode in episodes]
    return Served(path_ratios(map(recorded_walk, episodes), navigation), starts_on_floor(starts, navigation))


def held_out_ratios(dataset: PersonalDataset, scene: str) -> NDArray[np.float64]:
    """(N,) `path_ratios` of held-out episodes, over every fold of two splits against the third.

    The held-out episodes are those of the third split whose start is within NEAR_TRAINING (3-D) of a place where the
    robot stood in the other two, and whose target is among the goals of those two. Splits without the scene give no
    fold. Of the evidence, the home gets the same two splits, and the held-out episodes are the same without it.

    Raises:
        DatasetError: A file is damaged.
        SceneError: A pair of splits holds no place to stand.
    """
    ratios = [_fold(dataset, scene, held_out) for held_out in SPLITS if (held_out, scene) in dataset.files]
    return np.concatenate(ratios) if ratios else np.empty(0)


def held_out_walks(dataset: PersonalDataset, scene: str, held_out: Split) -> list[Walk]:
    """The walks of one split for which the other two splits hold enough information; see `held_out_ratios`.

    Raises:
        DatasetError: A file is damaged.
    """
    others = _others(dataset, scene, held_out)
    goals = [
        goal for split in others for goals in dataset.content(split, scene).goals_by_category.values() for goal in goals
    ]
    names = {goal.object_name for goal in goals}
    points = [point.agent_state.position for goal in goals for point in goal.original_view_points]
    points += [episode.record.start_position for episode in _episodes(dataset, scene, others)]
    training = np.array(points, float).reshape(-1, 3)
    found = []
    for episode in _episodes(dataset, scene, (held_out,)):
        away = np.linalg.norm(training - np.array(episode.record.start_position), axis=1)
        if episode.targets[0].object_name in names and len(away) and away.min() <= NEAR_TRAINING:
            found.append(recorded_walk(episode))
    return found


def _fold(dataset: PersonalDataset, scene: str, held_out: Split) -> NDArray[np.float64]:
    walks = held_out_walks(dataset, scene, held_out)
    if not walks:
        return np.empty(0)
    return path_ratios(walks, _walkable(recover_plan(dataset, scene, splits=_others(dataset, scene, held_out))))


def _walkable(plan: HomePlan) -> FloorGrid:
    """The plan's own floor, without the mesh that `scene_from_plan` also builds."""
    assert plan.cells is not None, "a recovered plan has cells"
    cells = cells_from_runs(plan.cells.walkable)
    return FloorGrid.from_cells(cells.rc, cells.y, grid=plan.cells.grid, max_climb=PLAN_CLIMB)


def _others(dataset: PersonalDataset, scene: str, held_out: Split) -> tuple[Split, ...]:
    return tuple(split for split in SPLITS if split != held_out and (split, scene) in dataset.files)


def _episodes(dataset: PersonalDataset, scene: str, splits: tuple[Split, ...]) -> Iterable[Episode]:
    return dataset.episodes(splits=splits, scenes=(scene,))


def _all_episodes(edition: PersonalDataset, scene: str) -> Iterable[Episode]:
    return edition.episodes(scenes=(scene,)) if scene in edition.scenes else ()
