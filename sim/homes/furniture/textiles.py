"""Rugs, curtains, towels, clothes, hangers, pillows and blankets."""

import math

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .joinery import spread
from .lofts import circle, curtain, cushion, cylinder, lathe, sheet, stack, tube
from .palette import DARK_METAL, DARK_WOOD, LIGHT_WOOD, STEEL, fabric, is_dark, plain
from .shapes import Draft, both, box, facets, merged, rounded_box, slab


def rug(piece: Draft, w: float, h: float, d: float) -> None:
    """A flat carpet with a border, a field, and a fringe at both ends; round or oval if the caption says so."""
    finish = piece.finish
    other = Finish(material=finish.material, rgb=finish.rgb2) if finish.rgb2 else plain(finish, 0.7)
    if piece.says("round", "circular", "circle", "oval"):
        for tone, r, top in ((other, w / 2, h * 0.5), (finish, w * 0.45, h * 0.85)):
            piece.add(tone, lathe([(r, 0.0), (r, top)], sides=28, depth=d / w, caps="end"))
        return
    cream, fringe, is_wide = fabric(232, 222, 200), 0.05, w >= d
    field_w, field_d = (w - 2 * fringe, d) if is_wide else (w, d - 2 * fringe)
    rim = min(0.14, min(w, d) * 0.1)
    piece.add(other, box((0.0, h * 0.3, 0.0), (field_w, h * 0.6, field_d)))
    line = slab((0.0, h * 0.4, 0.0), (field_w - rim, h * 0.8, field_d - rim), faces="+y+x-x+z-z")
    piece.add(cream, line)
    piece.add(finish, slab((0.0, h * 0.5, 0.0), (field_w - 2 * rim, h, field_d - 2 * rim), faces="+y+x-x+z-z"))
    length = d if is_wide else w
    num = max(6, min(16, int(length / 0.12)))
    thick = length / num * 0.45
    for at in spread(num, length):
        if is_wide:
            piece.add(cream, both(slab(((w - fringe) / 2, h * 0.2, at), (fringe, h * 0.3, thick), faces="+y")))
        else:
            thread = slab((at, h * 0.2, (d - fringe) / 2), (thick, h * 0.3, fringe), faces="+y")
            piece.add(cream, both(thread, axis="z"))
    if finish.pattern in ("patterned", "floral") or (finish.pattern == "plain" and piece.rng.random() < 0.5):
        x, y, z = (field_w - 2 * rim) * 0.3, h * 1.02, (field_d - 2 * rim) * 0.36
        diamond = np.array([(x, y, 0), (0, y, -z), (-x, y, 0), (0, y, z)])
        piece.add(other, facets(diamond))
        piece.add(cream, facets(diamond * np.array([0.6, 1.04, 0.6])))


def curtains(piece: Draft, w: float, h: float, d: float) -> None:
    """A rod with finials and two gathered halves; a shower's curtain is one piece."""
    tall, half = h - 0.05, w * 0.42
    piece.add(DARK_METAL, tube([(-w / 2 + 0.03, h - 0.03, 0.0), (w / 2 - 0.03, h - 0.03, 0.0)], 0.014))
    piece.add(DARK_METAL, both(cylinder((w / 2 - 0.025, h - 0.05, 0.0), 0.024, 0.04, sides=6)))
    if piece.says("shower"):
        piece.add(piece.finish, curtain((0.0, tall / 2, 0.0), (w - 0.04, tall, d * 0.7), folds=8))
        return
    x = (w - half) / 2
    for at in (-x, x):
        piece.add(piece.finish, curtain((at, tall / 2, 0.0), (half, tall, d * 0.75), folds=5, gather=0.35))
    piece.add(plain(piece.finish, 0.6), both(box((x, tall * 0.4, 0.0), (w * 0.3, 0.05, d * 0.8))))


