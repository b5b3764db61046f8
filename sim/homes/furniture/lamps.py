"""Lamps that stand on the floor or on tables, hang from ceilings and walls."""

import math

from sim.homes.plan import Finish

from .lofts import ball, cylinder, lathe, tube
from .palette import BLACK_METAL, BRASS, DARK_METAL, GLOW, plastic
from .shapes import Draft

_SHADE = plastic(246, 232, 200)


def _stand_and_shade(piece: Draft) -> tuple[Finish, Finish]:
    """The finish of the stand (metal, unless the caption says otherwise) and of the shade."""
    if piece.finish.material in ("metal", "wood", "ceramic", "stone"):
        return piece.finish, _SHADE
    return (BRASS if piece.rng.random() < 0.4 else DARK_METAL), piece.finish


def _shade(
    piece: Draft, finish: Finish, low: float, high: float, radii: tuple[float, float], *, z: float = 0.0
) -> None:
    """Adds a lampshade that is open below and above, with a bulb in it."""
    r, top = radii
    profile = [(r * 0.97, low + 0.004), (r, low), (top, high), (top * 0.96, high - 0.004), (r * 0.96, low + 0.006)]
    piece.add(finish, lathe(profile, at=(0, 0, z), sides=16))
    piece.add(GLOW, ball((0, low + (high - low) * 0.32, z), (0.07, 0.1, 0.07), sides=6, rings=4))


def floor_lamp(piece: Draft, w: float, h: float, d: float) -> None:
    """A pole on a disc or three feet, with a shade; low lamps are table lamps."""
    if h < 0.8:
        table_lamp(piece, w, h, d)
        return
    stand, cover = _stand_and_shade(piece)
    r, shade_h = min(w, d) / 2, min(0.34, h * 0.24)
    if piece.rng.random() < 0.3 and not piece.says("old", "antique"):
        for a in (0.5, 2.6, 4.7):
            foot = (r * 0.9 * math.cos(a), 0.012, r * 0.9 * math.sin(a))
            piece.add(stand, tube([(0, h * 0.55, 0), foot], 0.016, sides=5))
        piece.add(stand, cylinder((0, h * 0.54, 0), 0.016, h * 0.4 - shade_h * 0.4, sides=6))
        _shade(piece, cover, h - shade_h, h, (r, r * 0.72))
        return
    piece.add(stand, lathe([(r * 0.72, 0.0), (r * 0.72, 0.02), (0.03, 0.04)], sides=16))
    piece.add(stand, cylinder((0, 0.02, 0), 0.014, h - shade_h * 0.7, sides=6))
    _shade(piece, cover, h - shade_h, h, (r, r * 0.66))


def table_lamp(piece: Draft, w: float, h: float, d: float) -> None:
    """A bellied foot under a shade."""
    stand, cover = _stand_and_shade(piece)
    r, low = min(w, d) / 2, h * 0.52
    belly = [(0.5, 0.0), (0.5, 0.06), (0.3, 0.12), (0.52, 0.45), (0.42, 0.75), (0.14, 0.92), (0.1, 0.76 / 0.52)]
    piece.add(stand, lathe(belly, scale=(r, low), sides=12))
    _shade(piece, cover, low, h, (r, r * 0.6))


def ceiling_lamp(piece: Draft, w: float, h: float, d: float) -> None:
    """A cord and a wide shade, or arms with candles if it is a chandelier."""
    r = min(w, d) / 2
    is_chandelier = piece.says("chandelier")
    piece.add(BRASS if is_chandelier else BLACK_METAL, cylinder((0, h - 0.03, 0), 0.06, 0.03, sides=10))
    if is_chandelier:
        for k in range(6):
            x, z = r * math.cos(k * math.pi / 3), r * math.sin(k * math.pi / 3)
            arm = [(0, h * 0.3, 0), (0.5 * x, h * 0.1, 0.5 * z), (0.85 * x, h * 0.28, 0.85 * z)]
            piece.add(BRASS, tube(arm, 0.012, sides=5))
            piece.add(GLOW, ball((0.85 * x, h * 0.36, 0.85 * z), (0.06, 0.12, 0.06), sides=5, rings=3))
        piece.add(BRASS, cylinder((0, h * 0.2, 0), 0.014, h * 0.8, sides=5))
        piece.add(BRASS, ball((0, h * 0.26, 0), (0.11, 0.16, 0.11), sides=8))
        return
    shade_h = min(0.26, h * 0.5)
    piece.add(BLACK_METAL, cylinder((0, shade_h * 0.9, 0), 0.006, h - shade_h, sides=4))
    skin = [(r, 0.0), (r * 0.9, shade_h * 0.45), (r * 0.3, shade_h * 0.9), (0.03, shade_h)]
    piece.add(piece.finish, lathe(skin, sides=16))
    piece.add(GLOW, ball((0, shade_h * 0.2, 0), (0.12, 0.13, 0.12), sides=8))


def wall_lamp(piece: Draft, w: float, h: float, d: float) -> None:
    """A plate, a bent arm and a shade."""
    r = min(w, d) * 0.42
    stand, cover = _stand_and_shade(piece)
    z = d / 2 - r
    piece.add(stand, cylinder((0, h * 0.4, -d / 2), 0.05, 0.016, sides=12, axis="z"))
    piece.add(stand, tube([(0, h * 0.4, -d / 2), (0, h * 0.24, -d * 0.1), (0, h * 0.3, z), (0, h * 0.5, z)], 0.011))
    _shade(piece, cover, h * 0.44, h, (r, r * 0.62), z=z)
