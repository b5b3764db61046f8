"""Large things of their own kind: piano, bicycle, exercise machines, guitar, fire extinguisher."""

import math

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .lofts import ball, cylinder, lathe, loft, ring, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, BRASS, DARK_METAL, DARK_WOOD, LIT_SCREEN, PAPER, RED, STEEL, WHITE, is_dark
from .shapes import box, rounded_box, slab


def piano(order: Order) -> list[Part]:
    """An upright piano: case, keys in white and black, a stand with notes, legs and pedals."""
    w, h, d = order.size
    finish = order.finish
    keys_y, keys_d = min(0.72, h * 0.66), d * 0.42
    back_d = d - keys_d
    zb = -d / 2 + back_d / 2
    case = [rounded_box((0, h / 2, zb), (w, h, back_d), 0.01)]
    case += [
        box((s * (w / 2 - 0.03), keys_y / 2 + 0.06, d / 2 - keys_d / 2), (0.06, keys_y + 0.1, keys_d)) for s in (-1, 1)
    ]
    case.append(box((0, keys_y - 0.06, d / 2 - keys_d / 2), (w - 0.1, 0.1, keys_d - 0.01)))
    case.append(box((0, 0.03, d / 2 - keys_d / 2), (w - 0.12, 0.06, keys_d * 0.7)))
    num = 21
    key_w = (w - 0.16) / num
    z = d / 2 - 0.02 - keys_d * 0.36
    white = [
        slab(((k + 0.5 - num / 2) * key_w, keys_y + 0.004, z), (key_w - 0.006, 0.024, keys_d * 0.66), faces="+y+z+x")
        for k in range(num)
    ]
    black = [
        slab(
            ((k + 1 - num / 2) * key_w, keys_y + 0.024, z - keys_d * 0.1),
            (key_w * 0.52, 0.022, keys_d * 0.4),
            faces="+y+z+x-x",
        )
        for k in range(num - 1)
        if k % 7 not in (2, 6)
    ]
    stand = box((0, 0, 0), (w * 0.46, 0.22, 0.012)).turned("x", -0.16).moved(0, keys_y + 0.2, -d / 2 + back_d + 0.045)
    notes = [
        slab((s * 0.1, 0, 0.008), (0.18, 0.2, 0.004), faces="+z")
        .turned("x", -0.16)
        .moved(0, keys_y + 0.2, -d / 2 + back_d + 0.05)
        for s in (-1, 1)
    ]
    pedals = [box((x, 0.075, -d / 2 + back_d + 0.04), (0.03, 0.014, 0.1)) for x in (-0.07, 0.0, 0.07)]
    return [
        made_of(finish, *case),
        made_of(WHITE, *white),
        made_of(BLACK, *black),
        made_of(finish, stand),
        made_of(PAPER, *notes),
        made_of(BRASS, *pedals),
    ]


def _wheel(x: float, y: float, radius: float) -> list[Part]:
    """A tyre with spokes in the plane across z."""
    spokes = []
    for k in range(6):
        a = k * math.pi / 6
        spokes.append(
            tube(
                [
                    (x - radius * math.cos(a), y - radius * math.sin(a), 0),
                    (x + radius * math.cos(a), y + radius * math.sin(a), 0),
                ],
                0.004,
                sides=3,
            )
        )
    return [made_of(BLACK, ring((x, y, 0), radius, 0.02, sides=20, around=5)), made_of(STEEL, *spokes)]


def bicycle(order: Order) -> list[Part]:
    """Two wheels, a diamond frame, saddle, handlebar, chain wheel and pedals; its length is along x."""
    w, h, d = order.size
    r = min(h * 0.34, w * 0.2)
    left, right = -w / 2 + r + 0.025, w / 2 - r - 0.025
    axle = r + 0.022
    crank = (left + (right - left) * 0.4, axle * 0.9, 0.0)
    saddle = (crank[0] - w * 0.09, h * 0.82, 0.0)
    head = (right - w * 0.1, h * 0.84, 0.0)
    low_head = (right - w * 0.075, h * 0.66, 0.0)
    seat_joint = (crank[0] - w * 0.065, h * 0.64, 0.0)
    frame = [
        tube([crank, seat_joint], 0.019),
        tube([seat_joint, (head[0] + 0.01, h * 0.74, 0)], 0.019),
        tube([crank, low_head], 0.021),
        tube([(left, axle, 0.03), crank], 0.012),
        tube([(left, axle, 0.03), seat_joint], 0.011),
        tube([head, low_head], 0.02),
        tube([low_head, (right, axle, 0.03)], 0.014),
    ]
    reach = min(d / 2, 0.28)
    bar = tube(
        [
            (head[0] - 0.04, h * 0.97, -reach),
            (head[0] + 0.02, h * 0.95, -reach * 0.4),
            (head[0], h * 0.94, 0),
            (head[0] + 0.02, h * 0.95, reach * 0.4),
            (head[0] - 0.04, h * 0.97, reach),
        ],
        0.013,
    )
    stem = tube([head, (head[0], h * 0.94, 0)], 0.014)
    post = tube([seat_joint, saddle], 0.014)
    seat = ball((saddle[0] + 0.02, saddle[1] + 0.02, 0), (0.27, 0.07, 0.15), sides=8, rings=4)
    chain = cylinder((0, 0, 0), 0.09, 0.012, sides=12).turned("x", math.pi / 2).moved(crank[0], crank[1], 0.02)
    arms = [
        tube([(crank[0], crank[1], 0.04), (crank[0] + 0.15, crank[1] - 0.04, 0.05)], 0.009, sides=4),
        tube([(crank[0], crank[1], -0.04), (crank[0] - 0.15, crank[1] + 0.04, -0.05)], 0.009, sides=4),
    ]
    pedals = [box((crank[0] + s * 0.15, crank[1] - s * 0.04, s * 0.09), (0.09, 0.02, 0.07)) for s in (1, -1)]
    grips = [
        tube([(head[0] - 0.04, h * 0.97, s * reach), (head[0] - 0.02, h * 0.965, s * reach * 0.72)], 0.019)
        for s in (-1, 1)
    ]
    return [
        *_wheel(left, axle, r),
        *_wheel(right, axle, r),
        made_of(order.finish, *frame),
        made_of(STEEL, bar, stem, post, chain, *arms),
        made_of(BLACK, seat, *pedals, *grips),
    ]


