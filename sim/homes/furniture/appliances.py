"""Refrigerators, ovens, washing machines and other machines of kitchen and bath."""

import math

from sim.homes.plan import Finish

from .joinery import bar_handle, spread
from .lofts import SQUARE, ball, cylinder, lathe, ring, stack, tube
from .palette import (
    BLACK,
    BLACK_METAL,
    DARK_GLASS,
    DARK_METAL,
    LIT_SCREEN,
    SHEEN,
    STEEL,
    WHITE,
    is_dark,
    plain,
    plastic,
)
from .shapes import Draft, Shape, both, box, four, merged, rounded_box, slab

_HANDLE = Finish(material="metal", rgb=(150, 154, 160))
_COPPER = Finish(material="metal", rgb=(184, 108, 66))


def refrigerator(piece: Draft, w: float, h: float, d: float) -> None:
    """Two doors with long handles, stacked, or side by side with a water dispenser; low freezers have a lid."""
    finish, bar = piece.finish, STEEL if is_dark(piece.finish) else _HANDLE
    z, front = d / 2 - 0.045, d / 2 - 0.004
    piece.add(plain(finish, 0.72), box((0, h / 2, -0.03), (w - 0.01, h - 0.01, d - 0.06)))
    piece.add(BLACK, box((0, 0.025, d / 2 - 0.05), (w - 0.06, 0.05, 0.05)))
    if w > 0.82 or piece.says("double", "side"):
        piece.add(finish, both(rounded_box((w / 4, h / 2 + 0.03, z), (w / 2 - 0.006, h - 0.06, 0.055), 0.012)))
        piece.add(bar, both(bar_handle((0.045, h * 0.55, front), h * 0.5, upright=True)))
        piece.add(BLACK, box((-w / 4, h * 0.62, d / 2 - 0.017), (w * 0.24, h * 0.17, 0.006)))
        piece.add(LIT_SCREEN, box((-w / 4, h * 0.66, d / 2 - 0.012), (w * 0.2, 0.03, 0.008)))
        return
    split = h * (0.36 if piece.rng.random() < 0.5 else 0.66)
    for low, high in ((0.06, split), (split, h)):
        piece.add(finish, rounded_box((0, (low + high) / 2, z), (w, high - low - 0.008, 0.055), 0.012))
        length = min(0.45, (high - low) * 0.55)
        near = high - 0.08 - length / 2 if low < 0.1 else low + 0.08 + length / 2
        piece.add(bar, bar_handle((0.06 - w / 2, near, front), length, upright=True))
    piece.add(DARK_METAL, box((0, h - 0.12, d / 2 - 0.016), (0.12, 0.025, 0.005)))
    piece.add(DARK_METAL, box((0, split, z - 0.01), (w - 0.01, 0.012, 0.05)))


def _oven_door(piece: Draft, low: float, high: float) -> None:
    """A dark window with a handle above it, and the racks within."""
    w, _, d = piece.size
    mid, tall, front = (low + high) / 2, high - low, d / 2 - 0.004
    piece.add(DARK_GLASS, box((0, mid - tall * 0.06, front - 0.012), (w * 0.76, tall * 0.6, 0.01)))
    piece.add(SHEEN, *(box((0, mid + tall * t, front - 0.006), (w * 0.66, 0.008, 0.004)) for t in (-0.18, 0.04)))
    piece.add(STEEL, bar_handle((0, high - tall * 0.12, front - 0.006), w * 0.76, upright=False))


def _knobs(num: int, width: float, y: float, z: float) -> Shape:
    knobs = (cylinder((x, y, z), 0.022, 0.022, top=0.018, sides=8, axis="z") for x in spread(num, width))
    return merged(knobs)


