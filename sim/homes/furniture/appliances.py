"""Refrigerators, ovens, washing machines and other machines of kitchen and bath."""

import math

from sim.homes.plan import Finish

from .joinery import bar_handle
from .lofts import ball, cylinder, lathe, loft, ring, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, BLACK_METAL, DARK_GLASS, DARK_METAL, LIT_SCREEN, SHEEN, STEEL, WHITE, is_dark, plain
from .shapes import Shape, box, merged, rounded_box, slab

_HANDLE = Finish(material="metal", rgb=(150, 154, 160))


def _bar(finish: Finish) -> Finish:
    return STEEL if is_dark(finish) else _HANDLE


def refrigerator(order: Order) -> list[Part]:
    """Two doors over each other with long handles, or beside each other with a water dispenser; a low freezer's lid."""
    w, h, d = order.size
    finish = order.finish
    door_d = 0.06
    corpus = made_of(plain(finish, 0.72), box((0, h / 2, -door_d / 2), (w - 0.01, h - 0.01, d - door_d)))
    foot = made_of(BLACK, box((0, 0.025, d / 2 - 0.05), (w - 0.06, 0.05, 0.05)))
    z = d / 2 - 0.045
    if w > 0.82 or order.says("double", "side"):
        doors = [rounded_box((s * w / 4, h / 2 + 0.03, z), (w / 2 - 0.006, h - 0.06, 0.055), 0.012) for s in (-1, 1)]
        grips = [bar_handle((s * 0.045, h * 0.55, d / 2 - 0.004), h * 0.5, upright=True) for s in (-1, 1)]
        panel = box((-w / 4, h * 0.62, d / 2 - 0.017), (w * 0.24, h * 0.17, 0.006))
        spout = box((-w / 4, h * 0.66, d / 2 - 0.012), (w * 0.2, 0.03, 0.008))
        return [
            corpus,
            foot,
            made_of(finish, *doors),
            made_of(_bar(finish), *grips),
            made_of(BLACK, panel),
            made_of(LIT_SCREEN, spout),
        ]
    split = h * (0.36 if order.rng.random() < 0.5 else 0.66)
    doors = [
        rounded_box((0, (low + high) / 2, z), (w, high - low - 0.008, 0.055), 0.012)
        for low, high in ((0.06, split), (split, h))
    ]
    x = w / 2 - 0.06
    grips = []
    for low, high in ((0.06, split), (split, h)):
        length = min(0.45, (high - low) * 0.55)
        near = high - 0.08 - length / 2 if low < 0.1 else low + 0.08 + length / 2
        grips.append(bar_handle((-x, near, d / 2 - 0.004), length, upright=True))
    badge = box((0, h - 0.12, d / 2 - 0.016), (0.12, 0.025, 0.005))
    gap = box((0, split, z - 0.01), (w - 0.01, 0.012, 0.05))
    return [corpus, foot, made_of(finish, *doors), made_of(_bar(finish), *grips), made_of(DARK_METAL, badge, gap)]


def _oven_door(w: float, low: float, high: float, front: float) -> list[Part]:
    """A dark window with a handle above it, and the racks within."""
    mid, tall = (low + high) / 2, high - low
    window = box((0, mid - tall * 0.06, front - 0.012), (w * 0.76, tall * 0.6, 0.01))
    inside = [box((0, mid + tall * t, front - 0.006), (w * 0.66, 0.008, 0.004)) for t in (-0.18, 0.04)]
    grip = bar_handle((0, high - tall * 0.12, front - 0.006), w * 0.76, upright=False)
    return [made_of(DARK_GLASS, window), made_of(SHEEN, *inside), made_of(STEEL, grip)]


def _knobs(w: float, y: float, front: float, num: int) -> Shape:
    from_left = [(k + 0.5 - num / 2) * w * 0.8 / num for k in range(num)]
    found = [
        cylinder((0, 0, 0), 0.022, 0.022, top=0.018, sides=8).turned("x", math.pi / 2).moved(x, y, front - 0.023)
        for x in from_left
    ]
    return merged(found)


def oven(order: Order) -> list[Part]:
    """A built-in oven: a strip with knobs and a clock over a dark window with a handle."""
    w, h, d = order.size
    finish = order.finish
    strip = h - min(0.13, h * 0.2)
    front = d / 2 - 0.02
    shell = made_of(plain(finish, 0.8), box((0, h / 2, -0.03), (w - 0.01, h, d - 0.06)))
    door = made_of(finish, rounded_box((0, strip / 2, d / 2 - 0.045), (w, strip - 0.01, 0.04), 0.008))
    panel = made_of(finish, rounded_box((0, (strip + h) / 2, d / 2 - 0.045), (w, h - strip - 0.006, 0.04), 0.008))
    clock = made_of(LIT_SCREEN, box((0, (strip + h) / 2, d / 2 - 0.024), (w * 0.16, 0.035, 0.006)))
    mark = BLACK if not is_dark(finish) else STEEL
    sides = [made_of(mark, _knobs(w * 0.3, (strip + h) / 2, front + 0.018, 2).moved(s * w * 0.3)) for s in (-1, 1)]
    return [shell, door, panel, clock, *sides, *_oven_door(w, 0.02, strip - 0.02, d / 2 - 0.004)]


