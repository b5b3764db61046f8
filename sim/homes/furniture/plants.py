"""Plants in pots, flowers in vases, empty vases."""

import math

from .lofts import ball, lathe, leaf, tube
from .palette import DARK_WOOD, LEAF, LIGHT_LEAF, SOIL, plain, plastic
from .shapes import Draft, Shape, both

_BLOSSOMS = (
    plastic(222, 70, 80), plastic(240, 200, 70), plastic(230, 130, 180), plastic(246, 244, 238), plastic(150, 100, 190),
)  # fmt: skip
_POT = [(0.7, 0.0), (0.94, 0.82), (1.0, 0.84), (1.0, 1.0), (0.88, 1.0), (0.86, 0.86)]
_VASES = (
    [
        (0.5, 0.0), (0.75, 0.14), (1.0, 0.42), (0.84, 0.66), (0.42, 0.84), (0.4, 0.92), (0.56, 1.0), (0.46, 0.985),
        (0.3, 0.9),
    ],
    [
        (0.6, 0.0), (0.64, 0.03), (0.42, 0.1), (0.7, 0.34), (1.0, 0.72), (0.92, 0.84), (0.6, 0.9), (0.64, 1.0),
        (0.54, 0.99), (0.4, 0.9),
    ],
    [
        (0.7, 0.0), (0.95, 0.1), (1.0, 0.3), (0.6, 0.56), (0.36, 0.72), (0.34, 0.9), (0.5, 1.0), (0.4, 0.99),
        (0.26, 0.88),
    ],
)  # fmt: skip
_TURN = 2.39996
"""The golden angle between one leaf and the next (radians)."""


def plant(piece: Draft, w: float, h: float, d: float) -> None:
    """Long leaves out of a pot, a small tree with a round crown, or a Christmas tree."""
    pot_h, share = min(0.34, h * 0.36), 0.6 if h > 0.7 else 0.66
    pot_r = w * share / 2
    piece.add(piece.finish, lathe(_POT, scale=(pot_r, pot_h), sides=14, depth=d / w, caps="start"))
    piece.add(SOIL, lathe([(0.88, 0.9), (0.0, 0.92)], scale=(pot_r, pot_h), sides=8, depth=d / w))
    if piece.says("christmas"):
        _christmas_tree(piece, w, h, d, pot_h)
    elif piece.says("tree") or (h > 0.9 and piece.rng.random() < 0.45):
        trunk = [(0, pot_h * 0.9, 0), (0.02, h * 0.5, 0.01), (-0.01, h * 0.72, 0)]
        piece.add(DARK_WOOD, tube(trunk, [0.03, 0.022, 0.016]))
        _crown(piece, w, h, d)
    else:
        _leaves(piece, w, h, d, pot_h * 0.88)


def _christmas_tree(piece: Draft, w: float, h: float, d: float, foot: float) -> None:
    tall = h - foot
    for r, low, top in ((1.0, 0.08, 0.5), (0.8, 0.32, 0.74), (0.55, 0.58, 1.0)):
        piece.add(LEAF, lathe([(r * w / 2, foot + low * tall), (0.02, foot + top * tall)], sides=10, depth=d / w))
    for k in range(9):
        out = 0.4 * (1 - k / 14)
        at = (out * w * math.cos(k * 2.4), foot + (0.14 + k * 0.06) * tall, out * d * math.sin(k * 2.4))
        piece.add(plastic(206, 44, 44), ball(at, (0.07, 0.07, 0.07), sides=5, rings=3))


