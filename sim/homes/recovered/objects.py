"""Places the objects of a scene as furniture near their recorded centres, on floors, walls or each other.

`Recorded` -> `Furniture`. Widths and depths come from footprints.py; unhidden.py makes all pieces visible.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim.episodes.schema import Goal
from sim.types import SUCCESS_RADIUS

from ..cells import CELL
from ..furniture.appearance import finish_from_text
from ..furniture.families import Family, Mounting, look_of
from ..plan import Furniture, Storey
from .approaches import APART, NEAR_ENOUGH, came_near
from .flights import HEADROOM
from .footprints import SMALLEST, Footprint, Points, around, fitted_footprint, in_the_way, kept_clear, moved_into
from .recorded import Recorded, original_places

_SAME_FLOOR = 0.17
"""A floor this near to the storey's floor counts as the same (metres); it is drawn at that height."""
_LOW = 0.1
"""Share of an object's view points that may be below its assumed floor."""
_TALLEST = 3.2
_TALLER = 1.7
"""Largest height of a standing thing, as a multiple of the usual one; a higher thing must hang or lie on something."""
_FLAT_MARGIN = 0.006
_LEAST_TOP = 0.42
"""Least height of a standing thing that usually is as high (metres): a map of voxels of 0.2 m climbs up to 0.4 m."""
_NEAR = 3.0
_ON_TOP = 0.25
"""Places this far above the floor are on the piece (Habitat's navmesh covers beds and couches), not in its way."""
_HANGING_LAMP = 1.55
_LOW_SCREEN = 1.15
_SURFACES: dict[Family, float] = {"bed": 0.62, "bunk bed": 0.5, "sofa": 0.5, "armchair": 0.5, "chair": 0.5, "crib": 0.4}
"""Height at which things lie on a piece, as a share of its height; 1 for all other families."""
_MATTRESS = 0.52
"""Largest height of a bed's mattress, even with a high headboard (metres; furniture/seating.py)."""
_NARROW = 2 * (NEAR_ENOUGH - CELL - APART)
"""Largest lesser side of a standing thing that the robot only came near to on top of it (metres)."""
_LEAST_HUNG = 0.55
"""Least height of a thing that hangs from the ceiling over a recorded place, even if less than HEADROOM is left."""
_RIM = 0.06
"""Height by which a piece reaches above places on top of it (metres)."""
_LIE_IF_HIGH: tuple[Family, ...] = ("box", "basket", "bin", "plant", "stove", "washing machine", "suitcase")
"""Families that stand on another piece, not on a wall, where they are too high to stand on the floor."""
_ALWAYS_STAND: tuple[Family, ...] = ("stair", "bed", "bunk bed", "wardrobe")
_LEAN: tuple[Family, ...] = ("mirror", "picture", "board", "wall shelf", "wall cabinet", "clothes", "shutter")
"""Families that usually hang but also stand on the floor."""
_SHELF = "wall shelf"
_SUPPORTS: tuple[tuple[float, str], ...] = ((0.7, "side table"), (1.3, "console table"), (math.inf, _SHELF))
"""Piece that carries a thing without a recorded support, by the height of its top above the floor."""
_SOFT: tuple[Family, ...] = ("pillow", "blanket")
_SOFT_GAP = 0.42
"""Pillows lean and blankets hang: their centres may be this far above their support (metres)."""
_STRETCH = 2.4
"""Largest height of a thing that reaches down to its support, as a multiple of the usual one."""
_ON_CABINET: tuple[Family, ...] = ("tv", "monitor", "stove", "microwave", "coffee machine", "speaker")
_ON_WALL = 1.2
"""A microwave above this height without anything below hangs on a wall (metres)."""


class _Facts(NamedTuple):
    """The facts about one goal."""

    goal: Goal
    family: Family
    usual: tuple[float, float, float]
    ground: float
    """Height of the floor below the goal."""
    mounting: Mounting

    @property
    def above(self) -> float:
        return self.goal.position[1] - self.ground


