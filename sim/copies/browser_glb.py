"""Small GLB copies of a home for viser and Rerun: one storey without its ceiling, few triangles, few small textures."""

import PIL

from sim.cache import cached_bytes

from ..mesh import FLAT, Scene, TriangleMesh
from .atlas import atlased
from .cut import storey_mesh
from .decimate import decimated
from .glb_writer import glb_from_mesh as glb_from_mesh

MAX_FACES = 300_000
MAX_BYTES = 15_000_000
VERSION = 1
"""Raise it with every change of a copy's look; stored copies with another number are ignored."""


def browser_glb(scene: Scene, floor_y: float, *, srgb_colours: bool = False) -> bytes:
    """One storey of a scene as binary glTF 2.0: world axes (y up), unlit, the same bytes for the same scene.

    It has at most MAX_FACES triangles, MAX_BYTES bytes and the texels that `atlased` allows. It is made once and kept
    in the cache folder. `floor_y` is one of the scene's storey heights (metres); `srgb_colours` as in `glb_from_mesh`.

    Raises:
        SceneError: No face of the scene is on that storey.
    """
    shows_colours = scene.mesh.vertex_rgb is not None and bool((scene.mesh.face_texture != FLAT).any())
    srgb_colours = srgb_colours and shows_colours
    key = f"{VERSION} {PIL.__version__} {scene.digest} {scene.kind} {floor_y!r} {srgb_colours}"
    return cached_bytes("glb", key, lambda: _made(scene, floor_y, srgb_colours=srgb_colours))


def whole_glb(mesh: TriangleMesh) -> bytes:
    """As `browser_glb`, of a whole mesh: a thing on which nobody can stand has no storeys."""
    return cached_bytes("glb", f"{VERSION} {PIL.__version__} {mesh.digest()} whole", lambda: _small(mesh))


def _made(scene: Scene, floor_y: float, *, srgb_colours: bool) -> bytes:
    return _small(storey_mesh(scene, floor_y), srgb_colours=srgb_colours)


def _small(mesh: TriangleMesh, *, srgb_colours: bool = False) -> bytes:
    mesh = decimated(mesh, max_faces=MAX_FACES)
    glb = glb_from_mesh(atlased(mesh), srgb_colours=srgb_colours)
    while len(glb) > MAX_BYTES:  # loose triangles take three times the vertices of a closed surface
        mesh = decimated(mesh, max_faces=int(0.95 * len(mesh.faces) * MAX_BYTES / len(glb)))
        glb = glb_from_mesh(atlased(mesh), srgb_colours=srgb_colours)
    return glb
