"""Things that lie about on floors, tables and shelves: books, cups, statues, shoes, boxes, bags, toys and the like."""

import math

import numpy as np

from .lofts import SQUARE, ball, circle, cylinder, lathe, plate, ring, stack, tube
from .palette import (
    BLACK,
    BLACK_METAL,
    BRASS,
    DARK_METAL,
    DARK_WOOD,
    GLOW,
    PAPER,
    SPINES,
    STEEL,
    WHITE,
    fabric,
    is_dark,
    plain,
    plastic,
)
from .shapes import Draft, both, box, facets, four, merged, prism, rounded_box, slab


def book(piece: Draft, w: float, h: float, d: float) -> None:
    """A pile of books, each turned a little; one has the colour of the caption."""
    num = max(1, min(4, round(h / 0.04)))
    step, first = h / num, int(piece.rng.integers(len(SPINES)))
    for k in range(num):
        cover = piece.finish if k == num - 1 else plastic(*SPINES[(first + k) % len(SPINES)])
        share, y = 0.96 - 0.05 * ((k * 2) % 3), step * (k + 0.5)
        turn = 0.0 if num == 1 else (0.1, -0.12, 0.05, -0.03)[k]
        width, deep = w * share * 0.92, d * share * 0.9
        boards = [box((0, y + step * t, 0), (width, min(0.006, step * 0.2), deep)) for t in (-0.4, 0.4)]
        spine = box((-width / 2 + 0.004, y, 0), (0.008, step * 0.9, deep))
        pages = box((0.004, y, 0), (width - 0.016, step * 0.76, deep - 0.014))
        piece.add(plain(cover), merged([*boards, spine]).turned("y", turn))
        piece.add(PAPER, pages.turned("y", turn))


def bottle(piece: Draft, w: float, h: float, d: float) -> None:
    """A wine bottle with a label and a cap."""
    r = min(w, d) / 2
    profile = [(0.9, 0.0), (1.0, 0.03), (1.0, 0.56), (0.36, 0.74), (0.32, 0.93)]
    piece.add(piece.finish, lathe(profile, scale=(r, h), sides=10, caps="start"))
    piece.add(PAPER, lathe([(1.02, 0.18), (1.02, 0.44)], scale=(r, h), sides=10))
    piece.add(plastic(150, 40, 46), cylinder((0, h * 0.92, 0), r * 0.38, h * 0.08, sides=6))


def cup(piece: Draft, w: float, h: float, d: float) -> None:
    """A mug with a handle, or a drinking glass on a stem if it is made of glass."""
    if piece.says("glass") or piece.finish.material == "glass":
        profile = [
            (0.8, 0.0), (0.12, 0.05), (0.1, 0.42), (0.7, 0.52), (1.0, 0.75), (0.82, 1.0), (0.74, 0.98), (0.86, 0.74),
            (0.0, 0.56),
        ]  # fmt: skip
        scale = (min(w, d) / 2, h)
        piece.add(plastic(206, 224, 232), lathe(profile, scale=scale, sides=10))
        piece.add(plastic(140, 30, 50), lathe([(0.84, 0.74), (0.0, 0.745)], scale=scale, sides=10))
        return
    r = min(w * 0.38, d / 2)
    x, far = -w / 2 + r, w / 2 - 0.008
    profile = [(0.8, 0.0), (1.0, 0.2), (1.0, 1.0), (0.88, 1.0), (0.86, 0.5), (0.0, 0.45)]
    grip = [(x + r * 0.95, h * 0.8, 0), (far, h * 0.74, 0), (far, h * 0.36, 0), (x + r * 0.95, h * 0.24, 0)]
    piece.add(piece.finish, lathe(profile, scale=(r, h), at=(x, 0, 0), sides=10), tube(grip, 0.008, sides=4))
    piece.add(plastic(84, 52, 34), lathe([(r * 0.87, h * 0.82), (0.0, h * 0.82)], at=(x, 0, 0), sides=8))


