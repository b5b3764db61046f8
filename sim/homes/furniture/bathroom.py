"""Toilets, bathtubs, sinks, showers and their fittings."""

import math

import numpy as np

from sim.homes.plan import Finish

from .joinery import tap
from .lofts import ball, circle, cylinder, lathe, loft, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, CERAMIC, PANE, PANE_SHEEN, STEEL, WHITE, plain
from .shapes import Shape, box, facets, rounded_box


def toilet(order: Order) -> list[Part]:
    """A bowl with its seat, the lid up against the tank."""
    w, h, d = order.size
    white = order.finish
    seat = min(0.43, h * 0.56)
    tank_d = d * 0.26
    reach = d - tank_d * 0.55
    middle = d / 2 - reach / 2
    oval = circle(16, power=2.3)

    def oval_ring(share_w: float, share_d: float, y: float, back: float = 0.0) -> np.ndarray:
        return np.stack(
            [oval[:, 0] * w / 2 * share_w, np.full(16, y), oval[:, 1] * reach / 2 * share_d + middle - back], axis=1
        )

    bowl = loft(
        [
            oval_ring(0.56, 0.66, 0.0, 0.09),
            oval_ring(0.5, 0.6, seat * 0.3, 0.08),
            oval_ring(0.72, 0.8, seat * 0.62, 0.04),
            oval_ring(0.95, 0.96, seat * 0.92),
            oval_ring(0.95, 0.96, seat - 0.02),
        ]
    )
    rim = loft(
        [
            oval_ring(0.97, 0.98, seat - 0.02),
            oval_ring(0.97, 0.98, seat + 0.01),
            oval_ring(0.66, 0.66, seat + 0.012),
            oval_ring(0.6, 0.6, seat - 0.04),
            oval_ring(0.3, 0.3, seat - 0.17),
            oval_ring(0.02, 0.02, seat - 0.18),
        ]
    )
    lid_h = min(h - seat - 0.02, reach * 0.78)
    lid = lathe([(w * 0.47, 0.0), (w * 0.47, 0.025)], sides=16, depth=lid_h / (w * 0.94), power=2.6, caps="both")
    lid = lid.turned("x", math.pi / 2 - 0.12).moved(0.0, seat + lid_h / 2, -d / 2 + tank_d + 0.06)
    tank = rounded_box(
        (0.0, (seat * 0.75 + h) / 2, -d / 2 + tank_d / 2), (w * 0.95, h - seat * 0.75 - 0.03, tank_d), 0.03
    )
    cap = rounded_box((0.0, h - 0.025, -d / 2 + tank_d / 2), (w, 0.04, tank_d), 0.012)
    button = cylinder((0.0, h - 0.008, -d / 2 + tank_d / 2), 0.028, 0.008, sides=8)
    return [made_of(white, bowl, tank, cap), made_of(plain(white, 1.06), rim, lid), made_of(STEEL, button)]


def tub(order: Order) -> list[Part]:
    """A long basin, hollow, with a tap and water in it; on a step where it is a shower's tray."""
    w, h, d = order.size
    white, rim = order.finish, min(0.07, w / 8, d / 8)
    inner = (w - 2 * rim) / w
    inner_d = (d - 2 * rim) / d
    ring_points = circle(20, power=5.0)

    def ring_at(share_w: float, share_d: float, y: float) -> np.ndarray:
        return np.stack(
            [ring_points[:, 0] * w / 2 * share_w, np.full(20, y), ring_points[:, 1] * d / 2 * share_d], axis=1
        )

    top = h - 0.1 if h > 0.3 else h
    skin = loft(
        [
            ring_at(0.9, 0.86, 0.0),
            ring_at(0.97, 0.95, top - 0.06),
            ring_at(1.0, 1.0, top - 0.05),
            ring_at(1.0, 1.0, top),
            ring_at(inner, inner_d, top),
            ring_at(inner * 0.95, inner_d * 0.92, top * 0.5),
            ring_at(inner * 0.84, inner_d * 0.8, top * 0.2),
            ring_at(0.0, 0.0, top * 0.18),
        ]
    )
    level = top * 0.55
    water = facets([ring_at(inner * 0.955, inner_d * 0.93, level)[[0, k, k + 1, k + 2]] for k in range(1, 18, 2)])
    z = -d / 2 + rim * 0.6
    faucet = [tap((0.0, top, z), max(0.06, h - top), 0.12)]
    knobs = made_of(STEEL, *(ball((s * 0.11, top + 0.03, z), (0.045, 0.05, 0.045), sides=6, rings=4) for s in (-1, 1)))
    tint = Finish(material="plastic", rgb=(176, 212, 226))
    return [made_of(white, skin), made_of(tint, water), *faucet, knobs]