def oven(piece: Draft, w: float, h: float, d: float) -> None:
    """A built-in oven: a strip with knobs and a clock over a dark window with a handle."""
    finish, strip, z = piece.finish, h - min(0.13, h * 0.2), d / 2 - 0.045
    knob_y = (strip + h) / 2
    piece.add(plain(finish, 0.8), box((0, h / 2, -0.03), (w - 0.01, h, d - 0.06)))
    piece.add(finish, rounded_box((0, strip / 2, z), (w, strip - 0.01, 0.04), 0.008))
    piece.add(finish, rounded_box((0, knob_y, z), (w, h - strip - 0.006, 0.04), 0.008))
    piece.add(LIT_SCREEN, box((0, knob_y, d / 2 - 0.024), (w * 0.16, 0.035, 0.006)))
    knobs = _knobs(2, w * 0.24, knob_y, d / 2 - 0.025).moved(w * 0.3)
    piece.add(STEEL if is_dark(finish) else BLACK, both(knobs))
    _oven_door(piece, 0.02, strip - 0.02)


def stove(piece: Draft, w: float, h: float, d: float) -> None:
    """An oven under four burners with knobs at the front; low pieces are only a hob."""
    finish, z = piece.finish, d / 2 - 0.045
    top = h - min(0.03, h * 0.2)
    for at in (d * 0.22 - 0.01, -d * 0.22 - 0.01):
        piece.add(BLACK, both(cylinder((w * 0.24, top - 0.004, at), w * 0.09, 0.014, sides=10)))
        bars = [(w * 0.36, 0.012, 0.014), (0.014, 0.012, d * 0.32)]
        piece.add(BLACK_METAL, both(*(slab((w * 0.24, h - 0.006, at), size, faces="+y+x-x+z-z") for size in bars)))
    piece.add(finish if is_dark(finish) else plain(finish, 0.95), rounded_box((0, top - 0.015, 0), (w, 0.03, d), 0.008))
    if h < 0.3:
        piece.add(plain(finish, 0.7), box((0, (top - 0.03) / 2, 0), (w - 0.04, top - 0.03, d - 0.04)))
        return
    strip, knob_y = top - 0.13, top - 0.08
    piece.add(plain(finish, 0.8), box((0, (top - 0.03) / 2 + 0.02, -0.03), (w - 0.01, top - 0.07, d - 0.06)))
    for y, tall in (((strip + 0.16) / 2, strip - 0.17), (knob_y, top - strip - 0.036), (0.1, 0.1)):
        piece.add(finish, rounded_box((0, y, z), (w, tall, 0.04), 0.008))
    piece.add(STEEL if is_dark(finish) else BLACK, _knobs(5, w * 0.8, knob_y, d / 2 - 0.025))
    _oven_door(piece, 0.18, strip - 0.02)
    piece.add(BLACK, box((0, 0.025, -0.04), (w - 0.08, 0.05, d - 0.14)))


def washing_machine(piece: Draft, w: float, h: float, d: float) -> None:
    """A round window in a bright ring, a drawer, a dial and a display above; two machines where the box is tall."""
    if h > 1.45:
        half = piece.section((w, h / 2 - 0.005, d))
        washing_machine(half, *half.size)
        piece.put(half)
        piece.put(half, y=h / 2 + 0.005)
        return
    finish, strip, front = piece.finish, h * 0.83, d / 2 - 0.05
    radius, y, panel_y = min(w * 0.34, strip * 0.4), strip * 0.52, (strip + h) / 2
    metal = STEEL if not is_dark(finish) or finish.material != "metal" else _HANDLE
    piece.add(finish, rounded_box((0, h / 2, -0.025), (w, h, d - 0.05), 0.02))
    piece.add(metal, ring((0, y, front + 0.012), radius, 0.028, sides=20, around=5))
    piece.add(metal, cylinder((w * 0.05, panel_y, front), 0.042, 0.03, top=0.036, sides=12, axis="z"))
    piece.add(metal, box((radius + 0.01, y, front + 0.035), (0.03, 0.1, 0.03)))
    piece.add(DARK_GLASS, ball((0, y, front), (radius * 1.8, radius * 1.8, 0.08), sides=14, rings=4))
    piece.add(SHEEN, box((-radius * 0.35, y + radius * 0.35, front + 0.034), (radius * 0.3, radius * 0.1, 0.004)))
    piece.add(plain(finish, 0.72), box((0, strip, front + 0.001), (w - 0.01, 0.008, 0.004)))
    piece.add(plain(finish, 0.72), box((0, 0.04, front + 0.001), (w * 0.9, 0.008, 0.004)))
    drawer = (w * 0.34, (h - strip) * 0.62, 0.012)
    piece.add(plain(finish, 0.88), slab((-w * 0.28, panel_y, front + 0.006), drawer, faces="+z+x-x+y-y"))
    piece.add(BLACK, box((w * 0.3, panel_y, front + 0.004), (w * 0.24, (h - strip) * 0.4, 0.006)))


