"""A scene as arrays, for the raycaster, the browser copies and the recordings. Made by sim/homes/open_home.py."""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.types import ClutterLevel, SceneKind
from sim.walk.navigation_map import NavigationMap

FLAT = -1
"""`face_texture` of faces that show their own colour."""
VERTEX_COLOURS = -2
"""`face_texture` of faces that show the colours of their vertices, interpolated."""
FACE_IDS = -1
"""`IdImages.face_image` of faces whose object id is `face_instance`."""
_SURFACES = ("wall", "floor", "ceiling")
"""Last words of parts of the building, such as "shower wall"."""
_BUILDING = frozenset({
    "door frame", "doorframe", "window frame", "beam", "column", "roof", "unknown", "unlabeled", "objects", "object",
    "remove", "void",
})  # fmt: skip
"""Other categories of scans that name no thing."""


@dataclass(frozen=True, slots=True)
class IdImages:
    """Object ids finer than faces: images of ids laid over the faces, as HM3D's semantic files have them."""

    images: tuple[NDArray[np.uint16], ...]
    """(h, w) object ids, 0 = none; read without interpolation."""
    face_image: NDArray[np.int16]
    """(F,) index into `images`, FACE_IDS = the face has one id."""
    face_uv: NDArray[np.float32]
    """(F, 3, 2) as `TriangleMesh.face_uv`."""


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """Triangles in the world frame with flat colours, vertex colours, or textures that vertex colours may shade."""

    vertices: NDArray[np.float32]
    """(V, 3) metres."""
    faces: NDArray[np.int32]
    """(F, 3) vertex indices."""
    face_rgb: NDArray[np.uint8]
    """(F, 3) colour of faces without texture."""
    face_instance: NDArray[np.int32]
    """(F,) object id, 0 = none."""
    face_texture: NDArray[np.int16]
    """(F,) index into `textures`, or FLAT, or VERTEX_COLOURS."""
    face_uv: NDArray[np.float32]
    """(F, 3, 2) texture coordinates per corner; (0, 0) is the top left of the image, values outside 0-1 repeat."""
    textures: tuple[NDArray[np.uint8], ...] = ()
    """(h, w, 3) images, C-contiguous."""
    vertex_rgb: NDArray[np.uint8] | None = None
    """(V, 3) with glTF's meaning of COLOR_0: faces with VERTEX_COLOURS show it, textures are multiplied by it (255 = as
    they are), FLAT faces ignore it. None = textures as they are, and no face has VERTEX_COLOURS."""
    ids: IdImages | None = None
    """Object ids finer than faces, or None."""

    def select(self, keep: NDArray[np.bool_] | NDArray[np.integer]) -> "TriangleMesh":
        """The faces where `keep` (F,) is True, or those with these numbers, with all vertices and textures."""
        return replace(
            self,
            faces=self.faces[keep],
            face_rgb=self.face_rgb[keep],
            face_instance=self.face_instance[keep],
            face_texture=self.face_texture[keep],
            face_uv=self.face_uv[keep],
            ids=self.ids and IdImages(self.ids.images, self.ids.face_image[keep], self.ids.face_uv[keep]),
        )

    def digest(self) -> str:
        """sha256 of all arrays, and of the shapes that do not follow from the number of faces."""
        total = hashlib.sha256()
        for array in (self.vertices, self.faces, self.face_rgb, self.face_instance, self.face_texture, self.face_uv):
            total.update(np.ascontiguousarray(array).data)
        more = (*self.textures, *(() if self.vertex_rgb is None else (self.vertex_rgb,)))
        if self.ids is not None:
            more = (*more, self.ids.face_image, self.ids.face_uv, *self.ids.images)
        for array in more:
            total.update(f"{array.shape}".encode())
            total.update(np.ascontiguousarray(array).data)
        return total.hexdigest()


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object of a scene, from its semantics."""

    instance_id: int
    """Equals the id in `TriangleMesh.face_instance`; 0 = the object is known by its box alone."""
    name: str
    """`<raw name>_<int>`, the episodes' key where the object is one of their goals."""
    category: str
    centre: tuple[float, float, float]
    """World metres."""
    size: tuple[float, float, float]
    """Extents along world x, y, z in metres."""

    @property
    def is_building(self) -> bool:
        """Whether it is a part of the building, or unknown: scans list floors too, and these have no useful middle."""
        category = self.category.lower()
        return category in _BUILDING or category.endswith(_SURFACES)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Scene:
    """A home that can be rendered and walked in; equal only to itself."""

    name: str
    """`TEEsavR23oF`; the content files' name."""
    kind: SceneKind
    mesh: TriangleMesh
    objects: tuple[SceneObject, ...]
    navigation: NavigationMap
    digest: str
    """sha256 of everything that distances and pictures depend on."""
    clutter: ClutterLevel = 0
    """How much furniture without a caption was added to a planned home."""
    labels: bool = False
    """Whether the pictures of robots in this home (`renderer_of`) name the category of each object in view."""
    missing_storeys: tuple[str, ...] = ()
    """Names of storeys that a schematic home must have, but that no record tells of."""

    @property
    def label(self) -> str:
        """The name of the scene in views and reports, with its kind."""
        kind = {"scan": (), "schematic": ("schematic, not HM3D",), "invented": ("invented home",)}[self.kind]
        facts = [*kind, *([f"clutter {self.clutter}"] if self.clutter else []), *(["labels"] if self.labels else [])]
        return f"{self.name} ({', '.join(facts)})" if facts else self.name
