"""The any-angle distance field of a floor grid and the taut paths that it gives. Units: see grid_kernels."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit

from .grid_kernels import INSET, length, pop, push, walk


class Field(NamedTuple):
    """Any-angle distances from a set of goals. Anchors are nodes (0..N-1) and goals (N..N+G-1)."""

    distance: NDArray[np.float64]
    """(N,) grid units from each node's centre to its nearest goal, inf where unreachable."""
    parent: NDArray[np.int32]
    """(N,) anchor towards the goal, reachable in a straight line; -1 where the goal is unreachable."""
    goal_u: NDArray[np.float64]
    goal_v: NDArray[np.float64]
    goal_h: NDArray[np.float64]
    """(G,) height of the goal for path lengths, which may be above its floor."""
    goal_node: NDArray[np.int32]
    """(G,) node of each goal, ascending."""


@njit(cache=True, nogil=True)
def _anchor(cells, field, anchor):
    """(u, v, h, node, distance to go) of an anchor."""
    count = len(cells.row)
    if anchor >= count:
        goal = anchor - count
        return field.goal_u[goal], field.goal_v[goal], field.goal_h[goal], field.goal_node[goal], 0.0
    return cells.col[anchor] + 0.5, cells.row[anchor] + 0.5, cells.h[anchor], np.int32(anchor), field.distance[anchor]


@njit(cache=True, nogil=True)
def spread(cells, field):
    """Fills an empty field (distance inf, parent -1) by Dijkstra; a node takes its parent's parent when it sees it."""
    count = len(cells.row)
    distance, parent = field.distance, field.parent
    keys = np.empty(8 * count + len(field.goal_node) + 1)
    values = np.empty(len(keys), np.int32)
    closed = np.zeros(count, np.bool_)
    size = 0
    for goal in range(len(field.goal_node)):
        node = field.goal_node[goal]
        u, v = cells.col[node] + 0.5, cells.row[node] + 0.5
        away = length(field.goal_u[goal], field.goal_v[goal], field.goal_h[goal], u, v, cells.h[node])
        if away < distance[node]:
            distance[node], parent[node] = away, count + goal
            size = push(keys, values, size, away, node)
    while size:
        node, size = pop(keys, values, size)
        if closed[node]:
            continue
        closed[node] = True
        node_u, node_v = cells.col[node] + 0.5, cells.row[node] + 0.5
        from_u, from_v, from_h, from_node, to_go = _anchor(cells, field, parent[node])
        for side in range(8):
            other = cells.links[node, side]
            if other < 0 or closed[other]:
                continue
            u, v, h = cells.col[other] + 0.5, cells.row[other] + 0.5, cells.h[other]
            total = to_go + length(from_u, from_v, from_h, u, v, h)
            if total >= distance[other]:
                continue
            via = parent[node]
            if walk(cells, from_u, from_v, from_node, u, v)[0] != other:
                via = node
                total = distance[node] + length(node_u, node_v, cells.h[node], u, v, h)
                if total >= distance[other]:
                    continue
            distance[other], parent[other] = total, via
            size = push(keys, values, size, total, other)


@njit(cache=True, nogil=True)
def _first_anchor(cells, field, u, v, h, node):
    """The first anchor on the way from a point, -1 if no goal can be reached."""
    count = len(cells.row)
    best, found = math.inf, -1
    for side in range(-1, 8):
        near = node if side < 0 else cells.links[node, side]
        if near < 0 or field.parent[near] < 0:
            continue
        goal = np.searchsorted(field.goal_node, near)
        while goal < len(field.goal_node) and field.goal_node[goal] == near:
            goal_u, goal_v = field.goal_u[goal], field.goal_v[goal]
            is_same = near == node and goal_u == u and goal_v == v
            total = 0.0 if is_same else length(u, v, h, goal_u, goal_v, field.goal_h[goal])
            if total < best and walk(cells, u, v, node, goal_u, goal_v)[0] == near:
                best, found = total, count + goal
            goal += 1
        for anchor in (field.parent[near], near):
            to_u, to_v, to_h, to_node, to_go = _anchor(cells, field, anchor)
            total = to_go + length(u, v, h, to_u, to_v, to_h)
            if total < best and walk(cells, u, v, node, to_u, to_v)[0] == to_node:
                best, found = total, anchor
    return found