def dishwasher(piece: Draft, w: float, h: float, d: float) -> None:
    """A dishwasher with its door half open, so that racks with plates and cups show."""
    finish, side, low = piece.finish, 0.03, h * 0.42
    inner, room = w - 2 * side, h - 0.1 - low
    tall = room * 0.46
    piece.add(finish, both(box(((w - side) / 2, h / 2, -0.01), (side, h, d - 0.02))))
    piece.add(finish, rounded_box((0, h - 0.04, -0.005), (w, 0.08, d - 0.01), 0.01))
    piece.add(finish, rounded_box((0, low / 2 + 0.04, d / 2 - 0.035), (inner, low - 0.08, 0.05), 0.012))
    piece.add(plain(STEEL, 0.62), slab((0, h / 2, -d / 2 + 0.02), (w - side, h, 0.02), faces="+z"))
    piece.add(STEEL, bar_handle((0, low - 0.07, d / 2), w * 0.5, upright=False))
    piece.add(BLACK, slab((0, low - 0.012, d / 2 - 0.06), (inner - 0.02, 0.012, 0.1), faces="+y+z"))
    piece.add(BLACK, *(box((w * x, h - 0.04, d / 2 - 0.01), (0.024, 0.016, 0.006)) for x in (0.12, 0.2, 0.28, 0.36)))
    piece.add(BLACK, box((-w * 0.26, h - 0.04, d / 2 - 0.01), (w * 0.2, 0.035, 0.006)))
    for level in (low + 0.01, low + room * 0.58):
        piece.add(
            STEEL, *(slab((0, level, z), (inner, 0.012, 0.012), faces="+y-y+z") for z in (-d * 0.3, 0.0, d * 0.3))
        )
        piece.add(STEEL, slab((0, level + 0.05, d * 0.36), (inner, 0.01, 0.012), faces="+y-y+z"))
    plate = cylinder((0, 0, 0), tall * 0.56, 0.012, sides=12).turned("z", math.pi / 2 - 0.12)
    piece.add(WHITE, *(plate.moved(x, low + 0.03 + tall * 0.5, 0.0) for x in spread(6, w - 0.14)))
    cup_y = low + room * 0.6
    cups = [cylinder((x * w, cup_y, 0.06), 0.045, tall * 0.55, top=0.035, sides=8) for x in (0.1, 0.3)]
    piece.add(plastic(92, 140, 190), both(*cups))


def microwave(piece: Draft, w: float, h: float, d: float) -> None:
    """A wide box: dark window with a handle, keys and a clock at the right."""
    finish, front, is_black = piece.finish, d / 2 - 0.03, is_dark(piece.finish)
    piece.add(finish, rounded_box((0, h / 2 + 0.005, -0.015), (w, h - 0.01, d - 0.03), 0.012))
    piece.add(DARK_GLASS, box((-w * 0.13, h / 2, front + 0.004), (w * 0.6, h * 0.68, 0.008)))
    piece.add(SHEEN, box((-w * 0.13, h / 2, front + 0.009), (w * 0.44, h * 0.44, 0.003)))
    grip = bar_handle((w * 0.22 - 0.03, h / 2, d / 2 - 0.006), h * 0.7, upright=True)
    piece.add(STEEL if is_black else _HANDLE, grip)
    piece.add(LIT_SCREEN, box((w * 0.37, h * 0.8, front + 0.004), (w * 0.18, h * 0.13, 0.006)))
    key = (w * 0.042, h * 0.075, 0.008)
    rows = [h * (0.62 - 0.12 * r) for r in range(4)]
    keys = [box((x * w, y, front + 0.004), key) for y in rows for x in (0.31, 0.37, 0.43)]
    feet = four(cylinder((w * 0.42, 0, d * 0.36), 0.014, 0.012, sides=5))
    piece.add(STEEL if is_black else BLACK, *keys, feet)


