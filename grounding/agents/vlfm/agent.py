"""VLFM as an agent: it looks around, goes to the frontier of the best value, and then to what a detector found.

Observation -> `Seeker`, `ExploredArea`, `ValueMap`, `ObjectCloud` -> target or frontier -> next action. docs/agents.md
lists the differences from the published code.
"""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grounding.perception.protocol import Perception
from sim.tasks.observers import Detection, Insight
from sim.types import Action, Camera, Frame, Task

from ..looking_agent import LookingAgent
from ..seeking import FOR_EVER, FULL_TURN
from .explored import ExploredArea
from .object_cloud import SAME_GOAL, ObjectCloud
from .value_map import Fusion, ValueMap, most_valuable

PROMPT = "Seems like there is a <target> ahead."
"""VLFM's text; several texts are separated by "|"."""
STICK_DISTANCE, STICK_GAIN = 0.5, 0.01
"""The last frontier, or the nearest one within this distance (metres), is kept while its value and this gain are above
the last value (VLFM's code)."""
_REACHES = (0.25, 0.75)
"""A way may end this far from a frontier, or this far if it cannot otherwise, metres."""
_BAN_RADIUS, _BAN_STEPS = 0.5, 40
"""Frontiers within this distance (metres) of one that no way leads to are left out for this many steps."""
_MOST_STEPS = 150
"""Steps towards one frontier after which it is given up; VLFM has no such limit and may stay for ever."""
_SECOND_TRIES = 3
"""Frontiers that are left out come back this many times when no other is left."""
_MOST_CANDIDATES = 100
Values = Literal["pictures", "distance"]
"""What makes a frontier worth going to: how well pictures of it match the text, or only that it is near."""


class _Ban(NamedTuple):
    """A frontier that is left out for a while."""

    xz: tuple[float, float]
    until: int
    """Step from which it counts again."""


