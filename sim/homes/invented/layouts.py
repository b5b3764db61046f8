"""Floor plans of invented homes before they have walls: rectangles that tile a storey, and their connections.

Layouts are drawn with the hall along x and the stair at its north side; `turned` then mirrors and turns the whole home.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from ..plan import Rect, Stair

NUM_STEPS = 16
"""Steps of a flight; with storeys 2.8 m apart each step rises 0.175 m, less than the robot's limit of 0.2 m."""
LANDING = 1.0
"""Depth of free floor at both ends of a flight (metres)."""
_TREAD = 0.28
_STAIR_WIDTH = 1.0
HALF_WALL = 0.06
"""Half the thickness of a wall (metres)."""
_LEAST_SIDE = 2.5
"""Least side of a room (metres); corridors may be narrower."""
_CORRIDOR = 1.5

Towards = Literal["+x", "-x", "+z", "-z"]


class Layout(NamedTuple):
    """One storey as rectangles, the middle lines of its walls."""

    rects: tuple[Rect, ...]
    hubs: tuple[int, ...]
    """Rooms from which adjoining rooms are entered; doors are drawn from the first one outwards."""
    names: tuple[str, ...]
    """Names of rooms that the kind of layout gives; "" = the room is named later."""
    open_pairs: tuple[tuple[int, int], ...] = ()
    """Pairs of rooms without a wall between them."""
    is_winding: bool = False
    """Whether rooms are entered through other rooms as often as from the hubs."""


class Home(NamedTuple):
    """All storeys, and the stair between them."""

    storeys: tuple[Layout, ...]
    stair: Stair | None


def draw_home(num_storeys: int, rng: np.random.Generator) -> Home:
    """A home of one or two storeys, usually of 5 to 9 rooms; its kind, sizes and orientation are drawn."""
    home = _one_storey(rng) if num_storeys == 1 else _two_storeys(rng)
    return turned(home, mirror_x=rng.random() < 0.5, mirror_z=rng.random() < 0.5, swap=rng.random() < 0.5)


def turned(home: Home, *, mirror_x: bool, mirror_z: bool, swap: bool) -> Home:
    """The home mirrored along x and z, then with x and z swapped."""
    storeys = tuple(
        layout._replace(rects=tuple(_turned(rect, mirror_x, mirror_z, swap) for rect in layout.rects))
        for layout in home.storeys
    )
    if home.stair is None:
        return Home(storeys, None)
    sign, axis = home.stair.towards
    if (axis == "x" and mirror_x) or (axis == "z" and mirror_z):
        sign = "-" if sign == "+" else "+"
    if swap:
        axis = "z" if axis == "x" else "x"
    towards: dict[str, Towards] = {"+x": "+x", "-x": "-x", "+z": "+z", "-z": "-z"}
    rect = _turned(home.stair.rect, mirror_x, mirror_z, swap)
    return Home(storeys, home.stair.model_copy(update={"rect": rect, "towards": towards[sign + axis]}))


def landings(stair: Stair) -> tuple[Rect, Rect]:
    """The free floor before the first step and after the last step."""
    return stair.rect.beside(stair.yaw + math.pi, LANDING), stair.rect.beside(stair.yaw, LANDING)


def _turned(rect: Rect, mirror_x: bool, mirror_z: bool, swap: bool) -> Rect:
    x0, z0, x1, z1 = rect
    if mirror_x:
        x0, x1 = -x1, -x0
    if mirror_z:
        z0, z1 = -z1, -z0
    x0, z0, x1, z1 = (round(value + 0.0, 3) for value in (x0, z0, x1, z1))
    return Rect(z0, x0, z1, x1) if swap else Rect(x0, z0, x1, z1)


def _one_storey(rng: np.random.Generator) -> Home:
    kind = int(rng.integers(4))
    width = _between(rng, 9.6, 11.4)
    if kind == 0:
        return Home((_strip(width, _z_edges(rng, 1.7, 2.1), (int(rng.integers(2, 4)), 2), rng),), None)
    if kind == 1:
        return Home((_l_shaped(width, _z_edges(rng, _CORRIDOR, 1.7), rng),), None)
    if kind == 2:
        return Home((_open_plan(rng),), None)
    return Home((_rooms_off_rooms(width, rng),), None)


def _two_storeys(rng: np.random.Generator) -> Home:
    """A home with the stair in a hall between two rows of rooms, or at the far wall of the living room."""
    width = _between(rng, 9.4, 10.6)
    if rng.random() < 0.65:
        edges = _z_edges(rng, 2.7, 3.0)
        ground = _strip(width, edges, (int(rng.integers(1, 3)), 2), rng)
        upper = _strip(width, edges, ((1, 2), (2, 1), (2, 2))[int(rng.integers(3))], rng)
        kind = int(rng.integers(4))
        if kind == 0:  # the kitchen and the living room are one space
            ground = ground._replace(open_pairs=((len(ground.rects) - 2, len(ground.rects) - 1),))
        elif kind == 1:
            upper = _l_shaped(width, edges, rng, num_north=1)
        elif kind == 2:
            ground = ground._replace(is_winding=True)
        return Home((ground, upper), _stair(edges[1], width, rng))
    deep, shallow = _between(rng, 4.2, 4.8), _between(rng, 3.2, 3.7)
    num_south = int(rng.integers(2, 4))
    ground = _strip(width, (0.0, 0.0, deep, deep + shallow), (0, num_south), rng)
    ground = ground._replace(names=("living room", *ground.names[1:]), open_pairs=((0, 1),))
    hall = _between(rng, 2.4, 2.7)
    upper = _strip(width, (0.0, 0.0, hall, deep + shallow), (0, 3), rng)
    if rng.random() < 0.5:
        upper = _l_shaped(width, (0.0, 0.0, hall, deep + shallow), rng, num_north=0)
    return Home((ground, upper), _stair(0.0, width, rng))


