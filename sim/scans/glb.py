"""Reads a GLB or glTF file into a `TriangleMesh` in the world frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.frames import Rs_from_quats_xyzw, T_world_glb_zup

from ..mesh import FLAT, VERTEX_COLOURS, TriangleMesh
from .gltf_file import MAX_ELEMENTS, GltfFile, floats, read_gltf
from .gltf_schema import Mesh, Node, Primitive
from .gltf_textures import Look, TextureSet, look_of
from .scene_files import python_command, refused

MAX_NODES = 1 << 16
MAX_PARTS = 1 << 13
MAX_EXTENT = 1e5
"""Largest distance from the origin, metres: beyond it float32 cannot hold centimetres, and no home is there."""
_POINTS, _TRIANGLES, _STRIP, _FAN = 0, 4, 5, 6
_BLOCK = 1 << 16
"""Number of vertices that are transformed together, in float64."""


class _Part(NamedTuple):
    """One primitive at one node."""

    primitive: Primitive
    T_world_mesh: NDArray[np.float64]
    """(4, 4) pose of the mesh."""
    look: Look
    is_textured: bool
    vertices: slice
    """Range of the mesh's vertices; parts of one node with the same positions and vertex colours share them."""
    faces: slice
    """Range of the mesh's faces."""


def load_glb(path: Path, *, up: Literal["z", "y"] = "z", colours: Literal["linear", "srgb"] = "linear") -> TriangleMesh:
    """The triangles of a glTF 2.0 file, with node transforms applied, in the world frame.

    Colours are unlit, as Habitat shows scans: the product of a primitive's base colour, texture and vertex colours,
    where it has them. In a mesh with vertex colours, vertices of primitives without them are white. Alpha, skins,
    morph targets, points and lines are left out. All faces have instance 0. `face_rgb` is the mean of a face's vertex
    colours where it shows only these. Basis textures need the extra `basis`.

    Args:
        path: A `.glb`, or a `.gltf` with its buffers and images inside or in the same folder.
        up: The file's up axis; HM3D is z-up, glTF's own convention is y-up.
        colours: `linear` keeps the numbers of vertex colours; `srgb` encodes them, as glTF stores linear light.

    Raises:
        SceneError: The file is missing, damaged, without faces, too large, or uses features that we cannot read.
        MissingDependencyError: The file has Basis textures and the extra `basis` is not installed.
    """
    file = read_gltf(path)
    parts = _parts(file, T_world_glb_zup if up == "z" else np.eye(4))
    if not parts and any(primitive.mode == _POINTS for mesh in file.document.meshes for primitive in mesh.primitives):
        plain = f"trimesh.load_scene({str(path)!r}).to_geometry().export({str(path.with_suffix('.ply'))!r})"
        advice = f"{python_command(f'import trimesh; {plain}')}, and open that file: it names the next command."
        raise file.refused("found points without faces", "a mesh of triangles", advice=advice)
    if not parts:
        raise file.refused("found no faces", "a mesh of triangles", advice="Export the scene with its geometry.")
    num_vertices, num_faces = max(part.vertices.stop for part in parts), parts[-1].faces.stop
    has_colours = any("COLOR_0" in part.primitive.attributes for part in parts)
    vertices = np.empty((num_vertices, 3), np.float32)
    vertex_rgb = np.full((num_vertices, 3), 255, np.uint8) if has_colours else None
    faces = np.empty((num_faces, 3), np.int32)
    face_rgb = np.empty((num_faces, 3), np.uint8)
    face_texture = np.empty(num_faces, np.int16)
    face_uv = np.zeros((num_faces, 3, 2), np.float32)
    textures = TextureSet(file)
    placed, coloured = set[int](), set[int]()
    for part in parts:
        if part.vertices.start not in placed:
            placed.add(part.vertices.start)
            _place_vertices(file, part, vertices[part.vertices])
        corners = _corners(file, part)
        np.add(corners, part.vertices.start, out=faces[part.faces], dtype=np.int32, casting="unsafe")
        attributes, look = part.primitive.attributes, part.look
        face_rgb[part.faces] = _bytes(np.array(look.plain))
        if vertex_rgb is not None and "COLOR_0" in attributes and part.vertices.start not in coloured:
            coloured.add(part.vertices.start)
            vertex_rgb[part.vertices] = _vertex_colours(file, part, srgb=colours == "srgb")
        if part.is_textured:
            uv = _texture_coordinates(file, part, corners)
            face_texture[part.faces] = textures.place(look, uv)
            face_uv[part.faces] = uv.reshape(-1, 3, 2)
        elif vertex_rgb is not None and "COLOR_0" in attributes:
            face_texture[part.faces] = VERTEX_COLOURS
            face_rgb[part.faces] = mean_rgb(vertex_rgb[faces[part.faces]])
        else:
            face_texture[part.faces] = FLAT
    require_near(path, vertices)
    instance = np.zeros(num_faces, np.int32)
    return TriangleMesh(vertices, faces, face_rgb, instance, face_texture, face_uv, textures.textures(), vertex_rgb)


