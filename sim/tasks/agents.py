"""The agent protocol, and the agents that need no perception: random, shortest path (ground truth), replay."""

import importlib
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.frames import T_world_agent, forward_from_yaw, wrap_angle
from sim.types import FORWARD_STEP, TURN_STEP, Action, Camera, Observation, Pose, Task
from sim.world.navigation_map import NavigationMap

TURN_COST = 0.02
"""Metres of detour that the shortest-path agent accepts to save one turn; keeps it from weaving."""
MIN_PROGRESS = 1e-3
"""A forward that brings the goal less than this much nearer (metres) is not worth taking."""


ARRIVED = 0.06
"""Distance to the region (metres) at which the shortest-path agent stops: its places are up to 5 cm apart."""


class Agent(Protocol):
    """What walks: told the task once, then asked for one action per observation."""

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Starts a new episode; `keep_memory` says that the home is the same as in the last one."""
        ...

    def act(self, observation: Observation) -> Action:
        """The next action."""
        ...


class RandomAgent:
    """Uniform over the task's actions, STOP included."""

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Seeds the draw."""
        self._actions = task.actions
        self._rng = np.random.default_rng(seed)

    def act(self, observation: Observation) -> Action:
        """One draw."""
        return self._actions[int(self._rng.integers(len(self._actions)))]


class ReplayAgent:
    """Takes a recorded list of actions, then STOP."""

    def __init__(self, actions: Sequence[Action]) -> None:
        """Keeps what to do, in order."""
        self._actions = tuple(actions)

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Back to the first action."""

    def act(self, observation: Observation) -> Action:
        """The action of this step."""
        return self._actions[observation.step] if observation.step < len(self._actions) else Action.STOP


class ShortestPathAgent:
    """Walks greedily down the distance to a known goal region: an upper bound with ground truth, not a competitor."""

    def __init__(self, start: Pose, region: NDArray[np.float64], navigation: NavigationMap) -> None:
        """Knows the truth that other agents are not told.

        Args:
            start: True start pose, to turn the observation's start frame into the world.
            region: (K, 3) places to reach, well inside those from which STOP succeeds.
            navigation: The same map that the environment uses.
        """
        self._T_world_start = T_world_agent(start)
        self._start_yaw = start.yaw
        self._region = region
        self._navigation = navigation

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Forgets what it was about to do."""
        self._camera = camera
        self._planned: list[Action] = []

    def act(self, observation: Observation) -> Action:
        """The next turn or forward towards the region; STOP inside it or when no heading brings it nearer."""
        if not self._planned:
            self._planned = self._plan(observation)
        return self._planned.pop(0)

    def _plan(self, observation: Observation) -> list[Action]:
        T_world_camera = self._T_world_start @ observation.T_start_camera
        position = T_world_camera[:3, 3] - np.array([0.0, self._camera.mount_height, 0.0])
        yaw = wrap_angle(self._start_yaw + observation.compass)
        turns = range(-5, 7)
        ends = np.array([self._forward(position, yaw + turn * TURN_STEP) for turn in turns])
        distances = self._distances(np.vstack([position, ends]))
        gains = distances[0] - distances[1:]
        scores = np.where(gains > MIN_PROGRESS, gains - TURN_COST * np.abs(turns), -np.inf)
        best = int(np.argmax(scores))
        if distances[0] <= ARRIVED or not np.isfinite(scores[best]):
            return [Action.STOP]
        turn = turns[best]
        return [Action.LEFT if turn > 0 else Action.RIGHT] * abs(turn) + [Action.FORWARD]

    def _forward(self, position: NDArray[np.float64], yaw: float) -> tuple[float, float, float]:
        return self._navigation.step(position, position + FORWARD_STEP * forward_from_yaw(yaw)).position

    def _distances(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        if not len(self._region):
            return np.full(len(positions), np.inf)
        return self._navigation.distances(positions, self._region)


def load_agent(name: str) -> Agent:
    """A user's agent named `package.module:factory`; the factory is called without arguments.

    Raises:
        AgentError: The name has another form, or the plug-in cannot be imported or built.
    """
    module, _, factory = name.partition(":")
    if not factory:
        raise AgentError(
            f"--agent is {name!r}; expected random, shortest-path, or your own agent as package.module:factory."
        )
    try:
        agent = getattr(importlib.import_module(module), factory)()
    except Exception as error:  # the plug-in door: whatever the user's code raises is named
        raise AgentError(f"{name}: {type(error).__name__} while it was built: {error}. Correct the plug-in.") from error
    for method in ("reset", "act"):
        if not callable(getattr(agent, method, None)):
            raise AgentError(f"{name}: found no method {method}(); expected an Agent (sim.tasks.agents).")
    return agent
