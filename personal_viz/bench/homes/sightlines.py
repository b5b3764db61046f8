"""Checks whether recorded view points of a home are standable and see their object; for `personal-viz homes` and tests.

standing, seeing = sights_of(scene_from_plan(plan), dataset.goals(plan.name))["couch_12"]
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.episodes.schema import Goal
from sim.homes.recovered.recorded import original_places
from sim.mesh import Scene, TriangleMesh
from sim.render.raycast import Raycaster
from sim.types import TURN_STEP, Camera
from sim.walk.object_surface import object_ids_at, object_surface

SAMPLES = 64
"""Number of points on an object's surface to which lines of sight are drawn."""
_STEEPEST = TURN_STEP + math.atan(Camera().height / 2 / Camera().focal)
"""Steepest line of sight, up or down, that one look up or down still shows (radians)."""


class Sights(NamedTuple):
    """Checks of the original view points of one object, in their order."""

    standable: NDArray[np.bool_]
    """(V,) whether the robot can stand there."""
    visible_share: NDArray[np.float64]
    """(V,) share of the lines to the object's surface that meet the object first, in [0, 1]."""

    @property
    def ok(self) -> NDArray[np.bool_]:
        """(V,) whether each view point is standable and sees a part of the object."""
        return self.standable & (self.visible_share > 0)


def view_points_ok(scene: Scene, goals: Mapping[str, Goal]) -> tuple[int, int]:
    """Number of the goals' original view points that are standable and see their object, and of all of them.

    Args:
        scene: A home that contains the goals' objects under their names.
        goals: Goals by `object_name`, from `PersonalDataset.goals`.
    """
    sights = sights_of(scene, goals).values()
    return int(sum(found.ok.sum() for found in sights)), sum(len(found.ok) for found in sights)


def sights_of(scene: Scene, goals: Mapping[str, Goal]) -> dict[str, Sights]:
    """The views from each goal's original view points, by the goal's name; a missing object is not seen."""
    caster = Raycaster(scene.mesh)
    ids = {item.name: item.instance_id for item in scene.objects}
    found: dict[str, Sights] = {}
    for name, goal in goals.items():
        places = original_places(goal)
        standable = np.array([scene.navigation.is_navigable(place) for place in places], bool)
        item = next((item for item in scene.objects if item.instance_id == ids.get(name)), None)
        targets = np.zeros((0, 3))
        if item is not None:
            targets = object_surface(scene.mesh, item.instance_id, centre=item.centre, size=item.size, count=SAMPLES)
        shares = visible_shares(places, targets, ids.get(name, 0), mesh=scene.mesh, caster=caster)
        found[name] = Sights(standable, shares)
    return found


def visible_shares(
    places: NDArray[np.float64],
    targets: NDArray[np.float64],
    instance_id: int,
    *,
    mesh: TriangleMesh,
    caster: Raycaster,
) -> NDArray[np.float64]:
    """(V,) share of the lines from the camera above each place (V, 3) to targets (S, 3) that meet the object first.

    Lines too steep for one look up or down do not count as seen.
    """
    if not len(places) or not len(targets):
        return np.zeros(len(places))
    eyes = np.repeat(places + np.array([0.0, Camera().mount_height, 0.0]), len(targets), axis=0)
    hits = caster.cast(eyes, np.tile(targets, (len(places), 1)) - eyes)
    to = hits.positions - eyes
    steep = np.abs(np.arctan2(to[:, 1], np.hypot(to[:, 0], to[:, 2])))
    is_object = object_ids_at(mesh, hits.face_ids, hits.positions) == instance_id
    return (is_object & (steep <= _STEEPEST)).reshape(len(places), -1).mean(axis=1)
