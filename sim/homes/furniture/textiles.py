"""Rugs, curtains, towels, clothes and hangers."""

import math

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .lofts import circle, curtain, cylinder, lathe, loft, sheet, tube
from .order import Builder, Order, Part, made_of
from .palette import DARK_METAL, LIGHT_WOOD, STEEL, is_dark, plain
from .shapes import box, facets, slab


def rug(order: Order) -> list[Part]:
    """A flat carpet: border, field, fringe at both ends; round or oval where the caption says so."""
    w, h, d = order.size
    finish = order.finish
    other = Finish(material=finish.material, rgb=finish.rgb2) if finish.rgb2 else plain(finish, 0.7)
    if order.says("round", "circular", "circle", "oval"):
        rings = ((1.0, 0.5, other), (0.9, 0.85, finish))
        return [
            made_of(f, lathe([(r * w / 2, 0.0), (r * w / 2, h * t)], sides=28, depth=d / w, caps="end"))
            for r, t, f in rings
        ]
    fringe = 0.05
    long_x = w >= d
    field_w, field_d = (w - 2 * fringe, d) if long_x else (w, d - 2 * fringe)
    rim = min(0.14, min(w, d) * 0.1)
    base = box((0.0, h * 0.3, 0.0), (field_w, h * 0.6, field_d))
    inner = slab((0.0, h * 0.5, 0.0), (field_w - 2 * rim, h, field_d - 2 * rim), faces="+y+x-x+z-z")
    line = slab((0.0, h * 0.4, 0.0), (field_w - rim, h * 0.8, field_d - rim), faces="+y+x-x+z-z")
    threads = []
    length = d if long_x else w
    num = max(6, min(16, int(length / 0.12)))
    for k in range(num):
        at = (k + 0.5) / num * length - length / 2
        for s in (-1, 1):
            if long_x:
                threads.append(
                    slab((s * (w - fringe) / 2, h * 0.2, at), (fringe, h * 0.3, length / num * 0.45), faces="+y")
                )
            else:
                threads.append(
                    slab((at, h * 0.2, s * (d - fringe) / 2), (length / num * 0.45, h * 0.3, fringe), faces="+y")
                )
    cream = Finish(material="fabric", rgb=(232, 222, 200))
    parts = [made_of(other, base), made_of(cream, line, *threads), made_of(finish, inner)]
    if finish.pattern in ("patterned", "floral") or (finish.pattern == "plain" and order.rng.random() < 0.5):
        x, z = (field_w - 2 * rim) * 0.3, (field_d - 2 * rim) * 0.36
        y = h * 1.02
        diamond = np.array([(x, y, 0), (0, y, -z), (-x, y, 0), (0, y, z)])
        parts += [made_of(other, facets(diamond)), made_of(cream, facets(diamond * np.array([0.6, 1.04, 0.6])))]
    return parts


def curtains(order: Order) -> list[Part]:
    """A rod with finials and two gathered halves; one in a shower."""
    w, h, d = order.size
    z = 0.0
    rod = tube([(-w / 2 + 0.03, h - 0.03, z), (w / 2 - 0.03, h - 0.03, z)], 0.014)
    ends = [cylinder((s * (w / 2 - 0.025), h - 0.05, z), 0.024, 0.04, sides=6) for s in (-1, 1)]
    tall, amount = h - 0.05, 0.0
    if order.says("shower"):
        cloth = [curtain((0.0, tall / 2, z), (w - 0.04, tall, d * 0.7), folds=8)]
    else:
        part, amount = w * 0.42, 0.35
        cloth = [
            curtain((s * (w - part) / 2, tall / 2, z), (part, tall, d * 0.75), folds=5, gather=amount) for s in (-1, 1)
        ]
    bands = (
        []
        if not amount
        else [
            made_of(plain(order.finish, 0.6), box((s * (w - w * 0.42) / 2, tall * 0.4, z), (w * 0.3, 0.05, d * 0.8)))
            for s in (-1, 1)
        ]
    )
    return [made_of(DARK_METAL, rod, *ends), made_of(order.finish, *cloth), *bands]


def towel(order: Order) -> list[Part]:
    """A towel over a rail on the wall, with a border; front half longer than the back half."""
    w, h, d = order.size
    bar, z = h - 0.03, max(0.0, d / 2 - 0.05)
    rail = tube([(-w / 2 + 0.02, bar, z), (w / 2 - 0.02, bar, z)], 0.011)
    arms = [box((s * (w / 2 - 0.03), bar, (z - d / 2) / 2), (0.02, 0.02, z + d / 2)) for s in (-1, 1)]
    plates = [box((s * (w / 2 - 0.03), bar, -d / 2 + 0.006), (0.05, 0.05, 0.012)) for s in (-1, 1)]
    width = w * 0.78
    path = [
        (h * 0.3, -0.022),
        (bar - 0.04, -0.02),
        (bar + 0.008, -0.014),
        (bar + 0.018, 0.0),
        (bar + 0.008, 0.014),
        (bar - 0.04, 0.022),
        (h * 0.5, 0.026),
        (0.0, 0.028),
    ]
    x = np.linspace(-width / 2, width / 2, 7)
    ripple = 0.006 * np.sin(x / width * 6 * math.pi)
    grid = [np.stack([x, np.full(7, y), np.full(7, z + dz) + ripple * (1 - y / h)], axis=1) for y, dz in path]
    cloth = sheet(grid)
    band = plain(order.finish, 0.72) if not is_dark(order.finish) else plain(order.finish, 1.5)
    bands = [slab((0.0, y, z + 0.034), (width, 0.03, 0.004), faces="+z") for y in (h * 0.12, h * 0.18)]
    return [made_of(STEEL, rail, *arms, *plates), made_of(order.finish, cloth), made_of(band, *bands)]


