"""Hangs recovered pieces that would float from the ceiling, on cords, where no wall and no piece can carry them.

Pieces and the cells of their home -> cords, for `recover_plan`.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..building.cells.spaces import ceiling_heights, floor_layers, plinth_layers
from ..cells import CellGrid
from ..furniture.appearance import finish_from_text
from ..furniture.families import Mounting
from ..plan import Furniture, Storey
from .objects import is_solid

CORD = "hanging cord"
"""Category of cords."""
_TOUCH = 0.08
"""A piece is carried by what is this near to its box (metres)."""
_BEHIND = 0.05
"""A wall thing is carried by a wall this far behind it (metres); the wall may be one cell thick."""
_THICK = 0.02
"""Width and depth of a cord (metres)."""


def cords(
    pieces: Sequence[Furniture], mountings: Mapping[str, Mounting], storeys: Sequence[Storey], *, grid: CellGrid
) -> tuple[Furniture, ...]:
    """A cord (role `clutter`) for every piece that neither stands nor touches a wall, the floor or another piece.

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
        is_free = is_open[max(2 * k - 1, 0) : 2 * k + 2, beside[:, 0], beside[:, 1]].any(axis=0)
        is_carried = (
            mountings[piece.name] in ("floor", "ceiling")
            or not is_free.all()
            or piece.bottom_y - floors_y[k] <= _TOUCH
            or any(_touches(piece, other) for other in pieces if other is not piece and is_solid(other))
        )
        length = ceilings_y[k] - piece.top_y
        if not is_carried and length > _THICK:
            x, _, z = piece.centre
            found.append(
                Furniture(
                    name=f"{CORD}_{number + len(found)}",
                    category=CORD,
                    centre=(x, piece.top_y + length / 2, z),
                    size=(_THICK, length, _THICK),
                    finish=finish_from_text("", CORD),
                    role="clutter",
                )
            )
    return tuple(found)


def _beside(piece: Furniture, turn: float, reach: float) -> NDArray[np.float64]:
    """Places (3, 2), x and z, `reach` metres beside a side that is turned from the front by this angle (radians)."""
    yaw, (x, _, z) = piece.yaw + turn, piece.centre
    out, across = np.array([math.sin(yaw), math.cos(yaw)]), np.array([math.cos(yaw), -math.sin(yaw)])
    width, depth = np.array([piece.size[0], piece.size[2]])[:: 1 if round(math.sin(turn)) == 0 else -1]
    return np.array([x, z]) + (depth / 2 + reach) * out + np.array([[-0.25], [0.0], [0.25]]) * width * across


def _touches(piece: Furniture, other: Furniture) -> bool:
    """Whether the boxes of two pieces are at most _TOUCH apart."""
    apart = max(piece.bottom_y - other.top_y, other.bottom_y - piece.top_y, 0.0)
    return math.hypot(piece.rect.gap(other.rect), apart) <= _TOUCH
