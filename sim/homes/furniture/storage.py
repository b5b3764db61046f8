"""Storage: cabinets, chests of drawers and wardrobes with fronts; bookcases, wall shelves and racks of open boards."""

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .joinery import books, carcass, doors, drawers, handle_finish, knob, legs, spread, tap
from .lofts import ball, cylinder, lathe, tube
from .palette import (
    BLACK,
    BLACK_METAL,
    CERAMIC,
    DARK_METAL,
    DARK_WOOD,
    MIRROR,
    PANE_SHEEN,
    STEEL,
    fabric,
    is_dark,
    plain,
    plastic,
)
from .shapes import Draft, both, box, four, rounded_box, slab
from .tables import basin
from .textiles import garment


def cabinet(piece: Draft, w: float, h: float, d: float) -> None:
    """A cupboard with doors, with a basin if it is for washing; low and wide ones are for a television, tall ones have
    drawers."""
    if piece.says("sink", "bathroom", "bath", "vanity") and piece.says("cabinet", "vanity"):
        _wash_cabinet(piece, w, h, d)
        return
    if piece.says("tv", "sideboard", "table", "credenza"):
        _low_cabinet(piece, w, h, d)
        return
    cols, foot, top = max(1, round(w / 0.5)), 0.07, h - 0.03
    split = h * 0.72 if h < 1.1 else h
    carcass(piece, foot, top)
    doors(piece, foot + 0.01, min(split, top) - 0.004, cols=cols, handle_at=0.8 if h < 1.1 else 0.5)
    if split < top:
        drawers(piece, split, top - 0.004, cols=cols, has_knobs=False)
    lid = Finish(material="stone", rgb=(96, 96, 100)) if piece.says("kitchen", "lower") else piece.finish
    piece.add(lid, rounded_box((0.0, h - 0.015, 0.0), (w, 0.03, d), 0.008))
    piece.add(plain(piece.finish, 0.5), box((0.0, foot / 2, -0.03), (w - 0.06, foot, d - 0.1)))


def _wash_cabinet(piece: Draft, w: float, h: float, d: float) -> None:
    """Adds doors under a top with a basin and a tap."""
    level = h - 0.13
    carcass(piece, 0.1, level - 0.03)
    doors(piece, 0.11, level - 0.04, cols=max(1, round(w / 0.42)), handle_at=0.8)
    num = 2 if piece.says("double", "two", "sinks") and w > 1.0 else 1
    for x in spread(num, num * w * 0.5):
        basin(piece, (x, level + 0.075, 0.04), (min(0.46, w * 0.62 / num * 1.3), 0.09, d * 0.66))
        tap(piece, (x, level, -d / 2 + 0.06), 0.13, 0.12)
    lid = rounded_box((0.0, level - 0.015, 0.0), (w, 0.03, d), 0.008)
    piece.add(Finish(material="stone", rgb=(226, 224, 218)), lid)
    piece.add(plain(piece.finish, 0.7), legs((w - 0.04, 0.1, d - 0.06), 0.1, side=0.05))


def _low_cabinet(piece: Draft, w: float, h: float, d: float) -> None:
    """Adds doors at both ends and open shelves with a player between them, on short legs."""
    foot, end, board = min(0.14, h * 0.25), w * 0.3, 0.028
    inner, middle = w - 2 * end, (foot + h) / 2
    piece.add(piece.finish, *(box((0.0, y, 0.0), (w, board, d)) for y in (foot + board / 2, h - board / 2)))
    piece.add(piece.finish, both(box(((w - board) / 2, middle, 0.0), (board, h - foot - 2 * board, d))))
    piece.add(piece.finish, box((0.0, middle, -0.01), (inner, 0.02, d - 0.03)))
    piece.add(plain(piece.finish, 0.55), slab((0.0, middle, -d / 2 + 0.01), (w, h - foot, 0.02), faces="+z-z"))
    piece.add(DARK_WOOD, legs((w - 0.1, foot, d - 0.06), foot, side=0.045, splay=0.02))
    block = piece.section((end, h, d))
    carcass(block, foot + board, h - board, narrower=0.01)
    doors(block, foot + board, h - board, is_framed=False)
    for s in (-1, 1):
        piece.put(block, x=s * (w - end) / 2)
    piece.add(BLACK, box((0.0, foot + board + 0.035, 0.02), (inner * 0.6, 0.06, d * 0.6)))


