"""What hangs on walls and shows something: pictures, mirrors, screens, calendars, clocks, boards."""

import math

from sim.homes.plan import Finish

from .families import Vec
from .lofts import ball, cylinder, lathe, loft, ring, tube
from .order import Builder, Order, Part, made_of
from .palette import (
    BLACK,
    BLACK_METAL,
    BRASS,
    DARK_METAL,
    DARK_WOOD,
    LIT_SCREEN,
    MIRROR,
    PAPER,
    RED,
    SCREEN,
    SHEEN,
    STEEL,
    WHITE,
    is_dark,
    plain,
)
from .shapes import Shape, box, facets, picture_quad, prism, rounded_box, slab


def frame_bars(w: float, h: float, rim: float, d: float) -> Shape:
    """Four mitred bars around (w, h), lower at their outer edge, depth `d`, centred at half the height."""
    z0, z1 = -d / 2, d / 2
    rings = []
    for inset, z in ((0.0, z0), (0.0, z1 - d * 0.3), (rim * 0.35, z1), (rim, z1 - d * 0.25), (rim, z0)):
        x, y = w / 2 - inset, h / 2 - inset
        rings.append([(x, h / 2 + y, z), (-x, h / 2 + y, z), (-x, h / 2 - y, z), (x, h / 2 - y, z)])
    return loft(rings)


def picture(order: Order) -> list[Part]:
    """A frame, a mat and a painting."""
    w, h, d = order.size
    canvas = (
        order.finish
        if order.finish.material == "picture"
        else Finish(material="picture", rgb=order.finish.rgb, rgb2=order.finish.rgb2)
    )
    rim = min(0.06, w * 0.1, h * 0.1)
    if order.says("golden", "gold", "antique", "ornate"):
        frame = BRASS
    elif order.says("black"):
        frame = BLACK
    elif order.says("wooden", "wood", "brown"):
        frame = DARK_WOOD
    else:
        frame = (BLACK, DARK_WOOD, BRASS, WHITE)[int(order.rng.integers(4))]
    has_mat = order.says("photo", "photos", "mount") or order.rng.random() < 0.4
    mat = min(0.07, w * 0.11, h * 0.11) if has_mat else 0.0
    z = d * 0.1
    parts = [made_of(frame, frame_bars(w, h, rim, d))]
    if mat:
        parts.append(made_of(PAPER, picture_quad((0.0, h / 2, z - 0.003), (w - 2 * rim, h - 2 * rim))))
    parts.append(made_of(canvas, picture_quad((0.0, h / 2, z), (w - 2 * (rim + mat), h - 2 * (rim + mat)))))
    return parts


def mirror(order: Order) -> list[Part]:
    """A pane with the reflection of a room, and streaks of light, in a frame; round where the caption says so."""
    w, h, d = order.size
    frame = order.finish if order.finish.material in ("wood", "metal", "plastic") else STEEL
    z = d * 0.12
    is_round = order.says("round", "circular", "circle", "oval")
    rim = min(0.045, w * 0.07)
    if is_round:
        bar = ring((0, 0, 0), 0.5, 0.045, sides=28, around=6).scaled((w / 1.09, h / 1.09, 1.0)).moved(0, h / 2, 0)
        bar = bar._replace(corners=bar.corners * [1, 1, d / 0.09])
        pane = (
            lathe([(w * 0.46, 0.0), (w * 0.46, d * 0.5)], sides=28, depth=h / w, caps="end")
            .turned("x", math.pi / 2)
            .moved(0, h / 2, -d / 2)
        )
        parts = [made_of(frame, bar), made_of(MIRROR, pane)]
        half_w, half_h = w * 0.3, h * 0.3
    else:
        parts = [
            made_of(frame, frame_bars(w, h, rim, d)),
            made_of(MIRROR, picture_quad((0, h / 2, z), (w - 2 * rim, h - 2 * rim))),
        ]
        half_w, half_h = w / 2 - rim - 0.01, h / 2 - rim - 0.01
    front = (d * 0.06 if is_round else z) + 0.002
    return [*parts, *_streaks((0, h / 2, front), half_w, half_h)]


