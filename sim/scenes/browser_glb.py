"""Small GLB copies of a home for viser and Rerun: one storey without its ceiling, few triangles, few small textures."""

from sim.cache import cached_bytes

from .atlas import NUM_SHEETS, SHEET_SIDE, atlased
from .cut import storey_mesh
from .decimate import TOLERANCE, decimated
from .glb_writer import glb_from_mesh as glb_from_mesh
from .scene import VERTEX_COLOURS, Scene

VERSION = 1
"""Of the code that makes copies; raised whenever it would make another copy of the same scene."""
MAX_FACES = 300_000
MAX_BYTES = 15_000_000


def browser_glb(scene: Scene, floor_y: float, *, srgb_colours: bool = False) -> bytes:
    """One storey of a scene as binary glTF 2.0: world axes (y up), unlit, the same bytes for the same scene.

    At most MAX_FACES triangles, MAX_BYTES bytes and NUM_SHEETS textures of SHEET_SIDE pixels; textures that repeat add
    images of their own, all together no more pixels. Made once: the cache folder keeps it.

    Args:
        scene: Any home.
        floor_y: One of the scene's storey heights, metres.
        srgb_colours: Whether vertex colours are written as Rerun reads them; see `glb_from_mesh`.

    Raises:
        SceneError: No face of the scene is on that storey.
    """
    srgb_colours = srgb_colours and bool((scene.mesh.face_texture == VERTEX_COLOURS).any())
    limits = f"{MAX_FACES} {MAX_BYTES} {TOLERANCE} {NUM_SHEETS} {SHEET_SIDE}"
    key = f"{VERSION} {scene.digest} {scene.kind} {floor_y!r} {limits}{' srgb' if srgb_colours else ''}"
    return cached_bytes("glb", key, lambda: _made(scene, floor_y, srgb_colours=srgb_colours))


def _made(scene: Scene, floor_y: float, *, srgb_colours: bool) -> bytes:
    mesh = decimated(storey_mesh(scene, floor_y), max_faces=MAX_FACES)
    glb = glb_from_mesh(atlased(mesh), srgb_colours=srgb_colours)
    while len(glb) > MAX_BYTES:  # loose triangles take three times the vertices of a closed surface
        mesh = decimated(mesh, max_faces=int(0.95 * len(mesh.faces) * MAX_BYTES / len(glb)))
        glb = glb_from_mesh(atlased(mesh), srgb_colours=srgb_colours)
    return glb
