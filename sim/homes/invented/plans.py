"""An invented home from a seed: one or two storeys of rooms, doors and windows, a stair, and furniture."""

from collections.abc import Iterator, Sequence

import numpy as np

from sim.errors import SceneError

from ..plan import Furniture, HomePlan, Rect, Room, Stair, Storey, Wall
from .arrange import UsedLooks, furnish_room
from .free_space import FreeSpace, unseen_pieces, walkable_floor
from .layouts import Home, draw_home, landings
from .partitions import CEILING, build_partition, draw_doors, railings
from .recipes import NEEDED
from .room_kinds import draw_finishes, draw_names

MIN_PIECES, MAX_PIECES = 35, 80
MIN_ROOMS, MAX_ROOMS = 5, 9
STOREY_HEIGHT = 2.8
_ATTEMPTS = 60
_LABELS = ("ground floor", "first floor")
_ONE_STOREY_EVERY = 4


def invent_plan(name: str, *, seed: int) -> HomePlan:
    """A furnished home of 5 to 9 rooms and 35 to 80 pieces; the same name and seed give the same plan.

    This is the `DemoHome(seed)` of the project's requirements; `scene_from_plan` gives it a mesh, and
    `sim.authoring.generation.dataset_files` adds people and searches. Seeds 3, 7, 11, ... have one storey, all others
    two. A robot of our radius can reach every room, and every piece can be seen from nearby.

    Raises:
        SceneError: No attempt gave such a home; try another seed.
    """
    return next(invented_plans(name, seed=seed))


def invented_plans(name: str, *, seed: int) -> Iterator[HomePlan]:
    """Yields the homes of a seed, beginning with that of `invent_plan`; for callers with further requirements.

    Raises:
        SceneError: There are no more homes.
    """
    found = 0
    for attempt in range(_ATTEMPTS):
        plan = _drawn_plan(name, num_storeys(seed), np.random.default_rng([seed, attempt]))
        if plan is not None:
            found += 1
            yield plan
    raise SceneError(
        f"invented home {name!r}: seed {seed} gave {found} homes in {_ATTEMPTS} tries, none fit to be used; expected "
        f"one of {MIN_ROOMS} to {MAX_ROOMS} rooms and {MIN_PIECES} to {MAX_PIECES} pieces that can all be seen. Take "
        "another --seed."
    )


def num_storeys(seed: int) -> int:
    """The number of storeys for a seed, 1 or 2."""
    return 1 if seed % _ONE_STOREY_EVERY == _ONE_STOREY_EVERY - 1 else 2


def _drawn_plan(name: str, storeys: int, rng: np.random.Generator) -> HomePlan | None:
    """One attempt at a home; None where it is not complete."""
    home = draw_home(storeys, rng)
    if not MIN_ROOMS <= sum(len(layout.rects) for layout in home.storeys) <= MAX_ROOMS:
        return None
    rooms: list[Room] = []
    walls: list[Wall] = []
    furniture: list[Furniture] = []
    used = UsedLooks()
    for storey in range(storeys):
        built = _storey(home, storey, rng, used)
        if built is None:
            return None
        rooms += built[0]
        walls += built[1]
        furniture += built[2]
    stairs = () if home.stair is None else (home.stair,)
    plan = HomePlan(
        name=name,
        kind="invented",
        storeys=tuple(Storey(label=_LABELS[k], floor_y=k * STOREY_HEIGHT, ceiling=CEILING) for k in range(storeys)),
        rooms=tuple(rooms),
        walls=tuple(walls),
        stairs=stairs,
        furniture=tuple(furniture),
    )
    return _checked(plan)


def _storey(
    home: Home, storey: int, rng: np.random.Generator, used: UsedLooks
) -> tuple[list[Room], list[Wall], list[Furniture]] | None:
    """Rooms, walls and furniture of one storey; None where its rooms cannot all be joined or named."""
    layout, stair = home.storeys[storey], home.stair
    doors = draw_doors(layout, stair, rng)
    if doors is None:
        return None
    degrees = [sum(k in pair for pair in (*doors, *layout.open_pairs)) for k in range(len(layout.rects))]
    names = draw_names(layout.names, layout.rects, degrees, storey=(len(home.storeys), storey), rng=rng)
    if names is None:
        return None
    partition = build_partition(layout, names, doors, storey=storey, stair=stair, rng=rng)
    finishes = draw_finishes(names, rng)
    rooms = [
        Room(name=room_name, storey=storey, rect=rect, floor=floor, wall=wall)
        for room_name, rect, (floor, wall) in zip(names, layout.rects, finishes, strict=True)
    ]
    furniture: list[Furniture] = []
    for room in rooms:
        assert room.rect is not None
        space = FreeSpace(room.rect, partition, blocked=_blocked(stair))
        furniture += furnish_room(room, storey * STOREY_HEIGHT, space=space, used=used, rng=rng)
    walls = list(partition.walls)
    if stair is not None and storey == stair.storey + 1:
        walls += railings(stair, partition.walls)
    return rooms, walls, furniture


def _blocked(stair: Stair | None) -> list[Rect]:
    """The stair and the floor at both of its ends."""
    return [] if stair is None else [stair.rect.grown(0.1), *landings(stair)]


def _checked(plan: HomePlan) -> HomePlan | None:
    """The plan with its visible pieces, numbered; None where rooms are unreachable or pieces too few or too many."""
    if not MIN_PIECES <= len(plan.furniture) <= MAX_PIECES or not _is_whole(plan.rooms, plan.furniture):
        return None
    floors = walkable_floor(plan)
    if floors is None:
        return None
    unseen = unseen_pieces(plan, floors)
    kept = [piece for k, piece in enumerate(plan.furniture) if k not in unseen]
    kept = [piece for piece in kept if _is_supported(piece, kept, plan)]
    if len(kept) < MIN_PIECES or not _is_whole(plan.rooms, kept):
        return None
    numbered = tuple(
        piece.model_copy(update={"name": f"{piece.category}_{number}"}) for number, piece in enumerate(kept, start=1)
    )
    return plan.model_copy(update={"furniture": numbered})


def _is_whole(rooms: Sequence[Room], pieces: Sequence[Furniture]) -> bool:
    """Whether every room has the pieces that its name promises."""
    there = {(piece.room, piece.category) for piece in pieces}
    return all((room.name, category) in there for room in rooms for category in NEEDED.get(room.name, ()))


def _is_supported(piece: Furniture, others: list[Furniture], plan: HomePlan) -> bool:
    """Whether a piece stands on the floor, hangs on a wall, or lies on another piece."""
    room = next(room for room in plan.rooms if room.name == piece.room)
    if piece.bottom_y < plan.storeys[room.storey].floor_y + 0.02:
        return True
    assert room.rect is not None
    if not room.rect.grown(-0.1).holds_rect(piece.rect):  # at a wall
        return True
    return any(
        other.rect.holds(piece.centre[0], piece.centre[2])
        and other.bottom_y < piece.bottom_y - 0.01
        and piece.bottom_y <= other.top_y + 0.03
        for other in others
        if other is not piece
    )
