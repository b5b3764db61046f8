"""OneMap as an agent: it maps what pictures look like, and goes where the map resembles the described thing.

Observation -> `FeatureGrid` and `Seeker` -> target, frontier or point of interest -> next action. docs/agents.md lists
the differences from the published code.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.frames import wrap_angle, yaw_towards
from sim.tasks.looks import HomeLook, LookKind
from sim.tasks.observers import Detection, Insight
from sim.types import TURN_STEP, Action, Camera, Frame, Task

from ..looking_agent import LookingAgent
from ..seeking import FOR_EVER, FULL_TURN
from .feature_grid import FeatureGrid
from .goals import STICK_CELLS, MapGoal, chosen, explored_region, frontiers, hot_cells, points_of_interest
from .target import Target, believed, placed_detections, replaced

RANGES = {"frontier": (0.2, 0.4), "point": (0.4, 0.8)}
"""A way may end this far from a goal (metres), or this far if it cannot otherwise (OneMap's code)."""
_MOST_WAITS = 10
"""Steps at a goal after which it is given up (OneMap's code)."""
_MOST_STEPS = 150
"""Steps towards a goal after which it is given up; OneMap has no such limit, a drifting goal would last for ever."""
_OUT_OF_REACH_STEPS = 40
"""Steps for which a goal is left out that no way leads to."""


class _Ban(NamedTuple):
    """Targets, or other goals, near a cell that are left out for a while."""

    rc: tuple[int, int]
    until: int
    """Step from which they count again."""
    is_target: bool


class OneMapAgent(LookingAgent):
    """An `Agent` that looks for one described thing on the storey where it starts."""

    looks: ClassVar[frozenset[LookKind]] = frozenset({"glb"})
    """It can use the views of a walk, not a picture from above."""

    def look(self, home: HomeLook) -> None:
        """Makes a new map of the views of a walk; `reset(..., keep_memory=True)` keeps it.

        Raises:
            AgentError: A view has no colours or no depth.
        """
        self._T_map_start = None
        for view in home.views():
            if self._T_map_start is None:
                self._begin(view.camera, can_look=False, keep_memory=False)
                self._map = FeatureGrid()
            self._add(self._seen(view))
        self._next_T = self._T_map_start

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """Starts a new episode.

        With `keep_memory`, after `carry`, the map stays, and there is no look around; the target, goals, similarities
        and which cells were checked are forgotten. Without `carry`, or on another storey, the map is forgotten too.
        `seed` changes nothing: nothing is drawn.
        """
        perception = self._opened()
        is_kept = self._begin(camera, can_look=False, keep_memory=keep_memory)
        if not is_kept:
            self._map = FeatureGrid()
        text = self._goal_text(task)
        self._map.set_query(perception.encoder.encode_texts([f"a {text}"])[0])
        perception.detector.set_query(text)
        self._turns_left = 0 if is_kept else FULL_TURN
        self._target: Target | None = None
        self._goal: MapGoal | None = None
        self._goal_since, self._waits = 0, 0
        self._bans: list[_Ban] = []
        self._detections: tuple[Detection, ...] = ()
        self._note = ""

    def insight(self) -> Insight:
        """The map, its similarity to the text, frontiers, points of interest, detections, the goal and the reason.

        Cells are shown only while the map's frame is the episode's start frame: a grid cannot be turned.
        """
        goals = self._found_goals()
        points = sorted((goal for goal in goals if goal.kind == "point"), key=lambda goal: -goal.score)
        edges = [goal for goal in goals if goal.kind == "frontier"]
        goal = self._target or self._goal
        seen = self._map.confidence > 0
        return self._in_start(
            Insight(
                grid=self._map.grid,
                occupancy=self._map.occupancy(),
                similarity=np.where(seen, self._map.similarity, np.float32(np.nan)),
                frontiers=np.array([self._xz_of(each.rc) for each in edges], float).reshape(-1, 2),
                detections=self._detections,
                candidates=np.array([self._place_of(each.rc) for each in points], float).reshape(-1, 3),
                candidate_scores=tuple(each.score for each in points),
                goal=None if goal is None else self._place_of(goal.rc),
                note=self._note,
            )
        )

    def _add(self, frame: Frame) -> NDArray[np.int32]:
        """Adds a view to the map of features; (H, W) cell of each pixel, -1 where it has none."""
        patches = self._opened().encoder.encode_patches([frame])[0]
        return self._map.add(frame.depth_m, frame.T_world_camera, frame.camera, patches)

    def _look(self, frame: Frame) -> None:
        """Adds a view to the map, and looks for the target in it."""
        perception, cells = self._opened(), self._add(frame)
        part = self._map.box
        is_hot = np.zeros(self._map.grid.shape, bool)
        is_hot[part] = hot_cells(self._map.similarity[part], self._map.confidence[part] > 0)
        placed = placed_detections(frame, perception.detector, perception.segmenter)
        self._detections = tuple(detection for detection, _ in placed)
        found = [
            believed(mask, frame.depth_m, cells, is_hot=is_hot, similarity=self._map.similarity) for _, mask in placed
        ]
        candidates = [each for each in found if each is not None and not self._is_banned(each.rc, is_target=True)]
        self._target = replaced(self._target, candidates, is_hot)

    def _search(self) -> Action:
        """The next action; STOP near a believed detection, never otherwise."""
        return self._towards_target() or self._explore()

    def _towards_target(self) -> Action | None:
        """The next action towards the target, STOP near it; None without a target, or if no way leads to it."""
        target = self._target
        if target is None:
            return None
        self._goal = None
        action = self._seeker.stop_at(self._xz_of(target.rc))
        if action is not None:
            self._note = f"to a detection that the map agrees with, score {target.score:.2f}"
            return action
        self._ban(target.rc, _OUT_OF_REACH_STEPS, is_target=True)
        self._target = None
        return None

    def _explore(self) -> Action:
        """The next action towards the best frontier or point of interest; a turn if there is none."""
        for is_again in (False, True):
            left = [goal for goal in self._found_goals() if not self._is_banned(goal.rc)]
            while left:
                goal = chosen(left, self._goal)
                action = self._towards(goal)
                if action is not None:
                    return action
                self._goal = None
                left = [each for each in left if not self._is_banned(each.rc)]
            if not is_again:
                self._map.checked[:] = 0  # look at all points of interest once more
        self._note = "no goal is left: turning"
        return Action.LEFT

    def _found_goals(self) -> list[MapGoal]:
        """Frontiers and points of interest, on the whole grid."""
        part = self._map.box
        similarity, is_seen = self._map.similarity[part], self._map.confidence[part] > 0
        is_navigable, is_explored = self._map.is_navigable(part), self._map.is_explored(part)
        region = explored_region(is_explored, is_navigable)
        found = [
            *frontiers(region, is_navigable, similarity, is_seen),
            *points_of_interest(
                similarity, is_seen, region=region, is_explored=is_explored, is_checked=self._map.is_checked(part)
            ),
        ]
        row, col = part[0].start, part[1].start
        return [goal._replace(rc=(goal.rc[0] + row, goal.rc[1] + col)) for goal in found]

    def _towards(self, goal: MapGoal) -> Action | None:
        """The next action towards a goal, or turns at it; None, and it is left out from now on, if it has failed."""
        if self._goal is None or math.dist(goal.rc, self._goal.rc) > STICK_CELLS:
            self._goal_since, self._waits = self._step, 0
        if self._step - self._goal_since > _MOST_STEPS:
            self._ban(goal.rc, _OUT_OF_REACH_STEPS)
            return None
        if not self._plan(goal.rc, RANGES[goal.kind]):
            self._ban(goal.rc, _OUT_OF_REACH_STEPS)
            return None
        self._goal = goal
        self._note = f"to a {'frontier' if goal.kind == 'frontier' else 'point of interest'}, score {goal.score:.2f}"
        action = self._seeker.walk()
        if action is not None:
            return action
        self._waits += 1
        if self._seeker.goal is None or self._waits > _MOST_WAITS:
            self._ban(goal.rc, FOR_EVER if self._seeker.goal is not None else _OUT_OF_REACH_STEPS)
            return None
        away = wrap_angle(yaw_towards(self._seeker.memory.xz, self._xz_of(goal.rc)) - self._seeker.memory.yaw)
        return Action.RIGHT if away < -TURN_STEP / 2 else Action.LEFT

    def _plan(self, rc: tuple[int, int], reaches: Sequence[float]) -> bool:
        """Makes the cheapest place near a cell the seeker's goal, if it is another cell; False if there is no way."""
        return self._seeker.head_for(self._xz_of(rc), reaches=reaches, same=self._map.grid.cell / 2)

    def _ban(self, rc: tuple[int, int], steps: int, *, is_target: bool = False) -> None:
        """Leaves out goals near a cell from now on, and ends the walk."""
        self._bans = [each for each in self._bans if each.until > self._step]
        self._bans.append(_Ban(rc, min(self._step + steps, FOR_EVER), is_target))
        self._seeker.choose(None)

    def _is_banned(self, rc: tuple[int, int], *, is_target: bool = False) -> bool:
        bans = (each for each in self._bans if each.is_target == is_target and each.until > self._step)
        return any(math.dist(each.rc, rc) <= STICK_CELLS for each in bans)

    def _xz_of(self, rc: tuple[int, int]) -> tuple[float, float]:
        """Middle of a cell in the map, metres."""
        x, z = self._map.grid.xz_from_rc(np.array(rc)).tolist()
        return x, z

    def _place_of(self, rc: tuple[int, int]) -> tuple[float, float, float]:
        """Middle of a cell on the floor of the map, metres."""
        x, z = self._xz_of(rc)
        return x, self._seeker.memory.floor_y, z
