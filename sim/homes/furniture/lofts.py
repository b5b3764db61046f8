"""Round and soft shapes: rings joined to a skin (lathe, tube, ball), and sheets (cushion, curtain, leaf)."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .families import Vec
from .shapes import Shape, facets, fan, loft_quads, merged, unit

_SMOOTH = 0.5
"""Cosine of the angle up to which two neighbouring quads are lit as one curved surface."""
Caps = Literal["none", "both", "end", "start"]
Point = tuple[float, float]
Level = tuple[float, float, float, float]
SQUARE = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
"""An outline for `stack`."""


def loft(rings: ArrayLike, *, caps: Caps = "none") -> Shape:
    """A skin over rings (M, P, 3); curved where neighbours meet at less than 60 degrees, else with an edge.

    The skin faces outwards if the rings run counter-clockwise as seen from the last one. `caps` fill the first or last
    ring.
    """
    rings = np.asarray(rings, float)
    shapes = [Shape(*loft_quads(np.ascontiguousarray(rings), _SMOOTH))]
    if caps in ("both", "end"):
        shapes.append(facets(fan(rings[-1])))
    if caps in ("both", "start"):
        shapes.append(facets(fan(rings[0])[:, ::-1]))
    return merged(shapes)


def circle(sides: int, *, power: float = 2.0) -> NDArray[np.float64]:
    """Points (x, z) of the unit circle, (P, 2), counter-clockwise from above; a power above 2 makes it squarer."""
    angle = np.arange(sides) * 2 * np.pi / sides
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([np.sign(cos) * np.abs(cos) ** (2 / power), -np.sign(sin) * np.abs(sin) ** (2 / power)], axis=1)


def lathe(
    profile: Sequence[Point],
    *,
    scale: Point = (1.0, 1.0),
    at: Vec = (0.0, 0.0, 0.0),
    sides: int = 10,
    depth: float = 1.0,
    power: float = 2.0,
    caps: Caps = "none",
) -> Shape:
    """An upright turned shape.

    Args:
        profile: (radius, height) from the outside of the bottom onwards; may turn back inside, as in a bowl.
        scale: Metres for a radius of 1 and for a height of 1.
        at: Foot of the axis.
        sides: Number of corners of each ring.
        depth: Extent along z as a share of the extent along x.
        power: 2 = round, 4 and more = a rounded square.
        caps: Which ends are filled.
    """
    r_m, y_m = scale
    levels = [(y * y_m, r * 2 * r_m, r * 2 * r_m * depth, 0.0) for r, y in profile]
    return stack(circle(sides, power=power), (1.0, 1.0), levels, caps=caps).moved(*at)


def stack(outline: NDArray[np.float64], size: Point, levels: Sequence[Level], *, caps: Caps = "none") -> Shape:
    """A skin over copies of an outline (P, 2) one above the other.

    Args:
        outline: (x, z) from -1 to 1.
        size: Width and depth in metres at a share of 1.
        levels: Height, share of the width, share of the depth, and z of the middle of each copy.
        caps: Which ends are filled.
    """
    return loft([_level(outline, size, level) for level in levels], caps=caps)


def plate(outline: NDArray[np.float64], size: Point, level: Level) -> Shape:
    """A flat sheet that looks up, at one level of a stack."""
    return facets(fan(_level(outline, size, level)))


def _level(outline: NDArray[np.float64], size: Point, level: Level) -> NDArray[np.float64]:
    y, share_w, share_d, z = level
    x = outline[:, 0] * size[0] / 2 * share_w
    return np.stack([x, np.full(len(outline), y), outline[:, 1] * size[1] / 2 * share_d + z], axis=1)


def cylinder(
    foot: Vec, radius: float, height: float, *, top: float | None = None, sides: int = 10, axis: str = "y"
) -> Shape:
    """A cylinder from its foot along an axis, or a truncated cone with the radius `top` at its far end."""
    skin = lathe([(radius, 0.0), (radius if top is None else top, height)], sides=sides, caps="both")
    turn = {"x": ("z", -np.pi / 2), "y": ("y", 0.0), "z": ("x", np.pi / 2)}[axis]
    return skin.turned(*turn).moved(*foot)


def ball(centre: Vec, size: Vec, *, sides: int = 8, rings: int = 5, low: float = -1.0) -> Shape:
    """An ellipsoid in a box of `size`, or the part of it above the height `low` (-1 = bottom, 1 = top)."""
    angles = np.linspace(np.arcsin(low), np.pi / 2, rings + 1)
    half = np.array(size) / 2
    profile = [(half[0] * np.cos(a), half[1] * np.sin(a)) for a in angles]
    return lathe(profile, at=centre, sides=sides, depth=half[2] / half[0])


def tube(points: Sequence[Vec], radius: float | Sequence[float], *, sides: int = 6, is_closed: bool = False) -> Shape:
    """A round bar along points, with one radius for all points or one per point."""
    path = np.asarray(points, float)
    if is_closed:
        path = np.concatenate([path, path[:1]])
    steps = unit(np.diff(path, axis=0))
    ends = (steps[-1] + steps[0], steps[-1] + steps[0]) if is_closed else (steps[0], steps[-1])
    towards = unit(np.concatenate([ends[0][None], steps[:-1] + steps[1:], ends[1][None]]))
    side = unit(_cross(towards, _least_along(towards)))
    other = _cross(towards, side)
    angle = np.arange(sides) * 2 * np.pi / sides
    radii = np.broadcast_to(np.asarray(radius, float), (len(path),))[:, None, None]
    rings = path[:, None] + radii * (
        np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * other[:, None]
    )
    return loft(rings, caps="none" if is_closed else "both")


def ring(centre: Vec, radius: float, thickness: float, *, axis: str = "z", sides: int = 14, around: int = 5) -> Shape:
    """A ring about an axis; `thickness` is its bar's radius."""
    angle = np.arange(sides) * 2 * np.pi / sides
    flat = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
    k = "xyz".index(axis)
    points = np.zeros((sides, 3))
    points[:, (k + 1) % 3], points[:, (k + 2) % 3] = flat[:, 0], flat[:, 1]
    return tube([tuple(point) for point in points + np.array(centre)], thickness, sides=around, is_closed=True)


