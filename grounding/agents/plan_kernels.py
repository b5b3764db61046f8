"""Compiled loops over the cells of a robot's own map: path costs, places to look from, and the next heading.

Cells are (row, col); u = column axis and v = row axis in cells with fractions; costs are counted in actions.
"""

import math

import numpy as np

from sim.compiled import njit
from sim.walk.grid_kernels import pop, push

_DIAGONAL = math.sqrt(2.0)
FREE, OCCUPIED = 1, 2
"""The values of sim.tasks.observers; compiled loops cannot import values that may change."""
_AWAY_COST = 20.0
"""Extra cost, in actions, of a way that leads no nearer: the last resort in a tight place."""
_MOST_NODES = 3000
"""Most poses that the search for a heading visits."""
_FINE = 2
"""Poses in the same part of a cell, with this many parts along a side, and with the same heading count as one."""
_SAMPLES = 4
"""A forward is tried at this many places per cell, so that it cuts no corner."""
_LEAST_MOVE, _BUMP_COST = 1, 1.0
"""A forward may meet something if it moves this many cells before; that costs so many more actions."""
_AT_GOAL = 0.8
"""A pose this few actions from the goal has arrived."""
_UNKNOWN_DEPTH = 3
"""A ray from an unknown cell must reach known free floor within this many cells."""


@njit(cache=True, nogil=True)
def weigh(cells, assumed, cell, clearance, cost):
    """(rows, cols) factor by which a way's length counts in each cell: more near things, inf too near, nan in things.

    Args:
        cells: (rows, cols) UNKNOWN, FREE or OCCUPIED.
        assumed: (rows, cols) the same, with some unknown floor counted as free.
        cell: Side of a cell, metres.
        clearance: Metres from a blocked cell's middle within which the robot's centre cannot be.
        cost: (times, fades, unknown, tight, more): 1 + times * exp(-d / fades) where the next thing is d metres away,
            multiplied by `unknown` in an unknown cell; up to `more` is added where d is below `tight`.
    """
    rows, cols = cells.shape
    away = np.full((rows, cols), np.int32(1_000_000))  # fifths of a cell: chamfer distance 5-7-11, 2 % off at most
    moves = ((-1, 0, 5), (-1, -1, 7), (-1, 1, 7), (0, -1, 5), (-1, -2, 11), (-1, 2, 11), (-2, -1, 11), (-2, 1, 11))
    for sign in (1, -1):
        for i in range(rows):
            r = i if sign == 1 else rows - 1 - i
            for j in range(cols):
                c = j if sign == 1 else cols - 1 - j
                if cells[r, c] == OCCUPIED:
                    away[r, c] = 0
                    continue
                best = away[r, c]
                for dr, dc, length in moves:
                    from_r, from_c = r + sign * dr, c + sign * dc
                    if 0 <= from_r < rows and 0 <= from_c < cols:
                        best = min(best, away[from_r, from_c] + length)
                away[r, c] = best
    factor = np.empty((rows, cols))
    for r in range(rows):
        for c in range(cols):
            d = away[r, c] * 0.2 * cell
            if cells[r, c] == OCCUPIED:
                factor[r, c] = math.nan
            elif d < clearance or assumed[r, c] != FREE:
                factor[r, c] = math.inf
            else:
                near, known = cost[0] * math.exp(-d / cost[1]), 1.0 if cells[r, c] == FREE else cost[2]
                factor[r, c] = (1 + near) * known + cost[4] * max(0.0, 1 - d / cost[3])
    return factor


