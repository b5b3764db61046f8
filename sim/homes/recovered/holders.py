"""Gives recovered pieces that would float something to stand or hang on, where no wall and no other piece carries them.

Pieces and the cells of their home -> holders, for `recover_plan`. Under a low piece, where nobody walks, stands a
cabinet or a low wall; a high one hangs on a panel or a rod that comes down from the ceiling, or lies on a ledge.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..building.cells.spaces import ceiling_heights, floor_layers, plinth_layers
from ..cells import CellGrid
from ..furniture.appearance import finish_from_text
from ..furniture.families import Mounting, look_of
from ..plan import Furniture, Storey
from .footprints import STANDING_ROOM

STAND, PANEL = "cabinet", "wall panel"
"""Categories of holders."""
_TOUCH = 0.08
"""A piece is carried by what is this near to its box (metres)."""
_BEHIND = 0.05
"""A wall thing is carried by a wall this far behind it (metres); the wall may be one cell thick."""
_THIN = 0.12
"""No cabinet is as thin as this (metres)."""
_THICK = 0.03
"""Thickness of a panel and of its ledge (metres)."""

Vec = tuple[float, float, float]


def holders(
    pieces: Sequence[Furniture], mountings: Mapping[str, Mounting], storeys: Sequence[Storey], *, grid: CellGrid
) -> tuple[Furniture, ...]:
    """Holders (role `clutter`) for every piece that touches neither wall, floor or ceiling nor another piece.

    Args:
        pieces: All furniture.
        mountings: The mounting of each piece by its name.
        storeys: All storeys.
        grid: Cells of the home, with those that are open but not walkable.
    """
    is_open = ~np.isnan(floor_layers(grid, tuple(storeys))) | ~np.isnan(plinth_layers(grid, tuple(storeys)))
    floors_y = np.array([storey.floor_y for storey in storeys])
    ceilings_y = ceiling_heights(tuple(storeys))
    number = 1 + max((int(piece.name.rpartition("_")[2]) for piece in pieces), default=0)
    found: list[Furniture] = []
    for piece in pieces:
        k = max(int(np.searchsorted(floors_y, piece.bottom_y + _TOUCH)) - 1, 0)
        turns, reach = ((2,), _BEHIND) if mountings[piece.name] == "wall" else (range(4), _TOUCH)
        beside = grid.grid.rc_from_xz(np.concatenate([_beside(piece, turn * math.pi / 2, reach) for turn in turns]))
        is_at_wall = not is_open[max(2 * k - 1, 0) : 2 * k + 2, beside[:, 0], beside[:, 1]].any(axis=0).all()
        gap = ceilings_y[k] - piece.top_y
        if mountings[piece.name] == "ceiling" and gap > _TOUCH:
            found.append(_rod(piece, gap, number=number + len(found)))
        is_held = (
            mountings[piece.name] in ("floor", "ceiling")
            or (mountings[piece.name] == "wall" and is_at_wall)
            or piece.bottom_y - floors_y[k] <= _TOUCH
            or is_carried(piece, pieces)
        )
        if is_held:
            continue
        if piece.bottom_y - floors_y[k] < STANDING_ROOM:
            found.append(_stand(piece, floors_y[k], number=number + len(found)))
            continue
        if not is_at_wall and ceilings_y[k] > piece.top_y:
            found.append(_panel(piece, ceilings_y[k], number=number + len(found)))
        if mountings[piece.name] == "on":
            found.append(_ledge(piece, number=number + len(found)))
    return tuple(found)


def _beside(piece: Furniture, turn: float, reach: float) -> NDArray[np.float64]:
    """Places (3, 2), x and z, `reach` metres beside a side that is turned from the front by this angle (radians)."""
    yaw, (x, _, z) = piece.yaw + turn, piece.centre
    out, across = np.array([math.sin(yaw), math.cos(yaw)]), np.array([math.cos(yaw), -math.sin(yaw)])
    width, depth = np.array([piece.size[0], piece.size[2]])[:: 1 if round(math.sin(turn)) == 0 else -1]
    return np.array([x, z]) + (depth / 2 + reach) * out + np.array([[-0.25], [0.0], [0.25]]) * width * across


def is_carried(piece: Furniture, pieces: Sequence[Furniture]) -> bool:
    """Whether another piece is near enough to carry this one."""
    return any(_is_carrier(other) and _touches(piece, other) for other in pieces if other is not piece)


def _is_carrier(piece: Furniture) -> bool:
    """Whether things can lie on a piece or lean on it: the steps of stairs do not fill their box."""
    return look_of(piece.category).family not in ("flat", "stair")


def _touches(piece: Furniture, other: Furniture) -> bool:
    """Whether the boxes of two pieces are at most _TOUCH apart."""
    apart = max(piece.bottom_y - other.top_y, other.bottom_y - piece.top_y, 0.0)
    return math.hypot(piece.rect.gap(other.rect), apart) <= _TOUCH


def _stand(piece: Furniture, floor_y: float, *, number: int) -> Furniture:
    """What reaches from the floor to the underside of a piece, as wide and as deep: a cabinet, or a panel if thin."""
    (x, _, z), (width, _, depth) = piece.centre, piece.size
    height = piece.bottom_y - floor_y
    category = STAND if min(width, depth) > _THIN else PANEL
    return _holder(piece, number, category, (x, floor_y + height / 2, z), (width, height, depth))


def _panel(piece: Furniture, ceiling_y: float, *, number: int) -> Furniture:
    """A panel from the ceiling to the underside of a piece, behind it."""
    (x, _, z), (width, _, depth) = piece.centre, piece.size
    height, back = ceiling_y - piece.bottom_y, depth / 2 + _THICK / 2
    centre = (x - back * math.sin(piece.yaw), piece.bottom_y + height / 2, z - back * math.cos(piece.yaw))
    return _holder(piece, number, PANEL, centre, (width, height, _THICK))


def _rod(piece: Furniture, length: float, *, number: int) -> Furniture:
    """A thin rod of this length (metres) above a piece."""
    x, _, z = piece.centre
    return _holder(piece, number, PANEL, (x, piece.top_y + length / 2, z), (_THICK, length, _THICK))


def _ledge(piece: Furniture, *, number: int) -> Furniture:
    """A board right below a piece."""
    (x, _, z), (width, _, depth) = piece.centre, piece.size
    return _holder(piece, number, PANEL, (x, piece.bottom_y - _THICK / 2, z), (width, _THICK, depth))


def _holder(piece: Furniture, number: int, category: str, centre: Vec, size: Vec) -> Furniture:
    return Furniture(
        name=f"{category}_{number}",
        category=category,
        centre=centre,
        size=size,
        yaw=piece.yaw,
        finish=finish_from_text("", category),
        role="clutter",
    )
