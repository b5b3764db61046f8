"""Seats and beds: chairs, stools, benches, armchairs, sofas, beds and cribs."""

import math

from sim.homes.plan import Finish

from .joinery import feet, legs, tapered_leg, wooden
from .lofts import ball, cushion, cylinder, lathe, ring, tube
from .palette import BLACK, DARK_METAL, DARK_WOOD, LIGHT_WOOD, LINEN, STEEL, bedding, fabric, plain
from .shapes import Draft, both, box, four, rounded_box, slab


def chair(piece: Draft, w: float, h: float, d: float) -> None:
    """Four legs, a seat and a back of slats, rungs or a pad."""
    finish, seat = piece.finish, min(0.47, h * 0.5)
    is_soft = finish.material in ("fabric", "leather")
    side, lean = min(0.042, w * 0.1), d * 0.1
    x, back, front = (w - side) / 2, -d / 2 + lean + side / 2, (d - side) / 2
    posts = both(
        tapered_leg((x, seat, front), (x, 0.0, front), side),
        tapered_leg((x, seat, back), (x, 0.0, back - lean * 0.6), side),
        tapered_leg((x, h, back - lean), (x, seat, back), side),
    )
    piece.add(DARK_WOOD if is_soft else finish, posts)
    if is_soft:
        piece.add(finish, rounded_box((0.0, seat - 0.01, lean / 2), (w, 0.08, d - lean), 0.03))
        pad = (w - side, (h - seat) * 0.72, 0.05)
        piece.add(finish, rounded_box((0.0, (seat + h) / 2 + 0.06, back - lean * 0.5), pad, 0.02))
        return
    piece.add(finish, rounded_box((0.0, seat - 0.018, lean / 2), (w, 0.036, d - lean), 0.012))
    piece.add(finish, box((0.0, h - 0.05, back - lean * 0.93), (w - 0.02, 0.09, 0.024)))
    if piece.says("folding") or piece.rng.random() < 0.4:
        rungs = [box((0.0, seat + (h - seat) * t, back - lean * t), (w - 0.05, 0.05, 0.02)) for t in (0.3, 0.62)]
        piece.add(finish, *rungs)
        return
    for x in (0.12 * (w - 0.12), 0.36 * (w - 0.12)):
        slat = tapered_leg((x, h - 0.08, back - lean * 0.9), (x, seat + 0.03, back - lean * 0.05), 0.03)
        piece.add(finish, both(slat))


def office_chair(piece: Draft, w: float, h: float, d: float) -> None:
    """A seat on a gas spring over a star of five castors."""
    seat, reach = min(0.5, h * 0.5), min(w, d) / 2 - 0.035
    for k in range(5):
        angle = math.pi / 2 + 2 * math.pi * k / 5
        x, z = reach * math.cos(angle), reach * math.sin(angle)
        piece.add(DARK_METAL, tube([(0.0, 0.1, 0.0), (x, 0.065, z)], [0.026, 0.018], sides=5))
        piece.add(BLACK, ball((x, 0.032, z), (0.05, 0.064, 0.064), sides=6, rings=4))
    arm = [(w * 0.4, seat, 0.05), (w * 0.46, seat + 0.2, 0.02), (w * 0.46, seat + 0.2, -0.14)]
    piece.add(BLACK, both(tube(arm, 0.015)))
    piece.add(DARK_METAL, cylinder((0.0, 0.08, 0.0), 0.024, seat - 0.1, sides=6))
    piece.add(DARK_METAL, tube([(0, seat, -d * 0.2), (0, seat + 0.2, -d * 0.4)], 0.02))
    back = rounded_box((0.0, 0.0, 0.0), (w * 0.8, h - seat - 0.1, 0.07), 0.035).turned("x", -0.14)
    piece.add(piece.finish, rounded_box((0.0, seat, 0.03), (w * 0.84, 0.09, d * 0.78), 0.04))
    piece.add(piece.finish, back.moved(0.0, (seat + h) / 2 + 0.05, -d * 0.34))


