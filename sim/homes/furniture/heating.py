"""What heats or cools a room: fireplaces and their mantels, radiators, fans."""

import math

import numpy as np

from sim.homes.plan import Finish

from .lofts import ball, cylinder, lathe, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK_METAL, BRASS, DARK_METAL, DARK_WOOD, FIRE, SOOT, STEEL, WHITE, is_dark, plain
from .shapes import box, picture_quad, prism, rounded_box, slab


def fireplace(order: Order) -> list[Part]:
    """Pillars and a mantel around a dark opening with logs and flames, on a hearth."""
    w, h, d = order.size
    finish = order.finish
    hearth, shelf = 0.06, 0.07
    open_w, open_h = w * 0.52, (h - hearth) * 0.6
    side = (w * 0.92 - open_w) / 2
    depth = d * 0.78
    z = -d / 2 + depth / 2
    pillars = [
        box((s * (open_w + side) / 2, (h - shelf + hearth) / 2, z), (side, h - shelf - hearth, depth)) for s in (-1, 1)
    ]
    lintel = box((0, (hearth + open_h + h - shelf) / 2, z), (open_w, h - shelf - hearth - open_h, depth))
    mantel = [
        rounded_box((0, h - shelf / 2, -d * 0.04), (w, shelf, d * 0.92), 0.012),
        box((0, h - shelf - 0.02, z + 0.01), (w * 0.95, 0.04, depth)),
    ]
    base = rounded_box((0, hearth / 2, 0), (w, hearth, d), 0.008)
    back = -d / 2 + 0.04
    mid = hearth + open_h / 2
    soot = [
        picture_quad((0.0, mid, back), (open_w, open_h)),
        slab((0, hearth + 0.006, z), (open_w, 0.012, depth), faces="+y"),
    ]
    trim = box((0.0, hearth + open_h + 0.015, z + depth / 2 + 0.006), (open_w, 0.03, 0.012))
    edges = [box((s * (open_w / 2 + 0.012), mid, z + depth / 2 + 0.006), (0.024, open_h, 0.012)) for s in (-1, 1)]
    return [
        made_of(finish, *pillars, lintel, *mantel),
        made_of(plain(finish, 0.7), base),
        made_of(SOOT, *soot),
        made_of(BLACK_METAL, trim, *edges),
        *_fire(open_w, open_h, hearth, z + depth * 0.1),
    ]


def _fire(open_w: float, open_h: float, hearth: float, log_z: float) -> list[Part]:
    """Three logs and flames on a hearth of some height, before the depth `log_z`."""
    logs = [
        tube([(-open_w * 0.3, hearth + 0.06, log_z), (open_w * 0.3, hearth + 0.05, log_z + 0.03)], 0.045),
        tube([(-open_w * 0.24, hearth + 0.06, log_z - 0.1), (open_w * 0.28, hearth + 0.06, log_z - 0.08)], 0.045),
        tube([(-open_w * 0.2, hearth + 0.13, log_z - 0.02), (open_w * 0.22, hearth + 0.14, log_z - 0.06)], 0.04),
    ]
    flames = [
        lathe(
            [(0.02, 0.0), (size * 0.36, size * 0.3), (size * 0.2, size * 0.65), (0.0, size)],
            at=(x * open_w, hearth + 0.1, log_z - 0.04),
            sides=6,
        )
        for x, size in ((-0.16, open_h * 0.5), (0.02, open_h * 0.66), (0.18, open_h * 0.44))
    ]
    core = [
        lathe(
            [(0.01, 0.0), (size * 0.3, size * 0.3), (0.0, size)], at=(x * open_w, hearth + 0.1, log_z + 0.02), sides=5
        )
        for x, size in ((-0.1, open_h * 0.26), (0.1, open_h * 0.3))
    ]
    return [
        made_of(DARK_WOOD, *logs),
        made_of(FIRE, *flames),
        made_of(Finish(material="plastic", rgb=(252, 218, 90)), *core),
    ]


def mantle(order: Order) -> list[Part]:
    """A thick shelf on two brackets; candlesticks stand on it where there is room."""
    w, h, d = order.size
    thick = min(0.08, h * 0.5)
    low = h * 0.3
    board = rounded_box((0, low + thick / 2, 0), (w, thick, d), 0.012)
    brackets = [
        prism(
            [(low, -d / 2), (low - min(low, 0.14), -d / 2), (low, d * 0.3)][::-1], low=x - 0.03, high=x + 0.03, axis="x"
        )
        for x in (-w * 0.36, w * 0.36)
    ]
    room = h - low - thick
    holders = [
        lathe(
            [(room * 0.3, 0.0), (room * 0.1, room * 0.15), (room * 0.14, room * 0.5)],
            at=(x * w, low + thick, 0),
            sides=6,
            caps="end",
        )
        for x in (-0.36, 0.36)
    ]
    candles = [cylinder((x * w, low + thick + room * 0.5, 0), room * 0.1, room * 0.4, sides=6) for x in (-0.36, 0.36)]
    clock = rounded_box((0, low + thick + room * 0.42, 0), (room * 1.1, room * 0.84, d * 0.4), room * 0.1)
    face = (
        cylinder((0, 0, 0), room * 0.32, 0.006, sides=12)
        .turned("x", math.pi / 2)
        .moved(0, low + thick + room * 0.42, d * 0.2)
    )
    return [
        made_of(order.finish, board, *brackets),
        made_of(BRASS, *holders),
        made_of(WHITE, *candles, face),
        made_of(DARK_WOOD, clock),
    ]


