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
)  # fmt: skip
from .families import Family, Vec, look_of
from .shapes import Builder, Draft, Part, Shape

LEAST_SHARE = 0.6
"""A piece smaller than this share of its usual size along an axis is built at the usual size and squeezed."""
BUILDERS: dict[Family, Builder] = {
    "chair": seating.chair, "office chair": seating.office_chair, "armchair": seating.armchair, "sofa": seating.sofa,
    "stool": seating.stool, "bar chair": seating.bar_chair, "bench": seating.bench, "ottoman": seating.ottoman,
    "bed": seating.bed, "bunk bed": seating.bunk_bed, "crib": seating.crib, "table": tables.table, "desk": tables.desk,
    "counter": tables.counter, "ironing board": tables.ironing_board, "cabinet": storage.cabinet,
    "drawers": storage.chest_of_drawers, "wardrobe": storage.wardrobe, "wall cabinet": storage.wall_cabinet,
    "glass cabinet": storage.glass_cabinet, "shelf": storage.shelf, "wall shelf": storage.wall_shelf,
    "rack": storage.rack, "clothes rail": storage.clothes_rail, "toilet": bathroom.toilet, "tub": bathroom.tub,
    "sink": bathroom.sink, "shower": bathroom.shower, "glass pane": bathroom.glass_pane,
    "shower fitting": bathroom.shower_fitting, "dial": bathroom.dial, "refrigerator": appliances.refrigerator,
    "oven": appliances.oven, "stove": appliances.stove, "washing machine": appliances.washing_machine,
    "dishwasher": appliances.dishwasher, "microwave": appliances.microwave,
    "coffee machine": appliances.coffee_machine, "boiler": appliances.boiler, "extractor": appliances.extractor,
    "lamp": lamps.floor_lamp, "table lamp": lamps.table_lamp, "ceiling lamp": lamps.ceiling_lamp,
    "wall lamp": lamps.wall_lamp, "plant": plants.plant, "flowers": plants.flowers, "vase": plants.vase,
    "flat": textiles.rug, "curtain": textiles.curtains, "towel": textiles.towel, "clothes": textiles.clothes,
    "hanger": textiles.hanger, "pillow": textiles.pillow, "blanket": textiles.blanket, "picture": wall_things.picture,
    "mirror": wall_things.mirror, "tv": wall_things.tv, "monitor": wall_things.monitor, "laptop": wall_things.laptop,
    "calendar": wall_things.calendar, "clock": wall_things.clock, "board": wall_things.board,
    "electric box": wall_things.electric_box, "railing": structure.railing, "stair": structure.stair,
    "window": structure.window, "door": structure.door, "column": structure.column, "panel": structure.panel,
    "shutter": structure.shutter,
    "fireplace": structure.fireplace, "mantle": structure.mantle, "radiator": structure.radiator, "fan": structure.fan,
    "piano": machines.piano, "bicycle": machines.bicycle, "exercise bike": machines.exercise_bike,
    "treadmill": machines.treadmill, "guitar": machines.guitar, "fire extinguisher": machines.fire_extinguisher,
    "book": things.book, "bottle": things.bottle, "cup": things.cup, "bowl": things.bowl, "kettle": things.kettle,
    "speaker": things.speaker, "statue": things.statue, "candle": things.candle, "printer": things.printer,
    "telephone": things.telephone, "shoes": things.shoes, "box": things.cardboard_box, "basket": things.basket,
    "bin": things.bin_, "bag": things.bag, "backpack": things.backpack, "suitcase": things.suitcase,
    "umbrella stand": things.umbrella_stand, "toy": things.toy, "ball": things.play_ball,
}  # fmt: skip
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
    BUILDERS[family](draft, *built_at)
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
