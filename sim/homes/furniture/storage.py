"""Cabinets, drawers, wardrobes, shelves, racks and clothes rails."""

import numpy as np

from sim.homes.plan import Finish

from .joinery import body, books, door_fronts, drawer_rows, handle_finish, knob, legs, tap
from .lofts import ball, cylinder, lathe, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK, BLACK_METAL, CERAMIC, DARK_METAL, DARK_WOOD, MIRROR, PANE_SHEEN, STEEL, is_dark, plain
from .shapes import Shape, box, rounded_box, slab
from .tables import basin
from .textiles import garment


def cabinet(order: Order) -> list[Part]:
    """A cupboard with doors; with a basin for washing; low and wide ones carry a television, tall ones have drawers."""
    w, h, d = order.size
    if order.says("sink", "bathroom", "bath", "vanity") and order.says("cabinet", "vanity"):
        return _wash_cabinet(order)
    if order.says("tv", "sideboard", "table", "credenza"):
        return _low_cabinet(order)
    finish = order.finish
    cols = max(1, round(w / 0.5))
    foot, top = 0.07, h - 0.03
    split = h * 0.72 if h < 1.1 else h
    parts = [body(order.size, foot=foot, top=top, finish=finish)]
    doors_top = min(split, top) - 0.004
    parts += door_fronts(
        order.size,
        foot=foot + 0.01,
        top=doors_top,
        cols=cols,
        finish=finish,
        is_framed=True,
        handle_at=0.8 if h < 1.1 else 0.5,
    )
    if split < top:
        parts += drawer_rows(
            order.size, foot=split, top=top - 0.004, rows=1, cols=cols, finish=finish, is_framed=False, has_knobs=False
        )
    is_kitchen = order.says("kitchen", "lower")
    slab_finish = Finish(material="stone", rgb=(96, 96, 100)) if is_kitchen else finish
    lid = rounded_box((0.0, h - 0.015, 0.0), (w, 0.03, d), 0.008)
    plinth = box((0.0, foot / 2, -0.03), (w - 0.06, foot, d - 0.1))
    return [*parts, made_of(slab_finish, lid), made_of(plain(finish, 0.5), plinth)]


def _wash_cabinet(order: Order) -> list[Part]:
    """Doors under a top with a basin and a tap."""
    w, h, d = order.size
    finish, level = order.finish, h - 0.13
    parts = [body(order.size, foot=0.1, top=level - 0.03, finish=finish)]
    parts += door_fronts(
        order.size,
        foot=0.11,
        top=level - 0.04,
        cols=max(1, round(w / 0.42)),
        finish=finish,
        is_framed=True,
        handle_at=0.8,
    )
    top = rounded_box((0.0, level - 0.015, 0.0), (w, 0.03, d), 0.008)
    feet = legs((w - 0.04, 0.1, d - 0.06), 0.1, side=0.05)
    num = 2 if order.says("double", "two", "sinks") and w > 1.0 else 1
    for k in range(num):
        x = (k + 0.5 - num / 2) * w * 0.5
        parts += basin((x, level + 0.075, 0.04), (min(0.46, w * 0.62 / num * 1.3), 0.09, d * 0.66))
        parts.append(tap((x, level, -d / 2 + 0.06), 0.13, 0.12))
    return [*parts, made_of(Finish(material="stone", rgb=(226, 224, 218)), top), made_of(plain(finish, 0.7), feet)]


