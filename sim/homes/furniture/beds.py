"""Beds, cribs, pillows and blankets."""

import math

from sim.homes.plan import Finish

from .joinery import tapered_leg, wooden
from .lofts import curtain, cushion, tube
from .order import Builder, Order, Part, made_of
from .palette import DARK_WOOD, LIGHT_WOOD, LINEN, plain
from .shapes import Shape, box, rounded_box, slab


def bed(order: Order) -> list[Part]:
    """A frame with a headboard, a mattress, a duvet turned back, pillows; two storeys where it is a bunk bed."""
    if order.says("bunk") and order.size[1] > 1.25:  # a low box cannot hold two beds
        return bunk_bed(order)
    w, h, d = order.size
    finish = order.finish
    frame = wooden(finish, DARK_WOOD if finish.material != "leather" else finish)
    cover = (
        finish if finish.material in ("fabric", "carpet", "leather") else Finish(material="fabric", rgb=_linen(order))
    )
    rail, top = 0.3, min(0.52, h * 0.62)
    head = 0.07
    parts: list[Part] = [
        made_of(
            frame,
            rounded_box((0.0, h / 2, -d / 2 + head / 2), (w, h, head), 0.02),
            *(box((s * (w / 2 - 0.02), rail - 0.08, 0.0), (0.04, 0.18, d - 0.04)) for s in (-1, 1)),
            box((0.0, rail - 0.06, d / 2 - 0.02), (w, 0.24, 0.04)),
            *(box((s * (w / 2 - 0.035), rail / 2 - 0.08, d / 2 - 0.035), (0.07, rail - 0.16, 0.07)) for s in (-1, 1)),
        )
    ]
    panel = slab((0.0, h * 0.68, -d / 2 + head + 0.004), (w * 0.86, h * 0.4, 0.012), faces="+z+x-x+y-y")
    parts.append(made_of(plain(frame, 0.82), panel))
    parts.append(
        made_of(LINEN, rounded_box((0.0, (rail + top) / 2 - 0.04, 0.02), (w - 0.07, top - rail + 0.08, d - 0.13), 0.05))
    )
    fold = d * 0.2
    cover_d = d * 0.66
    cover_z = d / 2 - 0.03 - cover_d / 2
    parts.append(made_of(cover, rounded_box((0.0, top - 0.1, cover_z), (w, 0.26, cover_d), 0.06)))
    parts.append(
        made_of(
            LINEN,
            rounded_box((0.0, top + 0.022, cover_z - cover_d / 2 + fold / 4), (w * 0.99, 0.03, fold * 0.7), 0.014),
        )
    )
    num = 2 if w > 1.15 else 1
    size = (min(0.62, w / num * 0.82), 0.16, min(0.42, d * 0.21))
    lying = cushion((0.0, 0.0, 0.0), size, cells=4)
    z = -d / 2 + head + size[2] / 2 + 0.03
    places = [(k + 0.5 - num / 2) * w * 0.47 for k in range(num)]
    parts.append(made_of(LINEN, *(lying.turned("x", 0.2).moved(x, top + 0.07, z) for x in places)))
    return parts


def _linen(order: Order) -> tuple[int, int, int]:
    """Colour of the bedding of a bed whose own colour is that of its frame."""
    tones = ((224, 220, 210), (120, 142, 170), (176, 150, 130), (150, 168, 150), (96, 104, 120))
    return tones[int(order.rng.integers(len(tones)))]


def bunk_bed(order: Order) -> list[Part]:
    """Two beds over each other with posts, rails and a ladder."""
    w, h, d = order.size
    finish = order.finish
    frame = wooden(finish, LIGHT_WOOD)
    cover = finish if finish.material == "fabric" else Finish(material="fabric", rgb=_linen(order))
    shapes: list[Shape] = [
        box((a * (w / 2 - 0.03), h / 2, b * (d / 2 - 0.03)), (0.06, h, 0.06)) for a in (-1, 1) for b in (-1, 1)
    ]
    parts: list[Part] = []
    for level in (0.2 * h, 0.62 * h):
        shapes += [box((s * (w / 2 - 0.02), level, 0), (0.03, 0.14, d)) for s in (-1, 1)]
        shapes += [box((0, level + 0.15, s * (d / 2 - 0.02)), (w, 0.2, 0.03)) for s in (-1, 1)]
        mattress = rounded_box((0, level + 0.06, 0), (w - 0.08, 0.16, d - 0.09), 0.03)
        duvet = rounded_box((0, level + 0.13, d * 0.14), (w - 0.05, 0.1, d * 0.66), 0.04)
        parts += [
            made_of(LINEN, mattress, cushion((0, level + 0.17, -d * 0.36), (w * 0.6, 0.13, 0.34), cells=4)),
            made_of(cover, duvet),
        ]
    shapes += [box((s * (w / 2 - 0.02), h * 0.9, 0), (0.025, 0.08, d)) for s in (-1, 1)]
    shapes += [box((w / 2 - 0.012, h * 0.4, z * d), (0.024, h * 0.78, 0.05)) for z in (0.2, 0.38)]
    shapes += [box((w / 2 - 0.012, h * t, 0.29 * d), (0.024, 0.03, 0.16 * d)) for t in (0.14, 0.28, 0.42, 0.56, 0.7)]
    return [made_of(frame, *shapes), *parts]


