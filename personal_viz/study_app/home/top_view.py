"""A home's storeys as pictures from straight above, to scale: people remember them in PAN and click on them in POG.

For POG, agents get a grid of 1 m cells per storey (`grounding.oracle`): 50 x 50 m around the home. A cell holds the
texts of its objects as one vector, and most cells are empty. People get the same storeys and the same ground as a
picture in true colours: all walkable places and all objects with a margin. Its corner is on whole metres, like the
grid's, so that a cell is a whole number of pixels. The picture is cropped to the home, because the cells around it are
empty for both. The two do not hold the same information: people see shapes, colours and walls at 1 to 5 cm but no
caption; agents read the objects' captions but know nothing finer than a metre. In homes other than scans things look
plain, so people read their categories on the picture, as in the 3-D home.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from human_study.trial.events import MapPixel
from sim.cache import cached_bytes
from sim.copies.cut import storey_cut, storey_mesh
from sim.mesh import Scene
from sim.types import Camera, GridSpec

PIXELS_PER_METRE = (100, 80, 50, 40, 25, 20)
"""Possible scales; a home gets the first with which its picture has at most MAX_SIDE pixels a side."""
MAX_SIDE = 1600
MARGIN = 0.6
"""Margin around walkable places and objects, metres; the picture's edges are on the next whole metres."""
STRIP = 48
"""Height in pixels of the strip below the picture, with the storey's name and the scale."""
PAPER = (246, 246, 244)
"""Colour outside the home."""
_INK = (34, 34, 38)
_ABOVE = 400.0
"""Height of the camera over the floor (metres)."""
_TILE = 64
"""Side of the small pictures that make up the whole, in fine pixels. Each has its own camera straight above, so that a
wall of 2 m leans by less than a tenth of a pixel: a parallel projection in all but name."""
_FINE = 2
"""Fine pixels along a pixel's side; a pixel's colour is the mean of its fine pixels."""
_MADE_BY = 1
"""Version of the pictures; raise it when a change of this file changes a picture."""
_RINGS = 6
"""A name is moved by at most this many times its height."""
_NAME_SIZE, _WORD_SIZE = 22, 14
_WORD_OPACITY = 205
"""Opacity of names, out of 255: objects show through their names."""
Box = tuple[float, float, float, float]
"""(left, top, right, bottom) in pixels."""


@dataclass(frozen=True, slots=True)
class TopView:
    """One storey from above."""

    grid: GridSpec
    """The picture's pixels in the world; row 0 is at the smallest z."""
    floor_y: float
    """Height of the storey's floor, metres."""
    name: str
    """Name of the storey, such as `Storey 1 of 2`."""
    png: bytes
    """The picture, and below it STRIP rows that are not part of the grid."""

    def rgb(self) -> NDArray[np.uint8]:
        """The picture and its strip as pixels (rows + STRIP, cols, 3)."""
        return np.asarray(Image.open(io.BytesIO(self.png)).convert("RGB"))

    def jpeg(self) -> bytes:
        """The picture as a JPEG that is small enough for a browser."""
        buffer = io.BytesIO()
        Image.fromarray(self.rgb()).save(buffer, "JPEG", quality=90, subsampling=0)
        return buffer.getvalue()

    def pixel_at(self, xz: tuple[float, float]) -> MapPixel | None:
        """The place on the picture of a world point (x, z); None outside."""
        u, v = self.grid.uv_from_xz(np.array(xz)).tolist()
        rows, cols = self.grid.shape
        if not (0 <= u < cols and 0 <= v < rows):
            return None
        return MapPixel(uv=(u, v), origin_xz=self.grid.origin_xz, pixel_m=self.grid.cell, shape=self.grid.shape)


def top_views(scene: Scene, names: Sequence[str] = ()) -> tuple[TopView, ...]:
    """Every storey of a home from above, lowest first; made once, then read from the cache folder.

    Args:
        names: Name of each storey; () = `storey 1 of 2`.

    Raises:
        SceneError: A storey has no faces.
    """
    grid, heights = map_grid(scene), scene.navigation.storey_heights
    views = []
    for index, floor_y in enumerate(heights):
        name = names[index] if names else f"storey {index + 1} of {len(heights)}"
        name = name[:1].upper() + name[1:]
        key = f"top view {_MADE_BY} {scene.digest} {scene.kind} {floor_y!r} {grid} {name}"
        png = cached_bytes("png", key, lambda floor_y=floor_y, name=name: _made(scene, floor_y, grid, name))
        views.append(TopView(grid, floor_y, name, png))
    return tuple(views)


def map_grid(scene: Scene) -> GridSpec:
    """The pixels of all storeys' pictures: all walkable places and objects, out to whole metres."""
    known = [np.array([[item.centre[0], item.centre[2]] for item in scene.objects]).reshape(-1, 2)]
    for floor_y in scene.navigation.storey_heights:
        free, grid, _ = scene.navigation.top_down(floor_y)
        known.append(grid.xz_from_rc(np.argwhere(free)).reshape(-1, 2))
    xz = np.concatenate(known)
    low, high = np.floor(xz.min(axis=0) - MARGIN), np.ceil(xz.max(axis=0) + MARGIN)
    metres = high - low
    per_metre = next((count for count in PIXELS_PER_METRE if metres.max() * count <= MAX_SIDE), PIXELS_PER_METRE[-1])
    shape = (int(metres[1]) * per_metre, int(metres[0]) * per_metre)
    return GridSpec((float(low[0]), float(low[1])), 1 / per_metre, shape)