def _low_cabinet(order: Order) -> list[Part]:
    """Doors at both ends, open shelves with a box and discs between them, on short legs."""
    w, h, d = order.size
    finish, foot = order.finish, min(0.14, h * 0.25)
    end = w * 0.3
    board = 0.028
    shapes = [box((0.0, y, 0.0), (w, board, d)) for y in (foot + board / 2, h - board / 2)]
    shapes += [
        box((x, (foot + h) / 2, 0.0), (board, h - foot - 2 * board, d)) for x in (-w / 2 + board / 2, w / 2 - board / 2)
    ]
    inner = w - 2 * end
    shapes.append(box((0.0, (foot + h) / 2, -0.01), (inner, 0.02, d - 0.03)))
    back = slab((0.0, (foot + h) / 2, -d / 2 + 0.01), (w, h - foot, 0.02), faces="+z-z")
    parts = [
        made_of(finish, *shapes),
        made_of(plain(finish, 0.55), back),
        made_of(DARK_WOOD, legs((w - 0.1, foot, d - 0.06), foot, side=0.045, splay=0.02)),
    ]
    for s in (-1, 1):
        door = (end, h, d)
        block = [body((end - 0.01, h, d), foot=foot + board, top=h - board, finish=finish)]
        block += door_fronts(door, foot=foot + board, top=h - board, cols=1, finish=finish, is_framed=False)
        parts += [Part(part.shape.moved(s * (w - end) / 2), part.finish) for part in block]
    player = box((0.0, foot + board + 0.035, 0.02), (inner * 0.6, 0.06, d * 0.6))
    return [*parts, made_of(BLACK, player)]


def drawers(order: Order) -> list[Part]:
    """A chest of drawers; small ones have a drawer over an open shelf or two drawers."""
    w, h, d = order.size
    finish = order.finish
    foot = min(0.1, h * 0.14)
    small = w < 0.62 and h < 0.72
    rows = 2 if small else max(2, min(6, round((h - foot) / 0.21)))
    cols = 2 if w > 1.05 else 1
    has_knobs = order.rng.random() < 0.6
    framed = order.rng.random() < 0.4
    lid = rounded_box((0.0, h - 0.014, 0.0), (w, 0.028, d), 0.008)
    props = legs((w - 0.02, foot, d - 0.02), foot, side=0.05)
    top = h - 0.034
    parts = [made_of(finish, lid), made_of(plain(finish, 0.7), props)]
    if not small or order.rng.random() < 0.4:
        return [
            *parts,
            body(order.size, foot=foot, top=h - 0.028, finish=finish),
            *drawer_rows(
                order.size,
                foot=foot,
                top=top,
                rows=rows,
                cols=cols,
                finish=finish,
                is_framed=framed,
                has_knobs=has_knobs,
            ),
        ]
    split = h * 0.62
    sides = [box((s * (w / 2 - 0.012), (foot + split) / 2, -0.01), (0.024, split - foot, d - 0.02)) for s in (-1, 1)]
    floor = box((0.0, foot + 0.012, -0.01), (w, 0.024, d - 0.02))
    back = slab((0.0, (foot + split) / 2, -d / 2 + 0.01), (w, split - foot, 0.02), faces="+z-z")
    lying = [
        box((-0.04, foot + 0.05, 0.0), (w * 0.5, 0.05, d * 0.6)),
        box((-0.02, foot + 0.09, 0.02), (w * 0.42, 0.03, d * 0.5)),
    ]
    return [
        *parts,
        body(order.size, foot=split, top=h - 0.028, finish=finish),
        *drawer_rows(order.size, foot=split, top=top, rows=1, cols=1, finish=finish, is_framed=framed, has_knobs=True),
        made_of(finish, *sides, floor),
        made_of(plain(finish, 0.55), back),
        made_of(Finish(material="plastic", rgb=(54, 88, 136)), lying[0]),
        made_of(Finish(material="plastic", rgb=(158, 58, 48)), lying[1]),
    ]