def chest_of_drawers(piece: Draft, w: float, h: float, d: float) -> None:
    """A chest of drawers; small ones have a drawer over an open shelf or two drawers."""
    foot, top = min(0.1, h * 0.14), h - 0.034
    is_small = w < 0.62 and h < 0.72
    rows = 2 if is_small else max(2, min(6, round((h - foot) / 0.21)))
    has_knobs, is_framed = piece.rng.random() < 0.6, piece.rng.random() < 0.4
    piece.add(piece.finish, rounded_box((0.0, h - 0.014, 0.0), (w, 0.028, d), 0.008))
    piece.add(plain(piece.finish, 0.7), legs((w - 0.02, foot, d - 0.02), foot, side=0.05))
    if not is_small or piece.rng.random() < 0.4:
        carcass(piece, foot, h - 0.028)
        drawers(piece, foot, top, rows=rows, cols=2 if w > 1.05 else 1, is_framed=is_framed, has_knobs=has_knobs)
        return
    split = h * 0.62
    middle, tall = (foot + split) / 2, split - foot
    carcass(piece, split, h - 0.028)
    drawers(piece, split, top, is_framed=is_framed, has_knobs=True)
    piece.add(piece.finish, both(box((w / 2 - 0.012, middle, -0.01), (0.024, tall, d - 0.02))))
    piece.add(piece.finish, box((0.0, foot + 0.012, -0.01), (w, 0.024, d - 0.02)))
    piece.add(plain(piece.finish, 0.55), slab((0.0, middle, -d / 2 + 0.01), (w, tall, 0.02), faces="+z-z"))
    piece.add(plastic(54, 88, 136), box((-0.04, foot + 0.05, 0.0), (w * 0.5, 0.05, d * 0.6)))
    piece.add(plastic(158, 58, 48), box((-0.02, foot + 0.09, 0.02), (w * 0.42, 0.03, d * 0.5)))


def wardrobe(piece: Draft, w: float, h: float, d: float) -> None:
    """Tall doors under a cornice, one with a mirror if the caption says so; split for a built-in refrigerator."""
    cols, foot, top = max(1, min(4, round(w / 0.5))), 0.08, h - 0.06
    carcass(piece, foot, top)
    piece.add(piece.finish, rounded_box((0.0, h - 0.03, 0.0), (w, 0.06, d), 0.015))
    piece.add(piece.finish, box((0.0, foot / 2, -0.015), (w - 0.03, foot, d - 0.05)))
    if piece.says("refrigerator", "fridge", "freezer"):
        doors(piece, foot + 0.01, h * 0.42 - 0.004, is_framed=False, handle_at=0.8)
        doors(piece, h * 0.42 + 0.004, top - 0.004, is_framed=False, handle_at=0.2)
        piece.add(STEEL, box((0.0, top - 0.16, d / 2 - 0.022), (0.12, 0.03, 0.006)))
        return
    has_drawers = w > 0.8 and piece.rng.random() < 0.5
    low = h * 0.2 if has_drawers else foot + 0.01
    doors(piece, low, top - 0.004, cols=cols, handle_at=0.42)
    if has_drawers:
        drawers(piece, foot + 0.01, low - 0.004, cols=max(1, cols - 1), has_knobs=True)
    if piece.says("mirror", "mirrors", "mirrored"):
        pane = ((w - 0.016) / cols - 0.12, top - low - 0.14, 0.008)
        piece.add(MIRROR, *(box((x, (low + top) / 2, d / 2 - 0.022), pane) for x in spread(cols, w - 0.016)))


