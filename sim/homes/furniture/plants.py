"""Plants in pots, flowers in vases, empty vases."""

import math

from sim.homes.plan import Finish
from sim.words.finishes import Rgb

from .lofts import ball, lathe, leaf, tube
from .order import Builder, Order, Part, made_of
from .palette import DARK_WOOD, LEAF, LIGHT_LEAF, SOIL, plain
from .shapes import Shape

_BLOSSOMS: tuple[Rgb, ...] = ((222, 70, 80), (240, 200, 70), (230, 130, 180), (246, 244, 238), (150, 100, 190))


def _pot(w: float, d: float, tall: float, finish: Finish) -> list[Part]:
    """A pot with a rim and soil in it; `w` is the width at its rim."""
    r = w / 2
    skin = lathe(
        [
            (r * 0.7, 0.0),
            (r * 0.94, tall * 0.82),
            (r, tall * 0.84),
            (r, tall),
            (r * 0.88, tall),
            (r * 0.86, tall * 0.86),
        ],
        sides=14,
        depth=d / w,
        caps="start",
    )
    soil = lathe([(r * 0.88, tall * 0.9), (0.0, tall * 0.92)], sides=8, depth=d / w)
    return [made_of(finish, skin), made_of(SOIL, soil)]


def plant(order: Order) -> list[Part]:
    """Long leaves out of a pot, a small tree with a round crown, or a christmas tree."""
    w, h, d = order.size
    pot_h = min(0.34, h * 0.36)
    share = 0.6 if h > 0.7 else 0.66
    pot = _pot(w * share, d * share, pot_h, order.finish)
    if order.says("christmas"):
        cones = [
            lathe([(r * w / 2, pot_h + y * (h - pot_h)), (0.02, pot_h + top * (h - pot_h))], sides=10, depth=d / w)
            for r, y, top in ((1.0, 0.08, 0.5), (0.8, 0.32, 0.74), (0.55, 0.58, 1.0))
        ]
        baubles = [
            ball(
                (
                    0.4 * w * math.cos(k * 2.4) * (1 - k / 14),
                    pot_h + (0.14 + k * 0.06) * (h - pot_h),
                    0.4 * d * math.sin(k * 2.4) * (1 - k / 14),
                ),
                (0.07, 0.07, 0.07),
                sides=5,
                rings=3,
            )
            for k in range(9)
        ]
        return [*pot, made_of(LEAF, *cones), made_of(Finish(material="plastic", rgb=(206, 44, 44)), *baubles)]
    if order.says("tree") or (h > 0.9 and order.rng.random() < 0.45):
        trunk = tube([(0, pot_h * 0.9, 0), (0.02, h * 0.5, 0.01), (-0.01, h * 0.72, 0)], [0.03, 0.022, 0.016])
        return [*pot, made_of(DARK_WOOD, trunk), *_crown(order)]
    return [*pot, *_leaves(order, foot=(0.0, pot_h * 0.88, 0.0), count=18)]


def _crown(order: Order) -> list[Part]:
    """Rounded tufts of leaves around the top of a trunk, with single leaves between them."""
    w, h, d = order.size
    dark: list[Shape] = []
    light: list[Shape] = []
    for k in range(6):
        angle = k * 2.39996
        out = 0.0 if k == 5 else 0.24
        size = 0.5 - 0.03 * (k % 3)
        centre = (math.cos(angle) * w * out, h * (0.6 + 0.075 * (k % 3) + 0.12 * (k == 5)), math.sin(angle) * d * out)
        tuft = ball(centre, (w * size, h * 0.22, d * size), sides=7, rings=4)
        (light if k % 2 else dark).append(tuft)
        tip = (math.cos(angle + 0.8) * w * 0.48, h * (0.52 + 0.09 * (k % 4)), math.sin(angle + 0.8) * d * 0.48)
        dark.append(leaf((0.0, h * 0.66, 0.0), tip, width=w * 0.14, sag=0.04, steps=2))
    return [made_of(LEAF, *dark), made_of(LIGHT_LEAF, *light)]


def _leaves(order: Order, *, foot: tuple[float, float, float], count: int) -> list[Part]:
    """Leaves from one point outwards, evenly turned, some steep and some hanging."""
    w, h, d = order.size
    room = h - foot[1]
    dark: list[Shape] = []
    light: list[Shape] = []
    for k in range(count):
        angle = k * 2.39996 + float(order.rng.uniform(-0.2, 0.2))
        rise = 0.12 + 0.88 * ((k * 0.618) % 1.0)
        out = math.sqrt(1 - rise**2) * 0.92 + 0.08
        tip = (
            foot[0] + math.cos(angle) * w * 0.5 * out,
            foot[1] + room * 0.97 * rise,
            foot[2] + math.sin(angle) * d * 0.5 * out,
        )
        blade = leaf(foot, tip, width=max(0.05, min(w, d) * 0.22), sag=0.12 * room, steps=3)
        (light if k % 3 == 0 else dark).append(blade)
    return [made_of(LEAF, *dark), made_of(LIGHT_LEAF, *light)]


