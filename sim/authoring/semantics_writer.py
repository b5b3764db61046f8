"""Writes a home's objects as HM3D's semantic annotations, which hm3d.py and Habitat read back."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.frames import glb_zup_from_world

from ..copies.glb_writer import glb_from_mesh
from ..homes.plan import HomePlan
from ..mesh import FLAT, SceneObject, TriangleMesh
from ..scans.semantic_txt import HEADER, MAX_ID

_STEP = 0x9E3779
"""Odd, so that its multiples are different colours, far apart for neighbouring ids; 0 is black, no object."""


class SemanticFiles(NamedTuple):
    """The two semantic files of a scan."""

    glb: bytes
    """`<name>.semantic.glb`, z-up."""
    txt: bytes
    """`<name>.semantic.txt`."""


def semantic_files(
    mesh: TriangleMesh, objects: Sequence[SceneObject], *, region_of: Mapping[int, int]
) -> SemanticFiles:
    """A home's objects in HM3D's format; `load_semantics` gives the same names, categories, ids, centres and sizes.

    The boxes of objects are read from their largest connected part, so each object also gets a triangle without area
    from corner to corner of its box.

    Args:
        mesh: The home with ids, world frame.
        objects: The objects of the ids; their names are `<category>_<id>`, as in hm3d.py.
        region_of: Room number of each id; ids without one get -1, as in HM3D.
    """
    for item in objects:
        assert item.name == f"{item.category}_{item.instance_id}", item.name
        assert 0 < item.instance_id <= MAX_ID, item.instance_id
    lines = [HEADER]
    lines += [
        f'{item.instance_id},{_colour(item.instance_id):06X},"{item.category}",{region_of.get(item.instance_id, -1)}'
        for item in objects
    ]
    painted = _painted(mesh, objects)
    glb = glb_from_mesh(replace(painted, vertices=glb_zup_from_world(painted.vertices).astype(np.float32)))
    return SemanticFiles(glb, ("\n".join(lines) + "\n").encode())


def rooms_of_objects(plan: HomePlan) -> dict[int, int]:
    """The room number of each object's id in the plan's order."""
    number = {room.name: index for index, room in enumerate(plan.rooms)}
    return {
        instance: number[piece.room] for instance, piece in enumerate(plan.furniture, start=1) if piece.room in number
    }


def _colour(instance: int) -> int:
    """Colour of an instance, 0xRRGGBB."""
    return instance * _STEP & 0xFFFFFF


def _painted(mesh: TriangleMesh, objects: Sequence[SceneObject]) -> TriangleMesh:
    """The surface in one flat colour per object and black elsewhere, with the objects' boxes as triangles without area.

    Its faces have the order in which glb_writer writes those of `mesh`, so that both files match face by face.
    """
    order = np.argsort(np.where(mesh.face_texture == FLAT, -3, mesh.face_texture), kind="stable")
    ids = np.array([item.instance_id for item in objects], np.int64)
    centres = np.array([item.centre for item in objects], float).reshape(-1, 3)
    halves = np.array([item.size for item in objects], float).reshape(-1, 3) / 2
    corners = np.stack([centres - halves, centres + halves], axis=1).reshape(-1, 3)
    first = len(mesh.vertices) + 2 * np.arange(len(ids))
    instances = np.concatenate([mesh.face_instance[order].astype(np.int64), ids])
    num = len(instances)
    return TriangleMesh(
        np.concatenate([mesh.vertices, corners]).astype(np.float32),
        np.concatenate([mesh.faces[order], np.stack([first, first + 1, first + 1], axis=1)]).astype(np.int32),
        _rgb(instances),
        instances.astype(np.int32),
        np.full(num, FLAT, np.int16),
        np.zeros((num, 3, 2), np.float32),
    )


def _rgb(instances: NDArray[np.int64]) -> NDArray[np.uint8]:
    """(F, 3) colours of the instances."""
    packed = instances * _STEP & 0xFFFFFF
    return np.stack([packed >> 16, packed >> 8 & 0xFF, packed & 0xFF], axis=1).astype(np.uint8)
