"""Parts that many pieces share: legs, fronts of doors and drawers with handles, knobs, taps, rows of books."""

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .lofts import ball, cylinder, tube
from .palette import BLACK_METAL, SPINES, STEEL, is_dark, plain, plastic
from .shapes import Draft, Shape, box, facets, four, merged, slab

GAP = 0.008
"""Dark gap around doors and drawers, metres."""


def legs(size: Vec, height: float, *, side: float, splay: float = 0.0, inset: float = 0.0) -> Shape:
    """Four legs under a top of `size`, thinner at their feet and `splay` metres farther out there."""
    x, z = size[0] / 2 - side / 2 - inset, size[2] / 2 - side / 2 - inset
    return four(tapered_leg((x - splay, height, z - splay), (x, 0.0, z), side))


def tapered_leg(top: Vec, foot: Vec, side: float) -> Shape:
    """A square leg from its top to its foot, where it is 0.65 times as thick; its ends are open."""
    rings = [
        [(x + sx * half, y, z + sz * half) for sx, sz in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        for (x, y, z), half in ((foot, side * 0.325), (top, side * 0.5))
    ]
    low, high = np.array(rings)
    return facets(np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1))


def feet(size: Vec, height: float, *, inset: float = 0.04) -> Shape:
    """Four short round feet."""
    x, z = size[0] / 2 - inset - 0.025, size[2] / 2 - inset - 0.025
    return four(cylinder((x, 0.0, z), 0.018, height, top=0.028, sides=6))


def wooden(finish: Finish, otherwise: Finish) -> Finish:
    """The finish if it is wood, metal or plastic, else `otherwise`; for legs of upholstered things."""
    return finish if finish.material in ("wood", "metal", "plastic", "wicker") else otherwise


def handle_finish(finish: Finish) -> Finish:
    """Metal that shows on a front of this finish."""
    return STEEL if is_dark(finish) else BLACK_METAL


def bar_handle(centre: Vec, length: float, *, upright: bool) -> Shape:
    """A square bar on a front that is 2.5 cm behind the bar's centre."""
    x, y, z = centre
    bar = (0.016, length, 0.012) if upright else (length, 0.016, 0.012)
    away = length / 2 - 0.012
    ends = [(x, y + s * away, z - 0.013) if upright else (x + s * away, y, z - 0.013) for s in (-1, 1)]
    return merged([box(centre, bar), *(slab(end, (0.012, 0.012, 0.02), faces="+x-x+y-y") for end in ends)])


def knob(centre: Vec, radius: float = 0.016) -> Shape:
    """A round knob; its centre is one radius in front of the front."""
    return ball(centre, (2 * radius, 2 * radius, 2 * radius), sides=6, rings=4)


def front(centre: Vec, size: Vec, *, is_framed: bool = False) -> Shape:
    """The face of a door or drawer, open at its back; a framed one has a recessed panel."""
    if not is_framed:
        return slab(centre, size, faces="+x-x+y-y+z")
    (x, y, z), (w, h, d) = centre, size
    rim, deep = min(0.06, w / 5, h / 5), min(0.005, d)
    bars = []
    for s, side, end in ((1, "+x", "+y"), (-1, "-x", "-y")):
        bars.append(slab((x + s * (w - rim) / 2, y, z), (rim, h, d), faces=f"+y-y+z{side}"))
        bars.append(slab((x, y + s * (h - rim) / 2, z), (w - 2 * rim, rim, d), faces=f"+z{end}"))
    field = slab((x, y, z - deep / 2), (w - 2 * rim, h - 2 * rim, d - deep), faces="+z")
    return merged([*bars, field])


def carcass(piece: Draft, low: float, high: float, *, narrower: float = 0.0) -> None:
    """Adds the body behind fronts from `low` to `high` (metres), darker at its front so that gaps show."""
    w, _, d = piece.size
    shape = box((0.0, (low + high) / 2, -0.022), (w - narrower, high - low, d - 0.044))
    piece.add(plain(piece.finish, 0.8), shape)


def drawers(
    piece: Draft, low: float, high: float, *, rows: int = 1, cols: int = 1, is_framed: bool = False, has_knobs: bool
) -> None:
    """Adds fronts of drawers from `low` to `high`, on a body whose front is 2 cm behind that of the box."""
    w, _, d = piece.size
    step_y, step_x = (high - low) / rows, (w - 2 * GAP) / cols
    aside = step_x * 0.25 if step_x > 0.4 else 0.0
    for row, col in np.ndindex(rows, cols):
        x, y = (col + 0.5 - cols / 2) * step_x, low + (row + 0.5) * step_y
        if has_knobs:
            handle = merged(knob((x + s * aside, y, d / 2 - 0.012)) for s in ((-1, 1) if aside else (0,)))
        else:
            handle = bar_handle((x, y + step_y * 0.12, d / 2 - 0.007), min(0.22, step_x * 0.4), upright=False)
        face = front((x, y, d / 2 - 0.034), (step_x - GAP, step_y - GAP, 0.02), is_framed=is_framed)
        piece.add(piece.finish, face)
        piece.add(handle_finish(piece.finish), handle)


def doors(
    piece: Draft, low: float, high: float, *, cols: int = 1, is_framed: bool = True, handle_at: float = 0.5
) -> None:
    """Adds doors side by side from `low` to `high`, with adjacent handles at the share `handle_at` of their height."""
    w, _, d = piece.size
    step, height = (w - 2 * GAP) / cols, high - low
    for col in range(cols):
        x, side = (col + 0.5 - cols / 2) * step, 1 if col % 2 == 0 else -1
        face = front((x, low + height / 2, d / 2 - 0.034), (step - GAP, height, 0.02), is_framed=is_framed)
        grip = (x + side * (step / 2 - 0.045), low + height * handle_at, d / 2 - 0.007)
        piece.add(piece.finish, face)
        piece.add(handle_finish(piece.finish), bar_handle(grip, min(0.2, height * 0.35), upright=True))


def tap(piece: Draft, foot: Vec, height: float, reach: float) -> None:
    """Adds a tap that stands at `foot` and reaches towards +z."""
    radius = max(0.009, height * 0.06)
    bend = [(0.0, 0.0, 0.0), (0.0, height, 0.0), (0.0, height * 0.97, reach * 0.7), (0.0, height * 0.7, reach)]
    lever = tube([(radius, height * 0.35, 0.0), (radius + 0.05, height * 0.5, 0.0)], radius * 0.7, sides=4)
    piece.add(STEEL, tube(bend, radius).moved(*foot), lever.moved(*foot))


def books(piece: Draft, left: Vec, width: float, height: float, depth: float) -> None:
    """Adds upright books from the corner `left` (left, bottom, front) along +x, open at their backs."""
    at, rng = 0.0, piece.rng
    while at < width - 0.015:
        thick = min(float(rng.uniform(0.025, 0.055)), width - at)
        tall, deep = height * float(rng.uniform(0.7, 1.0)), depth * float(rng.uniform(0.85, 1.0))
        middle = (left[0] + at + thick / 2, left[1] + tall / 2, left[2] - deep / 2)
        cover = plastic(*SPINES[int(rng.integers(len(SPINES)))])
        piece.add(cover, slab(middle, (thick - 0.002, tall, deep), faces="+x-x+y+z"))
        at += thick


def spread(num: int, width: float) -> list[float]:
    """Places along x, from the middle, of `num` things that share a width evenly."""
    return [(k + 0.5 - num / 2) * width / num for k in range(num)]
