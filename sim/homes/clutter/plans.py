"""Fills a planned home with things without a caption, as in real homes, and blocks no path.

HomePlan -> HomePlan; household.py knows the usual things of each room, space.py finds space for them.
"""

import zlib
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from sim.errors import SceneError
from sim.types import ClutterLevel
from sim.walk.storeys import storey_of

from ..furniture.families import Family, look_of
from ..plan import Finish, Furniture, HomePlan, Rect
from .household import (
    ON_UPHOLSTERY,
    ONCE,
    SEAT_HEIGHTS,
    TOP_FAMILIES,
    UNMOVED,
    Household,
    drawn_finish,
    drawn_size,
    household_of,
)
from .space import SpareRoom, SpareStorey, empty_storeys

DENSITY: dict[ClutterLevel, float] = {1: 2.0, 2: 8.0}
"""Things per square metre of room: 5 and 20 times as many as captioned things in a home of the release (0.4)."""
DECOYS: dict[ClutterLevel, float] = {1: 0.5, 2: 1.5}
"""Number of decoys for each captioned object, of its category and in its room."""
_AT_WALLS, _HUNG = 0.12, 0.2
"""Shares of furniture and of hanging things among added things."""
_HUNG_EVERY = 1.3
"""Metres of wall for each thing that hangs there."""
_TRIES = 8
_MAX_FAILURES = 20
"""A room is full when this many things in a row have found no place."""
_APART = 60
"""Two colours are different if one channel differs by at least this (of 255)."""
_FINISHES = 16
_TOPS = (0.3, 1.5)
"""Lowest and highest surfaces on which things are put (metres)."""
_WET = ("sink", "bath", "vanity", "island")
_LOWEST_HUNG, _HUNG_AT = 1.2, 1.3
"""Least height of the lower end and of the middle of hanging things (metres): above the robot's camera, and above the
voxels of a map in which its body may be."""
_SMALL = 0.45
"""Things wider than this stand at walls (metres)."""


_T = TypeVar("_T")


class _Thing(NamedTuple):
    """A thing before it has a place."""

    category: str
    size: tuple[float, float, float]
    finish: Finish
    room: int
    """Index into the plan's rooms."""


class _Goals(NamedTuple):
    """The captioned pieces of a plan."""

    categories: frozenset[str]
    looks: dict[Family, list[Finish]]
    """Finishes of captioned pieces by family: no added piece looks like one of them."""


def with_clutter(plan: HomePlan, level: ClutterLevel, *, seed: int) -> HomePlan:
    """A home with added furniture and small things without captions, and decoys of the captioned things.

    No path becomes longer, and every captioned object stays visible from the same places. Added pieces of a captioned
    category have role `decoy` and a finish that no captioned piece has; all others have role `clutter`.

    Args:
        plan: A home without clutter.
        level: 0 = the plan unchanged; 1 and 2 add about DENSITY things per square metre where there is space.
        seed: The same plan, level and seed give the same home.

    Raises:
        SceneError: The plan has clutter of another level, or some of its rooms cannot be reached.
    """
    if level == plan.clutter or level == 0:
        return plan
    if plan.clutter or level not in DENSITY:
        raise SceneError(
            f"plan {plan.name!r}: found clutter level {plan.clutter} where {level!r} was asked for; expected a plan "
            "without clutter, and level 0, 1 or 2. Give the plan without clutter."
        )
    rng = np.random.default_rng([seed, level, zlib.crc32(plan.name.encode())])
    home = _Home(plan, rng)
    home.add_decoys(DECOYS[level])
    for number in range(len(plan.rooms)):
        home.fill_room(number, DENSITY[level])
    return plan.model_copy(update={"furniture": (*plan.furniture, *home.added), "clutter": level})


