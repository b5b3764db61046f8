"""The colours and object ids of a mesh for compiled kernels: one record per face; textures stay in place.

`surfaces_of_mesh` makes them; raycast_kernels.py looks up what each ray of a packet sees.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.compiled import njit
from sim.errors import SceneError
from sim.mesh import FACE_IDS, FLAT, VERTEX_COLOURS, IdImages, TriangleMesh

from .embree import aligned_bytes

TextureFilter = Literal["nearest", "bilinear", "mipmap"]
FILTERS: dict[TextureFilter, int] = {"nearest": 0, "bilinear": 1, "mipmap": 2}
"""The kernels' numbers of the filters."""
LARGEST_UV = 1e6
"""Texture coordinates beyond this count as damaged: float32 no longer tells texels apart there."""
LARGEST_TEXTURE = 2**31 - 1
"""Bytes: kernels count them in 32 bits."""
_WHITE = 0xFFFFFF
_RECORD = np.dtype(
    [
        ("u0", np.float32),  # corner 0, or packed colours: see `_records`
        ("v0", np.float32),
        ("du1", np.float32),  # corner 1 - corner 0
        ("dv1", np.float32),
        ("du2", np.float32),
        ("dv2", np.float32),
        ("texture", np.int16),
        ("id_image", np.int16),
        ("instance", np.int32),
    ]
)

_LEVEL = np.dtype(
    [
        ("address", np.int64),
        ("height", np.int32),
        ("width", np.int32),
        ("first_smaller", np.int32),  # row of the level half as large
        ("num_smaller", np.int32),
    ]
)


class Surfaces(NamedTuple):
    """The arrays of a mesh that kernels read; valid as long as the images behind them live."""

    records: NDArray[np.void]
    """(F,) 32 bytes each, at a multiple of 32."""
    levels: NDArray[np.void]
    """(L,) where each texture is; its smaller levels, with `mipmap`, follow all textures."""
    id_levels: NDArray[np.void]
    """(I,) where each id image is."""
    id_uv: NDArray[np.float32]
    """(F, 3, 2), or (0, 3, 2) without id images."""
    light: NDArray[np.int32]
    """(F, 3) packed colours of the corners that textures are multiplied by; (0, 3) where no texture is changed."""


def lanes_dtype(width: int) -> np.dtype:
    """The values that the stages of colouring pass on, for each ray of a packet."""
    floats = ["u", "v", "x_share", "y_share"]
    ints = ["height", "width", "left", "right", "top", "bottom", "instance", "colour"]
    ints += ["top_left", "top_right", "bottom_left", "bottom_right", "light0", "light1", "light2"]
    fields = [(name, np.float32, (width,)) for name in floats] + [(name, np.int32, (width,)) for name in ints]
    return np.dtype([*fields, ("texels", np.int64, (width,))])


def surfaces_of_mesh(mesh: TriangleMesh, *, texture_filter: TextureFilter) -> tuple[Surfaces, tuple[NDArray, ...]]:
    """The kernels' view of a mesh, and the images that must be kept alive with it.

    Textures are not copied; with `mipmap` their smaller levels add a third.

    Raises:
        SceneError: The mesh has no faces, or an array is damaged: nan, an index out of range, a wrong type.
    """
    check_mesh(mesh)
    textures = [np.ascontiguousarray(texture) for texture in mesh.textures]
    chains = [mip_levels(texture) if texture_filter == "mipmap" else [] for texture in textures]
    images = [*textures, *(level for chain in chains for level in chain)]
    levels = _places(images)
    counts = np.array([len(chain) for chain in chains], np.int32)
    levels["num_smaller"][: len(textures)] = counts
    levels["first_smaller"][: len(textures)] = len(textures) + np.cumsum(counts) - counts
    ids = mesh.ids or IdImages((), np.empty(0, np.int16), np.empty((0, 3, 2), np.float32))
    id_images = [np.ascontiguousarray(image) for image in ids.images]
    id_uv = np.ascontiguousarray(ids.face_uv, np.float32)
    surfaces = Surfaces(_records(mesh), levels, _places(id_images), id_uv, _light(mesh))
    return surfaces, (*images, *id_images)


