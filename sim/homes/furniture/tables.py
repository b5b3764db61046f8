"""Tables, desks, counters and ironing boards."""

from sim.homes.plan import Finish

from .families import Vec
from .joinery import bar_handle, carcass, doors, drawers, handle_finish, legs, tap
from .lofts import cylinder, lathe, tube
from .palette import BLACK_METAL, CERAMIC, LIGHT_WOOD, STEEL, is_dark, plain, plastic
from .shapes import Draft, both, box, prism, rounded_box, slab

_GLASS = plastic(178, 208, 206)
_STONE = Finish(material="stone", rgb=(92, 92, 96))
_LIGHT_STONE = Finish(material="stone", rgb=(214, 210, 202))
_TILES = Finish(material="tile", rgb=(226, 230, 232))


def table(piece: Draft, w: float, h: float, d: float) -> None:
    """A top on four legs, or on a column if it is round; low tables have a shelf beneath."""
    finish = piece.finish
    of_glass = finish.material == "glass" or piece.says("glass")
    frame = BLACK_METAL if of_glass and finish.material != "wood" else finish
    top = _GLASS if of_glass else finish
    thick = 0.02 if of_glass else min(0.045, h / 8)
    below = h - thick
    if piece.says("round", "circular", "circle", "oval", "semicircular"):
        piece.add(top, lathe([(w / 2, below), (w / 2, h)], sides=24, depth=d / w, caps="both"))
        if h > 0.55 or w < 0.7:
            base = [(w * 0.3, 0.0), (w * 0.3, 0.02), (0.05, 0.07), (0.035, 0.12), (0.045, h * 0.5), (0.035, below)]
            piece.add(frame, lathe(base, sides=12, depth=d / w))
        else:
            piece.add(frame, legs((w * 0.72, h, d * 0.72), below, side=0.05, splay=-0.04))
        return
    side, apron = (min(0.07, w * 0.08), 0.08) if h > 0.5 else (0.05, 0.05)
    apron_y = below - apron / 2
    piece.add(top, rounded_box((0.0, h - thick / 2, 0.0), (w, thick, d), 0.008))
    piece.add(frame, legs((w, h, d), below, side=side, inset=0.03))
    if not of_glass:
        x, z = w / 2 - 0.05 - side / 2, d / 2 - 0.05 - side / 2
        piece.add(frame, both(box((0.0, apron_y, z), (2 * x, apron, 0.02)), axis="z"))
        piece.add(frame, both(box((x, apron_y, 0.0), (0.02, apron, 2 * z))))
    if h < 0.6:
        piece.add(finish if not of_glass else frame, box((0.0, h * 0.3, 0.0), (w - 0.1, 0.02, d - 0.1)))
    if piece.says("drawer", "drawers"):
        piece.add(handle_finish(finish), bar_handle((0.0, apron_y, d / 2 - 0.03), 0.14, upright=False))


def desk(piece: Draft, w: float, h: float, d: float) -> None:
    """A top on a pedestal of drawers and a side, open for the knees."""
    thick, pedestal = 0.035, min(0.42, w * 0.34)
    below = h - thick
    piece.add(piece.finish, rounded_box((0.0, h - thick / 2, 0.0), (w, thick, d), 0.008))
    piece.add(piece.finish, box((-w / 2 + 0.03, below / 2, 0.0), (0.03, below, d - 0.04)))
    piece.add(piece.finish, box((-pedestal / 2, h * 0.62, -d / 2 + 0.05), (w - pedestal - 0.06, h * 0.5, 0.018)))
    chest = piece.section((pedestal, below, d - 0.03))
    carcass(chest, 0.03, below)
    drawers(chest, 0.04, below - 0.004, rows=3, has_knobs=False)
    piece.put(chest, x=w / 2 - pedestal / 2 - 0.01)
    if piece.says("computer"):
        piece.add(piece.finish, box((-pedestal / 2, h - 0.14, d * 0.1), (w - pedestal - 0.08, 0.02, d * 0.6)))


