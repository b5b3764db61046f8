"""A plan of two rooms with one door of 0.9 m between them, and a table on which the robot could stand if it flew."""

from functools import lru_cache

from sim.homes.open_home import scene_from_plan
from sim.homes.plan import Finish, Furniture, HomePlan, Opening, Rect, Room, Storey, Wall
from sim.mesh import Scene

FINISH = Finish(rgb=(200, 190, 180))
WEST, EAST = Rect(0, 0, 4, 4), Rect(4, 0, 8, 4)
"""The door is in the wall x = 4, at z = 2."""


def wall(start: tuple[float, float], end: tuple[float, float], *openings: Opening) -> Wall:
    return Wall(storey=0, start=start, end=end, height=2.5, openings=openings)


@lru_cache(maxsize=2)
def two_rooms(*, has_door: bool = True) -> HomePlan:
    """Without the door the east room is an island."""
    door = (Opening(kind="door", offset=2.0, width=0.9),) if has_door else ()
    outline = ((0.0, 0.0), (8.0, 0.0), (8.0, 4.0), (0.0, 4.0))
    table = Furniture(name="table_1", category="table", centre=(6.5, 0.35, 1.0), size=(1.2, 0.7, 0.9), finish=FINISH)
    return HomePlan(
        name="TwoRooms",
        kind="invented",
        storeys=(Storey(label="ground floor", floor_y=0.0),),
        rooms=(
            Room(name="west", storey=0, rect=WEST, floor=FINISH, wall=FINISH),
            Room(name="east", storey=0, rect=EAST, floor=FINISH, wall=FINISH),
        ),
        walls=(
            *(wall(a, b) for a, b in zip(outline, (*outline[1:], outline[0]), strict=True)),
            wall((4.0, 0.0), (4.0, 4.0), *door),
        ),
        furniture=(table,),
    )


@lru_cache(maxsize=2)
def two_room_scene(*, has_door: bool = True) -> Scene:
    return scene_from_plan(two_rooms(has_door=has_door))
