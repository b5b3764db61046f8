"""Homes whose objects have owners' words: from annotations of a scan, or from an edition's goals and captions.

Scene + `AnnotatedObject`s -> goals with view points -> `AnnotatedHome`, from which searches.py draws episodes.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from types import MappingProxyType

import numpy as np

from sim.errors import DatasetError
from sim.frames import quat_xyzw_from_yaw
from sim.homes.plan import floor_name
from sim.homes.recovered.names import room_texts
from sim.mesh import Scene, SceneObject
from sim.render.raycast import Raycaster
from sim.walk.navigation_map import NavigationMap, Points
from sim.walk.viewpoints import SeenFrom, view_points_around

from ..episodes.checks_text import is_annotator_note
from ..episodes.dataset import PersonalDataset
from ..episodes.ownership import normalise_phrase
from ..episodes.schema import AgentState, Goal, ViewPoint
from .annotations import MOST_CAPTIONS, AnnotatedObject

DEFAULT_CONFIG = "default"
"""Habitat's `scene_dataset_config` of scans that belong to no dataset."""
_SAMPLES = 32
"""Random places of a storey among which the one joined to most others stands for its floor."""
_NEXT_SENTENCE = re.compile(r"\s*[.;!?]+\s+(\w)")
_ARTICLE = re.compile(r"^(?:an?|the)\s+", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Thing:
    """An object that people can own, with its words."""

    goal: Goal
    phrase: str
    """Its words in descriptions, without article: "green velvet armchair near the oak bookshelf"."""
    room: str
    captions: tuple[str, ...]
    """The slots of the episodes' `description`, as they were written."""


@dataclass(frozen=True, slots=True)
class AnnotatedHome:
    """A home with everything that its searches need."""

    name: str
    scene_id: str
    """Path of the scan below `--scenes-dir`, as Habitat wants it."""
    scene_dataset_config: str
    navigation: NavigationMap
    storeys: Mapping[str, str]
    """Name in texts of each storey by its `floor_id`, from the lowest up."""
    things: Mapping[str, Thing]
    """By `object_name`."""
    left_out: tuple[str, ...] = ()
    """Objects that episodes cannot ask for, each with the reason."""

    def on_storey(self, floor_id: str) -> list[str]:
        """Names of the things on a storey, in their order."""
        return [name for name, thing in self.things.items() if thing.goal.floor_id == floor_id]


def home_from_annotations(
    scene: Scene, objects: Sequence[AnnotatedObject], *, scene_id: str, config: str = DEFAULT_CONFIG
) -> AnnotatedHome:
    """The home of a scan, whose view points are places that see the objects.

    Objects without caption or room, those that no reachable place sees, those on another floor than they say, and those
    whose words another object of the storey has too are left out.

    Args:
        scene: The scan; objects without a box are among its semantics.
        objects: Its objects.
        scene_id: Path of the scan below the folder of scans.
        config: Habitat's `scene_dataset_config`.

    Raises:
        DatasetError: The semantics lack an object.
    """
    semantics = {item.instance_id: item for item in scene.objects}
    renderer = Raycaster(scene.mesh)
    floors = _floors(scene.navigation)
    things: dict[str, Thing] = {}
    left_out: list[str] = []
    for item in objects:
        found = _scene_object(item, semantics, scene.name)
        if not item.is_complete:
            why = "has no room yet" if item.captions else "has no caption yet"
            left_out.append(f"{found.name} {'is flagged' if item.flagged else why}")
            continue
        seen = view_points_around(found, scene.mesh, navigation=scene.navigation, renderer=renderer)
        points = _joined([view_point(place) for place in seen], scene.navigation, floors)
        if not points:
            left_out.append(f"{found.name} is seen from no place that a robot can reach")
            continue
        goal = Goal(
            position=found.centre,
            object_id=item.id,
            object_name=found.name,
            object_category=item.category,
            floor_id=str(item.storey),
            view_points=points,
        )
        things[goal.object_name] = _thing(goal, item.captions, item.room)
    return _home(scene, things, left_out, scene_id=scene_id, config=config)


def captioned_goals(dataset: PersonalDataset, scene: str) -> dict[str, tuple[Goal, tuple[str, ...], str]]:
    """The objects that a scene's episodes ask for, by `object_name`: goal, filled caption slots, and room.

    The room is the one that ownership sentences name most often; empty where none does.

    Raises:
        DatasetError: The scene's episodes are damaged, or there are none.
    """
    episodes = list(dataset.episodes(scenes=(scene,)))
    if not episodes:
        raise DatasetError(
            f"{dataset.root}: scene {scene!r} has no episodes and no annotations; expected objects with captions. "
            "Annotate it first."
        )
    rooms = room_texts(episodes)
    found: dict[str, tuple[Goal, tuple[str, ...], str]] = {}
    for episode in episodes:
        for goal, words in zip(episode.targets, episode.record.captions_per_object, strict=True):
            counts = rooms.get(goal.object_name, {})
            room = min(counts.items(), key=lambda entry: (-entry[1], entry[0]), default=("", 0))[0]
            found.setdefault(goal.object_name, (goal, words, room))
    return dict(sorted(found.items()))


def home_from_edition(
    dataset: PersonalDataset, scene: Scene, *, refined: Mapping[int, AnnotatedObject] = MappingProxyType({})
) -> AnnotatedHome:
    """The home of a scene that has episodes: the objects that they ask for, with their captions and rooms.

    The goals keep the edition's original view points where a robot can stand in this scene.

    Args:
        dataset: The edition.
        scene: The home.
        refined: Objects whose captions were refined, by number; flagged ones are left out.

    Raises:
        DatasetError: The scene's episodes are damaged, or there are none.
    """
    goals = captioned_goals(dataset, scene.name)
    floors = _floors(scene.navigation)
    things: dict[str, Thing] = {}
    left_out: list[str] = []
    for name, (goal, old, room) in goals.items():
        new = refined.get(goal.object_id)
        captions = old if new is None else new.captions
        points = _joined(list(goal.original_view_points), scene.navigation, floors)
        if new is not None and new.flagged:
            left_out.append(f"{name} is flagged")
        elif not (captions and room):
            left_out.append(f"{name} has no {'room' if captions else 'caption'} in its episodes")
        elif not points:
            left_out.append(f"{name} has no view point that a robot can reach")
        else:
            things[name] = _thing(goal.model_copy(update={"view_points": points}), captions, room)
    first = next(dataset.episodes(scenes=(scene.name,))).record
    return _home(scene, things, left_out, scene_id=first.scene_id, config=first.scene_dataset_config)


def view_point(seen: SeenFrom) -> ViewPoint:
    """The view point, rounded as in the release."""
    x, y, z = (round(value, 5) for value in seen.position)
    _, qy, _, qw = quat_xyzw_from_yaw(seen.yaw)
    state = AgentState(position=(x, y, z), rotation=(0.0, round(qy, 6), 0.0, round(qw, 6)))
    return ViewPoint(agent_state=state, iou=round(seen.visible_share, 5))


def phrase_of(caption: str) -> str:
    """A caption's words as part of a sentence: no article in front, commas for inner periods, none at the end."""
    whole = " ".join(caption.split()).rstrip(" .,;!?")
    text = _ARTICLE.sub("", _NEXT_SENTENCE.sub(lambda found: f", {found[1].lower()}", whole))
    return text if text[:2].isupper() else text[:1].lower() + text[1:]


def _scene_object(item: AnnotatedObject, semantics: Mapping[int, SceneObject], scene: str) -> SceneObject:
    """The object in the semantics, or its box."""
    if item.box is not None:
        return SceneObject(0, f"{item.category}_{item.id}", item.category, item.box.centre, item.box.size)
    if item.id not in semantics:
        raise DatasetError(
            f"annotations of {scene!r}: object {item.id} ({item.category}) has no box, and the scan's semantics no "
            "object with this id; expected one of the two. Give it a box, or put the semantic files beside the scan."
        )
    return semantics[item.id]


def _thing(goal: Goal, captions: Sequence[str], room: str) -> Thing:
    slots = (*captions, *[""] * MOST_CAPTIONS)[:MOST_CAPTIONS]
    return Thing(goal, phrase_of(captions[0]), room, slots)


def _home(scene: Scene, things: dict[str, Thing], left_out: list[str], *, scene_id: str, config: str) -> AnnotatedHome:
    words = Counter(_words(thing) for thing in things.values())
    wrong = _on_wrong_storeys(things)
    for name, thing in things.items():
        if words[_words(thing)] > 1:
            left_out.append(f"{name} has the words of another object")
        elif is_annotator_note(thing.captions[0]):
            left_out.append(f"{name} has a note as its caption")
        elif name in wrong:
            left_out.append(
                f"{name} is said to be on storey {thing.goal.floor_id}, but is on the floor of {wrong[name]}"
            )
        else:
            continue
        things = {other: kept for other, kept in things.items() if other != name}
    numbers = sorted({int(thing.goal.floor_id) for thing in things.values()})
    storeys = {str(number): floor_name(number) for number in numbers}
    return AnnotatedHome(scene.name, scene_id, config, scene.navigation, storeys, things, tuple(left_out))


def _words(thing: Thing) -> tuple[str, str, str]:
    """What a description can say about the thing."""
    return thing.goal.floor_id, normalise_phrase(thing.phrase), normalise_phrase(thing.room)


def _on_wrong_storeys(things: Mapping[str, Thing]) -> dict[str, str]:
    """The right storey of each object whose floor is that of others' storey, by name (DATA_FORMAT.md, row 40)."""
    heights: dict[str, list[float]] = defaultdict(list)
    for thing in things.values():
        heights[thing.goal.floor_id].append(thing.goal.floor_y)
    usual = {floor_id: median(found) for floor_id, found in heights.items()}
    wrong = {}
    for name, thing in things.items():
        floor_y, said = thing.goal.floor_y, thing.goal.floor_id
        nearest = min(usual, key=lambda floor_id: (abs(usual[floor_id] - floor_y), floor_id != said))
        if nearest != said:
            wrong[name] = nearest
    return wrong


def _floors(navigation: NavigationMap) -> Points:
    """(S, 3) one place of each storey, joined to most of its floor; the same ones at every call."""
    found = []
    for height in navigation.storey_heights:
        rng = np.random.default_rng(0)
        places = np.array([navigation.random_point(rng, storey_y=height) for _ in range(_SAMPLES)])
        joined = [np.isfinite(navigation.distances(places, place[None])).sum() for place in places]
        found.append(places[int(np.argmax(joined))])
    return np.array(found).reshape(-1, 3)


def _joined(points: Sequence[ViewPoint], navigation: NavigationMap, floors: Points) -> tuple[ViewPoint, ...]:
    """The view points where a robot can stand, joined to a storey's floor."""
    if not points:
        return ()
    places = np.array([point.agent_state.position for point in points])
    walked = np.isfinite(navigation.distances(places, floors))
    return tuple(
        point
        for point, place, is_joined in zip(points, places, walked, strict=True)
        if is_joined and navigation.is_navigable(place)
    )
