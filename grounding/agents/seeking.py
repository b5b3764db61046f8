"""Walks to a chosen frontier to see it; every exploring agent uses it.

`Seeker` keeps the map, the frontiers that failed, and the way; agents choose which frontier it pursues.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.frames import forward_from_yaw, wrap_angle, yaw_towards
from sim.tasks.observers import OCCUPIED, UNKNOWN, Insight
from sim.types import FORWARD_STEP, TURN_STEP, Action, Camera, Observation

from .floor_memory import FloorMemory, Ground
from .frontiers import Frontier, costs_from, find_frontiers, reach_of
from .plan_kernels import best_heading, spread_costs

_ARRIVED = 0.8
"""A robot this few actions from the viewing place has arrived: a forward would pass it."""
_STRAIGHT = 6
"""A heading is judged by this many forwards in a row."""
_CLOSED_COST = 2.0
"""Cost, in actions, of a cell too near to things for plans; it counts only if the robot stands in one."""
_SAME_PLACE, _NEAR_PLACE, _AGAIN_COST = 0.025, 0.12, 8.0
"""A heading that led into a wall is not tried again within the first distance (metres); up to the second distance it
costs extra actions, most at the same place."""
_TRIED_CELL, _TRIED_COSTS = 0.1, (1.5, 5.0)
"""A forward repeated from the same cell (of this side, metres) in the same direction costs this many extra actions
until there is new floor, so that the robot does not go to and fro. The cost changes to the other one each time that a
goal fails for lack of new floor."""
_BAN_RADIUS, _LOOKED_RADIUS = 0.5, 0.3
"""Radius (metres) that is ignored around a place that could not be reached, and around one that stayed unknown."""
STOP_DISTANCE = 0.6
"""Agents stop this near to the middle of what they see of a thing, metres; its centre is farther."""
_NEAR_ENOUGH = 1.0
"""They stop within this distance (metres) where they can come no nearer."""
_STOPS = (0.55, 0.7, 1.0, 1.25, 1.5)
"""Distances (metres) from there at which a way to the thing may end, the first that works; no rule counts more."""
FULL_TURN = round(2 * math.pi / TURN_STEP)
"""Turns after which a robot has looked around."""
FOR_EVER = int(np.iinfo(np.int32).max)
_NEWS = 100
"""Cells of new floor that justify another round: a quarter of a square metre."""
_BEYOND = 12.0
"""Ways may lead to places that are this many actions farther from the goal than the robot."""
_MOST_MISSES = 5
"""The time for which a frontier is ignored doubles each time it could not be reached, at most this often."""
_PROGRESS = 0.5
"""The robot has come nearer when its way is shorter by this many actions."""
_PATIENCE = 15
"""Steps without coming nearer after which a goal counts as out of reach."""
_MOST_BUMPS = 8
"""Collisions on the way to one goal after which it counts as out of reach."""
_HEADING_STEPS = 4
"""Steps between two plans of the way to the same place."""
_DETOUR_STEPS = 40
"""Steps for which a frontier is ignored after it could not be reached."""
_LOOK_STEPS, _BAN_STEPS = 30, 150
"""Steps for which a frontier is ignored after it stayed unknown when the robot looked at it, and after the robot found
no new floor for too long on the way to it."""
_TRIES = 3
"""A frontier that stayed unknown after this many looks is given up."""
_DULL_STEPS = 150
"""Steps without new floor after which the current goal has failed; each later goal fails after a third of that."""
_ROUNDS = 12
"""All ignored frontiers come back this many times in one step; then the robot is done."""
_WORTH = 200
"""Cells of new floor that are worth the way: half a square metre."""
_STEPS_PER_CELL, _LONGEST = 8, 60
"""Steps that each cell of the longest frontier adds to the wait for it, and the most cells that count."""
_SQUEEZE_STEPS, _LAST_STEPS = 80, 160
"""Steps without floor that was worth it after which plans pass close to things, and after which the robot is done."""


class _Way(NamedTuple):
    """A planned way to the goal."""

    ground: Ground
    to_go: NDArray[np.float64]
    """(rows, cols) actions from each cell to the place to look from."""


class Seeker:
    """The part of an explorer that remembers, plans and walks. Frame: start."""

    def __init__(self, camera: Camera, *, can_look: bool = True, memory: FloorMemory | None = None) -> None:
        """Starts with a map, or without one; `can_look` says whether the camera may be tilted."""
        self.memory = memory or FloorMemory()
        self.goal: Frontier | None = None
        """The frontier that the robot goes to see."""
        self._camera, self._can_look = camera, can_look
        self._step = 0
        self._banned_until = np.zeros(self.memory.grid.shape, np.int32)
        self._failures = np.zeros(self.memory.grid.shape, np.uint8)
        self._misses = np.zeros(self.memory.grid.shape, np.uint8)
        self._spent = np.zeros(self.memory.grid.shape, np.float32)
        self._goal_rc, self._chosen_at = np.zeros((0, 2), np.int64), 0
        self._way: _Way | None = None
        self._best_to_go, self._nearer_at = math.inf, 0
        self._bumps = 0
        self._forgiven_at, self._rounds_now = -1, 0
        self._known, self._news_at, self._dull_at, self._dull_goals = 0, 0, 0, 0
        self._free_worth, self._worth_at, self._has_retried = 0, 0, False
        self._tried: Counter[tuple[int, int, int]] = Counter()
        self._begun: list[Action] = []
        self._headed_at = 0

    def see(self, observation: Observation) -> None:
        """Adds an observation.

        Raises:
            AgentError: The observation has no depth.
        """
        self.memory.see(observation)
        self._step = observation.step
        known = self.memory.num_known
        if known > self._known + _NEWS:
            self._known, self._news_at = known, self._step
            self._tried.clear()
        free = self.memory.num_free
        if free > self._free_worth + _WORTH:
            self._free_worth, self._worth_at, self._has_retried = free, self._step, False
            self.memory.relax()
        elif self._step - self._worth_at > _SQUEEZE_STEPS:
            self.squeeze()
        if observation.collided:
            self._way = None
            self._bumps += 1
            self._best_to_go, self._nearer_at = math.inf, self._step  # the way round may be longer

    def carry(self) -> None:
        """Goes on from another place, to which it does not walk, without a goal."""
        self.choose(None)
        self.memory.carry()

    def frontiers(self, *, even_banned: bool = False) -> list[Frontier]:
        """The frontiers that are not ignored now, or all of them, best first; cost is inf where no known way leads."""
        ground = self.memory.ground()
        failures = self._cut(self._failures, ground)
        banned = self._cut(self._banned_until, ground) > (FOR_EVER if even_banned else self._step)
        costs = costs_from(ground, self.memory.xz)
        return find_frontiers(
            ground,
            costs,
            banned=banned,
            failures=failures,
            spent=self._cut(self._spent, ground),
            robot=(*self.memory.xz, self.memory.yaw),
            is_tilted=self.memory.is_tilted,
            can_look=self._can_look,
            camera=self._camera,
        )

    def choose(self, goal: Frontier | None) -> None:
        """Makes `goal`, one of this step's `frontiers`, the goal from now on; stores the steps spent on the last."""
        if self.goal is not None:
            rows, cols = self._goal_rc.T
            self._spent[rows, cols] += self._step - self._chosen_at
        if goal is not None:
            self._goal_rc, self._chosen_at = goal.cells_rc + self._corner(self.memory.ground()), self._step
        self.goal, self._way, self._begun = goal, None, []
        self._best_to_go, self._nearer_at, self._bumps = math.inf, self._step, 0

    def replan(self) -> None:
        """Discards the way, so that it is planned again before the next action."""
        self._way = None

    @property
    def is_turning(self) -> bool:
        """Whether the robot is turning to its chosen heading; with a new goal at every turn it would never arrive."""
        return bool(self._begun)

    @property
    def cost_left(self) -> float:
        """Actions until the goal is seen, including the turns at its place; inf without a goal or a way."""
        if self.goal is None:
            return math.inf
        turn = abs(wrap_angle(yaw_towards(self.goal.place_xz, self.goal.target_xz) - self.memory.yaw))
        return self._to_go() + max(0.0, turn / TURN_STEP - 0.5)

    def forgive(self) -> bool:
        """Brings back ignored frontiers, and once also given-up ones; unblocks collisions if that is not enough.

        Returns:
            False if there was nothing to bring back, or if that has failed to help too often.
        """
        waiting = (self._banned_until > self._step) & (self._failures < _TRIES)
        if not waiting.any() and not self._has_retried:  # once, also what was given up
            self._has_retried = True
            waiting = self._banned_until > self._step
            self._failures[waiting] = 0
        self._rounds_now = self._rounds_now + 1 if self._step == self._forgiven_at else 0
        self._forgiven_at = self._step
        if self._rounds_now >= _ROUNDS:  # everything keeps failing before the robot can move
            return False
        self._banned_until[waiting] = 0
        is_shut_in = self._rounds_now > 0 or not waiting.any()
        return bool(waiting.any()) | (is_shut_in and self.memory.forget_bumps())

    def is_dull(self) -> bool:
        """Whether too little new floor was found for too long; the limit grows with the longest frontier."""
        dull = self._step - self._worth_at
        if dull <= _LAST_STEPS:
            return False
        most = max((len(frontier.cells_rc) for frontier in self.frontiers(even_banned=True)), default=0)
        return dull > _LAST_STEPS + _STEPS_PER_CELL * min(most, _LONGEST)

    def squeeze(self) -> bool:
        """Plans closer to things until there is new floor; False if it already does."""
        if not self.memory.squeeze():
            return False
        self._dull_at = self._step
        return True

    def pursue(self) -> Action | None:
        """The next action towards seeing the goal; None if the goal is seen, has failed, or does not exist."""
        goal = self.goal
        if goal is None:
            return None
        if self.memory.cell_at(goal.target_xz) != UNKNOWN:
            self.choose(None)
            return None
        if self._step - max(self._news_at, self._dull_at) > _DULL_STEPS:
            self._dull_at = self._step - _DULL_STEPS * 2 // 3
            self._dull_goals += 1
            self._leave(goal, for_steps=_BAN_STEPS)
            return None
        action = self._begun_before()
        if action is not None:
            return action
        if self._has_arrived():
            return self._look(goal)
        action = self._walk_on()
        if action is None:
            self._leave(goal, for_steps=_DETOUR_STEPS)
        return action

    def head_for(self, xz: tuple[float, float], *, reaches: Sequence[float], same: float) -> bool:
        """Makes the cheapest place near a point the goal of `walk`, unless the robot already goes there.

        Args:
            xz: The point, start frame, metres.
            reaches: Distances from it (metres) at which the way may end; a later one counts if the earlier ones fail.
            same: A goal for a point nearer to it than this (metres) is kept, and its way planned anew every few steps.

        Returns:
            False if no way leads there.
        """
        if self.goal is not None and (self.is_turning or math.dist(xz, self.goal.target_xz) < same):
            if self._step - self._headed_at >= _HEADING_STEPS and not self.is_turning:
                self.replan()
                self._headed_at = self._step
            return True
        ground = self.memory.ground()
        costs = costs_from(ground, self.memory.xz)
        cells = np.argwhere(np.isfinite(costs))
        away = np.hypot(*(ground.grid.xz_from_rc(cells) - np.array(xz)).T)
        for reach in reaches:
            near = cells[away <= reach]
            if len(near):
                best = near[costs[tuple(near.T)].argmin()]
                x, z = ground.grid.xz_from_rc(best).tolist()
                self.choose(Frontier(np.zeros((0, 2), np.int64), xz, float(costs[tuple(best)]), (x, z), xz))
                self._headed_at = self._step
                return True
        return False

    def stop_at(self, xz: tuple[float, float]) -> Action | None:
        """The next action of a walk that ends with STOP at a thing, as near to its middle as a way leads.

        Args:
            xz: The thing's middle, start frame, metres.

        Returns:
            None if no way leads near it.
        """
        away = math.dist(self.memory.xz, xz)
        if away <= STOP_DISTANCE:
            return Action.STOP
        for _ in range(2):  # on arrival a nearer place may be known
            action = self.walk() if self.head_for(xz, reaches=_STOPS, same=STOP_DISTANCE / 2) else None
            if action is not None:
                return action
            if self.goal is None:  # what looked like a way is none
                return Action.STOP if away <= _NEAR_ENOUGH else None
            self.choose(None)
        return Action.STOP

    def walk(self) -> Action | None:
        """The next action towards the goal's place, whatever is known of its target.

        Returns:
            None when the robot has arrived, when there is no goal, and when the place is out of reach; then the ways
            near the robot cost more from now on and there is no goal any more.
        """
        if self.goal is None:
            return None
        action = self._begun_before()
        if action is not None or self._has_arrived():
            return action
        action = self._walk_on()
        if action is None:
            self.memory.avoid(self.memory.xz)
            self.choose(None)
        return action

    def insight(self, frontiers: Sequence[Frontier], *, note: str) -> Insight:
        """The map so far, the goal, and the agent's note about it."""
        memory, goal = self.memory, self.goal
        return Insight(
            grid=memory.grid,
            occupancy=memory.cells,
            frontiers=np.array([frontier.middle_xz for frontier in frontiers], float).reshape(-1, 2),
            goal=None if goal is None else (goal.place_xz[0], memory.floor_y, goal.place_xz[1]),
            note=note,
        )

    def _begun_before(self) -> Action | None:
        """The next action of a turn or forward that was begun; None if there is none or the map closed its way."""
        if self._begun:
            action = self._begun.pop()
            if action is not Action.FORWARD or self._is_open_ahead():
                return self._counted(action)
        return None

    def _has_arrived(self) -> bool:
        """Whether a forward would pass the goal's place; remembers when the robot last came nearer to it."""
        to_go = self._to_go()
        if to_go < self._best_to_go - _PROGRESS:
            self._best_to_go, self._nearer_at = to_go, self._step
        return to_go < _ARRIVED

    def _walk_on(self) -> Action | None:
        """The next action along the way; None if there is none or the robot comes no nearer."""
        action = self._walk() if math.isfinite(self._to_go()) else None
        if self._bumps >= _MOST_BUMPS or self._step - self._nearer_at > _PATIENCE:
            return None
        return action

    def _look(self, goal: Frontier) -> Action | None:
        """Faces the target, then looks down if it is near; if it stays unknown, the goal has failed."""
        away = wrap_angle(yaw_towards(self.memory.xz, goal.target_xz) - self.memory.yaw)
        if abs(away) > TURN_STEP / 2 + 1e-3:
            return Action.LEFT if away > 0 else Action.RIGHT
        distance = math.dist(self.memory.xz, goal.target_xz) / self.memory.grid.cell
        level = reach_of(self._camera, self.memory.grid.cell, can_look=self._can_look)[1]
        if self._can_look and distance < level and not self.memory.is_tilted:
            return Action.LOOK_DOWN
        self._leave(goal, for_steps=_LOOK_STEPS, has_looked=True)
        return None

    def _walk(self) -> Action | None:
        """The next turn or forward along the way; None where every heading is blocked."""
        assert self._way is not None
        ground = self._way.ground
        u, v = ground.grid.uv_from_xz(np.array(self.memory.xz))
        step = FORWARD_STEP / ground.grid.cell
        turns, cost = best_heading(
            ground.weights,
            self._way.to_go,
            float(u),
            float(v),
            self.memory.yaw,
            step,
            TURN_STEP,
            _STRAIGHT,
            _CLOSED_COST,
            self._extra(),
        )
        if not math.isfinite(cost):
            return None
        turn = Action.LEFT if turns > 0 else Action.RIGHT
        self._begun = [Action.FORWARD, *[Action.LOOK_UP] * self.memory.is_tilted, *[turn] * abs(turns)]
        return self._counted(self._begun.pop())

    def _counted(self, action: Action) -> Action:
        """Returns the action; remembers it if it is a forward."""
        if action is Action.FORWARD:
            self._tried[self._tried_key(0)] += 1
        return action

    def _is_open_ahead(self) -> bool:
        """Whether the map shows nothing in the way of a forward."""
        ahead = forward_from_yaw(self.memory.yaw)[[0, 2]]
        places = np.array(self.memory.xz) + np.array([[0.4], [0.8], [1.0]]) * FORWARD_STEP * ahead
        return all(self.memory.cell_at((float(x), float(z))) != OCCUPIED for x, z in places)

    def _tried_key(self, turns: int) -> tuple[int, int, int]:
        """Cell and direction of a forward after `turns` turns to the left."""
        x, z = self.memory.xz
        count = round(2 * math.pi / TURN_STEP)
        heading = (round(self.memory.yaw / TURN_STEP) + turns) % count
        return math.floor(x / _TRIED_CELL), math.floor(z / _TRIED_CELL), heading

    def _extra(self) -> NDArray[np.float64]:
        """(12,) extra cost of headings in actions, by turns to the left: earlier forwards and collisions near here."""
        count = round(2 * math.pi / TURN_STEP)
        cost = _TRIED_COSTS[self._dull_goals % len(_TRIED_COSTS)]
        found = np.array([cost * self._tried[self._tried_key(turns)] for turns in range(count)])
        walls = np.zeros(count, bool)
        for bump in self.memory.bumps:
            away = math.dist(bump.xz, self.memory.xz)
            if away >= _NEAR_PLACE:
                continue
            turns = round(wrap_angle(bump.yaw - self.memory.yaw) / TURN_STEP) % count
            found[turns] += _AGAIN_COST * (1 - away / _NEAR_PLACE)
            walls[turns] |= away < _SAME_PLACE
        if not walls.all():
            found[walls] = np.inf
        return found

    def _to_go(self) -> float:
        """Actions to the goal's place, without turns."""
        assert self.goal is not None
        here = np.array(self.memory.xz)
        if self._way is None or not self._way.ground.grid.contains(self._way.ground.grid.rc_from_xz(here)):
            ground = self.memory.ground()  # the robot may have left the part of the map that was planned on
            place = ground.grid.rc_from_xz(np.array([self.goal.place_xz]))
            row, col = ground.grid.rc_from_xz(here).tolist()
            to_go = spread_costs(ground.weights, place, np.zeros(1), math.inf, (row, col), _BEYOND)
            self._way = _Way(ground, to_go)
        row, col = self._way.ground.grid.rc_from_xz(here).tolist()
        near = self._way.to_go[max(row - 2, 0) : row + 3, max(col - 2, 0) : col + 3]  # closer than plans allow
        return float(near.min())

    def _leave(self, goal: Frontier, *, for_steps: int, has_looked: bool = False) -> None:
        """Ignores the cells of the goal's group near its target; it counts as a failure if they were looked at."""
        grid = self.memory.grid
        (row, col) = grid.rc_from_xz(np.array(goal.target_xz))
        reach = round((_LOOKED_RADIUS if has_looked else _BAN_RADIUS) / grid.cell)
        area = (slice(max(row - reach, 0), row + reach + 1), slice(max(col - reach, 0), col + reach + 1))
        if has_looked:
            self._failures[area] += 1
            times = np.maximum(self._failures[area].astype(np.int32), 1)
        else:
            times = 1 << self._misses[area].astype(np.int32)
            self._misses[area] = np.minimum(self._misses[area] + 1, _MOST_MISSES)
            self.memory.avoid(self.memory.xz)
        self._banned_until[area] = self._step + for_steps * times
        given_up = self._failures[area] >= _TRIES
        self._banned_until[area][given_up] = FOR_EVER
        self.choose(None)

    def _cut(self, image: NDArray[Any], ground: Ground) -> NDArray[Any]:
        """The part of an image of the whole grid that the ground covers."""
        rows, cols = ground.cells.shape
        row, col = self._corner(ground)
        return image[row : row + rows, col : col + cols]

    def _corner(self, ground: Ground) -> NDArray[np.int64]:
        """(2,) row and column of the ground's first cell on the whole grid."""
        return self.memory.grid.rc_from_xz(np.array(ground.grid.origin_xz) + ground.grid.cell / 2)


def require_picture(observation: Observation) -> None:
    """Refuses an observation without colours or depth, for agents that look for things.

    Raises:
        AgentError: It has none.
    """
    if observation.rgb is None or observation.depth_m is None:
        raise AgentError(
            f"step {observation.step}: the observation has no picture; expected colours and depth, from which the maps "
            "are made. Run this agent with a renderer."
        )
