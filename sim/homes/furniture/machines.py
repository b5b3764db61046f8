"""Large things of their own kind: piano, bicycle, exercise machines, guitar, fire extinguisher."""

import math

import numpy as np

from .lofts import ball, cylinder, lathe, loft, ring, tube
from .palette import BLACK, BRASS, DARK_METAL, DARK_WOOD, LIT_SCREEN, PAPER, RED, STEEL, WHITE, is_dark, plastic
from .shapes import Draft, both, box, rounded_box, slab


def piano(piece: Draft, w: float, h: float, d: float) -> None:
    """An upright piano: case, white and black keys, sheet music on a stand, legs and pedals."""
    finish, keys_y, keys_d = piece.finish, min(0.72, h * 0.66), d * 0.42
    back_d = d - keys_d
    front, zk, back = -d / 2 + back_d, d / 2 - keys_d / 2, -d / 2 + back_d / 2
    piece.add(finish, rounded_box((0, h / 2, back), (w, h, back_d), 0.01))
    piece.add(finish, both(box((w / 2 - 0.03, keys_y / 2 + 0.06, zk), (0.06, keys_y + 0.1, keys_d))))
    piece.add(finish, box((0, keys_y - 0.06, zk), (w - 0.1, 0.1, keys_d - 0.01)))
    piece.add(finish, box((0, 0.03, zk), (w - 0.12, 0.06, keys_d * 0.7)))
    num = 21
    key, z = (w - 0.16) / num, d / 2 - 0.02 - keys_d * 0.36
    for k in range(num):
        at = ((k + 0.5 - num / 2) * key, keys_y + 0.004, z)
        piece.add(WHITE, slab(at, (key - 0.006, 0.024, keys_d * 0.66), faces="+y+z+x"))
        if k < num - 1 and k % 7 not in (2, 6):
            at = ((k + 1 - num / 2) * key, keys_y + 0.024, z - keys_d * 0.1)
            piece.add(BLACK, slab(at, (key * 0.52, 0.022, keys_d * 0.4), faces="+y+z+x-x"))
    stand = box((0, 0, 0), (w * 0.46, 0.22, 0.012)).turned("x", -0.16)
    notes = both(slab((0.1, 0, 0.008), (0.18, 0.2, 0.004), faces="+z")).turned("x", -0.16)
    piece.add(finish, stand.moved(0, keys_y + 0.2, front + 0.045))
    piece.add(PAPER, notes.moved(0, keys_y + 0.2, front + 0.05))
    piece.add(BRASS, *(box((x, 0.075, front + 0.04), (0.03, 0.014, 0.1)) for x in (-0.07, 0.0, 0.07)))


def bicycle(piece: Draft, w: float, h: float, d: float) -> None:
    """Two wheels, a diamond frame, saddle, handlebar, chain wheel and pedals; its length is along x."""
    r = min(h * 0.34, w * 0.2)
    left, right, axle = -w / 2 + r + 0.025, w / 2 - r - 0.025, r + 0.022
    for x in (left, right):
        piece.add(BLACK, ring((x, axle, 0), r, 0.02, sides=20, around=5))
        for k in range(6):
            a, b = r * math.cos(k * math.pi / 6), r * math.sin(k * math.pi / 6)
            piece.add(STEEL, tube([(x - a, axle - b, 0), (x + a, axle + b, 0)], 0.004, sides=3))
    cx, cy, hx = left + (right - left) * 0.4, axle * 0.9, right - w * 0.1
    crank, seat_joint = (cx, cy, 0.0), (cx - w * 0.065, h * 0.64, 0.0)
    saddle, head, low_head = (cx - w * 0.09, h * 0.82, 0.0), (hx, h * 0.84, 0.0), (right - w * 0.075, h * 0.66, 0.0)
    rear, fork = (left, axle, 0.03), (right, axle, 0.03)
    for start, end, thick in (
        (crank, seat_joint, 0.019), (seat_joint, (hx + 0.01, h * 0.74, 0), 0.019), (crank, low_head, 0.021),
        (rear, crank, 0.012), (rear, seat_joint, 0.011), (head, low_head, 0.02), (low_head, fork, 0.014),
    ):  # fmt: skip
        piece.add(piece.finish, tube([start, end], thick))
    reach, top = min(d / 2, 0.28), h * 0.94
    half = [(hx + 0.02, h * 0.95, reach * 0.4), (hx - 0.04, h * 0.97, reach)]
    bar = [*((x, y, -z) for x, y, z in reversed(half)), (hx, top, 0.0), *half]
    piece.add(STEEL, tube(bar, 0.013), tube([head, (hx, top, 0)], 0.014), tube([seat_joint, saddle], 0.014))
    piece.add(BLACK, both(tube([(hx - 0.04, h * 0.97, reach), (hx - 0.02, h * 0.965, reach * 0.72)], 0.019), axis="z"))
    piece.add(BLACK, ball((saddle[0] + 0.02, saddle[1] + 0.02, 0), (0.27, 0.07, 0.15), sides=8, rings=4))
    piece.add(STEEL, cylinder((cx, cy, 0.02), 0.09, 0.012, sides=12, axis="z"))
    for s in (1, -1):
        piece.add(STEEL, tube([(cx, cy, s * 0.04), (cx + s * 0.15, cy - s * 0.04, s * 0.05)], 0.009, sides=4))
        piece.add(BLACK, box((cx + s * 0.15, cy - s * 0.04, s * 0.09), (0.09, 0.02, 0.07)))