def _upholstered(piece: Draft, w: float, h: float, d: float, *, seats: int) -> None:
    """Adds the base, arms, back and cushions of an armchair or a sofa."""
    finish = piece.finish
    arm, foot = min(0.2, w * 0.17), 0.08
    seat, back = min(0.42, h * 0.52), min(0.24, d * 0.27)
    arm_top = min(seat + 0.2, h * 0.75)
    is_corner = piece.says("l", "corner", "sectional", "chaise") and seats > 1
    base_d = d * 0.7 if is_corner else d
    z = -(d - base_d) / 2
    base_y, base_h = (foot + seat * 0.72) / 2 + 0.01, seat * 0.72 - foot + 0.06
    piece.add(DARK_WOOD, feet((w, h, base_d), foot).moved(z=z))
    piece.add(finish, rounded_box((0.0, base_y, z), (w - 0.02, base_h, base_d - 0.02), 0.02))
    left = rounded_box((-(w - arm) / 2, (foot + arm_top) / 2, z), (arm, arm_top - foot, base_d), 0.06)
    piece.add(finish, left if is_corner else both(left))
    rest = (w - 0.04, h - foot - 0.04, back)
    piece.add(finish, rounded_box((0.0, (foot + h) / 2 - 0.02, -d / 2 + back / 2), rest, 0.06))
    step, high = (w - 2 * arm) / seats, h - seat - 0.02
    for k in range(seats):
        is_long = is_corner and k == seats - 1
        x = (k + 0.5 - seats / 2) * step + (arm / 2 if is_long else 0.0)
        width, deep = step * 0.98 + (arm if is_long else 0), (d if is_long else base_d) - back - 0.01
        piece.add(finish, rounded_box((x, seat - 0.045, -d / 2 + back + deep / 2), (width, 0.15, deep), 0.045))
        pad = rounded_box((0.0, 0.0, 0.0), (width * 0.96, high, 0.15), 0.06).turned("x", -0.14)
        piece.add(finish, pad.moved(x, seat + high / 2 + 0.01, -d / 2 + back + 0.055))
        if is_long:
            at = (x, base_y, (z + base_d / 2 + d / 2) / 2 - 0.1)
            piece.add(finish, rounded_box(at, (width, base_h, d - base_d + 0.19), 0.02))


def armchair(piece: Draft, w: float, h: float, d: float) -> None:
    """One upholstered seat between arms."""
    _upholstered(piece, w, h, d, seats=1)


def sofa(piece: Draft, w: float, h: float, d: float) -> None:
    """Two or three seats and two throw cushions; L-shaped if the caption says so."""
    _upholstered(piece, w, h, d, seats=2 if w < 1.75 or piece.says("loveseat") else 3)
    seat, side = min(0.42, h * 0.52), min(0.36, h * 0.42)
    contrast = plain(piece.finish, 0.62 if sum(piece.finish.rgb) > 300 else 1.7)
    thrown = cushion((0.0, 0.0, 0.0), (side, 0.15, side), cells=4).turned("x", math.pi / 2 - 0.35)
    x = -w / 2 + min(0.2, w * 0.17) + side * 0.55
    thrown = thrown.moved(x, seat + side / 2, -d / 2 + min(0.24, d * 0.27) + 0.2)
    is_corner = piece.says("l", "corner", "sectional", "chaise")
    piece.add(contrast, thrown if is_corner else both(thrown))


def stool(piece: Draft, w: float, h: float, d: float) -> None:
    """A round or square seat on four legs with rungs."""
    is_square = piece.says("square", "rectangular") or (not piece.says("round") and piece.rng.random() < 0.3)
    thick = 0.07 if piece.finish.material in ("fabric", "leather") else 0.035
    frame, y, x, z = wooden(piece.finish, DARK_WOOD), h * 0.3, w * 0.38, d * 0.38
    piece.add(frame, both(tube([(-x, y, z), (x, y, z)], 0.011, sides=4), axis="z"))
    piece.add(frame, both(tube([(x, y, -z), (x, y, z)], 0.011, sides=4)))
    piece.add(frame, four(tube([(w * 0.272, h - thick, d * 0.272), (w * 0.43, 0.0, d * 0.43)], [0.019, 0.014])))
    if is_square:
        piece.add(piece.finish, rounded_box((0.0, h - thick / 2, 0.0), (w * 0.94, thick, d * 0.94), 0.015))
        return
    edge = min(0.02, thick / 2)
    profile = [(w / 2 - edge, h - thick), (w / 2, h - thick / 2), (w / 2 - edge, h)]
    piece.add(piece.finish, lathe(profile, sides=14, depth=d / w, caps="both"))


def bar_chair(piece: Draft, w: float, h: float, d: float) -> None:
    """A high seat with a low back and a ring for the feet."""
    seat, frame = h * 0.7, wooden(piece.finish, STEEL)
    piece.add(frame, four(tube([(w * 0.3, seat, d * 0.3), (w * 0.46, 0.0, d * 0.46)], [0.018, 0.014])))
    piece.add(frame, ring((0.0, seat * 0.38, 0.0), min(w, d) * 0.4, 0.012, axis="y"))
    piece.add(frame, both(tube([(w * 0.36, seat, -d * 0.36), (w * 0.38, h - 0.08, -d * 0.44)], 0.014)))
    piece.add(piece.finish, rounded_box((0.0, seat, 0.0), (w * 0.9, 0.07, d * 0.88), 0.03))
    piece.add(piece.finish, rounded_box((0.0, h - 0.09, -d / 2 + 0.04), (w * 0.86, 0.18, 0.05), 0.022))


