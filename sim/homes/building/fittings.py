"""Adds windows, doors, railings and ceiling lamps at given places on walls, floors and ceilings."""

import itertools

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Rgb
from ..furniture.lofts import cylinder
from ..furniture.shapes import Shape, box, slab
from ..plan import Finish
from .quads import QuadBuilder, Spot, add_shapes

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
"""Height of a lamp below its ceiling (metres)."""
_STRIP = (0.07, 0.012)
"""Width and height of the strip between two floors (metres)."""
_STRIP_FINISH = Finish(material="wood", rgb=(150, 112, 76))
_BAR = 0.055
_CASING = 0.07
_CASING_DEPTH = 0.018
_RAIL_FINISH = Finish(material="wood", rgb=(128, 88, 56))
_POST_FINISH = Finish(material="wood", rgb=(150, 110, 72))
_RAIL_HEIGHT = 0.9
_POST_GAP = 0.14
_POST = 0.03
_RAIL = (0.05, 0.04)

Points = NDArray[np.float64]


def add_window(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, depth: float = 0.0) -> None:
    """Adds a window with a frame, a cross, a sill and a view of the outside.

    Args:
        builder: Takes the quads.
        spot: The middle of the window's lower edge, on the face of the wall that the room sees.
        size: Width and height, metres.
        depth: Distance of the pane behind the wall's face, metres; 0 = the window lies on the wall.
    """
    width, height = size
    pane_z = 0.006 - depth
    top = height
    for share, rgb in _OUTSIDE:
        low = top - share * height
        pane = slab((0, (low + top) / 2, pane_z), (width, top - low, 0.002), faces="+z")
        add_shapes(builder, spot, Finish(material="glass", rgb=rgb), pane)
        top = low
    bar = min(_BAR, width / 6)
    thin, middle, side, edge = 0.6 * bar, pane_z + 0.012, (width - bar) / 2, bar / 2
    columns = ((-side, bar), (0, thin), (side, bar))
    rows = ((edge, bar), (height * 0.62, thin), (height - edge, bar))
    bars = [
        *(box((x, height / 2, middle), (thick, height, 0.03)) for x, thick in columns),
        *(box((0, y, middle + 0.001), (width, thick, 0.03)) for y, thick in rows),
    ]
    sill = box((0, -0.015, 0.03 - depth / 2), (width + 0.2, 0.03, 0.08 + depth))
    add_shapes(builder, spot, FRAME_FINISH, *bars, *_casing(size), sill)


def add_door_frame(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, thickness: float) -> None:
    """Adds a frame that lines a doorway and is seen from both sides; the opening stays free except for the lining.

    Args:
        builder: Takes the quads.
        spot: The middle of the opening on the floor, in the middle of the wall.
        size: Width and height of the opening, metres.
        thickness: Thickness of the wall, metres.
    """
    width, height = size
    lining, deep = 0.025, thickness + 2 * _CASING_DEPTH - 0.004
    x = (width - lining) / 2
    sides = [box((at, height / 2, 0), (lining, height, deep)) for at in (-x, x)]
    add_shapes(builder, spot, FRAME_FINISH, *sides, box((0, height - lining / 2, 0), (width, lining, deep)))
    for turn in (0.0, np.pi):
        add_shapes(builder, Spot(spot.origin, spot.yaw + turn), FRAME_FINISH, *_casing(size, z=thickness / 2))


def _casing(size: tuple[float, float], *, z: float = 0.0) -> list[Shape]:
    """Boards on the wall beside and over an opening."""
    width, height = size
    x, middle, tall = (width + _CASING) / 2, z + _CASING_DEPTH / 2, height + _CASING
    sides = [box((at, tall / 2, middle), (_CASING, tall, _CASING_DEPTH)) for at in (-x, x)]
    return [*sides, box((0, height + _CASING / 2, middle), (width, _CASING, _CASING_DEPTH))]


def add_pane(builder: QuadBuilder, spot: Spot, size: tuple[float, float]) -> None:
    """Adds the back of a window's pane; the middle of its lower edge is at the spot."""
    width, height = size
    add_shapes(builder, spot, _PANE_FINISH, slab((0, height / 2, 0), (width, height, 0.0), faces="+z"))