def stove(order: Order) -> list[Part]:
    """An oven under four burners with knobs at the front; low ones are a hob alone."""
    w, h, d = order.size
    finish = order.finish
    grate_h = min(0.03, h * 0.2)
    top = h - grate_h
    burners, grates = [], []
    for sx in (-1, 1):
        for sz in (-1, 1):
            x, z = sx * w * 0.24, sz * d * 0.22 - 0.01
            burners.append(cylinder((x, top - 0.004, z), w * 0.09, 0.014, sides=10))
            grates += [
                slab((x, h - 0.006, z), size, faces="+y+x-x+z-z")
                for size in ((w * 0.36, 0.012, 0.014), (0.014, 0.012, d * 0.32))
            ]
    plate = rounded_box((0, top - 0.015, 0), (w, 0.03, d), 0.008)
    parts = [
        made_of(BLACK, *burners),
        made_of(BLACK_METAL, *grates),
        made_of(finish if is_dark(finish) else plain(finish, 0.95), plate),
    ]
    if h < 0.3:
        parts.append(made_of(plain(finish, 0.7), box((0, (top - 0.03) / 2, 0), (w - 0.04, top - 0.03, d - 0.04))))
        return parts
    strip = top - 0.13
    parts.append(
        made_of(plain(finish, 0.8), box((0, (top - 0.03) / 2 + 0.02, -0.03), (w - 0.01, top - 0.07, d - 0.06)))
    )
    parts.append(
        made_of(
            finish,
            rounded_box((0, (strip + 0.16) / 2, d / 2 - 0.045), (w, strip - 0.17, 0.04), 0.008),
            rounded_box((0, (strip + top - 0.03) / 2, d / 2 - 0.045), (w, top - strip - 0.036, 0.04), 0.008),
            rounded_box((0, 0.1, d / 2 - 0.045), (w, 0.1, 0.04), 0.008),
        )
    )
    mark = BLACK if not is_dark(finish) else STEEL
    parts.append(made_of(mark, _knobs(w, (strip + top - 0.03) / 2, d / 2 - 0.002, 5)))
    return [
        *parts,
        *_oven_door(w, 0.18, strip - 0.02, d / 2 - 0.004),
        made_of(BLACK, box((0, 0.025, -0.04), (w - 0.08, 0.05, d - 0.14))),
    ]


def washing_machine(order: Order) -> list[Part]:
    """A round window in a bright ring, a drawer, a dial and a display above; two machines where the box is tall."""
    w, h, d = order.size
    if h > 1.45:
        half = order._replace(size=(w, h / 2 - 0.005, d))
        low, high = washing_machine(half), washing_machine(half)
        return [*low, *(Part(part.shape.moved(y=h / 2 + 0.005), part.finish) for part in high)]
    finish = order.finish
    strip = h * 0.83
    front = d / 2 - 0.05
    shell = rounded_box((0, h / 2, -0.025), (w, h, d - 0.05), 0.02)
    radius = min(w * 0.34, strip * 0.4)
    y = strip * 0.52
    rim = ring((0, y, front + 0.012), radius, 0.028, sides=20, around=5)
    glass = ball((0, y, front), (radius * 1.8, radius * 1.8, 0.08), sides=14, rings=4, low=-1, high=1)
    shine = box((-radius * 0.35, y + radius * 0.35, front + 0.034), (radius * 0.3, radius * 0.1, 0.004)).turned(
        "z", 0.0
    )
    line = box((0, strip, front + 0.001), (w - 0.01, 0.008, 0.004))
    drawer = slab(
        (-w * 0.28, (strip + h) / 2, front + 0.006), (w * 0.34, (h - strip) * 0.62, 0.012), faces="+z+x-x+y-y"
    )
    dial = (
        cylinder((0, 0, 0), 0.042, 0.03, top=0.036, sides=12)
        .turned("x", math.pi / 2)
        .moved(w * 0.05, (strip + h) / 2, front)
    )
    show = box((w * 0.3, (strip + h) / 2, front + 0.004), (w * 0.24, (h - strip) * 0.4, 0.006))
    foot = box((0, 0.04, front + 0.001), (w * 0.9, 0.008, 0.004))
    grip = box((radius + 0.01, y, front + 0.035), (0.03, 0.1, 0.03))
    metal = STEEL if not is_dark(finish) or finish.material != "metal" else _HANDLE
    return [
        made_of(finish, shell),
        made_of(metal, rim, dial, grip),
        made_of(DARK_GLASS, glass),
        made_of(SHEEN, shine),
        made_of(plain(finish, 0.72), line, foot),
        made_of(plain(finish, 0.88), drawer),
        made_of(BLACK, show),
    ]