def bench(piece: Draft, w: float, h: float, d: float) -> None:
    """A long seat on legs of boards, with a pad if it is upholstered; a solid block in a bathroom."""
    if piece.says("spa"):
        piece.add(piece.finish, box((0, h / 2 - 0.02, -0.01), (w - 0.02, h - 0.04, d - 0.02)))
        piece.add(plain(piece.finish, 1.12), rounded_box((0, h - 0.025, 0), (w, 0.05, d), 0.015))
        return
    has_back, is_soft = h > 0.65, piece.finish.material in ("fabric", "leather")
    frame = wooden(piece.finish, DARK_WOOD)
    thick = 0.1 if is_soft else 0.045
    seat, seat_d = (0.45, d * 0.8) if has_back else (h, d)
    z = (d - seat_d) / 2
    piece.add(frame, legs((w * 0.94, seat, seat_d), seat - thick, side=0.06).moved(z=z))
    piece.add(frame, box((0.0, seat * 0.32, z), (w * 0.84, 0.05, 0.03)))
    if has_back:
        piece.add(frame, both(tapered_leg((w * 0.45, h, -d / 2 + 0.03), (w * 0.45, 0.0, -d / 2 + 0.06), 0.05)))
        for y in (seat + (h - seat) * 0.35, seat + (h - seat) * 0.85):
            piece.add(frame, box((0.0, y, -d / 2 + 0.04), (w * 0.94, 0.07, 0.025)))
    if is_soft:
        piece.add(piece.finish, rounded_box((0.0, seat - thick / 2, z), (w, thick, seat_d), 0.04))
        return
    plank = (seat_d - 0.02) / 3
    boards = [box((0.0, seat - thick / 2, z + k * (plank + 0.01)), (w, thick, plank)) for k in (-1, 0, 1)]
    piece.add(piece.finish, *boards)


def ottoman(piece: Draft, w: float, h: float, d: float) -> None:
    """A padded block or drum on short feet, with a seam and a button."""
    finish, foot = piece.finish, min(0.06, h * 0.2)
    is_even = min(w, d) > 0.9 * max(w, d) and not piece.says("square", "rectangular")
    if piece.says("round", "circular") or (is_even and piece.rng.random() < 0.5):
        rim = [(0.97, 0.55), (0.97, 0.6), (1.0, 0.66), (0.96, 0.92), (0.5, 1.0), (0.0, 0.985)]
        piece.add(DARK_WOOD, feet(piece.size, foot, inset=w * 0.16))
        piece.add(finish, lathe([(0.94, foot / h), *rim], scale=(w / 2, h), sides=16, depth=d / w))
        return
    piece.add(DARK_WOOD, feet(piece.size, foot))
    piece.add(finish, rounded_box((0.0, (foot + h * 0.6) / 2, 0.0), (w * 0.97, h * 0.6 - foot, d * 0.97), 0.02))
    piece.add(plain(finish, 0.75), box((0.0, h * 0.6, 0.0), (w * 0.985, 0.014, d * 0.985)))
    piece.add(finish, rounded_box((0.0, h * 0.8 - 0.005, 0.0), (w, h * 0.4, d), 0.05))
    piece.add(plain(finish, 0.7), ball((0.0, h - 0.004, 0.0), (0.05, 0.016, 0.05)))