def sink(order: Order) -> list[Part]:
    """A wash basin on the wall with a tap and a siphon; high ones stand on a pedestal; steel in kitchens."""
    w, h, d = order.size
    finish = order.finish
    is_steel = finish.material == "metal"
    bowl_h = min(0.17, h * 0.55)
    tap_h = min(0.16, h * 0.4)
    top = h - tap_h
    shell = circle(18, power=3.2)

    def ring_at(share: float, y: float, back: float = 0.0, share_d: float | None = None) -> np.ndarray:
        z = shell[:, 1] * d / 2 * (share if share_d is None else share_d) - back
        return np.stack([shell[:, 0] * w / 2 * share, np.full(18, y), z], axis=1)

    front = -d * 0.06
    skin = loft(
        [
            ring_at(0.45, top - bowl_h, 0.04, 0.5),
            ring_at(0.86, top - bowl_h * 0.5, 0.02),
            ring_at(1.0, top - 0.03),
            ring_at(1.0, top),
            ring_at(0.86, top, front, 0.72),
            ring_at(0.74, top - bowl_h * 0.5, front, 0.6),
            ring_at(0.4, top - bowl_h * 0.82, front, 0.34),
            ring_at(0.0, top - bowl_h * 0.84, front),
        ]
    )
    drain = cylinder((0.0, top - bowl_h * 0.84, -front), 0.022, 0.008, sides=8)
    parts = [
        made_of(finish, skin),
        made_of(BLACK if is_steel else STEEL, drain),
        tap((0.0, top, -d * 0.4), tap_h, d * 0.3),
    ]
    below = top - bowl_h
    if h > 0.6:
        profile = [
            (0.15, 0.0),
            (0.15, 0.02),
            (0.1, 0.08),
            (0.075, below * 0.5),
            (0.1, below * 0.95),
            (0.13, below + 0.04),
        ]
        return [*parts, made_of(finish, lathe(profile, at=(0.0, 0.0, -d * 0.1), sides=12))]
    if below > 0.04:
        pipe = tube(
            [
                (0.0, below + 0.02, 0.0),
                (0.0, 0.03, 0.0),
                (0.0, 0.03, -0.08),
                (0.0, below * 0.6, -0.09),
                (0.0, below * 0.6, -d / 2),
            ],
            0.018,
        )
        parts.append(made_of(STEEL, pipe))
    return parts


def _shower_head(x: float, y: float, z: float, drop: float) -> list[Shape]:
    """A riser on the wall with a head that looks down, a hose and a mixer."""
    low = y - drop
    head_z = z + 0.3
    head = [
        tube([(x, low, z + 0.03), (x, y - 0.06, z + 0.03), (x, y, z + 0.12), (x, y - 0.01, head_z)], 0.013),
        cylinder((x, y - 0.075, head_z), 0.12, 0.05, top=0.03, sides=12),
    ]
    hose = tube(
        [
            (x, low + 0.02, z + 0.05),
            (x + 0.09, low - 0.18, z + 0.06),
            (x + 0.13, low + 0.1, z + 0.06),
            (x + 0.1, low + 0.35, z + 0.06),
        ],
        0.008,
        sides=4,
    )
    mixer = tube([(x - 0.1, low, z + 0.05), (x + 0.1, low, z + 0.05)], 0.024)
    return [*head, hose, mixer]


