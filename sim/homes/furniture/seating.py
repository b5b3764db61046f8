"""Chairs, stools, benches, armchairs and sofas."""

import math

from .joinery import feet, legs, soft_box, tapered_leg, wooden
from .lofts import ball, cushion, cylinder, lathe, ring, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, DARK_METAL, DARK_WOOD, STEEL, plain
from .shapes import Shape, box, rounded_box


def chair(order: Order) -> list[Part]:
    """Four legs, a seat and a back of slats, rungs or a pad."""
    w, h, d = order.size
    finish, seat = order.finish, min(0.47, h * 0.5)
    frame = wooden(finish, DARK_WOOD)
    side = min(0.042, w * 0.1)
    lean = d * 0.1
    post_x, post_z = w / 2 - side / 2, -d / 2 + lean + side / 2
    front_x, front_z = post_x, d / 2 - side / 2
    bars = [
        shape
        for s in (-1, 1)
        for shape in (
            tapered_leg((s * front_x, seat, front_z), (s * front_x, 0.0, front_z), side),
            tapered_leg((s * post_x, seat, post_z), (s * post_x, 0.0, post_z - lean * 0.6), side),
            tapered_leg((s * post_x, h, post_z - lean), (s * post_x, seat, post_z), side),
        )
    ]
    middle = (seat + h) / 2
    if finish.material in ("fabric", "leather"):
        pad = rounded_box((0.0, middle + 0.06, post_z - lean * 0.5), (w - side, (h - seat) * 0.72, 0.05), 0.02)
        soft = made_of(finish, rounded_box((0.0, seat - 0.01, lean / 2), (w, 0.08, d - lean), 0.03), pad)
        return [made_of(frame, *bars), soft]
    bars.append(rounded_box((0.0, seat - 0.018, lean / 2), (w, 0.036, d - lean), 0.012))
    bars += _back_of_chair(order, seat, post_z, lean)
    return [made_of(finish, *bars)]


def _back_of_chair(order: Order, seat: float, post_z: float, lean: float) -> list[Shape]:
    """Rail at the top with upright slats, or three rungs."""
    w, h, _ = order.size
    rail = box((0.0, h - 0.05, post_z - lean * 0.93), (w - 0.02, 0.09, 0.024))
    if order.says("folding") or order.rng.random() < 0.4:
        rungs = [(0.3, 0.05), (0.62, 0.05)]
        return [rail] + [
            box((0.0, seat + (h - seat) * t, post_z - lean * t), (w - 0.05, high, 0.02)) for t, high in rungs
        ]
    low, high = seat + 0.03, h - 0.08
    slats = [x * (w - 0.12) for x in (-0.36, -0.12, 0.12, 0.36)]
    return [rail] + [tapered_leg((x, high, post_z - lean * 0.9), (x, low, post_z - lean * 0.05), 0.03) for x in slats]


def office_chair(order: Order) -> list[Part]:
    """A seat on a gas spring over a star of five castors."""
    w, h, d = order.size
    finish = order.finish
    seat = min(0.5, h * 0.5)
    reach = min(w, d) / 2 - 0.035
    star, castors = [], []
    for k in range(5):
        angle = math.pi / 2 + 2 * math.pi * k / 5
        x, z = reach * math.cos(angle), reach * math.sin(angle)
        star.append(tube([(0.0, 0.1, 0.0), (x, 0.065, z)], [0.026, 0.018], sides=5))
        castors.append(ball((x, 0.032, z), (0.05, 0.064, 0.064), sides=6, rings=4))
    arms = [
        tube([(s * w * 0.4, seat, 0.05), (s * w * 0.46, seat + 0.2, 0.02), (s * w * 0.46, seat + 0.2, -0.14)], 0.015)
        for s in (-1, 1)
    ]
    back = rounded_box((0.0, 0.0, 0.0), (w * 0.8, h - seat - 0.1, 0.07), 0.035).turned("x", -0.14)
    soft = made_of(
        finish,
        rounded_box((0.0, seat, 0.03), (w * 0.84, 0.09, d * 0.78), 0.04),
        back.moved(0.0, (seat + h) / 2 + 0.05, -d * 0.34),
    )
    column = [
        cylinder((0.0, 0.08, 0.0), 0.024, seat - 0.1, sides=6),
        tube([(0, seat, -d * 0.2), (0, seat + 0.2, -d * 0.4)], 0.02),
    ]
    return [made_of(DARK_METAL, *star, *column), made_of(BLACK, *castors, *arms), soft]


