"""Straight pieces of wall as quads: two faces with skirting, and dark rims that show the wall where a storey is cut."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..plan import Finish
from .quads import QuadBuilder

SKIRTING = 0.08
_SKIRTING_DEPTH = 0.012
SKIRTING_FINISH = Finish(material="wood", rgb=(206, 178, 142))
CEILING_FINISH = Finish(material="plaster", rgb=(244, 243, 238))
CAP_FINISH = Finish(material="plaster", rgb=(70, 70, 76))

Point = NDArray[np.float64]


class WallPiece(NamedTuple):
    """A straight piece of wall of one height; its ground plan has four corners, world (x, z) in metres."""

    left_start: Point
    left_end: Point
    right_start: Point
    right_end: Point
    """(2,) each; left as seen from its start to its end, from above."""
    bottom: float
    top: float
    """World heights."""
    left: Finish | None
    right: Finish | None
    """What is seen from each side; None = nobody can be there."""
    skirting: bool = True
    """Whether the piece stands on the floor."""
    rims: tuple[float, ...] = ()
    """World heights of rims seen from above."""
    ends: tuple[bool, bool] = (False, False)
    """Whether its start and its end are seen."""
    end_finish: Finish | None = None
    """Of the ends; None = as its left side, or else its right one."""
    has_top: bool = False
    """Whether its top can be seen, as a railing's."""
    has_underside: bool = False
    """Whether it can be seen from below, as a lintel."""


def add_wall_piece(builder: QuadBuilder, piece: WallPiece) -> None:
    """Adds the faces, ends, rims and skirting of a piece."""
    if piece.top - piece.bottom < 1e-6:
        return
    low, high = piece.bottom, piece.top
    foot = min(low + SKIRTING, high) if piece.skirting else low
    if piece.left is not None:
        _add_side(builder, piece.left_end, piece.left_start, (low, foot, high), piece.left)
    if piece.right is not None:
        _add_side(builder, piece.right_start, piece.right_end, (low, foot, high), piece.right)
    finish = piece.end_finish or piece.left or piece.right
    assert finish is not None
    if piece.ends[0]:
        builder.add_quads(upright(piece.left_start, piece.right_start, low, high)[None], finish)
    if piece.ends[1]:
        builder.add_quads(upright(piece.right_end, piece.left_end, low, high)[None], finish)
    plan = np.array([piece.left_start, piece.right_start, piece.right_end, piece.left_end])
    for height in piece.rims:
        builder.add_quads(_at(plan, height)[None], CAP_FINISH)
    if piece.has_top:
        builder.add_quads(_at(plan, high)[None], finish)
    if piece.has_underside:
        builder.add_quads(_at(plan, low)[None, ::-1], finish)


def upright(start: ArrayLike, end: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """(4, 3) upright quad over a line from `start` to `end` (x, z), seen from the right of that line."""
    (xa, za), (xb, zb) = np.asarray(start, float), np.asarray(end, float)
    return np.array([(xa, low, za), (xb, low, zb), (xb, high, zb), (xa, high, za)])


def _add_side(
    builder: QuadBuilder, start: Point, end: Point, heights: tuple[float, float, float], finish: Finish
) -> None:
    """One face over a line, seen from the line's right; the skirting stands a little before it."""
    low, foot, high = heights
    along = end - start
    length = float(np.hypot(*along))
    if length < 1e-9:
        return
    builder.add_quads(upright(start, end, low, high)[None], finish)
    if foot > low:
        out = np.array([-along[1], along[0]]) / length * _SKIRTING_DEPTH
        front = upright(start + out, end + out, low, foot)
        ledge = np.array([front[3], front[2], *upright(start, end, low, foot)[[2, 3]]])
        builder.add_quads(np.stack([front, ledge]), SKIRTING_FINISH)


def _at(plan: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """(4, 3) level quad at a height over four points (x, z)."""
    return np.stack([plan[:, 0], np.full(4, height), plan[:, 1]], axis=1)
