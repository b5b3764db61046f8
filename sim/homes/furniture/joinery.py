"""What many pieces share: legs, fronts of doors and drawers with their handles, knobs, taps, rows of books."""

import numpy as np

from sim.homes.plan import Finish

from .families import Vec
from .lofts import ball, cylinder, tube
from .order import Part, made_of
from .palette import BLACK_METAL, SPINES, STEEL, is_dark, plain
from .shapes import Shape, box, facets, merged, rounded_box, slab

GAP = 0.008
"""Dark gap around doors and drawers, metres."""


def legs(size: Vec, height: float, *, side: float, splay: float = 0.0, inset: float = 0.0) -> Shape:
    """Four legs under a top of `size`, thinner at their feet and `splay` metres farther out there."""
    x, z = size[0] / 2 - side / 2 - inset, size[2] / 2 - side / 2 - inset
    return merged(
        tapered_leg((sx * (x - splay), height, sz * (z - splay)), (sx * x, 0.0, sz * z), side)
        for sx in (-1, 1)
        for sz in (-1, 1)
    )


def tapered_leg(top: Vec, foot: Vec, side: float) -> Shape:
    """A square leg from its top to its foot, which is 0.65 as thick; without ends."""
    rings = [
        [(x + sx * half, y, z + sz * half) for sx, sz in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        for (x, y, z), half in ((foot, side * 0.325), (top, side * 0.5))
    ]
    low, high = np.array(rings)
    return facets(np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1))


def handle_finish(finish: Finish) -> Finish:
    """Metal that shows on a front of this finish."""
    return STEEL if is_dark(finish) else BLACK_METAL


def bar_handle(centre: Vec, length: float, *, upright: bool) -> Shape:
    """A square bar that stands off a front, which is 2.5 cm behind its centre."""
    x, y, z = centre
    bar = (0.016, length, 0.012) if upright else (length, 0.016, 0.012)
    away = length / 2 - 0.012
    ends = [(x, y + s * away, z - 0.013) if upright else (x + s * away, y, z - 0.013) for s in (-1, 1)]
    return merged([box(centre, bar), *(slab(end, (0.012, 0.012, 0.02), faces="+x-x+y-y") for end in ends)])


def knob(centre: Vec, radius: float = 0.016) -> Shape:
    """A round knob; its centre is its radius before the front."""
    return ball(centre, (2 * radius, 2 * radius, 2 * radius), sides=6, rings=4)


def front(centre: Vec, size: Vec, *, is_framed: bool = False) -> Shape:
    """The face of a door or drawer, its back open; framed ones have a field that stands back."""
    if not is_framed:
        return slab(centre, size, faces="+x-x+y-y+z")
    x, y, z = centre
    w, h, d = size
    rim = min(0.06, w / 5, h / 5)
    deep = min(0.005, d)
    bars = [
        slab((x + s * (w - rim) / 2, y, z), (rim, h, d), faces="+y-y+z" + ("+x" if s > 0 else "-x")) for s in (1, -1)
    ]
    bars += [
        slab((x, y + s * (h - rim) / 2, z), (w - 2 * rim, rim, d), faces="+z+y" if s > 0 else "+z-y") for s in (-1, 1)
    ]
    return merged([*bars, slab((x, y, z - deep / 2), (w - 2 * rim, h - 2 * rim, d - deep), faces="+z")])


def drawer_rows(
    size: Vec, *, foot: float, top: float, rows: int, cols: int, finish: Finish, is_framed: bool, has_knobs: bool
) -> list[Part]:
    """Fronts of drawers from `foot` to `top` (metres) on a body whose front is 2 cm behind the box."""
    w, _, d = size
    step_y, step_x = (top - foot) / rows, (w - 2 * GAP) / cols
    fronts, handles = [], []
    for row in range(rows):
        for col in range(cols):
            x, y = (col + 0.5 - cols / 2) * step_x, foot + (row + 0.5) * step_y
            fronts.append(front((x, y, d / 2 - 0.034), (step_x - GAP, step_y - GAP, 0.02), is_framed=is_framed))
            if has_knobs:
                aside = step_x * 0.25 if step_x > 0.4 else 0.0
                handles += [knob((x + s * aside, y, d / 2 - 0.012)) for s in ((-1, 1) if aside else (0,))]
            else:
                length = min(0.22, step_x * 0.4)
                handles.append(bar_handle((x, y + step_y * 0.12, d / 2 - 0.007), length, upright=False))
    return [made_of(finish, *fronts), made_of(handle_finish(finish), *handles)]