def recovered_pieces(
    recorded: Recorded, storeys: Sequence[Storey]
) -> tuple[tuple[Furniture, ...], dict[str, Mounting]]:
    """A piece for every goal, and the mounting of each piece by its name.

    Pieces are in order of the goals' names. After them come supports (role `clutter`) for things that would float.
    """
    facts = [_facts(goal, storeys) for _, goal in sorted(recorded.goals.items())]
    mountings: dict[str, Mounting] = {fact.goal.object_name: fact.mounting for fact in facts}
    found = {fact.goal.object_name: _piece(fact, recorded) for fact in facts if fact.mounting != "on"}
    bases = [piece for name, piece in found.items() if mountings[name] == "floor"]
    supports: list[Furniture] = []
    number = 1 + max((goal.object_id for goal in recorded.goals.values()), default=0)
    for fact in (fact for fact in facts if fact.mounting == "on"):
        below = _support_of(fact, bases)
        found[fact.goal.object_name] = piece = _lying(fact, recorded, below)
        if below is None and fact.family == "microwave" and fact.above > _ON_WALL:
            mountings[piece.name] = "wall"
        elif below is None:
            support = _new_support(fact, piece, recorded, number=number + len(supports))
            if support is not None:
                supports.append(support)
                mountings[support.name] = "wall" if support.category == _SHELF else "floor"
    return (*(found[fact.goal.object_name] for fact in facts), *supports), mountings


def is_solid(piece: Furniture) -> bool:
    """Whether a robot can neither stand on a standing piece nor pass below it."""
    return piece.size[1] > _ON_TOP and look_of(piece.category).family != "stair"


def _facts(goal: Goal, storeys: Sequence[Storey]) -> _Facts:
    heights = original_places(goal)[:, 1]
    # some places are on top of beds and couches, but the lowest ones are on the floor
    floor_y = float(np.quantile(heights, _LOW, method="lower")) if len(heights) else goal.floor_y
    storey_y = min((storey.floor_y for storey in storeys), key=lambda y: abs(y - floor_y))
    ground = storey_y if abs(storey_y - floor_y) < _SAME_FLOOR else floor_y
    family, usual, usual_mounting = look_of(goal.object_category)
    mounting = _mounting(family, usual_mounting, goal.position[1] - ground, usual[1])
    return _Facts(goal, family, usual, ground, mounting)


def _mounting(family: Family, mounting: Mounting, above: float, height: float) -> Mounting:
    """The mounting of a thing with its centre this far above the floor: it stands, hangs or lies."""
    tall = 2 * above
    if mounting == "ceiling" or (family == "lamp" and above > _HANGING_LAMP):
        return "ceiling"
    if mounting == "on":
        return "floor" if tall <= 1.3 * height else "on"
    if mounting == "wall":
        if family == "tv":
            return "on" if above < _LOW_SCREEN else "wall"
        return "floor" if family in _LEAN and tall <= 1.6 * height else "wall"
    if tall <= min(_TALLEST, _TALLER * height) or tall - height < 0.25 or family in _ALWAYS_STAND:
        return "floor"
    return "on" if family in _LIE_IF_HIGH else "wall"


def _piece(fact: _Facts, recorded: Recorded) -> Furniture:
    """A piece on the floor, on a wall or under the ceiling."""
    _, usual_h, _ = fact.usual
    height = usual_h
    if fact.family == "flat":
        # its top stays above the floor, although its recorded centre may lie below
        height = max(usual_h, (_FLAT_MARGIN - fact.above) / 0.3, min(2 * fact.above, 0.1))
    elif fact.mounting == "floor":
        top = min(_LEAST_TOP, usual_h)
        height = 2 * fact.above if fact.above >= top / 2 else 2 * (top - fact.above)
        # the recorded floor at this place must not cover it
        height = max(height, 2 * (_walked_on_y(fact, recorded) + _RIM - fact.goal.position[1]))
    elif fact.mounting == "wall":
        height = max(0.1, min(usual_h, 2 * fact.above))
    elif fact.mounting == "ceiling":
        above_place = fact.goal.position[1] - _walked_below_y(fact, recorded)
        height = min(usual_h, max(_LEAST_HUNG, 2 * (above_place - HEADROOM)))
    return _furniture(fact, recorded, height=height)