def dishwasher(order: Order) -> list[Part]:
    """Its door is down by half, so that racks with plates and cups show."""
    w, h, d = order.size
    finish = order.finish
    side = 0.03
    low = h * 0.42
    walls = [box((s * (w - side) / 2, h / 2, -0.01), (side, h, d - 0.02)) for s in (-1, 1)]
    top = rounded_box((0, h - 0.04, -0.005), (w, 0.08, d - 0.01), 0.01)
    inside = slab((0, h / 2, -d / 2 + 0.02), (w - side, h, 0.02), faces="+z")
    door = rounded_box((0, low / 2 + 0.04, d / 2 - 0.035), (w - 2 * side, low - 0.08, 0.05), 0.012)
    lip = made_of(BLACK, slab((0, low - 0.012, d / 2 - 0.06), (w - 2 * side - 0.02, 0.012, 0.1), faces="+y+z"))
    grip = bar_handle((0, low - 0.07, d / 2 + 0.0), w * 0.5, upright=False)
    parts = [made_of(finish, *walls, top, door), made_of(plain(STEEL, 0.62), inside), made_of(STEEL, grip), lip]
    buttons = [box((w * (0.12 + 0.08 * k), h - 0.04, d / 2 - 0.01), (0.024, 0.016, 0.006)) for k in range(4)]
    show = box((-w * 0.26, h - 0.04, d / 2 - 0.01), (w * 0.2, 0.035, 0.006))
    parts.append(made_of(BLACK, *buttons, show))
    wires: list[Shape] = []
    plates: list[Shape] = []
    for level in (low + 0.01, low + (h - 0.1 - low) * 0.58):
        wires += [slab((0, level, z), (w - 2 * side, 0.012, 0.012), faces="+y-y+z") for z in (-d * 0.3, 0.0, d * 0.3)]
        wires += [slab((0, level + 0.05, d * 0.36), (w - 2 * side, 0.01, 0.012), faces="+y-y+z")]
    tall = (h - 0.1 - low) * 0.46
    for k in range(6):
        x = (k - 2.5) * (w - 0.14) / 6
        plate = cylinder((0, 0, 0), tall * 0.56, 0.012, sides=12).turned("z", math.pi / 2 - 0.12)
        plates.append(plate.moved(x, low + 0.03 + tall * 0.5, 0.0))
    cups = [
        cylinder((x * w, low + (h - 0.1 - low) * 0.6, 0.06), 0.045, tall * 0.55, top=0.035, sides=8)
        for x in (-0.3, -0.1, 0.1, 0.3)
    ]
    parts += [
        made_of(STEEL, *wires),
        made_of(WHITE, *plates),
        made_of(Finish(material="plastic", rgb=(92, 140, 190)), *cups),
    ]
    return parts


def microwave(order: Order) -> list[Part]:
    """A wide box: dark window with a handle, keys and a clock at the right."""
    w, h, d = order.size
    finish = order.finish
    front = d / 2 - 0.03
    shell = rounded_box((0, h / 2 + 0.005, -0.015), (w, h - 0.01, d - 0.03), 0.012)
    split = w * 0.22
    window = box((-w * 0.13, h / 2, front + 0.004), (w * 0.6, h * 0.68, 0.008))
    inner = box((-w * 0.13, h / 2, front + 0.009), (w * 0.44, h * 0.44, 0.003))
    grip = bar_handle((split - 0.03, h / 2, d / 2 - 0.006), h * 0.7, upright=True)
    clock = box((w * 0.37, h * 0.8, front + 0.004), (w * 0.18, h * 0.13, 0.006))
    keys = [
        box((w * (0.31 + 0.06 * c), h * (0.62 - 0.12 * r), front + 0.004), (w * 0.042, h * 0.075, 0.008))
        for r in range(4)
        for c in range(3)
    ]
    feet = [cylinder((a * w * 0.42, 0, b * d * 0.36), 0.014, 0.012, sides=5) for a in (-1, 1) for b in (-1, 1)]
    key = BLACK if not is_dark(finish) else STEEL
    return [
        made_of(finish, shell),
        made_of(DARK_GLASS, window),
        made_of(SHEEN, inner),
        made_of(_bar(finish), grip),
        made_of(LIT_SCREEN, clock),
        made_of(key, *keys, *feet),
    ]