def coffee_machine(piece: Draft, w: float, h: float, d: float) -> None:
    """A tower and a head with a spout over a glass jug of coffee."""
    r, tall, z = min(w * 0.36, d * 0.28), h * 0.5, d * 0.16
    piece.add(piece.finish, rounded_box((0, 0.02, 0), (w, 0.04, d), 0.015))
    piece.add(piece.finish, rounded_box((0, h * 0.5, -d * 0.3), (w * 0.9, h - 0.02, d * 0.38), 0.02))
    piece.add(piece.finish, rounded_box((0, h * 0.86, d * 0.08), (w * 0.9, h * 0.26, d * 0.78), 0.025))
    piece.add(BLACK, cylinder((0, h * 0.66, z), 0.022, h * 0.1, top=0.034, sides=8))
    jug = [(0.9, 0.0), (1.0, 0.3), (0.96, 0.62), (0.6, 1.0), (0.66, 1.08)]
    piece.add(plastic(64, 40, 28), lathe(jug, scale=(r, tall), at=(0, 0.045, z), sides=10))
    far = d * 0.2
    grip = [(r, tall * 0.95, z), (r + 0.04, tall * 0.9, far), (r + 0.035, tall * 0.45, far), (r * 0.95, tall * 0.4, z)]
    piece.add(BLACK, tube(grip, 0.01, sides=5))
    piece.add(STEEL, cylinder((w * 0.14, h * 0.88, d * 0.465), 0.026, 0.02, sides=8, axis="z"))
    piece.add(plastic(220, 60, 40), box((-w * 0.22, h * 0.88, d * 0.475), (0.03, 0.03, 0.006)))


def boiler(piece: Draft, w: float, h: float, d: float) -> None:
    """An upright tank with pipes, a gauge and a valve."""
    r, foot, top = min(w, d) * 0.44, 0.1, h - 0.16
    profile = [(r * 0.7, foot), (r, foot + 0.05), (r, top - 0.06), (r * 0.75, top), (r * 0.2, top + 0.02)]
    piece.add(piece.finish, lathe(profile, sides=18))
    piece.add(STEEL, four(cylinder((r * 0.6, 0, r * 0.6), 0.025, foot + 0.03, sides=6)))
    piece.add(STEEL, *(cylinder((0, y, 0), r * 1.01, 0.02, sides=18) for y in (foot + 0.12, top - 0.14)))
    x = r * 0.45
    piece.add(_COPPER, both(tube([(x, top - 0.02, 0), (x, h - 0.05, 0), (x, h - 0.03, -d * 0.45)], 0.024)))
    piece.add(WHITE, cylinder((0, h * 0.62, r - 0.005), 0.07, 0.03, sides=12, axis="z"))
    piece.add(BLACK, box((0.012, h * 0.62 + 0.014, r + 0.028), (0.008, 0.05, 0.004)))
    piece.add(BLACK, box((0, h * 0.38, r - 0.005), (r * 0.8, 0.16, 0.04)))
    piece.add(plastic(230, 90, 40), box((0, h * 0.38, r + 0.017), (0.05, 0.05, 0.006)))


def extractor(piece: Draft, w: float, h: float, d: float) -> None:
    """A hood over a stove: a flat pyramid under a chimney, with buttons and a light."""
    levels = [(0.0, 1, 1, 0), (0.06, 1, 1, 0), (h * 0.4, 0.42, 0.5, -d * 0.25), (h, 0.42, 0.5, -d * 0.25)]
    piece.add(piece.finish, stack(SQUARE, (w, d), levels, caps="both"))
    piece.add(BLACK, both(*(box((x, 0.03, d / 2 - 0.001), (0.02, 0.02, 0.004)) for x in (0.02, 0.06))))