def wardrobe(order: Order) -> list[Part]:
    """Tall doors, one with a mirror where the caption says so, under a cornice; a built-in refrigerator is split."""
    w, h, d = order.size
    finish = order.finish
    cols = max(1, min(4, round(w / 0.5)))
    foot, top = 0.08, h - 0.06
    parts = [body(order.size, foot=foot, top=top, finish=finish)]
    cornice = rounded_box((0.0, h - 0.03, 0.0), (w, 0.06, d), 0.015)
    plinth = box((0.0, foot / 2, -0.015), (w - 0.03, foot, d - 0.05))
    parts.append(made_of(finish, cornice, plinth))
    if order.says("refrigerator", "fridge", "freezer"):
        split = h * 0.42
        for low, high, at in ((foot + 0.01, split - 0.004, 0.8), (split + 0.004, top - 0.004, 0.2)):
            parts += door_fronts(order.size, foot=low, top=high, cols=1, finish=finish, is_framed=False, handle_at=at)
        badge = box((0.0, top - 0.16, d / 2 - 0.022), (0.12, 0.03, 0.006))
        return [*parts, made_of(STEEL, badge)]
    has_drawers = w > 0.8 and order.rng.random() < 0.5
    low = h * 0.2 if has_drawers else foot + 0.01
    parts += door_fronts(
        order.size, foot=low, top=top - 0.004, cols=cols, finish=finish, is_framed=True, handle_at=0.42
    )
    if has_drawers:
        parts += drawer_rows(
            order.size,
            foot=foot + 0.01,
            top=low - 0.004,
            rows=1,
            cols=max(1, cols - 1),
            finish=finish,
            is_framed=False,
            has_knobs=True,
        )
    if order.says("mirror", "mirrors", "mirrored"):
        step = (w - 0.016) / cols
        panes = [
            box(((col + 0.5 - cols / 2) * step, (low + top) / 2, d / 2 - 0.022), (step - 0.12, top - low - 0.14, 0.008))
            for col in range(cols)
        ]
        parts.append(made_of(MIRROR, *panes))
    return parts


def wall_cabinet(order: Order) -> list[Part]:
    """Doors with handles at their lower edge, a light strip beneath."""
    w, h, d = order.size
    finish = order.finish
    cols = max(1, round(w / 0.45))
    rows = 2 if h > 1.3 else 1
    parts = [body(order.size, foot=0.0, top=h, finish=finish)]
    step = h / rows
    for row in range(rows):
        parts += door_fronts(
            order.size,
            foot=row * step + 0.006,
            top=(row + 1) * step - 0.006,
            cols=cols,
            finish=finish,
            is_framed=True,
            handle_at=0.22 if row == rows - 1 else 0.78,
        )
    cornice = box((0.0, h - 0.012, 0.0), (w, 0.024, d - 0.008))
    return [*parts, made_of(finish, cornice)]


def glass_cabinet(order: Order) -> list[Part]:
    """A cabinet whose doors are thin frames before shelves with vases, bowls and plates."""
    w, h, d = order.size
    finish, foot = order.finish, 0.08
    side, low = 0.03, h * 0.28
    solid = [box((s * (w - side) / 2, h / 2, 0), (side, h, d - 0.02)) for s in (-1, 1)]
    solid += [box((0, y, 0), (w, 0.04, d - 0.01)) for y in (h - 0.02, foot)]
    back = slab((0, h / 2, -d / 2 + 0.012), (w - side, h, 0.02), faces="+z-z")
    levels = np.linspace(low, h - 0.04, 4)
    boards = [box((0, y, -0.02), (w - 2 * side, 0.02, d - 0.08)) for y in levels[:3]]
    step = (w - 0.016) / 2
    frames: list[Shape] = []
    for s in (-1, 1):
        x, mid, tall = s * step / 2, (low + h) / 2, h - low - 0.05
        frames += [box((x + e * (step / 2 - 0.022), mid, d / 2 - 0.014), (0.036, tall, 0.02)) for e in (-1, 1)]
        frames += [box((x, mid + e * tall / 2, d / 2 - 0.014), (step, 0.04, 0.02)) for e in (-1, 1)]
        frames.append(box((x, mid, d / 2 - 0.014), (0.014, tall, 0.012)))
    shown: list[Part] = []
    for level, y in enumerate(levels[:3]):
        for k, x in enumerate((-0.3, 0.0, 0.3)):
            tall = (levels[1] - levels[0]) * (0.45 + 0.1 * ((level + k) % 3))
            profile = [(0.02, 0.0), (0.05, tall * 0.4), (0.025, tall * 0.75), (0.04, tall)]
            tone = ((70, 110, 160), (236, 232, 222), (180, 120, 60))[(level + 2 * k) % 3]
            shown.append(
                made_of(Finish(material="ceramic", rgb=tone), lathe(profile, at=(x * w, y + 0.01, 0), sides=6))
            )
    streaks = [
        box((s * step / 2 - 0.05, (low + h) / 2 + 0.1, d / 2 - 0.012), (0.012, (h - low) * 0.4, 0.004)) for s in (-1, 1)
    ]
    return [
        made_of(finish, *solid, *frames),
        made_of(plain(finish, 0.6), back),
        made_of(finish, *boards),
        body((w - 0.01, h, d), foot=foot, top=low, finish=finish),
        *door_fronts(order.size, foot=foot + 0.01, top=low - 0.012, cols=2, finish=finish, is_framed=True),
        *shown,
        made_of(PANE_SHEEN, *streaks),
        made_of(handle_finish(finish), *(knob((s * 0.05, (low + h) / 2, d / 2 - 0.008), 0.012) for s in (-1, 1))),
    ]


