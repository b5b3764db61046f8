"""What furniture looks like: a few solids per family of categories."""

from typing import NamedTuple

from sim.scenes.plan import Furniture, Rgb

from .appearance import tinted
from .families import Vec, look_of


class Part(NamedTuple):
    """One solid of a piece in the piece's frame: x to its right, y up from its bottom, its front looks along +z."""

    centre: Vec
    size: Vec
    rgb: Rgb
    is_round: bool = False
    """An upright drum with the box's width as diameter, instead of the box."""


def parts_of(piece: Furniture) -> list[Part]:
    """The solids of one piece; all lie inside its box of width, height and depth (metres)."""
    family, _ = look_of(piece.category)
    return _BUILDERS[family](piece.category, piece.size, piece.finish.rgb)


def _legs(size: Vec, height: float, side: float, rgb: Rgb) -> list[Part]:
    side = min(side, size[0] / 3, size[2] / 3)
    x, z = size[0] / 2 - side / 2, size[2] / 2 - side / 2
    return [Part((sx * x, height / 2, sz * z), (side, height, side), rgb) for sx in (-1, 1) for sz in (-1, 1)]


def _table(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    top = min(0.06, h / 3)
    return [Part((0, h - top / 2, 0), (w, top, d), rgb), *_legs(size, h - top, 0.06, tinted(rgb, 0.75))]


def _seat(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    seat, thick = h * 0.5, min(0.07, h / 8)
    back_d = min(0.07, d / 4)
    return [
        Part((0, seat - thick / 2, 0), (w, thick, d), rgb),
        Part((0, (seat + h) / 2 + thick, -d / 2 + back_d / 2), (w, h - seat - 2 * thick, back_d), tinted(rgb, 0.9)),
        Part((-w / 2 + 0.03, (seat + h) / 2, -d / 2 + back_d / 2), (0.04, h - seat, back_d * 0.8), tinted(rgb, 0.7)),
        Part((w / 2 - 0.03, (seat + h) / 2, -d / 2 + back_d / 2), (0.04, h - seat, back_d * 0.8), tinted(rgb, 0.7)),
        *_legs(size, seat - thick, 0.045, tinted(rgb, 0.6)),
    ]


def _sofa(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    arm, seat, back = min(0.18, w * 0.2), h * 0.5, d * 0.28
    inner = w - 2 * arm
    cushions = 2 if w > 1.3 else 1
    step = inner / cushions
    foot = h * 0.08
    return [
        Part((0, (foot + seat * 0.75) / 2, 0), (w, seat * 0.75 - foot, d), tinted(rgb, 0.8)),
        *_legs(size, foot, 0.06, (60, 44, 32)),
        Part((0, (seat * 0.7 + h) / 2, -d / 2 + back / 2), (inner, h - seat * 0.7, back), tinted(rgb, 0.92)),
        *(Part((s * (w - arm) / 2, h * 0.42, 0), (arm, h * 0.66, d), tinted(rgb, 0.86)) for s in (-1, 1)),
        *(
            Part((-inner / 2 + step * (k + 0.5), seat * 0.9, back / 2), (step * 0.94, seat * 0.3, d - back), rgb)
            for k in range(cushions)
        ),
    ]


def _bed(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    wood: Rgb = (126, 90, 60)
    linen: Rgb = (250, 248, 240)
    mattress = h * 0.62
    pillows = 2 if w > 1.1 else 1
    return [
        Part((0, mattress * 0.25 + 0.04, 0), (w, mattress * 0.5, d), wood),
        Part((0, mattress * 0.75, 0.02), (w * 0.96, mattress * 0.46, d * 0.95), (238, 236, 230)),
        Part((0, mattress * 0.8, d * 0.14), (w * 0.985, mattress * 0.48, d * 0.7), rgb),
        Part((0, h / 2, -d / 2 + 0.03), (w, h, 0.06), tinted(wood, 0.85)),
        *(
            Part(((k + 0.5 - pillows / 2) * w * 0.46, mattress * 1.04, -d * 0.36), (w * 0.38, 0.12, d * 0.16), linen)
            for k in range(pillows)
        ),
    ]


def _cabinet(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    fronts = [Part((0, h / 2, -0.01), (w, h, d - 0.02), tinted(rgb, 0.9))]
    rows = 3 if w > 0.7 and h < 0.9 else 2 if h < 0.9 and w < 0.5 else 1
    cols = 2 if w > 0.7 and (rows == 1) else 1
    metal: Rgb = (70, 70, 74) if sum(rgb) > 300 else (206, 206, 206)
    for row in range(rows):
        for col in range(cols):
            x, y = (col + 0.5) * w / cols - w / 2, (row + 0.5) * h / rows
            fronts.append(Part((x, y, d / 2 - 0.018), (w / cols - 0.03, h / rows - 0.03, 0.02), rgb))
            if rows > 1:
                fronts.append(Part((x, y, d / 2 - 0.006), (min(0.16, w / 3), 0.02, 0.012), metal))
            else:
                side = w / cols / 2 - 0.06
                fronts.append(
                    Part((x - side if col else x + side, y, d / 2 - 0.006), (0.02, min(0.2, h / 3), 0.012), metal)
                )
    if any(word in category for word in ("wash", "dryer", "oven", "stove", "cooker", "microwave", "fireplace")):
        fronts.append(Part((0, h * 0.45, d / 2 - 0.006), (w * 0.6, h * 0.42, 0.012), (42, 46, 54)))
    return fronts


def _shelf(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    boards = max(2, round(h / 0.36) + 1)
    thick = 0.03
    found = [Part((s * (w - thick) / 2, h / 2, 0), (thick, h, d), tinted(rgb, 0.85)) for s in (-1, 1)]
    found.append(Part((0, h / 2, -d / 2 + 0.01), (w, h, 0.02), tinted(rgb, 0.7)))
    spines: tuple[Rgb, ...] = ((150, 60, 50), (60, 90, 130), (190, 160, 90), (80, 120, 80), (110, 80, 120))
    gap = (h - thick) / (boards - 1)
    for k in range(boards):
        found.append(Part((0, thick / 2 + k * gap, 0), (w, thick, d), rgb))
        if k < boards - 1:
            share = 0.35 + 0.15 * (k % 3)
            x = (-1) ** k * (w * (1 - share) / 2 - thick)
            y = thick + k * gap + gap * 0.33
            found.append(Part((x, y, 0), (w * share * 0.9, gap * 0.62, d * 0.7), spines[k % len(spines)]))
    return found


def _lamp(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    metal: Rgb = (88, 84, 80)
    shade = min(0.32, h * 0.4)
    return [
        Part((0, 0.015, 0), (w * 0.7, 0.03, d * 0.7), metal, True),
        Part((0, (h - shade) / 2, 0), (0.04, h - shade, 0.04), metal),
        Part((0, h - shade / 2, 0), (w, shade, d), rgb, True),
    ]


def _panel(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    rim = min(0.05, w / 8, h / 8)
    is_screen = any(word in category for word in ("tv", "monitor", "computer"))
    is_pane = any(word in category for word in ("mirror", "window", "glass"))
    frame = rgb if is_screen or is_pane else tinted(rgb, 0.55)
    parts = [Part((0, h / 2, -d * 0.15), (w, h, d * 0.7), frame)]
    inside = (w - 2 * rim, h - 2 * rim, d * 0.3)
    if is_screen:
        return [*parts, Part((0, h / 2, d * 0.3), inside, (58, 70, 88))]
    if is_pane:
        return [*parts, Part((0, h / 2, d * 0.3), inside, (200, 216, 226))]
    return [  # a picture: sky, ground and something in the middle
        *parts,
        Part((0, h / 2, d * 0.2), (inside[0], inside[1], d * 0.2), tinted(rgb, 1.35)),
        Part((0, rim + inside[1] * 0.2, d * 0.3), (inside[0], inside[1] * 0.4, d * 0.2), rgb),
        Part((w * 0.12, h * 0.55, d * 0.35), (inside[0] * 0.25, inside[1] * 0.4, d * 0.2), tinted(rgb, 0.7)),
    ]


def _plant(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    pot = h * 0.4 if "vase" in category else min(0.35, h * 0.35)
    leaf: Rgb = (70, 120, 62)
    wide = 0.9 if "vase" in category else 0.6
    return [
        Part((0, pot / 2, 0), (w * wide, pot, d * wide), rgb, True),
        Part((0, pot + (h - pot) * 0.2, 0), (0.04, (h - pot) * 0.4, 0.04), tinted(leaf, 0.7)),
        Part((0, pot + (h - pot) * 0.55, 0), (w * 0.8, (h - pot) * 0.5, d * 0.8), leaf, True),
        Part((w * 0.06, pot + (h - pot) * 0.85, 0.0), (w * 0.5, (h - pot) * 0.3, d * 0.5), tinted(leaf, 1.25), True),
    ]


def _flat(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    return [
        Part((0, h * 0.4, 0), (w, h * 0.8, d), tinted(rgb, 0.7)),
        Part((0, h * 0.45, 0), (w * 0.9, h * 0.9, d * 0.86), rgb),
        Part((0, h * 0.5, 0), (w * 0.45, h, d * 0.4), tinted(rgb, 1.25)),
    ]


def _toilet(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    return [
        Part((0, h * 0.75, -d * 0.38), (w, h * 0.5, d * 0.24), rgb),
        Part((0, h * 0.24, 0.02), (w * 0.55, h * 0.48, d * 0.6), tinted(rgb, 0.92)),
        Part((0, h * 0.48, d * 0.1), (w * 0.92, h * 0.12, d * 0.76), tinted(rgb, 1.05)),
    ]


def _tub(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    rim = min(0.08, w / 6, d / 6)
    return [
        Part((0, h * 0.2, 0), (w * 0.98, h * 0.4, d * 0.98), tinted(rgb, 0.85)),
        *(Part((s * (w - rim) / 2, h / 2, 0), (rim, h, d), rgb) for s in (-1, 1)),
        *(Part((0, h / 2, s * (d - rim) / 2), (w, h, rim), tinted(rgb, 0.97)) for s in (-1, 1)),
        Part((0, h * 0.95, -d / 2 + rim * 0.8), (0.04, h * 0.1, rim), (170, 174, 180)),
    ]


def _cloth(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    return [
        Part((0, h - 0.02, 0), (w, 0.04, min(d, 0.04)), (120, 118, 114)),
        Part((-w * 0.2, h * 0.48, 0), (w * 0.5, h * 0.92, d), rgb),
        Part((w * 0.27, h * 0.56, 0), (w * 0.4, h * 0.8, d * 0.8), tinted(rgb, 0.8)),
    ]


def _box(category: str, size: Vec, rgb: Rgb) -> list[Part]:
    w, h, d = size
    return [
        Part((0, h * 0.44, 0), (w, h * 0.88, d), rgb),
        Part((0, h * 0.94, 0), (w * 0.9, h * 0.12, d * 0.9), tinted(rgb, 1.15)),
    ]


_BUILDERS = {
    "table": _table, "seat": _seat, "sofa": _sofa, "bed": _bed, "cabinet": _cabinet, "shelf": _shelf, "lamp": _lamp,
    "panel": _panel, "plant": _plant, "flat": _flat, "toilet": _toilet, "tub": _tub, "cloth": _cloth, "box": _box,
}  # fmt: skip