def exercise_bike(piece: Draft, w: float, h: float, d: float) -> None:
    """A flywheel in a case, a saddle, handles with a display, and pedals, on two cross bars; it faces +z."""
    accent = plastic(190, 60, 50) if is_dark(piece.finish) else piece.finish
    end, back, wheel_y, wheel_z, r = d * 0.42, -d * 0.3, h * 0.3, d * 0.2, min(h * 0.22, d * 0.28)
    crank_y, crank_z, far = h * 0.26, -d * 0.04, w / 2 - 0.03
    piece.add(DARK_METAL, both(tube([(-far, 0.035, end), (far, 0.035, end)], 0.034), axis="z"))
    piece.add(DARK_METAL, tube([(0, 0.05, -end), (0, 0.12, 0.0), (0, 0.05, end)], 0.03))
    piece.add(DARK_METAL, tube([(0, 0.1, -d * 0.12), (0, h * 0.68, back)], 0.026))
    piece.add(DARK_METAL, tube([(0, 0.12, d * 0.2), (0, h * 0.86, d * 0.3)], 0.028))
    piece.add(STEEL, cylinder((-0.035, wheel_y, wheel_z), r, 0.07, sides=20, axis="x"))
    piece.add(accent, cylinder((-0.045, wheel_y, wheel_z), r * 0.62, 0.09, sides=16, axis="x"))
    piece.add(BLACK, ball((0, h * 0.7, back), (0.24, 0.08, 0.28), sides=8, rings=4))
    x = w * 0.4
    half = [(x * 0.9, h * 0.84, d * 0.28), (x, h * 0.9, d * 0.08)]
    grips = [*((-a, y, z) for a, y, z in reversed(half)), (0.0, h * 0.82, d * 0.32), *half]
    piece.add(BLACK, tube(grips, 0.018))
    panel, screen = rounded_box((0, 0, 0), (0.2, 0.14, 0.04), 0.015), box((0, 0, -0.022), (0.14, 0.08, 0.006))
    for tone, shape in ((BLACK, panel), (LIT_SCREEN, screen)):
        piece.add(tone, shape.turned("x", 0.6).moved(0, h * 0.93, d * 0.3))
    piece.add(BLACK, cylinder((-0.06, crank_y, crank_z), 0.09, 0.12, sides=12, axis="x"))
    for s in (-1, 1):
        y, z = crank_y + s * 0.1, crank_z + s * 0.1
        piece.add(STEEL, tube([(s * 0.06, crank_y, crank_z), (s * 0.1, y, z)], 0.012, sides=5))
        piece.add(BLACK, box((s * 0.15, y, z), (0.1, 0.025, 0.1)))


