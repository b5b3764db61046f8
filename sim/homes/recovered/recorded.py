"""Collects the facts about one scene in the episode files: the robot's places, objects, captions, true path lengths.

Episode files of a dataset and of its evidence -> `Recorded`, from which `recover` makes a schematic home.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode, Goal
from sim.errors import DatasetError
from sim.types import SPLITS, Split

from ..plan import Source

_SAME_LENGTH = 1e-3  # metres; lengths are stored with 32 bits
_SAME_PLACE = 0.05
"""Centres of one object in two editions are no farther apart (metres); two objects of the release that share a category
are at least 0.71 m apart, and one object's centre is the same in all its splits."""

Point = tuple[float, float, float]


class PathLength(NamedTuple):
    """The true length of the shortest path between two places, as an episode stores it."""

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
        """Whether it is at least as long as the straight line; the other 12 of 2,000 lead to another view point."""
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
    episodes: tuple[Episode, ...] = ()
    """The episodes whose facts these are."""
    sources: tuple[Source, ...] = ()
    """What the dataset gave, and then each edition of its evidence."""

    @property
    def places(self) -> NDArray[np.float64]:
        """Every known place of the robot's centre, (N + M, 3): `standing`, then `extras`."""
        return np.concatenate([self.standing, self.extras])


def recorded_facts(dataset: PersonalDataset, scene: str, *, splits: tuple[Split, ...] = SPLITS) -> Recorded:
    """The facts of a scene in the named splits of the dataset and of its evidence; other splits' files are not read.

    An object in several splits or editions is taken from the first of them, with the view points of all. An edition's
    object is left out, with the episodes that ask for it, if an earlier edition has it elsewhere, or has the same thing
    under another name. An episode in several editions counts once.

    Raises:
        DatasetError: The scene is unknown, its files are damaged, or most objects that an edition of the evidence
            shares are elsewhere in it.
    """
    dataset.require_scene(scene)
    goals: dict[str, Goal] = {}
    episodes: list[Episode] = []
    starts, views, extras = set[Point](), set[Point](), set[Point]()
    sources: list[Source] = []
    for edition in (dataset, *dataset.evidence):
        named: tuple[Split, ...] = tuple(
            split for split in SPLITS if split in splits and (split, scene) in edition.files
        )
        entries = _entries(edition, scene, named)
        left_out = _contradicting(entries, goals, where=f"{edition.root}: scene {scene!r}")
        entries = [goal for goal in entries if goal.object_name not in left_out]
        before = len(starts), len(views | extras), len(goals)
        for goal in entries:
            known = goals.setdefault(goal.object_name, goal)
            goals[goal.object_name] = known if known is goal else _seen_from_more(known, goal)
            for point in goal.view_points:
                (extras if point.iou is None else views).add(_rounded(point.agent_state.position))
        new = _new_episodes(edition, scene, named, known=episodes, left_out=left_out)
        starts |= {_rounded(episode.record.start_position) for episode in new}
        episodes += new
        sources.append(
            Source(
                digest=edition.scene_digest(scene, splits=named),
                starts=len(starts) - before[0],
                view_points=len(views | extras) - before[1],
                objects=len(goals) - before[2],
                left_out=tuple(sorted(left_out)),
            )
        )
    standing = starts | views
    lengths = tuple(_length_of(episode) for episode in episodes if episode.targets[0].view_points)
    captions = _first_captions(episodes)
    points = _points(standing), _points(extras - standing)
    return Recorded(*points, goals, captions, lengths, tuple(episodes), tuple(sources))


def _entries(edition: PersonalDataset, scene: str, splits: tuple[Split, ...]) -> list[Goal]:
    """The goals of a scene in these splits, in the order of the files."""
    return [
        goal for split in splits for goals in edition.content(split, scene).goals_by_category.values() for goal in goals
    ]


def _contradicting(entries: list[Goal], known: dict[str, Goal], *, where: str) -> set[str]:
    """Names of the goals that are elsewhere in `known`, or have another name there.

    Raises:
        DatasetError: More than half of the goals that `known` has too are elsewhere.
    """
    shared = [goal for goal in entries if goal.object_name in known]
    away = {goal.object_name: math.dist(goal.position, known[goal.object_name].position) for goal in shared}
    moved = {name for name, metres in away.items() if metres > _SAME_PLACE}
    if 2 * len(moved) > len(away):
        raise DatasetError(
            f"{where}: {len(moved)} of {len(away)} objects are elsewhere than in the editions before it, "
            f"{min(moved)!r} by {away[min(moved)]:.2f} m; expected the same home. Leave this edition out."
        )
    renamed = {
        goal.object_name
        for goal in entries
        if goal.object_name not in known
        for other in known.values()
        if other.object_category == goal.object_category and math.dist(other.position, goal.position) <= _SAME_PLACE
    }
    return moved | renamed


def _seen_from_more(goal: Goal, other: Goal) -> Goal:
    """The goal with the original view points of its entry in another split or edition."""
    places = {point.agent_state.position for point in goal.view_points}
    more = [point for point in other.original_view_points if point.agent_state.position not in places]
    return goal.model_copy(update={"view_points": (*goal.view_points, *more)}) if more else goal


def _new_episodes(
    edition: PersonalDataset,
    scene: str,
    splits: tuple[Split, ...],
    *,
    known: list[Episode],
    left_out: set[str],
) -> list[Episode]:
    """The episodes of these splits that are not known and ask for no object that is left out."""
    if not splits:
        return []
    seen = {asked(episode) for episode in known}
    found = edition.episodes(splits=splits, scenes=(scene,))
    return [one for one in found if asked(one) not in seen and left_out.isdisjoint(one.record.object_names)]


def asked(episode: Episode) -> tuple[Point, tuple[str, ...]]:
    """What tells an episode from all others, in any edition: its start and its objects."""
    return episode.record.start_position, tuple(episode.record.object_names)


def _first_captions(episodes: list[Episode]) -> dict[str, str]:
    found: dict[str, str] = {}
    for episode in episodes:
        for name, texts in zip(episode.record.object_names, episode.record.captions_per_object, strict=True):
            if texts:
                found.setdefault(name, texts[0])
    return found


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
