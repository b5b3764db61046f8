"""The released episode files as pydantic models, and `Episode`, an episode with its targets resolved.

Unions and nulls are those measured in DATA_FORMAT.md. The dataset's `description` is the target's caption: it is
called `captions` here, is ground truth and never leaves `Episode`; `summary` becomes `Task.description`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, AllowInfNan, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from sim.errors import short
from sim.frames import yaw_from_quat_xyzw
from sim.types import PAPER6, Action, EpisodeKey, Pose, Split, Task, TaskKind

NAME_PATTERN = r"^[A-Za-z0-9_-]{1,64}$"
"""Characters that a scene's name or an episode's id may have in run files."""
LARGEST_M = 10_000.0
"""Largest coordinate or distance in a home, metres."""
_UNIT_TOLERANCE = 1e-3

Finite = Annotated[float, AllowInfNan(False)]
Metres = Annotated[float, AllowInfNan(False), Field(ge=-LARGEST_M, le=LARGEST_M)]
Vector3 = tuple[Finite, Finite, Finite]
"""Any vector, for other modules."""
Place = tuple[Metres, Metres, Metres]
"""A point of a home, world metres."""


def scene_name_from_id(scene_id: str) -> str:
    """The scene's name: `TEEsavR23oF` from `hm3d_v0.2/val/00800-TEEsavR23oF/TEEsavR23oF.basis.glb`."""
    return scene_id.rsplit("/", 1)[-1].split(".", 1)[0]


def scan_suffix_from_id(scene_id: str) -> str:
    """`.basis.glb`, or the suffix of another scan's file."""
    return scene_id.rsplit("/", 1)[-1].removeprefix(scene_name_from_id(scene_id))


def _require_unit(quat_xyzw: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    norm = math.hypot(*quat_xyzw)
    if abs(norm - 1) > _UNIT_TOLERANCE:
        raise PydanticCustomError(
            "unit_quaternion", "a unit quaternion [x, y, z, w]; its norm is {norm}, not 1", {"norm": f"{norm:.4g}"}
        )
    return quat_xyzw


def require_scene_name(scene_id: str) -> str:
    """The id; raises where it does not lead to a file that is named after a scene."""
    name = scene_name_from_id(scene_id)
    if not re.fullmatch(NAME_PATTERN, name):
        raise PydanticCustomError("scene_name", "a path to <SceneName>.glb, the name of 1-64 letters, digits, _ or -")
    return scene_id


QuatXyzw = Annotated[tuple[Finite, Finite, Finite, Finite], AfterValidator(_require_unit)]
STRICT_SHAPE = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)
"""Of everything in a content file."""


class AgentState(BaseModel):
    """A place to stand, world frame."""

    model_config = STRICT_SHAPE
    position: Place
    """Feet, metres."""
    rotation: QuatXyzw
    """Unit quaternion [x, y, z, w]."""


class ViewPoint(BaseModel):
    """A place near a goal: one that sees it (original), or one that the generator added (extra, no `iou`)."""

    model_config = STRICT_SHAPE
    agent_state: AgentState
    iou: Finite | None = None
    """Coverage score of GOAT, up to 2.94 in the release; absent on extra points."""


