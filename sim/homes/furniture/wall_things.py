"""Things on walls that show something: pictures, mirrors, screens, calendars, clocks, boards."""

import math

from sim.homes.plan import Finish

from .bathroom import streak
from .lofts import SQUARE, ball, cylinder, lathe, ring, stack, tube
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
    plastic,
)
from .shapes import Draft, Shape, both, box, facets, flat, picture_quad, prism, rounded_box, slab

_GLARE = plastic(236, 246, 250)


def frame_bars(w: float, h: float, rim: float, d: float) -> Shape:
    """Four mitred bars of depth `d` around (w, h), lower at their outer edge, centred at half the height."""
    z0, z1 = -d / 2, d / 2
    steps = ((0.0, z0), (0.0, z1 - d * 0.3), (rim * 0.35, z1), (rim, z1 - d * 0.25), (rim, z0))
    levels = [(z, w - 2 * inset, h - 2 * inset, 0.0) for inset, z in steps]
    return stack(SQUARE, (1.0, 1.0), levels).turned("x", math.pi / 2).moved(y=h / 2)


def picture(piece: Draft, w: float, h: float, d: float) -> None:
    """A frame, a mat and a painting."""
    rim, z = min(0.06, w * 0.1, h * 0.1), d * 0.1
    if piece.says("golden", "gold", "antique", "ornate"):
        frame = BRASS
    elif piece.says("black"):
        frame = BLACK
    elif piece.says("wooden", "wood", "brown"):
        frame = DARK_WOOD
    else:
        frame = (BLACK, DARK_WOOD, BRASS, WHITE)[int(piece.rng.integers(4))]
    has_mat = piece.says("photo", "photos", "mount") or piece.rng.random() < 0.4
    mat = min(0.07, w * 0.11, h * 0.11) if has_mat else 0.0
    piece.add(frame, frame_bars(w, h, rim, d))
    if mat:
        piece.add(PAPER, picture_quad((0.0, h / 2, z - 0.003), (w - 2 * rim, h - 2 * rim)))
    piece.add(_canvas(piece.finish), picture_quad((0.0, h / 2, z), (w - 2 * (rim + mat), h - 2 * (rim + mat))))


def _canvas(finish: Finish) -> Finish:
    """A painting in the colours of a finish."""
    return finish if finish.material == "picture" else Finish(material="picture", rgb=finish.rgb, rgb2=finish.rgb2)


def mirror(piece: Draft, w: float, h: float, d: float) -> None:
    """A pane with the reflection of a room and streaks of light, in a frame; round if the caption says so."""
    frame = piece.finish if piece.finish.material in ("wood", "metal", "plastic") else STEEL
    rim, z = min(0.045, w * 0.07), d * 0.12
    if piece.says("round", "circular", "circle", "oval"):
        bar = ring((0, 0, 0), 0.5, 0.045, sides=28, around=6).scaled((w / 1.09, h / 1.09, 1.0)).moved(0, h / 2, 0)
        pane = lathe([(w * 0.46, 0.0), (w * 0.46, d * 0.5)], sides=28, depth=h / w, caps="end")
        piece.add(frame, bar._replace(corners=bar.corners * [1, 1, d / 0.09]))
        piece.add(MIRROR, pane.turned("x", math.pi / 2).moved(0, h / 2, -d / 2))
        half_w, half_h, z = w * 0.3, h * 0.3, d * 0.06
    else:
        piece.add(frame, frame_bars(w, h, rim, d))
        piece.add(MIRROR, picture_quad((0, h / 2, z), (w - 2 * rim, h - 2 * rim)))
        half_w, half_h = w / 2 - rim - 0.01, h / 2 - rim - 0.01
    lean = min(half_w * 0.9, half_h * 0.8)
    for at, wide in ((-0.42, 0.2), (-0.02, 0.1)):
        heights = (h / 2 - half_h * 0.75, h / 2 + half_h * 0.75)
        band = streak(half_w * at - lean * 0.3, heights, (half_w * wide, lean * 0.7), z + 0.002)
        piece.add(_GLARE, band)