def _parts(file: GltfFile, T_world_glb: NDArray[np.float64]) -> list[_Part]:
    """All primitives with triangles in the file's scene; nothing large is read or made yet."""
    parts: list[_Part] = []
    known: dict[tuple, slice] = {}
    looks: dict[int | None, Look] = {}
    num_vertices = num_faces = 0
    for node, mesh, T_world_mesh in _placed_meshes(file, T_world_glb):
        for primitive in mesh.primitives:
            if primitive.mode < _TRIANGLES or "POSITION" not in primitive.attributes:
                continue
            if primitive.material not in looks:
                looks[primitive.material] = look_of(file, primitive.material)
            look = looks[primitive.material]
            count = _count(file, primitive.attributes["POSITION"])
            faces = slice(num_faces, num_faces + _num_faces(file, primitive, count))
            if faces.stop == faces.start:
                continue
            colours = primitive.attributes.get("COLOR_0")
            is_textured = look.image is not None and look.coordinates in primitive.attributes
            tint = None if colours is None or is_textured else look.factor  # otherwise it is in the texels, or unused
            key = (node, primitive.attributes["POSITION"], colours, tint)
            vertices = known.setdefault(key, slice(num_vertices, num_vertices + count))
            parts.append(_Part(primitive, T_world_mesh, look, is_textured, vertices, faces))
            num_vertices, num_faces = max(num_vertices, vertices.stop), faces.stop
            if max(num_vertices, num_faces) > MAX_ELEMENTS:
                found = f"announces {num_vertices} vertices and {num_faces} faces"
                raise file.refused(found, f"at most {MAX_ELEMENTS} of each", advice="Split the scene.")
    return parts


def _placed_meshes(file: GltfFile, T_world_glb: NDArray[np.float64]) -> list[tuple[int, Mesh, NDArray[np.float64]]]:
    """(node, its mesh, pose (4, 4) of the mesh) of every mesh that the file's scene shows.

    The scene is the default one, else the first; without scenes all nodes are shown.
    """
    nodes = file.document.nodes
    if len(nodes) > MAX_NODES:
        raise file.refused(f"has {len(nodes)} nodes", f"at most {MAX_NODES}", advice="Join its meshes.")
    tops = _top_nodes(file)
    roots = list(tops)
    if file.document.scenes:
        scene = file.get("scenes", file.document.scene or 0, of="scene")
        roots = list(dict.fromkeys(scene.nodes))
        for root in roots:
            file.get("nodes", root, of="the scene")
            if root not in tops:
                raise file.refused(f"the scene names node {root}, a child of another", "nodes without parent")
    with np.errstate(over="ignore", invalid="ignore"):  # a resulting inf or nan is refused later
        Ts_parent_node = _local_poses(nodes)
        stack = [(root, np.eye(4)) for root in reversed(roots)]
        found, num_primitives = [], 0
        while stack:
            index, T_glb_parent = stack.pop()
            node, T_glb_node = nodes[index], T_glb_parent @ Ts_parent_node[index]
            if node.mesh is not None:
                mesh = file.get("meshes", node.mesh, of=f"nodes.{index}")
                num_primitives += len(mesh.primitives)
                if num_primitives > MAX_PARTS:
                    raise file.refused(f"shows more than {MAX_PARTS} primitives", "fewer", advice="Join its meshes.")
                found.append((index, mesh, T_world_glb @ T_glb_node))
            stack += [(child, T_glb_node) for child in reversed(node.children)]
    return found