def crib(order: Order) -> list[Part]:
    """A child's bed with bars on all sides."""
    w, h, d = order.size
    frame = order.finish if order.finish.material in ("wood", "plastic", "metal") else LIGHT_WOOD
    low, high = h * 0.3, h * 0.9
    shapes: list[Shape] = [
        tapered_leg((a * (w / 2 - 0.025), h, b * (d / 2 - 0.025)), (a * (w / 2 - 0.025), 0, b * (d / 2 - 0.025)), 0.05)
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    for y in (low, high):
        shapes += [box((s * (w / 2 - 0.025), y, 0), (0.035, 0.05, d - 0.06)) for s in (-1, 1)]
        shapes += [box((0, y, s * (d / 2 - 0.025)), (w - 0.06, 0.05, 0.035)) for s in (-1, 1)]
    bar = high - low
    shapes += [
        slab(
            (s * (w / 2 - 0.025), (low + high) / 2, -d / 2 + 0.1 + k * (d - 0.2) / 8),
            (0.02, bar, 0.024),
            faces="+x-x+z-z",
        )
        for k in range(9)
        for s in (-1, 1)
    ]
    shapes += [
        slab(
            (-w / 2 + 0.1 + k * (w - 0.2) / 4, (low + high) / 2, s * (d / 2 - 0.025)),
            (0.024, bar, 0.02),
            faces="+x-x+z-z",
        )
        for k in range(5)
        for s in (-1, 1)
    ]
    mattress = rounded_box((0, low + 0.06, 0), (w - 0.07, 0.12, d - 0.07), 0.03)
    blanket = rounded_box((0, low + 0.12, d * 0.16), (w - 0.1, 0.06, d * 0.55), 0.025)
    tone = order.finish if order.finish.material == "fabric" else Finish(material="fabric", rgb=(150, 190, 214))
    return [
        made_of(frame, *shapes),
        made_of(LINEN, mattress, cushion((0, low + 0.16, -d * 0.33), (w * 0.6, 0.1, 0.24), cells=3)),
        made_of(tone, blanket),
    ]


def pillow(order: Order) -> list[Part]:
    """A pillow that leans back a little, with a seam; round ones are flat drums."""
    w, h, d = order.size
    if h > 0.26:  # it stands
        thick = min(d * 0.8, 0.2)
        shape = cushion((0.0, 0.0, 0.0), (w, thick, h * 0.98), cells=6).turned("x", math.pi / 2 - 0.18)
        return [made_of(order.finish, shape.moved(0.0, h / 2, 0.0))]
    return [made_of(order.finish, cushion((0.0, h / 2, 0.0), (w, h, d), cells=6))]


def blanket(order: Order) -> list[Part]:
    """A folded stack of cloth with a fringe, or cloth hanging in folds where the place is high."""
    w, h, d = order.size
    finish = order.finish
    if h > 0.55 and d < 0.35:
        rail = tube([(-w / 2, h - 0.02, 0), (w / 2, h - 0.02, 0)], 0.013)
        hung = curtain((0, (h - 0.02) / 2, 0), (w * 0.92, h - 0.02, d * 0.8), folds=4)
        return [made_of(DARK_WOOD, rail), made_of(finish, hung)]
    layers = 4 if h > 0.16 else 2
    step = h / layers
    folded = [
        rounded_box(
            ((0.008, -0.008)[k % 2], step * (k + 0.5), 0.01),
            (w - 0.03 - 0.012 * (k % 2), step * 1.05, d - 0.06),
            step * 0.45,
        )
        for k in range(layers)
    ]
    fringe = [
        slab((x * (w - 0.08), h * 0.3, d / 2 - 0.014), (0.018, h * 0.45, 0.008), faces="+z+x-x")
        for x in (-0.5, -0.4, -0.3, -0.2, -0.1, 0, 0.1, 0.2, 0.3, 0.4, 0.5)
    ]
    band = slab((0, h * 0.5, 0.0), (w * 0.12, h + 0.004, d - 0.05), faces="+y+z")
    return [made_of(finish, *folded), made_of(plain(finish, 0.7), *fringe, band)]


BUILDERS: dict[str, Builder] = {"bed": bed, "bunk bed": bunk_bed, "crib": crib, "pillow": pillow, "blanket": blanket}