def bowl(piece: Draft, w: float, h: float, d: float) -> None:
    """A bowl of fruit."""
    profile = [(0.36, 0.0), (0.4, 0.1), (0.85, 0.6), (1.0, 1.0), (0.94, 1.0), (0.76, 0.6), (0.0, 0.3)]
    piece.add(piece.finish, lathe(profile, scale=(w / 2, h * 0.62), sides=14, depth=d / w))
    size = min(w, d) * 0.3
    fruit = (plastic(214, 60, 50), plastic(240, 160, 50), plastic(150, 180, 70), plastic(232, 200, 70))
    for k, tone in enumerate(fruit):
        a = k * math.pi / 2 + 0.4
        centre = (0.21 * w * math.cos(a), h - size / 2 - 0.01 * (k % 2), 0.21 * d * math.sin(a))
        piece.add(tone, ball(centre, (size, size, size), sides=6, rings=3))


def kettle(piece: Draft, w: float, h: float, d: float) -> None:
    """A round pot with a spout, an arched handle and a lid."""
    r, tall = min(d / 2, w * 0.38), h * 0.7
    x = -w / 2 + r + w * 0.06
    profile = [(0.95, 0.0), (1.0, 0.2), (0.86, 0.7), (0.5, 0.95), (0.46, 1.0)]
    piece.add(piece.finish, lathe(profile, scale=(r, tall), at=(x, 0, 0), sides=12, caps="both"))
    spout = [(x + r * 0.7, tall * 0.35, 0), (x + r * 1.15, tall * 0.6, 0), (w / 2 - 0.008, tall * 0.92, 0)]
    piece.add(piece.finish, tube(spout, [0.028, 0.02, 0.013]))
    grip = [(-0.7, tall * 0.8), (-0.66, h * 0.94), (0.0, h - 0.012), (0.66, h * 0.94), (0.7, tall * 0.8)]
    piece.add(BLACK, tube([(x + a * r, y, 0) for a, y in grip], 0.011, sides=5))
    piece.add(BLACK, ball((x, tall + 0.012, 0), (0.03, 0.03, 0.03), sides=6, rings=3))


def speaker(piece: Draft, w: float, h: float, d: float) -> None:
    """A case with two round cones."""
    z = d / 2 - 0.02
    piece.add(piece.finish, rounded_box((0, h / 2, -0.01), (w, h, d - 0.02), 0.012))
    piece.add(BLACK, slab((0, h / 2, z - 0.008), (w * 0.92, h * 0.94, 0.018), faces="+z"))
    for y, r in ((h * 0.32, min(w * 0.36, h * 0.26)), (h * 0.74, min(w * 0.2, h * 0.13))):
        cone = lathe([(r, 0.004), (r * 0.4, -0.02)], sides=12).turned("x", math.pi / 2)
        piece.add(STEEL, ring((0, y, z + 0.002), r, 0.012, sides=12, around=3))
        piece.add(DARK_METAL, cone.moved(0, y, z + 0.006))
        piece.add(plain(STEEL, 0.8), ball((0, y, z), (r * 0.8, r * 0.8, 0.03), sides=8, rings=4))


def statue(piece: Draft, w: float, h: float, d: float) -> None:
    """A standing figure on a plinth."""
    low = h * 0.14
    t = h - low
    piece.add(plain(piece.finish, 0.6), box((0, low * 0.3, 0), (w, low * 0.6, d)))
    piece.add(plain(piece.finish, 0.6), box((0, low * 0.8, 0), (w * 0.8, low * 0.4, d * 0.8)))
    leg = [(w * 0.1, low, 0), (w * 0.09, low + t * 0.24, d * 0.03), (w * 0.08, low + t * 0.48, 0)]
    profile = [(0.17, 0.44), (0.16, 0.54), (0.13, 0.6), (0.2, 0.74), (0.22, 0.79), (0.07, 0.84), (0.06, 0.87)]
    torso = lathe(profile, sides=8, depth=0.65).scaled((w, t, d)).moved(0, low, 0)
    piece.add(piece.finish, both(tube(leg, [w * 0.08, w * 0.075, w * 0.1])), torso)
    piece.add(piece.finish, ball((0, low + t * 0.925, 0), (w * 0.2, t * 0.15, d * 0.22), sides=7))
    shoulder = low + t * 0.77
    hanging = [(-w * 0.22, shoulder, 0), (-w * 0.34, low + t * 0.6, 0), (-w * 0.2, low + t * 0.5, d * 0.16)]
    raised = [(w * 0.22, shoulder, 0), (w * 0.38, low + t * 0.88, 0), (w * 0.34, h - 0.02, d * 0.04)]
    piece.add(piece.finish, *(tube(arm, w * 0.055, sides=5) for arm in (hanging, raised)))


