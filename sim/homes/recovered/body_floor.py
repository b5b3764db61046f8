"""The floor that a robot's body leaves: places for its centre, and gaps between them that are too narrow for a wall.

A home has floor wherever the body covers it, and a map of that floor keeps the body's radius from every wall. Such a
map of a floor for the centre is its closing by the body (a morphological closing), so the floor is closed at once.
"""

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec
from sim.walk.storeys import nearest_storey

from ..cells import Cells
from ..images import distance_to

_RADIUS = 5.1
"""Radius of the closing (cells): BODY and one cell, so that walls between two places are at least two cells thick."""
_RIM = 10
"""Cells around changed floor whose closing may change: _RADIUS twice, in whole cells."""
_MARGIN = 2 * _RIM
"""Cells around changed floor that have a say in that: floor up to _RIM cells from the rim."""

Mask = NDArray[np.bool_]
Nodes = NDArray[np.int64]


class BodyFloor:
    """Closes sets of nodes by the body, each storey on its own; of several nodes in a column the highest counts."""

    def __init__(self, cells: Cells, floors_y: list[float], *, grid: GridSpec) -> None:
        """Takes the nodes (N,) and the heights of the storeys' floors (S,), metres."""
        rows, cols = grid.shape
        self._layer = nearest_storey(cells.y, floors_y)
        self._rc = cells.rc + _MARGIN
        shape = (len(floors_y), rows + 2 * _MARGIN, cols + 2 * _MARGIN)
        self._node = np.full(shape, -1, np.int64)
        order = np.argsort(cells.y, kind="stable")
        self._node[self._layer[order], self._rc[order, 0], self._rc[order, 1]] = order

    def closed(self, is_floor: Mask) -> Mask:
        """The nodes (N,) of a floor and of its narrow gaps."""
        found = is_floor.copy()
        for nodes in self._node:
            found[_closed_nodes(nodes, is_floor)] = True
        return found

    def added(self, is_floor: Mask, nodes: Nodes) -> Nodes:
        """The nodes of `is_floor` that it gains by closing around some `nodes` of it, and these."""
        parts = [nodes]
        for layer in np.unique(self._layer[nodes]).tolist():
            rc = self._rc[nodes[self._layer[nodes] == layer]]
            (top, left), (bottom, right) = rc.min(axis=0), rc.max(axis=0)
            window = self._node[layer, top - _MARGIN : bottom + _MARGIN + 1, left - _MARGIN : right + _MARGIN + 1]
            parts.append(_closed_nodes(window, is_floor, rim=_RIM))
        return np.unique(np.concatenate(parts))


def _closed_nodes(nodes: Nodes, is_floor: Mask, *, rim: int = 0) -> Nodes:
    """Nodes of an image (rows, cols; -1 = none) in the closing of the floor, without those at its rim."""
    floor = (nodes >= 0) & is_floor[nodes]
    if not floor.any():
        return np.zeros(0, np.int64)
    covered = distance_to(floor) <= _RADIUS
    inside = covered if covered.all() else distance_to(~covered) > _RADIUS
    part = np.s_[rim : nodes.shape[0] - rim, rim : nodes.shape[1] - rim]
    return nodes[part][(inside & (nodes >= 0))[part]]
