"""A navigation map read from Habitat's `.navmesh`: distances, steps and snaps equal those of habitat-sim bit for bit.

Rules: HABITAT_SEMANTICS.md 2.2-2.4. Queries use float32 inside, as in Habitat.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.types import STOREY_GAP

from .navigation_map import Points, StepResult, TopDown
from .navmesh_file import NavMeshData, NavMeshSettings, read_navmesh
from .navmesh_kernels import project
from .navmesh_paths import lengths, polyline
from .navmesh_places import MAX_SPAN, cells_of, covered_cells, places_near, random_place, spanned_area
from .navmesh_polygons import island_radii, polygons_from_data, triangle_areas
from .navmesh_search import wall_distance
from .navmesh_steps import step
from .storeys import no_such_storey, same_storey, storey_levels

if TYPE_CHECKING:
    from sim.mesh import TriangleMesh

SETTINGS_TOLERANCE = 1e-5
"""Settings that differ by less than this are the same (habitat-sim)."""
_NAVIGABLE_ASIDE = np.float32(0.01)
"""A navigable point is at most this far from the mesh, seen from above (metres, habitat-sim)."""


class NavMesh:
    """Implements `NavigationMap` on Detour's polygons. Immutable; may be read from several threads.

    As in Habitat the surface lies up to one voxel (0.2 m) above the real floor; table tops, beds and roofs are islands.
    Distances count from the given points: one over the mesh keeps its own height, one beside it is moved to the edge of
    the nearest polygon at no cost. They may differ in the two directions.
    """

    def __init__(self, data: NavMeshData, *, mesh: "TriangleMesh | None" = None) -> None:
        """Use `load_navmesh`.

        Args:
            data: Content of the file.
            mesh: The scan, to tell roofs (nothing above them) from storeys; without it, large bare plates on top of
                everything count as roofs.

        Raises:
            SceneError: No polygon is walkable, or the polygons are larger than any home.
        """
        self.settings: NavMeshSettings = data.settings
        """Settings with which the mesh was built."""
        self.digest: str = data.digest
        """sha256 of the file."""
        self._polygons = polygons_from_data(data)
        if not (self._polygons.island >= 0).any():
            raise SceneError(
                f"{data.path}: found {len(data.counts)} polygons, none of them walkable; expected at least one. "
                "Remove the .navmesh file: then the map is made from the scan's mesh."
            )
        if (spanned := spanned_area(self._polygons)) > MAX_SPAN:
            raise SceneError(
                f"{data.path}: found polygons that span {spanned:.0f} m2; expected a home (at most {MAX_SPAN:.0f}). "
                "Check the file's unit."
            )
        self._radii = island_radii(self._polygons)
        self._cells = cells_of(self._polygons)
        self.storey_heights: tuple[float, ...] = storey_levels(*covered_cells(self._polygons, self._cells, mesh))

    @property
    def area(self) -> float:
        """Area of the surface of all islands in square metres (slopes count in full)."""
        return float(triangle_areas(self._polygons).sum())

    def fits(self, radius: float, height: float) -> bool:
        """Whether the mesh was built for a robot of this radius and height (metres).

        A file of version 1 does not say; it counts as built with Habitat's defaults (0.1, 1.5), as HM3D's files are.
        """
        return (
            abs(self.settings.agent_radius - radius) <= SETTINGS_TOLERANCE
            and abs(self.settings.agent_height - height) <= SETTINGS_TOLERANCE
        )

    def snap(self, point: Points) -> Points | None:
        """Nearest point (3,) of the mesh within the box of half extents (2, 4, 2) m; None if there is none.

        Over or under a polygon, a height difference up to one step (agent_max_climb) counts as no distance.
        """
        (polygon,), (found,) = self._project(point)
        return found.astype(np.float64) if polygon >= 0 else None

    def island(self, point: Points) -> int | None:
        """Number of the connected part that `point` snaps to; None if there is none."""
        (polygon,), _ = self._project(point)
        return int(self._polygons.island[polygon]) if polygon >= 0 else None

    def island_radius(self, point: Points) -> float:
        """Largest distance of the corners of `point`'s island from their mean, metres; 0 without an island."""
        island = self.island(point)
        return 0.0 if island is None else float(self._radii[island])

    def is_navigable(self, point: Points, *, max_dy: float = 0.5) -> bool:
        """Whether the nearest point of the mesh is within `max_dy` in height and within 1 cm seen from above."""
        (polygon,), (found,) = self._project(point)
        if polygon < 0:
            return False
        away = np.asarray(point, np.float32) - found
        aside = np.sqrt(away[0] * away[0] + away[2] * away[2])
        return bool(abs(away[1]) <= np.float32(max_dy) and aside <= _NAVIGABLE_ASIDE)

    def distance_to_obstacle(self, point: Points, *, max_radius: float = 2.0) -> float:
        """Planar metres from the snapped point to the nearest wall; `max_radius` if none is nearer, inf off the map."""
        return float(wall_distance(self._polygons, np.asarray(point, np.float32), np.float32(max_radius)))

    def step(self, start: Points, end: Points, *, slide: bool = False) -> StepResult:
        """The result of walking straight from `start` (3,) to `end` (3,), stopping at the first wall unless `slide`.

        The rule of habitat-sim <= 0.3.3: the walk begins at the snapped start, so a start off the mesh jumps onto it;
        the collision test counts from the given start. No move where an end is on no island, or on different islands.
        """
        found, collided = step(self._polygons, np.asarray(start, np.float32), np.asarray(end, np.float32), slide)
        return StepResult((float(found[0]), float(found[1]), float(found[2])), bool(collided))

    def distance(self, start: Points, goal: Points) -> float:
        """Geodesic metres from `start` (3,) to `goal` (3,); inf where unreachable."""
        return float(self.distances(np.asarray(start)[None], np.asarray(goal)[None])[0])

    def distances(self, starts: Points, goals: Points) -> NDArray[np.float64]:
        """Geodesic metres from each start (M, 3) to its nearest goal (N, 3); inf where unreachable. Returns (M,).

        Each start is computed on its own, as in the first call of `habitat_sim.PathFinder.find_path` with several ends.
        """
        return lengths(self._polygons, _rows(starts), _rows(goals))[0].astype(np.float64)

    def shortest_path(self, start: Points, goals: Points) -> Points | None:
        """Polyline (K, 3) from `start` (3,) to the nearest of `goals` (N, 3); None if unreachable.

        Its ends are the given points, moved to the edge of their polygon where they are not over it. A start on the
        goal gives two points.
        """
        begin, ends = _rows(start), _rows(goals)
        _, (nearest,) = lengths(self._polygons, begin, ends)
        return polyline(self._polygons, begin[0], ends[nearest]).astype(np.float64) if nearest >= 0 else None

    def points_within(self, centres: Points, radius: float, *, max_dy: float) -> Points:
        """Places (K, 3) to stand within planar `radius` of any centre (N, 3) and within `max_dy` of its y.

        They are the centres of 5 cm cells, and points at most 5 cm apart on walls and on the circles; the boundary
        counts as inside. (0, 3) when there are none.
        """
        centres = np.asarray(centres, float).reshape(-1, 3)
        found = [places_near(self._polygons, self._cells, c, radius=radius, max_dy=max_dy) for c in centres]
        return np.unique(np.concatenate([np.empty((0, 3)), *found]), axis=0)

    def random_point(self, rng: np.random.Generator, *, storey_y: float | None = None) -> Points:
        """A place (3,) uniform over the surface of all islands, as in Habitat (of one storey if its height is given).

        Raises:
            SceneError: The storey has no floor.
        """
        band = (-np.inf, np.inf) if storey_y is None else (storey_y - STOREY_GAP, storey_y + STOREY_GAP)
        place = random_place(self._polygons, rng, band=band)
        if place is None:
            raise no_such_storey(storey_y, self.storey_heights)
        return place

    def top_down(self, storey_y: float) -> TopDown:
        """Free space of the storey at this height: 5 cm cells less than STOREY_GAP above or below it."""
        free = np.zeros(self._cells.grid.shape, bool)
        on_storey = same_storey(self._cells.y, storey_y)
        free[self._cells.row[on_storey], self._cells.col[on_storey]] = True
        return TopDown(free, self._cells.grid, float(storey_y))

    def _project(self, point: Points) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """(polygon (1,), place (1, 3)) nearest to a point (3,)."""
        return project(self._polygons, np.asarray(point, np.float32)[None])


def load_navmesh(path: Path, *, mesh: "TriangleMesh | None" = None) -> NavMesh:
    """The navigation map of a `.navmesh` file of version 1 or 2; the scan `mesh` (world frame) tells roofs from
    storeys.

    Raises:
        SceneError: The file is missing, damaged, of another kind, or holds no floor.
    """
    return NavMesh(read_navmesh(path), mesh=mesh)


def _rows(points: Points) -> NDArray[np.float32]:
    """Points (N, 3) in Habitat's precision."""
    return np.ascontiguousarray(np.asarray(points, np.float32).reshape(-1, 3))