def candle(piece: Draft, w: float, h: float, d: float) -> None:
    """A candle on a holder, lit."""
    r = min(w, d) / 2
    holder = [(1.0, 0.0), (1.0, 0.03), (0.3, 0.1), (0.24, 0.3), (0.5, 0.36)]
    piece.add(BRASS, lathe(holder, scale=(r, h), sides=10, caps="end"))
    piece.add(piece.finish, cylinder((0, h * 0.36, 0), r * 0.34, h * 0.46, sides=7))
    piece.add(GLOW, lathe([(0.002, 0.0), (r * 0.16, h * 0.05), (0.0, h * 0.15)], at=(0, h * 0.84, 0), sides=5))


def printer(piece: Draft, w: float, h: float, d: float) -> None:
    """A low case with paper at the back and a printed sheet in front."""
    piece.add(plain(piece.finish), rounded_box((0, h * 0.36, -0.02), (w, h * 0.7, d * 0.72), 0.025))
    piece.add(BLACK, slab((0, h * 0.22, d * 0.3), (w * 0.7, h * 0.14, 0.03), faces="+z"))
    piece.add(BLACK, box((w * 0.3, h * 0.71, d * 0.12), (w * 0.24, 0.01, d * 0.12)))
    behind = box((0, 0, 0), (w * 0.6, h * 0.6, 0.006)).turned("x", -0.3)
    piece.add(PAPER, behind.moved(0, h * 0.72, -d * 0.34))
    piece.add(PAPER, slab((0, h * 0.17, d * 0.38), (w * 0.58, 0.006, d * 0.2), faces="+y-y+z"))


def telephone(piece: Draft, w: float, h: float, d: float) -> None:
    """A desk telephone with keys and a receiver."""
    x = -w * 0.3
    side = [(0.0, d / 2), (h * 0.24, d / 2), (h * 0.6, -d / 2), (0.0, -d / 2)]
    piece.add(plain(piece.finish), prism(side, low=-w / 2, high=w / 2, axis="x"))
    piece.add(BLACK_METAL, tube([(x, h * 0.7, -d * 0.4), (x, h * 0.9, 0.0), (x, h * 0.5, d * 0.4)], 0.018, sides=6))
    for y, z in ((0.62, -0.38), (0.42, 0.36)):
        piece.add(BLACK_METAL, ball((x, y * h, z * d), (0.06, 0.05, 0.06), sides=6, rings=3))
    for row, col in np.ndindex(4, 3):
        at = (w * (0.06 + 0.14 * col), h * (0.5 - 0.09 * row), d * (-0.2 + 0.2 * row))
        piece.add(WHITE, box(at, (w * 0.09, 0.02, d * 0.12)))


def shoes(piece: Draft, w: float, h: float, d: float) -> None:
    """A pair of shoes with soles, openings and laces."""
    each = w * 0.44
    x, oval = (w - each) / 2, circle(8, power=2.4)
    upper = [
        (0.02, 1.0, 1.0, 0.0), (h * 0.3, 0.98, 0.98, 0.0), (h * 0.52, 0.8, 0.72, -0.1 * d),
        (h * 0.9, 0.62, 0.44, -0.24 * d), (h, 0.6, 0.42, -0.26 * d),
    ]  # fmt: skip
    sole = lathe([(each / 2, 0.0), (each / 2, 0.024)], sides=8, depth=d / each, power=2.4, caps="start")
    bars = ((h * 0.66, d * 0.06), (h * 0.8, 0.0))
    laces = [tube([(-each * 0.2, y, z), (each * 0.2, y, z)], 0.006, sides=3).moved(x) for y, z in bars]
    piece.add(plain(piece.finish), both(stack(oval, (each, d), upper).moved(x)))
    piece.add(WHITE if is_dark(piece.finish) else DARK_METAL, both(sole.moved(x), *laces))
    piece.add(BLACK, both(plate(oval, (each, d), (h - 0.006, 0.6, 0.42, -0.26 * d)).moved(x)))


