"""Furniture -> parts: the piece's family builds it at a sensible size, then it is shrunk into the piece's own box."""

import re
import zlib

import numpy as np

from sim.homes.plan import Furniture

from ...words.captions import own_words
from . import (
    appliances,
    bathroom,
    lamps,
    machines,
    plants,
    seating,
    storage,
    structure,
    tables,
    textiles,
    things,
    wall_things,
)
from .families import Vec, look_of
from .shapes import Builder, Draft, Part, Shape

LEAST_SHARE = 0.6
"""A piece smaller than this share of its usual size along an axis is built at the usual size and squeezed."""
_MODULES = (
    seating, tables, storage, bathroom, appliances, lamps, plants, textiles, wall_things, structure, machines, things,
)  # fmt: skip
BUILDERS: dict[str, Builder] = {family: build for module in _MODULES for family, build in module.BUILDERS.items()}
"""The function that builds each family."""


def parts_of(piece: Furniture) -> list[Part]:
    """The shapes of one piece, each with its finish; all lie inside its box of width, height and depth (metres).

    Equal pieces give equal parts: details that neither category nor caption gives follow from the piece's name.
    """
    family, usual, _ = look_of(piece.category)
    built_at = _vec(np.where(np.array(piece.size) < LEAST_SHARE * np.array(usual), usual, piece.size))
    words = own_words(piece.caption, piece.category).all | frozenset(re.findall(r"[a-z]+", piece.category.lower()))
    rng = np.random.default_rng(zlib.crc32(piece.name.encode()))
    draft = Draft(built_at, piece.finish, words, rng)
    BUILDERS[family](draft)
    ratio = np.array(piece.size) / built_at
    return [Part(_fitted(part.shape, ratio, piece.size), part.finish) for part in draft.parts]


def _fitted(shape: Shape, ratio: np.ndarray, size: Vec) -> Shape:
    """The shape at the piece's own size; corners that rounding or leaning moves out of the box are pushed in."""
    if (ratio < 1).any():
        shape = shape.scaled(_vec(ratio))
    w, h, d = size
    return shape._replace(corners=np.clip(shape.corners, [-w / 2, 0.0, -d / 2], [w / 2, h, d / 2]))


def _vec(values: np.ndarray) -> Vec:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