class Goal(BaseModel):
    """One object instance of a scene, with the places around it."""

    model_config = STRICT_SHAPE
    position: Place
    """Centre of the object's box, metres."""
    object_id: int
    object_name: str = Field(min_length=1)
    """`<raw name>_<int>`: the key that episodes use."""
    object_category: str = Field(min_length=1)
    floor_id: str
    """The annotator's label, kept as text; our storeys are computed from heights."""
    view_points: tuple[ViewPoint, ...]
    radius: Finite | None = None
    object_name_id: int | None = None
    room_id: int | str | None = None
    room_name: str | None = None

    @property
    def original_view_points(self) -> tuple[ViewPoint, ...]:
        """View points with an `iou`; the only ones that the rules `paper` and `habitat` use."""
        return tuple(point for point in self.view_points if point.iou is not None)

    @property
    def floor_y(self) -> float:
        """Height of the floor the object belongs to: the median of its original view points.

        An object without original view points (window shutter_259) gets the height of the highest view point that is
        not above its centre, because extra points lie on several storeys.
        """
        originals = sorted(point.agent_state.position[1] for point in self.original_view_points)
        if originals:
            return originals[len(originals) // 2]
        below = [y for y in (point.agent_state.position[1] for point in self.view_points) if y <= self.position[1]]
        return max(below, default=self.position[1])


class EpisodeInfo(BaseModel):
    """Distances that the generator stored. We recompute them (DESIGN.md); these are a named alternative only."""

    model_config = STRICT_SHAPE
    geodesic_distance: Metres
    """Metres from the start to view_points[0] of the target."""
    euclidean_distance: Metres
    """Planar metres from the start to the target's centre."""
    closest_goal_object_id: int


class EpisodeRecord(BaseModel):
    """One entry of `episodes` in a content file, as released."""

    model_config = STRICT_SHAPE
    episode_id: str = Field(pattern=NAME_PATTERN)
    scene_id: Annotated[str, AfterValidator(require_scene_name)]
    scene_dataset_config: str
    object_category: str = Field(min_length=1)
    object_id: str | tuple[str, ...]
    """One object name, or several names of equally right objects ("one of X's Ys")."""
    captions: tuple[str, ...] | tuple[tuple[str, ...], ...] = Field(alias="description")
    """Three caption slots, or one such triple per instance; ground truth."""
    owner: str = Field(min_length=1)
    floor_id: str
    summary: str = Field(min_length=1)
    extracted_summary: tuple[str, ...]
    """One ownership sentence per edge; ground truth for people and for PAN agents."""
    query: tuple[Annotated[str, Field(min_length=1, pattern=r"\S")], ...] = Field(min_length=1)
    """Equivalent paraphrases."""
    start_position: Place
    start_rotation: QuatXyzw
    info: EpisodeInfo
    goals: tuple[Any, ...] = ()
    additional_obj_config_paths: tuple[Any, ...] = ()
    start_room: Any = None
    shortest_paths: Any = None

    @property
    def scan_suffix(self) -> str:
        """`.basis.glb`, or the suffix of another scan's file."""
        return scan_suffix_from_id(self.scene_id)

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the right objects, a tuple even for one object."""
        return (self.object_id,) if isinstance(self.object_id, str) else self.object_id

    @property
    def captions_per_object(self) -> tuple[tuple[str, ...], ...]:
        """The filled caption slots of each of `object_names`."""
        flat = tuple(slot for slot in self.captions if isinstance(slot, str))
        nested = tuple(slots for slots in self.captions if not isinstance(slots, str)) or (flat,)
        return tuple(tuple(text for text in slots if text) for slots in nested)

    @model_validator(mode="after")
    def _one_caption_list_per_object(self) -> "EpisodeRecord":
        if len(self.captions_per_object) != len(self.object_names):
            raise ValueError(f"description for {len(self.object_names)} objects, found {len(self.captions_per_object)}")
        return self


class SceneFile(BaseModel):
    """One content file `<split>/content/<SceneName>.json.gz`."""

    model_config = STRICT_SHAPE
    goals_by_category: dict[str, tuple[Goal, ...]]
    """`goals_key` of each category to all goal objects of that category in the scene."""
    episodes: tuple[EpisodeRecord, ...]
    category_to_task_category_id: dict[str, int]
    category_to_scene_annotation_category_id: dict[str, int]


@dataclass(frozen=True, slots=True)
class Episode:
    """An episode with its targets; holds ground truth, so it never reaches an agent, a browser or a prompt."""

    key: EpisodeKey
    record: EpisodeRecord
    targets: tuple[Goal, ...]
    """The right objects, found by exact `object_name`."""

    @property
    def start(self) -> Pose:
        """Start pose, world frame."""
        return Pose(self.record.start_position, yaw_from_quat_xyzw(self.record.start_rotation))

    def task(self, kind: TaskKind, *, query_index: int = 0, actions: tuple[Action, ...] = PAPER6) -> Task:
        """The part of this episode that an agent or a participant may see."""
        return Task(kind, self.record.summary, (self.record.query[query_index],), actions=actions)


def goals_key(scene: str, category: str, *, suffix: str = ".basis.glb") -> str:
    """Habitat's key of `goals_by_category`: the file name of the scan, which ends in `suffix`, and a category."""
    return f"{scene}{suffix}_{category}"


def goals_of(
    scene: str, category: str, goals_by_category: Mapping[str, tuple[Goal, ...]], *, suffix: str
) -> tuple[Goal, ...] | None:
    """All goals of a category; None without its key, by the scan's file name (it ends in `suffix`) or the release's."""
    for ending in (suffix, ".basis.glb"):
        goals = goals_by_category.get(goals_key(scene, category, suffix=ending))
        if goals is not None:
            return goals
    return None


def resolve_goals(
    scene: str,
    category: str,
    names: Sequence[str],
    goals_by_category: Mapping[str, tuple[Goal, ...]],
    *,
    suffix: str,
) -> tuple[Goal, ...]:
    """The goals with these names.

    Raises:
        KeyError: The goal list is missing or a name does not resolve exactly once; args[0] says which one.
    """
    key = goals_key(scene, category, suffix=suffix)
    goals = goals_of(scene, category, goals_by_category, suffix=suffix)
    if goals is None:
        raise KeyError(f"goals_by_category has no key {short(key, most=80)}")
    targets = tuple(goal for name in names for goal in goals if goal.object_name == name)
    if [goal.object_name for goal in targets] != list(names):
        found = [goal.object_name for goal in targets]
        raise KeyError(
            f"object_id {short(list(names), most=80)} resolves to {short(found, most=80)} in {short(key, most=80)}, "
            "expected each once"
        )
    return targets


def resolve_episode(split: Split, scene: str, record: EpisodeRecord, content: SceneFile) -> Episode:
    """The episode with its targets.

    Raises:
        KeyError: As `resolve_goals`.
    """
    targets = resolve_goals(
        scene, record.object_category, record.object_names, content.goals_by_category, suffix=record.scan_suffix
    )
    return Episode(EpisodeKey(split, scene, record.episode_id), record, targets)