def shower(order: Order) -> list[Part]:
    """A tray, tiled walls at the back and the left, a pane at the right, a half-open door, a shower head within."""
    w, h, d = order.size
    tiles = (
        order.finish
        if order.finish.material in ("tile", "stone", "ceramic")
        else Finish(material="tile", rgb=(206, 220, 226))
    )
    tray = rounded_box((0.0, 0.05, 0.0), (w, 0.1, d), 0.02)
    drain = cylinder((0.0, 0.1, 0.0), 0.05, 0.006, sides=8)
    walls = [
        box((0.0, h / 2 + 0.05, -d / 2 + 0.02), (w, h - 0.1, 0.04)),
        box((-w / 2 + 0.02, h / 2 + 0.05, 0.0), (0.04, h - 0.1, d)),
    ]
    bar = 0.03
    posts = [
        box((x, h / 2, z), (bar, h, bar))
        for x, z in (
            (w / 2 - bar / 2, d / 2 - bar / 2),
            (-w / 2 + bar / 2, d / 2 - bar / 2),
            (w / 2 - bar / 2, -d / 2 + bar / 2),
        )
    ]
    rails = [
        box((0.0, h - bar / 2, d / 2 - bar / 2), (w, bar, bar)),
        box((w / 2 - bar / 2, h - bar / 2, 0.0), (bar, bar, d)),
    ]
    pane_h = h - 0.16
    side = box((w / 2 - bar / 2, 0.1 + pane_h / 2, 0.0), (0.008, pane_h, d - 0.08))
    fixed = w * 0.3
    front = box((-w / 2 + bar + fixed / 2, 0.1 + pane_h / 2, d / 2 - bar / 2), (fixed, pane_h, 0.008))
    edge = box((-w / 2 + bar + fixed, h / 2, d / 2 - bar / 2), (0.02, h - 0.1, 0.024))
    grip = tube(
        [(-w / 2 + bar + fixed + 0.02, h * 0.45, d / 2 - 0.004), (-w / 2 + bar + fixed + 0.02, h * 0.6, d / 2 - 0.004)],
        0.01,
    )
    sheen = [
        facets(
            [
                [
                    (-w / 2 + bar + fixed * a, h * 0.3, d / 2 - 0.008),
                    (-w / 2 + bar + fixed * (a + 0.16), h * 0.3, d / 2 - 0.008),
                    (-w / 2 + bar + fixed * (a + 0.4), h * 0.8, d / 2 - 0.008),
                    (-w / 2 + bar + fixed * (a + 0.24), h * 0.8, d / 2 - 0.008),
                ]
            ]
        )
        for a in (0.12, 0.42)
    ]
    return [
        made_of(CERAMIC, tray),
        made_of(tiles, *walls),
        made_of(STEEL, drain, *posts, *rails, edge, grip, *_shower_head(-w * 0.08, h - 0.12, -d / 2 + 0.04, h * 0.42)),
        made_of(PANE, side, front),
        made_of(PANE_SHEEN, *sheen),
    ]


def glass_pane(order: Order) -> list[Part]:
    """A shower's pane in a metal frame, with streaks of light and a handle."""
    w, h, d = order.size
    bar = 0.03
    frame = [box((s * (w - bar) / 2, h / 2, 0.0), (bar, h, d)) for s in (-1, 1)]
    frame += [box((0.0, y, 0.0), (w, bar, d)) for y in (bar / 2, h - bar / 2)]
    pane = box((0.0, h / 2, 0.0), (w - bar, h - bar, min(0.01, d / 3)))
    z = d * 0.3
    streaks = [
        facets(
            [
                [
                    (x * w, h * 0.2, z),
                    (x * w + 0.05 * w, h * 0.2, z),
                    (x * w + 0.35 * w, h * 0.85, z),
                    (x * w + 0.3 * w, h * 0.85, z),
                ]
            ]
        )
        for x in (-0.38, -0.26, 0.06)
    ]
    drops = [
        ball((x * w, y * h, z), (0.03, 0.045, 0.01), sides=4, rings=2)
        for x, y in ((-0.3, 0.7), (0.2, 0.3), (0.33, 0.75), (0.1, 0.85), (-0.2, 0.35))
    ]
    grip = tube([(w * 0.36, h * 0.42, d / 2 - 0.012), (w * 0.36, h * 0.56, d / 2 - 0.012)], 0.012)
    return [made_of(STEEL, *frame, grip), made_of(PANE, pane), made_of(PANE_SHEEN, *streaks, *drops)]


