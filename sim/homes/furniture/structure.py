"""Parts of the house: railings, stairs, windows, doors, columns, panels, fireplaces, radiators, fans."""

import math

from .joinery import spread
from .lofts import ball, cylinder, lathe, tube
from .palette import BLACK_METAL, BRASS, DARK_METAL, DARK_WOOD, FIRE, SOOT, STEEL, WHITE, is_dark, plain, plastic
from .shapes import Draft, both, box, flat, picture_quad, prism, rounded_box, slab
from .wall_things import frame_bars

_BALUSTER = [(0.8, 0.0), (0.5, 0.12), (1.0, 0.34), (0.45, 0.66), (0.8, 1.0)]


def railing(piece: Draft, w: float, h: float, d: float) -> None:
    """Posts, a handrail and balusters of iron, turned wood or stone; sloping in a stairwell."""
    finish, thick = piece.finish, min(d, 0.07)
    is_sloping = (
        piece.says("stairs", "stair", "staircase") and piece.says("railing", "handrail", "banister") and w > 0.7
    )
    slope = 0.45 * min(h, 1.2) if is_sloping else 0.0
    rise, post = h - slope, min(thick * 1.3, d)
    of_stone = piece.says("balustrade", "parapet") or finish.material in ("stone", "plaster")
    for share, tall, deep in ((1.0, 0.055, thick), (0.12, 0.035, thick * 0.6)):
        y = rise * share - tall
        rail = [(-w / 2, y), (w / 2, y + slope), (w / 2, y + slope + tall), (-w / 2, y + tall)]
        piece.add(finish, prism(rail, low=-deep / 2, high=deep / 2))
    for s in (-1, 1):
        top = rise - 0.02 + slope * (s + 1) / 2
        piece.add(finish, box((s * (w / 2 - post / 2), top / 2, 0), (post, top, post)))
    tone = finish if finish.material != "wood" or of_stone else plain(finish, 0.95)
    for x in spread(max(4, min(14, round(w / (0.16 if of_stone else 0.12)))), w):
        up = slope * (x / w + 0.5)
        low, high = rise * 0.1 + up, rise - 0.05 + up
        if of_stone:
            piece.add(tone, lathe(_BALUSTER, scale=(min(0.045, thick * 0.6), high - low), at=(x, low, 0), sides=6))
        else:
            piece.add(tone, tube([(x, low, 0), (x, high, 0)], 0.009 if finish.material == "metal" else 0.014, sides=4))


def stair(piece: Draft, w: float, h: float, d: float) -> None:
    """Steps that rise away from the front, with light treads, dark risers, and a rail at one side."""
    top = h * 0.72 if h > 0.8 else h
    num = max(3, min(9, round(top / 0.17)))
    rise, run, rail, x = top / num, d / num, h - top, w / 2 - 0.03
    light = plain(piece.finish, 1.35) if is_dark(piece.finish) else WHITE
    for k in range(num):
        y, z = (k + 1) * rise - 0.03, d / 2 - (k + 0.5) * run
        piece.add(piece.finish, box((0, y + 0.015, z + 0.008), (w, 0.03, run + 0.016 if k else run)))
        piece.add(light, slab((0, (k + 0.5) * rise - 0.015, z), (w - 0.04, rise - 0.03, run - 0.02), faces="+z"))
        piece.add(light, slab((0, y / 2, z), (w - 0.04, y, run), faces="+x-x-z" if k == num - 1 else "+x-x"))
        if rail:
            post = [(x, y + 0.01, z), (x, y + rail - 0.01 - rise * 0.5, z)]
            piece.add(DARK_METAL, tube(post, 0.012, sides=4))
    if rail:
        end = (x, top + rail - rise * 0.6 - 0.02, -d / 2 + 0.03)
        piece.add(DARK_METAL, tube([(x, rise * 0.5 + rail - 0.03, d / 2 - 0.02), end], 0.026))


