"""Small things that stand on tables and shelves: books, bottles, cups, bowls, statues, speakers and the like."""

import math

from sim.homes.plan import Finish

from .lofts import ball, cylinder, lathe, ring, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, BLACK_METAL, BRASS, DARK_METAL, GLOW, PAPER, SPINES, STEEL, WHITE, plain
from .shapes import box, prism, rounded_box, slab


def book(order: Order) -> list[Part]:
    """A pile of books, each turned a little; one is the caption's colour."""
    w, h, d = order.size
    num = max(1, min(4, round(h / 0.04)))
    step = h / num
    parts: list[Part] = []
    first = int(order.rng.integers(len(SPINES)))
    for k in range(num):
        cover = order.finish if k == num - 1 else Finish(material="plastic", rgb=SPINES[(first + k) % len(SPINES)])
        share = 0.96 - 0.05 * ((k * 2) % 3)
        turn = 0.0 if num == 1 else (0.1, -0.12, 0.05, -0.03)[k]
        width, deep = w * share * 0.92, d * share * 0.9
        boards = [box((0, step * (k + t), 0), (width, min(0.006, step * 0.2), deep)) for t in (0.1, 0.9)]
        spine = box((-width / 2 + 0.004, step * (k + 0.5), 0), (0.008, step * 0.9, deep))
        pages = box((0.004, step * (k + 0.5), 0), (width - 0.016, step * 0.76, deep - 0.014))
        parts += [
            Part(part.shape.turned("y", turn), part.finish)
            for part in (made_of(plain(cover), *boards, spine), made_of(PAPER, pages))
        ]
    return parts


def bottle(order: Order) -> list[Part]:
    """A wine bottle with a label and a cap."""
    w, h, d = order.size
    r = min(w, d) / 2
    skin = lathe(
        [(r * 0.9, 0.0), (r, h * 0.03), (r, h * 0.56), (r * 0.36, h * 0.74), (r * 0.32, h * 0.93)],
        sides=10,
        caps="start",
    )
    label = lathe([(r * 1.02, h * 0.18), (r * 1.02, h * 0.44)], sides=10)
    cap = cylinder((0, h * 0.92, 0), r * 0.38, h * 0.08, sides=6)
    return [
        made_of(order.finish, skin),
        made_of(PAPER, label),
        made_of(Finish(material="plastic", rgb=(150, 40, 46)), cap),
    ]


def cup(order: Order) -> list[Part]:
    """A mug with a handle; a drinking glass on a stem where it is of glass."""
    w, h, d = order.size
    if order.says("glass") or order.finish.material == "glass":
        r = min(w, d) / 2
        profile = [
            (r * 0.8, 0.0),
            (r * 0.12, h * 0.05),
            (r * 0.1, h * 0.42),
            (r * 0.7, h * 0.52),
            (r, h * 0.75),
            (r * 0.82, h),
            (r * 0.74, h * 0.98),
            (r * 0.86, h * 0.74),
            (0.0, h * 0.56),
        ]
        drink = lathe([(r * 0.84, h * 0.74), (0.0, h * 0.745)], sides=10)
        return [
            made_of(Finish(material="plastic", rgb=(206, 224, 232)), lathe(profile, sides=10)),
            made_of(Finish(material="plastic", rgb=(140, 30, 50)), drink),
        ]
    r = min(w * 0.38, d / 2)
    x = -w / 2 + r
    skin = lathe(
        [(r * 0.8, 0.0), (r, h * 0.2), (r, h), (r * 0.88, h), (r * 0.86, h * 0.5), (0.0, h * 0.45)],
        at=(x, 0, 0),
        sides=10,
    )
    grip = tube(
        [
            (x + r * 0.95, h * 0.8, 0),
            (w / 2 - 0.008, h * 0.74, 0),
            (w / 2 - 0.008, h * 0.36, 0),
            (x + r * 0.95, h * 0.24, 0),
        ],
        0.008,
        sides=4,
    )
    tea = lathe([(r * 0.87, h * 0.82), (0.0, h * 0.82)], at=(x, 0, 0), sides=8)
    return [made_of(order.finish, skin, grip), made_of(Finish(material="plastic", rgb=(84, 52, 34)), tea)]