def tv(piece: Draft, w: float, h: float, d: float) -> None:
    """A wide dark screen with a thin rim, a reflection, a light and two feet."""
    foot, rim, z = h * 0.05, min(0.02, w * 0.03), d * 0.3 + 0.002
    low, high, half = foot + 2 * rim, h - rim, w / 2 - rim
    mid, tall = (low + high) / 2, high - low
    piece.add(BLACK, rounded_box((0, (h + foot) / 2, 0.0), (w, h - foot, d * 0.6), 0.01))
    piece.add(BLACK, rounded_box((0, h * 0.45, -d * 0.36), (w * 0.5, h * 0.4, d * 0.28), 0.01))
    piece.add(SCREEN, picture_quad((0, mid, z), (w - 2 * rim, tall)))
    glare = [(-half * 0.1, low), (half * 0.32, low), (half * 0.98, mid + tall * 0.46), (half * 0.5, high)]
    piece.add(SHEEN, flat(glare, z + 0.002))
    piece.add(DARK_METAL, both(box((w * 0.3, foot / 2, 0), (0.03, foot, d))))
    piece.add(RED, box((w * 0.42, foot + rim, z), (0.014, 0.008, 0.004)))


def monitor(piece: Draft, w: float, h: float, d: float) -> None:
    """A lit screen with windows on it, on a foot, with a keyboard and a mouse in front of it."""
    foot, tall, z, keys_z = h * 0.24, h * 0.76, -d * 0.2, d / 2 - 0.055
    piece.add(BLACK, rounded_box((0, foot + tall / 2, z), (w, tall, 0.035), 0.01))
    piece.add(BLACK, box((0, foot * 0.6, z - 0.01), (0.05, foot * 1.2, 0.025)))
    piece.add(BLACK, lathe([(w * 0.2, 0.0), (w * 0.2, 0.012)], at=(0, 0, z), sides=14, depth=0.55, caps="end"))
    piece.add(LIT_SCREEN, picture_quad((0, foot + tall / 2 + 0.008, z + 0.019), (w - 0.04, tall - 0.06)))
    pages = ((-0.14, 0.58, 0.46, 0.5), (0.27, 0.68, 0.24, 0.3))
    lines = ((-0.14, 0.8, 0.46, 0.06), (-0.14, 0.6, 0.36, 0.03), (-0.14, 0.52, 0.36, 0.03), (-0.18, 0.44, 0.28, 0.03))
    for tone, away, quads in ((PAPER, 0.021, pages), (SHEEN, 0.023, (*lines, (0.27, 0.68, 0.2, 0.2)))):
        for x, y, wide, high in quads:
            piece.add(tone, picture_quad((x * w, foot + tall * y, z + away), (w * wide, tall * high)))
    piece.add(DARK_METAL, rounded_box((-0.02, 0.01, keys_z), (w * 0.8, 0.018, 0.1), 0.006))
    rows = [slab((-0.02, 0.02, keys_z + at), (w * 0.74, 0.008, 0.022), faces="+y+z") for at in (-0.03, 0.0, 0.03)]
    piece.add(plain(STEEL), *rows)
    piece.add(BLACK, ball((w * 0.45, 0.012, keys_z), (0.05, 0.032, 0.08), sides=6, rings=3))


def laptop(piece: Draft, w: float, h: float, d: float) -> None:
    """An open laptop: a half with the keyboard and a half with the screen."""
    tall = h - 0.015
    piece.add(STEEL, rounded_box((0, 0.01, d * 0.08), (w, 0.02, d * 0.84), 0.006))
    keys = [slab((0, 0.022, d * (0.09 * r - 0.12)), (w * 0.86, 0.004, d * 0.065), faces="+y+z") for r in range(4)]
    piece.add(BLACK, *keys)
    piece.add(DARK_METAL, slab((0, 0.021, d * 0.36), (w * 0.28, 0.003, d * 0.16), faces="+y"))
    for tone, shape in (
        (STEEL, rounded_box((0, tall / 2, 0), (w, tall, 0.012), 0.005)),
        (LIT_SCREEN, picture_quad((0, tall / 2, 0.008), (w * 0.92, tall * 0.86))),
        (PAPER, picture_quad((-w * 0.08, tall * 0.52, 0.01), (w * 0.5, tall * 0.5))),
    ):
        piece.add(tone, shape.turned("x", -0.22).moved(0, 0.015, -d * 0.3))


def calendar(piece: Draft, w: float, h: float, d: float) -> None:
    """A picture over a sheet with a grid of days, with a spiral at the top, on a nail."""
    top, z, day = h - 0.03, d * 0.12, (w * 0.1, (h - 0.03) * 0.058)
    piece.add(PAPER, box((0, top / 2, -d * 0.1), (w, top, d * 0.4)))
    piece.add(_canvas(piece.finish), picture_quad((0, top * 0.75, z), (w * 0.94, top * 0.42)))
    piece.add(RED, picture_quad((0, top * 0.49, z), (w * 0.5, top * 0.05)))
    for row in range(5):
        y = top * (0.4 - 0.082 * row)
        piece.add(plain(STEEL, 0.75), *(picture_quad((w * (0.133 * c - 0.4), y, z), day) for c in range(6)))
        piece.add(RED, picture_quad((w * 0.4, y, z), day))
    for k in range(9):
        coil = ring((w * (0.105 * k - 0.42), top, 0), min(0.014, d * 0.45), 0.003, axis="x", sides=6, around=3)
        piece.add(BLACK_METAL, coil)
    piece.add(BLACK_METAL, both(tube([(0, h - 0.004, 0), (w * 0.2, top, 0)], 0.002, sides=3)))


