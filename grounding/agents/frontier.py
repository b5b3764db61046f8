"""Exploration: look at the frontier that takes the fewest actions to see, again and again, until none is left.

Before it stops with frontiers out of reach, the robot looks around once more.

The cost of a frontier of K cells is multiplied by 1 + 60 / K; otherwise the robot would look at slivers beside things
one by one. It includes actions already spent on the frontier, as the nearest one may be out of reach behind a wall that
cannot be seen.

Observation -> `Seeker` (map, frontiers, way) -> the goal chosen here -> next action.
"""

import math
from typing import Literal

import numpy as np

from sim.tasks.observers import Insight
from sim.types import Action, Camera, Observation, Task

from .frontiers import Frontier
from .seeking import FULL_TURN, Seeker

StopReason = Literal["no-frontier", "steps", "stuck"]
MAX_STEPS = 2500
"""Budget of an exploration (paper, Sec. IV; issue 7)."""
_MOVED = 0.02
"""A forward that moves the robot less than this (metres) counts as no move."""
_STUCK = 60
"""After this many forwards in a row without a move the robot gives up."""
_REPLAN_STEPS = 4
"""Steps between two searches for a nearer goal while the current goal is valid."""
_SWITCH_GAIN = 3.0
"""Actions that another frontier must save to become the goal."""


class FrontierExplorer:
    """An `Agent` that explores the storey on which it starts; it sees depth and its own pose, nothing else."""

    def __init__(self, *, max_steps: int = MAX_STEPS) -> None:
        """Takes the largest number of actions; if all are used, the last one is STOP."""
        self._max_steps = max_steps

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Begins with an empty map, even with `keep_memory`: each episode has its own start frame."""
        rng = np.random.default_rng(seed)
        self._turn = Action.LEFT if rng.integers(2) else Action.RIGHT
        self._seeker = Seeker(camera, can_look=Action.LOOK_DOWN in task.actions)
        self._frontiers: list[Frontier] = []
        self._turns_left, self._has_looked_around = FULL_TURN, False
        self._planned_at = 0
        self._note = "looking around at the start"
        self._last: tuple[Action, tuple[float, float]] | None = None
        self._unmoved = 0
        self.stop_reason: StopReason | None = None
        """Why it stopped; None while it explores."""

    def act(self, observation: Observation) -> Action:
        """The next action; STOP when no frontier is left, as the last step, or when it cannot move."""
        self._seeker.see(observation)
        self._count_unmoved()
        action = self._choose(observation.step)
        if action is not Action.STOP and observation.step + 1 >= self._max_steps:
            self.stop_reason, self._note, action = "steps", "no step is left", Action.STOP
        self._last = (action, self._seeker.memory.xz)
        return action

    def insight(self) -> Insight:
        """The map so far, the frontiers, the goal, and the reason for it."""
        return self._seeker.insight(self._frontiers, note=self._note)

    def _choose(self, step: int) -> Action:
        if self._unmoved >= _STUCK:
            return self._stop("stuck", f"{_STUCK} forwards in a row led nowhere")
        while not self._turns_left:
            self._look_for_nearer(step)
            action = self._seeker.pursue()
            if action is not None:
                return action
            self._frontiers = self._seeker.frontiers()
            if self._seeker.is_dull():
                return self._stop("no-frontier", f"{len(self._frontiers)} frontiers are left, none worth more steps")
            if self._frontiers and math.isfinite(self._frontiers[0].cost):
                self._take(self._frontiers[0], step)
            elif not self._seeker.squeeze() and not self._seeker.forgive():
                if not self._frontiers or self._has_looked_around:
                    return self._stop("no-frontier", f"{len(self._frontiers)} frontiers are left, out of reach")
                self._turns_left, self._note = FULL_TURN, "no frontier can be reached: looking around"
                self._has_looked_around = True
        self._turns_left -= 1
        return self._turn

    def _look_for_nearer(self, step: int) -> None:
        """Plans the way anew every few steps, and changes to another frontier where that saves actions."""
        if self._seeker.goal is None or self._seeker.is_turning or step - self._planned_at < _REPLAN_STEPS:
            return
        self._seeker.replan()
        self._frontiers, self._planned_at = self._seeker.frontiers(), step
        if self._frontiers and self._frontiers[0].cost + _SWITCH_GAIN < self._seeker.cost_left:
            self._take(self._frontiers[0], step)

    def _take(self, frontier: Frontier, step: int) -> None:
        self._seeker.choose(frontier)
        self._planned_at, self._has_looked_around = step, False
        self._note = f"to a frontier of {len(frontier.cells_rc)} cells, counted as {frontier.cost:.0f} actions away"

    def _stop(self, reason: StopReason, note: str) -> Action:
        self._seeker.choose(None)
        self.stop_reason, self._note = reason, note
        return Action.STOP

    def _count_unmoved(self) -> None:
        """Counts consecutive forwards that did not move the robot."""
        if self._last is not None and self._last[0] is Action.FORWARD:
            moved = math.dist(self._last[1], self._seeker.memory.xz) >= _MOVED
            self._unmoved = 0 if moved else self._unmoved + 1
