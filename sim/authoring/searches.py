"""Draws searches in a home: the owners, the person in the query, the description, and the robot's start."""

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import DatasetError
from sim.frames import quat_xyzw_from_yaw, yaw_towards
from sim.types import SPLITS, Split
from sim.walk.navigation_map import NavigationMap, Points

from ..episodes.checks_geometry import GEODESIC_LIMITS, positions_of
from ..episodes.ownership import anonymous_summary, queries_for
from ..episodes.schema import EpisodeInfo, EpisodeRecord, Goal, Vector3
from .annotated import AnnotatedHome, Thing
from .captions import are_mixed_up, names_category, ownership_sentence
from .descriptions import Describe, OwnedItem, write_description
from .people import NAMES, Edge, draw_ownership, unmet_need

Starts = Literal["invented", "released", "paper"]
"""Named rules for starts, see `START_RULES`."""
MOST_EPISODES = 300
"""Most episodes of a home in a split."""
ONE_OF_SHARE = 0.05
"""Share of the queries of medium and hard that ask for "one of X's chairs" (35 of 1,400 in the release)."""
_TRIES = 80
_STARTS = 256
_FURTHEST = 15.0
"""Largest planar distance of a start from the target (metres)."""
_JITTER = 0.02
"""Starts are moved by up to this much from the middle of a map's cell (metres)."""
_LEAST_WAY = 1.0
"""Starts this near the target or one of its view points are refused: the robot has arrived (planar metres)."""
_MARGIN = 0.01
"""Distance of starts from the ends of the split's window (metres)."""
_SAME = 1e-6
"""A walk this much shorter than the straight line is as long (metres)."""
_AWAY = np.pi / 4
"""Starts of the release look away from the target, with this much noise to either side (DATA_FORMAT.md, 5.3)."""
_MOST_ITEMS = 12
"""Most objects that are offered to the graph."""
ODD_PLURALS = ("s", "x", "ch", "sh", "f", "y")
"""Queries add a bare "s" (DATA_FORMAT.md, section 3), which is wrong after these endings."""
_IDS_PER_HOME = 1000


class StartRule(NamedTuple):
    """A rule for the robot's starts."""

    level: float
    """Largest height difference from the target's floor (metres)."""
    is_from_nearest: bool
    """Whether the window of distances holds for the nearest view point too, not only for the first one."""
    looks_away: bool
    """Whether starts look away from the target as in the release; otherwise in any direction."""


START_RULES: dict[Starts, StartRule] = {
    "invented": StartRule(level=0.09, is_from_nearest=False, looks_away=False),
    "released": StartRule(level=0.5, is_from_nearest=True, looks_away=False),
    "paper": StartRule(level=0.5, is_from_nearest=False, looks_away=True),
}
"""`invented`: of invented homes. `released`: the release's windows, measured to the nearest view point. `paper`: as the
authors' program draws them: measured to the first view point, looking 135 to 180 degrees away from the target."""


@dataclass(frozen=True, slots=True)
class Style:
    """The parts of a search that differ between datasets."""

    starts: Starts = "invented"
    describe: Describe = write_description
    advice: str = "Take another --seed."
    """What to do where nothing can be drawn."""


class _Search(NamedTuple):
    """Everything that is drawn for one episode; items and people are indices."""

    names: list[str]
    """Names of the objects; `edges` holds indices into them."""
    edges: list[Edge]
    person: int
    """The owner in the query."""
    targets: list[Goal]
    """The right objects, nearest to the start first."""
    start: "Start"


class Start(NamedTuple):
    """Where a robot begins."""

    position: Vector3
    yaw: float
    geodesic: float
    """Metres to the first view point of the first target."""