def cardboard_box(piece: Draft, w: float, h: float, d: float) -> None:
    """A box with tape and open flaps; wooden boxes are crates, plastic boxes have a lid."""
    finish, top = piece.finish, h * 0.86
    if finish.material == "wood" or piece.says("organizer", "crate", "drawers"):
        piece.add(finish, four(box((w / 2 - 0.02, h / 2, d / 2 - 0.02), (0.04, h, 0.04))))
        for y in (h / 6, h / 2, h * 5 / 6):
            piece.add(finish, both(box((0, y, d / 2 - 0.01), (w, h * 0.28, 0.014)), axis="z"))
            piece.add(finish, both(box((w / 2 - 0.01, y, 0), (0.014, h * 0.28, d))))
        piece.add(plain(finish, 0.5), slab((0, h * 0.7, 0), (w - 0.03, 0.01, d - 0.03), faces="+y"))
        return
    if piece.says("plastic", "container") or finish.material in ("plastic", "metal", "glass"):
        tub = lathe([(0.6, 0.0), (0.69, h * 0.82)], sides=4, caps="start").turned("y", math.pi / 4)
        piece.add(finish, tub.scaled((w, 1.0, d)))
        piece.add(plain(finish, 0.75), rounded_box((0, h * 0.91, 0), (w, h * 0.16, d), 0.02))
        piece.add(DARK_METAL, both(box((w / 2 - 0.012, h * 0.8, 0), (0.024, h * 0.12, d * 0.3))))
        return
    a, b, x, z = w * 0.43, d * 0.43, w / 2, d / 2
    high = top + min(h - top, w * 0.2)
    low = top + (high - top) * 0.6
    piece.add(finish, slab((0, top / 2, 0), (w * 0.86, top, d * 0.86), faces="+x-x+z-z-y"))
    piece.add(plain(finish, 1.08), both(facets([[(a, top, b), (a, top, -b), (x, high, -b), (x, high, b)]])))
    piece.add(plain(finish, 1.08), both(facets([[(-a, top, b), (a, top, b), (a, low, z), (-a, low, z)]]), axis="z"))
    piece.add(plain(finish, 0.45), slab((0, top - 0.03, 0), (w * 0.85, 0.004, d * 0.85), faces="+y"))
    tape = plastic(222, 196, 150)
    piece.add(tape, slab((0, top * 0.55, 0), (w * 0.1, top * 0.9, d * 0.862), faces="+z-z"))
    piece.add(tape, slab((0, top * 0.55, 0), (w * 0.862, top * 0.9, d * 0.1), faces="+x-x"))


def basket(piece: Draft, w: float, h: float, d: float) -> None:
    """A woven basket with a rim, two handles and cloth in it."""
    r, top = w * 0.46, h * 0.8
    woven = [(0.78, 0.0)]
    for k in range(1, 5):
        woven += [(0.82 + 0.04 * k, k / 4 - 0.1), (0.78 + 0.04 * k, k / 4)]
    rim = [(1.02, 1.0), (0.9, 1.0), (0.86, 0.8)]
    piece.add(piece.finish, lathe([*woven, *rim], scale=(r, top), sides=14, depth=d / w))
    y, z = h - 0.02, d * 0.12
    grip = [(r * 0.9, top, -z), (r, y, -d * 0.07), (r, y, d * 0.07), (r * 0.9, top, z)]
    piece.add(piece.finish, both(tube(grip, 0.014, sides=5)))
    cloth = ball((0, top * 0.84, 0), (r * 1.7, h * 0.26, d * 0.8), sides=10, rings=4, low=0.0)
    piece.add(fabric(236, 232, 222), cloth)


