"""Small recorded scenes with known answers, for tests of the recovery."""

from typing import NamedTuple

import numpy as np

from sim.episodes.schema import Goal
from sim.frames import quat_xyzw_from_yaw, yaw_towards
from sim.homes.furniture.families import Mounting
from sim.homes.plan import Furniture, Storey
from sim.homes.recovered.objects import recovered_pieces
from sim.homes.recovered.recorded import Recorded

from .synthetic import example_goal, example_view_point

Point = tuple[float, float, float]
GROUND = (Storey(label="ground floor", floor_y=0.0),)


def recorded_goal(name: str, position: Point, seen_from: list[Point]) -> Goal:
    """A goal called `<category>_<int>` with original view points."""
    category, _, number = name.rpartition("_")
    x, _, z = position
    views = [
        example_view_point(px, pz, y=py, quat_xyzw=list(quat_xyzw_from_yaw(yaw_towards((px, pz), (x, z)))), iou=0.5)
        for px, py, pz in seen_from
    ]
    changes = {"position": list(position), "object_id": int(number), "object_name": name, "object_category": category}
    return Goal.model_validate({**example_goal(view_points=views), **changes})


def recorded_of(*goals: Goal, captions: dict[str, str] | None = None, more: list[Point] | None = None) -> Recorded:
    """The record of files with these goals; `more` are places that the generator added."""
    places = {tuple(p.agent_state.position) for goal in goals for p in goal.original_view_points}
    standing = np.array(sorted(places), float).reshape(-1, 3)
    extras = np.array(more or [], float).reshape(-1, 3)
    return Recorded(standing, extras, {goal.object_name: goal for goal in goals}, captions or {}, ())


class Found(NamedTuple):
    """A recovered object and where it is mounted."""

    piece: Furniture
    mounting: Mounting


def objects_of(recorded: Recorded) -> dict[str, Found]:
    """The recovered objects of a one-storey scene, by name."""
    pieces, mountings = recovered_pieces(recorded, GROUND)
    return {piece.name: Found(piece, mountings[piece.name]) for piece in pieces}