@njit(cache=True, nogil=True)
def spread_costs(weights, source_rc, source_cost, most=math.inf, until_rc=(-1, -1), beyond=0.0):
    """(rows, cols) cost of the cheapest way from the sources, inf where there is none: Dijkstra over 8 neighbours.

    Args:
        weights: (rows, cols) cost of crossing a cell from side to side, inf where it is blocked.
        source_rc: (S, 2) cells to begin with; a blocked one is left out.
        source_cost: (S,) their costs.
        most: Cells that cost more are left out.
        until_rc: Once this cell (row, col) is reached, only cells that cost at most `beyond` more are added.
        beyond: Extra cost, in actions.
    """
    rows, cols = weights.shape
    costs = np.full((rows, cols), math.inf)
    keys = np.empty(8 * rows * cols + len(source_rc) + 1)
    values = np.empty(len(keys), np.int32)
    size = 0
    for k in range(len(source_rc)):
        r, c = source_rc[k]
        if math.isfinite(weights[r, c]) and source_cost[k] < costs[r, c]:
            costs[r, c] = source_cost[k]
            size = push(keys, values, size, source_cost[k], r * cols + c)
    closed = np.zeros((rows, cols), np.bool_)
    while size:
        at, size = pop(keys, values, size)
        r, c = at // cols, at % cols
        if closed[r, c]:
            continue
        if costs[r, c] > most:
            break
        if abs(r - until_rc[0]) <= 2 and abs(c - until_rc[1]) <= 2:
            most = min(most, costs[r, c] + beyond)
        closed[r, c] = True
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                to_r, to_c = r + dr, c + dc
                if to_r < 0 or to_c < 0 or to_r >= rows or to_c >= cols or closed[to_r, to_c]:
                    continue
                if not math.isfinite(weights[to_r, to_c]):
                    continue
                is_diagonal = dr != 0 and dc != 0
                if is_diagonal and not (math.isfinite(weights[r, to_c]) and math.isfinite(weights[to_r, c])):
                    continue  # never cut a corner
                length = _DIAGONAL if is_diagonal else 1.0
                total = costs[r, c] + length * 0.5 * (weights[r, c] + weights[to_r, to_c])
                if total < costs[to_r, to_c]:
                    costs[to_r, to_c] = total
                    size = push(keys, values, size, total, to_r * cols + to_c)
    for r in range(rows):
        for c in range(cols):
            if not closed[r, c]:
                costs[r, c] = math.inf
    return costs


@njit(cache=True, nogil=True)
def best_views(
    targets, farthest, groups, num_groups, cells, costs, robot, reach, turn_step, look_cost, here, is_tilted
):
    """For each group of unknown cells the cheapest place from which one of them can be seen.

    Args:
        targets: (T, 2) unknown cells beside known free ones.
        farthest: (T,) largest distance in cells from which each may be looked at.
        groups: (T,) group of each target.
        num_groups: Number of groups, G.
        cells: (rows, cols) UNKNOWN, FREE or OCCUPIED.
        costs: (rows, cols) actions to get there, inf where the robot cannot.
        robot: Its column and row with fractions, and its yaw.
        reach: (nearest with the camera down, nearest with it level) in cells.
        turn_step: Radians of one turn.
        look_cost: Actions for looking down and up again.
        here: Cells that cost less count as the robot's own place.
        is_tilted: Whether the camera looks down now; then it may stay down while the robot only turns.

    Returns:
        cost (G,), inf where there is no such place; place (G, 2); target (G, 2).
    """
    rows, cols = cells.shape
    best = np.full(num_groups, math.inf)
    place = np.zeros((num_groups, 2), np.int64)
    target = np.zeros((num_groups, 2), np.int64)
    num_rays = 48
    for t in range(len(targets)):
        g = groups[t]
        for ray in range(num_rays):
            angle = 2 * math.pi * ray / num_rays
            dr, dc = math.sin(angle), math.cos(angle)
            # the robot stands along the ray and looks back: forward of yaw a is (-sin a, -cos a) in (u, v)
            facing = math.atan2(dc, dr)
            turns_here = _turns(facing - robot[2], turn_step)
            for k in range(1, int(farthest[t]) + 1):
                r, c = round(targets[t, 0] + k * dr), round(targets[t, 1] + k * dc)
                if r < 0 or c < 0 or r >= rows or c >= cols or cells[r, c] == OCCUPIED:
                    break
                if cells[r, c] != FREE and k > _UNKNOWN_DEPTH:
                    break
                if k < reach[0] or not costs[r, c] < best[g]:
                    continue
                is_here = costs[r, c] < here
                look = 0.0 if is_here and is_tilted else look_cost if k < reach[1] else 0.0
                if is_here:
                    total = turns_here + look
                else:
                    along = math.atan2(robot[0] - c - 0.5, robot[1] - r - 0.5)
                    turns = _turns(along - robot[2], turn_step) + _turns(facing - along, turn_step)
                    total = costs[r, c] + turns + look + (1.0 if is_tilted else 0.0)
                if total < best[g]:
                    best[g] = total
                    place[g, 0], place[g, 1] = r, c
                    target[g, 0], target[g, 1] = targets[t, 0], targets[t, 1]
    return best, place, target


@njit(cache=True, nogil=True)
def _turns(angle, turn_step):
    """Approximate number of turns by this angle; half a turn less, because the target need not be exactly ahead."""
    away = abs((angle + math.pi) % (2 * math.pi) - math.pi)
    return max(0.0, away - 0.5 * turn_step) / turn_step


