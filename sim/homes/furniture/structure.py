"""Parts of the house that episodes name: railings, stairs, windows, doors, shutters, columns."""

from sim.homes.plan import Finish

from .lofts import ball, lathe, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK_METAL, DARK_METAL, STEEL, WHITE, is_dark, plain
from .shapes import Shape, box, facets, prism, slab
from .wall_things import frame_bars


def railing(order: Order) -> list[Part]:
    """Posts, a hand rail and balusters: bars of iron, turned wood or stone; sloping in a stairwell."""
    w, h, d = order.size
    finish = order.finish
    thick = min(d, 0.07)
    slope = (
        0.45 * min(h, 1.2)
        if order.says("stairs", "stair", "staircase") and order.says("railing", "handrail", "banister") and w > 0.7
        else 0.0
    )
    rise = h - slope
    of_stone = order.says("balustrade", "parapet") or finish.material in ("stone", "plaster")
    num = max(4, min(14, round(w / (0.16 if of_stone else 0.12))))
    rail: list[Shape] = []
    for share, tall, deep in ((1.0, 0.055, thick), (0.12, 0.035, thick * 0.6)):
        y = rise * share - tall
        rail.append(
            prism(
                [(-w / 2, y), (w / 2, y + slope), (w / 2, y + slope + tall), (-w / 2, y + tall)],
                low=-deep / 2,
                high=deep / 2,
            )
        )
    for s in (-1, 1):
        post = min(thick * 1.3, d)
        top = rise - 0.02 + slope * (s + 1) / 2
        rail.append(box((s * (w / 2 - post / 2), top / 2, 0), (post, top, post)))
    bars: list[Shape] = []
    for k in range(num):
        share = (k + 0.5) / num
        x = -w / 2 + share * w
        low, high = rise * 0.1 + slope * share, rise - 0.05 + slope * share
        if of_stone:
            t = high - low
            r = min(0.045, thick * 0.6)
            bars.append(
                lathe(
                    [
                        (r * 0.8, low),
                        (r * 0.5, low + t * 0.12),
                        (r, low + t * 0.34),
                        (r * 0.45, low + t * 0.66),
                        (r * 0.8, low + t),
                    ],
                    at=(x, 0, 0),
                    sides=6,
                )
            )
        else:
            bars.append(tube([(x, low, 0), (x, high, 0)], 0.009 if finish.material == "metal" else 0.014, sides=4))
    return [
        made_of(finish, *rail),
        made_of(finish if finish.material != "wood" or of_stone else plain(finish, 0.95), *bars),
    ]


def stair(order: Order) -> list[Part]:
    """Steps that rise away from the front, with light treads, dark risers, and a rail at one side."""
    w, h, d = order.size
    has_rail = h > 0.8
    top = h * 0.72 if has_rail else h
    num = max(3, min(9, round(top / 0.17)))
    rise, run = top / num, d / num
    treads, risers = [], []
    for k in range(num):
        z = d / 2 - (k + 0.5) * run
        treads.append(box((0, (k + 1) * rise - 0.015, z + 0.008), (w, 0.03, run + 0.016 if k else run)))
        risers.append(slab((0, (k + 0.5) * rise - 0.015, z), (w - 0.04, rise - 0.03 + 0.0, run - 0.02), faces="+z"))
        risers.append(
            slab(
                (0, ((k + 1) * rise - 0.03) / 2, z),
                (w - 0.04, (k + 1) * rise - 0.03, run),
                faces="+x-x" + ("-z" if k == num - 1 else ""),
            )
        )
    parts = [
        made_of(order.finish, *treads),
        made_of(plain(order.finish, 1.35) if is_dark(order.finish) else WHITE, *risers),
    ]
    if has_rail:
        x = w / 2 - 0.03
        rail_h = h - top
        posts = [
            tube(
                [
                    (x, (k + 1) * rise - 0.02, d / 2 - (k + 0.5) * run),
                    (x, (k + 1) * rise + rail_h - 0.04 - rise * 0.5, d / 2 - (k + 0.5) * run),
                ],
                0.012,
                sides=4,
            )
            for k in range(num)
        ]
        hand = tube(
            [(x, rise * 0.5 + rail_h - 0.03, d / 2 - 0.02), (x, top + rail_h - rise * 0.6 - 0.02, -d / 2 + 0.03)], 0.026
        )
        parts.append(made_of(DARK_METAL, *posts, hand))
    return parts


