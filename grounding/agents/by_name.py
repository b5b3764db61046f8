"""The agents that see, known by name: each gets its perception and the text to look for, episode by episode."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.tasks.agents import Agent
from sim.tasks.looks import LookKind
from sim.types import Task

from ..chat.budget import Budget
from ..chat.endpoint import Endpoint, LlmOptions
from ..chat.transcript import RecordedChat
from ..encoders.protocol import ModelOptions
from ..phrases.rules import RulePhrases
from .goal_text import GoalText, goal_text

if TYPE_CHECKING:
    from ..perception.protocol import Perception

SeeingName = Literal[
    "vlfm", "onemap", "vlfm-geometry", "frontier-vlm", "frontier-geometry", "nearest-frontier", "instance-memory"
]
CONTROLS: dict[SeeingName, SeeingName] = {"frontier-vlm": "frontier-geometry"}
"""Agents that are always run beside another one on the same episodes."""
SEEING: tuple[SeeingName, ...] = get_args(SeeingName)


@dataclass(frozen=True, slots=True)
class MakesSeeing:
    """Makes agents that see with a named perception and look for a text."""

    name: SeeingName
    perception: str
    """As `grounding.perception.by_name` says."""
    goal_text: GoalText = "phrase"
    model: ModelOptions = field(default_factory=ModelOptions)
    """How real models run."""
    seed: int = 0
    """Of the errors of oracle perception."""
    llm: LlmOptions | None = None
    """The chat model of frontier-vlm."""
    budget: Budget | None = None
    """Its limits, and the run folder that counts; None = neither."""
    looks: ClassVar[bool] = True

    def open(self, dataset: PersonalDataset, scene: Scene) -> Callable[[Episode], Agent]:
        """A new agent for each episode; models are loaded once per process.

        An agent that goes on with the next search of a home sequence gets the text of the episode made for that search.

        Raises:
            AgentError: The perception is unknown or cannot be loaded.
            MissingDependencyError: The extra of a model is not installed.
        """
        perception_of = self._perception(dataset, scene)
        phrases = RulePhrases()
        chat = self._chat() if self.name == "frontier-vlm" else None
        texts: dict[str, Callable[[Task], str]] = {}

        def agent_of(episode: Episode) -> Agent:
            own = goal_text(self.goal_text, episode, phrases)
            texts.update(dict.fromkeys(episode.record.query, own))
            return _agent(
                self.name,
                perception_of(episode),
                text_of=lambda task: texts.get(task.queries[0], own)(task),
                phrases=phrases,
                chat=chat,
            )

        return agent_of

    def _chat(self) -> RecordedChat:
        assert self.llm is not None, "frontier-vlm without a chat model"
        return RecordedChat(Endpoint(self.llm, budget=self.budget))

    def _perception(self, dataset: PersonalDataset, scene: Scene) -> Callable[[Episode], "Perception"]:
        from ..maps.oracle_map import object_texts
        from ..perception.by_name import EpisodeTruth, is_oracle, make_perception

        if not is_oracle(self.perception):
            models = _models(self.perception, self.model)
            return lambda episode: models
        captions = object_texts(dataset, scene)
        return lambda episode: make_perception(
            self.perception, truth=EpisodeTruth(scene, episode.start, captions), options=self.model, seed=self.seed
        )


def _agent(
    name: SeeingName, perception: "Perception", *, text_of: Callable, phrases: RulePhrases, chat: RecordedChat | None
) -> Agent:
    if name in ("vlfm", "vlfm-geometry"):
        from .vlfm.agent import VlfmAgent

        return VlfmAgent(perception, text_of, values="pictures" if name == "vlfm" else "distance")
    if name == "onemap":
        from .onemap.agent import OneMapAgent

        return OneMapAgent(perception, text_of)
    if name == "instance-memory":
        from .instance_memory import InstanceMemoryAgent

        return InstanceMemoryAgent(perception, text_of, phrases)
    if chat is not None:
        from .frontier_vlm.transcribed import TranscribedAgent

        return TranscribedAgent(perception, text_of, chat)
    from .frontier_vlm.agent import JudgedFrontierAgent
    from .frontier_vlm.choices import GeometryJudge

    rule = "nearest" if name == "nearest-frontier" else "distance-weighted"
    return JudgedFrontierAgent(perception, text_of, judge=lambda: GeometryJudge(rule))


def looks_of(name: SeeingName) -> frozenset[LookKind]:
    """The looks at a home that the agent can take before the task."""
    if name != "onemap":
        return frozenset()
    from .onemap.agent import OneMapAgent

    return OneMapAgent.looks


@lru_cache(maxsize=1)
def _models(name: str, options: ModelOptions) -> "Perception":
    from ..perception.by_name import make_perception

    return make_perception(name, options=options)
