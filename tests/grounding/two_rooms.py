"""Two rooms with a door of 0.9 m between them, and a table top on which the robot could stand but not climb."""

from functools import lru_cache

from sim.homes.open_home import scene_from_plan
from sim.homes.plan import HomePlan
from sim.mesh import Scene

from ..sim import plans


@lru_cache(maxsize=2)
def two_rooms(*, has_door: bool = True) -> HomePlan:
    """The plan of the two rooms; without the door the east room is an island."""
    table = plans.piece("table_1", (6.5, 0.35, 1.0), (1.2, 0.7, 0.9))
    return plans.two_rooms(table, door=2.0 if has_door else None, name="TwoRooms")


@lru_cache(maxsize=2)
def two_room_scene(*, has_door: bool = True) -> Scene:
    return scene_from_plan(two_rooms(has_door=has_door))
