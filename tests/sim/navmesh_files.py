"""Writes tiny `.navmesh` files by hand: convex polygons joined where they share an edge."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.walk.navmesh_file import NavMeshSettings

Outline = NDArray[np.float64]


def plate(x0: float, z0: float, x1: float, z1: float, *, y: float = 0.0, far_y: float | None = None) -> Outline:
    """A rectangle (4, 3) in Detour's order; with `far_y` it rises from y at z0 to far_y at z1."""
    far = y if far_y is None else far_y
    return np.array([[x0, y, z0], [x0, far, z1], [x1, far, z1], [x1, y, z0]])


def l_shape() -> list[Outline]:
    """Floor of 6 x 2 m with a wing of 2 x 4 m at its right end; the inner corner is (4, 2)."""
    return [plate(0, 0, 4, 2), plate(4, 0, 6, 2), plate(4, 2, 6, 6)]


def two_storeys() -> list[Outline]:
    """The L with a 4 m long ramp from its wing up to a room at y = 3; the room under that one cannot be reached."""
    ramp = plate(4, 6, 6, 10, far_y=3.0)
    return [*l_shape(), ramp, plate(4, 10, 6, 14, y=3), plate(0, 10, 4, 14, y=3), plate(0, 10, 4, 14)]


def navmesh_bytes(
    outlines: list[Outline],
    *,
    version: int = 2,
    settings: NavMeshSettings | None = None,
    flags: dict[int, int] | None = None,
    climb: float = 0.2,
) -> bytes:
    """Content of a file of polygons, each a fan of detail triangles, under a tree of one root and its leaves.

    Args:
        outlines: Corners (K, 3) of each polygon, in Detour's order; equal edges are shared.
        version: Version of the format; version 1 has no settings.
        settings: None = Habitat's defaults.
        flags: Flags by polygon number; the others have 1.
        climb: Largest step of the agent, metres.
    """
    vertices = np.unique(np.concatenate(outlines), axis=0)
    index = [[int(np.flatnonzero((vertices == corner).all(axis=1))[0]) for corner in outline] for outline in outlines]
    owner = {(c, ring[(k + 1) % len(ring)]): p for p, ring in enumerate(index) for k, c in enumerate(ring)}
    low, high = vertices.min(axis=0) - 0.2, vertices.max(axis=0) + np.array([0.2, 1.0, 0.2])
    scale = 20.0
    polygons, details, triangles = b"", b"", b""
    for p, ring in enumerate(index):
        count = len(ring)
        across = [owner.get((ring[(k + 1) % count], ring[k]), -1) + 1 for k in range(count)]
        padded = [*ring, *[0] * (6 - count), *across, *[0] * (6 - count)]
        polygons += struct.pack("<I12HHBB", 0xFFFFFFFF, *padded, (flags or {}).get(p, 1), count, 0)
        details += struct.pack("<IIBBxx", 0, len(triangles) // 4, 0, count - 2)
        for k in range(count - 2):
            border = (k == 0) | 1 << 2 | (k == count - 3) << 4
            triangles += struct.pack("4B", 0, k + 1, k + 2, border)
    boxes = [(outline.min(axis=0) - low, outline.max(axis=0) - low) for outline in outlines]
    boxes = [(np.array(a) * scale, np.array(b) * scale + 1) for a, b in [(high * 0, high - low), *boxes]]
    tree = b"".join(
        struct.pack("<6Hi", *a.astype(int), *b.astype(int), node - 1 if node else -len(boxes))
        for node, (a, b) in enumerate(boxes)
    )
    counts = [len(outlines), len(vertices), 0, len(outlines), 0, len(triangles) // 4, len(boxes), 0, len(outlines)]
    header = struct.pack("<6i9i10f", 0x444E4156, 7, 0, 0, 0, 0, *counts, 0.88, 0.18, climb, *low, *high, scale)
    tile = header + vertices.astype("<f4").tobytes() + polygons + details + triangles + tree
    size = (high - low)[[0, 2]]
    chosen = settings or NavMeshSettings()
    values = [getattr(chosen, name) for name in NavMeshSettings.__slots__]
    middle = struct.pack("<13f3?x", *values) if version == 2 else b""
    return (
        struct.pack("<3i3f2f2i", 0x4D534554, version, 1, *low, *size, 1, len(outlines))
        + middle
        + struct.pack("<Ii", 1, len(tile))
        + tile
    )


def write_navmesh(path: Path, outlines: list[Outline], **options) -> Path:
    """Writes the content that `navmesh_bytes` makes, and returns `path`."""
    path.write_bytes(navmesh_bytes(outlines, **options))
    return path
