"""Puts the parts of a piece of furniture into the world, as quads of a QuadBuilder."""

import numpy as np

from sim.homes.building.quads import QuadBuilder
from sim.homes.plan import Finish, Furniture

from ..furniture.parts import parts_of
from ..furniture.shapes import Shape, merged, rotation


def add_piece(builder: QuadBuilder, piece: Furniture, *, instance: int) -> None:
    """Adds a piece at its place: its middle at `piece.centre`, its front turned from +z by `piece.yaw` about +y.

    Args:
        builder: Gets one batch of quads for each of the piece's finishes.
        piece: Where, how large and what.
        instance: Object id of all its quads.
    """
    by_finish: dict[Finish, list[Shape]] = {}
    for part in parts_of(piece):
        by_finish.setdefault(part.finish, []).append(part.shape)
    R = rotation("y", piece.yaw)
    foot = np.array(piece.centre) - [0.0, piece.size[1] / 2, 0.0]
    for finish, shapes in by_finish.items():
        shape = merged(shapes)
        builder.add_quads(
            shape.corners @ R.T + foot, finish, uv=shape.uv, normals=shape.normals @ R.T, instance=instance
        )
