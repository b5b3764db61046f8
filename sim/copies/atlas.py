"""Packs many large textures as shrunk tiles into a few small sheets; finer textures shrink more."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.compiled import njit

from ..mesh import TriangleMesh

SHEET_SIDE = 1024
"""Longest side of a texture in the result (pixels)."""
NUM_SHEETS = 4
"""The result's textures have at most the pixels of this many square sheets."""
_PAD = 4
"""Pixels around a tile that repeat its rim, so that neighbours do not bleed into it."""
_STEPS = 24
"""Rounds of the search for the finest scale that fits."""


class _Use(NamedTuple):
    """The use of one texture by faces."""

    texture: int
    is_repeated: bool
    """Whether a face reaches over the image's edge; such an image stays whole, as a repeating image of its own."""
    box: tuple[int, int, int, int]
    """x0, y0, x1, y1 of the used part, texels."""
    density: float
    """Texels per square metre of surface."""

    def size(self, density: float) -> tuple[int, int]:
        """(width, height) in pixels of a copy with at most this density."""
        x0, y0, x1, y1 = self.box
        most = SHEET_SIDE - (0 if self.is_repeated else 2 * _PAD)
        factor = min(1.0, (density / self.density) ** 0.5, most / max(x1 - x0, y1 - y0))
        return max(1, round((x1 - x0) * factor)), max(1, round((y1 - y0) * factor))


class _Tile(NamedTuple):
    """The place of a copy: its top left pixel, without padding."""

    sheet: int
    x: int
    y: int
    width: int
    height: int