def wall_cabinet(piece: Draft, w: float, h: float, d: float) -> None:
    """Doors with handles at their lower edge, under a cornice; two rows of doors if the cabinet is high."""
    rows = 2 if h > 1.3 else 1
    step = h / rows
    carcass(piece, 0.0, h)
    for row in range(rows):
        handle_at = 0.22 if row == rows - 1 else 0.78
        doors(piece, row * step + 0.006, (row + 1) * step - 0.006, cols=max(1, round(w / 0.45)), handle_at=handle_at)
    piece.add(piece.finish, box((0.0, h - 0.012, 0.0), (w, 0.024, d - 0.008)))


def glass_cabinet(piece: Draft, w: float, h: float, d: float) -> None:
    """A cabinet whose doors are thin frames, in front of shelves with vases, bowls and plates."""
    finish, foot, side, low = piece.finish, 0.08, 0.03, h * 0.28
    step, mid, tall, z = (w - 0.016) / 2, (low + h) / 2, h - low - 0.05, d / 2 - 0.014
    levels = np.linspace(low, h - 0.04, 4).tolist()
    piece.add(finish, both(box(((w - side) / 2, h / 2, 0), (side, h, d - 0.02))))
    piece.add(finish, *(box((0, y, 0), (w, 0.04, d - 0.01)) for y in (h - 0.02, foot)))
    piece.add(plain(finish, 0.6), slab((0, h / 2, -d / 2 + 0.012), (w - side, h, 0.02), faces="+z-z"))
    piece.add(finish, *(box((0, y, -0.02), (w - 2 * side, 0.02, d - 0.08)) for y in levels[:3]))
    posts = both(box((step / 2 - 0.022, mid, z), (0.036, tall, 0.02)))
    rails = [box((0.0, mid + e * tall / 2, z), (step, 0.04, 0.02)) for e in (-1, 1)]
    for x in (-step / 2, step / 2):
        piece.add(finish, *(bar.moved(x) for bar in (posts, *rails, box((0.0, mid, z), (0.014, tall, 0.012)))))
        piece.add(PANE_SHEEN, box((x - 0.05, mid + 0.1, d / 2 - 0.012), (0.012, (h - low) * 0.4, 0.004)))
    carcass(piece, foot, low, narrower=0.01)
    doors(piece, foot + 0.01, low - 0.012, cols=2)
    piece.add(handle_finish(finish), both(knob((0.05, mid, d / 2 - 0.008), 0.012)))
    tones = ((70, 110, 160), (236, 232, 222), (180, 120, 60))
    for level, k in np.ndindex(3, 3):
        height = (levels[1] - levels[0]) * (0.45 + 0.1 * ((level + k) % 3))
        profile = [(0.02, 0.0), (0.05, 0.4), (0.025, 0.75), (0.04, 1.0)]
        shown = lathe(profile, scale=(1.0, height), at=((k - 1) * 0.3 * w, levels[level] + 0.01, 0), sides=6)
        piece.add(Finish(material="ceramic", rgb=tones[(level + 2 * k) % 3]), shown)


def shelf(piece: Draft, w: float, h: float, d: float) -> None:
    """A bookcase: sides, back and boards, most of them full of books."""
    thick, num = 0.026, max(2, round(h / 0.36) + 1)
    gap, inner = (h - thick) / (num - 1), w - 2 * thick - 0.01
    piece.add(piece.finish, both(box(((w - thick) / 2, h / 2, 0.0), (thick, h, d))))
    piece.add(plain(piece.finish, 0.62), slab((0, h / 2, -d / 2 + 0.008), (w, h, 0.016), faces="+z-z"))
    for k in range(num):
        piece.add(piece.finish, slab((0, thick / 2 + k * gap, 0), (w - 2 * thick, thick, d), faces="+y-y+z"))
    for k in range(num - 1):
        y = thick + k * gap
        share = float(piece.rng.uniform(0.45, 0.92)) if k % 3 != 2 else 0.4
        books(piece, (-inner / 2, y, d / 2 - 0.05), inner * share, gap * 0.78, d * 0.6)
        if share < 0.65:
            _ornament(piece, (inner * 0.32, y, 0.0), gap * 0.55, k)