def add_leaf(builder: QuadBuilder, spot: Spot, size: tuple[float, float], *, is_hinged_right: bool = False) -> None:
    """Adds a door leaf with panels and a handle at the spot; its left edge is at x = 0, its back at z = 0."""
    (width, height), thick = size, LEAF_THICKNESS
    panels = [
        slab(
            (width / 2, (low + high) / 2 * height, thick + 0.001),
            (width * 0.66, (high - low) * height, 0.004),
            faces="+z",
        )
        for low, high in ((0.1, 0.44), (0.52, 0.93))
    ]
    handle = box((0.08 if is_hinged_right else width - 0.08, 1.0, thick + 0.02), (0.13, 0.022, 0.03))
    add_shapes(builder, spot, LEAF_FINISH, box((width / 2, height / 2, thick / 2), (width, height, thick)))
    add_shapes(builder, spot, _PANEL_FINISH, *panels)
    add_shapes(builder, spot, _HANDLE_FINISH, handle)


def add_strip(builder: QuadBuilder, spot: Spot, length: float) -> None:
    """Adds a flat strip of wood where two floors meet; its middle is at the spot."""
    width, height = _STRIP
    add_shapes(builder, spot, _STRIP_FINISH, box((0, height / 2, 0), (length + width, height, width)))


def add_ceiling_lamp(builder: QuadBuilder, place: Points) -> tuple[float, float, float]:
    """Adds a round lamp under the ceiling at a place (3,); returns the place of its light."""
    spot = Spot(place, 0.0)
    add_shapes(builder, spot, _LAMP_RIM_FINISH, cylinder((0, -0.03, 0), 0.19, 0.03, sides=12))
    shade = cylinder((0, -LAMP_DROP, 0), 0.13, LAMP_DROP - 0.03, top=0.17, sides=12)
    add_shapes(builder, spot, _LAMP_FINISH, shade)
    x, y, z = place.tolist()
    return (x, y - LAMP_DROP - 0.05, z)


def add_railing(builder: QuadBuilder, feet: Points, *, height: float = _RAIL_HEIGHT) -> None:
    """Adds posts on a line of points (N, 3) and a rail whose top is `height` metres over them."""
    places = _spaced(feet)
    for a, b in itertools.pairwise(places):
        along = b - a
        length = float(np.hypot(along[0], along[2]))
        if length > 1e-6:
            _add_rail(builder, a, b, height - _RAIL[1])
    post = box((0, (height - _RAIL[1]) / 2, 0), (_POST, height - _RAIL[1], _POST))
    add_shapes(builder, Spot(np.zeros(3), 0.0), _POST_FINISH, *(post.moved(x, y, z) for x, y, z in places.tolist()))


def _spaced(feet: Points) -> Points:
    """Points about _POST_GAP apart on a line, with its ends."""
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(feet[:, [0, 2]], axis=0).T))])
    count = max(2, round(float(length[-1]) / _POST_GAP) + 1)
    at = np.linspace(0, length[-1], count)
    return np.stack([np.interp(at, length, feet[:, axis]) for axis in range(3)], axis=1)


def _add_rail(builder: QuadBuilder, a: Points, b: Points, height: float) -> None:
    """Adds a bar between two points `height` over `a` and `b`; its ends are upright, so that bars join."""
    along = np.array([b[0] - a[0], b[2] - a[2]])
    side = np.array([along[1], -along[0]]) / np.hypot(*along) * _RAIL[0] / 2
    side = np.array([side[0], 0, side[1]])
    up = np.array([0.0, _RAIL[1], 0])
    base = np.array([0.0, height, 0])
    ring = [[end + base - side, end + base + side, end + base + side + up, end + base - side + up] for end in (a, b)]
    first, second = ring
    quads = [[first[k], second[k], second[(k + 1) % 4], first[(k + 1) % 4]] for k in range(4)]
    builder.add_quads(np.array(quads)[:, ::-1], _RAIL_FINISH)
    builder.add_quads(np.array([first[::-1], second]), _RAIL_FINISH)