def _made(scene: Scene, floor_y: float, grid: GridSpec, name: str) -> bytes:
    """The whole picture of a storey as PNG."""
    rows, cols = grid.shape
    whole = Image.new("RGB", (cols, rows + STRIP), PAPER)
    whole.paste(Image.fromarray(_seen_from_above(scene, floor_y, grid)))
    if scene.kind != "scan":
        _write_categories(whole, scene, floor_y, grid)
    _write_strip(whole, grid, name)
    buffer = io.BytesIO()
    whole.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _seen_from_above(scene: Scene, floor_y: float, grid: GridSpec) -> NDArray[np.uint8]:
    """Pixels (rows, cols, 3) of the storey, cut under its ceiling."""
    from sim.render.raycast import Raycaster  # where its library is missing, the rest still works

    raycaster = Raycaster(storey_mesh(scene, floor_y))
    rows, cols = (_FINE * side for side in grid.shape)
    pixel = grid.cell / _FINE
    camera = Camera(_TILE, _TILE, hfov_deg=math.degrees(2 * math.atan(_TILE / 2 * pixel / _ABOVE)))
    tile_rows, tile_cols = -(-rows // _TILE), -(-cols // _TILE)
    fine = np.empty((tile_rows * _TILE, tile_cols * _TILE, 3), np.uint8)
    for row in range(tile_rows):
        middles = [((col + 0.5) * _TILE * pixel, (row + 0.5) * _TILE * pixel) for col in range(tile_cols)]
        Ts_world_down = np.stack([_T_world_down(grid, dx, dz, floor_y + _ABOVE) for dx, dz in middles])
        for col, frame in enumerate(raycaster.render_batch(Ts_world_down, camera)):
            rgb = np.where((frame.depth_m == 0)[..., None], np.array(PAPER, np.uint8), frame.rgb)
            fine[row * _TILE : (row + 1) * _TILE, col * _TILE : (col + 1) * _TILE] = rgb
    blocks = fine[:rows, :cols].reshape(grid.shape[0], _FINE, grid.shape[1], _FINE, 3)
    return np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)


def _T_world_down(grid: GridSpec, dx: float, dz: float, eye_y: float) -> NDArray[np.float64]:
    """Pose (4, 4) of a camera that looks down at a place of the grid: picture right = +x, down = +z."""
    T_world_down = np.eye(4)
    T_world_down[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    T_world_down[:3, 3] = grid.origin_xz[0] + dx, eye_y, grid.origin_xz[1] + dz
    return T_world_down


def _write_categories(picture: Image.Image, scene: Scene, floor_y: float, grid: GridSpec) -> None:
    """Writes the category of every object of the storey on the object, or as near as there is room, with a line to it.

    Every object gets its name, because it may be the one to find.
    """
    bottom_y, top_y = storey_cut(scene, floor_y)
    font = ImageFont.load_default(size=_WORD_SIZE)
    draw = ImageDraw.Draw(picture, "RGBA")
    items = [item for item in scene.objects if bottom_y <= item.centre[1] <= top_y]
    taken: list[Box] = []
    names: list[tuple[str, float, float]] = []
    for item in sorted(items, key=lambda item: (-item.size[0] * item.size[2], item.instance_id)):
        u, v = grid.uv_from_xz(np.array([item.centre[0], item.centre[2]])).tolist()
        left, top, right, bottom = draw.textbbox((u, v), item.category, font=font, anchor="mm")
        own = (left - 3, top - 2, right + 3, bottom + 2)
        box, du, dv = free_place(own, taken) or (own, 0.0, 0.0)
        taken.append(box)
        if (du, dv) != (0, 0):
            draw.line((u, v, u + du, v + dv), fill=(255, 255, 255, _WORD_OPACITY), width=2)
        names.append((item.category, u + du, v + dv))
    for box, (name, u, v) in zip(taken, names, strict=True):  # names are drawn over all lines
        draw.rounded_rectangle(box, 3, fill=(255, 255, 255, _WORD_OPACITY))
        draw.text((u, v), name, font=font, anchor="mm", fill=_INK)


def free_place(box: Box, taken: Sequence[Box], *, rings: int = _RINGS) -> tuple[Box, float, float] | None:
    """The box moved by (du, dv) to the nearest tried place where it overlaps no other; None if there is none."""
    height = box[3] - box[1] + 1
    for ring in range(rings):
        for du, dv in ((0, -1), (0, 1), (-2, 0), (2, 0), (-2, -1), (2, 1), (-2, 1), (2, -1)) if ring else ((0, 0),):
            moved = (box[0] + du * ring * height, box[1] + dv * ring * height)
            moved = (*moved, moved[0] + box[2] - box[0], moved[1] + box[3] - box[1])
            if not any(moved[0] < b[2] and b[0] < moved[2] and moved[1] < b[3] and b[1] < moved[3] for b in taken):
                return moved, du * ring * height, dv * ring * height
    return None


def _write_strip(picture: Image.Image, grid: GridSpec, name: str) -> None:
    """Writes the strip below the picture: the storey's name, and a scale bar of whole metres."""
    rows, cols = grid.shape
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(size=_NAME_SIZE)
    middle = rows + STRIP / 2
    draw.line((0, rows, cols, rows), fill=_INK, width=1)
    draw.text((12, middle), name, font=font, anchor="lm", fill=_INK)
    metres = next((count for count in (5, 2, 1) if count / grid.cell <= 0.3 * cols), 1)
    right = cols - 16
    left = right - metres / grid.cell
    draw.line((left, middle, right, middle), fill=_INK, width=3)
    for x in (left, right):
        draw.line((x, middle - 7, x, middle + 7), fill=_INK, width=3)
    draw.text((left - 10, middle), f"{metres} m", font=font, anchor="rm", fill=_INK)
