"""Log where an episode's targets are, from where STOP succeeds, and the shortest way there: a recording's last act."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from sim.episodes.schema import Episode
from sim.tasks.rules import success_radius, success_region
from sim.walk.navigation_map import NavigationMap

from . import paths
from .log_maps import POINT, StoreyMap, storeys_of
from .log_run import LIFT, Rgb

GOAL_RGB: Rgb = (255, 60, 60)
PLACE_RGB: Rgb = (255, 190, 190)
PATH_RGB: Rgb = (255, 120, 120)
RIM, WAY = -1.2, -1.5
"""Radii; negative = points of the screen."""
PLACE = 0.03
"""Radius of a place to stand, metres: places are 5 cm apart and fill their area."""
_RIM_ANGLES = np.linspace(0, 2 * np.pi, 65)


@dataclass(frozen=True, slots=True)
class GoalRegion:
    """The truth of an episode as the success rule `paper` sees it; M targets."""

    names: tuple[str, ...]
    """(M,) object names."""
    centres: NDArray[np.float64]
    """(M, 3) world metres."""
    floors_y: NDArray[np.float64]
    """(M,) height of each target's floor."""
    storeys: NDArray[np.int64]
    """(M,) index of each target's storey."""
    radii: NDArray[np.float64]
    """(M,) largest planar distance that succeeds: 1 m, 1.5 m where relaxed."""
    places: NDArray[np.float64]
    """(K, 3) places to stand from which STOP succeeds."""
    place_storeys: NDArray[np.int64]
    """(K,) index of each place's storey."""
    path: NDArray[np.float64] | None
    """(P, 3) shortest path from the start to the nearest place; None where none can be reached."""
    path_storeys: NDArray[np.int64]
    """(P,) index of the storey of each of its corners; (0,) without a path."""

    @property
    def rims(self) -> NDArray[np.float64]:
        """(M, 65, 3) the closed circle around each target's centre, on its floor."""
        ring = np.stack([np.cos(_RIM_ANGLES), np.zeros(len(_RIM_ANGLES)), np.sin(_RIM_ANGLES)], axis=1)
        feet = np.column_stack([self.centres[:, 0], self.floors_y, self.centres[:, 2]])
        return feet[:, None] + self.radii[:, None, None] * ring


def goal_region(episode: Episode, navigation: NavigationMap) -> GoalRegion:
    """The targets of an episode, their success region and the shortest path to it on the scene's map."""
    places = success_region(episode, navigation)
    path = navigation.shortest_path(np.array(episode.start.position), places) if len(places) else None
    floors_y = np.array([target.floor_y for target in episode.targets], float)
    return GoalRegion(
        names=tuple(target.object_name for target in episode.targets),
        centres=np.array([target.position for target in episode.targets], float),
        floors_y=floors_y,
        storeys=storeys_of(floors_y, navigation),
        radii=np.array([success_radius(target) for target in episode.targets]),
        places=places,
        place_storeys=storeys_of(places[:, 1], navigation),
        path=path,
        path_storeys=storeys_of(np.empty(0) if path is None else path[:, 1], navigation),
    )


def log_goal(stream: rr.RecordingStream, goal: GoalRegion, maps: Sequence[StoreyMap]) -> None:
    """Logs the goal below `/goal` at the stream's present time, which must be the end of all that is shown."""
    up = np.array([0.0, LIFT, 0.0])
    centres = rr.Points3D(goal.centres, colors=[GOAL_RGB], radii=0.14, labels=goal.names)
    stream.log(f"{paths.GOAL}/centre", centres)
    stream.log(f"{paths.GOAL}/region", rr.LineStrips3D(list(goal.rims + up), colors=[GOAL_RGB], radii=RIM))
    stream.log(f"{paths.GOAL}/places", rr.Points3D(goal.places + up / 2, colors=[PLACE_RGB], radii=PLACE))
    if goal.path is not None:
        stream.log(f"{paths.GOAL}/path", rr.LineStrips3D([goal.path + up], colors=[PATH_RGB], radii=WAY))
    for storey in maps:
        _log_on_map(stream, goal, storey)


def _log_on_map(stream: rr.RecordingStream, goal: GoalRegion, storey: StoreyMap) -> None:
    entity = f"{paths.GOAL}/map/{storey.part}"
    here = goal.storeys == storey.index
    labels = [name for name, is_here in zip(goal.names, here, strict=True) if is_here]
    spots = storey.pixels(goal.centres[here])
    stream.log(entity, rr.Points2D(spots, colors=[GOAL_RGB], radii=POINT, labels=labels, draw_order=60.0))
    rims = storey.pixels(goal.rims[here])
    stream.log(f"{entity}/region", rr.LineStrips2D(list(rims), colors=[GOAL_RGB], radii=RIM, draw_order=55.0))
    places = storey.pixels(goal.places[goal.place_storeys == storey.index])
    stream.log(
        f"{entity}/places", rr.Points2D(places, colors=[PLACE_RGB], radii=PLACE / storey.grid.cell, draw_order=10.0)
    )
    if goal.path is not None:
        here = goal.path_storeys == storey.index
        corners = storey.pixels(goal.path)
        pieces = np.stack([corners[:-1], corners[1:]], axis=1)[here[:-1] & here[1:]]
        stream.log(f"{entity}/path", rr.LineStrips2D(list(pieces), colors=[PATH_RGB], radii=WAY, draw_order=54.0))