def window(piece: Draft, w: float, h: float, d: float) -> None:
    """A frame with a cross of bars, sky and a hill behind the panes, a sill and a handle."""
    rim, sill, z, half = min(0.07, w * 0.09), 0.05, -d * 0.05, w * 0.46
    frame = piece.finish if piece.finish.material in ("wood", "metal", "plastic") else WHITE
    low, high = sill + rim * 0.5, h - rim * 0.5
    tall = high - low
    piece.add(frame, frame_bars(w * 0.97, h - sill, rim, d * 0.7).moved(y=sill))
    piece.add(frame, box((0, h / 2, 0), (rim * 0.8, h - 0.1, d * 0.5)))
    piece.add(frame, box((0, sill + (h - sill) * 0.6, 0), (w * 0.9, rim * 0.5, d * 0.45)))
    piece.add(frame, box((0, sill / 2, 0.0), (w, sill, d)))
    piece.add(plastic(166, 208, 242), flat([(-half, low), (half, low), (half, high), (-half, high)], z))
    hill = [(-half, low), (half, low), (half, low + tall * 0.26), (-half, low + tall * 0.36)]
    piece.add(plastic(122, 164, 92), flat(hill, z + 0.003))
    for tone, x, y, size in (
        (plastic(74, 120, 66), -0.6, 0.34, (0.36, 0.3)), (plastic(74, 120, 66), 0.55, 0.34, (0.36, 0.3)),
        (WHITE, -0.45, 0.86, (0.4, 0.09)), (WHITE, 0.5, 0.8, (0.5, 0.09)),
    ):  # fmt: skip
        at, extent = (x * half, low + tall * y, z + 0.002), (half * size[0], tall * size[1], 0.006)
        piece.add(tone, ball(at, extent, sides=8, rings=4))
    piece.add(STEEL, box((rim * 0.2, h * 0.45, d * 0.36), (0.02, 0.11, 0.02)))


def door(piece: Draft, w: float, h: float, d: float) -> None:
    """A leaf with four panels in a frame, and a handle."""
    rim = min(0.08, w * 0.1)
    leaf_w, leaf_h, y = w - 2 * rim, h - rim, (h - rim) * 0.47
    piece.add(piece.finish, box((0, leaf_h / 2, 0), (leaf_w, leaf_h, d * 0.5)))
    piece.add(plain(piece.finish, 0.85), both(box(((w - rim) / 2, h / 2, 0), (rim, h, d))))
    piece.add(plain(piece.finish, 0.85), box((0, h - rim / 2, 0), (w - 2 * rim, rim, d)))
    for at, tall in ((0.25, 0.36), (0.7, 0.42)):
        centre, size = (leaf_w * 0.23, leaf_h * at, d * 0.25), (leaf_w * 0.34, leaf_h * tall, d * 0.12)
        piece.add(plain(piece.finish, 0.92), both(slab(centre, size, faces="+z+x-x+y-y")))
    grip = [(leaf_w * 0.42, y, d * 0.25), (leaf_w * 0.42, y, d * 0.46), (leaf_w * 0.28, y, d * 0.46)]
    piece.add(STEEL, tube(grip, 0.012))


def column(piece: Draft, w: float, h: float, d: float) -> None:
    """A round shaft between a base and a capital."""
    piece.add(piece.finish, *(box((0, y, 0), (w, 0.08, d)) for y in (0.04, h - 0.04)))
    profile = [(0.95, 0.08), (0.9, 0.14), (0.76, 0.18), (0.68, h - 0.2), (0.8, h - 0.14), (0.95, h - 0.08)]
    piece.add(piece.finish, lathe(profile, scale=(min(w, d) / 2, 1.0), sides=16))


def panel(piece: Draft, w: float, h: float, d: float) -> None:
    """A plain board."""
    piece.add(piece.finish, box((0, h / 2, 0), (w, h, d)))


def shutter(piece: Draft, w: float, h: float, d: float) -> None:
    """Two leaves with slanting slats and a knob."""
    leaf = w / 2
    rim, num = min(0.05, leaf * 0.14), max(5, min(14, round(h / 0.08)))
    step = (h - 2 * rim) / num
    for x in (-leaf / 2, leaf / 2):
        post = both(box(((leaf - rim) / 2, h / 2, 0), (rim - 0.004, h, d * 0.6))).moved(x)
        rails = [box((x, y, 0), (leaf - 2 * rim, rim, d * 0.6)) for y in (rim / 2, h - rim / 2, h / 2)]
        piece.add(piece.finish, post, *rails)
        slat = box((0, 0, 0), (leaf - 2 * rim, step * 0.95, 0.008)).turned("x", 0.6)
        piece.add(plain(piece.finish, 0.92), *(slat.moved(x, rim + (k + 0.5) * step, 0) for k in range(num)))
    piece.add(BLACK_METAL, ball((rim * 0.9, h * 0.5, d * 0.34), (0.025, 0.025, 0.025), sides=6, rings=3))