class VlfmAgent(LookingAgent):
    """An `Agent` that looks for one described thing on the storey where it starts."""

    def __init__(
        self,
        perception: Perception | Callable[[], Perception],
        goal_text: Callable[[Task], str],
        *,
        prompt: str = PROMPT,
        fusion: Fusion = "weighted",
        exploration_threshold: float = 0.0,
        values: Values = "pictures",
    ) -> None:
        """Makes an agent.

        Args:
            perception: What it sees with, or a function that makes it when the first episode begins.
            goal_text: What to look for, such as "red backpack", from the task; never from the goal.
            prompt: The texts that pictures are compared with; `<target>` becomes the goal text.
            fusion: How new values join the map.
            exploration_threshold: With several texts, the first one counts whose best frontier has at least this value.
            values: `distance` makes the control `vlfm-geometry`: the same in all else, it compares no picture with a
                text.
        """
        super().__init__(perception, goal_text)
        self._fusion: Fusion = fusion
        self._prompt, self._threshold, self._by = prompt, exploration_threshold, values

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Begins with empty maps.

        With `keep_memory`, after `carry` and on the same storey, obstacles stay: values and the explored area belong to
        the last query.
        """
        perception = self._opened()
        self._rng = np.random.default_rng(seed)
        text = self._goal_text(task)
        perception.detector.set_query(text)
        self._texts = self._prompt.replace("<target>", text.replace("|", "/")).split("|")
        is_kept = self._begin(camera, can_look=False, keep_memory=keep_memory, obstacles_alone=True)
        grid = self._seeker.memory.grid
        if is_kept:
            self._explored.forget_explored()
        else:
            self._explored = ExploredArea(grid)
        self._cloud = ObjectCloud()
        self._values = ValueMap(grid, num_texts=len(self._texts), fusion=self._fusion)
        self._turns_left = FULL_TURN
        self._detections: tuple[Detection, ...] = ()
        self._goal: tuple[float, float, float] | None = None
        self._frontier: tuple[float, float] | None = None
        self._value, self._since, self._waits = -math.inf, 0, 0
        self._target_from = 0
        self._bans: list[_Ban] = []
        self._tries_left = _SECOND_TRIES
        self._note = ""

    def insight(self) -> Insight:
        """The map, its values for the first text, frontiers, detections, the target's points, the goal and the note."""
        seen = self._values.confidence > 0
        memory = self._seeker.memory
        return self._in_start(
            Insight(
                grid=memory.grid,
                occupancy=memory.cells,
                similarity=np.where(seen, self._values.values[..., 0], np.float32(np.nan)),
                frontiers=self._explored.frontiers(),
                detections=self._detections,
                candidates=self._cloud.nearest(memory.xz, most=_MOST_CANDIDATES),
                goal=self._goal,
                note=self._note,
            )
        )

    def _look(self, frame: Frame) -> None:
        """Adds a view to the maps, and looks for the target in it."""
        perception = self._opened()
        T, floor_y = frame.T_world_camera, self._seeker.memory.floor_y
        self._explored.see(frame.depth_m, T, frame.camera, floor_y=floor_y)
        if self._by == "pictures":
            self._values.add(frame.depth_m, T, frame.camera, perception.scorer.score(frame, self._texts))
        found = [(each, perception.segmenter.mask(frame, each)) for each in perception.detector.detect(frame)]
        self._detections = tuple(self._cloud.add(frame, found, rng=self._rng))
        self._cloud.retract(frame)

    def _search(self) -> Action:
        """The next action; STOP near the target's point, or when no frontier is left."""
        return self._towards_target() or self._explore()

    def _towards_target(self) -> Action | None:
        """The next action towards the target, STOP near it; None without a target, or if no way leads to it."""
        goal = self._cloud.goal(self._seeker.memory.xz)
        if goal is None or self._step < self._target_from:
            return None
        xz = (goal[0], goal[2])
        away = math.dist(self._seeker.memory.xz, xz)
        self._goal, self._frontier = goal, None
        action = self._seeker.stop_at(xz)
        if action is not None:
            self._note = f"to a detected target, {away:.1f} m away"
            return action
        self._target_from = self._step + _BAN_STEPS
        return None

    def _explore(self) -> Action:
        """The next action towards the best frontier; STOP if none is left."""
        frontiers = self._explored.frontiers()
        while True:
            left = [xz for xz in frontiers.tolist() if not self._is_banned((xz[0], xz[1]))]
            while left:
                action = self._towards_best(np.array(left))
                if action is not None:
                    return action
                left = [xz for xz in left if not self._is_banned((xz[0], xz[1]))]
            waiting = [ban for ban in self._bans if self._step < ban.until < FOR_EVER]
            if not waiting or not self._tries_left:
                break
            self._tries_left -= 1
            self._seeker.squeeze()
            self._bans = [ban for ban in self._bans if ban.until == FOR_EVER]
        self._goal = None
        self._note = f"{len(frontiers)} frontiers are left, none of which can be reached"
        return Action.STOP

    def _towards_best(self, places: NDArray[np.float64]) -> Action | None:
        """The next action towards the chosen frontier (of N, 2); None, and it is left out from now on, if it failed."""
        values = self._values_of(places)
        index = chosen_frontier(places, values, last=self._frontier, last_value=self._value)
        xz = (float(places[index, 0]), float(places[index, 1]))
        if self._frontier is None or math.dist(xz, self._frontier) > STICK_DISTANCE:
            self._since, self._waits = self._step, 0
        self._frontier, self._value = xz, float(values[index])
        self._goal = (xz[0], self._seeker.memory.floor_y, xz[1])
        self._note = f"to the frontier of value {self._value:.3f}, one of {len(places)}"
        if self._step - self._since > _MOST_STEPS or not self._plan(xz):
            return self._leave(xz, _BAN_STEPS)
        action = self._seeker.walk()
        if action is not None:
            return action
        if self._seeker.goal is None:
            return self._leave(xz, _BAN_STEPS)
        self._waits += 1
        if self._waits > FULL_TURN:
            return self._leave(xz, None)
        self._note = "turning at a frontier that is still open"
        return Action.LEFT

    def _values_of(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) values of frontiers (of N, 2); by distance 1 / (1 + metres), so that a robot on its way stays on it."""
        if self._by == "distance":
            return 1 / (1 + np.hypot(*(places - np.array(self._seeker.memory.xz)).T))
        return most_valuable(self._values.values_at(places), threshold=self._threshold)

    def _plan(self, xz: tuple[float, float]) -> bool:
        """Makes the cheapest place near `xz` the seeker's goal unless it already is; False if no way leads there."""
        return self._seeker.head_for(xz, reaches=_REACHES, same=SAME_GOAL)

    def _leave(self, xz: tuple[float, float], steps: int | None) -> None:
        """Leaves out frontiers near a place for some steps, for ever if None, and ends the walk."""
        self._bans.append(_Ban(xz, FOR_EVER if steps is None else self._step + steps))
        self._seeker.choose(None)
        self._frontier, self._value = None, -math.inf

    def _is_banned(self, xz: tuple[float, float]) -> bool:
        return any(ban.until > self._step and math.dist(ban.xz, xz) <= _BAN_RADIUS for ban in self._bans)


def chosen_frontier(
    places: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    last: tuple[float, float] | None,
    last_value: float,
) -> int:
    """Index of the frontier to go to: the last one unless it has become worse, else the one of the best value.

    Args:
        places: (N, 2), at least one; equal values are chosen in this order.
        values: (N,).
        last: The last choice.
        last_value: Its value then.
    """
    if last is not None:
        away = np.hypot(*(places - np.array(last)).T)
        nearest = int(away.argmin())
        if away[nearest] <= STICK_DISTANCE and values[nearest] + STICK_GAIN > last_value:
            return nearest
    return int(values.argmax())