def _walked_on_y(fact: _Facts, recorded: Recorded) -> float:
    """Height of the highest recorded place on top of a piece; -inf where there is none."""
    (x, y, z), (width, height, depth) = fact.goal.position, fact.usual
    away = np.abs(recorded.places - (x, y, z))
    on_it = (away[:, [0, 2]].max(axis=1) < min(width, depth) / 2) & (recorded.places[:, 1] > fact.ground + _ON_TOP / 2)
    on_it &= away[:, 1] < height / 2 + _RIM
    return float(recorded.places[on_it, 1].max(initial=-math.inf))


def _walked_below_y(fact: _Facts, recorded: Recorded) -> float:
    """Height of the highest recorded place below a piece; -inf where there is none."""
    (x, y, z), (width, _, depth) = fact.goal.position, fact.usual
    away = recorded.places - (x, y, z)
    below = (np.abs(away[:, [0, 2]]).max(axis=1) < max(width, depth)) & (away[:, 1] < 0)
    return float(recorded.places[below, 1].max(initial=-math.inf))


def _furniture(fact: _Facts, recorded: Recorded, *, height: float, on: Furniture | None = None) -> Furniture:
    """The piece with this height and a fitted footprint; on another piece it stays inside that piece's bounds."""
    goal = fact.goal
    x, y, z = goal.position
    footprint = _footprint(fact, recorded, height=height)
    if on is not None:
        footprint = _within(footprint, goal, on, is_soft=fact.family in _SOFT)
    caption = recorded.captions.get(goal.object_name, "")
    (width, depth), (dx, dz) = footprint.size, footprint.middle
    return Furniture(
        name=goal.object_name,
        category=goal.object_category,
        centre=(x + dx, y, z + dz),
        size=(width, height, depth),
        yaw=footprint.yaw,
        finish=finish_from_text(caption, goal.object_category),
        caption=caption,
    )


def _footprint(fact: _Facts, recorded: Recorded, *, height: float) -> Footprint:
    goal = fact.goal
    x, y, z = goal.position
    seen_from = np.array([p.agent_state.position for p in goal.original_view_points or goal.view_points])
    places = recorded.places
    near = np.abs(places - (x, fact.ground, z)).max(axis=1) <= _NEAR
    offsets = (places[near] - goal.position)[:, [0, 2]]
    is_in_the_way = in_the_way(places[near], bottom=y - height / 2, top=y + height / 2)
    if fact.mounting == "floor":
        is_in_the_way &= places[near, 1] < fact.ground + _ON_TOP
    blocked = np.zeros((0, 2)) if fact.family == "flat" else offsets[is_in_the_way]
    footprint = fitted_footprint(
        (seen_from.reshape(-1, 3) - goal.position)[:, [0, 2]],
        offsets[np.abs(places[near, 1] - fact.ground) < 0.5],
        usual=(fact.usual[0], fact.usual[2]),
        blocked=blocked,
        is_thin=fact.mounting == "wall",
    )
    if fact.mounting != "floor" or _was_reached(fact):
        return footprint
    extents = footprint.bounds[1] - footprint.bounds[0]
    extents[extents.argmin()] = min(extents.min(), _NARROW)
    return footprint._replace(bounds=footprint.bounds.mean(axis=0) + around(extents / 2))


def _was_reached(fact: _Facts) -> bool:
    """Whether the robot stood on the floor near enough to a thing, or never came as near to it."""
    places = original_places(fact.goal)
    away = np.hypot(*(places - fact.goal.position)[:, [0, 2]].T)
    is_on_floor = places[:, 1] < fact.ground + _ON_TOP
    return not came_near(fact.goal) or bool((is_on_floor & (away <= SUCCESS_RADIUS)).any())


