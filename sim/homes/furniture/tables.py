"""Tables, desks, counters and ironing boards."""

from sim.homes.plan import Finish

from .families import Vec
from .joinery import bar_handle, body, door_fronts, drawer_rows, handle_finish, legs, tap
from .lofts import cylinder, lathe, tube
from .order import Builder, Order, Part, made_of
from .palette import BLACK_METAL, CERAMIC, LIGHT_WOOD, STEEL, is_dark, plain
from .shapes import Shape, box, prism, rounded_box, slab

_GLASS = Finish(material="plastic", rgb=(178, 208, 206))
_STONE = Finish(material="stone", rgb=(92, 92, 96))
_LIGHT_STONE = Finish(material="stone", rgb=(214, 210, 202))


def table(order: Order) -> list[Part]:
    """A top on four legs, or on a column where it is round; low ones have a shelf beneath."""
    w, h, d = order.size
    is_round = order.says("round", "circular", "circle", "oval", "semicircular")
    of_glass = order.finish.material == "glass" or order.says("glass")
    frame = BLACK_METAL if of_glass and order.finish.material != "wood" else order.finish
    top_finish = _GLASS if of_glass else order.finish
    thick = 0.02 if of_glass else min(0.045, h / 8)
    if is_round:
        top = lathe([(w / 2, h - thick), (w / 2, h)], sides=24, depth=d / w, caps="both")
        if h > 0.55 or w < 0.7:
            base = [(w * 0.3, 0.0), (w * 0.3, 0.02), (0.05, 0.07), (0.035, 0.12), (0.045, h * 0.5), (0.035, h - thick)]
            return [made_of(top_finish, top), made_of(frame, lathe(base, sides=12, depth=d / w))]
        return [
            made_of(top_finish, top),
            made_of(frame, legs((w * 0.72, h, d * 0.72), h - thick, side=0.05, splay=-0.04)),
        ]
    top = rounded_box((0.0, h - thick / 2, 0.0), (w, thick, d), 0.008)
    side = min(0.07, w * 0.08) if h > 0.5 else 0.05
    props: list[Shape] = [legs((w, h, d), h - thick, side=side, inset=0.03)]
    apron = 0.08 if h > 0.5 else 0.05
    if not of_glass:
        reach_x, reach_z = w / 2 - 0.05 - side / 2, d / 2 - 0.05 - side / 2
        y = h - thick - apron / 2
        props += [box((0.0, y, s * reach_z), (2 * reach_x, apron, 0.02)) for s in (-1, 1)]
        props += [box((s * reach_x, y, 0.0), (0.02, apron, 2 * reach_z)) for s in (-1, 1)]
    parts = [made_of(top_finish, top), made_of(frame, *props)]
    if h < 0.6:
        parts.append(
            made_of(order.finish if not of_glass else frame, box((0.0, h * 0.3, 0.0), (w - 0.1, 0.02, d - 0.1)))
        )
    if order.says("drawer", "drawers"):
        parts.append(
            made_of(
                handle_finish(order.finish), bar_handle((0.0, h - thick - apron / 2, d / 2 - 0.03), 0.14, upright=False)
            )
        )
    return parts


def desk(order: Order) -> list[Part]:
    """A top on a pedestal of drawers and a side, open for the knees."""
    w, h, d = order.size
    finish = order.finish
    thick, pedestal = 0.035, min(0.42, w * 0.34)
    x = w / 2 - pedestal / 2 - 0.01
    top = rounded_box((0.0, h - thick / 2, 0.0), (w, thick, d), 0.008)
    side = box((-w / 2 + 0.03, (h - thick) / 2, 0.0), (0.03, h - thick, d - 0.04))
    back = box((-pedestal / 2, h * 0.62, -d / 2 + 0.05), (w - pedestal - 0.06, h * 0.5, 0.018))
    block = (pedestal, h - thick, d - 0.03)
    chest = [body(block, foot=0.03, top=h - thick, finish=finish)]
    chest += drawer_rows(
        block, foot=0.04, top=h - thick - 0.004, rows=3, cols=1, finish=finish, is_framed=False, has_knobs=False
    )
    moved = [Part(part.shape.moved(x), part.finish) for part in chest]
    parts = [made_of(finish, top), made_of(finish, side, back), *moved]
    if order.says("computer"):
        tray = box((-pedestal / 2, h - 0.14, d * 0.1), (w - pedestal - 0.08, 0.02, d * 0.6))
        parts.append(made_of(finish, tray))
    return parts


