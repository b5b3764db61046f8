"""Collects the facts about one scene in the episode files: the robot's places, objects, captions, true path lengths.

Episode files -> `Recorded`, from which `recover` makes a schematic home.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode, Goal
from sim.types import SPLITS, Split

_SAME_LENGTH = 1e-3  # metres; lengths are stored with 32 bits

Point = tuple[float, float, float]


class PathLength(NamedTuple):
    """The true length of the shortest way between two places, as an episode stores it."""

    split: Split
    target: str
    """`object_name` of the episode's (first) target."""
    start: Point
    end: Point
    """`view_points[0]` of the target."""
    length: float
    """Length in metres on Habitat's navmesh."""

    @property
    def is_possible(self) -> bool:
        """Whether it is no shorter than the straight line; the others lead to another view point (12 of 2,000)."""
        return self.length >= math.dist(self.start, self.end) - _SAME_LENGTH


class Recorded(NamedTuple):
    """The facts about one scene in the episode files."""

    standing: NDArray[np.float64]
    """(N, 3) places where the robot stood: original view points and starts, sorted, each once."""
    extras: NDArray[np.float64]
    """(M, 3) the view points that the generator added: random places of Habitat's navmesh near view_points[0], also
    on the storeys above and below; sorted, each once."""
    goals: dict[str, Goal]
    captions: dict[str, str]
    """First caption of each object that is a target of an episode."""
    lengths: tuple[PathLength, ...]
    """One per episode, in the order of the files."""

    @property
    def places(self) -> NDArray[np.float64]:
        """Every known place of the robot's centre, (N + M, 3): `standing`, then `extras`."""
        return np.concatenate([self.standing, self.extras])


def recorded_facts(dataset: PersonalDataset, scene: str, *, splits: tuple[Split, ...] = SPLITS) -> Recorded:
    """The facts of a scene in the named splits; the other splits' files are not read.

    An object in several splits is taken from the first of them, with the extra view points of all.

    Raises:
        DatasetError: The scene is unknown or its files are damaged.
    """
    dataset.require_scene(scene)
    named: tuple[Split, ...] = tuple(split for split in SPLITS if split in splits and (split, scene) in dataset.files)
    entries = [
        goal for split in named for goals in dataset.content(split, scene).goals_by_category.values() for goal in goals
    ]
    goals: dict[str, Goal] = {}
    standing: set[Point] = set()
    extras: set[Point] = set()
    for goal in entries:
        goals.setdefault(goal.object_name, goal)
        for point in goal.view_points:
            (extras if point.iou is None else standing).add(_rounded(point.agent_state.position))
    captions: dict[str, str] = {}
    lengths: list[PathLength] = []
    for episode in dataset.episodes(splits=named, scenes=(scene,)):
        standing.add(_rounded(episode.record.start_position))
        for name, texts in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
            if texts:
                captions.setdefault(name, texts[0])
        if episode.targets[0].view_points:
            lengths.append(_length_of(episode))
    return Recorded(_points(standing), _points(extras - standing), goals, captions, tuple(lengths))


def _length_of(episode: Episode) -> PathLength:
    target = episode.targets[0]
    end = target.view_points[0].agent_state.position
    length = episode.record.info.geodesic_distance
    return PathLength(episode.key.split, target.object_name, episode.record.start_position, end, length)


def _rounded(position: Point) -> Point:
    x, y, z = (round(value, 4) for value in position)
    return x, y, z


def _points(places: set[Point]) -> NDArray[np.float64]:
    return np.array(sorted(places), float).reshape(-1, 3)


def original_places(goal: Goal) -> NDArray[np.float64]:
    """Feet positions (V, 3) of the robot at the goal's original view points."""
    return np.array([p.agent_state.position for p in goal.original_view_points], float).reshape(-1, 3)