def shower_fitting(order: Order) -> list[Part]:
    """A riser with a hand shower, or a wire shelf with bottles and soap."""
    w, h, d = order.size
    if order.says("soap", "shelf", "tray"):
        wires = [
            tube([(-w / 2 + 0.01, y, z), (w / 2 - 0.01, y, z)], 0.006, sides=4)
            for y, z in ((0.02, d * 0.4), (0.08, d * 0.4), (0.02, -d * 0.4), (0.02, 0.0))
        ]
        ends = [
            tube(
                [
                    (s * (w / 2 - 0.01), 0.08, d * 0.42),
                    (s * (w / 2 - 0.01), 0.02, d * 0.42),
                    (s * (w / 2 - 0.01), 0.02, -d * 0.45),
                    (s * (w / 2 - 0.01), h * 0.5, -d * 0.45),
                ],
                0.006,
                sides=4,
            )
            for s in (-1, 1)
        ]
        tall = h - 0.04
        bottles = []
        for k, (tone, share) in enumerate((((80, 150, 190), 1.0), ((230, 120, 150), 0.85))):
            r = min(d * 0.28, w * 0.13)
            profile = [(r, 0.0), (r, tall * share * 0.7), (r * 0.4, tall * share * 0.78), (r * 0.4, tall * share)]
            bottles.append(
                made_of(
                    Finish(material="plastic", rgb=tone),
                    lathe(profile, at=(-w * 0.3 + k * w * 0.27, 0.03, 0.0), sides=8, caps="end"),
                )
            )
        soap = made_of(
            Finish(material="plastic", rgb=(246, 226, 190)),
            rounded_box((w * 0.3, 0.05, 0.0), (w * 0.24, 0.04, d * 0.55), 0.016),
        )
        return [made_of(STEEL, *wires, *ends), *bottles, soap]
    z = -d / 2 + 0.04
    bar = tube([(0.0, 0.05, z), (0.0, h - 0.03, z)], 0.013)
    holders = [box((0.0, y, -d / 2 + 0.02), (0.04, 0.04, 0.04)) for y in (0.06, h - 0.05)]
    face = min(0.11, w * 0.42)
    head = (
        cylinder((0.0, 0.0, 0.0), face, 0.04, top=face * 0.5, sides=14).turned("x", -0.75).moved(0.0, h * 0.84, d * 0.1)
    )
    handle = tube([(0.0, h * 0.86, d * 0.2), (0.0, h * 0.7, -d * 0.1)], 0.014)
    hose = tube(
        [(0.0, h * 0.7, -d * 0.1), (w * 0.34, h * 0.35, 0.0), (w * 0.3, h * 0.06, 0.0), (w * 0.04, h * 0.1, z)],
        0.009,
        sides=5,
    )
    return [made_of(STEEL, bar, *holders, head, handle, hose)]


def dial(order: Order) -> list[Part]:
    """A mixer on the wall: a plate, a round knob with a lever, marks for hot and cold."""
    w, h, d = order.size
    plate = cylinder((0, 0, 0), w * 0.48, d * 0.2, sides=18).turned("x", math.pi / 2).moved(0, h / 2, -d / 2)
    turn = (
        cylinder((0, 0, 0), w * 0.24, d * 0.5, top=w * 0.2, sides=12).turned("x", math.pi / 2).moved(0, h / 2, -d * 0.3)
    )
    lever = tube([(0, h / 2, d * 0.25), (0, h * 0.12, d * 0.42)], 0.014)
    z = -d * 0.29
    hot = box((-w * 0.36, h / 2, z), (0.024, 0.024, 0.004))
    cold = box((w * 0.36, h / 2, z), (0.024, 0.024, 0.004))
    return [
        made_of(STEEL, turn, lever),
        made_of(WHITE, plate),
        made_of(Finish(material="plastic", rgb=(210, 50, 40)), hot),
        made_of(Finish(material="plastic", rgb=(50, 90, 200)), cold),
    ]


BUILDERS: dict[str, Builder] = {
    "toilet": toilet, "tub": tub, "sink": sink, "shower": shower, "glass pane": glass_pane,
    "shower fitting": shower_fitting, "dial": dial,
}  # fmt: skip