def _crown(piece: Draft, w: float, h: float, d: float) -> None:
    """Adds rounded tufts of leaves around the top of a trunk, with single leaves between them."""
    for k in range(6):
        angle, out, size = k * _TURN, 0.0 if k == 5 else 0.24, 0.5 - 0.03 * (k % 3)
        y = h * (0.6 + 0.075 * (k % 3) + 0.12 * (k == 5))
        centre = (math.cos(angle) * w * out, y, math.sin(angle) * d * out)
        piece.add(LIGHT_LEAF if k % 2 else LEAF, ball(centre, (w * size, h * 0.22, d * size), sides=7, rings=4))
        tip = (math.cos(angle + 0.8) * w * 0.48, h * (0.52 + 0.09 * (k % 4)), math.sin(angle + 0.8) * d * 0.48)
        piece.add(LEAF, leaf((0.0, h * 0.66, 0.0), tip, width=w * 0.14, sag=0.04, steps=2))


def _leaves(piece: Draft, w: float, h: float, d: float, foot: float) -> None:
    """Adds leaves that grow outwards from one point at even angles, some steep and some hanging."""
    room = h - foot
    for k in range(18):
        angle, rise = k * _TURN + float(piece.rng.uniform(-0.2, 0.2)), 0.12 + 0.88 * ((k * 0.618) % 1.0)
        out = (math.sqrt(1 - rise**2) * 0.92 + 0.08) * 0.5
        tip = (math.cos(angle) * w * out, foot + room * 0.97 * rise, math.sin(angle) * d * out)
        blade = leaf((0.0, foot, 0.0), tip, width=max(0.05, min(w, d) * 0.22), sag=0.12 * room, steps=3)
        piece.add(LEAF if k % 3 else LIGHT_LEAF, blade)


def flowers(piece: Draft, w: float, h: float, d: float) -> None:
    """A vase with stems, leaves and blossoms."""
    tall, size = h * 0.46, max(0.05, w * 0.24)
    piece.add(piece.finish, _vase_skin(piece, w * 0.5, tall))
    tone = int(piece.rng.integers(len(_BLOSSOMS)))
    first, second = _BLOSSOMS[tone], _BLOSSOMS[1 if tone != 1 else 3]
    for k in range(7):
        angle, out = k * _TURN, 0.16 + 0.24 * ((k * 0.618) % 1.0) if k else 0.02
        x, y, z = (math.cos(angle) * w * out, h * (0.94 - 0.5 * out) - 0.02, math.sin(angle) * d * out)
        piece.add(LEAF, tube([(0, tall * 0.92, 0), (x, y, z)], 0.006, sides=3))
        piece.add(first if k < 4 else second, ball((x, y, z), (size, size * 0.6, size), sides=6, rings=3))
        if k < 4:
            heart = ball((x, y + size * 0.2, z), (size * 0.4, size * 0.4, size * 0.4), sides=5, rings=2)
            piece.add(plain(second, 0.9), heart)
        if k % 2:
            tip = (x * 1.4, h * 0.66, z * 1.4)
            piece.add(LEAF, leaf((0, tall * 0.95, 0), tip, width=w * 0.14, sag=0.02, steps=2))


def _vase_skin(piece: Draft, width: float, height: float) -> Shape:
    """The skin of a vase with one of three outlines."""
    w, _, d = piece.size
    return lathe(_VASES[int(piece.rng.integers(3))], scale=(width / 2, height), sides=12, depth=d / w)


def vase(piece: Draft, w: float, h: float, d: float) -> None:
    """A turned vase with two painted bands."""
    finish, skin = piece.finish, _vase_skin(piece, w, h)
    middle = skin.corners[..., 1].mean(axis=1)
    is_painted = (middle > 0.36 * h) & (middle < 0.62 * h)
    if finish.rgb2 is not None and finish.pattern == "plain":
        piece.add(finish, skin.chosen(~is_painted))
        piece.add(finish.model_copy(update={"rgb": finish.rgb2, "rgb2": None}), skin.chosen(is_painted))
    else:
        piece.add(finish, skin)
    if piece.says("handle", "handles", "jar", "urn"):
        grip = [(w * 0.2, h * 0.86, 0), (w * 0.42, h * 0.8, 0), (w * 0.42, h * 0.62, 0)]
        piece.add(finish, both(tube(grip, 0.01, sides=5)))
