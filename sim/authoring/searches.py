"""Draws one search in an invented home: the owners, the person in the query, and the robot's start."""

import hashlib
from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import DatasetError
from sim.frames import quat_xyzw_from_yaw
from sim.homes.plan import Furniture, HomePlan
from sim.types import SPLITS, Split
from sim.walk.navigation_map import NavigationMap

from ..episodes.checks_geometry import GEODESIC_LIMITS
from ..episodes.ownership import queries_for
from ..episodes.schema import EpisodeInfo, EpisodeRecord, Goal, Vector3
from .captions import are_mixed_up, ownership_sentence
from .descriptions import OwnedItem, write_description
from .people import NAMES, Edge, draw_ownership

ONE_OF_SHARE = 0.05
"""Share of the queries of medium and hard that ask for "one of X's chairs" (35 of 1,400 in the release)."""
_TRIES = 80
_STARTS = 256
_FURTHEST, _LEVEL = 15.0, 0.09
"""Largest planar distance of a start from the target, and largest height difference from its floor (metres)."""
_JITTER = 0.02
"""Starts are moved by up to this much from the middle of a map's cell (metres)."""
_LEAST_WAY = 1.0
"""Starts this near the target or one of its view points are refused: the robot has arrived (planar metres)."""
_MARGIN = 0.01
"""Distance of starts from the ends of the split's window (metres)."""
_MOST_ITEMS = 12
"""Most objects that are offered to the graph."""
_ODD_PLURALS = ("s", "x", "ch", "sh", "f", "y")
"""Queries add a bare "s" (DATA_FORMAT.md, section 3), which is wrong after these endings."""
_CONFIG = "invented home, no scene dataset config"
_IDS_PER_HOME = 1000


@dataclass(frozen=True, slots=True)
class FurnishedHome:
    """A home with the goals and captions for its searches."""

    plan: HomePlan
    navigation: NavigationMap
    goals: dict[str, Goal]
    """Goals by `object_name`: all pieces of the plan that have captions."""
    captions: dict[str, str]
    """Captions by `object_name`."""

    def piece(self, name: str) -> Furniture:
        """The piece with this name."""
        return next(piece for piece in self.plan.furniture if piece.name == name)


class _Search(NamedTuple):
    """Everything that is drawn for one episode; items and people are indices."""

    names: list[str]
    """Names of the objects; `edges` holds indices into them."""
    edges: list[Edge]
    person: int
    """The owner in the query."""
    targets: list[Goal]
    """The right objects, nearest to the start first."""
    start: "_Start"


class _Start(NamedTuple):
    position: Vector3
    yaw: float
    geodesic: float
    """Metres to the first view point of the first target."""