def fireplace(piece: Draft, w: float, h: float, d: float) -> None:
    """Pillars and a mantel around a dark opening with logs and flames, on a hearth."""
    finish, hearth, shelf, depth = piece.finish, 0.06, 0.07, d * 0.78
    open_w, open_h = w * 0.52, (h - hearth) * 0.6
    side, z, front = (w * 0.92 - open_w) / 2, -d / 2 + depth / 2, -d / 2 + depth + 0.006
    mid, top = hearth + open_h / 2, hearth + open_h
    pillar = box(((open_w + side) / 2, (h - shelf + hearth) / 2, z), (side, h - shelf - hearth, depth))
    piece.add(finish, both(pillar), box((0, (top + h - shelf) / 2, z), (open_w, h - shelf - top, depth)))
    piece.add(finish, rounded_box((0, h - shelf / 2, -d * 0.04), (w, shelf, d * 0.92), 0.012))
    piece.add(finish, box((0, h - shelf - 0.02, z + 0.01), (w * 0.95, 0.04, depth)))
    piece.add(plain(finish, 0.7), rounded_box((0, hearth / 2, 0), (w, hearth, d), 0.008))
    piece.add(SOOT, picture_quad((0.0, mid, -d / 2 + 0.04), (open_w, open_h)))
    piece.add(SOOT, slab((0, hearth + 0.006, z), (open_w, 0.012, depth), faces="+y"))
    piece.add(BLACK_METAL, box((0.0, top + 0.015, front), (open_w, 0.03, 0.012)))
    piece.add(BLACK_METAL, both(box((open_w / 2 + 0.012, mid, front), (0.024, open_h, 0.012))))
    log_z = z + depth * 0.1
    for (left, y, back), (right, y2, back2), r in (
        ((-0.3, 0.06, 0.0), (0.3, 0.05, 0.03), 0.045),
        ((-0.24, 0.06, -0.1), (0.28, 0.06, -0.08), 0.045),
        ((-0.2, 0.13, -0.02), (0.22, 0.14, -0.06), 0.04),
    ):
        ends = [(left * open_w, hearth + y, log_z + back), (right * open_w, hearth + y2, log_z + back2)]
        piece.add(DARK_WOOD, tube(ends, r))
    flame, core = [(0.36, 0.3), (0.2, 0.65), (0.0, 1.0)], [(0.3, 0.3), (0.0, 1.0)]
    for x, size in ((-0.16, 0.5), (0.02, 0.66), (0.18, 0.44)):
        tall = open_h * size
        at = (x * open_w, hearth + 0.1, log_z - 0.04)
        piece.add(FIRE, lathe([(0.02 / tall, 0.0), *flame], scale=(tall, tall), at=at, sides=6))
    for x, size in ((-0.1, 0.26), (0.1, 0.3)):
        tall = open_h * size
        at = (x * open_w, hearth + 0.1, log_z + 0.02)
        piece.add(plastic(252, 218, 90), lathe([(0.01 / tall, 0.0), *core], scale=(tall, tall), at=at, sides=5))


