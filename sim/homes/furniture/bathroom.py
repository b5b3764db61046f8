"""Toilets, bathtubs, sinks, showers and their fittings."""

import math

from sim.homes.plan import Finish

from .joinery import tap
from .lofts import ball, circle, cylinder, lathe, plate, stack, tube
from .palette import BLACK, CERAMIC, PANE, PANE_SHEEN, STEEL, WHITE, plain, plastic
from .shapes import Draft, Shape, both, box, flat, merged, rounded_box

_TILES = Finish(material="tile", rgb=(206, 220, 226))


def toilet(piece: Draft, w: float, h: float, d: float) -> None:
    """A bowl with a seat, and the lid up against the tank."""
    white, seat, tank_d = piece.finish, min(0.43, h * 0.56), d * 0.26
    reach, tank_z = d - tank_d * 0.55, -d / 2 + tank_d / 2
    oval, z = circle(16, power=2.3), d / 2 - reach / 2
    bowl = [
        (0.0, 0.56, 0.66, -0.09), (seat * 0.3, 0.5, 0.6, -0.08), (seat * 0.62, 0.72, 0.8, -0.04),
        (seat * 0.92, 0.95, 0.96, 0.0), (seat - 0.02, 0.95, 0.96, 0.0),
    ]  # fmt: skip
    rim = [(-0.02, 0.97, 0.98), (0.01, 0.97, 0.98), (0.012, 0.66, 0.66), (-0.04, 0.6, 0.6), (-0.17, 0.3, 0.3)]
    levels = [(seat + y, a, b, 0.0) for y, a, b in (*rim, (-0.18, 0.02, 0.02))]
    piece.add(white, stack(oval, (w, reach), bowl).moved(z=z))
    piece.add(plain(white, 1.06), stack(oval, (w, reach), levels).moved(z=z))
    lid_h = min(h - seat - 0.02, reach * 0.78)
    lid = lathe([(w * 0.47, 0.0), (w * 0.47, 0.025)], sides=16, depth=lid_h / (w * 0.94), power=2.6, caps="both")
    lid = lid.turned("x", math.pi / 2 - 0.12).moved(0.0, seat + lid_h / 2, -d / 2 + tank_d + 0.06)
    piece.add(plain(white, 1.06), lid)
    tank = (w * 0.95, h - seat * 0.75 - 0.03, tank_d)
    piece.add(white, rounded_box((0.0, (seat * 0.75 + h) / 2, tank_z), tank, 0.03))
    piece.add(white, rounded_box((0.0, h - 0.025, tank_z), (w, 0.04, tank_d), 0.012))
    piece.add(STEEL, cylinder((0.0, h - 0.008, tank_z), 0.028, 0.008, sides=8))


def tub(piece: Draft, w: float, h: float, d: float) -> None:
    """A long hollow basin with a tap and water in it; on a step if it is the tray of a shower."""
    rim = min(0.07, w / 8, d / 8)
    a, b = (w - 2 * rim) / w, (d - 2 * rim) / d
    outline, top = circle(20, power=5.0), h - 0.1 if h > 0.3 else h
    levels = [
        (0.0, 0.9, 0.86, 0.0), (top - 0.06, 0.97, 0.95, 0.0), (top - 0.05, 1.0, 1.0, 0.0), (top, 1.0, 1.0, 0.0),
        (top, a, b, 0.0), (top * 0.5, a * 0.95, b * 0.92, 0.0), (top * 0.2, a * 0.84, b * 0.8, 0.0),
        (top * 0.18, 0.0, 0.0, 0.0),
    ]  # fmt: skip
    piece.add(piece.finish, stack(outline, (w, d), levels))
    piece.add(plastic(176, 212, 226), plate(outline, (w, d), (top * 0.55, a * 0.955, b * 0.93, 0.0)))
    z = -d / 2 + rim * 0.6
    tap(piece, (0.0, top, z), max(0.06, h - top), 0.12)
    piece.add(STEEL, both(ball((0.11, top + 0.03, z), (0.045, 0.05, 0.045), sides=6, rings=4)))