def _streaks(centre: Vec, half_w: float, half_h: float) -> list[Part]:
    """Two slanting bands of light, as cartoons draw glass."""
    x, y, z = centre
    lean = min(half_w * 0.9, half_h * 0.8)
    bands = []
    for at, wide in ((-0.42, 0.2), (-0.02, 0.1)):
        low, high = x + half_w * at - lean * 0.3, x + half_w * at + lean * 0.4
        quad = [
            (low, y - half_h * 0.75, z),
            (low + half_w * wide, y - half_h * 0.75, z),
            (high + half_w * wide, y + half_h * 0.75, z),
            (high, y + half_h * 0.75, z),
        ]
        bands.append(facets([quad]))
    return [made_of(Finish(material="plastic", rgb=(236, 246, 250)), *bands)]


def tv(order: Order) -> list[Part]:
    """A wide dark screen with a thin rim, a glare, a light and two feet."""
    w, h, d = order.size
    foot = h * 0.05
    shell = rounded_box((0, (h + foot) / 2, 0.0), (w, h - foot, d * 0.6), 0.01)
    rim = min(0.02, w * 0.03)
    z = d * 0.3 + 0.002
    low, high = foot + 2 * rim, h - rim
    screen = picture_quad((0, (low + high) / 2, z), (w - 2 * rim, high - low))
    half_w, mid, tall = w / 2 - rim, (low + high) / 2, high - low
    glare = [
        (-half_w * 0.1, low, z + 0.002),
        (half_w * 0.32, low, z + 0.002),
        (half_w * 0.98, mid + tall * 0.46, z + 0.002),
        (half_w * 0.5, high, z + 0.002),
    ]
    feet = [box((s * w * 0.3, foot / 2, 0), (0.03, foot, d)) for s in (-1, 1)]
    back = rounded_box((0, h * 0.45, -d * 0.36), (w * 0.5, h * 0.4, d * 0.28), 0.01)
    light = box((w * 0.42, foot + rim, d * 0.3 + 0.002), (0.014, 0.008, 0.004))
    return [
        made_of(BLACK, shell, back),
        made_of(SCREEN, screen),
        made_of(SHEEN, facets([glare])),
        made_of(DARK_METAL, *feet),
        made_of(RED, light),
    ]


def monitor(order: Order) -> list[Part]:
    """A lit screen on a foot with windows on it, and a keyboard and a mouse before it."""
    w, h, d = order.size
    foot, tall = h * 0.24, h * 0.76
    z = -d * 0.2
    shell = rounded_box((0, foot + tall / 2, z), (w, tall, 0.035), 0.01)
    screen = picture_quad((0, foot + tall / 2 + 0.008, z + 0.019), (w - 0.04, tall - 0.06))
    neck = box((0, foot * 0.6, z - 0.01), (0.05, foot * 1.2, 0.025))
    base = lathe([(w * 0.2, 0.0), (w * 0.2, 0.012)], at=(0, 0, z), sides=14, depth=0.55, caps="end")
    pages = [
        picture_quad((x * w, foot + tall * y, z + 0.021), (w * a, tall * b))
        for x, y, a, b in ((-0.14, 0.58, 0.46, 0.5), (0.27, 0.68, 0.24, 0.3))
    ]
    bars = [
        picture_quad((x * w, foot + tall * y, z + 0.023), (w * a, tall * b))
        for x, y, a, b in (
            (-0.14, 0.8, 0.46, 0.06),
            (-0.14, 0.6, 0.36, 0.03),
            (-0.14, 0.52, 0.36, 0.03),
            (-0.18, 0.44, 0.28, 0.03),
            (0.27, 0.68, 0.2, 0.2),
        )
    ]
    board_z = d / 2 - 0.055
    board = rounded_box((-0.02, 0.01, board_z), (w * 0.8, 0.018, 0.1), 0.006)
    keys = [slab((-0.02, 0.02, board_z + (r - 1) * 0.03), (w * 0.74, 0.008, 0.022), faces="+y+z") for r in range(3)]
    mouse = ball((w * 0.45, 0.012, board_z), (0.05, 0.032, 0.08), sides=6, rings=3)
    return [
        made_of(BLACK, shell, neck, base),
        made_of(LIT_SCREEN, screen),
        made_of(PAPER, *pages),
        made_of(SHEEN, *bars),
        made_of(DARK_METAL, board),
        made_of(plain(STEEL), *keys),
        made_of(BLACK, mouse),
    ]