def mip_levels(texture: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Means of the texture (h, w, 3) over 2 x 2, 4 x 4, ... texels, down to one texel; none if it is one."""
    levels = [texture]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_halved(levels[-1]))
    return levels[1:]


def check_mesh(mesh: TriangleMesh) -> None:
    """Raises SceneError with one line if a kernel could not read the mesh safely."""
    num_faces, num_vertices = len(mesh.faces), len(mesh.vertices)
    if not num_faces:
        raise SceneError("renderer: found a mesh without faces; expected at least one. Check the scene's file.")
    _check_range("faces", mesh.faces, 0, num_vertices - 1)
    _check_within("vertices", mesh.vertices, float(np.finfo(np.float32).max))
    _check_range("face_texture", mesh.face_texture, VERTEX_COLOURS, len(mesh.textures) - 1)
    _check_within("face_uv", mesh.face_uv, LARGEST_UV)
    per_face = {"face_rgb": mesh.face_rgb, "face_instance": mesh.face_instance, "face_uv": mesh.face_uv}
    per_face["face_texture"] = mesh.face_texture
    for texture in mesh.textures:
        _check_image("a texture", texture, (np.uint8, 3))
    is_coloured = (mesh.face_texture == VERTEX_COLOURS).any()
    if is_coloured if mesh.vertex_rgb is None else len(mesh.vertex_rgb) < num_vertices:
        raise _damaged("vertex_rgb", "fewer colours than vertices", "one per vertex")
    if mesh.ids is not None:
        _check_range("ids.face_image", mesh.ids.face_image, FACE_IDS, len(mesh.ids.images) - 1)
        _check_within("ids.face_uv", mesh.ids.face_uv, LARGEST_UV)
        per_face |= {"ids.face_image": mesh.ids.face_image, "ids.face_uv": mesh.ids.face_uv}
        for image in mesh.ids.images:
            _check_image("an id image", image, (np.uint16, None))
    for name, values in per_face.items():
        if len(values) != num_faces:
            raise _damaged(name, f"{len(values)} rows", f"one for each of {num_faces} faces")


def _damaged(name: str, found: str, expected: str) -> SceneError:
    return SceneError(f"renderer: {name} has {found}; expected {expected}. Check the scene's file.")


def _check_range(name: str, values: NDArray, low: int, high: int) -> None:
    if values.min(initial=low) < low or values.max(initial=low) > high:
        wrong = values[(values < low) | (values > high)][0]
        raise _damaged(name, f"the index {wrong}", f"{low} to {high}")


def _check_within(name: str, values: NDArray, largest: float) -> None:
    with np.errstate(invalid="ignore"):
        fine = values.min(initial=0) >= -largest and values.max(initial=0) <= largest  # nan is neither
    if not fine:
        wrong = values[~(np.abs(values) <= largest)][0]
        raise _damaged(name, f"the value {wrong}", f"numbers within +-{largest:g}")


def _check_image(name: str, image: NDArray, kind: tuple[type, int | None]) -> None:
    dtype, channels = kind
    shape = image.shape[:2] if channels is None else (*image.shape[:2], channels)
    if image.dtype != dtype or image.shape != shape or not 0 < image.nbytes <= LARGEST_TEXTURE:
        form = "(h, w)" if channels is None else f"(h, w, {channels})"
        raise _damaged(name, f"shape {image.shape} of {image.dtype}", f"{form} of {np.dtype(dtype)}, at most 2 GiB")


def _records(mesh: TriangleMesh) -> NDArray[np.void]:
    """(F,) records. Faces without texture hold 24-bit colours, exact in float32, instead of coordinates.

    FLAT: the colour is in `u0`. VERTEX_COLOURS: those of the corners are in `u0`, `v0`, `du1`.
    """
    records = aligned_bytes(len(mesh.faces) * _RECORD.itemsize).view(_RECORD)
    corner = mesh.face_uv
    records["u0"], records["v0"] = corner[:, 0].T
    records["du1"], records["dv1"] = (corner[:, 1] - corner[:, 0]).T
    records["du2"], records["dv2"] = (corner[:, 2] - corner[:, 0]).T
    records["texture"], records["instance"] = mesh.face_texture, mesh.face_instance
    records["id_image"] = FACE_IDS if mesh.ids is None else mesh.ids.face_image
    flat = mesh.face_texture == FLAT
    records["u0"][flat] = _packed(mesh.face_rgb[flat])
    blended = mesh.face_texture == VERTEX_COLOURS
    if mesh.vertex_rgb is not None and blended.any():
        corners = _packed(mesh.vertex_rgb).astype(np.float32)[mesh.faces[blended]]
        for field, column in zip(("u0", "v0", "du1"), corners.T, strict=True):
            records[field][blended] = column
    return records


def _light(mesh: TriangleMesh) -> NDArray[np.int32]:
    """`Surfaces.light`; empty unless a textured face has a corner that is not white."""
    if mesh.vertex_rgb is None or not mesh.textures:
        return np.empty((0, 3), np.int32)
    light = _packed(mesh.vertex_rgb)[mesh.faces]
    changes = (light[mesh.face_texture >= 0] != _WHITE).any()
    return light if changes else np.empty((0, 3), np.int32)


def _packed(rgb: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(N,) red + 256 green + 65536 blue of colours (N, 3)."""
    return rgb.astype(np.int32) @ np.array([1, 256, 65536], np.int32)


def _places(images: Sequence[NDArray]) -> NDArray[np.void]:
    return np.array([(image.ctypes.data, *image.shape[:2], 0, 0) for image in images], _LEVEL)


@njit(cache=True, nogil=True)
def _halved(texture):
    """(h', w', 3) means; sides are halved, odd ones rounded down with blocks of up to three texels."""
    height, width = texture.shape[0], texture.shape[1]
    rows, cols = max(1, height // 2), max(1, width // 2)
    half = np.empty((rows, cols, 3), np.uint8)
    for row in range(rows):
        top, bottom = row * height // rows, (row + 1) * height // rows
        for col in range(cols):
            left, right = col * width // cols, (col + 1) * width // cols
            count = (bottom - top) * (right - left)
            for k in range(3):
                total = 0
                for y in range(top, bottom):
                    for x in range(left, right):
                        total += texture[y, x, k]
                half[row, col, k] = (total + count // 2) // count
    return half
