"""Checks that targets can be found: that the description tells an episode's target from similar objects.

Episode + plan + scene -> `FindVerdict`. A difference counts only where our home shows it; words that are not true
in the plan do not count.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.frames import T_world_camera, yaw_towards
from sim.homes.plan import Furniture, HomePlan
from sim.mesh import Scene
from sim.render.raycast import Raycaster
from sim.render.renderer import Renderer
from sim.types import TURN_STEP, Camera, EpisodeKey, Pose
from sim.walk.viewpoints import view_points_around

from ..episodes.described import described_object
from ..episodes.schema import Episode, Goal
from .cues import cues, storey_of_piece

MIN_PIXELS = 150
"""An object with fewer pixels in the best 640 x 480 view is hardly visible (12 by 12 pixels)."""
_LOOK = Camera(160, 120)
"""Camera for choosing the best view point."""
_SEEN_BESIDE = 4
"""Pixels of _LOOK that a thing beside the target needs to be noticed."""
_MAX_PLACES = 32
"""Most view points that are tried, those with the best coverage first."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The look of an object from the best of its view points."""

    pixels: int
    """Pixels of a 640 x 480 picture."""
    position: tuple[float, float, float] | None
    """Feet of the robot at the view point; None where no place sees the object."""
    beside: frozenset[int]
    """Instance ids of other things in any view of the object."""


@dataclass(frozen=True, slots=True)
class FindVerdict:
    """Whether an episode's target can be found by reading and looking."""

    key: EpisodeKey
    target: str
    """`object_name` of the judged right object; of several, the one that is easiest to find."""
    pixels: int
    """Pixels that show the target from its best view point, at 640 x 480."""
    cues: tuple[tuple[str, str], ...]
    """(name, difference from the target) for each distinguishable object of the same category on the storey."""
    alike: tuple[str, ...]
    """Names of the objects of the category that cannot be distinguished from the target."""

    @property
    def findable(self) -> bool:
        """Whether the target is visible and distinguishable from every other object of its category."""
        return self.pixels >= MIN_PIXELS and not self.alike

    @property
    def reason(self) -> str:
        """The reason why the target is not findable, in one line; empty where it is findable."""
        if self.pixels < MIN_PIXELS:
            return f"{self.target} has {self.pixels} pixels at its best view point"
        return f"{self.target} cannot be told from {', '.join(self.alike)}" if self.alike else ""


def find_verdicts(
    episodes: Sequence[Episode], plan: HomePlan, scene: Scene, *, renderer: Renderer
) -> tuple[FindVerdict, ...]:
    """The verdict on each of a scene's episodes, in order; the scene is made from the plan."""
    sights: dict[str, Sight] = {}
    for goal in (goal for episode in episodes for goal in episode.targets):
        if goal.object_name not in sights:
            sights[goal.object_name] = best_sight(goal, scene, renderer=renderer)
    return tuple(find_verdict(episode, plan, scene, sights=sights) for episode in episodes)


def find_verdict(episode: Episode, plan: HomePlan, scene: Scene, *, sights: Mapping[str, Sight]) -> FindVerdict:
    """The verdict on one episode; of several right objects the one that is easiest to find is judged.

    The scene is made from the plan; `sights` holds those of the episode's targets by `object_name`.
    """
    verdicts = [_verdict(episode, goal, plan, scene, sights[goal.object_name]) for goal in episode.targets]
    return min(verdicts, key=lambda verdict: (not verdict.findable, len(verdict.alike), -verdict.pixels))


class Finder:
    """Judges whether objects of one home can be found; each object is looked at once."""

    def __init__(self, plan: HomePlan, scene: Scene) -> None:
        """Keeps the home; the scene is made from the plan."""
        self._plan, self._scene = plan, scene
        self._renderer = Raycaster(scene.mesh)
        self._sights: dict[str, Sight] = {}

    def is_visible(self, goal: Goal) -> bool:
        """Whether the object has enough pixels at its best view point."""
        if goal.object_name not in self._sights:
            self._sights[goal.object_name] = best_sight(goal, self._scene, renderer=self._renderer)
        return self._sights[goal.object_name].pixels >= MIN_PIXELS

    def can_find(self, episode: Episode) -> bool:
        """Whether each right object of an episode can be found by reading and looking."""
        return all(
            self.is_visible(goal)
            and find_verdict(replace(episode, targets=(goal,)), self._plan, self._scene, sights=self._sights).findable
            for goal in episode.targets
        )


