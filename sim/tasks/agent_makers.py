"""Agents for a whole home: how worker processes get the agent of each episode, whatever it is made of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.mesh import Scene
from sim.types import SuccessRule

from .agents import Agent, RandomAgent, ShortestPathAgent, load_agent


class AgentMaker(Protocol):
    """Makes the agents of a home's episodes. Jobs carry it to worker processes: small, picklable and comparable."""

    looks: ClassVar[bool]
    """Whether the agents need pictures."""

    def open(self, dataset: PersonalDataset, scene: Scene) -> Callable[[Episode], Agent]:
        """A function that gives an episode's agent; called once per home and process.

        It gets ground truth, which it may use for what an agent sees with, never for where it goes.

        Raises:
            AgentError: The agent cannot be built.
        """
        ...


@dataclass(frozen=True, slots=True)
class MakesRandom:
    """Makes agent `random`."""

    looks: ClassVar[bool] = False

    def open(self, dataset: PersonalDataset, scene: Scene) -> Callable[[Episode], Agent]:
        """A new agent for each episode."""
        return lambda episode: RandomAgent()


@dataclass(frozen=True, slots=True)
class MakesShortestPath:
    """Makes agent `shortest-path`, which alone knows the goal."""

    rule: SuccessRule = "paper"
    """The success rule that it walks for."""
    looks: ClassVar[bool] = False

    def open(self, dataset: PersonalDataset, scene: Scene) -> Callable[[Episode], Agent]:
        """A new agent for each episode, with its targets."""
        return lambda episode: ShortestPathAgent(episode, scene.navigation, rule=self.rule)


@dataclass(frozen=True, slots=True)
class MakesPlugin:
    """Makes a user's own agent."""

    name: str
    """`package.module:factory`."""
    looks: ClassVar[bool] = True

    def open(self, dataset: PersonalDataset, scene: Scene) -> Callable[[Episode], Agent]:
        """One agent for all episodes of the home, reset for each.

        Raises:
            AgentError: The plug-in cannot be built.
        """
        agent = load_agent(self.name)
        return lambda episode: agent
