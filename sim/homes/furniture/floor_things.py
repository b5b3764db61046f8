"""Things that lie about on floors: shoes, boxes, baskets, bins, bags, suitcases, toys."""

import math

import numpy as np

from sim.homes.plan import Finish

from .lofts import ball, circle, cylinder, lathe, loft, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, BRASS, DARK_METAL, DARK_WOOD, PAPER, STEEL, WHITE, is_dark, plain
from .shapes import Shape, box, facets, rounded_box, slab


def shoes(order: Order) -> list[Part]:
    """A pair of shoes with soles, openings and laces."""
    w, h, d = order.size
    each = w * 0.44
    uppers, soles, holes, laces = [], [], [], []
    for s in (-1, 1):
        x = s * (w - each) / 2
        oval = circle(8, power=2.4)
        rings = []
        for a, b, y, back in (
            (1.0, 1.0, 0.02, 0.0),
            (0.98, 0.98, h * 0.3, 0.0),
            (0.8, 0.72, h * 0.52, 0.1),
            (0.62, 0.44, h * 0.9, 0.24),
            (0.6, 0.42, h, 0.26),
        ):
            rings.append(
                np.stack([oval[:, 0] * each / 2 * a + x, np.full(8, y), oval[:, 1] * d / 2 * b - back * d], axis=1)
            )
        uppers.append(loft(rings))
        soles.append(
            lathe([(each / 2, 0.0), (each / 2, 0.024)], at=(x, 0, 0), sides=8, depth=d / each, power=2.4, caps="start")
        )
        holes.append(facets([rings[-1][[0, k, k + 1, min(k + 2, 7)]] for k in range(1, 7, 2)]).moved(y=-0.006))
        laces += [
            tube([(x - each * 0.2, h * y, d * z), (x + each * 0.2, h * y, d * z)], 0.006, sides=3)
            for y, z in ((0.66, 0.06), (0.8, 0.0))
        ]
    return [
        made_of(plain(order.finish), *uppers),
        made_of(WHITE if is_dark(order.finish) else DARK_METAL, *soles, *laces),
        made_of(BLACK, *holes),
    ]


def cardboard_box(order: Order) -> list[Part]:
    """A box with tape, or open with its flaps out; wooden ones are crates."""
    w, h, d = order.size
    finish = order.finish
    if finish.material == "wood" or order.says("organizer", "crate", "drawers"):
        posts = [
            box((a * (w / 2 - 0.02), h / 2, b * (d / 2 - 0.02)), (0.04, h, 0.04)) for a in (-1, 1) for b in (-1, 1)
        ]
        rows = 3
        boards = []
        for k in range(rows):
            y = (k + 0.5) * h / rows
            boards += [box((0, y, s * (d / 2 - 0.01)), (w, h / rows * 0.84, 0.014)) for s in (-1, 1)]
            boards += [box((s * (w / 2 - 0.01), y, 0), (0.014, h / rows * 0.84, d)) for s in (-1, 1)]
        floor = slab((0, h * 0.7, 0), (w - 0.03, 0.01, d - 0.03), faces="+y")
        return [made_of(finish, *posts, *boards), made_of(plain(finish, 0.5), floor)]
    if order.says("plastic", "container") or finish.material in ("plastic", "metal", "glass"):
        tub = (
            lathe([(0.6, 0.0), (0.69, h * 0.82)], sides=4, caps="start")
            .turned("y", math.pi / 4)
            .scaled((w / 1.0, 1.0, d / 1.0))
        )
        lid = rounded_box((0, h * 0.91, 0), (w, h * 0.16, d), 0.02)
        grips = [box((s * (w / 2 - 0.012), h * 0.8, 0), (0.024, h * 0.12, d * 0.3)) for s in (-1, 1)]
        return [made_of(finish, tub), made_of(plain(finish, 0.75), lid), made_of(DARK_METAL, *grips)]
    top = h * 0.86
    lean = min(h - top, w * 0.2)
    walls = slab((0, top / 2, 0), (w * 0.86, top, d * 0.86), faces="+x-x+z-z-y")
    inside = slab((0, top - 0.03, 0), (w * 0.85, 0.004, d * 0.85), faces="+y")
    a, b = w * 0.43, d * 0.43
    out_x, out_z = w / 2, d / 2
    flaps = facets([
        [(a, top, b), (a, top, -b), (out_x, top + lean, -b), (out_x, top + lean, b)],
        [(-a, top, -b), (-a, top, b), (-out_x, top + lean, b), (-out_x, top + lean, -b)],
        [(-a, top, b), (a, top, b), (a, top + lean * 0.6, out_z), (-a, top + lean * 0.6, out_z)],
        [(a, top, -b), (-a, top, -b), (-a, top + lean * 0.6, -out_z), (a, top + lean * 0.6, -out_z)],
    ])  # fmt: skip
    tape = [
        slab((0, top * 0.55, 0), (w * 0.1, top * 0.9, d * 0.862), faces="+z-z"),
        slab((0, top * 0.55, 0), (w * 0.862, top * 0.9, d * 0.1), faces="+x-x"),
    ]
    return [
        made_of(finish, walls),
        made_of(plain(finish, 1.08), flaps),
        made_of(plain(finish, 0.45), inside),
        made_of(Finish(material="plastic", rgb=(222, 196, 150)), *tape),
    ]


