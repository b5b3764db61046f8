"""Small homes given as cells, with known walls."""

from sim.homes.cells import AreaRun, CellGrid, CellRun
from sim.homes.plan import Finish, HomePlan, Room, Storey

BLUE, RED = Finish(material="plaster", rgb=(80, 90, 200)), Finish(material="plaster", rgb=(200, 90, 80))
WOOD, TILE = Finish(material="wood", rgb=(160, 120, 80)), Finish(material="tile", rgb=(190, 196, 200))


def block(row: int, col: int, height: int, width: int, *, y_cm: int = 0, guessed: bool = False) -> tuple[CellRun, ...]:
    """A rectangle of cells."""
    return tuple(CellRun(r, col, width, y_cm, guessed) for r in range(row, row + height))


def plan_of_cells(
    walkable: tuple[CellRun, ...],
    *,
    plinth: tuple[CellRun, ...] = (),
    rooms: tuple[Room, ...] | None = None,
    storeys: tuple[Storey, ...] = (Storey(label="ground floor", floor_y=0.0, ceiling=2.5),),
    shape: tuple[int, int] = (120, 120),
) -> HomePlan:
    """A home with its corner at x = z = 0."""
    if rooms is None:
        rooms = tuple(Room(name=f"all {k}", storey=k, floor=WOOD, wall=BLUE) for k in range(len(storeys)))
    grid = CellGrid(origin_xz=(0.0, 0.0), shape=shape, walkable=walkable, plinth=plinth)
    return HomePlan(name="Cells", kind="schematic", storeys=storeys, rooms=rooms, cells=grid)


def two_cell_rooms() -> HomePlan:
    """Two rooms of about 2 m by 2 m side by side, with 0.2 m between them and a way through of 0.9 m."""
    left, right = block(20, 20, 40, 40), block(20, 70, 40, 40)
    door = block(32, 60, 12, 10)
    rooms = (
        Room(name="left", storey=0, area=tuple(AreaRun(r, 20, 45) for r in range(20, 60)), floor=WOOD, wall=BLUE),
        Room(name="right", storey=0, area=tuple(AreaRun(r, 65, 45) for r in range(20, 60)), floor=TILE, wall=RED),
    )
    return plan_of_cells((*left, *right, *door), rooms=rooms)


def two_storeys() -> HomePlan:
    """A room with a flight of 15 risers along x to the room above it; its 14 steps are 0.25 m deep."""
    storeys = (Storey(label="ground floor", floor_y=0.0), Storey(label="first floor", floor_y=2.8))
    low, high = block(20, 20, 40, 40), block(20, 130, 40, 40, y_cm=280)
    steps = tuple(run for k in range(14) for run in block(36, 60 + 5 * k, 14, 5, y_cm=round(280 / 15 * (k + 1))))
    return plan_of_cells((*low, *high, *steps), storeys=storeys, shape=(80, 200))