def draw_searches(
    home: AnnotatedHome, counts: Mapping[Split, int], *, rng: np.random.Generator, style: Style
) -> dict[Split, tuple[EpisodeRecord, ...]]:
    """Episodes of a home: so many of each split; no two tell the same story and ask the same.

    The storeys that can keep the split's rule of ownership take turns; objects that were asked for come last.

    Raises:
        DatasetError: A number is out of range, or a split's constraint cannot be met; the message says which one.
    """
    found: dict[Split, tuple[EpisodeRecord, ...]] = {}
    asked: set[str] = set()
    for split in SPLITS:
        count = counts.get(split, 0)
        if not 0 <= count <= MOST_EPISODES:
            raise DatasetError(
                f"scene {home.name!r}: {count} episodes of split {split!r}; expected 0 to {MOST_EPISODES}. "
                "Give another number."
            )
        storeys = storeys_for(home, split) if count else []
        records: list[EpisodeRecord] = []
        stories: set[tuple[str, ...]] = set()
        for index in range(count):
            storey = storeys[index % len(storeys)]
            record = _draw_search(home, split, index, storey, asked=asked, stories=stories, rng=rng, style=style)
            records.append(record)
            stories.add(_story(record))
            asked = asked.union(record.object_names)
        found[split] = tuple(records)
    return found


def storeys_for(home: AnnotatedHome, split: Split) -> list[str]:
    """The `floor_id`s of the storeys whose objects can keep a split's rule of ownership.

    Raises:
        DatasetError: There is none; the message names the rule, what each storey has, and what it needs.
    """
    needs = {floor_id: unmet_need(split, _conflicts(home, home.on_storey(floor_id))) for floor_id in home.storeys}
    fitting = [floor_id for floor_id, need in needs.items() if need is None]
    if fitting:
        return fitting
    found = "; ".join(f"{home.storeys[floor_id]}: {need}" for floor_id, need in needs.items()) or "no object has words"
    raise DatasetError(
        f"scene {home.name!r}: split {split!r} cannot be made, {found}. Annotate more objects there, or ask for 0 "
        f"episodes of {split}."
    )


def _draw_search(
    home: AnnotatedHome,
    split: Split,
    index: int,
    storey: str,
    *,
    asked: set[str],
    stories: set[tuple[str, ...]],
    rng: np.random.Generator,
    style: Style,
) -> EpisodeRecord:
    """One episode, the `index`-th (from 0) of its split, unlike those of `stories`."""
    rule = START_RULES[style.starts]
    wants_several = split != "easy" and rng.random() < ONE_OF_SHARE
    failed: Counter[str] = Counter()
    for attempt in range(_TRIES):
        # not every home has two pieces of a category for a "one of" query, or a start for each object
        is_choosy = attempt < _TRIES // 2
        avoided = asked if is_choosy else set[str]()
        search = _drawn(home, split, storey, avoided, rng, rule, wants_several=wants_several and is_choosy)
        if isinstance(search, str):
            failed[search] += 1
            continue
        record = _record(home, split, index, search, rng, style)
        if record is None:
            failed["description"] += 1
        elif _story(record) in stories:
            failed["story"] += 1
        else:
            return record
    raise DatasetError(
        f"scene {home.name!r}: split {split!r}, {_why(home, split, storey, failed, rule)} {style.advice}"
    )


def _why(home: AnnotatedHome, split: Split, storey: str, failed: Counter[str], rule: StartRule) -> str:
    """The constraint at which most tries failed, with what was found and what would be needed."""
    floor, (low, high) = home.storeys[storey], GEODESIC_LIMITS[split]
    most = failed.most_common(1)[0][0]
    if most == "start":
        to = "nearest" if rule.is_from_nearest else "first"
        return (
            f"start {low:g}-{high:g} m from the {to} view point of the target: found none on the {floor} in {_TRIES} "
            f"tries, where the longest walk to an object is {_longest_walk(home, storey, rule):.2f} m; expected one "
            f"between {low:g} and {high:g} m, more than {_LEAST_WAY:g} m from the target's view points."
        )
    return {
        "graph": f"ownership graph: found none that keeps the split's rule over the objects on the {floor} in {_TRIES} "
        "tries; expected more objects of different categories.",
        "target": f"query with one meaning: found no owner with one on the {floor} in {_TRIES} tries; expected objects "
        "of different categories.",
        "description": f"description: found none on the {floor} in {_TRIES} tries from which every owner and object is "
        "read back; expected captions in plain words.",
        "story": f"no episode twice: found only repeated ones on the {floor} in {_TRIES} tries; expected more objects "
        "or fewer episodes.",
    }[most]