def _top_nodes(file: GltfFile) -> dict[int, None]:
    """The nodes without parent, in order; raises SceneError unless they are the roots of trees that hold all nodes."""
    nodes = file.document.nodes
    parents: dict[int, int] = {}
    for index, node in enumerate(nodes):
        for child in node.children:
            file.get("nodes", child, of=f"nodes.{index}")
            if child in parents:
                raise file.refused(f"node {child} is a child of nodes {parents[child]} and {index}", "one parent")
            parents[child] = index
    tops = dict.fromkeys(index for index in range(len(nodes)) if index not in parents)
    reached, stack = 0, list(tops)
    while stack:
        reached += 1
        stack += nodes[stack.pop()].children
    if reached < len(nodes):
        raise file.refused(f"{len(nodes) - reached} nodes are children of each other in a cycle", "trees of nodes")
    return tops


def _local_poses(nodes: Sequence[Node]) -> NDArray[np.float64]:
    """(N, 4, 4) poses of nodes in their parents; quaternions have any length, and all zeros give no rotation."""
    Ts = np.tile(np.eye(4), (len(nodes), 1, 1))
    quats_xyzw = np.array([node.rotation for node in nodes]).reshape(-1, 4)
    lengths = np.array([np.linalg.norm(quat) for quat in quats_xyzw])
    turned = np.flatnonzero(lengths)
    Ts[turned, :3, :3] = Rs_from_quats_xyzw(quats_xyzw[turned] / lengths[turned, None])
    Ts[:, :3, :3] *= np.array([node.scale for node in nodes]).reshape(-1, 1, 3)
    Ts[:, :3, 3] = np.array([node.translation for node in nodes]).reshape(-1, 3)
    for index, node in enumerate(nodes):
        if node.matrix is not None:
            Ts[index] = np.reshape(node.matrix, (4, 4)).T
    return Ts


def _count(file: GltfFile, accessor: int) -> int:
    return file.get("accessors", accessor, of="a primitive").count


def _num_faces(file: GltfFile, primitive: Primitive, num_vertices: int) -> int:
    count = num_vertices if primitive.indices is None else _count(file, primitive.indices)
    if primitive.mode != _TRIANGLES:
        return max(count - 2, 0)
    if count % 3:
        raise file.refused(f"a primitive has {count} corners of triangles", "a multiple of 3")
    return count // 3


def _place_vertices(file: GltfFile, part: _Part, out: NDArray[np.float32]) -> None:
    """Writes the part's vertices (V, 3) into `out`, world frame."""
    accessor = part.primitive.attributes["POSITION"]
    points = _attribute(file, part, "POSITION", widths=(3,))
    normalized = file.document.accessors[accessor].normalized
    R, t = part.T_world_mesh[:3, :3], part.T_world_mesh[:3, 3]
    if not (part.T_world_mesh - np.eye(4)).any():
        out[...] = floats(points, normalized=normalized)
        return
    with np.errstate(over="ignore", invalid="ignore"):
        for first in range(0, len(points), _BLOCK):
            block = floats(points[first : first + _BLOCK], normalized=normalized).astype(np.float64)
            out[first : first + _BLOCK] = block @ R.T + t