def counter(piece: Draft, w: float, h: float, d: float) -> None:
    """Lower cabinets under a thick stone top, with a basin in bathrooms, and a tiled wall behind if it is high."""
    finish, is_high = piece.finish, h > 1.15
    has_basin = piece.says("bathroom", "sink", "sinks", "bath", "basin")
    level = h * 0.55 if is_high else h - 0.12 * has_basin
    thick = min(0.045, level / 6)
    is_stone = finish.material in ("stone", "ceramic", "tile")
    stone = finish if is_stone else (_LIGHT_STONE if is_dark(finish) else _STONE)
    base = piece.section((w - 0.02, level, d - 0.03), plain(LIGHT_WOOD) if is_stone else finish)
    cols, rail = max(2, round(w / 0.5)), level - thick - min(0.18, level * 0.22)
    carcass(base, 0.08, level - thick)
    doors(base, 0.1, rail - 0.01, cols=cols, handle_at=0.82)
    drawers(base, rail, level - thick - 0.006, cols=cols, has_knobs=False)
    piece.put(base)
    piece.add(BLACK_METAL, box((0.0, 0.04, -0.03), (w - 0.06, 0.08, d - 0.12)))
    piece.add(stone, rounded_box((0.0, level - thick / 2, 0.0), (w, thick, d), 0.01))
    if is_high:
        piece.add(_TILES, box((0.0, (level + h) / 2, -d / 2 + 0.01), (w, h - level, 0.02)))
    if has_basin:
        basin(piece, (0.0, level + 0.1, 0.05), (min(0.5, w * 0.6), 0.12, d * 0.62))
        tap(piece, (0.0, level, -d / 2 + 0.06), 0.24 if is_high else 0.12, 0.14)


def basin(piece: Draft, centre: Vec, size: Vec) -> None:
    """Adds a bowl whose rim is 0.15 of its height above `centre`, with a drain."""
    (x, y, z), (w, h, d) = centre, size
    half, rim = w / 2, min(0.025, w * 0.06)
    profile = [
        (half * 0.6, -h), (half * 0.92, -h * 0.35), (half, 0.0), (half - rim, 0.0), (half * 0.8, -h * 0.4),
        (half * 0.45, -h * 0.8), (0.0, -h * 0.86),
    ]  # fmt: skip
    piece.add(CERAMIC, lathe(profile, at=(x, y + h * 0.15, z), sides=16, depth=d / w, power=2.6))
    piece.add(STEEL, cylinder((x, y - h * 0.7, z), 0.02, 0.006, sides=6))


def ironing_board(piece: Draft, w: float, h: float, d: float) -> None:
    """A padded board with a pointed end, on crossed legs, and an iron on it."""
    half, board, x = d / 2, h - 0.13, -w * 0.26
    side = [(0.75, -w / 2), (1.0, -w / 2 + 0.06), (1.0, w * 0.18), (0.55, w * 0.4), (0.16, w / 2)]
    ring = [*((half * z, along) for z, along in side), *((-half * z, along) for z, along in reversed(side))]
    piece.add(piece.finish, prism(ring, low=board - 0.035, high=board, axis="y"))
    for s in (-1, 1):
        leg = tube([(s * w * 0.3, board - 0.03, -s * d * 0.18), (-s * w * 0.3, 0.02, -s * d * 0.18)], 0.013, sides=5)
        piece.add(STEEL, leg)
    piece.add(STEEL, both(tube([(w * 0.3, 0.015, -half * 0.9), (w * 0.3, 0.015, half * 0.9)], 0.014, sides=5)))
    piece.add(STEEL, slab((x, board + 0.004, 0), (0.2, 0.008, 0.1), faces="+z-z"))
    sole = [(-0.05, x - 0.1), (0.05, x - 0.1), (0.055, x), (0.0, x + 0.12), (-0.055, x)]
    low = board + 0.05
    grip = [(x - 0.08, low, 0), (x - 0.08, h - 0.01, 0), (x + 0.05, h - 0.015, 0), (x + 0.06, low, 0)]
    piece.add(plastic(60, 96, 160), prism(sole, low=board, high=low, axis="y"), tube(grip, 0.014))