def towel(piece: Draft, w: float, h: float, d: float) -> None:
    """A towel with a border over a rail on the wall; its front half is longer than its back half."""
    bar, z, width = h - 0.03, max(0.0, d / 2 - 0.05), w * 0.78
    piece.add(STEEL, tube([(-w / 2 + 0.02, bar, z), (w / 2 - 0.02, bar, z)], 0.011))
    piece.add(STEEL, both(box((w / 2 - 0.03, bar, (z - d / 2) / 2), (0.02, 0.02, z + d / 2))))
    piece.add(STEEL, both(box((w / 2 - 0.03, bar, -d / 2 + 0.006), (0.05, 0.05, 0.012))))
    path = [
        (h * 0.3, -0.022), (bar - 0.04, -0.02), (bar + 0.008, -0.014), (bar + 0.018, 0.0),
        (bar + 0.008, 0.014), (bar - 0.04, 0.022), (h * 0.5, 0.026), (0.0, 0.028),
    ]  # fmt: skip
    x = np.linspace(-width / 2, width / 2, 7)
    ripple = 0.006 * np.sin(x / width * 6 * math.pi)
    grid = [np.stack([x, np.full(7, y), np.full(7, z + dz) + ripple * (1 - y / h)], axis=1) for y, dz in path]
    piece.add(piece.finish, sheet(grid))
    band = plain(piece.finish, 1.5 if is_dark(piece.finish) else 0.72)
    piece.add(band, *(slab((0.0, y, z + 0.034), (width, 0.03, 0.004), faces="+z") for y in (h * 0.12, h * 0.18)))


def garment(piece: Draft, hook: Vec, size: Vec, finish: Finish, *, is_across: bool = False) -> None:
    """Adds a shirt on a hanger below `hook`, turned by 90 degrees if `is_across`; `size`: width, height, thickness."""
    w, h, t = size
    drop, tall = 0.07, h - 0.07
    hem, chest = [(1.0, 0.92, 1.0), (0.45, 0.72, 0.85), (0.16, 0.8, 0.8)], [(0.1, 0.92, 0.55), (0.06, 0.68, 0.5)]
    levels = [(-drop - y * tall, a, b, 0.0) for y, a, b in (*hem, *chest, (0, 0.32, 0.3))]
    trunk = stack(circle(8), (w, t), levels)
    sleeve = [(w * 0.4, -drop - 0.1 * tall, 0.0), (w * 0.5, -drop - 0.58 * tall, t * 0.1)]
    sleeves = both(tube(sleeve, [w * 0.07, w * 0.055], sides=5))
    collar = [(-w * 0.12, -drop, t * 0.2), (0.0, -drop - 0.1 * h, t * 0.34), (w * 0.12, -drop, t * 0.2)]
    wire = [(0.0, -drop, 0.0), (0.0, -0.02, 0.0), (0.015, 0.01, 0.0), (0.0, 0.02, 0.0)]
    for tone, shape in (
        (finish, merged([trunk, sleeves])),
        (plain(finish, 0.7), tube(collar, 0.014, sides=4)),
        (DARK_METAL, tube(wire, 0.006, sides=4)),
    ):
        piece.add(tone, (shape.turned("y", math.pi / 2) if is_across else shape).moved(*hook))