def door_fronts(
    size: Vec, *, foot: float, top: float, cols: int, finish: Finish, is_framed: bool, handle_at: float = 0.5
) -> list[Part]:
    """Doors side by side from `foot` to `top`, handles beside each other; `handle_at` is their share of the height."""
    w, _, d = size
    step = (w - 2 * GAP) / cols
    height = top - foot
    doors, handles = [], []
    for col in range(cols):
        x = (col + 0.5 - cols / 2) * step
        doors.append(front((x, foot + height / 2, d / 2 - 0.034), (step - GAP, height, 0.02), is_framed=is_framed))
        side = 1 if col % 2 == 0 else -1
        x += side * (step / 2 - 0.045)
        length = min(0.2, height * 0.35)
        handles.append(bar_handle((x, foot + height * handle_at, d / 2 - 0.007), length, upright=True))
    return [made_of(finish, *doors), made_of(handle_finish(finish), *handles)]


def tap(foot: Vec, height: float, reach: float) -> Part:
    """A tap that stands at `foot` and reaches towards +z."""
    x, y, z = foot
    radius = max(0.009, height * 0.06)
    spout = tube(
        [(x, y, z), (x, y + height, z), (x, y + height * 0.97, z + reach * 0.7), (x, y + height * 0.7, z + reach)],
        radius,
    )
    lever = tube([(x + radius, y + height * 0.35, z), (x + radius + 0.05, y + height * 0.5, z)], radius * 0.7, sides=4)
    return made_of(STEEL, spout, lever)


def books(left: Vec, width: float, height: float, depth: float, rng: np.random.Generator) -> list[Part]:
    """Upright books from the corner `left` (left, bottom, front) along +x; without backs."""
    found: dict[int, list[Shape]] = {}
    at = 0.0
    while at < width - 0.015:
        thick = min(float(rng.uniform(0.025, 0.055)), width - at)
        tall, deep = height * float(rng.uniform(0.7, 1.0)), depth * float(rng.uniform(0.85, 1.0))
        middle = (left[0] + at + thick / 2, left[1] + tall / 2, left[2] - deep / 2)
        shape = slab(middle, (thick - 0.002, tall, deep), faces="+x-x+y+z")
        found.setdefault(int(rng.integers(len(SPINES))), []).append(shape)
        at += thick
    return [made_of(Finish(material="plastic", rgb=SPINES[key]), *found[key]) for key in sorted(found)]


def soft_box(centre: Vec, size: Vec, finish: Finish, *, bevel: float = 0.05) -> Part:
    """An upholstered block."""
    return made_of(finish, rounded_box(centre, size, bevel))


def feet(size: Vec, height: float, finish: Finish, *, inset: float = 0.04) -> Part:
    """Four short round feet."""
    x, z = size[0] / 2 - inset - 0.025, size[2] / 2 - inset - 0.025
    return made_of(
        finish,
        *(cylinder((sx * x, 0.0, sz * z), 0.018, height, top=0.028, sides=6) for sx in (-1, 1) for sz in (-1, 1)),
    )


def body(size: Vec, *, foot: float, top: float, finish: Finish) -> Part:
    """The corpus behind fronts, darker at its front so that gaps show."""
    w, _, d = size
    shape = box((0.0, (foot + top) / 2, -0.022), (w, top - foot, d - 0.044))
    return made_of(plain(finish, 0.8), shape)


def wooden(finish: Finish, otherwise: Finish) -> Finish:
    """The finish if it is of wood, metal or plastic, else another one: for legs of upholstered things."""
    return finish if finish.material in ("wood", "metal", "plastic", "wicker") else otherwise