def sink(piece: Draft, w: float, h: float, d: float) -> None:
    """A wash basin on the wall with a tap and a drain trap; on a pedestal if it is high, of steel in kitchens."""
    finish, bowl, tap_h = piece.finish, min(0.17, h * 0.55), min(0.16, h * 0.4)
    top, z = h - tap_h, d * 0.06
    below = top - bowl
    levels = [
        (below, 0.45, 0.5, -0.04), (top - bowl * 0.5, 0.86, 0.86, -0.02), (top - 0.03, 1.0, 1.0, 0.0),
        (top, 1.0, 1.0, 0.0), (top, 0.86, 0.72, z), (top - bowl * 0.5, 0.74, 0.6, z),
        (top - bowl * 0.82, 0.4, 0.34, z), (top - bowl * 0.84, 0.0, 0.0, z),
    ]  # fmt: skip
    piece.add(finish, stack(circle(18, power=3.2), (w, d), levels))
    drain = cylinder((0.0, top - bowl * 0.84, z), 0.022, 0.008, sides=8)
    piece.add(BLACK if finish.material == "metal" else STEEL, drain)
    tap(piece, (0.0, top, -d * 0.4), tap_h, d * 0.3)
    if h > 0.6:
        pedestal = [(0.15, 0.0), (0.15, 0.02), (0.1, 0.08), (0.075, below * 0.5), (0.1, below * 0.95)]
        profile = [*pedestal, (0.13, below + 0.04)]
        piece.add(finish, lathe(profile, at=(0.0, 0.0, -d * 0.1), sides=12))
    elif below > 0.04:
        path = [(below + 0.02, 0.0), (0.03, 0.0), (0.03, -0.08), (below * 0.6, -0.09), (below * 0.6, -d / 2)]
        piece.add(STEEL, tube([(0.0, y, z) for y, z in path], 0.018))


def _shower_head(low: float, high: float) -> Shape:
    """A riser on the wall with a head that points down, a hose and a mixer."""
    riser = [(0.0, low, 0.03), (0.0, high - 0.06, 0.03), (0.0, high, 0.12), (0.0, high - 0.01, 0.3)]
    hose = [(0.0, low + 0.02, 0.05), (0.09, low - 0.18, 0.06), (0.13, low + 0.1, 0.06), (0.1, low + 0.35, 0.06)]
    mixer = tube([(-0.1, low, 0.05), (0.1, low, 0.05)], 0.024)
    head = cylinder((0.0, high - 0.075, 0.3), 0.12, 0.05, top=0.03, sides=12)
    return merged([tube(riser, 0.013), head, tube(hose, 0.008, sides=4), mixer])


def shower(piece: Draft, w: float, h: float, d: float) -> None:
    """A tray, tiled walls at the back and the left, a pane at the right, a half-open door, and a shower head inside."""
    tiles = piece.finish if piece.finish.material in ("tile", "stone", "ceramic") else _TILES
    bar, fixed, pane_h = 0.03, w * 0.3, h - 0.16
    x, z, pane_y = (w - bar) / 2, (d - bar) / 2, 0.1 + pane_h / 2
    edge = -w / 2 + bar + fixed
    piece.add(CERAMIC, rounded_box((0.0, 0.05, 0.0), (w, 0.1, d), 0.02))
    piece.add(tiles, box((0.0, h / 2 + 0.05, -d / 2 + 0.02), (w, h - 0.1, 0.04)))
    piece.add(tiles, box((-w / 2 + 0.02, h / 2 + 0.05, 0.0), (0.04, h - 0.1, d)))
    piece.add(STEEL, *(box((s * x, h / 2, t * z), (bar, h, bar)) for s, t in ((1, 1), (-1, 1), (1, -1))))
    piece.add(STEEL, box((0.0, h - bar / 2, z), (w, bar, bar)), box((x, h - bar / 2, 0.0), (bar, bar, d)))
    piece.add(STEEL, cylinder((0.0, 0.1, 0.0), 0.05, 0.006, sides=8))
    piece.add(STEEL, box((edge, h / 2, z), (0.02, h - 0.1, 0.024)))
    piece.add(STEEL, tube([(edge + 0.02, h * 0.45, d / 2 - 0.004), (edge + 0.02, h * 0.6, d / 2 - 0.004)], 0.01))
    piece.add(STEEL, _shower_head(h * 0.58 - 0.12, h - 0.12).moved(-w * 0.08, 0.0, -d / 2 + 0.04))
    piece.add(PANE, box((x, pane_y, 0.0), (0.008, pane_h, d - 0.08)))
    piece.add(PANE, box((edge - fixed / 2, pane_y, z), (fixed, pane_h, 0.008)))
    for left in (edge - fixed * 0.88, edge - fixed * 0.58):
        piece.add(PANE_SHEEN, streak(left, (h * 0.3, h * 0.8), (fixed * 0.16, fixed * 0.24), d / 2 - 0.008))


def streak(left: float, heights: tuple[float, float], extent: tuple[float, float], z: float) -> Shape:
    """A slanting band of light on glass, as in cartoons, from x = `left`; `extent` is its width and its slant."""
    (low, high), (wide, lean) = heights, extent
    points = [(left, low), (left + wide, low), (left + wide + lean, high), (left + lean, high)]
    return flat(points, z)