def _upholstered(order: Order, *, seats: int) -> list[Part]:
    """Base, arms, back and cushions of an armchair or a sofa."""
    w, h, d = order.size
    finish = order.finish
    arm, foot = min(0.2, w * 0.17), 0.08
    seat, back = min(0.42, h * 0.52), min(0.24, d * 0.27)
    inner = w - 2 * arm
    arm_top = min(seat + 0.2, h * 0.75)
    corner = order.says("l", "corner", "sectional", "chaise") and seats > 1
    base_d = d * 0.7 if corner else d
    z = -(d - base_d) / 2
    base = rounded_box(
        (0.0, (foot + seat * 0.72) / 2 + 0.01, z), (w - 0.02, seat * 0.72 - foot + 0.06, base_d - 0.02), 0.02
    )
    arms = [
        rounded_box((s * (w - arm) / 2, (foot + arm_top) / 2, z), (arm, arm_top - foot, base_d), 0.06)
        for s in ((-1,) if corner else (-1, 1))
    ]
    rest = rounded_box((0.0, (foot + h) / 2 - 0.02, -d / 2 + back / 2), (w - 0.04, h - foot - 0.04, back), 0.06)
    step = inner / seats
    soft = []
    for k in range(seats):
        x = -inner / 2 + step * (k + 0.5)
        long = corner and k == seats - 1
        if long:
            x += arm / 2
        width, deep = step * 0.98 + (arm if long else 0), (d if long else base_d) - back - 0.01
        soft.append(rounded_box((x, seat - 0.045, -d / 2 + back + deep / 2), (width, 0.15, deep), 0.045))
        high = h - seat - 0.02
        rest_pad = rounded_box((0.0, 0.0, 0.0), (width * 0.96, high, 0.15), 0.06).turned("x", -0.14)
        soft.append(rest_pad.moved(x, seat + high / 2 + 0.01, -d / 2 + back + 0.055))
        if long:
            base_long = (x, (foot + seat * 0.72) / 2 + 0.01, (z + base_d / 2 + d / 2) / 2 - 0.1)
            arms.append(rounded_box(base_long, (width, seat * 0.72 - foot + 0.06, d - base_d + 0.19), 0.02))
    return [
        Part(feet((w, h, base_d), foot, DARK_WOOD).shape.moved(z=z), DARK_WOOD),
        made_of(finish, base, *arms, rest),
        made_of(finish, *soft),
    ]


def armchair(order: Order) -> list[Part]:
    """One upholstered seat between arms."""
    return _upholstered(order, seats=1)


def sofa(order: Order) -> list[Part]:
    """Two or three seats, two throw cushions; L-shaped where the caption says so."""
    w, h, d = order.size
    seats = 2 if w < 1.75 or order.says("loveseat") else 3
    parts = _upholstered(order, seats=seats)
    seat, side = min(0.42, h * 0.52), min(0.36, h * 0.42)
    contrast = plain(order.finish, 0.62 if sum(order.finish.rgb) > 300 else 1.7)
    thrown = cushion((0.0, 0.0, 0.0), (side, 0.15, side), cells=4).turned("x", math.pi / 2 - 0.35)
    y, z = seat + side / 2, -d / 2 + min(0.24, d * 0.27) + 0.2
    places = [-w / 2 + min(0.2, w * 0.17) + side * 0.55]
    if not order.says("l", "corner", "sectional", "chaise"):
        places.append(-places[0])
    return [*parts, made_of(contrast, *(thrown.moved(x, y, z) for x in places))]


