"""The detail of materials: factors by which texels are lighter or darker than their mean, repeated without a seam."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...words.finishes import Material

Shape = tuple[int, int]
"""Rows and columns of an image."""
Metres = tuple[float, float]
"""Width and height of the surface that an image covers."""
Detail = NDArray[np.float32]
"""(h, w, 1) or (h, w, 3) factors with a mean near 1."""
_SEED = 20250806
_PLANK = 0.125
"""Width of a floor's planks (metres)."""
_BOARD = 1.0
"""Length of a plank (metres)."""
_TILE = 0.3
_SLAB = 0.6
_STRANDS = 8
"""Number of strands of wicker along a side of its image."""


@lru_cache(maxsize=128)
def detail_of(material: Material, shape: Shape, metres: Metres, *, is_floor: bool = False) -> Detail:
    """Factors by which the texels of a material differ from its colour; 1 everywhere for smooth materials."""
    rng = np.random.default_rng([_SEED, *material.encode()])
    if is_floor and material == "wood":
        detail = _planks(rng, shape, metres)
    elif is_floor and material == "stone":
        detail = _stone(rng, shape, metres) * _joints(shape, metres, _SLAB)[..., None]
    else:
        detail = _DETAILS[material](rng, shape, metres) if material in _DETAILS else np.ones((*shape, 1))
    detail = np.asarray(detail, np.float32).reshape(*shape, -1)
    detail.flags.writeable = False
    return detail


def noise(rng: np.random.Generator, shape: Shape, size: tuple[float, float]) -> NDArray[np.float64]:
    """Smooth noise of this shape that repeats; mean 0, standard deviation 1.

    `size` has the standard deviations of the blur down and across, in texels.
    """
    down, across = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])
    passed = np.exp(-2 * np.pi**2 * ((size[0] * down) ** 2 + (size[1] * across) ** 2))
    passed[0, 0] = 0
    image = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * passed, shape)
    return image / image.std()


def _texels(shape: Shape, metres: Metres) -> tuple[float, float]:
    """Texels per metre down and across."""
    return shape[0] / metres[1], shape[1] / metres[0]


