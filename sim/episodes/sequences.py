"""Home sequences: messages that change who owns what, and several searches in one home (docs/home-sequences.md).

The format is ours, not the PersONAL authors'. A record that contradicts itself is refused when it is made.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, BaseModel, Field, model_validator

from sim.types import Split

from .schema import NAME_PATTERN, STRICT_SHAPE, Metres, Place, QuatXyzw, require_scene_name

MessageKind = Literal["intro", "transfer", "swap", "share", "unshare", "lend", "leave", "correction"]
SubtaskKind = Literal["fresh", "revisit", "changed", "stale"]
_MOVES = "one object that goes from one person to another"
_SHAPES: dict[MessageKind, str] = {
    "intro": "edges to add and none to remove",
    "transfer": _MOVES,
    "swap": "two objects that two people exchange",
    "share": "one edge to add",
    "unshare": "one edge to remove",
    "lend": _MOVES,
    "leave": "all edges of one person to remove",
    "correction": _MOVES,
}
"""What a message of each kind adds and removes."""


class Edge(NamedTuple):
    """One person owns one object."""

    owner: str
    object_name: str


class Message(BaseModel):
    """What people are told before a search; ground truth except for its text."""

    model_config = STRICT_SHAPE
    before: int = Field(ge=0)
    """Index of the subtask that it precedes."""
    kind: MessageKind
    text: str = Field(min_length=1, pattern=r"\S")
    adds: tuple[Edge, ...] = ()
    removes: tuple[Edge, ...] = ()
    until: int | None = None
    """Index of the subtask before which a lent object is given back; None for other kinds."""
    extracted_summary: tuple[str, ...] = ()
    """Of an `intro`: ownership sentences as in episodes; they may tell of more than its edges."""


class SubtaskInfo(BaseModel):
    """Distances that the generator stored (metres)."""

    model_config = STRICT_SHAPE
    geodesic_distance: Metres
    """From the sequence's start to view_points[0] of the nearest right object."""
    previous_geodesic: Metres | None = None
    """From the right object of the search before; None for the first search."""
    euclidean_distance: Metres | None = None
    """Planar, from the start to the object's centre; of searches that come from an episode."""
    closest_goal_object_id: int | None = None