@njit(cache=True, nogil=True)
def best_heading(weights, to_go, u, v, yaw, step, turn_step, most_forwards, closed_cost, extra):
    """(turns, cost): how far to turn first (positive = left) for the turns and forwards that lead best to the goal.

    A search over the robot's own moves, because in a narrow passage no straight way is long: A* from its pose, with
    `to_go` as the bound, until a way of `most_forwards` forwards or to the goal is the cheapest.

    Args:
        weights: (rows, cols) as for `spread_costs`; nan in cells not to be crossed even to leave a tight place.
        to_go: (rows, cols) actions from each cell to the goal.
        u: Robot's column, with fraction.
        v: Robot's row, with fraction.
        yaw: Robot's heading, radians.
        step: Length of one forward in cells.
        turn_step: Radians of one turn.
        most_forwards: Most forwards of a way.
        closed_cost: Actions to cross a blocked cell; a robot that stands in one may do so for one forward.
        extra: (num_turns,) extra cost of headings in actions, by turns to the left of the current one; inf = forbidden.

    Returns:
        Cost is inf where every heading is blocked; a way that leads away is chosen where none leads nearer.
    """
    num_turns = round(2 * math.pi / turn_step)
    side = 2 * _FINE * (int(most_forwards * step) + 2)
    was_at = np.zeros((side, side, num_turns), np.bool_)
    nodes = np.empty((_MOST_NODES, 6))  # column, row, cost, heading in turns from now, first turns, forwards
    nodes[0] = np.array([u, v, 0.0, 0.0, 0.0, 0.0])
    keys, values = np.empty(_MOST_NODES), np.empty(_MOST_NODES, np.int32)
    count, size = 1, push(keys, values, 0, 0.0, 0)
    best, best_turns = math.inf, 0
    while size:
        node, size = pop(keys, values, size)
        at_u, at_v, gone, heading, first, forwards = [nodes[node, i] for i in range(6)]
        left = to_go[int(at_v), int(at_u)]
        if node and (forwards >= most_forwards or left < _AT_GOAL):
            return int(first), gone + left
        for order in range(num_turns):
            turns = (order + 1) // 2 * (1 if order % 2 else -1)
            facing = (int(heading) + turns) % num_turns
            cost = gone + abs(turns) + (0.0 if node else extra[facing])
            if not math.isfinite(cost) or count == _MOST_NODES:
                continue
            walked, entered, moved = _walked(weights, to_go, at_u, at_v, yaw + facing * turn_step, step, closed_cost)
            first_turns = int(first) if node else turns
            if not entered:  # to leave a place where everything is blocked
                if cost + walked + 3 * _AWAY_COST < best:
                    best, best_turns = cost + walked + 3 * _AWAY_COST, first_turns
                continue
            to_u = at_u - moved * math.sin(yaw + facing * turn_step)
            to_v = at_v - moved * math.cos(yaw + facing * turn_step)
            fine = int(_FINE * (to_v - v) + side // 2), int(_FINE * (to_u - u) + side // 2)
            if was_at[fine[0], fine[1], facing]:
                continue
            was_at[fine[0], fine[1], facing] = True
            cost, left = cost + walked, to_go[int(to_v), int(to_u)]
            total = cost + left + (0.0 if left < to_go[int(v), int(u)] - 0.1 else _AWAY_COST)
            if total < best - 1e-9:
                best, best_turns = total, first_turns
            nodes[count] = np.array([to_u, to_v, cost, facing, first_turns, forwards + 1])
            size, count = push(keys, values, size, cost + left, count), count + 1
    return best_turns, best


@njit(cache=True, nogil=True)
def _walked(weights, to_go, u, v, angle, step, closed_cost):
    """(cost, entered, moved): actions of one forward, whether it ends where plans may be, and how far it gets (cells).

    A forward that meets something ends before it, at an extra cost; the cost is inf where it does not move.
    """
    rows, cols = weights.shape
    du, dv = -math.sin(angle) / _SAMPLES, -math.cos(angle) / _SAMPLES
    entered, walked = math.isfinite(to_go[int(v), int(u)]), 0.0
    for k in range(1, int(step * _SAMPLES) + 1):
        r, c = math.floor(v + k * dv), math.floor(u + k * du)
        is_inside = 0 <= r < rows and 0 <= c < cols
        if is_inside and math.isfinite(to_go[r, c]) and not math.isnan(weights[r, c]):
            entered = True
            walked += weights[r, c] / _SAMPLES
        elif is_inside and not entered and not math.isnan(weights[r, c]):
            walked += closed_cost / _SAMPLES
        elif entered and k > _LEAST_MOVE * _SAMPLES:
            moved = (k - 1) / _SAMPLES
            return walked + _BUMP_COST + 1 - moved / step, True, moved
        else:
            return math.inf, False, 0.0
    return walked, entered, step
