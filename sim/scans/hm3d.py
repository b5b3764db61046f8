"""HM3D's semantic annotations: `.semantic.glb` and `.semantic.txt` become object ids on a scan, and objects."""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sim.errors import SceneError

from ..mesh import SceneObject, TriangleMesh
from .glb import load_glb
from .painted_ids import PaintedMesh, painted_mesh, with_ids
from .semantic_txt import SemanticLabel, read_semantic_txt


class Semantics(NamedTuple):
    """The semantics of a scan, from its two files."""

    mesh: TriangleMesh
    """The scan with ids; 0 where a place shows the colour of no object."""
    objects: tuple[SceneObject, ...]
    """The objects with at least one vertex in the file, in the order of the text."""


def find_semantics(scan: Path, name: str) -> tuple[Path, Path] | None:
    """The semantic GLB and text beside a scan, None where there are neither.

    Raises:
        SceneError: One of the two is missing.
    """
    files = scan.with_name(f"{name}.semantic.glb"), scan.with_name(f"{name}.semantic.txt")
    there = [file.is_file() for file in files]
    if not any(there):
        return None
    if not all(there):
        missing, found = (files[0], files[1]) if there[1] else (files[1], files[0])
        raise SceneError(
            f"{found}: found without {missing.name}; expected both semantic files or none. "
            f"Copy {missing.name} beside it."
        )
    return files


def load_semantics(
    semantic_glb: Path, semantic_txt: Path, mesh: TriangleMesh, *, up: Literal["z", "y"] = "z"
) -> Semantics:
    """The objects of a scan, and the scan with their ids.

    Colours in textures (HM3D-Semantics v0.2) are read texel by texel, those of vertices (v0.1) face by face; vertex
    colours that fit the text only after encoding from linear light are encoded. A colour without a line gets id 0, no
    object (Habitat gives such colours new ids after the largest). Where two lines name one colour, the first counts.
    The box of an object is Habitat's: the largest box, in world axes, of any of its connected parts. Its name is
    `<category>_<id>`, as in PersONAL's episodes.

    Args:
        semantic_glb: The scan's surface with one colour per object.
        semantic_txt: The object of each colour.
        mesh: The scan, world frame.
        up: Up axis of `semantic_glb`, which is that of the scan.

    Raises:
        SceneError: A file is missing or damaged, or no colour of the GLB is in the text.
    """
    labels = read_semantic_txt(semantic_txt)
    painted = _painted(semantic_glb, semantic_txt, labels, up)
    boxes = _boxes(painted)
    objects = tuple(_object(label, *boxes[label.id]) for label in labels if label.id in boxes)
    return Semantics(with_ids(mesh, painted), objects)


def _painted(
    semantic_glb: Path, semantic_txt: Path, labels: tuple[SemanticLabel, ...], up: Literal["z", "y"]
) -> PaintedMesh:
    id_of_rgb = np.zeros(1 << 24, np.uint16)
    for label in reversed(labels):  # a colour of two objects goes to the first
        id_of_rgb[label.rgb] = label.id
    mesh = load_glb(semantic_glb, up=up)
    painted = painted_mesh(mesh, id_of_rgb)
    if mesh.vertex_rgb is not None:
        encoded = painted_mesh(load_glb(semantic_glb, up=up, colours="srgb"), id_of_rgb)
        if np.count_nonzero(encoded.face_id) > np.count_nonzero(painted.face_id):
            painted = encoded
    if not painted.face_id.any() and not any(image.any() for image in painted.ids.images):
        raise SceneError(
            f"{semantic_glb}: found no colour that {semantic_txt.name} names; expected the colours of its "
            f"{len(labels)} objects. Copy both files again from the same release."
        )
    return painted


def _boxes(painted: PaintedMesh) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """(lowest, highest) corner of each id's part with the largest box; faces of one id are joined by common edges."""
    corner_ids = painted.corner_ids()
    vertex_id = np.zeros(len(painted.vertices), np.int32)
    vertex_id[painted.faces] = corner_ids
    pairs = painted.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs = pairs[(vertex_id[pairs[:, 0]] == vertex_id[pairs[:, 1]]) & (vertex_id[pairs[:, 0]] > 0)]
    count = len(vertex_id)
    edges = coo_array((np.ones(len(pairs), np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    part = connected_components(edges, directed=False)[1]
    used = np.flatnonzero(vertex_id)
    if not len(used):
        return {}
    used = used[np.argsort(part[used], kind="stable")]
    starts = np.flatnonzero(np.diff(part[used], prepend=-1))
    points = painted.vertices[used].astype(np.float64)
    lows, highs = np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)
    sizes = np.diff(np.append(starts, len(used)))
    best = np.lexsort((sizes, (highs - lows).prod(axis=1)))  # the largest last; flat ones by number of vertices
    return {int(vertex_id[used[starts[k]]]): (lows[k], highs[k]) for k in best}


def _object(label: SemanticLabel, low: NDArray[np.float64], high: NDArray[np.float64]) -> SceneObject:
    x, y, z = ((low + high) / 2).tolist()
    size_x, size_y, size_z = (high - low).tolist()
    return SceneObject(label.id, label.name, label.category, (x, y, z), (size_x, size_y, size_z))
