"""Changes recovered pieces so that none hides another from the places that see it.

Only sizes change, and unrecorded supports may be removed. Walls do not matter, because they are in no line of sight.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim.episodes.schema import Goal
from sim.render.raycast import Raycaster
from sim.types import Camera
from sim.walk.object_surface import object_surface

from ...mesh import TriangleMesh
from ..building.quads import QuadBuilder, add_piece
from ..furniture.families import look_of
from ..plan import Furniture
from .footprints import SMALLEST
from .recorded import original_places

_ROUNDS = 6
_ENOUGH = 0.97
"""Share of an object's view points that must see it; with fewer, the pieces that hide it are changed."""
_SAMPLES = 32
_SHRUNK = 0.8
_LEAST_SHARE = 0.55
"""Least width and depth of a shrunk blocker, as a share of its original ones."""
_LIP = 0.01
"""Distance by which a thing inside another piece reaches out of it (metres)."""
_FARTHEST_OUT = 0.4


class _Hidden(NamedTuple):
    """An object that too few places see, and the pieces in front of it."""

    index: int
    by: Counter[int]
    """Number of lines of sight that each other piece cuts, by index."""


def unhidden(found: Sequence[Furniture], goals: Mapping[str, Goal]) -> tuple[Furniture, ...]:
    """The pieces, with sizes at which (nearly) all original view points of each piece see a part of it past the others.

    Names, centres and yaws stay; supports (role `clutter`) are left out where they hide an object.
    """
    pieces = list(found)
    for _ in range(_ROUNDS):
        hidden = _hidden(pieces, goals)
        if not hidden:
            break
        dropped: set[int] = set()
        for case in hidden:
            for index, _ in sorted(case.by.items(), key=lambda item: (-item[1], item[0]))[:2]:
                if pieces[index].role == "clutter":
                    dropped.add(index)
                else:
                    own, usual = found[index].size, look_of(found[index].category).size
                    width, _, depth = np.maximum(_LEAST_SHARE * np.array(own), SMALLEST * np.array(usual)).tolist()
                    pieces[case.index], pieces[index] = made_way(
                        pieces[case.index], pieces[index], least=(width, depth)
                    )
        pieces = [piece for index, piece in enumerate(pieces) if index not in dropped]
    return tuple(pieces)


def made_way(piece: Furniture, blocker: Furniture, *, least: tuple[float, float]) -> tuple[Furniture, Furniture]:
    """The hidden piece and the blocker, one of them with a new size.

    A piece whose centre lies inside the blocker reaches a little out of its front or top, like an oven in a cabinet or
    a blanket on a bed. Otherwise the blocker shrinks, at most to `least` metres of width and depth.
    """
    x, y, z = piece.centre
    half_h = blocker.size[1] / 2
    if blocker.rect.holds(x, z) and abs(y - blocker.centre[1]) < half_h:
        front, back = _gaps(piece, blocker)
        top = blocker.centre[1] + half_h - y
        width, height, depth = piece.size
        if depth / 2 < front + _LIP <= _FARTHEST_OUT and front < back + _LIP:
            return piece.model_copy(update={"size": (width, height, 2 * (front + _LIP))}), blocker
        if height / 2 < top + _LIP <= _FARTHEST_OUT:
            return piece.model_copy(update={"size": (width, 2 * (top + _LIP), depth)}), blocker
    width, height, depth = blocker.size
    smaller = (max(min(least[0], width), width * _SHRUNK), height, max(min(least[1], depth), depth * _SHRUNK))
    return piece, blocker.model_copy(update={"size": smaller})


def _gaps(piece: Furniture, blocker: Furniture) -> tuple[float, float]:
    """Distances from the piece's centre to the blocker's bounds, towards the piece's front and its back, metres."""
    (x, _, z), rect = piece.centre, blocker.rect
    sin, cos = math.sin(piece.yaw), math.cos(piece.yaw)
    ends = (rect.x1 - x, x - rect.x0) if abs(sin) > abs(cos) else (rect.z1 - z, z - rect.z0)
    return ends if sin + cos > 0 else (ends[1], ends[0])


def _hidden(pieces: Sequence[Furniture], goals: Mapping[str, Goal]) -> list[_Hidden]:
    """The recorded pieces that fewer than _ENOUGH of their view points see."""
    mesh = _shapes(pieces)
    caster = Raycaster(mesh)
    found: list[_Hidden] = []
    for index, piece in enumerate(pieces):
        places = original_places(goals[piece.name]) if piece.name in goals else np.zeros((0, 3))
        if not len(places):
            continue
        eyes = places + np.array([0.0, Camera().mount_height, 0.0])
        targets = object_surface(mesh, index + 1, centre=piece.centre, size=piece.world_size, count=_SAMPLES)
        starts = np.repeat(eyes, len(targets), axis=0)
        hits = caster.cast(starts, np.tile(targets, (len(eyes), 1)) - starts)
        ids = np.where(hits.face_ids >= 0, mesh.face_instance[hits.face_ids], 0).reshape(len(eyes), -1)
        is_blind = (ids != index + 1).all(axis=1)
        if is_blind.sum() > (1 - _ENOUGH) * len(eyes):
            others = ids[is_blind]
            found.append(_Hidden(index, Counter((others[others > 0] - 1).tolist())))
    return found


def _shapes(pieces: Sequence[Furniture]) -> TriangleMesh:
    """A mesh of the pieces alone, with ids 1, 2, ... in their order."""
    builder = QuadBuilder()
    for instance, piece in enumerate(pieces, start=1):
        add_piece(builder, piece, instance=instance)
    return builder.bare_mesh()