def shelf(order: Order) -> list[Part]:
    """A bookcase: sides, back and boards, most of them full of books."""
    w, h, d = order.size
    finish, thick = order.finish, 0.026
    boards = max(2, round(h / 0.36) + 1)
    gap = (h - thick) / (boards - 1)
    frame = [box((s * (w - thick) / 2, h / 2, 0.0), (thick, h, d)) for s in (-1, 1)]
    frame += [slab((0, thick / 2 + k * gap, 0), (w - 2 * thick, thick, d), faces="+y-y+z") for k in range(boards)]
    back = slab((0, h / 2, -d / 2 + 0.008), (w, h, 0.016), faces="+z-z")
    parts = [made_of(finish, *frame), made_of(plain(finish, 0.62), back)]
    inner = w - 2 * thick - 0.01
    for k in range(boards - 1):
        y = thick + k * gap
        share = float(order.rng.uniform(0.45, 0.92)) if k % 3 != 2 else 0.4
        parts += books((-inner / 2, y, d / 2 - 0.05), inner * share, gap * 0.78, d * 0.6, order.rng)
        if share < 0.65:
            parts.append(_ornament((inner * 0.32, y, 0.0), gap * 0.55, k))
    return parts


def _ornament(foot: tuple[float, float, float], tall: float, kind: int) -> Part:
    """A small vase or box on a shelf."""
    if kind % 2:
        x, y, z = foot
        return made_of(
            Finish(material="wicker", rgb=(196, 160, 110)), box((x, y + tall * 0.4, z), (tall, tall * 0.8, tall))
        )
    profile = [(0.3, 0.0), (0.42, 0.35), (0.2, 0.72), (0.28, 1.0)]
    return made_of(CERAMIC, lathe([(r * tall, y * tall) for r, y in profile], at=foot, sides=8))


def wall_shelf(order: Order) -> list[Part]:
    """Boards on brackets with books, a vase and a basket; a closet's has a rod with clothes."""
    w, h, d = order.size
    finish, thick = order.finish, 0.03
    num = 1 if h < 0.35 else 2 if h < 0.8 else 3 if h < 1.5 else max(3, round(h / 0.45))
    gap = h / num
    boards, brackets, parts = [], [], []
    for k in range(num):
        y = k * gap + 0.12 if num > 1 or h > 0.3 else 0.04
        boards.append(rounded_box((0.0, y - thick / 2, 0.0), (w, thick, d), 0.006))
        for s in (-1, 1):
            brackets.append(box((s * w * 0.36, y - thick - 0.03, -d * 0.1), (0.02, 0.02, d * 0.7)))
            brackets.append(box((s * w * 0.36, y - thick - 0.05, -d / 2 + 0.012), (0.03, 0.1, 0.02)))
        room = min(gap - 0.14, 0.26)
        if room > 0.06:
            share = 0.4 + 0.12 * (k % 3)
            parts += books((-w / 2 + 0.04, y, d / 2 - 0.04), w * share, room, d * 0.6, order.rng)
            parts.append(_ornament((w * 0.32, y, 0.0), min(room * 0.8, w * 0.2), k))
    return [made_of(finish, *boards), made_of(BLACK_METAL, *brackets), *parts]