def laptop(order: Order) -> list[Part]:
    """A keyboard half and a screen half, open."""
    w, h, d = order.size
    base = rounded_box((0, 0.01, d * 0.08), (w, 0.02, d * 0.84), 0.006)
    keys = [slab((0, 0.022, -d * 0.12 + r * d * 0.09), (w * 0.86, 0.004, d * 0.065), faces="+y+z") for r in range(4)]
    pad = slab((0, 0.021, d * 0.36), (w * 0.28, 0.003, d * 0.16), faces="+y")
    tall = h - 0.015
    lean = 0.22
    lid = rounded_box((0, tall / 2, 0), (w, tall, 0.012), 0.005).turned("x", -lean).moved(0, 0.015, -d * 0.3)
    screen = picture_quad((0, tall / 2, 0.008), (w * 0.92, tall * 0.86)).turned("x", -lean).moved(0, 0.015, -d * 0.3)
    page = (
        picture_quad((-w * 0.08, tall * 0.52, 0.01), (w * 0.5, tall * 0.5)).turned("x", -lean).moved(0, 0.015, -d * 0.3)
    )
    return [
        made_of(STEEL, base, lid),
        made_of(BLACK, *keys),
        made_of(DARK_METAL, pad),
        made_of(LIT_SCREEN, screen),
        made_of(PAPER, page),
    ]


def calendar(order: Order) -> list[Part]:
    """A picture over a sheet of days in a grid, a spiral at the top, on a nail."""
    w, h, d = order.size
    top = h - 0.03
    sheet = box((0, top / 2, -d * 0.1), (w, top, d * 0.4))
    canvas = Finish(material="picture", rgb=order.finish.rgb, rgb2=order.finish.rgb2)
    z = d * 0.12
    view = picture_quad((0, top * 0.75, z), (w * 0.94, top * 0.42))
    title = picture_quad((0, top * 0.49, z), (w * 0.5, top * 0.05))
    days = [
        picture_quad((-w * 0.4 + c * w * 0.133, top * (0.4 - 0.082 * r), z), (w * 0.1, top * 0.058))
        for r in range(5)
        for c in range(6)
    ]
    free = [picture_quad((w * 0.4, top * (0.4 - 0.082 * r), z), (w * 0.1, top * 0.058)) for r in range(5)]
    coils = [
        ring((-w * 0.42 + k * w * 0.105, top, 0), min(0.014, d * 0.45), 0.003, axis="x", sides=6, around=3)
        for k in range(9)
    ]
    nail = (
        tube([(0, h - 0.004, 0), (-w * 0.2, top, 0)], 0.002, sides=3),
        tube([(0, h - 0.004, 0), (w * 0.2, top, 0)], 0.002, sides=3),
    )
    return [
        made_of(PAPER, sheet),
        made_of(canvas, view),
        made_of(RED, title, *free),
        made_of(plain(STEEL, 0.75), *days),
        made_of(BLACK_METAL, *coils, *nail),
    ]


def clock(order: Order) -> list[Part]:
    """A round face with marks and hands."""
    w, h, d = order.size
    r = min(w, h) / 2
    rim = made_of(
        order.finish, cylinder((0, 0, 0), r, d * 0.7, sides=18).turned("x", math.pi / 2).moved(0, h / 2, -d / 2)
    )
    face = made_of(
        PAPER, cylinder((0, 0, 0), r * 0.86, d * 0.1, sides=18).turned("x", math.pi / 2).moved(0, h / 2, d * 0.2)
    )
    z = d * 0.31
    marks = [
        box((0, r * 0.72, z), (r * (0.1 if k % 3 == 0 else 0.05), r * 0.16, 0.003))
        .turned("z", k * math.pi / 6)
        .moved(0, h / 2, 0)
        for k in range(12)
    ]
    hands = [
        box((0, r * long / 2, z + 0.004), (r * wide, r * long, 0.003)).turned("z", angle).moved(0, h / 2, 0)
        for long, wide, angle in ((0.45, 0.09, 0.9), (0.66, 0.06, -1.05))
    ]
    return [rim, face, made_of(BLACK, *marks, *hands)]


