"""Lamps that stand on the floor or on tables, hang from ceilings and walls."""

import math

from sim.homes.plan import Finish

from .lofts import ball, cylinder, lathe, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK_METAL, BRASS, DARK_METAL, GLOW
from .shapes import Shape

_SHADE = Finish(material="plastic", rgb=(246, 232, 200))


def _stand_and_shade(order: Order) -> tuple[Finish, Finish]:
    """Metal (or what the caption says) for the stand, and the shade's finish."""
    finish = order.finish
    if finish.material in ("metal", "wood", "ceramic", "stone"):
        return finish, _SHADE
    return (BRASS if order.rng.random() < 0.4 else DARK_METAL), finish


def _shade(foot: float, top: float, low_r: float, high_r: float, finish: Finish) -> list[Part]:
    """A lampshade that is open below and above, and the bulb in it."""
    skin = lathe(
        [
            (low_r * 0.97, foot + 0.004),
            (low_r, foot),
            (high_r, top),
            (high_r * 0.96, top - 0.004),
            (low_r * 0.96, foot + 0.006),
        ],
        sides=16,
    )
    bulb = ball((0, foot + (top - foot) * 0.32, 0), (0.07, 0.1, 0.07), sides=6, rings=4)
    return [made_of(finish, skin), made_of(GLOW, bulb)]


def floor_lamp(order: Order) -> list[Part]:
    """A disc, a pole and a shade; low ones are table lamps."""
    w, h, d = order.size
    if h < 0.8:
        return table_lamp(order)
    stand, cover = _stand_and_shade(order)
    r = min(w, d) / 2
    shade_h = min(0.34, h * 0.24)
    foot = lathe([(r * 0.72, 0.0), (r * 0.72, 0.02), (0.03, 0.04)], sides=16)
    pole = cylinder((0, 0.02, 0), 0.014, h - shade_h * 0.7, sides=6)
    if order.rng.random() < 0.3 and not order.says("old", "antique"):
        feet = [
            tube([(0, h * 0.55, 0), (r * 0.9 * math.cos(a), 0.012, r * 0.9 * math.sin(a))], 0.016, sides=5)
            for a in (0.5, 2.6, 4.7)
        ]
        return [
            made_of(stand, *feet, cylinder((0, h * 0.54, 0), 0.016, h * 0.4 - shade_h * 0.4, sides=6)),
            *_shade(h - shade_h, h, r, r * 0.72, cover),
        ]
    return [made_of(stand, foot, pole), *_shade(h - shade_h, h, r, r * 0.66, cover)]


def table_lamp(order: Order) -> list[Part]:
    """A bellied foot under a shade."""
    w, h, d = order.size
    stand, cover = _stand_and_shade(order)
    r = min(w, d) / 2
    shade_h = h * 0.48
    low = h - shade_h
    profile = [
        (r * 0.5, 0.0),
        (r * 0.5, low * 0.06),
        (r * 0.3, low * 0.12),
        (r * 0.52, low * 0.45),
        (r * 0.42, low * 0.75),
        (r * 0.14, low * 0.92),
        (r * 0.1, h - shade_h * 0.5),
    ]
    return [made_of(stand, lathe(profile, sides=12)), *_shade(low, h, r, r * 0.6, cover)]


def ceiling_lamp(order: Order) -> list[Part]:
    """A cord and a wide shade, or arms with candles where it is a chandelier."""
    w, h, d = order.size
    r = min(w, d) / 2
    rose = cylinder((0, h - 0.03, 0), 0.06, 0.03, sides=10)
    if order.says("chandelier"):
        arms: list[Shape] = []
        bulbs: list[Shape] = []
        for k in range(6):
            a = k * math.pi / 3
            x, z = math.cos(a), math.sin(a)
            arms.append(
                tube(
                    [(0, h * 0.3, 0), (r * 0.5 * x, h * 0.1, r * 0.5 * z), (r * 0.85 * x, h * 0.28, r * 0.85 * z)],
                    0.012,
                    sides=5,
                )
            )
            bulbs.append(ball((r * 0.85 * x, h * 0.36, r * 0.85 * z), (0.06, 0.12, 0.06), sides=5, rings=3))
        rod = cylinder((0, h * 0.2, 0), 0.014, h * 0.8, sides=5)
        heart = ball((0, h * 0.26, 0), (0.11, 0.16, 0.11), sides=8)
        return [made_of(BRASS, rose, rod, heart, *arms), made_of(GLOW, *bulbs)]
    shade_h = min(0.26, h * 0.5)
    cord = cylinder((0, shade_h * 0.9, 0), 0.006, h - shade_h, sides=4)
    skin = lathe([(r, 0.0), (r * 0.9, shade_h * 0.45), (r * 0.3, shade_h * 0.9), (0.03, shade_h)], sides=16)
    bulb = ball((0, shade_h * 0.2, 0), (0.12, 0.13, 0.12), sides=8)
    return [made_of(BLACK_METAL, rose, cord), made_of(order.finish, skin), made_of(GLOW, bulb)]


def wall_lamp(order: Order) -> list[Part]:
    """A plate, a bent arm and a shade."""
    w, h, d = order.size
    r = min(w, d) * 0.42
    stand, cover = _stand_and_shade(order)
    plate = cylinder((0, 0, 0), 0.05, 0.016, sides=12).turned("x", math.pi / 2).moved(0, h * 0.4, -d / 2)
    arm = tube([(0, h * 0.4, -d / 2), (0, h * 0.24, -d * 0.1), (0, h * 0.3, d / 2 - r), (0, h * 0.5, d / 2 - r)], 0.011)
    hood = _shade(h * 0.44, h, r, r * 0.62, cover)
    return [made_of(stand, plate, arm), *(Part(part.shape.moved(z=d / 2 - r), part.finish) for part in hood)]


BUILDERS: dict[str, Builder] = {
    "lamp": floor_lamp, "table lamp": table_lamp, "ceiling lamp": ceiling_lamp, "wall lamp": wall_lamp,
}  # fmt: skip