def _stair(z: float, width: float, rng: np.random.Generator) -> Stair:
    """A flight along the wall at `z`, with room to step on and off at both ends."""
    length = NUM_STEPS * _TREAD
    x0 = _between(rng, 2.1, width - length - 2.1)
    rect = Rect(x0, round(z + HALF_WALL, 3), round(x0 + length, 3), round(z + HALF_WALL + _STAIR_WIDTH, 3))
    return Stair(storey=0, rect=rect, towards="+x", num_steps=NUM_STEPS)


def _z_edges(rng: np.random.Generator, narrowest: float, widest: float) -> tuple[float, float, float, float]:
    """z of the north wall, of both walls of the hall, and of the south wall."""
    north, hall, south = _between(rng, 3.2, 3.9), _between(rng, narrowest, widest), _between(rng, 3.3, 4.2)
    return (0.0, north, round(north + hall, 3), round(north + hall + south, 3))


def _strip(width: float, z_edges: Sequence[float], counts: tuple[int, int], rng: np.random.Generator) -> Layout:
    """A hall along x with rooms on one or both sides."""
    z0, h0, h1, z1 = z_edges
    rects = (
        Rect(0.0, h0, width, h1),
        *(Rect(a, z0, b, h0) for a, b in _split(0.0, width, counts[0], rng)),
        *(Rect(a, h1, b, z1) for a, b in _split(0.0, width, counts[1], rng)),
    )
    return Layout(rects, (0,), ("hall", *[""] * (len(rects) - 1)))


def _l_shaped(width: float, z_edges: Sequence[float], rng: np.random.Generator, *, num_north: int = 2) -> Layout:
    """A corridor along x that turns south at its end; rooms on its outside and two on its inside."""
    z0, h0, h1, z1 = z_edges
    arm = round(width - _CORRIDOR, 3)
    if z1 - h1 >= 2 * _LEAST_SIDE + 0.4 and rng.random() < 0.5:
        inside = [Rect(0.0, a, arm, b) for a, b in _split(h1, z1, 2, rng)]
    else:
        inside = [Rect(a, h1, b, z1) for a, b in _split(0.0, arm, 2, rng)]
    north = [Rect(a, z0, b, h0) for a, b in _split(0.0, width, num_north, rng)]
    rects = (Rect(0.0, h0, width, h1), Rect(arm, h1, width, z1), *north, *inside)
    return Layout(rects, (0, 1), ("hall", "corridor", *[""] * (len(rects) - 2)), open_pairs=((0, 1),))


def _open_plan(rng: np.random.Generator) -> Layout:
    """A living room that opens into kitchen and dining area on one side; bedrooms behind a corridor on the other."""
    day, night = _between(rng, 4.2, 5.2), _between(rng, 3.3, 4.0)
    depth = _between(rng, 8.6, 10.2)
    corridor = round(day + _CORRIDOR, 3)
    east = round(corridor + night, 3)
    num_day = int(rng.integers(2, 4))
    order = ["living room", "kitchen"] if num_day == 2 else ["living room", "dining room", "kitchen"]
    spans = _split(0.0, depth, num_day, rng)
    day_rooms = [Rect(0.0, a, day, b) for a, b in spans]
    night_rooms = [Rect(corridor, a, east, b) for a, b in _split(0.0, depth, 3, rng)]
    rects = (*day_rooms, Rect(day, 0.0, corridor, depth), *night_rooms)
    return Layout(
        rects,
        (0, num_day),
        (*order, "hall", "", "", ""),
        open_pairs=tuple(itertools.pairwise(range(num_day))),
    )


def _rooms_off_rooms(width: float, rng: np.random.Generator) -> Layout:
    """Two rows of rooms without a corridor; each room is entered through another room."""
    depths = _between(rng, 3.4, 4.0), _between(rng, 3.6, 4.4)
    middle, z1 = depths[0], round(sum(depths), 3)
    north = [Rect(a, 0.0, b, middle) for a, b in _split(0.0, width, 3, rng)]
    south = [Rect(a, middle, b, z1) for a, b in _split(0.0, width, int(rng.integers(2, 4)), rng)]
    rects = (*north, *south)
    hub = max(range(len(north), len(rects)), key=lambda k: rects[k].x1 - rects[k].x0)
    names = ["living room" if k == hub else "" for k in range(len(rects))]
    return Layout(rects, (hub,), tuple(names), is_winding=True)


def _split(low: float, high: float, num: int, rng: np.random.Generator) -> list[tuple[float, float]]:
    """`num` neighbouring spans of random lengths, none under _LEAST_SIDE."""
    if num == 0:
        return []
    spare = high - low - num * _LEAST_SIDE
    assert spare >= 0, (low, high, num)
    shares = rng.dirichlet(np.full(num, 4.0)) * spare + _LEAST_SIDE
    edges = [low, *(round(float(low + edge), 2) for edge in np.cumsum(shares)[:-1]), high]
    return list(itertools.pairwise(edges))


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """A random length, rounded to decimetres."""
    return round(float(rng.uniform(low, high)), 1)