def exercise_bike(order: Order) -> list[Part]:
    """A flywheel in a case, a saddle, handles with a display, pedals, on two cross bars; it looks along +z."""
    w, h, d = order.size
    accent = order.finish if not is_dark(order.finish) else Finish(material="plastic", rgb=(190, 60, 50))
    bars = [tube([(-w / 2 + 0.03, 0.035, z), (w / 2 - 0.03, 0.035, z)], 0.034) for z in (-d * 0.42, d * 0.42)]
    spine = [tube([(0, 0.05, -d * 0.42), (0, 0.12, 0.0), (0, 0.05, d * 0.42)], 0.03)]
    wheel_y, wheel_z, r = h * 0.3, d * 0.2, min(h * 0.22, d * 0.28)
    wheel = cylinder((0, 0, 0), r, 0.07, sides=20).turned("z", math.pi / 2).moved(0.035, wheel_y, wheel_z)
    cover = cylinder((0, 0, 0), r * 0.62, 0.09, sides=16).turned("z", math.pi / 2).moved(0.045, wheel_y, wheel_z)
    post = tube([(0, 0.1, -d * 0.12), (0, h * 0.68, -d * 0.3)], 0.026)
    saddle = [ball((0, h * 0.7, -d * 0.3), (0.24, 0.08, 0.28), sides=8, rings=4)]
    mast = tube([(0, 0.12, d * 0.2), (0, h * 0.86, d * 0.3)], 0.028)
    reach = w * 0.4
    grips = tube(
        [
            (-reach, h * 0.9, d * 0.08),
            (-reach * 0.9, h * 0.84, d * 0.28),
            (0, h * 0.82, d * 0.32),
            (reach * 0.9, h * 0.84, d * 0.28),
            (reach, h * 0.9, d * 0.08),
        ],
        0.018,
    )
    panel = rounded_box((0, 0, 0), (0.2, 0.14, 0.04), 0.015).turned("x", 0.6).moved(0, h * 0.93, d * 0.3)
    screen = box((0, 0, -0.022), (0.14, 0.08, 0.006)).turned("x", 0.6).moved(0, h * 0.93, d * 0.3)
    crank_y, crank_z = h * 0.26, -d * 0.04
    cranks = [
        tube([(s * 0.06, crank_y, crank_z), (s * 0.1, crank_y + s * 0.1, crank_z + s * 0.1)], 0.012, sides=5)
        for s in (-1, 1)
    ]
    pedals = [box((s * 0.15, crank_y + s * 0.1, crank_z + s * 0.1), (0.1, 0.025, 0.1)) for s in (-1, 1)]
    hub = cylinder((0, 0, 0), 0.09, 0.12, sides=12).turned("z", math.pi / 2).moved(0.06, crank_y, crank_z)
    return [
        made_of(DARK_METAL, *bars, *spine, post, mast),
        made_of(BLACK, *saddle, grips, panel, hub, *pedals),
        made_of(STEEL, wheel, *cranks),
        made_of(accent, cover),
        made_of(LIT_SCREEN, screen),
    ]


