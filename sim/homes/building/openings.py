"""Windows, door frames, door leaves and ceiling lamps, in the frame of the wall or ceiling that they belong to."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Rgb
from ..furniture.lofts import cylinder
from ..furniture.shapes import Shape, box, slab
from ..plan import Finish
from .quads import QuadBuilder

FRAME_FINISH = Finish(material="wood", rgb=(206, 178, 142))
LEAF_FINISH = Finish(material="wood", rgb=(168, 124, 82))
_PANEL_FINISH = Finish(material="wood", rgb=(146, 104, 66))
_PANE_FINISH = Finish(material="glass", rgb=(150, 178, 198))
_HANDLE_FINISH = Finish(material="metal", rgb=(188, 188, 192))
_LAMP_FINISH = Finish(material="glass", rgb=(255, 250, 232))
_LAMP_RIM_FINISH = Finish(material="metal", rgb=(150, 146, 138))
_OUTSIDE: tuple[tuple[float, Rgb], ...] = (
    # share of the pane's height, colour: from the top down
    (0.26, (166, 206, 242)), (0.22, (192, 221, 246)), (0.18, (222, 236, 246)), (0.12, (126, 160, 112)),
    (0.22, (104, 146, 84)),
)  # fmt: skip
LEAF_THICKNESS = 0.04
LAMP_DROP = 0.09
"""How far a lamp hangs below its ceiling (metres)."""
_STRIP = (0.07, 0.012)
"""Width and height of the strip between two floors (metres)."""
_STRIP_FINISH = Finish(material="wood", rgb=(150, 112, 76))
_BAR = 0.055
_CASING = 0.07
_CASING_DEPTH = 0.018


class Spot(NamedTuple):
    """Where a thing is: on a wall, x runs along it, y up and z out of it, right-handed."""

    origin: NDArray[np.float64]
    """(3,) world metres."""
    yaw: float
    """Radians about +y; at 0 the axes are the world's."""


def spot_on_wall(start: NDArray[np.float64], out: NDArray[np.float64], y: float) -> Spot:
    """A spot over (x, z) `start` whose z looks along the level direction `out`; both (2,)."""
    return Spot(np.array([start[0], y, start[1]]), float(np.arctan2(out[0], out[1])))


def add_shape(builder: QuadBuilder, shape: Shape, spot: Spot, finish: Finish) -> None:
    """Adds a shape of the spot's own frame."""
    placed = shape.turned("y", spot.yaw)
    builder.add_quads(placed.corners + spot.origin, finish, uv=placed.uv)


def add_window(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, depth: float = 0.0) -> None:
    """A window with frame, cross, sill and something of outside.

    Args:
        builder: Takes the quads.
        spot: The middle of the window's lower edge, on the face of the wall that the room sees.
        size: Width and height, metres.
        depth: How far behind the wall's face the pane is, metres; 0 = the window is set upon the wall.
    """
    width, height = size
    pane_z = 0.006 - depth
    top = height
    for share, rgb in _OUTSIDE:
        low = top - share * height
        pane = slab((0, (low + top) / 2, pane_z), (width, top - low, 0.002), faces="+z")
        add_shape(builder, pane, spot, Finish(material="glass", rgb=rgb))
        top = low
    bar = min(_BAR, width / 6)
    middle = pane_z + 0.012
    for x in (-(width - bar) / 2, 0.0, (width - bar) / 2):
        add_shape(
            builder, box((x, height / 2, middle), (bar * (0.6 if x == 0 else 1), height, 0.03)), spot, FRAME_FINISH
        )
    for y in (bar / 2, height * 0.62, height - bar / 2):
        thick = bar * (0.6 if 0.5 * height < y < 0.7 * height else 1)
        add_shape(builder, box((0, y, middle + 0.001), (width, thick, 0.03)), spot, FRAME_FINISH)
    _add_casing(builder, spot, (width, height))
    add_shape(builder, box((0, -0.015, 0.03 - depth / 2), (width + 0.2, 0.03, 0.08 + depth)), spot, FRAME_FINISH)