def radiator(order: Order) -> list[Part]:
    """Ribs side by side between two pipes, a valve and feet; high on the wall a cooling box with slats."""
    w, h, d = order.size
    finish = order.finish
    foot = min(0.08, h * 0.15)
    num = max(4, min(16, round(w / 0.08)))
    step = (w - 0.08) / num
    ribs = [
        rounded_box(
            (-w / 2 + 0.02 + (k + 0.5) * step, (foot + h) / 2, 0), (step * 0.72, h - foot, d), min(0.03, step * 0.3)
        )
        for k in range(num)
    ]
    pipes = [tube([(-w / 2, y, 0), (w / 2 - 0.03, y, 0)], 0.018, sides=5) for y in (foot + 0.06, h - 0.06)]
    valve = cylinder((0, 0, 0), 0.026, 0.05, sides=8).turned("z", math.pi / 2).moved(w / 2, h - 0.06, 0)
    riser = tube([(w / 2 - 0.03, foot + 0.06, 0), (w / 2 - 0.02, 0.0, 0)], 0.012, sides=5)
    feet = [box((s * w * 0.36, foot / 2 + 0.02, 0), (0.03, foot + 0.04, d * 0.7)) for s in (-1, 1)]
    return [
        made_of(finish, *ribs, *pipes, *feet),
        made_of(STEEL, riser),
        made_of(BLACK_METAL if not is_dark(finish) else STEEL, valve),
    ]


def fan(order: Order) -> list[Part]:
    """A fan on a pole with a cage, or blades under the ceiling."""
    w, h, d = order.size
    if order.says("ceiling"):
        hub = lathe([(0.02, 0.0), (0.1, 0.03), (0.1, 0.1), (0.03, 0.14)], sides=10)
        rod = cylinder((0, 0.1, 0), 0.015, h - 0.12, sides=5)
        rose = cylinder((0, h - 0.03, 0), 0.07, 0.03, sides=8)
        blades = [
            rounded_box((w * 0.28, 0.07, 0), (w * 0.4, 0.012, 0.13), 0.005).turned("y", k * 2 * math.pi / 5)
            for k in range(5)
        ]
        return [made_of(DARK_METAL, hub, rod, rose), made_of(order.finish, *blades)]
    r = min(w / 2, h * 0.24)
    y, z = h - r, d * 0.05
    foot = lathe([(min(w, d) * 0.42, 0.0), (min(w, d) * 0.42, 0.025), (0.03, 0.05)], sides=14)
    pole = cylinder((0, 0.03, -0.02), 0.018, h - r - 0.03, sides=6)
    motor = ball((0, y, z - 0.08), (0.11, 0.11, 0.16), sides=8, rings=4)
    blades = [
        ball((0, r * 0.45, 0), (r * 0.42, r * 0.8, 0.02), sides=6, rings=3)
        .turned("z", k * 2 * math.pi / 3)
        .moved(0, y, z)
        for k in range(3)
    ]
    angle = np.arange(16) * 2 * math.pi / 16
    rings = [
        tube([(s * r * math.cos(a), y + s * r * math.sin(a), z + dz) for a in angle], 0.006, sides=3, is_closed=True)
        for s, dz in ((0.97, 0.0), (0.8, 0.06), (0.4, 0.08))
    ]
    spokes = [
        tube(
            [
                (0, y, z + 0.08),
                (0.8 * r * math.cos(a), y + 0.8 * r * math.sin(a), z + 0.06),
                (0.97 * r * math.cos(a), y + 0.97 * r * math.sin(a), z),
            ],
            0.004,
            sides=3,
        )
        for a in angle[::2]
    ]
    return [
        made_of(order.finish, foot, pole, motor),
        made_of(Finish(material="plastic", rgb=(120, 160, 196)), *blades),
        made_of(STEEL, *rings, *spokes),
    ]


BUILDERS: dict[str, Builder] = {"fireplace": fireplace, "mantle": mantle, "radiator": radiator, "fan": fan}