def best_sight(goal: Goal, scene: Scene, *, renderer: Renderer) -> Sight:
    """The object's look from the best of its standable original view points, or else of places found around it."""
    item = next((item for item in scene.objects if item.name == goal.object_name), None)
    if item is None:
        return Sight(0, None, frozenset())
    points = sorted(goal.original_view_points, key=lambda point: -(point.iou or 0.0))
    places = [point.agent_state.position for point in points]
    places = [place for place in places if scene.navigation.is_navigable(np.array(place))][:_MAX_PLACES]
    if not places:
        around = view_points_around(item, scene.mesh, navigation=scene.navigation, renderer=renderer)
        places = [seen.position for seen in around[:_MAX_PLACES]]
    if not places:
        return Sight(0, None, frozenset())
    poses = [pose_towards(place, item.centre) for place in places]
    frames = renderer.render_batch(np.stack([T_world_camera(pose, _LOOK) for pose in poses]), _LOOK)
    counts = [np.bincount(frame.instance_ids.ravel(), minlength=item.instance_id + 1) for frame in frames]
    best = int(np.argmax([count[item.instance_id] for count in counts]))
    noticed = [np.flatnonzero(count >= _SEEN_BESIDE) for count in counts if count[item.instance_id] >= _SEEN_BESIDE]
    whole = renderer.render(T_world_camera(poses[best], Camera()), Camera())
    pixels = int((whole.instance_ids == item.instance_id).sum())
    if not pixels:
        return Sight(0, None, frozenset())
    return Sight(pixels, places[best], frozenset(np.concatenate([[0], *noticed]).astype(int).tolist()) - {0})


def pose_towards(position: tuple[float, float, float], centre: tuple[float, float, float]) -> Pose:
    """A robot at `position` that looks at `centre`, with one look up or down where that brings it into the picture."""
    away = math.hypot(centre[0] - position[0], centre[2] - position[2])
    rise = math.atan2(centre[1] - position[1] - Camera().mount_height, away)
    half = math.atan(Camera().height / 2 / Camera().focal)
    tilt = 0.0 if abs(rise) <= half else math.copysign(TURN_STEP, rise)
    return Pose(position, yaw_towards((position[0], position[2]), (centre[0], centre[2])), tilt)


def _verdict(episode: Episode, goal: Goal, plan: HomePlan, scene: Scene, sight: Sight) -> FindVerdict:
    pieces = {piece.name: piece for piece in plan.furniture}
    target = pieces.get(goal.object_name)
    if target is None:
        return FindVerdict(episode.key, goal.object_name, 0, (), ())
    storey = storey_of_piece(target, plan)
    like = [
        piece
        for piece in plan.furniture
        if piece.category == target.category
        and piece.name not in episode.record.object_names
        and storey_of_piece(piece, plan) == storey
    ]
    ids = {item.instance_id: item.name for item in scene.objects}
    noticed = [pieces[ids[instance]] for instance in sorted(sight.beside) if ids.get(instance) in pieces]
    captions = dict(zip(episode.record.object_names, episode.record.captions_per_object, strict=True))
    caption = " . ".join(captions[goal.object_name])
    said = described_object(episode.record, caption=caption, category=target.category, owner=episode.record.owner)
    told: list[tuple[str, str]] = []
    alike: list[str] = []
    for other in like:
        cue = next(cues(said, target, other, plan, noticed), None) or _exclusion(episode, target, other, plan)
        if cue is None:
            alike.append(other.name)
        else:
            told.append((other.name, cue))
    return FindVerdict(episode.key, target.name, sight.pixels, tuple(told), tuple(alike))


def _exclusion(episode: Episode, target: Furniture, other: Furniture, plan: HomePlan) -> str | None:
    """The description's words about the other object that only it shows: somebody else's red chair."""
    if not other.caption:
        return None
    said = described_object(episode.record, caption=other.caption, category=other.category, owner=None)
    cue = next(cues(said, other, target, plan, plan.furniture), None)
    return cue and f"the other's {cue}"