def flowers(order: Order) -> list[Part]:
    """A vase with stems, leaves and blossoms."""
    w, h, d = order.size
    tall = h * 0.46
    parts = [made_of(order.finish, _vase_skin(w * 0.5, tall, d / w, order))]
    stems, blades, heads, hearts = [], [], [], []
    for k in range(7):
        angle = k * 2.39996
        out = 0.16 + 0.24 * ((k * 0.618) % 1.0) if k else 0.02
        head = (math.cos(angle) * w * out, h * (0.94 - 0.5 * out) - 0.02, math.sin(angle) * d * out)
        stems.append(tube([(0, tall * 0.92, 0), head], 0.006, sides=3))
        size = max(0.05, w * 0.24)
        heads.append(ball(head, (size, size * 0.6, size), sides=6, rings=3))
        hearts.append(
            ball((head[0], head[1] + size * 0.2, head[2]), (size * 0.4, size * 0.4, size * 0.4), sides=5, rings=2)
        )
        if k % 2:
            blades.append(
                leaf((0, tall * 0.95, 0), (head[0] * 1.4, h * 0.66, head[2] * 1.4), width=w * 0.14, sag=0.02, steps=2)
            )
    tone = _BLOSSOMS[int(order.rng.integers(len(_BLOSSOMS)))]
    first, second = (
        Finish(material="plastic", rgb=tone),
        Finish(material="plastic", rgb=_BLOSSOMS[1 if tone != _BLOSSOMS[1] else 3]),
    )
    return [
        *parts,
        made_of(LEAF, *stems, *blades),
        made_of(first, *heads[:4]),
        made_of(second, *heads[4:]),
        made_of(plain(second, 0.9), *hearts[:4]),
    ]


def _vase_skin(w: float, h: float, depth: float, order: Order) -> Shape:
    """One of three outlines."""
    r = w / 2
    outlines = (
        [
            (0.5, 0.0),
            (0.75, 0.14),
            (1.0, 0.42),
            (0.84, 0.66),
            (0.42, 0.84),
            (0.4, 0.92),
            (0.56, 1.0),
            (0.46, 0.985),
            (0.3, 0.9),
        ],
        [
            (0.6, 0.0),
            (0.64, 0.03),
            (0.42, 0.1),
            (0.7, 0.34),
            (1.0, 0.72),
            (0.92, 0.84),
            (0.6, 0.9),
            (0.64, 1.0),
            (0.54, 0.99),
            (0.4, 0.9),
        ],
        [
            (0.7, 0.0),
            (0.95, 0.1),
            (1.0, 0.3),
            (0.6, 0.56),
            (0.36, 0.72),
            (0.34, 0.9),
            (0.5, 1.0),
            (0.4, 0.99),
            (0.26, 0.88),
        ],
    )
    outline = outlines[int(order.rng.integers(3))]
    return lathe([(a * r, b * h) for a, b in outline], sides=12, depth=depth)


def vase(order: Order) -> list[Part]:
    """A turned vase with two painted bands."""
    w, h, d = order.size
    skin = _vase_skin(w, h, d / w, order)
    parts = [made_of(order.finish, skin)]
    if order.says("handle", "handles", "jar", "urn"):
        grips = [
            tube([(s * w * 0.2, h * 0.86, 0), (s * w * 0.42, h * 0.8, 0), (s * w * 0.42, h * 0.62, 0)], 0.01, sides=5)
            for s in (-1, 1)
        ]
        parts.append(made_of(order.finish, *grips))
    if order.finish.rgb2 is not None and order.finish.pattern == "plain":
        middle = skin.corners[..., 1].mean(axis=1)
        band = (middle > 0.36 * h) & (middle < 0.62 * h)
        painted = Shape(skin.corners[band], skin.normals[band], skin.uv[band])
        other = order.finish.model_copy(update={"rgb": order.finish.rgb2, "rgb2": None})
        rest = Shape(skin.corners[~band], skin.normals[~band], skin.uv[~band])
        parts[0] = made_of(order.finish, rest)
        parts.append(made_of(other, painted))
    return parts


BUILDERS: dict[str, Builder] = {"plant": plant, "flowers": flowers, "vase": vase}
