"""Reads Habitat's `.navmesh` files (Detour tile data behind an MSET header) into arrays, and checks every number.

Layout, little endian: set header, (version 2) the settings the mesh was built with, then per tile a reference, a length
and Detour's own tile. Habitat writes one tile; files with several are refused.
"""

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import DTypeLike, NDArray

from sim.errors import SceneError

MAX_CORNERS = 6
"""Most corners of a polygon (Detour's DT_VERTS_PER_POLYGON)."""
_SET_MAGIC = 0x4D534554  # "MSET"
_TILE_MAGIC = 0x444E4156  # "DNAV"
_TILE_VERSION = 7
_EXTERNAL = 0x8000
"""Set in a polygon's neighbour where the edge lies on the border of the tile."""
_MAX_BYTES = 256 << 20
"""Larger files are not homes (HM3D's files are below 1 MB)."""
_MAX_COORDINATE = 1e5
"""Metres; beyond it single precision cannot separate places of a home."""
_SET_HEADER = struct.Struct("<3i 3f2f2i")
_SETTINGS = struct.Struct("<13f 3?x")
_TILE_HEADER = struct.Struct("<15i 10f")
_POLYGON = np.dtype(
    [
        ("link", "<u4"),
        ("corners", "<u2", MAX_CORNERS),
        ("neighbours", "<u2", MAX_CORNERS),
        ("flags", "<u2"),
        ("count", "u1"),
        ("kind", "u1"),
    ]
)
_DETAIL = np.dtype([("vertex", "<u4"), ("triangle", "<u4"), ("vertices", "u1"), ("triangles", "u1"), ("pad", "u1", 2)])
_TREE_NODE = np.dtype([("low", "<u2", 3), ("high", "<u2", 3), ("index", "<i4")])
_LINK_BYTES = 12
_ADVICE = "Copy or download the file again, or remove it: then the map is made from the scan's mesh."


@dataclass(frozen=True, slots=True)
class NavMeshSettings:
    """Recast's settings for a mesh; the defaults are Habitat's (HABITAT_SEMANTICS.md 2.5). Metres, degrees, cells."""

    cell_size: float = 0.05
    cell_height: float = 0.2
    agent_height: float = 1.5
    agent_radius: float = 0.1
    agent_max_climb: float = 0.2
    agent_max_slope: float = 45.0
    region_min_size: float = 20.0
    region_merge_size: float = 20.0
    edge_max_len: float = 12.0
    edge_max_error: float = 1.3
    verts_per_poly: float = 6.0
    detail_sample_dist: float = 6.0
    detail_sample_max_error: float = 1.0
    filter_low_hanging_obstacles: bool = True
    filter_ledge_spans: bool = True
    filter_walkable_low_height_spans: bool = True


@dataclass(frozen=True, slots=True)
class NavMeshData:
    """One Detour tile, checked: every index lies inside its array and every number is finite. World metres."""

    path: Path
    """The file's path, for messages."""
    version: int
    """Version of the file, 1 or 2."""
    settings: NavMeshSettings
    """Settings of the mesh; Habitat's defaults for version 1, which does not store them."""
    digest: str
    """sha256 of the file."""
    origin: NDArray[np.float32]
    """(3,) corner of tile (0, 0)."""
    tile_size: NDArray[np.float32]
    """(2,) extent along x and z."""
    bounds: NDArray[np.float32]
    """(2, 3) lowest and highest corner of the tile."""
    climb: float
    """Highest step, metres."""
    scale: float
    """Tree units per metre."""
    vertices: NDArray[np.float32]
    """(V, 3) positions."""
    corners: NDArray[np.int32]
    """(P, 6) vertices of each polygon in order; only the first `counts` are used."""
    counts: NDArray[np.int32]
    """(P,) corners per polygon, 3-6."""
    neighbours: NDArray[np.int32]
    """(P, 6) polygon across the edge from corner k to corner k + 1, -1 = wall."""
    flags: NDArray[np.uint16]
    """(P,) bit 0 = walkable."""
    details: NDArray[np.int64]
    """(P, 4) first detail vertex, first detail triangle, number of vertices, number of triangles."""
    detail_vertices: NDArray[np.float32]
    """(D, 3) positions."""
    detail_triangles: NDArray[np.uint8]
    """(T, 4) three corners (first the polygon's own, then its detail vertices) and edge flags."""
    tree_bounds: NDArray[np.uint16]
    """(B, 2, 3) lowest and highest corner of each tree node in tree units above the tile's lowest corner."""
    tree_index: NDArray[np.int32]
    """(B,) leaf: its polygon; otherwise minus the number of nodes to skip."""


