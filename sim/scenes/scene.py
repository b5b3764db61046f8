"""A scene as arrays: what the raycaster, the browser copies and the recordings read. Sources: sim/scenes/sources.py."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.types import SceneKind
from sim.world.navigation_map import NavigationMap

CUT_HEIGHT = 1.9
"""Storey copies keep faces whose centre is at most this far above the floor (metres): no ceiling, walls up to here."""
CUT_BELOW = 0.4
"""... and at most this far below it, so that a storey keeps its floor and the first steps of a stair."""


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """Triangles in the world frame with flat colours or textures."""

    vertices: NDArray[np.float32]
    """(V, 3) metres."""
    faces: NDArray[np.int32]
    """(F, 3) vertex indices."""
    face_rgb: NDArray[np.uint8]
    """(F, 3) colour of faces without texture."""
    face_instance: NDArray[np.int32]
    """(F,) object id, 0 = none."""
    face_texture: NDArray[np.int16]
    """(F,) index into `textures`, -1 = flat colour."""
    face_uv: NDArray[np.float32]
    """(F, 3, 2) texture coordinates per corner; (0, 0) is the top left of the image, values outside 0-1 repeat."""
    textures: tuple[NDArray[np.uint8], ...] = ()
    """(h, w, 3) images."""

    def select(self, keep: NDArray[np.bool_]) -> "TriangleMesh":
        """The faces where `keep` (F,) is True, with all vertices and textures."""
        return TriangleMesh(
            self.vertices,
            self.faces[keep],
            self.face_rgb[keep],
            self.face_instance[keep],
            self.face_texture[keep],
            self.face_uv[keep],
            self.textures,
        )

    def digest(self) -> str:
        """sha256 of all arrays."""
        total = hashlib.sha256()
        for array in (self.vertices, self.faces, self.face_rgb, self.face_instance, self.face_texture, self.face_uv):
            total.update(np.ascontiguousarray(array).tobytes())
        for texture in self.textures:
            total.update(np.ascontiguousarray(texture).tobytes())
        return total.hexdigest()


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object of a scene that semantics know."""

    instance_id: int
    """Positive; equals the id in `TriangleMesh.face_instance`."""
    name: str
    """`<raw name>_<int>`, the episodes' key where the object is one of their goals."""
    category: str
    centre: tuple[float, float, float]
    """World metres."""
    size: tuple[float, float, float]
    """Extents along world x, y, z in metres."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A home that can be rendered and walked in."""

    name: str
    """`TEEsavR23oF`; the content files' name."""
    kind: SceneKind
    mesh: TriangleMesh
    objects: tuple[SceneObject, ...]
    navigation: NavigationMap
    digest: str
    """sha256 of what distances and pictures depend on."""

    @property
    def label(self) -> str:
        """How views and reports must call the scene."""
        return {
            "scan": self.name,
            "schematic": f"{self.name} (schematic, not HM3D)",
            "invented": f"{self.name} (invented home)",
        }[self.kind]


def cut_storey(mesh: TriangleMesh, floor_y: float) -> TriangleMesh:
    """The mesh of one storey without ceiling, as browsers get it and as clicks are intersected."""
    centre_y = mesh.vertices[mesh.faces, 1].mean(axis=1)
    return mesh.select((centre_y >= floor_y - CUT_BELOW) & (centre_y <= floor_y + CUT_HEIGHT))