def mantle(piece: Draft, w: float, h: float, d: float) -> None:
    """A thick shelf on two brackets; candlesticks and a clock stand on it where there is room."""
    thick, low, x = min(0.08, h * 0.5), h * 0.3, w * 0.36
    top, room = low + thick, h - low - thick
    piece.add(piece.finish, rounded_box((0, low + thick / 2, 0), (w, thick, d), 0.012))
    bracket = [(low, d * 0.3), (low - min(low, 0.14), -d / 2), (low, -d / 2)]
    piece.add(piece.finish, both(prism(bracket, low=x - 0.03, high=x + 0.03, axis="x")))
    holder = [(0.3, 0.0), (0.1, 0.15), (0.14, 0.5)]
    piece.add(BRASS, both(lathe(holder, scale=(room, room), at=(x, top, 0), sides=6, caps="end")))
    piece.add(WHITE, both(cylinder((x, top + room * 0.5, 0), room * 0.1, room * 0.4, sides=6)))
    piece.add(DARK_WOOD, rounded_box((0, top + room * 0.42, 0), (room * 1.1, room * 0.84, d * 0.4), room * 0.1))
    piece.add(WHITE, cylinder((0, top + room * 0.42, d * 0.2), room * 0.32, 0.006, sides=12, axis="z"))


def radiator(piece: Draft, w: float, h: float, d: float) -> None:
    """Ribs side by side between two pipes, with a valve and feet."""
    finish, foot, num = piece.finish, min(0.08, h * 0.15), max(4, min(16, round(w / 0.08)))
    step = (w - 0.08) / num
    for x in spread(num, w - 0.08):
        rib = rounded_box((x - 0.02, (foot + h) / 2, 0), (step * 0.72, h - foot, d), min(0.03, step * 0.3))
        piece.add(finish, rib)
    for y in (foot + 0.06, h - 0.06):
        piece.add(finish, tube([(-w / 2, y, 0), (w / 2 - 0.03, y, 0)], 0.018, sides=5))
    piece.add(finish, both(box((w * 0.36, foot / 2 + 0.02, 0), (0.03, foot + 0.04, d * 0.7))))
    piece.add(STEEL, tube([(w / 2 - 0.03, foot + 0.06, 0), (w / 2 - 0.02, 0.0, 0)], 0.012, sides=5))
    valve = cylinder((w / 2 - 0.05, h - 0.06, 0), 0.026, 0.05, sides=8, axis="x")
    piece.add(STEEL if is_dark(finish) else BLACK_METAL, valve)


def fan(piece: Draft, w: float, h: float, d: float) -> None:
    """A fan on a pole with a cage, or blades under the ceiling."""
    if piece.says("ceiling"):
        piece.add(DARK_METAL, lathe([(0.02, 0.0), (0.1, 0.03), (0.1, 0.1), (0.03, 0.14)], sides=10))
        piece.add(DARK_METAL, cylinder((0, 0.1, 0), 0.015, h - 0.12, sides=5))
        piece.add(DARK_METAL, cylinder((0, h - 0.03, 0), 0.07, 0.03, sides=8))
        blade = rounded_box((w * 0.28, 0.07, 0), (w * 0.4, 0.012, 0.13), 0.005)
        piece.add(piece.finish, *(blade.turned("y", k * 2 * math.pi / 5) for k in range(5)))
        return
    r, z, foot = min(w / 2, h * 0.24), d * 0.05, min(w, d) * 0.42
    y = h - r
    piece.add(piece.finish, lathe([(foot, 0.0), (foot, 0.025), (0.03, 0.05)], sides=14))
    piece.add(piece.finish, cylinder((0, 0.03, -0.02), 0.018, h - r - 0.03, sides=6))
    piece.add(piece.finish, ball((0, y, z - 0.08), (0.11, 0.11, 0.16), sides=8, rings=4))
    blade = ball((0, r * 0.45, 0), (r * 0.42, r * 0.8, 0.02), sides=6, rings=3)
    blades = [blade.turned("z", k * 2 * math.pi / 3).moved(0, y, z) for k in range(3)]
    piece.add(plastic(120, 160, 196), *blades)
    circle = [(r * math.cos(k * math.pi / 8), r * math.sin(k * math.pi / 8)) for k in range(16)]
    for s, dz in ((0.97, 0.0), (0.8, 0.06), (0.4, 0.08)):
        hoop = [(s * a, y + s * b, z + dz) for a, b in circle]
        piece.add(STEEL, tube(hoop, 0.006, sides=3, is_closed=True))
    for a, b in circle[::2]:
        spoke = [(0.0, y, z + 0.08), (0.8 * a, y + 0.8 * b, z + 0.06), (0.97 * a, y + 0.97 * b, z)]
        piece.add(STEEL, tube(spoke, 0.004, sides=3))
