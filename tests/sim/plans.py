"""Small planned homes with known answers: pieces of furniture, and two rooms with a door between them."""

import itertools
from typing import Any

from sim.homes.plan import Finish, Furniture, HomePlan, Opening, Rect, Room, Storey, Wall

GROUND = (Storey(label="ground floor", floor_y=0.0),)
GREY = Finish(rgb=(128, 128, 128))

Vec = tuple[float, float, float]


def piece(name: str, centre: Vec, size: Vec, /, **changes: Any) -> Furniture:
    """A grey piece called `<category>_<number>`."""
    fields = {"name": name, "category": name.rpartition("_")[0], "centre": centre, "size": size, "finish": GREY}
    return Furniture(**fields | changes)


def room(name: str, rect: Rect, /, **changes: Any) -> Room:
    """A grey room on the ground floor."""
    return Room(**{"name": name, "storey": 0, "rect": rect, "floor": GREY, "wall": GREY} | changes)


def walls_around(rect: Rect, **changes: Any) -> tuple[Wall, ...]:
    """Four walls 2.5 m high, from the corner (x0, z0) along x first."""
    x0, z0, x1, z1 = rect
    corners = [(x0, z0), (x1, z0), (x1, z1), (x0, z1), (x0, z0)]
    fields = {"storey": 0, "height": 2.5} | changes
    return tuple(Wall(start=start, end=end, **fields) for start, end in itertools.pairwise(corners))


def two_rooms(*pieces: Furniture, door: float | None = 2.0, **changes: Any) -> HomePlan:
    """Two rooms of 4 x 4 m; the wall between them, x = 4, has a 0.9 m door at z = `door`, or no door if it is None."""
    openings = () if door is None else (Opening(kind="door", offset=door, width=0.9),)
    between = Wall(storey=0, start=(4.0, 0.0), end=(4.0, 4.0), height=2.5, openings=openings)
    fields = {
        "name": "Two",
        "kind": "invented",
        "storeys": GROUND,
        "rooms": (room("west", Rect(0, 0, 4, 4)), room("east", Rect(4, 0, 8, 4))),
        "walls": (*walls_around(Rect(0, 0, 8, 4)), between),
        "furniture": pieces,
    }
    return HomePlan(**fields | changes)