def read_navmesh(path: Path) -> NavMeshData:
    """The navigation mesh of a file, versions 1 and 2 with one tile.

    Raises:
        SceneError: The file is missing, truncated, too large, of another kind, or contradicts itself.
    """
    source = _Source(path)
    magic, version, tiles, *params = source.unpack(_SET_HEADER, "header")
    if magic != _SET_MAGIC or version not in (1, 2):
        source.refuse(f"magic {magic & 0xFFFFFFFF:#010x}, version {version}", "a .navmesh of version 1 or 2")
    if tiles != 1:
        source.refuse(f"{tiles} tiles", "one tile, as Habitat writes")
    settings = NavMeshSettings(*source.unpack(_SETTINGS, "settings")) if version == 2 else NavMeshSettings()
    _, length = source.unpack(struct.Struct("<Ii"), "tile length")
    if length != source.left:
        source.refuse(f"a tile of {length} bytes in {source.left}", "one tile that ends with the file")
    return _tile(source, version, settings, np.array(params[:3], "<f4"), np.array(params[3:5], "<f4"))


class _Source:
    """The bytes of a file, read from the front."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._at = 0
        try:
            with path.open("rb") as file:
                self.content = file.read(_MAX_BYTES + 1)
        except OSError as error:
            raise SceneError(
                f"{path}: cannot be read ({error.strerror}); expected a .navmesh file. {_ADVICE}"
            ) from None
        if len(self.content) > _MAX_BYTES:
            self.refuse(f"more than {_MAX_BYTES} bytes", "a file of a home")

    @property
    def left(self) -> int:
        return len(self.content) - self._at

    def refuse(self, found: str, expected: str) -> NoReturn:
        raise SceneError(f"{self.path}: found {found}; expected {expected}. {_ADVICE}")

    def unpack(self, form: struct.Struct, what: str) -> tuple:
        return form.unpack(self._take(form.size, what))

    def array(self, dtype: DTypeLike, shape: tuple[int, ...], what: str) -> NDArray:
        dtype = np.dtype(dtype)
        count = 1
        for side in shape:
            count *= side  # Python's integers do not overflow
        return np.frombuffer(self._take(count * dtype.itemsize, what), dtype).reshape(shape)

    def _take(self, size: int, what: str) -> bytes:
        if not 0 <= size <= self.left:
            self.refuse(f"{self.left} bytes left for the {what}", str(size))
        self._at += size
        return self.content[self._at - size : self._at]


def _tile(
    source: _Source,
    version: int,
    settings: NavMeshSettings,
    origin: NDArray[np.float32],
    tile_size: NDArray[np.float32],
) -> NavMeshData:
    """The rest of the file: one Detour tile."""
    header = source.unpack(_TILE_HEADER, "tile header")
    magic, tile_version, x, z, _layer, _user, polygons, vertices, links = header[:9]
    details, detail_vertices, detail_triangles, nodes, off_mesh, _base = header[9:15]
    if magic != _TILE_MAGIC or tile_version != _TILE_VERSION:
        source.refuse(f"tile magic {magic & 0xFFFFFFFF:#010x}, version {tile_version}", "a Detour tile of version 7")
    if min(header[6:14]) < 0 or polygons < 1:
        source.refuse(f"counts {list(header[6:14])} in the tile header", "numbers >= 0 and at least one polygon")
    if off_mesh or (x, z) != (0, 0):
        source.refuse(f"tile ({x}, {z}) with {off_mesh} off-mesh connections", "tile (0, 0) without any")
    if details != polygons or nodes < 1:
        source.refuse(
            f"{details} detail meshes and {nodes} tree nodes for {polygons} polygons", "a detail mesh each and a tree"
        )
    vertex = source.array("<f4", (vertices, 3), "vertices")
    polygon = source.array(_POLYGON, (polygons,), "polygons")
    source.array("u1", (links, _LINK_BYTES), "links")
    detail = source.array(_DETAIL, (details,), "detail meshes")
    detail_vertex = source.array("<f4", (detail_vertices, 3), "detail vertices")
    triangle = source.array("u1", (detail_triangles, 4), "detail triangles")
    node = source.array(_TREE_NODE, (nodes,), "tree")
    if source.left:
        source.refuse(f"{source.left} bytes after the tree", "the end of the file")
    neighbours = polygon["neighbours"].astype(np.int32) - 1
    columns = ("vertex", "triangle", "vertices", "triangles")
    data = NavMeshData(
        path=source.path,
        version=version,
        settings=settings,
        digest=hashlib.sha256(source.content).hexdigest(),
        origin=origin,
        tile_size=tile_size,
        bounds=np.array(header[18:24], np.float32).reshape(2, 3),
        climb=header[17],
        scale=header[24],
        vertices=vertex.astype(np.float32),
        corners=polygon["corners"].astype(np.int32),
        counts=polygon["count"].astype(np.int32),
        neighbours=np.where(polygon["neighbours"] >= _EXTERNAL, -1, neighbours),
        flags=polygon["flags"].astype(np.uint16),
        details=np.stack([detail[name].astype(np.int64) for name in columns], axis=1),
        detail_vertices=detail_vertex.astype(np.float32),
        detail_triangles=triangle.copy(),
        tree_bounds=np.stack([node["low"], node["high"]], axis=1).astype(np.uint16),
        tree_index=node["index"].astype(np.int32),
    )
    _check_numbers(source, data, (*header[15:], *origin, *tile_size))
    _check_indices(source, data, polygon["kind"] >> 6)
    return data


def _check_numbers(source: _Source, data: NavMeshData, loose: tuple[float, ...]) -> None:
    """Refuses numbers that are not finite or too large for a home."""
    for what, values in (
        ("vertices", data.vertices),
        ("detail vertices", data.detail_vertices),
        ("header", np.array(loose)),
    ):
        bad = ~(np.abs(values) <= _MAX_COORDINATE)
        if bad.any():
            source.refuse(f"{float(values[bad][0])!r} in the {what}", f"numbers within {_MAX_COORDINATE:.0f} of zero")
    extent = data.bounds[1] - data.bounds[0]
    if not (extent >= 0).all() or not (data.tile_size > 0).all() or not data.scale > 0 or not data.climb >= 0:
        source.refuse(
            f"bounds {data.bounds.tolist()}, tile size {data.tile_size.tolist()}, scale {data.scale!r}",
            "a tile of positive size",
        )
    if data.scale * float(extent.max()) > 0xFFFF:
        source.refuse(f"{data.scale!r} tree units per metre over {float(extent.max())!r} m", "at most 65535 in all")


def _check_indices(source: _Source, data: NavMeshData, kinds: NDArray[np.integer]) -> None:
    """Refuses polygons, detail triangles and tree nodes that point outside their arrays."""
    polygons, counts = len(data.counts), data.counts
    if kinds.any() or counts.min() < 3 or counts.max() > MAX_CORNERS:
        source.refuse(f"polygons with {counts.min()}-{counts.max()} corners", f"ground polygons with 3-{MAX_CORNERS}")
    is_meant = np.arange(MAX_CORNERS) < counts[:, None]
    if data.corners[is_meant].max() >= len(data.vertices):
        source.refuse(f"vertex {data.corners[is_meant].max()} in a polygon", f"less than {len(data.vertices)}")
    if data.neighbours[is_meant].max() >= polygons:
        source.refuse(f"neighbour {data.neighbours[is_meant].max()} of a polygon", f"less than {polygons}")
    vertex, triangle, vertices, triangles = data.details.T
    if (vertex + vertices).max() > len(data.detail_vertices) or triangles.min() < 1:
        source.refuse("a detail mesh without triangles or outside the detail vertices", "triangles and own vertices")
    if (triangle + triangles).max() > len(data.detail_triangles):
        source.refuse("a detail mesh outside the detail triangles", f"at most {len(data.detail_triangles)} in all")
    if triangles.sum() > len(data.detail_triangles):
        source.refuse("detail meshes that share triangles", "triangles of their own")
    owner = np.repeat(np.arange(polygons), triangles)
    rows = np.repeat(triangle - np.cumsum(triangles) + triangles, triangles) + np.arange(triangles.sum())
    if (data.detail_triangles[rows, :3].max(axis=1) >= (counts + vertices)[owner]).any():
        source.refuse("a detail triangle with a corner that its polygon lacks", "corners of the polygon's own")
    index = data.tree_index
    if index.max() >= polygons or index.min() < -len(index):
        source.refuse(f"tree indices {index.min()} to {index.max()}", f"{-len(index)} to {polygons - 1}")