def glass_pane(piece: Draft, w: float, h: float, d: float) -> None:
    """A shower's pane in a metal frame, with streaks of light and a handle."""
    bar, z = 0.03, d * 0.3
    piece.add(STEEL, both(box(((w - bar) / 2, h / 2, 0.0), (bar, h, d))))
    piece.add(STEEL, *(box((0.0, y, 0.0), (w, bar, d)) for y in (bar / 2, h - bar / 2)))
    piece.add(PANE, box((0.0, h / 2, 0.0), (w - bar, h - bar, min(0.01, d / 3))))
    for x in (-0.38, -0.26, 0.06):
        piece.add(PANE_SHEEN, streak(x * w, (h * 0.2, h * 0.85), (0.05 * w, 0.3 * w), z))
    for x, y in ((-0.3, 0.7), (0.2, 0.3), (0.33, 0.75), (0.1, 0.85), (-0.2, 0.35)):
        piece.add(PANE_SHEEN, ball((x * w, y * h, z), (0.03, 0.045, 0.01), sides=4, rings=2))
    piece.add(STEEL, tube([(w * 0.36, h * 0.42, d / 2 - 0.012), (w * 0.36, h * 0.56, d / 2 - 0.012)], 0.012))


def shower_fitting(piece: Draft, w: float, h: float, d: float) -> None:
    """A riser with a hand shower, or a wire shelf with bottles and soap."""
    if piece.says("soap", "shelf", "tray"):
        _soap_shelf(piece, w, h, d)
        return
    z, face = -d / 2 + 0.04, min(0.11, w * 0.42)
    piece.add(STEEL, tube([(0.0, 0.05, z), (0.0, h - 0.03, z)], 0.013))
    piece.add(STEEL, *(box((0.0, y, -d / 2 + 0.02), (0.04, 0.04, 0.04)) for y in (0.06, h - 0.05)))
    head = cylinder((0.0, 0.0, 0.0), face, 0.04, top=face * 0.5, sides=14).turned("x", -0.75)
    piece.add(STEEL, head.moved(0.0, h * 0.84, d * 0.1))
    piece.add(STEEL, tube([(0.0, h * 0.86, d * 0.2), (0.0, h * 0.7, -d * 0.1)], 0.014))
    hose = [(0.0, h * 0.7, -d * 0.1), (w * 0.34, h * 0.35, 0.0), (w * 0.3, h * 0.06, 0.0), (w * 0.04, h * 0.1, z)]
    piece.add(STEEL, tube(hose, 0.009, sides=5))


def _soap_shelf(piece: Draft, w: float, h: float, d: float) -> None:
    x, tall, r = w / 2 - 0.01, h - 0.04, min(d * 0.28, w * 0.13)
    for y, z in ((0.02, d * 0.4), (0.08, d * 0.4), (0.02, -d * 0.4), (0.02, 0.0)):
        piece.add(STEEL, tube([(-x, y, z), (x, y, z)], 0.006, sides=4))
    end = [(x, 0.08, d * 0.42), (x, 0.02, d * 0.42), (x, 0.02, -d * 0.45), (x, h * 0.5, -d * 0.45)]
    piece.add(STEEL, both(tube(end, 0.006, sides=4)))
    profile = [(1.0, 0.0), (1.0, 0.7), (0.4, 0.78), (0.4, 1.0)]
    for tone, share, at in ((plastic(80, 150, 190), 1.0, -0.3), (plastic(230, 120, 150), 0.85, -0.03)):
        piece.add(tone, lathe(profile, scale=(r, tall * share), at=(at * w, 0.03, 0.0), sides=8, caps="end"))
    piece.add(plastic(246, 226, 190), rounded_box((w * 0.3, 0.05, 0.0), (w * 0.24, 0.04, d * 0.55), 0.016))


def dial(piece: Draft, w: float, h: float, d: float) -> None:
    """A mixer on the wall: a plate, a round knob with a lever, and marks for hot and cold."""
    piece.add(WHITE, cylinder((0, h / 2, -d / 2), w * 0.48, d * 0.2, sides=18, axis="z"))
    piece.add(STEEL, cylinder((0, h / 2, -d * 0.3), w * 0.24, d * 0.5, top=w * 0.2, sides=12, axis="z"))
    piece.add(STEEL, tube([(0, h / 2, d * 0.25), (0, h * 0.12, d * 0.42)], 0.014))
    for x, tone in ((-w * 0.36, plastic(210, 50, 40)), (w * 0.36, plastic(50, 90, 200))):
        piece.add(tone, box((x, h / 2, -d * 0.29), (0.024, 0.024, 0.004)))