def _support_of(fact: _Facts, bases: Sequence[Furniture]) -> Furniture | None:
    """The standing piece with the highest surface below a thing's centre, near enough to carry it."""
    x, y, z = fact.goal.position
    least = y - (_SOFT_GAP if fact.family in _SOFT else _STRETCH / 2 * fact.usual[1] + 0.05)
    fitting = [
        (surface_y(base), base.name, base)
        for base in bases
        if base.rect.grown(0.08).holds(x, z) and least <= surface_y(base) < y + 0.1
    ]
    return max(fitting, key=lambda entry: entry[:2])[2] if fitting else None


def surface_y(piece: Furniture) -> float:
    """Height at which things lie on a piece (world metres)."""
    family, height = look_of(piece.category).family, piece.size[1]
    above = height * _SURFACES.get(family, 1.0)
    return piece.centre[1] - height / 2 + (min(above, _MATTRESS) if family == "bed" else above)


def _lying(fact: _Facts, recorded: Recorded, below: Furniture | None) -> Furniture:
    """A thing that reaches down to its support; without a support it keeps its usual height."""
    usual_h, y = fact.usual[1], fact.goal.position[1]
    height = min(usual_h, 2 * fact.above)
    if below is not None:
        most = 2 * _SOFT_GAP if fact.family in _SOFT else _STRETCH * usual_h
        height = min(max(2 * (y - surface_y(below)), 0.5 * usual_h), most)
    return _furniture(fact, recorded, height=max(height, 0.03), on=below)


def _within(footprint: Footprint, goal: Goal, on: Furniture, *, is_soft: bool) -> Footprint:
    """The footprint cut to its support and moved into it; soft things take its direction."""
    (x0, z0, x1, z1), (x, _, z) = on.rect, goal.position
    extents = np.array(footprint.size)
    if is_soft:
        footprint = footprint._replace(yaw=on.yaw)
    if abs(math.sin(footprint.yaw)) > 0.5:
        extents = extents[::-1]
    outer = np.array([np.minimum([x0 - x, z0 - z], -0.1) - 0.01, np.maximum([x1 - x, z1 - z], 0.1) + 0.01])
    return footprint._replace(bounds=moved_into(outer, middle=np.array(footprint.middle), size=extents))


def _new_support(fact: _Facts, piece: Furniture, recorded: Recorded, *, number: int) -> Furniture | None:
    """A small piece below the middle of a thing without support; None where it is on the floor or no piece fits."""
    x, y, z = piece.centre
    top = y - piece.size[1] / 2
    if top - fact.ground < 0.12:
        return None
    category = next(name for limit, name in _SUPPORTS if top - fact.ground <= limit)
    if fact.family in _SOFT:
        category = "day bench"
    elif fact.family in _ON_CABINET and category != _SHELF:
        category = "credenza"
    height = 0.3 if category == _SHELF else top - fact.ground
    blocked = _blocked(recorded.places - (x, 0, z), bottom=top - height, top=top)
    rect = piece.rect
    half = np.array([max(0.4, rect.x1 - rect.x0 + 0.1), max(0.4, rect.z1 - rect.z0 + 0.1)]) / 2
    footprint = Footprint(piece.yaw, kept_clear(half, blocked, least=SMALLEST * 2 * half))
    (width, depth), (dx, dz) = footprint.size, footprint.middle
    if min(width, depth) < 0.16 or (footprint.bounds * [[1], [-1]] > 0).any():
        return None
    return Furniture(
        name=f"{category}_{number}",
        category=category,
        centre=(x + dx, top - height / 2, z + dz),
        size=(width, height, depth),
        yaw=piece.yaw,
        finish=finish_from_text("", category),
        role="clutter",
    )


def _blocked(offsets: Points, *, bottom: float, top: float) -> Points:
    """The x and z (B, 2) of the nearby `offsets` (N, 3) at which a robot's body would meet the object."""
    near = np.abs(offsets[:, [0, 2]]).max(axis=1) <= _NEAR
    return offsets[near & in_the_way(offsets, bottom=bottom, top=top)][:, [0, 2]]