def bin_(piece: Draft, w: float, h: float, d: float) -> None:
    """A pedal bin, or an open waste-paper basket with crumpled paper."""
    r = min(w, d) / 2
    if piece.says("open", "paper", "bucket") or piece.rng.random() < 0.4:
        profile = [(0.74, 0.0), (0.97, 0.96), (1.0, 1.0), (0.9, 1.0), (0.84, 0.8), (0.0, 0.74)]
        piece.add(piece.finish, lathe(profile, scale=(r, h), sides=14))
        for a in (0.3, 2.4, 4.5):
            at = (r * 0.4 * math.cos(a), h * 0.86, r * 0.4 * math.sin(a))
            piece.add(PAPER, ball(at, (r * 0.6, r * 0.5, r * 0.55), sides=5, rings=3))
        return
    piece.add(piece.finish, lathe([(r * 0.9, 0.03), (r * 0.92, h * 0.84)], sides=16))
    piece.add(BLACK, lathe([(r * 0.95, 0.0), (r * 0.95, 0.04), (r * 0.9, 0.05)], sides=16))
    piece.add(BLACK, lathe([(0.97, 0.83), (0.97, 0.88), (0.7, 0.96), (0.0, 1.0)], scale=(r, h), sides=16))
    piece.add(BLACK, box((0, 0.022, r * 0.96), (r * 0.5, 0.016, r * 0.14)))


def bag(piece: Draft, w: float, h: float, d: float) -> None:
    """A handbag that is narrower at its top, with two arched handles and a clasp."""
    top, z = h * 0.62, d * 0.13
    levels = [(0.0, 0.92, 0.9, 0.0), (0.03, 1.0, 1.0, 0.0), (top * 0.5, 0.98, 0.8, 0.0), (top, 0.84, 0.3, 0.0)]
    piece.add(piece.finish, stack(SQUARE, (w, d), levels, caps="both"))
    half = [(0.08, h - 0.014), (0.2, h * 0.86), (0.24, top * 0.92)]
    arch = [(x * w, y, z) for x, y in (*((-x, y) for x, y in reversed(half)), *half)]
    piece.add(plain(piece.finish, 0.7), both(tube(arch, 0.012, sides=5), axis="z"))
    piece.add(plain(piece.finish, 0.7), box((0, top * 0.36, d * 0.42), (w * 0.6, top * 0.4, 0.02)))
    piece.add(BRASS, box((0, top * 0.86, d * 0.22), (0.05, 0.035, 0.02)))


def backpack(piece: Draft, w: float, h: float, d: float) -> None:
    """A rounded sack with a front pocket, side pockets, straps and a loop."""
    dark, back = plain(piece.finish, 0.6), -d * 0.2
    piece.add(plain(piece.finish), rounded_box((0, h * 0.47, -d * 0.1), (w * 0.86, h * 0.94, d * 0.66), 0.09))
    piece.add(plain(piece.finish), rounded_box((0, h * 0.28, d * 0.3), (w * 0.66, h * 0.44, d * 0.36), 0.05))
    piece.add(dark, both(rounded_box((w * 0.44, h * 0.2, -d * 0.05), (w * 0.12, h * 0.32, d * 0.4), 0.03)))
    strap = [(w * 0.2, h * 0.9, -d * 0.38), (w * 0.28, h * 0.6, -d * 0.48), (w * 0.3, h * 0.1, -d * 0.38)]
    piece.add(dark, both(tube(strap, 0.018, sides=4)))
    loop = [(-0.04, h * 0.92, back), (-0.03, h - 0.008, back), (0.03, h - 0.008, back), (0.04, h * 0.92, back)]
    piece.add(dark, tube(loop, 0.009, sides=5))
    piece.add(STEEL, box((0, h * 0.49, d * 0.3), (w * 0.6, 0.012, d * 0.34)))
    piece.add(STEEL, box((0, h * 0.74, d * 0.236), (w * 0.64, 0.014, 0.012)))