class _Home:
    """A plan while things are added to it."""

    def __init__(self, plan: HomePlan, rng: np.random.Generator) -> None:
        self.added: list[Furniture] = []
        self._plan, self._rng = plan, rng
        self._first_number = 1 + max((int(piece.name.rsplit("_", 1)[1]) for piece in plan.furniture), default=0)
        storey_of = _storeys_of(plan)
        captioned = [piece for piece in plan.furniture if piece.role == "captioned"]
        looks: dict[Family, list[Finish]] = {}
        for piece in captioned:
            looks.setdefault(look_of(piece.category).family, []).append(piece.finish)
        self._goals = _Goals(frozenset(piece.category for piece in captioned), looks)
        self._storeys: list[SpareStorey] = []
        for k, storey in enumerate(empty_storeys(plan)):
            there = [piece for piece, own in zip(plan.furniture, storey_of, strict=True) if own == k]
            self._storeys.append(SpareStorey(storey, there, [piece for piece in there if piece.role == "captioned"]))
        self._rooms = [SpareRoom(self._storeys[room.storey], number) for number, room in enumerate(plan.rooms)]

    def add_decoys(self, share: float) -> None:
        """Adds this many things for each captioned object, of its category and in its room."""
        numbers = {room.name: number for number, room in enumerate(self._plan.rooms)}
        for goal in [piece for piece in self._plan.furniture if piece.role == "captioned"]:
            count = int(share) + int(self._rng.random() < share - int(share))
            if look_of(goal.category).family in UNMOVED or goal.room not in numbers:
                continue
            for _ in range(count):
                self._put(goal.category, numbers[goal.room])

    def fill_room(self, number: int, density: float) -> None:
        """Adds things that are usual in a room until it has this many per square metre, or is full."""
        household = household_of(self._plan.rooms[number].name)
        wanted = round(density * self._rooms[number].area)
        for _ in range(round(_AT_WALLS * wanted)):
            self._put(self._one(household.at_walls), number)
        for _ in range(round(min(_HUNG * wanted, self._rooms[number].wall_length / _HUNG_EVERY))):
            self._put(self._one(household.hung), number)
        name = self._plan.rooms[number].name
        left = wanted - sum(piece.room == name for piece in self.added)
        failures = 0
        while left > 0 and failures < _MAX_FAILURES:
            if self._put_small(household, number):
                left, failures = left - 1, 0
            else:
                failures += 1

    def _put_small(self, household: Household, number: int) -> bool:
        """Puts one small thing on a table, a seat or the floor; returns whether it found a place."""
        draw = self._rng.random()
        if draw < 0.6:
            return self._put(self._one(household.on_tops), number, on_top=True)
        seats = self._hosts(number, tuple(SEAT_HEIGHTS)) if draw < 0.8 else []
        if seats:
            seat = self._one(seats)
            return self._put(self._one(ON_UPHOLSTERY[look_of(seat.category).family]), number, seat=seat)
        return self._put(self._one(household.on_floor), number)

    def _put(self, category: str, number: int, *, on_top: bool = False, seat: Furniture | None = None) -> bool:
        """Puts a thing at a usual place of its category, or at the given one; returns whether it found a place."""
        finish = self._new_finish(category)
        family, mounting = look_of(category).family, look_of(category).mounting
        if finish is None or mounting == "ceiling" or family == "flat":
            return False
        if category in ONCE and any(piece.category == category for piece in self._in_room(number)):
            return False
        thing = _Thing(category, drawn_size(category, self._rng), finish, number)
        if seat is not None:
            return any(self._lies(thing, seat) for _ in range(_TRIES))
        if on_top or mounting == "on":
            hosts = self._hosts(number, tuple(SEAT_HEIGHTS) if family in ("pillow", "blanket") else TOP_FAMILIES)
            return bool(hosts) and any(self._lies(thing, self._one(hosts)) for _ in range(_TRIES))
        fits = self._hangs if mounting == "wall" else self._stands
        return any(fits(thing) for _ in range(_TRIES))

    def _hosts(self, number: int, families: tuple[Family, ...]) -> list[Furniture]:
        """Pieces of these families in a room on which things can lie."""
        floor_y = self._plan.storeys[self._plan.rooms[number].storey].floor_y
        return [
            piece
            for piece in self._in_room(number)
            if look_of(piece.category).family in families
            and not any(word in piece.category for word in _WET)
            and _TOPS[0] < _top_of(piece) - floor_y < _TOPS[1]
        ]

    def _lies(self, thing: _Thing, host: Furniture) -> bool:
        """Whether the thing fits at a random place on a piece."""
        family = look_of(host.category).family
        has_back = family in ("sofa", "armchair")
        side = 0.2 if has_back else 0.02
        reach_x, reach_z = host.size[0] / 2 - side - thing.size[0] / 2, host.size[2] / 2 - 0.02 - thing.size[2] / 2
        if reach_x < 0 or reach_z < 0:
            return False
        x, z = float(self._rng.uniform(-reach_x, reach_x)), float(self._rng.uniform(-reach_z, reach_z))
        z = min(reach_z, 0.02) if has_back else z
        cos, sin = np.cos(host.yaw), np.sin(host.yaw)
        centre = (host.centre[0] + cos * x + sin * z, _top_of(host), host.centre[2] - sin * x + cos * z)
        yaw = host.yaw + (0.0 if family in SEAT_HEIGHTS else float(self._rng.uniform(-0.5, 0.5)))
        return self._takes(thing, centre, yaw, on=host)

    def _hangs(self, thing: _Thing) -> bool:
        """Whether the thing fits at a random place of a wall of its room."""
        spot = self._rooms[thing.room].wall_spot(thing.size[0], self._rng)
        if spot is None:
            return False
        floor_y = self._plan.storeys[self._plan.rooms[thing.room].storey].floor_y
        middle = max(_LOWEST_HUNG + thing.size[1] / 2, _HUNG_AT) + float(self._rng.uniform(0, 0.35))
        x, z = spot.at(thing.size[2] / 2 + 0.006)
        return self._takes(thing, (x, floor_y + middle - thing.size[1] / 2, z), spot.yaw)

    def _stands(self, thing: _Thing) -> bool:
        """Whether the thing fits on the floor of its room: with its back to a wall or, if it is small, anywhere."""
        room = self._rooms[thing.room]
        w, _, d = thing.size
        if max(w, d) > _SMALL or self._rng.random() < 0.5:
            spot = room.wall_spot(w, self._rng, depth=d)
            place = spot and (spot.at(d / 2 + 0.02), spot.yaw)
        else:
            at = room.floor_spot(max(w, d) / 2, self._rng)
            place = at and (at, float(self._rng.uniform(-np.pi, np.pi)))
        if place is None:
            return False
        (x, z), yaw = place
        half = 0.25 * min(w, d)
        floor_y = room.storey.floor_at(Rect(x - half, z - half, x + half, z + half))
        return floor_y is not None and self._takes(thing, (x, floor_y, z), yaw, stands=True)

    def _takes(
        self,
        thing: _Thing,
        foot: tuple[float, float, float],
        yaw: float,
        *,
        on: Furniture | None = None,
        stands: bool = False,
    ) -> bool:
        """Adds the thing with the middle of its bottom at this place, if it fits there; returns whether it does."""
        x, y, z = (round(value, 4) for value in (foot[0], foot[1] + thing.size[1] / 2, foot[2]))
        piece = Furniture(
            name=f"{thing.category}_{self._first_number + len(self.added)}",
            category=thing.category,
            centre=(x, y, z),
            size=thing.size,
            yaw=round(yaw, 4),
            finish=thing.finish,
            room=self._plan.rooms[thing.room].name,
            role="decoy" if thing.category in self._goals.categories else "clutter",
        )
        fits = self._rooms[thing.room].storey.take(piece, on=on, stands=stands)
        if fits:
            self.added.append(piece)
        return fits

    def _new_finish(self, category: str) -> Finish | None:
        """A finish unlike those of all captioned pieces of the family; None where all drawn ones are too similar."""
        taken = self._goals.looks.get(look_of(category).family, [])
        for _ in range(_FINISHES):
            finish = drawn_finish(category, self._rng)
            if all(np.abs(np.subtract(finish.rgb, other.rgb)).max() >= _APART for other in taken):
                return finish
        return None

    def _in_room(self, number: int) -> list[Furniture]:
        name = self._plan.rooms[number].name
        return [piece for piece in (*self._plan.furniture, *self.added) if piece.room == name]

    def _one(self, choices: Sequence[_T]) -> _T:
        return choices[int(self._rng.integers(len(choices)))]


def _top_of(piece: Furniture) -> float:
    """World height at which things lie on a piece."""
    share = SEAT_HEIGHTS.get(look_of(piece.category).family, 1.0)
    return piece.centre[1] + (share - 0.5) * piece.size[1]


def _storeys_of(plan: HomePlan) -> list[int]:
    """Storey of each piece of a plan: the storey of its room, else the highest storey below it."""
    of_room = {room.name: room.storey for room in plan.rooms}
    floors = [(storey.floor_y, storey.floor_y) for storey in plan.storeys]
    return [of_room.get(piece.room, storey_of(piece.bottom_y, floors)) for piece in plan.furniture]