def _longest_walk(home: AnnotatedHome, storey: str, rule: StartRule) -> float:
    """Metres of the longest walk from a place of a storey to a view point as the rule measures it; 0 without any."""
    goals = [home.things[name].goal for name in home.on_storey(storey)]
    rng = np.random.default_rng(0)
    walks = [_walks(home.navigation, _places(home.navigation, goal, rule, rng), [goal], rule)[0] for goal in goals]
    finite = [walk[np.isfinite(walk)] for walk in walks]
    return max((float(walk.max()) for walk in finite if len(walk)), default=0.0)


def _story(record: EpisodeRecord) -> tuple[str, ...]:
    """What an episode tells and asks, without names; two with the same are one episode (DATA_FORMAT.md, row 44)."""
    text, slots = anonymous_summary(record)
    return (text, str(slots.get(record.owner)), *record.object_names)


def _drawn(
    home: AnnotatedHome,
    split: Split,
    storey: str,
    asked: set[str],
    rng: np.random.Generator,
    rule: StartRule,
    *,
    wants_several: bool,
) -> _Search | Literal["graph", "target", "start"]:
    """A graph, a target and a start; or what is missing."""
    names = _offered(home, home.on_storey(storey), rng, wants_several=wants_several)
    try:
        edges = draw_ownership(split, _conflicts(home, names, may_own_twins=wants_several), rng=rng)
    except DatasetError:
        return "graph"
    choices: dict[tuple[int, str], list[str]] = {}
    for edge in edges:
        choices.setdefault((edge.person, _category(home, names[edge.item])), []).append(names[edge.item])
    fitting = [(person, owned) for (person, _), owned in choices.items() if (len(owned) > 1) == wants_several]
    if not fitting:
        return "target"
    new = [choice for choice in fitting if not asked.intersection(choice[1])] or fitting
    person, owned = new[int(rng.integers(len(new)))]
    start = draw_start(home.navigation, [home.things[name].goal for name in owned], split, rng, rule)
    if start is None:
        return "start"
    return _Search(names, edges, person, start[0], start[1])


def _offered(home: AnnotatedHome, on_storey: list[str], rng: np.random.Generator, *, wants_several: bool) -> list[str]:
    """Some objects of a storey in random order; two of one category first where a search wants several."""
    names = [on_storey[k] for k in rng.permutation(len(on_storey))]
    if wants_several:
        counts = Counter(_category(home, name) for name in names)
        category = next((c for c, count in counts.items() if count > 1 and not c.endswith(ODD_PLURALS)), "")
        twins = [name for name in names if _category(home, name) == category][:2]
        names = [*twins, *(name for name in names if name not in twins)]
    return names[:_MOST_ITEMS]


def _conflicts(home: AnnotatedHome, names: Sequence[str], *, may_own_twins: bool = False) -> NDArray[np.bool_]:
    """(M, M) True for two objects that one person may not own, because a query could mean either."""
    things = [home.things[name] for name in names]
    return np.array([[may_be_meant(a, b, may_own_twins) for b in things] for a in things], bool).reshape(
        len(names), len(names)
    )


def may_be_meant(first: Thing, second: Thing, may_own_twins: bool) -> bool:
    """Whether a query for one of two objects could mean the other."""
    one, other = first.goal.object_category, second.goal.object_category
    if one == other:
        return not may_own_twins
    return are_mixed_up(one, other) or names_category(one, second.phrase) or names_category(other, first.phrase)


def _category(home: AnnotatedHome, name: str) -> str:
    return home.things[name].goal.object_category