def bed(piece: Draft, w: float, h: float, d: float) -> None:
    """A frame with a headboard, a mattress, a duvet turned back, and pillows; two levels if it is a bunk bed."""
    if piece.says("bunk") and h > 1.25:  # a low box cannot hold two beds
        bunk_bed(piece, w, h, d)
        return
    finish = piece.finish
    is_cloth = finish.material in ("fabric", "carpet", "leather")
    frame = wooden(finish, DARK_WOOD if finish.material != "leather" else finish)
    cover = finish if is_cloth else bedding(piece.rng)
    rail, top, head = 0.3, min(0.52, h * 0.62), 0.07
    piece.add(frame, rounded_box((0.0, h / 2, -d / 2 + head / 2), (w, h, head), 0.02))
    piece.add(frame, both(box((w / 2 - 0.02, rail - 0.08, 0.0), (0.04, 0.18, d - 0.04))))
    piece.add(frame, box((0.0, rail - 0.06, d / 2 - 0.02), (w, 0.24, 0.04)))
    piece.add(frame, both(box((w / 2 - 0.035, rail / 2 - 0.08, d / 2 - 0.035), (0.07, rail - 0.16, 0.07))))
    panel = slab((0.0, h * 0.68, -d / 2 + head + 0.004), (w * 0.86, h * 0.4, 0.012), faces="+z+x-x+y-y")
    piece.add(plain(frame, 0.82), panel)
    piece.add(LINEN, rounded_box((0.0, (rail + top) / 2 - 0.04, 0.02), (w - 0.07, top - rail + 0.08, d - 0.13), 0.05))
    fold, cover_z = d * 0.2, d / 2 - 0.03 - d * 0.33
    piece.add(cover, rounded_box((0.0, top - 0.1, cover_z), (w, 0.26, d * 0.66), 0.06))
    piece.add(
        LINEN, rounded_box((0.0, top + 0.022, cover_z - d * 0.33 + fold / 4), (w * 0.99, 0.03, fold * 0.7), 0.014)
    )
    num = 2 if w > 1.15 else 1
    size = (min(0.62, w / num * 0.82), 0.16, min(0.42, d * 0.21))
    lying = cushion((0.0, 0.0, 0.0), size, cells=4).turned("x", 0.2)
    lying = lying.moved((num - 1) * w * 0.235, top + 0.07, -d / 2 + head + size[2] / 2 + 0.03)
    piece.add(LINEN, lying if num == 1 else both(lying))


def bunk_bed(piece: Draft, w: float, h: float, d: float) -> None:
    """Two beds, one above the other, with posts, rails and a ladder."""
    frame = wooden(piece.finish, LIGHT_WOOD)
    cover = piece.finish if piece.finish.material == "fabric" else bedding(piece.rng)
    side, end = w / 2 - 0.02, d / 2 - 0.02
    piece.add(frame, four(box((w / 2 - 0.03, h / 2, d / 2 - 0.03), (0.06, h, 0.06))))
    for level in (0.2 * h, 0.62 * h):
        piece.add(frame, both(box((side, level, 0), (0.03, 0.14, d))))
        piece.add(frame, both(box((0, level + 0.15, end), (w, 0.2, 0.03)), axis="z"))
        piece.add(LINEN, rounded_box((0, level + 0.06, 0), (w - 0.08, 0.16, d - 0.09), 0.03))
        piece.add(LINEN, cushion((0, level + 0.17, -d * 0.36), (w * 0.6, 0.13, 0.34), cells=4))
        piece.add(cover, rounded_box((0, level + 0.13, d * 0.14), (w - 0.05, 0.1, d * 0.66), 0.04))
    piece.add(frame, both(box((side, h * 0.9, 0), (0.025, 0.08, d))))
    piece.add(frame, *(box((w / 2 - 0.012, h * 0.4, z * d), (0.024, h * 0.78, 0.05)) for z in (0.2, 0.38)))
    steps = (0.14, 0.28, 0.42, 0.56, 0.7)
    piece.add(frame, *(box((w / 2 - 0.012, h * t, 0.29 * d), (0.024, 0.03, 0.16 * d)) for t in steps))


def crib(piece: Draft, w: float, h: float, d: float) -> None:
    """A child's bed with bars on all sides."""
    frame = piece.finish if piece.finish.material in ("wood", "plastic", "metal") else LIGHT_WOOD
    low, high, x, z = h * 0.3, h * 0.9, w / 2 - 0.025, d / 2 - 0.025
    middle, bar = (low + high) / 2, high - low
    piece.add(frame, four(tapered_leg((x, h, z), (x, 0, z), 0.05)))
    for y in (low, high):
        piece.add(frame, both(box((x, y, 0), (0.035, 0.05, d - 0.06))))
        piece.add(frame, both(box((0, y, z), (w - 0.06, 0.05, 0.035)), axis="z"))
    along = [-d / 2 + 0.1 + k * (d - 0.2) / 8 for k in range(9)]
    across = [-w / 2 + 0.1 + k * (w - 0.2) / 4 for k in range(5)]
    piece.add(frame, both(*(slab((x, middle, at), (0.02, bar, 0.024), faces="+x-x+z-z") for at in along)))
    ends = [slab((at, middle, z), (0.024, bar, 0.02), faces="+x-x+z-z") for at in across]
    piece.add(frame, both(*ends, axis="z"))
    piece.add(LINEN, rounded_box((0, low + 0.06, 0), (w - 0.07, 0.12, d - 0.07), 0.03))
    piece.add(LINEN, cushion((0, low + 0.16, -d * 0.33), (w * 0.6, 0.1, 0.24), cells=3))
    cover: Finish = piece.finish if piece.finish.material == "fabric" else fabric(150, 190, 214)
    piece.add(cover, rounded_box((0, low + 0.12, d * 0.16), (w - 0.1, 0.06, d * 0.55), 0.025))