def counter(order: Order) -> list[Part]:
    """Lower cabinets under a thick stone top; a basin in it in bathrooms; a tiled wall behind where it is high."""
    w, h, d = order.size
    high = h > 1.15
    has_basin = order.says("bathroom", "sink", "sinks", "bath", "basin")
    level = h * 0.55 if high else h - 0.12 * has_basin
    thick = min(0.045, level / 6)
    finish = order.finish
    is_stone = finish.material in ("stone", "ceramic", "tile")
    stone = finish if is_stone else (_LIGHT_STONE if is_dark(finish) else _STONE)
    front_finish = plain(LIGHT_WOOD) if is_stone else finish
    base: Vec = (w - 0.02, level, d - 0.03)
    cols = max(2, round(w / 0.5))
    parts = [body(base, foot=0.08, top=level - thick, finish=front_finish)]
    rail = level - thick - min(0.18, level * 0.22)
    parts += door_fronts(
        base, foot=0.1, top=rail - 0.01, cols=cols, finish=front_finish, is_framed=True, handle_at=0.82
    )
    parts += drawer_rows(
        base,
        foot=rail,
        top=level - thick - 0.006,
        rows=1,
        cols=cols,
        finish=front_finish,
        is_framed=False,
        has_knobs=False,
    )
    parts.append(made_of(BLACK_METAL, box((0.0, 0.04, -0.03), (w - 0.06, 0.08, d - 0.12))))
    parts.append(made_of(stone, rounded_box((0.0, level - thick / 2, 0.0), (w, thick, d), 0.01)))
    if high:
        tiles = Finish(material="tile", rgb=(226, 230, 232))
        parts.append(made_of(tiles, box((0.0, (level + h) / 2, -d / 2 + 0.01), (w, h - level, 0.02))))
    if has_basin:
        parts += basin((0.0, level + 0.1, 0.05), (min(0.5, w * 0.6), 0.12, d * 0.62))
        parts.append(tap((0.0, level, -d / 2 + 0.06), 0.24 if high else 0.12, 0.14))
    return parts


def basin(centre: Vec, size: Vec) -> list[Part]:
    """A bowl that stands on something, `centre` in the middle of its rim's height less half its own."""
    x, y, z = centre
    w, h, d = size
    half, rim = w / 2, min(0.025, w * 0.06)
    profile = [
        (half * 0.6, -h), (half * 0.92, -h * 0.35), (half, 0.0), (half - rim, 0.0), (half * 0.8, -h * 0.4),
        (half * 0.45, -h * 0.8), (0.0, -h * 0.86),
    ]  # fmt: skip
    bowl = lathe(profile, at=(x, y + h * 0.15, z), sides=16, depth=d / w, power=2.6)
    drain = cylinder((x, y - h * 0.7, z), 0.02, 0.006, sides=6)
    return [made_of(CERAMIC, bowl), made_of(STEEL, drain)]


def ironing_board(order: Order) -> list[Part]:
    """A padded board with a pointed end on crossed legs, an iron on it."""
    w, h, d = order.size
    half, board = d / 2, h - 0.13
    nose = [(-half * 0.75, -w / 2), (half * 0.75, -w / 2)]
    outline = [(half, -w / 2 + 0.06), (half, w * 0.18), (half * 0.55, w * 0.4), (half * 0.16, w / 2)]
    ring = [(z, x) for z, x in [*nose[1:], *outline, *[(-z, x) for z, x in reversed(outline)], nose[0]]]
    top = prism(ring, low=board - 0.035, high=board, axis="y")
    cross = [
        tube([(s * w * 0.3, board - 0.03, z), (-s * w * 0.3, 0.02, z)], 0.013, sides=5)
        for s, z in ((1, -d * 0.18), (-1, d * 0.18))
    ]
    cross += [
        tube([(s * w * 0.3, 0.015, -half * 0.9), (s * w * 0.3, 0.015, half * 0.9)], 0.014, sides=5) for s in (-1, 1)
    ]
    x = -w * 0.26
    sole = prism(
        [(-0.05, x - 0.1), (0.05, x - 0.1), (0.055, x), (0.0, x + 0.12), (-0.055, x)],
        low=board,
        high=board + 0.05,
        axis="y",
    )
    grip = tube(
        [(x - 0.08, board + 0.05, 0), (x - 0.08, h - 0.01, 0), (x + 0.05, h - 0.015, 0), (x + 0.06, board + 0.05, 0)],
        0.014,
    )
    return [
        made_of(order.finish, top),
        made_of(STEEL, *cross, slab((x, board + 0.004, 0), (0.2, 0.008, 0.1), faces="+z-z")),
        made_of(Finish(material="plastic", rgb=(60, 96, 160)), sole, grip),
    ]


BUILDERS: dict[str, Builder] = {"table": table, "desk": desk, "counter": counter, "ironing board": ironing_board}