def atlased(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh with its textures as tiles of at most NUM_SHEETS sheets of SHEET_SIDE pixels.

    All surfaces get about the same number of texels per square metre, but never more than they have. A texture that
    repeats stays an image of its own. Unused texels are left out, and do not mix into their neighbours when tiles
    shrink.

    Args:
        mesh: Any mesh; the same mesh gives the same result.

    Returns:
        The same faces; coordinates of tiles are inside 0-1.
    """
    face_uv = _unwrapped(mesh)
    uses = [_use_of(mesh, face_uv, int(texture)) for texture in np.unique(mesh.face_texture[mesh.face_texture >= 0])]
    if not uses:
        return replace(mesh, textures=())
    tiles = _packed(uses)
    sizes = np.zeros((max(tile.sheet for tile in tiles) + 1, 2), int)
    for use, tile in zip(uses, tiles, strict=True):
        pad = 0 if use.is_repeated else _PAD
        sizes[tile.sheet] = np.maximum(sizes[tile.sheet], [tile.y + tile.height + pad, tile.x + tile.width + pad])
    sheets = [np.zeros((height, width, 3), np.uint8) for height, width in sizes]
    face_texture, new_uv = mesh.face_texture.copy(), face_uv.copy()
    for use, tile in zip(uses, tiles, strict=True):
        here = mesh.face_texture == use.texture
        face_texture[here] = tile.sheet
        sheet, image = sheets[tile.sheet], mesh.textures[use.texture]
        if use.is_repeated:
            sheet[:] = _shrunk(image, np.ones(image.shape[:2], bool), use.box, tile.width, tile.height)
            continue
        size = np.array(image.shape[1::-1], float)
        is_used = _covered(face_uv[here] * size, *image.shape[:2])
        pixels = _shrunk(image, is_used, use.box, tile.width, tile.height, pad=_PAD)
        y, x = tile.y - _PAD, tile.x - _PAD
        sheet[y : y + pixels.shape[0], x : x + pixels.shape[1]] = pixels
        low, high = np.array(use.box[:2]), np.array(use.box[2:])
        share = np.clip((face_uv[here] * size - low) / (high - low), 0, 1)
        place = np.array([tile.x, tile.y]) + share * [tile.width, tile.height]
        new_uv[here] = place / [sheet.shape[1], sheet.shape[0]]
    return replace(mesh, face_texture=face_texture, face_uv=new_uv.astype(np.float32), textures=tuple(sheets))


def _unwrapped(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Texture coordinates (F, 3, 2) moved by whole images so that each face begins in 0-1.

    Coordinates up to half a texel outside the image are rounding errors, not a repetition.
    """
    uv = mesh.face_uv.astype(float)
    sizes = np.array([image.shape[1::-1] for image in mesh.textures] or [(1, 1)], float)
    slack = 0.5 / sizes[np.maximum(mesh.face_texture, 0)]
    return uv - np.floor(uv.min(axis=1) + slack)[:, None]


def _use_of(mesh: TriangleMesh, face_uv: NDArray[np.float64], texture: int) -> _Use:
    """The use of this texture by its faces."""
    here = mesh.face_texture == texture
    height, width = mesh.textures[texture].shape[:2]
    texels = face_uv[here] * [width, height]
    corners = mesh.vertices[mesh.faces[here]].astype(float)
    a, b, c = np.moveaxis(corners, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    p, q, r = np.moveaxis(texels, 1, 0)
    (qx, qy), (rx, ry) = (q - p).T, (r - p).T
    num_texels = np.abs(qx * ry - qy * rx).sum() / 2
    density = max(num_texels, 1.0) / max(area, 1e-9)
    low, high = texels.min(axis=(0, 1)), texels.max(axis=(0, 1))
    if (high > np.array([width, height]) + 0.5).any():
        return _Use(texture, True, (0, 0, width, height), density)
    x0, y0 = np.maximum(np.floor(low).astype(int) - 1, 0)
    x1, y1 = np.minimum(np.ceil(high).astype(int) + 1, [width, height])
    return _Use(texture, False, (int(x0), int(y0), int(x1), int(y1)), density)


def _packed(uses: list[_Use]) -> list[_Tile]:
    """A tile for each use, at the finest density that fits."""
    fine = max(use.density for use in uses)
    tiles = _placed(uses, fine)
    if tiles is not None:
        return tiles
    coarse = fine
    while tiles is None:
        coarse /= 16
        tiles = _placed(uses, coarse)
    for _ in range(_STEPS):
        middle = (coarse * fine) ** 0.5
        tried = _placed(uses, middle)
        if tried is None:
            fine = middle
        else:
            coarse, tiles = middle, tried
    return tiles


def _placed(uses: list[_Use], density: float) -> list[_Tile] | None:
    """Tiles of this density in shelves, the highest first; None when they need more than NUM_SHEETS."""
    sizes = [use.size(density) for use in uses]
    tiles: dict[int, _Tile] = {}
    alone = [index for index, use in enumerate(uses) if use.is_repeated]
    left = NUM_SHEETS * SHEET_SIDE**2 - sum(sizes[index][0] * sizes[index][1] for index in alone)
    sheet, x, y, shelf = -1, SHEET_SIDE, SHEET_SIDE, 0
    for index in sorted(range(len(uses)), key=lambda index: (-sizes[index][1], index)):
        if uses[index].is_repeated:
            continue
        width, height = sizes[index][0] + 2 * _PAD, sizes[index][1] + 2 * _PAD
        if x + width > SHEET_SIDE:
            x, y, shelf = 0, y + shelf, height
        if y + height > SHEET_SIDE:
            sheet, x, y, shelf = sheet + 1, 0, 0, height
        tiles[index] = _Tile(sheet, x + _PAD, y + _PAD, *sizes[index])
        x += width
    if (sheet + 1) * SHEET_SIDE**2 > left and any(size != (1, 1) for size in sizes):
        return None
    for number, index in enumerate(alone, start=sheet + 1):
        tiles[index] = _Tile(number, 0, 0, *sizes[index])
    return [tiles[index] for index in range(len(uses))]


def _shrunk(
    image: NDArray[np.uint8],
    is_used: NDArray[np.bool_],
    box: tuple[int, int, int, int],
    width: int,
    height: int,
    *,
    pad: int = 0,
) -> NDArray[np.uint8]:
    """Means of the used texels in a box of the image, (height + 2 pad, width + 2 pad, 3); gaps take the nearest."""
    total, count = _sums(image, is_used, *box, width, height)
    total, count = (np.pad(array, ((pad, pad), (pad, pad), (0, 0))) for array in (total, count[..., None]))
    empty = count[..., 0] == 0
    if empty.all():
        empty[:] = False
    rgb = np.rint(total / np.maximum(count, 1)).astype(np.uint8)
    if not empty.any():
        return rgb
    rows, cols = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)  # type: ignore[misc]
    return rgb[rows, cols]


@njit(cache=True, nogil=True)
def _sums(image, is_used, x0, y0, x1, y1, width, height):
    """Sum of colours (height, width, 3) and number (height, width) of the used texels in each pixel of the copy."""
    total, count = np.zeros((height, width, 3), np.int64), np.zeros((height, width), np.int64)
    for y in range(y0, y1):
        row = (2 * (y - y0) + 1) * height // (2 * (y1 - y0))
        for x in range(x0, x1):
            if is_used[y, x]:
                col = (2 * (x - x0) + 1) * width // (2 * (x1 - x0))
                count[row, col] += 1
                for channel in range(3):
                    total[row, col, channel] += image[y, x, channel]
    return total, count


@njit(cache=True, nogil=True)
def _covered(corners, height, width):
    """(height, width) whether a texel is inside a face, whose corners (F, 3, 2) are in texels, or within 1 of it."""
    result = np.zeros((height, width), np.bool_)
    for f in range(len(corners)):
        ax, ay = corners[f, 0, 0] - 0.5, corners[f, 0, 1] - 0.5
        bx, by = corners[f, 1, 0] - 0.5, corners[f, 1, 1] - 0.5
        cx, cy = corners[f, 2, 0] - 0.5, corners[f, 2, 1] - 0.5
        turn = 1.0 if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) >= 0 else -1.0
        # distances from the edges are linear: e = nx * x + ny * y + d, at least -1 near the face
        n0x, n0y = turn * (ay - by), turn * (bx - ax)
        n1x, n1y = turn * (by - cy), turn * (cx - bx)
        n2x, n2y = turn * (cy - ay), turn * (ax - cx)
        l0, l1, l2 = (n0x**2 + n0y**2) ** 0.5, (n1x**2 + n1y**2) ** 0.5, (n2x**2 + n2y**2) ** 0.5
        for y in range(max(int(min(ay, by, cy)) - 1, 0), min(int(max(ay, by, cy)) + 3, height)):
            for x in range(max(int(min(ax, bx, cx)) - 1, 0), min(int(max(ax, bx, cx)) + 3, width)):
                if (
                    n0x * (x - ax) + n0y * (y - ay) >= -l0
                    and n1x * (x - bx) + n1y * (y - by) >= -l1
                    and n2x * (x - cx) + n2y * (y - cy) >= -l2
                ):
                    result[y, x] = True
    return result
