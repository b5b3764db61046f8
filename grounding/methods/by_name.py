"""The grounders known by name. A grounder sees a map, a `Task` and phrases, never an `Episode`."""

from collections.abc import Sequence
from typing import Literal, Protocol, get_args

from sim.errors import AgentError, did_you_mean
from sim.plugins import build_plugin, is_plugin
from sim.types import Task

from ..chat.protocol import Chat
from ..encoders.hashed import HashedWords
from ..encoders.protocol import TextEncoder
from ..maps.home_map import Memory, MemoryKind
from ..types import Grounding
from .baselines import MapCentre, QueryScoring, RandomCell
from .chat_grounders import CHAT_METHODS, ChatGrounder, Seen
from .matching import MATCHERS, OBJECT_MATCHERS, ObjectMatcher, PhraseMatcher

GrounderName = Literal[
    "random",
    "center",
    "qs",
    "rpg",
    "rpg-authors",
    "rpg-literal",
    "phrase",
    "dual",
    "dual-smooth",
    "dual-smooth-point",
    "joint",
    "object-phrase",
    "object-dual",
    "object-list-llm",
    "map-image-vlm",
    "frames-vlm",
]


class Grounder(Protocol):
    """Answers where on a map the query's object is. `grounding.checks.check_grounder` tests a plug-in."""

    @property
    def name(self) -> str:
        """Row name in tables."""
        ...

    @property
    def uses_phrases(self) -> bool:
        """Whether the answer depends on the phrases; printed beside every result."""
        ...

    @property
    def frame(self) -> str:
        """The places among which it chooses; a baseline's figure means nothing without them."""
        ...

    @property
    def takes(self) -> MemoryKind:
        """The kind of map that it answers on; it refuses the other kind."""
        ...

    def ground(self, memory: Memory, task: Task, phrases: Sequence[str]) -> Grounding:
        """Ranked answers; the same inputs give the same answers.

        Args:
            memory: A map of the kind that it takes.
            task: Description and queries; the first query counts.
            phrases: Phrases of the task's description; may be empty.

        Raises:
            AgentError: The map is of the other kind, or was made with another encoder.
        """
        ...


def takes_objects(name: str) -> bool:
    """Whether the method of this name answers on maps of objects, not on grid maps.

    Raises:
        AgentError: No method has this name, or a plug-in cannot be built.
    """
    if name in CHAT_METHODS:
        return CHAT_METHODS[name] == "objects"
    return name in OBJECT_MATCHERS or (is_plugin(name) and make_grounder(name, HashedWords()).takes == "objects")


def require_method(name: str) -> None:
    """Refuses a name that belongs to no method.

    Raises:
        AgentError: The name is neither one of ours nor has the form of a plug-in.
    """
    if name not in get_args(GrounderName) and not is_plugin(name):
        raise AgentError(
            f"--method is {name!r}; expected {', '.join(get_args(GrounderName))}, or your own as "
            f"package.module:factory.{did_you_mean(name, get_args(GrounderName))}"
        )


def make_grounder(
    name: GrounderName | str,
    encoder: TextEncoder,
    *,
    seed: int = 0,
    chat: Chat | None = None,
    seen: Seen | None = None,
) -> Grounder:
    """The grounder of this name with the paper's parameters, or a user's own.

    Args:
        name: A `GrounderName`, or package.module:factory, whose factory gets the encoder.
        encoder: The map's encoder; `random` and `center` do not use it.
        seed: Seed of `random`'s draws.
        chat: The model of CHAT_METHODS; without it they only tell their properties.
        seen: What `map-image-vlm` and `frames-vlm` show beside the map.

    Raises:
        AgentError: No method has this name, or a plug-in cannot be built.
    """
    require_method(name)
    match name:
        case "random":
            return RandomCell(seed=seed)
        case "center":
            return MapCentre()
        case "qs":
            return QueryScoring(encoder)
        case "rpg" | "rpg-authors" | "rpg-literal":
            from .rpg import PRESETS, RegionGated  # torch

            options = {"rpg": PRESETS["paper"], "rpg-authors": PRESETS["authors"], "rpg-literal": PRESETS["literal"]}
            return RegionGated(encoder, options=options[name], name=name)
        case "phrase" | "dual" | "dual-smooth" | "dual-smooth-point":
            return PhraseMatcher(encoder, name=name, options=MATCHERS[name])
        case "joint":
            from .joint import JointMatcher  # scipy

            return JointMatcher(encoder)
        case "object-phrase" | "object-dual":
            return ObjectMatcher(encoder, name=name, temperature=OBJECT_MATCHERS[name])
        case "object-list-llm" | "map-image-vlm" | "frames-vlm":
            return ChatGrounder(encoder, name=name, chat=chat, seen=seen)
        case _:
            return build_plugin(name, encoder, option="--method", methods=("ground",))