def bowl(order: Order) -> list[Part]:
    """A bowl of fruit."""
    w, h, d = order.size
    r, tall = w / 2, h * 0.62
    skin = lathe(
        [
            (r * 0.36, 0.0),
            (r * 0.4, tall * 0.1),
            (r * 0.85, tall * 0.6),
            (r, tall),
            (r * 0.94, tall),
            (r * 0.76, tall * 0.6),
            (0.0, tall * 0.3),
        ],
        sides=14,
        depth=d / w,
    )
    size = min(w, d) * 0.3
    fruit = []
    for k, tone in enumerate(((214, 60, 50), (240, 160, 50), (150, 180, 70), (232, 200, 70))):
        a = k * math.pi / 2 + 0.4
        fruit.append(
            made_of(
                Finish(material="plastic", rgb=tone),
                ball(
                    (0.42 * r * math.cos(a), h - size / 2 - 0.01 * (k % 2), 0.42 * r * math.sin(a) * d / w),
                    (size, size, size),
                    sides=6,
                    rings=3,
                ),
            )
        )
    return [made_of(order.finish, skin), *fruit]


def kettle(order: Order) -> list[Part]:
    """A round can with a spout, an arched handle and a lid."""
    w, h, d = order.size
    r = min(d / 2, w * 0.38)
    x = -w / 2 + r + w * 0.06
    tall = h * 0.7
    skin = lathe(
        [(r * 0.95, 0.0), (r, tall * 0.2), (r * 0.86, tall * 0.7), (r * 0.5, tall * 0.95), (r * 0.46, tall)],
        at=(x, 0, 0),
        sides=12,
        caps="both",
    )
    spout = tube(
        [(x + r * 0.7, tall * 0.35, 0), (x + r * 1.15, tall * 0.6, 0), (w / 2 - 0.008, tall * 0.92, 0)],
        [0.028, 0.02, 0.013],
    )
    grip = tube(
        [
            (x - r * 0.7, tall * 0.8, 0),
            (x - r * 0.66, h * 0.94, 0),
            (x, h - 0.012, 0),
            (x + r * 0.66, h * 0.94, 0),
            (x + r * 0.7, tall * 0.8, 0),
        ],
        0.011,
        sides=5,
    )
    knob = ball((x, tall + 0.012, 0), (0.03, 0.03, 0.03), sides=6, rings=3)
    return [made_of(order.finish, skin, spout), made_of(BLACK, grip, knob)]


def speaker(order: Order) -> list[Part]:
    """A case with two round membranes."""
    w, h, d = order.size
    case = rounded_box((0, h / 2, -0.01), (w, h, d - 0.02), 0.012)
    z = d / 2 - 0.02
    parts = [made_of(order.finish, case)]
    rims, cones, caps = [], [], []
    for y, r in ((h * 0.32, min(w * 0.36, h * 0.26)), (h * 0.74, min(w * 0.2, h * 0.13))):
        rims.append(ring((0, y, z + 0.002), r, 0.012, sides=12, around=3))
        cones.append(lathe([(r, 0.004), (r * 0.4, -0.02)], sides=12).turned("x", math.pi / 2).moved(0, y, z + 0.006))
        caps.append(ball((0, y, z), (r * 0.8, r * 0.8, 0.03), sides=8, rings=4))
    face = slab((0, h / 2, z - 0.008), (w * 0.92, h * 0.94, 0.018), faces="+z")
    return [
        *parts,
        made_of(BLACK, face),
        made_of(STEEL, *rims),
        made_of(DARK_METAL, *cones),
        made_of(plain(STEEL, 0.8), *caps),
    ]


