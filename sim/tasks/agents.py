"""The agent protocol, and the agents that need no perception: random, and shortest path (ground truth)."""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Episode
from sim.errors import AgentError
from sim.frames import T_world_agent, forward_from_yaw, wrap_angle
from sim.plugins import build_plugin, call_plugin, is_plugin
from sim.types import FORWARD_STEP, TURN_STEP, Action, Camera, Observation, SuccessRule, Task
from sim.walk.navigation_map import NavigationMap

from .rules import reaches_goal, success_region

TURN_COST = 0.02
"""Metres of detour that the shortest-path agent accepts to save one turn; keeps it from weaving."""
MIN_PROGRESS = 0.03
"""The agent takes no steps that bring it less than this much nearer to the goal, metres."""
LOOKAHEAD = 4
"""Forwards that the agent tries in a row before it gives up: without sliding, its 12 headings catch on corners, and a
step back or aside leads around them."""
NEAR = 0.1
"""Places where STOP succeeds are at most this far (metres) from the region's points, which are 5 cm apart."""
SAME_PLACE = 0.05
"""Only one of two places closer than this (metres) is tried."""
_TURNS = sorted(range(-5, 7), key=abs)
"""Every heading, the least turning first; positive is left."""


class Agent(Protocol):
    """An agent gets the task once and then returns one action per observation."""

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Starts a new episode; `keep_memory` says that the home is the same as in the last one."""
        ...

    def act(self, observation: Observation) -> Action:
        """The next action."""
        ...


def next_action(agent: Agent, task: Task, observation: Observation) -> Action:
    """The agent's answer to an observation.

    Raises:
        AgentError: It raised, or returned something that is not one of the task's actions.
    """
    action = call_plugin("agent", agent.act, observation)
    if isinstance(action, Action) and action in task.actions:
        return action
    kind = "" if isinstance(action, Action) else f" of type {type(action).__name__}"
    raise AgentError(
        f"act() returned {action!r}{kind}; expected an Action of {[item.value for item in task.actions]}. "
        "Correct the agent."
    )


class RandomAgent:
    """Uniform over the task's actions, STOP included."""

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Seeds the draw."""
        self._actions = task.actions
        self._rng = np.random.default_rng(seed)

    def act(self, observation: Observation) -> Action:
        """One draw."""
        return self._actions[int(self._rng.integers(len(self._actions)))]


class _Way(NamedTuple):
    """A sequence of actions and its result."""

    position: tuple[float, float, float]
    yaw: float
    actions: tuple[Action, ...]


class ShortestPathAgent:
    """Walks down the distance to where STOP succeeds: an upper bound with ground truth, not a competitor."""

    def __init__(self, episode: Episode, navigation: NavigationMap, *, rule: SuccessRule = "paper") -> None:
        """Takes the ground truth that other agents do not get.

        Args:
            episode: Gives the targets and the true start, which turns the observation's start frame into the world.
            navigation: The same map that the environment uses.
            rule: Decides the goal: `paper` = the region around a target, `habitat` = a view point.
        """
        self._T_world_start = T_world_agent(episode.start)
        self._start_yaw = episode.start.yaw
        self._episode = episode
        self._rule: SuccessRule = rule
        self._region = success_region(episode, navigation, rule=rule)
        self._navigation = navigation

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Forgets its planned actions."""
        self._camera = camera
        self._planned: list[Action] = []

    def act(self, observation: Observation) -> Action:
        """The next turn or forward towards the goal; STOP where it succeeds, or when no sequence found leads nearer."""
        if not self._planned:
            self._planned = self._plan(observation)
        return self._planned.pop(0)

    def _plan(self, observation: Observation) -> list[Action]:
        """The shortest sequence of actions with progress; among equally many forwards, the best for its turns."""
        T_world_camera = self._T_world_start @ observation.T_start_camera
        x, y, z = T_world_camera[:3, 3].tolist()
        position = (x, y - self._camera.mount_height, z)
        (here,) = self._distances(np.array([position]))
        if self._is_there(position, here) or not np.isfinite(here):
            return [Action.STOP]
        ways = [_Way(position, wrap_angle(self._start_yaw + observation.compass), ())]
        tried: set[tuple[int, ...]] = set()
        for _ in range(LOOKAHEAD):
            ways = [longer for way in ways for longer in self._one_forward_more(way, tried)]
            if not ways:
                break
            distances = self._distances(np.array([way.position for way in ways]))
            gains = here - distances
            arrives = [self._is_there(way.position, left) for way, left in zip(ways, distances, strict=True)]
            is_useful = (gains > MIN_PROGRESS) | arrives
            scores = np.where(is_useful, gains - TURN_COST * np.array([len(way.actions) for way in ways]), -np.inf)
            best = int(np.argmax(scores))
            if np.isfinite(scores[best]):
                return list(ways[best].actions)
        return [Action.STOP]

    def _one_forward_more(self, way: _Way, tried: set[tuple[int, ...]]) -> Iterator[_Way]:
        """The sequence with one more forward, for each direction that leads to a new place; extends `tried`."""
        for turn in _TURNS:
            yaw = way.yaw + turn * TURN_STEP
            start = np.array(way.position)
            end = self._navigation.step(start, start + FORWARD_STEP * forward_from_yaw(yaw)).position
            place = tuple(round(value / SAME_PLACE) for value in end)
            if place not in tried:
                tried.add(place)
                turns = (Action.LEFT if turn > 0 else Action.RIGHT,) * abs(turn)
                yield _Way(end, yaw, (*way.actions, *turns, Action.FORWARD))

    def _is_there(self, position: tuple[float, float, float], distance: float) -> bool:
        """Whether STOP succeeds here; `distance` to the region decides most places without asking the rule."""
        return distance <= NEAR and reaches_goal(position, self._episode, distance=distance, rule=self._rule)

    def _distances(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        if not len(self._region):
            return np.full(len(positions), np.inf)
        return self._navigation.distances(positions, self._region)


def load_agent(name: str) -> Agent:
    """A user's agent named `package.module:factory`, from the current folder too; the factory gets no arguments.

    Raises:
        AgentError: The name has another form, or the plug-in cannot be imported or built.
    """
    if not is_plugin(name):
        raise AgentError(
            f"--agent is {name!r}; expected random, shortest-path, or your own agent as package.module:factory."
        )
    return build_plugin(name, option="--agent", methods=("reset", "act"))