def coffee_machine(order: Order) -> list[Part]:
    """A tower and a head with a spout over a glass jug of coffee."""
    w, h, d = order.size
    finish = order.finish
    base = rounded_box((0, 0.02, 0), (w, 0.04, d), 0.015)
    tower = rounded_box((0, h * 0.5, -d * 0.3), (w * 0.9, h - 0.02, d * 0.38), 0.02)
    head = rounded_box((0, h * 0.86, d * 0.08), (w * 0.9, h * 0.26, d * 0.78), 0.025)
    nozzle = cylinder((0, h * 0.66, d * 0.16), 0.022, h * 0.1, top=0.034, sides=8)
    r = min(w * 0.36, d * 0.28)
    tall = h * 0.5
    jug = lathe(
        [(r * 0.9, 0.0), (r, tall * 0.3), (r * 0.96, tall * 0.62), (r * 0.6, tall), (r * 0.66, tall * 1.08)],
        at=(0, 0.045, d * 0.16),
        sides=10,
    )
    coffee = Finish(material="plastic", rgb=(64, 40, 28))
    grip = tube(
        [
            (r, tall * 0.95, d * 0.16),
            (r + 0.04, tall * 0.9, d * 0.2),
            (r + 0.035, tall * 0.45, d * 0.2),
            (r * 0.95, tall * 0.4, d * 0.16),
        ],
        0.01,
        sides=5,
    )
    light = box((-w * 0.22, h * 0.88, d * 0.475), (0.03, 0.03, 0.006))
    knob = cylinder((0, 0, 0), 0.026, 0.02, sides=8).turned("x", math.pi / 2).moved(w * 0.14, h * 0.88, d * 0.465)
    return [
        made_of(finish, base, tower, head),
        made_of(BLACK, nozzle, grip),
        made_of(coffee, jug),
        made_of(STEEL, knob),
        made_of(Finish(material="plastic", rgb=(220, 60, 40)), light),
    ]


def boiler(order: Order) -> list[Part]:
    """An upright tank with pipes, a gauge and a valve."""
    w, h, d = order.size
    r = min(w, d) * 0.44
    foot, top = 0.1, h - 0.16
    profile = [(r * 0.7, foot), (r, foot + 0.05), (r, top - 0.06), (r * 0.75, top), (r * 0.2, top + 0.02)]
    tank = lathe(profile, sides=18)
    props = [cylinder((a * r * 0.6, 0, b * r * 0.6), 0.025, foot + 0.03, sides=6) for a in (-1, 1) for b in (-1, 1)]
    pipes = [
        tube([(s * r * 0.45, top - 0.02, 0), (s * r * 0.45, h - 0.05, 0), (s * r * 0.45, h - 0.03, -d * 0.45)], 0.024)
        for s in (-1, 1)
    ]
    bands = [cylinder((0, y, 0), r * 1.01, 0.02, sides=18) for y in (foot + 0.12, top - 0.14)]
    gauge = cylinder((0, 0, 0), 0.07, 0.03, sides=12).turned("x", math.pi / 2).moved(0, h * 0.62, r - 0.005)
    hand = box((0.012, h * 0.62 + 0.014, r + 0.028), (0.008, 0.05, 0.004))
    panel = box((0, h * 0.38, r - 0.005), (r * 0.8, 0.16, 0.04))
    lamp = box((0, h * 0.38, r + 0.017), (0.05, 0.05, 0.006))
    copper = Finish(material="metal", rgb=(184, 108, 66))
    return [
        made_of(order.finish, tank),
        made_of(STEEL, *bands, *props),
        made_of(copper, *pipes),
        made_of(WHITE, gauge),
        made_of(BLACK, hand, panel),
        made_of(Finish(material="plastic", rgb=(230, 90, 40)), lamp),
    ]


def extractor(order: Order) -> list[Part]:
    """A hood over a stove: a flat pyramid under a chimney, with buttons and a light."""
    w, h, d = order.size
    rings = []
    for y, a, b, back in ((0.0, 1, 1, 0), (0.06, 1, 1, 0), (h * 0.4, 0.42, 0.5, 0.25), (h, 0.42, 0.5, 0.25)):
        rings.append(
            [(sx * w / 2 * a, y, sz * d / 2 * b - d * back) for sx, sz in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        )
    hood = loft(rings, caps="both")
    buttons = [box((x, 0.03, d / 2 - 0.001), (0.02, 0.02, 0.004)) for x in (-0.06, -0.02, 0.02, 0.06)]
    return [made_of(order.finish, hood), made_of(BLACK, *buttons)]


BUILDERS: dict[str, Builder] = {
    "refrigerator": refrigerator, "oven": oven, "stove": stove, "washing machine": washing_machine,
    "dishwasher": dishwasher, "microwave": microwave, "coffee machine": coffee_machine, "boiler": boiler,
    "extractor": extractor,
}  # fmt: skip