def draw_start(
    navigation: NavigationMap, goals: list[Goal], split: Split, rng: np.random.Generator, rule: StartRule
) -> tuple[list[Goal], Start] | None:
    """The goals, nearest first, and a start in the split's window on their storey; None where none was found."""
    points = _places(navigation, goals[0], rule, rng)
    if not len(points):
        return None
    walks, distances = _walks(navigation, points, goals, rule)
    low, high = GEODESIC_LIMITS[split]
    places = np.array(
        [place for goal in goals for place in (goal.position, *(p.agent_state.position for p in goal.view_points))]
    )[:, [0, 2]]
    near = (np.linalg.norm(points[:, None, [0, 2]] - places, axis=2) <= _LEAST_WAY).any(axis=1)
    nearest = distances.min(axis=1)
    fits = np.flatnonzero((walks > low + _MARGIN) & (nearest < high - _MARGIN) & ~near)
    if not len(fits):
        return None
    chosen = int(fits[0])
    x, y, z = (float(value) for value in points[chosen])
    ordered = [goals[k] for k in np.argsort(distances[chosen], kind="stable")]
    yaw = float(rng.uniform(-np.pi, np.pi))
    if rule.looks_away:
        target = ordered[0].position
        yaw = yaw_towards((x, z), (target[0], target[2])) + np.pi + yaw / np.pi * _AWAY
    return ordered, Start((x, y, z), yaw, float(nearest[chosen]))


def _walks(
    navigation: NavigationMap, points: Points, goals: Sequence[Goal], rule: StartRule
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) walks to the nearest goal as the rule measures them, and (N, G) to each goal's first view point; metres."""
    firsts = np.array([goal.view_points[0].agent_state.position for goal in goals])
    walked = np.stack([navigation.distances(points, first[None]) for first in firsts], axis=1)
    straight = np.linalg.norm(points[:, None] - firsts, axis=2)
    # a map that moves ends to its own places may measure less
    distances = np.where(straight > walked + _SAME, straight, walked)
    if not rule.is_from_nearest:
        return distances.min(axis=1), distances
    return navigation.distances(points, np.concatenate([positions_of(goal) for goal in goals])), distances


def _places(navigation: NavigationMap, goal: Goal, rule: StartRule, rng: np.random.Generator) -> Points:
    """(_STARTS, 3) places to stand on the goal's storey, uniform over its floor; (0, 3) where there are none."""
    x, _, z = goal.position
    cells = navigation.points_within(np.array([[x, goal.floor_y, z]]), _FURTHEST, max_dy=rule.level)
    if not len(cells):
        return cells
    places = cells[rng.integers(len(cells), size=_STARTS)]
    places[:, [0, 2]] += rng.uniform(-_JITTER, _JITTER, size=(_STARTS, 2))
    return places


def _record(
    home: AnnotatedHome, split: Split, index: int, search: _Search, rng: np.random.Generator, style: Style
) -> EpisodeRecord | None:
    """The episode of a search; None where it cannot be described."""
    num_people = max(edge.person for edge in search.edges) + 1
    people = [str(name) for name in rng.choice(NAMES, size=num_people, replace=False)]
    first, start = search.targets[0], search.start
    summary = style.describe(_owned(home, search, people), floor=home.storeys[first.floor_id], rng=rng)
    if summary is None:
        return None
    slots = [home.things[goal.object_name].captions for goal in search.targets]
    several = len(search.targets) > 1
    return EpisodeRecord(
        episode_id=str(_first_id(home.name) + SPLITS.index(split) * (_IDS_PER_HOME // len(SPLITS)) + index),
        scene_id=home.scene_id,
        scene_dataset_config=home.scene_dataset_config,
        object_category=first.object_category,
        object_id=tuple(goal.object_name for goal in search.targets) if several else first.object_name,
        description=tuple(slots) if several else slots[0],
        owner=people[search.person],
        floor_id=first.floor_id,
        summary=summary,
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


def _sentence(home: AnnotatedHome, name: str, owner: str) -> str:
    return ownership_sentence(owner, home.things[name].phrase, home.things[name].room)


def _owned(home: AnnotatedHome, search: _Search, people: Sequence[str]) -> list[OwnedItem]:
    """The objects of a search with the names of their owners."""
    owned = []
    for item in sorted({edge.item for edge in search.edges}):
        thing = home.things[search.names[item]]
        owners = tuple(people[edge.person] for edge in search.edges if edge.item == item)
        owned.append(OwnedItem(thing.phrase, thing.room, owners))
    return owned


def _first_id(scene: str) -> int:
    """The home's first episode id; ids of different homes do not overlap, because validators want them unique."""
    return int(hashlib.sha256(scene.encode()).hexdigest()[:9], 16) * _IDS_PER_HOME