def clock(piece: Draft, w: float, h: float, d: float) -> None:
    """A round face with marks and hands."""
    r, z = min(w, h) / 2, d * 0.31
    piece.add(piece.finish, cylinder((0, h / 2, -d / 2), r, d * 0.7, sides=18, axis="z"))
    piece.add(PAPER, cylinder((0, h / 2, d * 0.2), r * 0.86, d * 0.1, sides=18, axis="z"))
    marks = [(0.72, 0.1 if k % 3 == 0 else 0.05, 0.16, z, k * math.pi / 6) for k in range(12)]
    hands = [(0.225, 0.09, 0.45, z + 0.004, 0.9), (0.33, 0.06, 0.66, z + 0.004, -1.05)]
    for away, wide, long, front, angle in (*marks, *hands):
        bar = box((0, r * away, front), (r * wide, r * long, 0.003))
        piece.add(BLACK, bar.turned("z", angle).moved(0, h / 2, 0))


def board(piece: Draft, w: float, h: float, d: float) -> None:
    """A framed board with notes on it and pens on its ledge."""
    is_black = piece.says("black", "blackboard", "chalkboard")
    face = plastic(46, 62, 54) if is_black else piece.finish
    rim, z, side = DARK_WOOD if is_black else STEEL, d * 0.08, min(0.14, w * 0.16, h * 0.2)
    piece.add(face, box((0, h / 2, -d * 0.2), (w - 0.02, h - 0.02, d * 0.5)))
    piece.add(rim, frame_bars(w, h, 0.03, d * 0.7), box((0, 0.025, d * 0.25), (w * 0.5, 0.016, d * 0.5)))
    for x, y, tone in (
        (-0.3, 0.66, plastic(250, 226, 110)), (-0.08, 0.72, plastic(240, 150, 160)),
        (0.3, 0.3, plastic(150, 210, 240)), (-0.32, 0.34, plastic(250, 250, 244)),
    ):  # fmt: skip
        piece.add(tone, picture_quad((x * w, y * h, z), (side, side * 1.15)))
    ink = PAPER if is_black or is_dark(face) else plastic(40, 70, 160)
    for k in range(4):
        piece.add(ink, picture_quad((w * 0.2, h * (0.78 - 0.1 * k), z), (w * (0.34 - 0.07 * (k % 2)), 0.014)))
    piece.add(RED, *(tube([(x, 0.04, d * 0.3), (x + 0.1, 0.04, d * 0.3)], 0.008, sides=5) for x in (-0.12, 0.04)))


def electric_box(piece: Draft, w: float, h: float, d: float) -> None:
    """A grey case with a door, breakers behind a window, a lightning bolt on a yellow triangle, and a pipe."""
    z, side, low = d * 0.32 + 0.012, min(w, h) * 0.44, h * 0.2
    piece.add(piece.finish, rounded_box((0, h / 2, -d * 0.1), (w, h, d * 0.8), 0.01))
    piece.add(plain(piece.finish, 1.08), slab((0, h / 2, d * 0.32), (w * 0.9, h * 0.92, 0.02), faces="+z+x-x+y-y"))
    piece.add(DARK_METAL, picture_quad((0, h * 0.74, z), (w * 0.7, h * 0.16)))
    piece.add(WHITE, *(box((w * (0.108 * k - 0.27), h * 0.74, z), (w * 0.07, h * 0.08, 0.014)) for k in range(6)))
    sign = [(-side / 2, low), (side / 2, low), (0, low + side * 0.86)]
    piece.add(plastic(250, 206, 40), prism(sign, low=z - 0.004, high=z + 0.004))
    bolt = facets([
        [(0.08, 0.36, 0.0), (-0.12, 0.02, 0.0), (0.02, 0.04, 0.0), (0.02, 0.04, 0.0)],
        [(-0.02, 0.1, 0.0), (-0.06, -0.22, 0.0), (0.13, 0.14, 0.0), (0.02, 0.12, 0.0)],
    ])  # fmt: skip
    piece.add(BLACK, bolt.scaled((side, side, 1.0)).moved(0.0, low + side * 0.3, z + 0.007))
    piece.add(BLACK, cylinder((w * 0.36, h * 0.5, z), 0.014, 0.012, sides=8, axis="z"))