def basket(order: Order) -> list[Part]:
    """A woven basket with a rim, two handles and cloth in it."""
    w, h, d = order.size
    r, top = w * 0.46, h * 0.8
    finish = order.finish
    profile = [(r * 0.78, 0.0)]
    for k in range(1, 5):
        y = top * k / 4
        profile += [(r * (0.82 + 0.16 * k / 4), y - top * 0.1), (r * (0.78 + 0.16 * k / 4), y)]
    skin = lathe([*profile, (r * 1.02, top), (r * 0.9, top), (r * 0.86, top * 0.8)], sides=14, depth=d / w)
    grips = [
        tube(
            [
                (s * r * 0.9, top, -d * 0.12),
                (s * r, h - 0.02, -d * 0.07),
                (s * r, h - 0.02, d * 0.07),
                (s * r * 0.9, top, d * 0.12),
            ],
            0.014,
            sides=5,
        )
        for s in (-1, 1)
    ]
    cloth = ball((0, top * 0.84, 0), (r * 1.7, h * 0.26, d * 0.8), sides=10, rings=4, low=0.0)
    return [made_of(finish, skin, *grips), made_of(Finish(material="fabric", rgb=(236, 232, 222)), cloth)]


def bin_(order: Order) -> list[Part]:
    """A pedal bin, or an open waste-paper basket with crumpled paper."""
    w, h, d = order.size
    r = min(w, d) / 2
    if order.says("open", "paper", "bucket") or order.rng.random() < 0.4:
        skin = lathe(
            [(r * 0.74, 0.0), (r * 0.97, h * 0.96), (r, h), (r * 0.9, h), (r * 0.84, h * 0.8), (0.0, h * 0.74)],
            sides=14,
        )
        papers = [
            ball(
                (r * 0.4 * math.cos(a), h * 0.86, r * 0.4 * math.sin(a)), (r * 0.6, r * 0.5, r * 0.55), sides=5, rings=3
            )
            for a in (0.3, 2.4, 4.5)
        ]
        return [made_of(order.finish, skin), made_of(PAPER, *papers)]
    skin = lathe([(r * 0.9, 0.03), (r * 0.92, h * 0.84)], sides=16)
    base = lathe([(r * 0.95, 0.0), (r * 0.95, 0.04), (r * 0.9, 0.05)], sides=16)
    lid = lathe([(r * 0.97, h * 0.83), (r * 0.97, h * 0.88), (r * 0.7, h * 0.96), (0.0, h)], sides=16)
    pedal = box((0, 0.022, r * 0.96), (r * 0.5, 0.016, r * 0.14))
    return [made_of(order.finish, skin), made_of(BLACK, base, lid, pedal)]