@njit(cache=True, nogil=True)
def _pull(cells, at, nodes):
    """Removes corners of a polyline whose neighbours see each other, in place."""
    i = 1
    while i < len(at) - 1:
        if walk(cells, at[i - 1][0], at[i - 1][1], nodes[i - 1], at[i + 1][0], at[i + 1][1])[0] == nodes[i + 1]:
            at.pop(i)
            nodes.pop(i)
            i = max(i - 1, 1)
        else:
            i += 1


@njit(cache=True, nogil=True)
def _into_corners(cells, at, nodes):
    """Moves corners of a polyline from cell centres to the cell's corner that makes it shortest, in place."""
    moved = False
    for i in range(1, len(at) - 1):
        here = nodes[i]
        (u0, v0, h0), (u1, v1, h), (u2, v2, h2) = at[i - 1], at[i], at[i + 1]
        best = length(u0, v0, h0, u1, v1, h) + length(u1, v1, h, u2, v2, h2)
        for k in range(4):
            u = cells.col[here] + (INSET if k % 2 else 1 - INSET)
            v = cells.row[here] + (INSET if k // 2 else 1 - INSET)
            total = length(u0, v0, h0, u, v, h) + length(u, v, h, u2, v2, h2)
            if total >= best or walk(cells, u0, v0, nodes[i - 1], u, v)[0] != here:
                continue
            if walk(cells, u, v, here, u2, v2)[0] == nodes[i + 1]:
                best, at[i], moved = total, (u, v, h), True
    return moved


@njit(cache=True, nogil=True)
def trace(cells, field, u, v, h, node):
    """Taut polyline from a point to its nearest goal: lists of (u, v, h) and of nodes; empty if unreachable."""
    at, nodes = [(u, v, h)], [node]
    anchor = _first_anchor(cells, field, u, v, h, node)
    if anchor < 0:
        at.pop()
        nodes.pop()
        return at, nodes
    while True:
        to_u, to_v, to_h, to_node, _ = _anchor(cells, field, anchor)
        at.append((to_u, to_v, to_h))
        nodes.append(to_node)
        if anchor >= len(cells.row):
            break
        anchor = field.parent[anchor]
    _pull(cells, at, nodes)
    if _into_corners(cells, at, nodes):
        _pull(cells, at, nodes)
    return at, nodes


@njit(cache=True, nogil=True)
def path_to_goal(cells, field, u, v, h, node):
    """(K, 2) of u, v and nodes (K,) of the traced path; K = 0 if unreachable."""
    at, nodes = trace(cells, field, u, v, h, node)
    points, on = np.empty((len(at), 2)), np.empty(len(at), np.int32)
    for i in range(len(at)):
        points[i, 0], points[i, 1], on[i] = at[i][0], at[i][1], nodes[i]
    return points, on


@njit(cache=True, nogil=True)
def lengths_to_goals(cells, field, u, v, h, nodes):
    """(M,) lengths in grid units of the traced paths of points on nodes; inf where the node is -1 or unreachable."""
    lengths = np.full(len(u), math.inf)
    for i in range(len(u)):
        if nodes[i] < 0 or field.parent[nodes[i]] < 0:
            continue
        at, on = trace(cells, field, u[i], v[i], h[i], nodes[i])
        if len(at) == 0:
            continue
        lengths[i] = 0.0
        if len(at) == 2 and on[0] == on[1] and at[0][0] == at[1][0] and at[0][1] == at[1][1]:
            continue
        for k in range(len(at) - 1):
            lengths[i] += length(*at[k], *at[k + 1])
    return lengths