def _wood(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Grain along u: long streaks, fine pores and a few growth rings."""
    down, across = _texels(shape, metres)
    bend = noise(rng, shape, (0.05 * down, 0.2 * across))
    rings = np.sin(2 * np.pi * (np.arange(shape[0])[:, None] / shape[0] * round(metres[1] / 0.075)) + 3.2 * bend)
    streaks = noise(rng, shape, (0.004 * down, 0.22 * across))
    pores = noise(rng, shape, (0.7, 0.03 * across))
    return 1 + 0.055 * rings + 0.05 * streaks + 0.03 * pores


def _planks(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Planks along u, each of its own shade, with dark joints; (h, w, 3)."""
    height, width = shape
    rows, boards = max(1, round(metres[1] / _PLANK)), max(1, round(metres[0] / _BOARD))
    row = np.arange(height) * rows // height
    shift = (rng.integers(0, width // boards, rows) + (np.arange(rows) % 2) * width // (2 * boards)) % width
    col = (np.arange(width)[None] + shift[row][:, None]) % width
    board = row[:, None] * boards + col * boards // width  # (h, w)
    grain = _wood(rng, shape, metres)
    moved = rng.integers(0, (height, width), (rows * boards, 2))
    at_row = (np.arange(height)[:, None] + moved[board, 0]) % height
    grain = grain[at_row, (np.arange(width)[None] + moved[board, 1]) % width]
    tone = rng.normal(0, 0.055, rows * boards)[board][..., None]
    warmth = rng.normal(0, 0.02, rows * boards)[board][..., None] * np.array([1.0, 0.0, -1.5])
    first_row = np.diff(row, prepend=-1) != 0
    end = col * boards // width != (col - 1) % width * boards // width
    joint = np.where(first_row[:, None] | end, 0.66, 1.0)[..., None]
    return (1 + 0.75 * (grain[..., None] - 1) + tone + warmth) * joint


def _joints(shape: Shape, metres: Metres, side: float) -> NDArray[np.float64]:
    """Square tiles (h, w) that differ a little, with joints between their rounded edges."""
    places = []
    for count, length in zip(shape, metres[::-1], strict=True):
        tiles = max(1, round(length / side))
        at = (np.arange(count) + 0.5) * tiles / count
        places.append((at.astype(int), np.minimum(at % 1, 1 - at % 1) * length / tiles))
    (row, to_row), (col, to_col) = places
    number = row[:, None] * 31 + col[None] * 17
    tone = 1 + 0.03 * np.sin(number * 12.9898)
    away = np.minimum(to_row[:, None], to_col[None])  # metres from the nearest joint
    grout = np.clip((away - 0.002) / 0.003, 0, 1)
    return (0.7 + 0.3 * grout) * (1 - 0.05 * np.exp(-((away / 0.012) ** 2))) * tone


def _tile(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    down, across = _texels(shape, metres)
    glaze = noise(rng, shape, (0.05 * down, 0.05 * across))
    return _joints(shape, metres, _TILE) * (1 + 0.012 * glaze)


def _carpet(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Tufts, some of them brushed by feet."""
    down, across = _texels(shape, metres)
    brushed = noise(rng, shape, (0.06 * down, 0.06 * across))
    return 1 + 0.075 * noise(rng, shape, (0.6, 0.6)) + 0.02 * brushed


def _plaster(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    down, across = _texels(shape, metres)
    trowel = noise(rng, shape, (0.1 * down, 0.1 * across))
    return 1 + 0.006 * trowel + 0.008 * noise(rng, shape, (0.8, 0.8))


def _fabric(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Threads along both directions."""
    weft, warp = noise(rng, shape, (0.5, 5.0)), noise(rng, shape, (5.0, 0.5))
    return 1 + 0.045 * weft + 0.045 * warp


def _leather(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Grain, with creases where a noise changes its sign."""
    down, across = _texels(shape, metres)
    creases = np.exp(-((noise(rng, shape, (1.6, 1.6)) / 0.3) ** 2))
    worn = noise(rng, shape, (0.05 * down, 0.05 * across))
    return 1.03 - 0.12 * creases + 0.035 * worn


def _wicker(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Strands over and under each other."""
    y, x = (np.arange(count)[:, None] * _STRANDS / count for count in shape)
    x = x.T
    is_across = (np.floor(x) + np.floor(y)) % 2 == 0
    round_y, round_x = np.sin(np.pi * (y % 1)), np.sin(np.pi * (x % 1))
    strand = np.where(is_across, round_y**0.7 * (0.75 + 0.25 * round_x), round_x**0.7 * (0.75 + 0.25 * round_y))
    return 0.5 + 0.8 * strand + 0.04 * noise(rng, shape, (1.0, 1.0))


def _stone(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Clouds, speckles and veins; (h, w, 1)."""
    down, across = _texels(shape, metres)
    clouds = noise(rng, shape, (0.09 * down, 0.09 * across)) + 0.5 * noise(rng, shape, (0.025 * down, 0.025 * across))
    veins = np.exp(-((noise(rng, shape, (0.06 * down, 0.06 * across)) / 0.07) ** 2))
    return (1 + 0.045 * clouds - 0.09 * veins + 0.03 * noise(rng, shape, (0.6, 0.6)))[..., None]


def _metal(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Metal brushed along u."""
    return 1 + 0.03 * noise(rng, shape, (0.5, shape[1] / 6))


def _paper(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    return 1 + 0.016 * noise(rng, shape, (1.0, 1.0)) + 0.01 * noise(rng, shape, (4.0, 4.0))


def _leaf(rng: np.random.Generator, shape: Shape, metres: Metres) -> NDArray[np.float64]:
    """Leaves that lie over each other, with dark gaps; (h, w, 3)."""
    down, across = _texels(shape, metres)
    image = np.full((*shape, 3), 0.55)
    long, wide = 0.05, 0.02  # half axes, metres
    reach = int(np.ceil(long * max(down, across))) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    for _ in range(90):
        row, col = rng.integers(0, shape)
        angle, tone = rng.uniform(0, np.pi), rng.uniform(0.75, 1.4)
        along = (np.cos(angle) * x / across + np.sin(angle) * y / down) / long
        beside = (np.cos(angle) * y / down - np.sin(angle) * x / across) / wide
        inside = np.abs(beside) < 1 - along**2
        shade = tone * (1.06 - 0.22 * np.exp(-((beside / 0.14) ** 2)) - 0.16 * np.abs(beside))
        colour = shade[..., None] * np.array([tone**0.5, 1.0, 0.92])
        rows, cols = (row + np.arange(-reach, reach + 1)) % shape[0], (col + np.arange(-reach, reach + 1)) % shape[1]
        window = np.ix_(rows, cols)
        image[window] = np.where(inside[..., None], colour, image[window])
    return image


_DETAILS: dict[Material, Callable[[np.random.Generator, Shape, Metres], NDArray[np.float64]]] = {
    "wood": _wood, "tile": _tile, "carpet": _carpet, "plaster": _plaster, "fabric": _fabric, "leather": _leather,
    "wicker": _wicker, "stone": _stone, "metal": _metal, "paper": _paper, "leaf": _leaf,
}  # fmt: skip
