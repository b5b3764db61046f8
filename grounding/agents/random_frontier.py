"""The paper's Random row: walk to a frontier drawn at random, then to the next, and stop when the steps end.

Observation -> `Seeker` (map, frontiers, way) -> a drawn goal -> next action. It never looks for the target.
"""

import math

import numpy as np

from sim.tasks.observers import Insight
from sim.types import Action, Camera, Observation, Task

from .carried_map import CarriedMap
from .frontiers import Frontier


class RandomFrontierAgent(CarriedMap):
    """An `Agent` that pursues a uniformly drawn frontier until it is seen, gone or out of reach, then draws again.

    When none is left it turns in place, so that its path does not grow; STOP is its last step (BASELINES.md section 4).
    """

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Seeds the draw; begins with an empty map, or with `keep_memory`, after `carry`, with the one that it has."""
        self._rng = np.random.default_rng(seed)
        self._max_steps = task.max_steps
        self._begin(camera, can_look=Action.LOOK_DOWN in task.actions, keep_memory=keep_memory)
        self._frontiers: list[Frontier] = []
        self._turn = Action.LEFT if self._rng.integers(2) else Action.RIGHT
        self._note = ""

    def act(self, observation: Observation) -> Action:
        """The next action towards the drawn frontier; STOP as the last of the task's steps."""
        self._seeker.see(self._in_map(observation))
        if observation.step + 1 >= self._max_steps:
            self._note = "the last step"
            return Action.STOP
        action = self._seeker.pursue()
        while action is None:
            self._frontiers = [each for each in self._seeker.frontiers() if math.isfinite(each.cost)]
            if not self._frontiers:
                self._note = "no frontier is left: turning"
                return self._turn
            drawn = self._frontiers[int(self._rng.integers(len(self._frontiers)))]
            self._seeker.choose(drawn)
            self._note = f"one of {len(self._frontiers)} frontiers, drawn at random"
            action = self._seeker.pursue()
        return action

    def insight(self) -> Insight:
        """The map so far, the frontiers, and the drawn one."""
        return self._in_start(self._seeker.insight(self._frontiers, note=self._note))


def random_frontier() -> RandomFrontierAgent:
    """The factory that `personal-viz run --agent random-frontier` names."""
    return RandomFrontierAgent()