def bag(order: Order) -> list[Part]:
    """A handbag: a body narrower at its top, two arched handles, a clasp."""
    w, h, d = order.size
    top = h * 0.62
    rings = []
    for y, a, b in ((0.0, 0.92, 0.9), (0.03, 1.0, 1.0), (top * 0.5, 0.98, 0.8), (top, 0.84, 0.3)):
        rings.append([(sx * w / 2 * a, y, sz * d / 2 * b) for sx, sz in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    body = loft(rings, caps="both")
    arch = [
        (-0.24, top * 0.92),
        (-0.2, h * 0.86),
        (-0.08, h - 0.014),
        (0.08, h - 0.014),
        (0.2, h * 0.86),
        (0.24, top * 0.92),
    ]
    grips = [tube([(x * w, y, s * d * 0.13) for x, y in arch], 0.012, sides=5) for s in (-1, 1)]
    clasp = box((0, top * 0.86, d * 0.22), (0.05, 0.035, 0.02))
    pocket = box((0, top * 0.36, d * 0.42), (w * 0.6, top * 0.4, 0.02))
    return [made_of(order.finish, body), made_of(plain(order.finish, 0.7), *grips, pocket), made_of(BRASS, clasp)]


def backpack(order: Order) -> list[Part]:
    """A rounded sack with a front pocket, side pockets, straps and a loop."""
    w, h, d = order.size
    body = rounded_box((0, h * 0.47, -d * 0.1), (w * 0.86, h * 0.94, d * 0.66), 0.09)
    pocket = rounded_box((0, h * 0.28, d * 0.3), (w * 0.66, h * 0.44, d * 0.36), 0.05)
    sides = [rounded_box((s * w * 0.44, h * 0.2, -d * 0.05), (w * 0.12, h * 0.32, d * 0.4), 0.03) for s in (-1, 1)]
    zips = [
        box((0, h * 0.49, d * 0.3), (w * 0.6, 0.012, d * 0.34)),
        box((0, h * 0.74, d * 0.236), (w * 0.64, 0.014, 0.012)),
    ]
    loop = tube(
        [
            (-0.04, h * 0.92, -d * 0.2),
            (-0.03, h - 0.008, -d * 0.2),
            (0.03, h - 0.008, -d * 0.2),
            (0.04, h * 0.92, -d * 0.2),
        ],
        0.009,
        sides=5,
    )
    straps = [
        tube(
            [(s * w * 0.2, h * 0.9, -d * 0.38), (s * w * 0.28, h * 0.6, -d * 0.48), (s * w * 0.3, h * 0.1, -d * 0.38)],
            0.018,
            sides=4,
        )
        for s in (-1, 1)
    ]
    return [
        made_of(plain(order.finish), body, pocket),
        made_of(plain(order.finish, 0.6), *sides, *straps, loop),
        made_of(STEEL, *zips),
    ]


def suitcase(order: Order) -> list[Part]:
    """A trolley case with ribs, wheels and its handle out."""
    w, h, d = order.size
    top = h * 0.8
    shell = rounded_box((0, (0.04 + top) / 2, 0), (w, top - 0.04, d), 0.05)
    ribs = [box((x * w, (0.04 + top) / 2, d / 2 - 0.004), (0.014, top * 0.74, 0.012)) for x in (-0.3, -0.1, 0.1, 0.3)]
    wheels = [
        cylinder((0, 0, 0), 0.03, 0.02, sides=8).turned("z", math.pi / 2).moved(a * w * 0.38, 0.03, b * d * 0.3)
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    arch = tube(
        [
            (-w * 0.22, top, -d * 0.3),
            (-w * 0.22, h - 0.014, -d * 0.3),
            (w * 0.22, h - 0.014, -d * 0.3),
            (w * 0.22, top, -d * 0.3),
        ],
        0.012,
        sides=5,
    )
    seam = box((0, (0.04 + top) / 2, 0), (w + 0.002, top - 0.05, 0.014))
    return [
        made_of(plain(order.finish), shell),
        made_of(plain(order.finish, 0.7), *ribs),
        made_of(BLACK, *wheels, seam),
        made_of(STEEL, arch),
    ]


def umbrella_stand(order: Order) -> list[Part]:
    """A round stand with two closed umbrellas."""
    w, h, d = order.size
    r, tall = min(w, d) / 2, h * 0.58
    skin = lathe(
        [(r * 0.9, 0.0), (r * 0.92, tall - 0.02), (r, tall), (r * 0.86, tall), (r * 0.84, tall * 0.6)], sides=14
    )
    parts = [made_of(order.finish, skin)]
    for s, tone in ((-1, (170, 44, 48)), (1, (40, 60, 110))):
        cloth = tube(
            [(s * r * 0.2, tall * 0.5, 0), (s * r * 0.5, h * 0.78, 0), (s * r * 0.56, h * 0.82, 0)],
            [0.02, 0.045, 0.02],
            sides=7,
        )
        grip = tube(
            [
                (s * r * 0.56, h * 0.8, 0),
                (s * r * 0.66, h * 0.93, 0),
                (s * r * 0.6, h - 0.012, 0),
                (s * r * 0.36, h - 0.03, 0),
            ],
            0.011,
            sides=5,
        )
        parts += [made_of(Finish(material="plastic", rgb=tone), cloth), made_of(DARK_WOOD, grip)]
    return parts


def toy(order: Order) -> list[Part]:
    """A sitting teddy bear."""
    w, h, d = order.size
    fur = order.finish
    body = ball((0, h * 0.3, -d * 0.06), (w * 0.6, h * 0.56, d * 0.62), sides=8)
    head = ball((0, h * 0.72, -d * 0.02), (w * 0.56, h * 0.42, d * 0.56), sides=8)
    ears = [ball((s * w * 0.23, h * 0.91, -d * 0.04), (w * 0.2, h * 0.16, d * 0.14), sides=6, rings=3) for s in (-1, 1)]
    arms = [
        ball((0, 0, 0), (w * 0.2, h * 0.34, d * 0.22), sides=6, rings=4)
        .turned("z", s * 0.5)
        .moved(s * w * 0.34, h * 0.38, d * 0.08)
        for s in (-1, 1)
    ]
    feet = [ball((s * w * 0.27, h * 0.1, d * 0.28), (w * 0.26, h * 0.2, d * 0.42), sides=7, rings=4) for s in (-1, 1)]
    light = plain(fur, 1.4)
    snout = ball((0, h * 0.67, d * 0.24), (w * 0.24, h * 0.15, d * 0.16), sides=6, rings=3)
    tummy = ball((0, h * 0.3, d * 0.2), (w * 0.34, h * 0.34, d * 0.12), sides=7, rings=3)
    soles = [ball((s * w * 0.27, h * 0.1, d * 0.46), (w * 0.15, h * 0.12, d * 0.06), sides=6, rings=2) for s in (-1, 1)]
    dots = [ball((s * w * 0.11, h * 0.77, d * 0.23), (w * 0.06, h * 0.05, d * 0.04), sides=5, rings=2) for s in (-1, 1)]
    nose = ball((0, h * 0.7, d * 0.31), (w * 0.09, h * 0.05, d * 0.05), sides=5, rings=2)
    return [
        made_of(plain(fur), body, head, *ears, *arms, *feet),
        made_of(light, snout, tummy, *soles),
        made_of(BLACK, *dots, nose),
    ]


def play_ball(order: Order) -> list[Part]:
    """A ball in wedges of two colours."""
    w, h, d = order.size
    skin = ball((0, h / 2, 0), (w, h, d), sides=12, rings=8)
    even = np.arange(len(skin.corners)) % 4 < 2
    two = [Shape(skin.corners[keep], skin.normals[keep], skin.uv[keep]) for keep in (even, ~even)]
    other = Finish(material="plastic", rgb=order.finish.rgb2 or (244, 244, 240))
    return [made_of(plain(order.finish), two[0]), made_of(other, two[1])]


BUILDERS: dict[str, Builder] = {
    "shoes": shoes,
    "box": cardboard_box,
    "basket": basket,
    "bin": bin_,
    "bag": bag,
    "backpack": backpack,
    "suitcase": suitcase,
    "umbrella stand": umbrella_stand,
    "toy": toy,
    "ball": play_ball,
}
