"""The interface for places where a robot can stand and their distances; no caller knows which implementation it has."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.types import GridSpec

Points = NDArray[np.float64]


class StepResult(NamedTuple):
    """The end of a forward step."""

    position: tuple[float, float, float]
    """Feet, world metres."""
    collided: bool
    """Whether |moved|^2 + 1e-5 < |wanted|^2 (habitat-sim's rule)."""


class TopDown(NamedTuple):
    """One storey's free space seen from above."""

    free: NDArray[np.bool_]
    """(rows, cols), True where the robot's centre can be."""
    grid: GridSpec
    floor_y: float
    """Height of the storey, metres."""


class NavigationMap(Protocol):
    """Places where the robot's centre can be in a scene, and geodesic distances between them. World metres, y up."""

    @property
    def storey_heights(self) -> tuple[float, ...]:
        """Typical floor height of each storey, ascending; neighbours differ by at least STOREY_GAP."""
        ...

    def snap(self, point: Points) -> Points | None:
        """Nearest place (3,) to stand, searched within 2 m sideways and 4 m in height; None if there is none."""
        ...

    def is_navigable(self, point: Points, *, max_dy: float = 0.5) -> bool:
        """Whether the robot can stand at this x, z with its feet within `max_dy` of this y."""
        ...

    def step(self, start: Points, end: Points, *, slide: bool = False) -> StepResult:
        """The result of walking straight from `start` (3,) to `end` (3,), stopping at the first wall unless `slide`."""
        ...

    def distances(self, starts: Points, goals: Points) -> NDArray[np.float64]:
        """Geodesic metres from each start (M, 3) to its nearest goal (N, 3); inf where unreachable. Returns (M,)."""
        ...

    def shortest_path(self, start: Points, goals: Points) -> Points | None:
        """Polyline (K, 3) from `start` (3,) to the nearest of `goals` (N, 3); None if unreachable."""
        ...

    def points_within(self, centres: Points, radius: float, *, max_dy: float) -> Points:
        """Places (K, 3) to stand within planar `radius` of any centre (N, 3) and within `max_dy` of its y.

        The places are dense (5 cm or finer); the boundary counts as inside. (0, 3) when there are none.
        """
        ...

    def random_point(self, rng: np.random.Generator, *, storey_y: float | None = None) -> Points:
        """A place (3,) to stand, uniform over the free area (of one storey if its height is given).

        A map made from cells or a mesh leaves out islands that belong to no storey, such as tops of beds. A `.navmesh`
        draws from all islands, as Habitat does.
        """
        ...

    def top_down(self, storey_y: float) -> TopDown:
        """Free space of the storey at this height."""
        ...