class Subtask(BaseModel):
    """One search."""

    model_config = STRICT_SHAPE
    query: tuple[Annotated[str, Field(min_length=1, pattern=r"\S")], ...] = Field(min_length=1)
    """Equivalent paraphrases."""
    owner: str = Field(min_length=1)
    object_category: str = Field(min_length=1)
    object_id: str | tuple[str, ...]
    """Names of the right objects: one, or several equally right ones."""
    mode: Literal["any", "all"] = "any"
    """Whether one of the right objects is enough."""
    kind: SubtaskKind
    old_object_id: str | None = None
    """The object that would have been right before `message`; the trap of `changed` and `stale`."""
    message: int = Field(ge=0)
    """Index of the message that decides the answer."""
    captions: tuple[str, ...] | tuple[tuple[str, ...], ...] = Field(default=(), alias="description")
    """As in `EpisodeRecord`."""
    info: SubtaskInfo

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of the right objects, a tuple even for one object."""
        return (self.object_id,) if isinstance(self.object_id, str) else self.object_id


class Generator(BaseModel):
    """What made a sequence."""

    model_config = STRICT_SHAPE
    seed: int | None = None
    version: int | None = None


class SequenceRecord(BaseModel):
    """One entry of `sequences` in a content file."""

    model_config = STRICT_SHAPE
    sequence_id: str = Field(pattern=NAME_PATTERN)
    split: Split
    """The split whose rule of ownership holds after each message."""
    scene_id: Annotated[str, AfterValidator(require_scene_name)]
    scene_dataset_config: str
    floor_id: str
    start_position: Place
    start_rotation: QuatXyzw
    messages: tuple[Message, ...] = Field(min_length=1)
    subtasks: tuple[Subtask, ...] = Field(min_length=1)
    sources: tuple[str, ...] = ()
    """Episodes from which texts or objects come, such as hard/TEEsavR23oF/240."""
    generator: Generator = Generator()

    @model_validator(mode="after")
    def _tells_one_story(self) -> Self:
        problem = _broken_shape(self.messages, len(self.subtasks))
        if problem:
            raise ValueError(problem)
        states = ownership_over_time(self.messages, len(self.subtasks))
        asked: dict[tuple[str, frozenset[str]], int] = {}
        for index, (subtask, edges) in enumerate(zip(self.subtasks, states, strict=True)):
            if subtask.message >= len(self.messages) or self.messages[subtask.message].before > index:
                raise ValueError(f"subtasks[{index}].message {subtask.message}: no message before this subtask")
            right = {Edge(subtask.owner, name) for name in subtask.object_names}
            if not right <= edges.keys():
                raise ValueError(f"subtasks[{index}]: {subtask.owner} does not own {sorted(subtask.object_names)} then")
            search = subtask.owner, frozenset(subtask.object_names)
            decided = max(edges[edge] for edge in right)
            problem = _broken_kind(subtask, self.messages, decided=decided, was_asked=asked.get(search) == decided)
            if problem:
                raise ValueError(f"subtasks[{index}] is {subtask.kind!r}: {problem}")
            asked[search] = decided
        return self


def ownership_over_time(messages: Sequence[Message], num_subtasks: int) -> tuple[Mapping[Edge, int], ...]:
    """At each subtask, who owns what, and the index of the message that said so.

    What was lent goes back before the subtask `until`, and before the messages that precede it.

    Raises:
        ValueError: A message adds an edge that holds already, or removes one that does not hold.
    """
    edges: dict[Edge, int] = {}
    states = []
    for subtask in range(num_subtasks):
        for index, message in enumerate(messages):
            if message.until == subtask:
                _change(edges, index, adds=message.removes, removes=message.adds)
        for index, message in enumerate(messages):
            if message.before == subtask:
                _change(edges, index, adds=message.adds, removes=message.removes)
                problem = _broken_end(message, edges)
                if problem:
                    raise ValueError(f"messages[{index}] is {message.kind!r}: {problem}")
        states.append(MappingProxyType(dict(edges)))
    return tuple(states)


def _change(edges: dict[Edge, int], index: int, *, adds: Iterable[Edge], removes: Iterable[Edge]) -> None:
    """Takes edges away and adds others, as message `index` says."""
    for edge in removes:
        if edges.pop(edge, None) is None:
            raise ValueError(f"messages[{index}]: {edge.owner} does not own {edge.object_name!r} then")
    for edge in adds:
        if edges.setdefault(edge, index) != index:
            raise ValueError(f"messages[{index}]: {edge.owner} owns {edge.object_name!r} already")


def _broken_shape(messages: Sequence[Message], num_subtasks: int) -> str | None:
    """Why the messages cannot be told in this order; None where they can."""
    kinds = [message.kind for message in messages]
    if kinds[0] != "intro" or messages[0].before != 0 or kinds.count("intro") != 1:
        return "messages: expected one intro, first of all and before subtask 0"
    befores = [message.before for message in messages]
    if befores != sorted(befores) or befores[-1] >= num_subtasks:
        return f"messages: before is {befores}; expected rising indices of the {num_subtasks} subtasks"
    for index, message in enumerate(messages):
        if (message.until is not None) != (message.kind == "lend"):
            return f"messages[{index}].until is {message.until}; expected an index for lend, and null for other kinds"
        if message.until is not None and message.until <= message.before:
            return f"messages[{index}].until is {message.until}; expected a subtask after {message.before}"
        if not _has_shape(message):
            return f"messages[{index}] is {message.kind!r}; expected {_SHAPES[message.kind]}"
    return None


def _has_shape(message: Message) -> bool:
    """Whether a message adds and removes what its kind says, as far as it tells without the state before it."""
    before, after = set(message.removes), set(message.adds)
    owners, objects = {edge.owner for edge in before}, {edge.object_name for edge in before}
    match message.kind:
        case "intro":
            return bool(after) and not before
        case "share":
            return len(after) == 1 and not before
        case "unshare":
            return len(before) == 1 and not after
        case "leave":
            return len(owners) == 1 and not after
        case "swap":
            exchanged = {Edge(owner, name) for owner in owners for name in objects} - before
            return len(before) == len(owners) == len(objects) == 2 and after == exchanged
        case _:
            return (
                len(before) == len(after) == 1 and objects == {edge.object_name for edge in after} and before != after
            )


def _broken_end(message: Message, edges: Mapping[Edge, int]) -> str | None:
    """Why a message does not fit the ownership after it; None where it does."""
    owned = Counter(edge.object_name for edge in edges)
    match message.kind:
        case "share" if owned[message.adds[0].object_name] < 2:
            return f"{message.adds[0].object_name!r} has no other owner to share it with"
        case "unshare" if not owned[message.removes[0].object_name]:
            return f"{message.removes[0].object_name!r} has no owner after it"
        case "leave" if any(edge.owner == message.removes[0].owner for edge in edges):
            return f"{message.removes[0].owner} still owns something after it"
        case _:
            return None


def _broken_kind(subtask: Subtask, messages: Sequence[Message], *, decided: int, was_asked: bool) -> str | None:
    """Why a search is not of its kind; None where it is.

    Args:
        subtask: The search.
        messages: All messages of the sequence.
        decided: The message that said last that the owner has the right objects.
        was_asked: Whether a search after that message asked the same.
    """
    old = subtask.old_object_id
    gave_away = old is not None and Edge(subtask.owner, old) in messages[subtask.message].removes
    if old is not None and not gave_away:
        return f"messages[{subtask.message}] does not take {old!r} from {subtask.owner}"
    if subtask.kind == "stale":
        return None if gave_away else "old_object_id is null; expected the object that the owner gave away"
    if decided != subtask.message:
        return f"message is {subtask.message}; expected {decided}, which says that {subtask.owner} owns it"
    kind = "revisit" if was_asked else "changed" if decided else "fresh"
    if subtask.kind != kind:
        return f"expected {kind!r}: messages[{decided}] decides it, and {'some' if was_asked else 'no'}body asked since"
    return None if kind == "changed" or old is None else f"old_object_id is {old!r}; expected null"