def _ornament(piece: Draft, foot: Vec, tall: float, kind: int) -> None:
    """Adds a small vase or box on a shelf."""
    if kind % 2:
        shape = box((0.0, tall * 0.4, 0.0), (tall, tall * 0.8, tall)).moved(*foot)
        piece.add(Finish(material="wicker", rgb=(196, 160, 110)), shape)
        return
    profile = [(0.3, 0.0), (0.42, 0.35), (0.2, 0.72), (0.28, 1.0)]
    piece.add(CERAMIC, lathe(profile, scale=(tall, tall), at=foot, sides=8))


def wall_shelf(piece: Draft, w: float, h: float, d: float) -> None:
    """Boards on brackets with books, a vase or a basket."""
    thick = 0.03
    num = 1 if h < 0.35 else 2 if h < 0.8 else 3 if h < 1.5 else max(3, round(h / 0.45))
    gap = h / num
    for k in range(num):
        y = k * gap + 0.12 if num > 1 or h > 0.3 else 0.04
        piece.add(piece.finish, rounded_box((0.0, y - thick / 2, 0.0), (w, thick, d), 0.006))
        arm = box((w * 0.36, y - thick - 0.03, -d * 0.1), (0.02, 0.02, d * 0.7))
        piece.add(BLACK_METAL, both(arm, box((w * 0.36, y - thick - 0.05, -d / 2 + 0.012), (0.03, 0.1, 0.02))))
        room = min(gap - 0.14, 0.26)
        if room > 0.06:
            books(piece, (-w / 2 + 0.04, y, d / 2 - 0.04), w * (0.4 + 0.12 * (k % 3)), room, d * 0.6)
            _ornament(piece, (w * 0.32, y, 0.0), min(room * 0.8, w * 0.2), k)


def rack(piece: Draft, w: float, h: float, d: float) -> None:
    """An open frame with slatted levels and pairs of shoes."""
    num = max(2, round(h / 0.32))
    gap = (h - 0.06) / num
    tones = ((150, 60, 50), (60, 70, 90), (210, 200, 180), (90, 120, 90))
    piece.add(piece.finish, four(box((w / 2 - 0.015, h / 2, d / 2 - 0.015), (0.03, h, 0.03))))
    for k in range(num + 1):
        y = 0.04 + k * gap
        slats = [box((0.0, y, z * d), (w - 0.04, 0.016, 0.03)) for z in (0.38, 0.13)]
        piece.add(piece.finish, both(*slats, axis="z"))
        piece.add(piece.finish, both(box((w / 2 - 0.015, y - 0.012, 0.0), (0.024, 0.02, d - 0.04))))
        if k == num or gap <= 0.15:
            continue
        for j in range(max(1, int(w / 0.3))):
            shoe = ball((0.055, y + 0.012, 0.02), (0.085, 0.14, d * 0.7), sides=6, rings=2, low=0.0)
            finish = Finish(material="leather", rgb=tones[(j + k) % 4])
            piece.add(finish, both(shoe).moved(-w / 2 + 0.16 + j * 0.28))


def clothes_rail(piece: Draft, w: float, h: float, d: float) -> None:
    """Two posts on feet, a bar, and garments on hangers."""
    metal = piece.finish if piece.finish.material in ("metal", "wood", "plastic") else STEEL
    frame, bar = DARK_METAL if is_dark(metal) else metal, h - 0.06
    piece.add(frame, tube([(-w / 2 + 0.02, bar, 0), (w / 2 - 0.02, bar, 0)], 0.015))
    piece.add(frame, both(cylinder((w / 2 - 0.05, 0.03, 0), 0.014, h - 0.05, sides=6)))
    piece.add(frame, both(box((w / 2 - 0.05, 0.02, 0), (0.04, 0.035, d))))
    tones = ((52, 82, 140), (176, 60, 56), (232, 228, 218), (70, 74, 80), (120, 150, 110))
    first, tall = int(piece.rng.integers(len(tones))), min(0.95, bar - 0.12)
    for k, x in enumerate(spread(max(2, min(5, round(w / 0.2))), w - 0.2)):
        size = (d * 0.95, tall * (0.72 + 0.07 * ((k * 2) % 5)), 0.11)
        garment(piece, (x, bar, 0.0), size, fabric(*tones[(first + k) % len(tones)]), is_across=True)