def draw_search(
    home: FurnishedHome, split: Split, index: int, *, asked: set[str], rng: np.random.Generator
) -> EpisodeRecord:
    """One episode, the `index`-th (from 0) of its split; storeys take turns.

    The split gives the rule of ownership and the window of distances; objects that earlier searches `asked` for come
    last.

    Raises:
        DatasetError: No graph or no start was found.
    """
    storey = index % len(home.plan.storeys)
    wants_several = split != "easy" and rng.random() < ONE_OF_SHARE
    for attempt in range(_TRIES):
        # not every home has two pieces of a category for a "one of" query
        search = _drawn(home, split, storey, asked, rng, wants_several=wants_several and attempt < _TRIES // 2)
        if search is not None:
            return _record(home, split, index, search, rng)
    raise DatasetError(
        f"invented home {home.plan.name!r}: split {split!r} has no target with a start at a distance in "
        f"{GEODESIC_LIMITS[split]} m, {_TRIES} tries; expected one. Take another --seed."
    )


def _drawn(
    home: FurnishedHome,
    split: Split,
    storey: int,
    asked: set[str],
    rng: np.random.Generator,
    *,
    wants_several: bool,
) -> _Search | None:
    """A graph, a target and a start; None where the graph has no suitable target, or the target no start."""
    on_storey = [name for name, goal in home.goals.items() if goal.floor_id == str(storey)]
    names = _offered(home, on_storey, rng, wants_several=wants_several)
    edges = draw_ownership(split, _conflicts(home, names, may_own_twins=wants_several), rng=rng)
    choices: dict[tuple[int, str], list[str]] = {}
    for edge in edges:
        choices.setdefault((edge.person, home.piece(names[edge.item]).category), []).append(names[edge.item])
    fitting = [(person, owned) for (person, _), owned in choices.items() if (len(owned) > 1) == wants_several]
    if not fitting:
        return None
    new = [choice for choice in fitting if not asked.intersection(choice[1])] or fitting
    person, owned = new[int(rng.integers(len(new)))]
    goals = [home.goals[name] for name in owned]
    start = _start(home.navigation, goals, split, rng)
    if start is None:
        return None
    return _Search(names, edges, person, start[0], start[1])


def _offered(home: FurnishedHome, on_storey: list[str], rng: np.random.Generator, *, wants_several: bool) -> list[str]:
    """Some objects of a storey in random order; two of one category first where a search wants several."""
    names = [on_storey[k] for k in rng.permutation(len(on_storey))]
    if wants_several:
        counts = Counter(home.piece(name).category for name in names)
        category = next((c for c, count in counts.items() if count > 1 and not c.endswith(_ODD_PLURALS)), "")
        twins = [name for name in names if home.piece(name).category == category][:2]
        names = [*twins, *(name for name in names if name not in twins)]
    return names[:_MOST_ITEMS]


def _conflicts(home: FurnishedHome, names: list[str], *, may_own_twins: bool) -> NDArray[np.bool_]:
    """(M, M) True for two objects that one person may not own, because a query could mean either."""
    categories = [home.piece(name).category for name in names]
    return np.array(
        [[are_mixed_up(a, b) and not (may_own_twins and a == b) for b in categories] for a in categories], bool
    ).reshape(len(names), len(names))


def _start(
    navigation: NavigationMap, goals: list[Goal], split: Split, rng: np.random.Generator
) -> tuple[list[Goal], _Start] | None:
    """The goals, nearest first, and a start in the split's window on their storey; None where none was found."""
    points = _places(navigation, goals[0], rng)
    firsts = [np.array([goal.view_points[0].agent_state.position]) for goal in goals]
    distances = np.stack([navigation.distances(points, first) for first in firsts], axis=1)  # (_STARTS, G)
    low, high = GEODESIC_LIMITS[split]
    places = np.array(
        [place for goal in goals for place in (goal.position, *(p.agent_state.position for p in goal.view_points))]
    )[:, [0, 2]]
    near = (np.linalg.norm(points[:, None, [0, 2]] - places, axis=2) <= _LEAST_WAY).any(axis=1)
    nearest = distances.min(axis=1)
    fits = np.flatnonzero((nearest > low + _MARGIN) & (nearest < high - _MARGIN) & ~near)
    if not len(fits):
        return None
    chosen = int(fits[0])
    x, y, z = (float(value) for value in points[chosen])
    order = np.argsort(distances[chosen], kind="stable")
    start = _Start((x, y, z), float(rng.uniform(-np.pi, np.pi)), float(nearest[chosen]))
    return [goals[k] for k in order], start


def _places(navigation: NavigationMap, goal: Goal, rng: np.random.Generator) -> NDArray[np.float64]:
    """(_STARTS, 3) places to stand on the goal's storey, uniform over its floor."""
    x, _, z = goal.position
    cells = navigation.points_within(np.array([[x, goal.floor_y, z]]), _FURTHEST, max_dy=_LEVEL)
    places = cells[rng.integers(len(cells), size=_STARTS)]
    places[:, [0, 2]] += rng.uniform(-_JITTER, _JITTER, size=(_STARTS, 2))
    return places


def _record(home: FurnishedHome, split: Split, index: int, search: _Search, rng: np.random.Generator) -> EpisodeRecord:
    num_people = max(edge.person for edge in search.edges) + 1
    people = [str(name) for name in rng.choice(NAMES, size=num_people, replace=False)]
    first, scene, start = search.targets[0], home.plan.name, search.start
    slots = [(home.captions[goal.object_name], "", "") for goal in search.targets]
    several = len(search.targets) > 1
    return EpisodeRecord(
        episode_id=str(_first_id(scene) + SPLITS.index(split) * (_IDS_PER_HOME // len(SPLITS)) + index),
        scene_id=f"invented/{scene}/{scene}.basis.glb",
        scene_dataset_config=_CONFIG,
        object_category=first.object_category,
        object_id=tuple(goal.object_name for goal in search.targets) if several else first.object_name,
        description=tuple(slots) if several else slots[0],
        owner=people[search.person],
        floor_id=first.floor_id,
        summary=_summary(home, int(first.floor_id), search, people, rng),
        extracted_summary=tuple(_sentence(home, search.names[edge.item], people[edge.person]) for edge in search.edges),
        query=queries_for(people[search.person], first.object_category, one_of=several),
        start_position=start.position,
        start_rotation=quat_xyzw_from_yaw(start.yaw),
        info=EpisodeInfo(
            geodesic_distance=start.geodesic,
            euclidean_distance=float(
                np.hypot(start.position[0] - first.position[0], start.position[2] - first.position[2])
            ),
            closest_goal_object_id=first.object_id,
        ),
    )


def _sentence(home: FurnishedHome, name: str, owner: str) -> str:
    return ownership_sentence(owner, home.captions[name], home.piece(name).room)


def _summary(home: FurnishedHome, storey: int, search: _Search, people: list[str], rng: np.random.Generator) -> str:
    owned = []
    for item in sorted({edge.item for edge in search.edges}):
        owners = tuple(people[edge.person] for edge in search.edges if edge.item == item)
        name = search.names[item]
        owned.append(OwnedItem(home.captions[name], home.piece(name).room, owners))
    return write_description(owned, floor=home.plan.storeys[storey].label, rng=rng)


def _first_id(scene: str) -> int:
    """The home's first episode id; ids of different homes do not overlap, because validators want them unique."""
    return int(hashlib.sha256(scene.encode()).hexdigest()[:9], 16) * _IDS_PER_HOME