def garment(hook: Vec, size: Vec, finish: Finish, *, is_across: bool = False) -> list[Part]:
    """A shirt on a hanger below `hook`; `size` is width, height, thickness; across = turned by a right angle."""
    w, h, t = size
    y = [0.0, -0.06, -0.1, -0.16, -0.45, -1.0]
    half = [0.16, 0.34, 0.46, 0.4, 0.36, 0.46]
    thick = [0.3, 0.5, 0.55, 0.8, 0.85, 1.0]
    ring = circle(8)
    drop = 0.07
    rings = [
        np.stack([ring[:, 0] * a * w, np.full(8, b * (h - drop) - drop), ring[:, 1] * c * t / 2], axis=1)
        for a, b, c in reversed(list(zip(half, y, thick, strict=True)))
    ]
    shapes = [loft(rings)]
    for s in (-1, 1):
        top = (s * w * 0.4, -drop - 0.1 * (h - drop), 0.0)
        end = (s * w * 0.5, -drop - 0.58 * (h - drop), t * 0.1)
        shapes.append(tube([top, end], [w * 0.07, w * 0.055], sides=5))
    collar = tube(
        [(-w * 0.12, -drop, t * 0.2), (0.0, -drop - 0.1 * h, t * 0.34), (w * 0.12, -drop, t * 0.2)], 0.014, sides=4
    )
    hanger = tube([(0.0, -drop, 0.0), (0.0, -0.02, 0.0), (0.015, 0.01, 0.0), (0.0, 0.02, 0.0)], 0.006, sides=4)
    pieces = [(shapes, finish), ([collar], plain(finish, 0.7)), ([hanger], DARK_METAL)]
    parts = [made_of(f, *found) for found, f in pieces]
    turned = [part.shape.turned("y", math.pi / 2) if is_across else part.shape for part in parts]
    return [Part(shape.moved(*hook), part.finish) for shape, part in zip(turned, parts, strict=True)]


def clothes(order: Order) -> list[Part]:
    """Garments side by side on a rod or one robe on a hook."""
    w, h, d = order.size
    if order.says("bathrobe", "robe", "dress", "coat", "jacket"):
        plate = box((0.0, h - 0.03, -d / 2 + 0.01), (0.06, 0.06, 0.02))
        peg = tube([(0.0, h - 0.03, -d / 2), (0.0, h - 0.03, 0.02)], 0.01)
        thick = min(d * 0.8, 0.24)
        belt = box((0.0, h * 0.5, 0.0), (w * 0.72, 0.045, thick * 0.9))
        tails = [box((0.03 + k * 0.04, h * 0.38, thick * 0.44), (0.03, h * 0.2, 0.01)) for k in (0, 1)]
        return [
            made_of(STEEL, plate, peg),
            *garment((0.0, h - 0.03, 0.0), (w * 0.95, h - 0.04, thick), order.finish),
            made_of(plain(order.finish, 0.75), belt, *tails),
        ]
    bar = h - 0.035
    rail = [tube([(-w / 2, bar, 0.0), (w / 2, bar, 0.0)], 0.014)]
    first = order.finish
    tones = (
        first,
        Finish(material="fabric", rgb=(62, 82, 126)),
        Finish(material="fabric", rgb=(226, 222, 212)),
        Finish(material="fabric", rgb=(150, 62, 58)),
        plain(first, 0.7),
    )
    across = d > 0.28
    num = max(2, min(6, round(w / 0.16))) if across else max(1, round(w / 0.5))
    parts = [made_of(STEEL, *rail)]
    for k in range(num):
        x = (k + 0.5 - num / 2) * (w - 0.06) / num
        tall = (h - 0.05) * (0.8 + 0.2 * float(order.rng.random()))
        parts += garment(
            (x, bar, 0.0),
            (min(0.5, d * 0.95 if across else w / num), tall, min(0.13, w / num) if across else min(0.22, d * 0.9)),
            tones[k % 5],
            is_across=across,
        )
    return parts


def hanger(order: Order) -> list[Part]:
    """A coat hanger on a hook."""
    w, h, _ = order.size
    wood = order.finish if order.finish.material in ("wood", "plastic", "metal") else LIGHT_WOOD
    y = h * 0.62
    arch = tube(
        [
            (-w / 2 + 0.02, h * 0.28, 0),
            (-w * 0.2, h * 0.5, 0),
            (0, y, 0),
            (w * 0.2, h * 0.5, 0),
            (w / 2 - 0.02, h * 0.28, 0),
        ],
        0.016,
    )
    bar = tube([(-w / 2 + 0.04, h * 0.27, 0), (w / 2 - 0.04, h * 0.27, 0)], 0.01)
    hook = tube(
        [(0, y, 0), (0, h * 0.8, 0), (0.03, h * 0.88, 0), (0.02, h * 0.97, 0), (-0.02, h * 0.95, 0)], 0.006, sides=4
    )
    return [made_of(wood, arch, bar), made_of(STEEL, hook)]


BUILDERS: dict[str, Builder] = {"flat": rug, "curtain": curtains, "towel": towel, "clothes": clothes, "hanger": hanger}
