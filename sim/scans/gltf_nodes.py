"""Places of a glTF file's meshes, from its nodes. The nodes must form trees; anything else is refused."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .gltf_file import GltfFile
from .gltf_schema import Node

MAX_NODES = 1 << 16


class PlacedMesh(NamedTuple):
    """One mesh at one node."""

    node: int
    mesh: int
    T_glb_mesh: NDArray[np.float64]
    """(4, 4) pose of the mesh in the file's frame."""


def placed_meshes(file: GltfFile) -> list[PlacedMesh]:
    """Every mesh that the file's scene shows, with the transforms of all its node's ancestors.

    The scene is the default one, else the first; without scenes all nodes are shown.

    Raises:
        SceneError: A node has two parents or is its own ancestor, or there are more than MAX_NODES.
    """
    nodes = file.document.nodes
    if len(nodes) > MAX_NODES:
        raise file.refused(f"has {len(nodes)} nodes", f"at most {MAX_NODES}", advice="Join its meshes.")
    tops = _top_nodes(file)
    roots = tops
    if file.document.scenes:
        scene = file.get("scenes", file.document.scene or 0, of="scene")
        roots = list(dict.fromkeys(scene.nodes))
        for root in roots:
            file.get("nodes", root, of="the scene")
            if root not in tops:
                raise file.refused(f"the scene names node {root}, a child of another", "nodes without parent")
    found = []
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        index, T_glb_parent = stack.pop()
        node = nodes[index]
        with np.errstate(over="ignore", invalid="ignore"):  # a resulting inf or nan is refused later
            T_glb_node = T_glb_parent @ _matrix(node)
        if node.mesh is not None:
            file.get("meshes", node.mesh, of=f"nodes.{index}")
            found.append(PlacedMesh(index, node.mesh, T_glb_node))
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
        raise file.refused(f"{len(nodes) - reached} nodes are children of each other in a circle", "trees of nodes")
    return tops


def _matrix(node: Node) -> NDArray[np.float64]:
    """(4, 4) transform of a node in its parent."""
    if node.matrix is not None:
        return np.array(node.matrix).reshape(4, 4).T
    T = np.eye(4)
    T[:3, :3] = _rotation(node.rotation) * np.array(node.scale)
    T[:3, 3] = node.translation
    return T


def _rotation(quat_xyzw: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """(3, 3) rotation of a quaternion of any length; all zeros give no rotation."""
    length = float(np.linalg.norm(quat_xyzw))
    if length == 0:
        return np.eye(3)
    # not Rs_from_quats_xyzw: arrays of one cost a file of 65,536 nodes a second more
    x, y, z, w = (value / length for value in quat_xyzw)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