def treadmill(piece: Draft, w: float, h: float, d: float) -> None:
    """A belt between side rails, and two posts with a display at its -z end; the user steps on at the other end."""
    x = w * 0.45
    piece.add(DARK_METAL, rounded_box((0, 0.09, 0), (w * 0.9, 0.12, d), 0.03))
    piece.add(BLACK, slab((0, 0.153, d * 0.05), (w * 0.6, 0.008, d * 0.84), faces="+y"))
    piece.add(STEEL, both(box((w * 0.38, 0.16, 0.04), (w * 0.12, 0.02, d * 0.9))))
    piece.add(DARK_METAL, both(tube([(x, 0.1, -d * 0.34), (x, h * 0.86, -d * 0.44)], 0.03)))
    piece.add(DARK_METAL, both(tube([(x, h * 0.74, -d * 0.43), (x, h * 0.74, -d * 0.12)], 0.024)))
    panel = rounded_box((0, 0, 0), (w * 0.96, 0.22, 0.06), 0.02)
    for tone, shape in ((BLACK, panel), (LIT_SCREEN, slab((0, 0, 0.034), (w * 0.4, 0.13, 0.004), faces="+z"))):
        piece.add(tone, shape.turned("x", -0.5).moved(0, h * 0.88, -d * 0.42))


def guitar(piece: Draft, w: float, h: float, d: float) -> None:
    """A waisted body with a hole, a neck with strings, a head; it leans upright."""
    body, front = h * 0.46, d * 0.375
    half = [
        (0.0, 0.0), (0.62, 0.03), (0.94, 0.16), (1.0, 0.28), (0.84, 0.44), (0.62, 0.54), (0.64, 0.68), (0.76, 0.8),
        (0.66, 0.93), (0.3, 1.0),
    ]  # fmt: skip
    outline = [(x * w / 2, y * body) for x, y in (*half, *((-x, y) for x, y in reversed(half[1:])))]
    rings = [[(x, y, z) for x, y in outline] for z in (-front, front)]
    piece.add(piece.finish, loft(np.array([*rings, [(0.0, y, front) for _, y in outline]])))
    piece.add(BLACK, cylinder((0, body * 0.62, front), w * 0.15, 0.006, sides=12, axis="z"))
    low, high = body * 0.75, h * 0.9
    piece.add(DARK_WOOD, box((0, (low + high) / 2, front + 0.004), (0.05, high - low, 0.022)))
    piece.add(DARK_WOOD, box((0, h * 0.94, front - 0.006), (0.075, h * 0.12, 0.02)))
    piece.add(DARK_WOOD, box((0, body * 0.3, front + 0.006), (w * 0.34, 0.022, 0.012)))
    low, high = body * 0.3, h * 0.92
    string = (0.003, high - low, 0.002)
    piece.add(STEEL, both(*(slab((x, (low + high) / 2, front + 0.018), string, faces="+z") for x in (0.005, 0.015))))
    pegs = [ball((0.046, h * y, front - 0.006), (0.024, 0.02, 0.016), sides=5, rings=2) for y in (0.9, 0.94, 0.98)]
    piece.add(STEEL, both(*pegs))


def fire_extinguisher(piece: Draft, w: float, h: float, d: float) -> None:
    """A red bottle with a lever, a gauge and a hose."""
    red = piece.finish if piece.finish.rgb[0] > 120 and piece.finish.rgb[1] < 110 else RED
    r, top = min(w, d) * 0.4, h * 0.76
    bottle = [(0.9, 0.0), (1.0, 0.03 / top), (1.0, 0.84), (0.7, 0.95), (0.3, 1.0), (0.3, 1.0 + 0.03 / top)]
    piece.add(red, lathe(bottle, scale=(r, top), sides=14, caps="start"))
    piece.add(PAPER, lathe([(1.01, 0.35), (1.01, 0.62)], scale=(r, top), sides=14))
    piece.add(BLACK, box((0, top + 0.05, 0), (0.035, 0.05, 0.04)), box((w * 0.12, h * 0.93, 0), (w * 0.5, 0.016, 0.03)))
    piece.add(BLACK, tube([(0, top + 0.06, 0), (w * 0.34, top + 0.03, 0)], 0.009, sides=4))
    z = 0.03
    hose = [(-0.02, top + 0.05, 0.0), (-w * 0.4, top, 0.02), (-w * 0.46, top * 0.6, z), (-w * 0.42, top * 0.28, z)]
    piece.add(BLACK, tube(hose, 0.013))
    piece.add(BLACK, tube([(-w * 0.42, top * 0.3, z), (-w * 0.4, top * 0.1, z)], [0.014, 0.028]))
    piece.add(WHITE, cylinder((0, top + 0.045, 0.02), 0.022, 0.016, sides=8, axis="z"))