def suitcase(piece: Draft, w: float, h: float, d: float) -> None:
    """A trolley case with ribs, wheels and an extended handle."""
    top, x, z = h * 0.8, w * 0.22, -d * 0.3
    y = (0.04 + top) / 2
    piece.add(plain(piece.finish), rounded_box((0, y, 0), (w, top - 0.04, d), 0.05))
    ribs = [box((share * w, y, d / 2 - 0.004), (0.014, top * 0.74, 0.012)) for share in (0.1, 0.3)]
    piece.add(plain(piece.finish, 0.7), both(*ribs))
    piece.add(BLACK, four(cylinder((w * 0.38 - 0.01, 0.03, d * 0.3), 0.03, 0.02, sides=8, axis="x")))
    piece.add(BLACK, box((0, y, 0), (w + 0.002, top - 0.05, 0.014)))
    piece.add(STEEL, tube([(-x, top, z), (-x, h - 0.014, z), (x, h - 0.014, z), (x, top, z)], 0.012, sides=5))


def umbrella_stand(piece: Draft, w: float, h: float, d: float) -> None:
    """A round stand with two closed umbrellas."""
    r, tall = min(w, d) / 2, h * 0.58
    profile = [(r * 0.9, 0.0), (r * 0.92, tall - 0.02), (r, tall), (r * 0.86, tall), (r * 0.84, tall * 0.6)]
    piece.add(piece.finish, lathe(profile, sides=14))
    cloth = [(r * 0.2, tall * 0.5, 0), (r * 0.5, h * 0.78, 0), (r * 0.56, h * 0.82, 0)]
    grip = [(r * 0.56, h * 0.8, 0), (r * 0.66, h * 0.93, 0), (r * 0.6, h - 0.012, 0), (r * 0.36, h - 0.03, 0)]
    for s, tone in ((-1, plastic(170, 44, 48)), (1, plastic(40, 60, 110))):
        piece.add(tone, tube([(s * x, y, z) for x, y, z in cloth], [0.02, 0.045, 0.02], sides=7))
    piece.add(DARK_WOOD, both(tube(grip, 0.011, sides=5)))


def toy(piece: Draft, w: float, h: float, d: float) -> None:
    """A sitting teddy bear."""
    fur, light = plain(piece.finish), plain(piece.finish, 1.4)
    arm = ball((0, 0, 0), (w * 0.2, h * 0.34, d * 0.22), sides=6, rings=4).turned("z", 0.5)
    piece.add(fur, both(arm.moved(w * 0.34, h * 0.38, d * 0.08)))
    for tone, centre, size, sides, rings in (  # in shares of the box
        (fur, (0.0, 0.3, -0.06), (0.6, 0.56, 0.62), 8, 5),
        (fur, (0.0, 0.72, -0.02), (0.56, 0.42, 0.56), 8, 5),
        (fur, (0.23, 0.91, -0.04), (0.2, 0.16, 0.14), 6, 3),
        (fur, (0.27, 0.1, 0.28), (0.26, 0.2, 0.42), 7, 4),
        (light, (0.0, 0.67, 0.24), (0.24, 0.15, 0.16), 6, 3),
        (light, (0.0, 0.3, 0.2), (0.34, 0.34, 0.12), 7, 3),
        (light, (0.27, 0.1, 0.46), (0.15, 0.12, 0.06), 6, 2),
        (BLACK, (0.11, 0.77, 0.23), (0.06, 0.05, 0.04), 5, 2),
        (BLACK, (0.0, 0.7, 0.31), (0.09, 0.05, 0.05), 5, 2),
    ):
        (x, y, z), (a, b, c) = centre, size
        shape = ball((x * w, y * h, z * d), (a * w, b * h, c * d), sides=sides, rings=rings)
        piece.add(tone, both(shape) if x else shape)


def play_ball(piece: Draft, w: float, h: float, d: float) -> None:
    """A ball in wedges of two colours."""
    skin = ball((0, h / 2, 0), (w, h, d), sides=12, rings=8)
    is_even = np.arange(len(skin.corners)) % 4 < 2
    piece.add(plain(piece.finish), skin.chosen(is_even))
    piece.add(plastic(*(piece.finish.rgb2 or (244, 244, 240))), skin.chosen(~is_even))