def treadmill(order: Order) -> list[Part]:
    """A belt between side rails, two posts with a display; one stands on its rear end (-z side is the display)."""
    w, h, d = order.size
    deck = rounded_box((0, 0.09, 0), (w * 0.9, 0.12, d), 0.03)
    belt = slab((0, 0.153, d * 0.05), (w * 0.6, 0.008, d * 0.84), faces="+y")
    rails = [box((s * w * 0.38, 0.16, 0.04), (w * 0.12, 0.02, d * 0.9)) for s in (-1, 1)]
    posts = [tube([(s * w * 0.45, 0.1, -d * 0.34), (s * w * 0.45, h * 0.86, -d * 0.44)], 0.03) for s in (-1, 1)]
    arms = [tube([(s * w * 0.45, h * 0.74, -d * 0.43), (s * w * 0.45, h * 0.74, -d * 0.12)], 0.024) for s in (-1, 1)]
    panel = rounded_box((0, 0, 0), (w * 0.96, 0.22, 0.06), 0.02).turned("x", -0.5).moved(0, h * 0.88, -d * 0.42)
    screen = slab((0, 0, 0.034), (w * 0.4, 0.13, 0.004), faces="+z").turned("x", -0.5).moved(0, h * 0.88, -d * 0.42)
    return [
        made_of(DARK_METAL, deck, *posts, *arms),
        made_of(BLACK, belt, panel),
        made_of(STEEL, *rails),
        made_of(LIT_SCREEN, screen),
    ]


def guitar(order: Order) -> list[Part]:
    """A waisted body with a hole, a neck with strings, a head; it leans upright."""
    w, h, d = order.size
    body_h = h * 0.46
    half = [
        (0.0, 0.0),
        (0.62, 0.03),
        (0.94, 0.16),
        (1.0, 0.28),
        (0.84, 0.44),
        (0.62, 0.54),
        (0.64, 0.68),
        (0.76, 0.8),
        (0.66, 0.93),
        (0.3, 1.0),
    ]
    outline = [(x * w / 2, y * body_h) for x, y in half] + [(-x * w / 2, y * body_h) for x, y in reversed(half[1:])]
    thick = d * 0.75
    rings = [np.array([(x, y, z) for x, y in outline]) for z in (-thick / 2, thick / 2)]
    centre = np.array([(0.0, y, thick / 2) for _, y in outline])
    skin = loft([*rings, centre])
    hole = cylinder((0, 0, 0), w * 0.15, 0.006, sides=12).turned("x", math.pi / 2).moved(0, body_h * 0.62, thick / 2)
    neck = box((0, (body_h * 0.75 + h * 0.9) / 2, thick / 2 + 0.004), (0.05, h * 0.9 - body_h * 0.75, 0.022))
    head = box((0, h * 0.94, thick / 2 - 0.006), (0.075, h * 0.12, 0.02))
    bridge = box((0, body_h * 0.3, thick / 2 + 0.006), (w * 0.34, 0.022, 0.012))
    strings = [
        slab((x, (body_h * 0.3 + h * 0.92) / 2, thick / 2 + 0.018), (0.003, h * 0.92 - body_h * 0.3, 0.002), faces="+z")
        for x in (-0.015, -0.005, 0.005, 0.015)
    ]
    pegs = [
        ball((s * 0.046, h * y, thick / 2 - 0.006), (0.024, 0.02, 0.016), sides=5, rings=2)
        for s in (-1, 1)
        for y in (0.9, 0.94, 0.98)
    ]
    return [
        made_of(order.finish, skin),
        made_of(BLACK, hole),
        made_of(DARK_WOOD, neck, head, bridge),
        made_of(STEEL, *strings, *pegs),
    ]


def fire_extinguisher(order: Order) -> list[Part]:
    """A red bottle with a lever, a gauge and a hose."""
    w, h, d = order.size
    red = order.finish if order.finish.rgb[0] > 120 and order.finish.rgb[1] < 110 else RED
    r = min(w, d) * 0.4
    top = h * 0.76
    bottle = lathe(
        [(r * 0.9, 0.0), (r, 0.03), (r, top * 0.84), (r * 0.7, top * 0.95), (r * 0.3, top), (r * 0.3, top + 0.03)],
        sides=14,
        caps="start",
    )
    label = lathe([(r * 1.01, top * 0.35), (r * 1.01, top * 0.62)], sides=14)
    valve = [
        box((0, top + 0.05, 0), (0.035, 0.05, 0.04)),
        box((w * 0.12, h * 0.93, 0), (w * 0.5, 0.016, 0.03)).turned("z", 0.0),
        tube([(0, top + 0.06, 0), (w * 0.34, top + 0.03, 0)], 0.009, sides=4),
    ]
    hose_points: list[Vec] = [
        (-0.02, top + 0.05, 0.0),
        (-w * 0.4, top, 0.02),
        (-w * 0.46, top * 0.6, 0.03),
        (-w * 0.42, top * 0.28, 0.03),
    ]
    hose = tube(hose_points, 0.013)
    horn = tube([(-w * 0.42, top * 0.3, 0.03), (-w * 0.4, top * 0.1, 0.03)], [0.014, 0.028])
    gauge = cylinder((0, 0, 0), 0.022, 0.016, sides=8).turned("x", math.pi / 2).moved(0, top + 0.045, 0.02)
    return [made_of(red, bottle), made_of(PAPER, label), made_of(BLACK, *valve, hose, horn), made_of(WHITE, gauge)]


BUILDERS: dict[str, Builder] = {
    "piano": piano, "bicycle": bicycle, "exercise bike": exercise_bike, "treadmill": treadmill, "guitar": guitar,
    "fire extinguisher": fire_extinguisher,
}  # fmt: skip