def board(order: Order) -> list[Part]:
    """A framed board with notes on it and pens on its ledge."""
    w, h, d = order.size
    is_black = order.says("black", "blackboard", "chalkboard")
    face = Finish(material="plastic", rgb=(46, 62, 54)) if is_black else order.finish
    panel = made_of(face, box((0, h / 2, -d * 0.2), (w - 0.02, h - 0.02, d * 0.5)))
    bars = made_of(
        STEEL if not is_black else DARK_WOOD,
        frame_bars(w, h, 0.03, d * 0.7),
        box((0, 0.025, d * 0.25), (w * 0.5, 0.016, d * 0.5)),
    )
    z = d * 0.08
    notes = []
    for x, y, tone in (
        (-0.3, 0.66, (250, 226, 110)),
        (-0.08, 0.72, (240, 150, 160)),
        (0.3, 0.3, (150, 210, 240)),
        (-0.32, 0.34, (250, 250, 244)),
    ):
        side = min(0.14, w * 0.16, h * 0.2)
        notes.append(
            made_of(Finish(material="plastic", rgb=tone), picture_quad((x * w, y * h, z), (side, side * 1.15)))
        )
    ink = PAPER if is_black or is_dark(face) else Finish(material="plastic", rgb=(40, 70, 160))
    text = [picture_quad((w * 0.2, h * (0.78 - 0.1 * k), z), (w * (0.34 - 0.07 * (k % 2)), 0.014)) for k in range(4)]
    pens = [tube([(x, 0.04, d * 0.3), (x + 0.1, 0.04, d * 0.3)], 0.008, sides=5) for x in (-0.12, 0.04)]
    return [panel, bars, *notes, made_of(ink, *text), made_of(RED, *pens)]


def electric_box(order: Order) -> list[Part]:
    """A grey case with a door, breakers behind a window, a lightning bolt on a yellow triangle, a pipe."""
    w, h, d = order.size
    case = rounded_box((0, h / 2, -d * 0.1), (w, h, d * 0.8), 0.01)
    door = slab((0, h / 2, d * 0.32), (w * 0.9, h * 0.92, 0.02), faces="+z+x-x+y-y")
    z = d * 0.32 + 0.012
    window = picture_quad((0, h * 0.74, z), (w * 0.7, h * 0.16))
    breakers = [box((-w * 0.27 + k * w * 0.108, h * 0.74, z), (w * 0.07, h * 0.08, 0.014)) for k in range(6)]
    side = min(w, h) * 0.44
    low = h * 0.2
    sign = prism([(-side / 2, low), (side / 2, low), (0, low + side * 0.86)], low=z - 0.004, high=z + 0.004)
    m = low + side * 0.3
    bolt = facets(
        [
            [
                (0.08 * side, m + 0.36 * side, z + 0.007),
                (-0.12 * side, m + 0.02 * side, z + 0.007),
                (0.02 * side, m + 0.04 * side, z + 0.007),
                (0.02 * side, m + 0.04 * side, z + 0.007),
            ],
            [
                (-0.02 * side, m + 0.1 * side, z + 0.007),
                (-0.06 * side, m - 0.22 * side, z + 0.007),
                (0.13 * side, m + 0.14 * side, z + 0.007),
                (0.02 * side, m + 0.12 * side, z + 0.007),
            ],
        ]
    )
    lock = cylinder((0, 0, 0), 0.014, 0.012, sides=8).turned("x", math.pi / 2).moved(w * 0.36, h * 0.5, z)
    return [
        made_of(order.finish, case),
        made_of(plain(order.finish, 1.08), door),
        made_of(DARK_METAL, window),
        made_of(WHITE, *breakers),
        made_of(Finish(material="plastic", rgb=(250, 206, 40)), sign),
        made_of(BLACK, bolt, lock),
    ]


BUILDERS: dict[str, Builder] = {
    "picture": picture, "mirror": mirror, "tv": tv, "monitor": monitor, "laptop": laptop, "calendar": calendar,
    "clock": clock, "board": board, "electric box": electric_box,
}  # fmt: skip
