"""Reasons why a POG answer failed, from its place among the home's objects and from the grounder's computed layers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Episode, Goal
from sim.frames import planar_distance
from sim.tasks.rules import SUCCESS_RADIUS
from sim.tasks.run_files import Answer
from sim.walk.storeys import storey_of

from ..maps.home_map import ObjectMap
from ..types import TIE
from .asked_again import AnswerAgain

FailureKind = Literal[
    "no answer", "another storey", "near miss", "another instance", "another object", "nothing known there"
]
KINDS: dict[FailureKind, str] = {
    "no answer": "the grounder gave no point",
    "another storey": "no right object is on the answer's storey",
    "near miss": "1 to 2 m from a right object",
    "another instance": "an object of the right category that is not the owner's",
    "another object": "an object of another category",
    "nothing known there": "no object of the data set within 1 m",
}
"""Kinds of failure and their meaning, in order: the first that fits counts."""
NEAR_MISS = 2.0
"""Largest distance of a near miss, metres; the smallest is SUCCESS_RADIUS."""


@dataclass(frozen=True, slots=True)
class Failure:
    """One answer that is wrong."""

    kind: FailureKind
    distance: float
    """Planar metres to the nearest right object on the answer's storey; inf if there is none."""
    object_name: str
    """The data set's object nearest to the answer, within SUCCESS_RADIUS; "" when there is none."""


def failure_of(
    episode: Episode, answer: Answer, *, goals: Sequence[Goal], storeys: Sequence[tuple[float, float]]
) -> Failure:
    """The kind of failure of an answer.

    Args:
        answer: An answer that failed according to its measures.
        storeys: From `scene_storeys`.
    """
    if not answer.candidates:
        return Failure("no answer", math.inf, "")
    point = answer.candidates[0]
    distance = math.inf if answer.measures is None else answer.measures.planar_distance
    distance = math.inf if distance is None else distance
    here = [goal for goal in goals if storey_of(goal.floor_y, storeys) == storey_of(point[1], storeys)]
    # names one of the things within a metre: the right category comes before a nearer thing of another one
    near = [goal for goal in here if planar_distance(point, goal.position) <= SUCCESS_RADIUS]
    same = [goal for goal in near if goal.object_category == episode.record.object_category]
    nearest = min(
        same or near, key=lambda goal: (planar_distance(point, goal.position), goal.object_name), default=None
    )
    name = nearest.object_name if nearest else ""
    if math.isinf(distance):
        return Failure("another storey", distance, name)
    if distance <= NEAR_MISS:
        return Failure("near miss", distance, name)
    if same:
        return Failure("another instance", distance, name)
    return Failure("another object" if near else "nothing known there", distance, name)


def reasons(episode: Episode, again: AnswerAgain) -> list[str]:
    """Sentences about the failure from the grounder's own layers; empty where they show nothing."""
    if again.grounding is None or again.memory is None:
        return [f"The method {again.problem}."] if again.problem else []
    near = _near_targets(episode, _places_xz(again))
    if not near.any():
        what = "object" if isinstance(again.memory, ObjectMap) else "cell"
        return [f"The right object is not on the map: no {what} of it lies within {SUCCESS_RADIUS:g} m."]
    layers = again.grounding.layers
    if layers is None or len(layers.final) != len(near):
        return []
    best, top = float(layers.final[near].max()), float(layers.final.max(initial=-np.inf))
    if not np.isfinite(best):
        return ["The phrases' gate is closed around the right object."]
    if best >= top - TIE:
        ties = int((layers.final >= top - TIE).sum())
        return [f"A tie: the right place scores as high as the answer ({ties} places do), the first of them wins."]
    rank = int((layers.final > best + TIE).sum()) + 1
    scored = int(np.isfinite(layers.final).sum())
    return [f"The right place is {rank}. of {scored}, with {best:.3f} against {top:.3f}."]


def _places_xz(again: AnswerAgain) -> NDArray[np.float64]:
    """(N, 2) middles of the map's cells or objects."""
    assert again.memory is not None
    if isinstance(again.memory, ObjectMap):
        return again.memory.middles_xz
    layers = again.grounding.layers if again.grounding else None
    return again.memory.grid.xz_from_rc(again.memory.rc if layers is None else layers.rc)


def _near_targets(episode: Episode, places_xz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether each place is within SUCCESS_RADIUS of a right object."""
    targets = np.array([target.position for target in episode.targets], float)[:, [0, 2]]
    apart = np.linalg.norm(places_xz[:, None] - targets, axis=-1)
    return (apart <= SUCCESS_RADIUS).any(axis=1)