def rack(order: Order) -> list[Part]:
    """An open frame with slatted levels: shoes below, bottles or boxes above."""
    w, h, d = order.size
    finish = order.finish
    posts = [box((a * (w / 2 - 0.015), h / 2, b * (d / 2 - 0.015)), (0.03, h, 0.03)) for a in (-1, 1) for b in (-1, 1)]
    num = max(2, round(h / 0.32))
    gap = (h - 0.06) / num
    slats, things = [], []
    for k in range(num + 1):
        y = 0.04 + k * gap
        slats += [box((0.0, y, z * d), (w - 0.04, 0.016, 0.03)) for z in (-0.38, -0.13, 0.13, 0.38)]
        slats += [box((s * (w / 2 - 0.015), y - 0.012, 0.0), (0.024, 0.02, d - 0.04)) for s in (-1, 1)]
        if k < num and gap > 0.15:
            for j in range(max(1, int(w / 0.3))):
                x = -w / 2 + 0.16 + j * 0.28
                tone = ((150, 60, 50), (60, 70, 90), (210, 200, 180), (90, 120, 90))[(j + k) % 4]
                pair = [
                    ball((x + e * 0.055, y + 0.012, 0.02), (0.085, 0.14, d * 0.7), sides=6, rings=2, low=0.0)
                    for e in (-1, 1)
                ]
                things.append(made_of(Finish(material="leather", rgb=tone), *pair))
    return [made_of(finish, *posts, *slats), *things]


def clothes_rail(order: Order) -> list[Part]:
    """Two posts on feet, a bar, and garments on hangers."""
    w, h, d = order.size
    metal = order.finish if order.finish.material in ("metal", "wood", "plastic") else STEEL
    bar = h - 0.06
    frame = [tube([(-w / 2 + 0.02, bar, 0), (w / 2 - 0.02, bar, 0)], 0.015)]
    for s in (-1, 1):
        frame.append(cylinder((s * (w / 2 - 0.05), 0.03, 0), 0.014, h - 0.05, sides=6))
        frame.append(box((s * (w / 2 - 0.05), 0.02, 0), (0.04, 0.035, d)))
    parts = [made_of(metal if not is_dark(metal) else DARK_METAL, *frame)]
    tones = ((52, 82, 140), (176, 60, 56), (232, 228, 218), (70, 74, 80), (120, 150, 110))
    first = int(order.rng.integers(len(tones)))
    num = max(2, min(5, round(w / 0.2)))
    tall = min(0.95, bar - 0.12)
    for k in range(num):
        x = (k + 0.5 - num / 2) * (w - 0.2) / num
        tone = Finish(material="fabric", rgb=tones[(first + k) % len(tones)])
        parts += garment((x, bar, 0.0), (d * 0.95, tall * (0.72 + 0.07 * ((k * 2) % 5)), 0.11), tone, is_across=True)
    return parts


BUILDERS: dict[str, Builder] = {
    "cabinet": cabinet, "drawers": drawers, "wardrobe": wardrobe, "wall cabinet": wall_cabinet,
    "glass cabinet": glass_cabinet, "shelf": shelf, "wall shelf": wall_shelf, "rack": rack,
    "clothes rail": clothes_rail,
}  # fmt: skip
