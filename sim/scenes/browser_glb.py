"""Small GLB copies of a home for viser and Rerun: one storey without its ceiling, few triangles, few small textures."""

import PIL

from sim.cache import cached_bytes

from .atlas import atlased
from .code_digest import code_digest
from .cut import storey_mesh
from .decimate import decimated
from .glb_writer import glb_from_mesh as glb_from_mesh
from .scene import FLAT, Scene, TriangleMesh

MAX_FACES = 300_000
MAX_BYTES = 15_000_000
_MADE_BY = (
    "atlas.py", "browser_glb.py", "cut.py", "decimate.py", "decimate_kernels.py", "equal_rows.py", "glb_writer.py",
    "surface.py",
)  # fmt: skip
"""Modules whose code decides what a copy of a scene is; a change of any of them makes kept copies anew."""


def browser_glb(scene: Scene, floor_y: float, *, srgb_colours: bool = False) -> bytes:
    """One storey of a scene as binary glTF 2.0: world axes (y up), unlit, the same bytes for the same scene.

    At most MAX_FACES triangles, MAX_BYTES bytes and as many texels as `atlased` allows. Made once: the cache folder
    keeps it.

    Args:
        scene: Any home.
        floor_y: One of the scene's storey heights, metres.
        srgb_colours: Whether vertex colours are written as Rerun reads them; see `glb_from_mesh`.

    Raises:
        SceneError: No face of the scene is on that storey.
    """
    srgb_colours = srgb_colours and _has_colours(scene.mesh)
    key = f"{code_digest(*_MADE_BY)} {PIL.__version__} {scene.digest} {scene.kind} {floor_y!r} {srgb_colours}"
    return cached_bytes("glb", key, lambda: _made(scene, floor_y, srgb_colours=srgb_colours))


def _made(scene: Scene, floor_y: float, *, srgb_colours: bool) -> bytes:
    mesh = decimated(storey_mesh(scene, floor_y), max_faces=MAX_FACES)
    glb = glb_from_mesh(atlased(mesh), srgb_colours=srgb_colours)
    while len(glb) > MAX_BYTES:  # loose triangles take three times the vertices of a closed surface
        mesh = decimated(mesh, max_faces=int(0.95 * len(mesh.faces) * MAX_BYTES / len(glb)))
        glb = glb_from_mesh(atlased(mesh), srgb_colours=srgb_colours)
    return glb


def _has_colours(mesh: TriangleMesh) -> bool:
    """Whether vertex colours are shown, on their own or on textures."""
    return mesh.vertex_rgb is not None and bool((mesh.face_texture != FLAT).any())