def window(order: Order) -> list[Part]:
    """A frame with a cross of bars, sky and a hill behind the panes, a sill and a handle."""
    w, h, d = order.size
    rim = min(0.07, w * 0.09)
    sill_h = 0.05
    frame = order.finish if order.finish.material in ("wood", "metal", "plastic") else WHITE
    bars = [
        frame_bars(w * 0.97, h - sill_h, rim, d * 0.7).moved(y=sill_h),
        box((0, h / 2, 0), (rim * 0.8, h - 0.1, d * 0.5)),
        box((0, sill_h + (h - sill_h) * 0.6, 0), (w * 0.9, rim * 0.5, d * 0.45)),
    ]
    bars.append(box((0, sill_h / 2, 0.0), (w, sill_h, d)))
    z = -d * 0.05
    low, high, half = sill_h + rim * 0.5, h - rim * 0.5, w * 0.46
    sky = facets([[(-half, low, z), (half, low, z), (half, high, z), (-half, high, z)]])
    tall = high - low
    hill = facets(
        [
            [
                (-half, low, z + 0.003),
                (half, low, z + 0.003),
                (half, low + tall * 0.26, z + 0.003),
                (-half, low + tall * 0.36, z + 0.003),
            ]
        ]
    )
    trees = [
        ball((x * half, low + tall * 0.34, z + 0.002), (half * 0.36, tall * 0.3, 0.006), sides=8, rings=4)
        for x in (-0.6, 0.55)
    ]
    cloud = [
        ball((x * half, low + tall * y, z + 0.002), (half * s, tall * 0.09, 0.006), sides=8, rings=4)
        for x, y, s in ((-0.45, 0.86, 0.4), (0.5, 0.8, 0.5))
    ]
    grip = box((rim * 0.2, h * 0.45, d * 0.36), (0.02, 0.11, 0.02))
    return [
        made_of(frame, *bars),
        made_of(Finish(material="plastic", rgb=(166, 208, 242)), sky),
        made_of(Finish(material="plastic", rgb=(122, 164, 92)), hill),
        made_of(Finish(material="plastic", rgb=(74, 120, 66)), *trees),
        made_of(WHITE, *cloud),
        made_of(STEEL, grip),
    ]


def door(order: Order) -> list[Part]:
    """A leaf with four fields in a frame, a handle."""
    w, h, d = order.size
    rim = min(0.08, w * 0.1)
    posts = [box((s * (w - rim) / 2, h / 2, 0), (rim, h, d)) for s in (-1, 1)] + [
        box((0, h - rim / 2, 0), (w - 2 * rim, rim, d))
    ]
    leaf_w, leaf_h = w - 2 * rim, h - rim
    leaf = box((0, leaf_h / 2, 0), (leaf_w, leaf_h, d * 0.5))
    fields = [
        slab((sx * leaf_w * 0.23, leaf_h * y, d * 0.25), (leaf_w * 0.34, leaf_h * tall, d * 0.12), faces="+z+x-x+y-y")
        for sx in (-1, 1)
        for y, tall in ((0.25, 0.36), (0.7, 0.42))
    ]
    grip = tube(
        [
            (leaf_w * 0.42, leaf_h * 0.47, d * 0.25),
            (leaf_w * 0.42, leaf_h * 0.47, d * 0.46),
            (leaf_w * 0.28, leaf_h * 0.47, d * 0.46),
        ],
        0.012,
    )
    return [
        made_of(order.finish, leaf),
        made_of(plain(order.finish, 0.85), *posts),
        made_of(plain(order.finish, 0.92), *fields),
        made_of(STEEL, grip),
    ]


def column(order: Order) -> list[Part]:
    """A round shaft between a base and a capital."""
    w, h, d = order.size
    r = min(w, d) / 2
    blocks = [box((0, 0.04, 0), (w, 0.08, d)), box((0, h - 0.04, 0), (w, 0.08, d))]
    profile = [
        (r * 0.95, 0.08),
        (r * 0.9, 0.14),
        (r * 0.76, 0.18),
        (r * 0.68, h - 0.2),
        (r * 0.8, h - 0.14),
        (r * 0.95, h - 0.08),
    ]
    return [made_of(order.finish, *blocks, lathe(profile, sides=16))]


def shutter(order: Order) -> list[Part]:
    """Two leaves with slanting slats and a knob."""
    w, h, d = order.size
    frame: list[Shape] = []
    slats: list[Shape] = []
    leaf = w / 2
    rim = min(0.05, leaf * 0.14)
    num = max(5, min(14, round(h / 0.08)))
    for s in (-1, 1):
        x = s * leaf / 2
        frame += [box((x + e * (leaf - rim) / 2, h / 2, 0), (rim - 0.004, h, d * 0.6)) for e in (-1, 1)]
        frame += [box((x, y, 0), (leaf - 2 * rim, rim, d * 0.6)) for y in (rim / 2, h - rim / 2, h / 2)]
        for k in range(num):
            y = rim + (k + 0.5) * (h - 2 * rim) / num
            tilt = box((0, 0, 0), (leaf - 2 * rim, (h - 2 * rim) / num * 0.95, 0.008)).turned("x", 0.6)
            slats.append(tilt.moved(x, y, 0))
    knob = ball((rim * 0.9, h * 0.5, d * 0.34), (0.025, 0.025, 0.025), sides=6, rings=3)
    return [made_of(order.finish, *frame), made_of(plain(order.finish, 0.92), *slats), made_of(BLACK_METAL, knob)]


BUILDERS: dict[str, Builder] = {
    "railing": railing,
    "stair": stair,
    "window": window,
    "door": door,
    "column": column,
    "shutter": shutter,
}