def statue(order: Order) -> list[Part]:
    """A standing figure on a plinth."""
    w, h, d = order.size
    low = h * 0.14
    plinth = [box((0, low * 0.3, 0), (w, low * 0.6, d)), box((0, low * 0.8, 0), (w * 0.8, low * 0.4, d * 0.8))]
    t = h - low
    legs = [
        tube(
            [(s * w * 0.1, low, 0), (s * w * 0.09, low + t * 0.24, d * 0.03), (s * w * 0.08, low + t * 0.48, 0)],
            [w * 0.08, w * 0.075, w * 0.1],
        )
        for s in (-1, 1)
    ]
    torso = lathe(
        [(0.17, 0.44), (0.16, 0.54), (0.13, 0.6), (0.2, 0.74), (0.22, 0.79), (0.07, 0.84), (0.06, 0.87)],
        sides=8,
        depth=0.65,
    )
    torso = torso.scaled((w, t, d)).moved(0, low, 0)
    head = ball((0, low + t * 0.925, 0), (w * 0.2, t * 0.15, d * 0.22), sides=7)
    arms = [
        tube(
            [(-w * 0.22, low + t * 0.77, 0), (-w * 0.34, low + t * 0.6, 0), (-w * 0.2, low + t * 0.5, d * 0.16)],
            w * 0.055,
            sides=5,
        ),
        tube(
            [(w * 0.22, low + t * 0.77, 0), (w * 0.38, low + t * 0.88, 0), (w * 0.34, h - 0.02, d * 0.04)],
            w * 0.055,
            sides=5,
        ),
    ]
    return [made_of(order.finish, *legs, torso, head, *arms), made_of(plain(order.finish, 0.6), *plinth)]


def candle(order: Order) -> list[Part]:
    """A candle on a holder, lit."""
    w, h, d = order.size
    r = min(w, d) / 2
    holder = lathe(
        [(r, 0.0), (r, h * 0.03), (r * 0.3, h * 0.1), (r * 0.24, h * 0.3), (r * 0.5, h * 0.36)], sides=10, caps="end"
    )
    wax = cylinder((0, h * 0.36, 0), r * 0.34, h * 0.46, sides=7)
    flame = lathe([(0.002, 0.0), (r * 0.16, h * 0.05), (0.0, h * 0.15)], at=(0, h * 0.84, 0), sides=5)
    return [made_of(BRASS, holder), made_of(order.finish, wax), made_of(GLOW, flame)]


def printer(order: Order) -> list[Part]:
    """A low case with paper behind and a printed sheet in front."""
    w, h, d = order.size
    case = rounded_box((0, h * 0.36, -0.02), (w, h * 0.7, d * 0.72), 0.025)
    slot = slab((0, h * 0.22, d * 0.3), (w * 0.7, h * 0.14, 0.03), faces="+z")
    behind = box((0, 0, 0), (w * 0.6, h * 0.6, 0.006)).turned("x", -0.3).moved(0, h * 0.72, -d * 0.34)
    out = slab((0, h * 0.17, d * 0.38), (w * 0.58, 0.006, d * 0.2), faces="+y-y+z")
    keys = box((w * 0.3, h * 0.71, d * 0.12), (w * 0.24, 0.01, d * 0.12))
    return [made_of(plain(order.finish), case), made_of(BLACK, slot, keys), made_of(PAPER, behind, out)]


def telephone(order: Order) -> list[Part]:
    """A desk telephone with keys and a receiver."""
    w, h, d = order.size
    base = prism(
        [(0.0, -d / 2), (h * 0.6, -d / 2), (h * 0.24, d / 2), (0.0, d / 2)][::-1], low=-w / 2, high=w / 2, axis="x"
    )
    bar = tube([(-w * 0.3, h * 0.7, -d * 0.4), (-w * 0.3, h * 0.9, 0.0), (-w * 0.3, h * 0.5, d * 0.4)], 0.018, sides=6)
    ends = [
        ball((-w * 0.3, y * h, z * d), (0.06, 0.05, 0.06), sides=6, rings=3) for y, z in ((0.62, -0.38), (0.42, 0.36))
    ]
    keys = [
        box((w * (0.06 + 0.14 * c), h * (0.5 - 0.09 * r), d * (-0.2 + 0.2 * r)), (w * 0.09, 0.02, d * 0.12))
        for r in range(4)
        for c in range(3)
    ]
    return [made_of(plain(order.finish), base), made_of(BLACK_METAL, bar, *ends), made_of(WHITE, *keys)]


BUILDERS: dict[str, Builder] = {
    "book": book,
    "bottle": bottle,
    "cup": cup,
    "bowl": bowl,
    "kettle": kettle,
    "speaker": speaker,
    "statue": statue,
    "candle": candle,
    "printer": printer,
    "telephone": telephone,
}