def clothes(piece: Draft, w: float, h: float, d: float) -> None:
    """Garments side by side on a rod or one robe on a hook."""
    finish = piece.finish
    if piece.says("bathrobe", "robe", "dress", "coat", "jacket"):
        thick = min(d * 0.8, 0.24)
        piece.add(STEEL, box((0.0, h - 0.03, -d / 2 + 0.01), (0.06, 0.06, 0.02)))
        piece.add(STEEL, tube([(0.0, h - 0.03, -d / 2), (0.0, h - 0.03, 0.02)], 0.01))
        garment(piece, (0.0, h - 0.03, 0.0), (w * 0.95, h - 0.04, thick), finish)
        piece.add(plain(finish, 0.75), box((0.0, h * 0.5, 0.0), (w * 0.72, 0.045, thick * 0.9)))
        tails = [box((x, h * 0.38, thick * 0.44), (0.03, h * 0.2, 0.01)) for x in (0.03, 0.07)]
        piece.add(plain(finish, 0.75), *tails)
        return
    bar, is_across = h - 0.035, d > 0.28
    piece.add(STEEL, tube([(-w / 2, bar, 0.0), (w / 2, bar, 0.0)], 0.014))
    tones = (finish, fabric(62, 82, 126), fabric(226, 222, 212), fabric(150, 62, 58), plain(finish, 0.7))
    num = max(2, min(6, round(w / 0.16))) if is_across else max(1, round(w / 0.5))
    width = min(0.5, d * 0.95 if is_across else w / num)
    thick = min(0.13, w / num) if is_across else min(0.22, d * 0.9)
    for k, x in enumerate(spread(num, w - 0.06)):
        tall = (h - 0.05) * (0.8 + 0.2 * float(piece.rng.random()))
        garment(piece, (x, bar, 0.0), (width, tall, thick), tones[k % 5], is_across=is_across)


def hanger(piece: Draft, w: float, h: float, d: float) -> None:
    """A coat hanger on a hook."""
    wood = piece.finish if piece.finish.material in ("wood", "plastic", "metal") else LIGHT_WOOD
    y, end = h * 0.62, w / 2 - 0.02
    arch = [(-end, h * 0.28, 0), (-w * 0.2, h * 0.5, 0), (0, y, 0), (w * 0.2, h * 0.5, 0), (end, h * 0.28, 0)]
    piece.add(wood, tube(arch, 0.016))
    piece.add(wood, tube([(0.02 - end, h * 0.27, 0), (end - 0.02, h * 0.27, 0)], 0.01))
    hook = [(0, y, 0), (0, h * 0.8, 0), (0.03, h * 0.88, 0), (0.02, h * 0.97, 0), (-0.02, h * 0.95, 0)]
    piece.add(STEEL, tube(hook, 0.006, sides=4))


def pillow(piece: Draft, w: float, h: float, d: float) -> None:
    """A pillow that lies flat, or stands and leans back a little if the piece is high."""
    if h > 0.26:
        shape = cushion((0.0, 0.0, 0.0), (w, min(d * 0.8, 0.2), h * 0.98), cells=6).turned("x", math.pi / 2 - 0.18)
        piece.add(piece.finish, shape.moved(0.0, h / 2, 0.0))
        return
    piece.add(piece.finish, cushion((0.0, h / 2, 0.0), (w, h, d), cells=6))


def blanket(piece: Draft, w: float, h: float, d: float) -> None:
    """A folded stack of cloth with a fringe, or cloth hanging in folds if the piece is high."""
    finish = piece.finish
    if h > 0.55 and d < 0.35:
        piece.add(DARK_WOOD, tube([(-w / 2, h - 0.02, 0), (w / 2, h - 0.02, 0)], 0.013))
        piece.add(finish, curtain((0, (h - 0.02) / 2, 0), (w * 0.92, h - 0.02, d * 0.8), folds=4))
        return
    layers = 4 if h > 0.16 else 2
    step = h / layers
    for k in range(layers):
        at = ((0.008, -0.008)[k % 2], step * (k + 0.5), 0.01)
        piece.add(finish, rounded_box(at, (w - 0.03 - 0.012 * (k % 2), step * 1.05, d - 0.06), step * 0.45))
    for k in range(-5, 6):
        thread = slab((k / 10 * (w - 0.08), h * 0.3, d / 2 - 0.014), (0.018, h * 0.45, 0.008), faces="+z+x-x")
        piece.add(plain(finish, 0.7), thread)
    piece.add(plain(finish, 0.7), slab((0, h * 0.5, 0.0), (w * 0.12, h + 0.004, d - 0.05), faces="+y+z"))