def stool(order: Order) -> list[Part]:
    """A round or square seat on four legs with rungs."""
    w, h, d = order.size
    is_square = order.says("square", "rectangular") or (not order.says("round") and order.rng.random() < 0.3)
    thick = 0.07 if order.finish.material in ("fabric", "leather") else 0.035
    frame = wooden(order.finish, DARK_WOOD)
    reach = 0.34
    rungs = [
        tube([(a * w * 0.38, h * 0.3, b * d * 0.38) for a, b in ends], 0.011, sides=4)
        for ends in (((-1, 1), (1, 1)), ((-1, -1), (1, -1)), ((1, -1), (1, 1)), ((-1, -1), (-1, 1)))
    ]
    posts = [
        tube([(a * w * reach * 0.8, h - thick, b * d * reach * 0.8), (a * w * 0.43, 0.0, b * d * 0.43)], [0.019, 0.014])
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    if is_square:
        seat = rounded_box((0.0, h - thick / 2, 0.0), (w * 0.94, thick, d * 0.94), 0.015)
    else:
        edge = min(0.02, thick / 2)
        profile = [(w / 2 - edge, h - thick), (w / 2, h - thick / 2), (w / 2 - edge, h)]
        seat = lathe(profile, sides=14, depth=d / w, caps="both")
    return [made_of(frame, *posts, *rungs), made_of(order.finish, seat)]


def bar_chair(order: Order) -> list[Part]:
    """A high seat with a low back and a ring for the feet."""
    w, h, d = order.size
    seat = h * 0.7
    frame = wooden(order.finish, STEEL)
    posts = [
        tube([(a * w * 0.3, seat, b * d * 0.3), (a * w * 0.46, 0.0, b * d * 0.46)], [0.018, 0.014])
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    foot_rest = ring((0.0, seat * 0.38, 0.0), min(w, d) * 0.4, 0.012, axis="y")
    rests = [tube([(s * w * 0.36, seat, -d * 0.36), (s * w * 0.38, h - 0.08, -d * 0.44)], 0.014) for s in (-1, 1)]
    soft = made_of(
        order.finish,
        rounded_box((0.0, seat, 0.0), (w * 0.9, 0.07, d * 0.88), 0.03),
        rounded_box((0.0, h - 0.09, -d / 2 + 0.04), (w * 0.86, 0.18, 0.05), 0.022),
    )
    return [made_of(frame, *posts, foot_rest, *rests), soft]


def bench(order: Order) -> list[Part]:
    """A long seat on board legs; a pad on it where it is upholstered; a solid block in a bath."""
    w, h, d = order.size
    if order.says("spa"):
        return [
            made_of(order.finish, box((0, h / 2 - 0.02, -0.01), (w - 0.02, h - 0.04, d - 0.02))),
            made_of(plain(order.finish, 1.12), rounded_box((0, h - 0.025, 0), (w, 0.05, d), 0.015)),
        ]
    soft = order.finish.material in ("fabric", "leather")
    frame = wooden(order.finish, DARK_WOOD)
    thick = 0.1 if soft else 0.045
    seat_d = d * 0.8 if h > 0.65 else d
    seat = 0.45 if h > 0.65 else h
    z = (d - seat_d) / 2
    props: list[Shape] = [legs((w * 0.94, seat, seat_d), seat - thick, side=0.06).moved(z=z)]
    props.append(box((0.0, seat * 0.32, z), (w * 0.84, 0.05, 0.03)))
    if h > 0.65:  # a bench with a back
        props += [
            tapered_leg((s * w * 0.45, h, -d / 2 + 0.03), (s * w * 0.45, 0.0, -d / 2 + 0.06), 0.05) for s in (-1, 1)
        ]
        props += [box((0.0, seat + (h - seat) * t, -d / 2 + 0.04), (w * 0.94, 0.07, 0.025)) for t in (0.35, 0.85)]
    if soft:
        top = made_of(order.finish, rounded_box((0.0, seat - thick / 2, z), (w, thick, seat_d), 0.04))
    else:
        plank = (seat_d - 0.02) / 3
        boards = [box((0.0, seat - thick / 2, z + k * (plank + 0.01)), (w, thick, plank)) for k in (-1, 0, 1)]
        top = made_of(order.finish, *boards)
    return [made_of(frame, *props), top]


def ottoman(order: Order) -> list[Part]:
    """A padded block or drum on short feet, with a seam and a button."""
    w, h, d = order.size
    finish = order.finish
    foot = min(0.06, h * 0.2)
    is_even = min(w, d) > 0.9 * max(w, d) and not order.says("square", "rectangular")
    if order.says("round", "circular") or (is_even and order.rng.random() < 0.5):
        profile = [
            (0.94, foot),
            (0.97, h * 0.55),
            (0.97, h * 0.6),
            (1.0, h * 0.66),
            (0.96, h * 0.92),
            (0.5, h),
            (0.0, h * 0.985),
        ]
        drum = lathe([(r * w / 2, y) for r, y in profile], sides=16, depth=d / w)
        return [feet(order.size, foot, DARK_WOOD, inset=w * 0.16), made_of(finish, drum)]
    seam = made_of(plain(finish, 0.75), box((0.0, h * 0.6, 0.0), (w * 0.985, 0.014, d * 0.985)))
    button = made_of(plain(finish, 0.7), ball((0.0, h - 0.004, 0.0), (0.05, 0.016, 0.05)))
    low = soft_box((0.0, (foot + h * 0.6) / 2, 0.0), (w * 0.97, h * 0.6 - foot, d * 0.97), finish, bevel=0.02)
    return [
        feet(order.size, foot, DARK_WOOD),
        low,
        seam,
        soft_box((0.0, h * 0.8 - 0.005, 0.0), (w, h * 0.4, d), finish, bevel=0.05),
        button,
    ]


BUILDERS: dict[str, Builder] = {
    "chair": chair, "office chair": office_chair, "armchair": armchair, "sofa": sofa, "stool": stool,
    "bar chair": bar_chair, "bench": bench, "ottoman": ottoman,
}  # fmt: skip