def sheet(points: ArrayLike) -> Shape:
    """A curved sheet through points (R, C, 3), seen from both sides, lit on the side of its axes' cross product."""
    grid = np.asarray(points, float)
    normals = unit(_cross(np.gradient(grid, axis=0), np.gradient(grid, axis=1)))
    along = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).max(axis=1 - axis) for axis in (0, 1)]
    v, u = (np.concatenate([[0.0], np.cumsum(steps)]) for steps in along)
    grid_u, grid_v = np.meshgrid(u, v)
    uv = np.stack([grid_u, grid_v], axis=2)
    parts = [
        np.stack([a[:-1, :-1], a[1:, :-1], a[1:, 1:], a[:-1, 1:]], axis=2).reshape(-1, 4, a.shape[2])
        for a in (grid, normals, uv)
    ]
    return Shape(*parts)


def cushion(centre: Vec, size: Vec, *, cells: int = 5) -> Shape:
    """A pillow that lies flat, thick in the middle and thin at its four sides; `size` is along x, y, z."""
    t = np.sin(np.linspace(-1, 1, cells + 1) * np.pi / 2)
    x, z = np.meshgrid(t, t)
    drawn_in = 1 - 0.07 * (1 - np.stack([z, x], axis=2) ** 2)  # sides between the corners are drawn in
    height = (np.maximum(1 - x**4, 0) * np.maximum(1 - z**4, 0)) ** 0.55
    w, h, d = np.array(size) / 2
    top = np.stack([x * w * drawn_in[..., 0], height * h, z * d * drawn_in[..., 1]], axis=2)
    bottom = top * np.array([1, -1, 1])
    return merged([sheet(top), sheet(bottom[:, ::-1])]).moved(*centre)


def curtain(centre: Vec, size: Vec, *, folds: int = 5, gather: float = 0.0) -> Shape:
    """Hanging cloth in folds, `size` along x, y, z; `gather` (0-1) draws it together at half its height."""
    w, h, d = size
    s = np.linspace(-1, 1, 4 * folds + 1)
    rows = (1.0, 0.62, 0.4, 0.2, 0.0) if gather else (1.0, 0.0)
    wave = np.sin((s + 1) * np.pi * folds)
    grid = []
    for y in rows:
        narrow = 1 - gather * np.exp(-(((y - 0.4) / 0.22) ** 2))
        grid.append(np.stack([s * w / 2 * narrow, np.full_like(s, (y - 0.5) * h), wave * d / 2], axis=1))
    return sheet(grid).moved(*centre)


def leaf(foot: Vec, tip: Vec, *, width: float, sag: float = 0.0, steps: int = 3) -> Shape:
    """A blade from foot to tip, widest in its middle, that sags by `sag` metres."""
    t = np.linspace(0, 1, steps + 1)[:, None]
    a, b = np.array(foot), np.array(tip)
    line = a + (b - a) * t + np.array([0, 1, 0]) * (sag * 4 * t * (1 - t))
    flat = np.cross(b - a, [0.0, 1.0, 0.0])
    side = unit(flat if np.linalg.norm(flat) > 1e-9 else np.array([1.0, 0, 0]))
    broad = width / 2 * np.sin(np.pi * (0.12 + 0.88 * t) ** 0.8)
    return sheet(np.stack([line - side * broad, line + side * broad], axis=1))


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cross product of vectors (..., 3); np.cross takes several times as long."""
    (ax, ay, az), (bx, by, bz) = ((v[..., 0], v[..., 1], v[..., 2]) for v in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _least_along(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """The axis (3,) that is least parallel to the directions (M, 3)."""
    return np.eye(3)[int(np.abs(towards).max(axis=0).argmin())]
