"""habitat-lab's measures of a given trajectory, exactly (HABITAT_SEMANTICS.md, section 1); `rules` has PersONAL's own.

They differ from rule `habitat` of sim/tasks/rules.py where habitat-lab has no guard: here unreachable goals give inf
and nan, as they do in habitat-lab, and a start on the goal is refused, because habitat-lab itself fails on it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import RunFileError
from sim.types import Action
from sim.walk.navigation_map import NavigationMap

MOVED = 1e-4
"""habitat-lab updates the distance when np.allclose(..., atol=MOVED) says that the position changed (metres)."""


class HabitatMeasures(NamedTuple):
    """habitat-lab's report at the end of an episode, under its own names."""

    distance_to_goal: float
    """Geodesic metres to the nearest goal point; inf where unreachable."""
    success: float
    """1.0 when STOP was called strictly nearer than `success_distance`, else 0.0."""
    spl: float
    """Success * L / max(L, P); nan when the goal was unreachable at reset, even without success (0 * nan)."""
    soft_spl: float
    """max(0, 1 - distance / L) * L / max(L, P); nan when the goal was unreachable at reset."""
    num_steps: int
    """Number of actions taken, STOP included."""
    collisions: int
    """Number of forwards that a wall shortened."""


def distances_to_goal(positions: ArrayLike, goals: ArrayLike, *, navigation: NavigationMap) -> NDArray[np.float64]:
    """habitat-lab's distance_to_goal at reset and after each action.

    As in habitat-lab, the value is updated only when the position differs by more than np.allclose allows (atol 1e-4,
    rtol 1e-5) from the place of the last update. One thing is not imitated: within an episode habitat-lab keeps lower
    bounds of the goals' distances and may therefore miss the nearest of several; final measures of the golden data
    never show it.

    Args:
        positions: (T + 1, 3) the robot's feet at reset and after each action, world metres.
        goals: (N, 3) all view points or all goal positions; the nearest counts.
        navigation: The scene's map; a `NavMesh` gives Habitat's own distances.

    Returns:
        (T + 1,) metres, inf where unreachable.

    Raises:
        RunFileError: Shapes are not as described, or there is no goal.
    """
    places, ends = np.asarray(positions, float), np.asarray(goals, float)
    for name, array in (("positions", places), ("goals", ends)):
        if array.ndim != 2 or array.shape[1] != 3 or not len(array):
            raise RunFileError(f"{name}: found shape {array.shape}; expected (at least 1, 3). Give world points.")
    rows: list[int] = []
    for index, place in enumerate(places):
        if not rows or not np.allclose(places[rows[-1]], place, atol=MOVED):
            rows.append(index)
    measured = navigation.distances(places[rows], ends)
    return np.asarray(measured)[np.searchsorted(rows, np.arange(len(places)), side="right") - 1]


def habitat_measures(
    positions: ArrayLike,
    actions: Sequence[Action],
    collided: Sequence[bool],
    *,
    distances: ArrayLike,
    success_distance: float,
) -> HabitatMeasures:
    """All of habitat-lab's measures after the last action.

    STOP as the action that reaches the step limit counts, because habitat-lab measures before it tests the limit.

    Args:
        positions: (T + 1, 3) the robot's feet at reset and after each action, world metres.
        actions: (T,) STOP only as the last one.
        collided: (T,) the simulator's flag for each action.
        distances: (T + 1,) from `distances_to_goal`; the first is L.
        success_distance: Limit in metres; a distance equal to it is not a success.

    Raises:
        RunFileError: Lengths do not fit together, or STOP is not the last action.
        ZeroDivisionError: The start lies on a goal, L = 0: habitat-lab raises the same when the episode is reset.
    """
    places, left = np.asarray(positions, float), np.asarray(distances, float)
    _check_lengths(places, actions, collided, left)
    start, end = float(left[0]), float(left[-1])
    if start == 0:
        raise ZeroDivisionError("distance_to_goal is 0 at reset; habitat-lab divides by it and fails there too.")
    success = 1.0 if len(actions) and actions[-1] is Action.STOP and end < success_distance else 0.0
    # Python floats throughout, and max() with the 0 first: inf / inf is nan, and max(0, nan) is 0, as in habitat-lab.
    path_m = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    efficiency = start / max(start, path_m)
    return HabitatMeasures(
        distance_to_goal=end,
        success=success,
        spl=success * efficiency,
        soft_spl=max(0, 1 - end / start) * efficiency,
        num_steps=len(actions),
        collisions=sum(bool(flag) for flag in collided),
    )


def _check_lengths(
    positions: NDArray[np.float64], actions: Sequence[Action], collided: Sequence[bool], distances: NDArray[np.float64]
) -> None:
    """Raises RunFileError if the parts of a trajectory do not fit together."""
    count = len(actions)
    expected = {"positions": count + 1, "collided": count, "distances": count + 1}
    found = {"positions": len(positions), "collided": len(collided), "distances": len(distances)}
    wrong = [f"{found[name]} {name} (expected {expected[name]})" for name in found if found[name] != expected[name]]
    if wrong:
        raise RunFileError(f"trajectory of {count} actions: found {', '.join(wrong)}. Give one more pose than actions.")
    if Action.STOP in actions[:-1]:
        place = list(actions).index(Action.STOP)
        raise RunFileError(
            f"trajectory of {count} actions: found stop as action {place + 1}; expected it as the last one only. "
            "Cut the trajectory there."
        )