def _corners(file: GltfFile, part: _Part) -> NDArray[np.integer]:
    """(F, 3) vertices of each face within the part; a mirroring node's faces are reversed, to keep their front side."""
    primitive, count = part.primitive, part.vertices.stop - part.vertices.start
    if primitive.indices is None:
        index = np.arange(count, dtype=np.uint32)
    else:
        index = file.elements(primitive.indices, of="a primitive")
        if index.dtype.kind != "u" or index.shape[1] != 1:
            raise file.refused(f"accessors.{primitive.indices} holds no indices", "unsigned integers")
        index = index[:, 0]
        if len(index) and int(index.max()) >= count:
            wrong = int(np.argmax(index >= count))
            found = f"face {wrong // 3} of accessors.{primitive.indices} uses vertex {int(index[wrong])}"
            raise file.refused(found, f"0 to {count - 1}, the vertices that it has")
    first = np.arange(max(len(index) - 2, 0))
    if primitive.mode == _STRIP:
        corners = index[np.stack([first, first + 1 + first % 2, first + 2 - first % 2], axis=1)]
    elif primitive.mode == _FAN:
        corners = index[np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)]
    else:
        corners = index.reshape(-1, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        mirrored = np.linalg.det(part.T_world_mesh[:3, :3]) < 0
    return corners[:, [0, 2, 1]] if mirrored else corners


def _attribute(file: GltfFile, part: _Part, name: str, *, widths: tuple[int, ...]) -> NDArray:
    """(V, width) values of a vertex attribute in the file's type, one per vertex of the part."""
    accessor = part.primitive.attributes[name]
    count = _count(file, accessor)
    num_vertices = part.vertices.stop - part.vertices.start
    if count != num_vertices:
        raise file.refused(f"{name} (accessors.{accessor}) has {count} elements", f"{num_vertices}, one per vertex")
    values = file.elements(accessor, of=name)
    if values.shape[1] not in widths or values.dtype == np.uint32:
        found = f"{name} (accessors.{accessor}) has {values.shape[1]} numbers of {values.dtype} each"
        raise file.refused(found, f"{' or '.join(map(str, widths))} numbers, not of uint32")
    return values


def _texture_coordinates(file: GltfFile, part: _Part, corners: NDArray[np.integer]) -> NDArray[np.float32]:
    """(3F, 2) texture coordinates of the corners, as in the file."""
    name = part.look.coordinates
    values = _attribute(file, part, name, widths=(2,))[corners.reshape(-1)]
    return floats(values, normalized=file.document.accessors[part.primitive.attributes[name]].normalized)


def _vertex_colours(file: GltfFile, part: _Part, *, srgb: bool) -> NDArray[np.uint8]:
    """(V, 3) vertex colours times the base colour, unless the texture includes it.

    Integers count as shares of their largest value, even where the file does not call them normalized.
    """
    colours = floats(_attribute(file, part, "COLOR_0", widths=(3, 4))[:, :3], normalized=True)
    if srgb:
        low, high = colours * 12.92, 1.055 * np.maximum(colours, 0.0031308) ** (1 / 2.4) - 0.055
        colours = np.where(colours <= 0.0031308, low, high)
    return _bytes(colours if part.is_textured else colours * np.array(part.look.factor, np.float32))


def _bytes(shares: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Shares of 0 to 1 as bytes 0 to 255, rounded; NaN becomes 0."""
    return (np.clip(np.nan_to_num(shares), 0, 1) * 255 + 0.5).astype(np.uint8)


def mean_rgb(corners: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mean colours (F, 3) of faces from those of their corners (F, 3, 3), rounded."""
    return ((2 * corners.sum(axis=1, dtype=np.uint16) + 3) // 6).astype(np.uint8)


def require_near(path: Path, vertices: NDArray[np.floating]) -> None:
    """Raises SceneError unless all vertices (V, 3) of a scene file are finite and near the origin."""
    for first in range(0, len(vertices), _BLOCK):
        usable = (np.abs(vertices[first : first + _BLOCK]) <= MAX_EXTENT).all(axis=1)
        if not usable.all():
            wrong = first + int(np.argmin(usable))
            found = f"vertex {wrong} is {vertices[wrong].tolist()}"
            expected = f"finite metres within {MAX_EXTENT:.0f} of the origin"
            raise refused(path, found, expected, advice="Export the scene again.")