def add_door_frame(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, thickness: float) -> None:
    """A frame that lines a doorway and is seen from both sides; the opening stays free but for the lining.

    Args:
        builder: Takes the quads.
        spot: The middle of the opening on the floor, in the middle of the wall.
        size: Width and height of the opening, metres.
        thickness: Of the wall, metres.
    """
    width, height = size
    lining = 0.025
    deep = thickness + 2 * _CASING_DEPTH - 0.004
    for x in (-(width - lining) / 2, (width - lining) / 2):
        add_shape(builder, box((x, height / 2, 0), (lining, height, deep)), spot, FRAME_FINISH)
    add_shape(builder, box((0, height - lining / 2, 0), (width, lining, deep)), spot, FRAME_FINISH)
    for turn in (0.0, np.pi):
        side = Spot(spot.origin, spot.yaw + turn)
        _add_casing(builder, side, size, z=thickness / 2)


def _add_casing(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, z: float = 0.0) -> None:
    """Boards on the wall beside and over an opening."""
    width, height = size
    middle = z + _CASING_DEPTH / 2
    for sign in (-1, 1):
        x = sign * (width + _CASING) / 2
        add_shape(
            builder,
            box((x, (height + _CASING) / 2, middle), (_CASING, height + _CASING, _CASING_DEPTH)),
            spot,
            FRAME_FINISH,
        )
    add_shape(builder, box((0, height + _CASING / 2, middle), (width, _CASING, _CASING_DEPTH)), spot, FRAME_FINISH)


def add_pane(builder: QuadBuilder, spot: Spot, size: tuple[float, float]) -> None:
    """The back of a window's pane; its lower edge's middle is at the spot."""
    width, height = size
    add_shape(builder, slab((0, height / 2, 0), (width, height, 0.0), faces="+z"), spot, _PANE_FINISH)


def add_leaf(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, is_hinged_right: bool = False) -> None:
    """A door leaf with panels and a handle; it stands at the spot, its left edge at x = 0, its back at z = 0."""
    width, height = size
    add_shape(
        builder, box((width / 2, height / 2, LEAF_THICKNESS / 2), (width, height, LEAF_THICKNESS)), spot, LEAF_FINISH
    )
    for low, high in ((0.1, 0.44), (0.52, 0.93)):
        panel = slab(
            (width / 2, (low + high) / 2 * height, LEAF_THICKNESS + 0.001),
            (width * 0.66, (high - low) * height, 0.004),
            faces="+z",
        )
        add_shape(builder, panel, spot, _PANEL_FINISH)
    add_shape(
        builder,
        box((0.08 if is_hinged_right else width - 0.08, 1.0, LEAF_THICKNESS + 0.02), (0.13, 0.022, 0.03)),
        spot,
        _HANDLE_FINISH,
    )


def add_strip(builder: QuadBuilder, spot: Spot, length: float) -> None:
    """A flat strip of wood on the floor where two floors meet; its middle is at the spot."""
    width, height = _STRIP
    add_shape(builder, box((0, height / 2, 0), (length + width, height, width)), spot, _STRIP_FINISH)


def add_ceiling_lamp(builder: QuadBuilder, spot: Spot) -> tuple[float, float, float]:
    """A round lamp under the ceiling at the spot; returns the place of its light."""
    rim = cylinder((0, -0.03, 0), 0.19, 0.03, sides=12)
    shade = cylinder((0, -LAMP_DROP, 0), 0.13, LAMP_DROP - 0.03, top=0.17, sides=12)
    add_shape(builder, rim, spot, _LAMP_RIM_FINISH)
    add_shape(builder, shade, spot, _LAMP_FINISH)
    x, y, z = spot.origin.tolist()
    return (x, y - LAMP_DROP - 0.05, z)
