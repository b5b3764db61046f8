"""Rooms of recovered homes: names from texts, and regions that follow walking distances."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from sim.episodes.dataset import PersonalDataset
from sim.homes.cells import CellGrid, Cells, runs_from_cells
from sim.homes.plan import Room, Storey
from sim.homes.recovered.names import RoomName, room_name, room_texts, usual_room
from sim.homes.recovered.plans import recover_plan
from sim.homes.recovered.regions import joined
from sim.homes.recovered.rooms import RecoveredRooms, open_cells, recovered_rooms

from .recorded_worlds import GROUND, Point, recorded_goal
from .synthetic import SCENE, example_content, example_episode, write_dataset

GRID = CellGrid(origin_xz=(0.0, 0.0), shape=(120, 160), walkable=())
"""6 m along z, 8 m along x."""


def grid_of(*rects: tuple[float, float, float, float], y: float = 0.0) -> CellGrid:
    """A grid whose floor covers rectangles (x0, z0, x1, z1) in metres."""
    free = np.zeros(GRID.shape, bool)
    for x0, z0, x1, z1 in rects:
        free[round(z0 / 0.05) : round(z1 / 0.05), round(x0 / 0.05) : round(x1 / 0.05)] = True
    rc = np.argwhere(free)
    return GRID.model_copy(
        update={"walkable": runs_from_cells(Cells(rc, np.full(len(rc), y), np.zeros(len(rc), bool)))}
    )


def room_at(rooms: tuple[Room, ...], x: float, z: float) -> str:
    """Name of the room that holds a point."""
    row, col = int(z / 0.05), int(x / 0.05)
    names = [room.name for room in rooms for run in room.area if run.row == row and 0 <= col - run.col < run.length]
    assert len(names) == 1
    return names[0]


TWO_ROOMS = ((0.5, 0.5, 3.4, 4.0), (3.4, 2.0, 4.4, 2.8), (4.4, 0.5, 7.5, 4.0))
"""Two rooms with a doorway of 0.8 m between them."""


def recovered(
    texts: dict[str, str], places: dict[str, tuple[Point, Point]], grid: CellGrid, storeys: tuple[Storey, ...] = GROUND
) -> RecoveredRooms:
    """The rooms that are recovered; `places` has the centre of each object and the one place that sees it."""
    goals = {name: recorded_goal(name, centre, [seen_from]) for name, (centre, seen_from) in places.items()}
    return recovered_rooms({name: Counter({text: 1}) for name, text in texts.items()}, goals, storeys, grid=grid)


@pytest.mark.parametrize(
    ("text", "kind", "name"),
    [
        ("kitchen", "kitchen", "kitchen"),
        ("Kitchen.", "kitchen", "kitchen"),
        ("master bedroom bathroom", "bathroom", "master bedroom bathroom"),
        ("bathroom of the master bedroom", "bathroom", "bathroom"),
        ("bathroom with blue floor", "bathroom", "bathroom"),
        ("closet near bedroom", "closet", "closet"),
        ("bedroom 2", "bedroom", "bedroom 2"),
        ("bedroom 1 closet", "closet", "bedroom 1 closet"),
        ("between the kitchen and the living room", "kitchen", "kitchen"),
        ("open-space dining room next to living room", "dining room", "open space dining room"),
        ("closeth", "closet", "closet"),
        ("corridor near the kitchen", "hallway", "corridor"),
        ("office", "studio", "office"),
    ],
)
def test_a_text_names_a_kind_of_room(text: str, kind: str, name: str) -> None:
    found = room_name(text)
    assert found is not None
    assert (found.kind, found.name) == (kind, name)


def test_a_text_without_a_room_names_none_and_objects_have_usual_rooms() -> None:
    assert room_name("an unspecified area") is None
    assert (usual_room("toilet"), usual_room("kitchen cabinet"), usual_room("chair")) == ("bathroom", "kitchen", None)
    places = {"bed_1": ((1.0, 0.4, 1.0), (2.0, 0.0, 1.5)), "toilet_2": ((7.0, 0.4, 1.0), (6.0, 0.0, 1.5))}
    found = recovered({"bed_1": "bedroom"}, places, grid_of(*TWO_ROOMS))
    assert room_at(found.rooms, 7.0, 3.5) == "bathroom"
    # an object beside one with a named room does not name a room
    places["toilet_2"] = ((1.2, 0.4, 1.0), (2.0, 0.0, 1.6))
    assert [room.name for room in recovered({"bed_1": "bedroom"}, places, grid_of(TWO_ROOMS[0])).rooms] == ["bedroom"]


def test_the_room_of_a_target_comes_from_the_sentence_of_its_owner(tmp_path: Path) -> None:
    summary = ["Ada owns a tall lamp in the study", "Ada owns a low oak table in the lounge", "Bo owns it in the attic"]
    content = example_content(episodes=[example_episode(extracted_summary=summary)])
    dataset = PersonalDataset(write_dataset(tmp_path, {("easy", SCENE): content}))
    assert room_texts(dataset.episodes()) == {"coffee table_7": Counter({"lounge": 1})}
    assert room_texts(()) == {}


def test_a_doorway_divides_two_rooms_and_walking_distance_counts_not_the_straight_line() -> None:
    places = {"bed_1": ((1.0, 0.4, 1.0), (2.0, 0.0, 1.5)), "oven_2": ((7.0, 0.4, 1.0), (6.0, 0.0, 1.5))}
    found = recovered({"bed_1": "blue bedroom", "oven_2": "kitchen"}, places, grid_of(*TWO_ROOMS))
    assert sorted(room.name for room in found.rooms) == ["blue bedroom", "kitchen"]
    assert [room_at(found.rooms, x, z) for x, z in ((0.6, 3.9), (3.3, 0.6), (4.5, 0.6), (7.4, 3.9))] == [
        "blue bedroom", "blue bedroom", "kitchen", "kitchen",
    ]  # fmt: skip
    assert found.room_of == {"bed_1": "blue bedroom", "oven_2": "kitchen"}
    # two long rooms side by side, joined only at the far end; the bed is near the wall between them
    side_by_side = ((0.5, 0.5, 7.0, 1.5), (0.5, 2.0, 7.0, 3.0), (6.0, 1.5, 7.0, 2.0))
    places = {"bed_1": ((1.0, 0.4, 1.4), (1.5, 0.0, 1.2)), "sink_2": ((4.5, 0.8, 2.9), (4.5, 0.0, 2.5))}
    found = recovered({"bed_1": "bedroom", "sink_2": "bathroom"}, places, grid_of(*side_by_side))
    assert room_at(found.rooms, 1.0, 2.2) == "bathroom"
    assert room_at(found.rooms, 1.0, 1.2) == "bedroom"


def test_equal_names_get_numbers_and_neighbours_have_different_finishes() -> None:
    places = {"bed_1": ((1.0, 0.4, 1.0), (2.0, 0.0, 1.5)), "bed_2": ((7.0, 0.4, 1.0), (6.0, 0.0, 1.5))}
    texts = {"bed_1": "bedroom with red sheets", "bed_2": "bedroom with carved headboard"}
    found = recovered(texts, places, grid_of(*TWO_ROOMS))
    assert sorted(room.name for room in found.rooms) == ["bedroom", "bedroom 2"]
    first, second = found.rooms
    assert first.wall.rgb != second.wall.rgb
    assert first.floor != second.floor


def test_different_names_for_one_room_give_one_room() -> None:
    places = {
        "bed_1": ((1.0, 0.4, 1.0), (2.0, 0.0, 1.5)), "lamp_2": ((1.0, 0.4, 3.0), (2.0, 0.0, 2.8)),
        "sink_3": ((7.0, 0.8, 1.0), (6.0, 0.0, 1.5)), "towel_4": ((7.0, 1.2, 3.0), (6.0, 0.0, 2.8)),
    }  # fmt: skip
    texts = {
        "bed_1": "master bedroom", "lamp_2": "main bedroom",
        "sink_3": "bathroom of the master bedroom", "towel_4": "master bedroom bathroom",
    }  # fmt: skip
    found = recovered(texts, places, grid_of(*TWO_ROOMS))
    assert len(found.rooms) == 2
    assert found.room_of["bed_1"] == found.room_of["lamp_2"] != found.room_of["sink_3"] == found.room_of["towel_4"]


HALL_GRID = GRID.model_copy(update={"shape": (30, 40)})
HALL = ((0.5, 0.5, 7.5, 4.0),)
"""One large room, in which nothing divides the parts."""


def hall(first: str, second: str) -> RecoveredRooms:
    """The rooms of a hall with two objects whose texts name these rooms."""
    places = {"sofa_1": ((1.0, 0.4, 1.0), (2.0, 0.0, 1.5)), "desk_2": ((7.0, 0.4, 1.0), (6.0, 0.0, 1.5))}
    return recovered({"sofa_1": first, "desk_2": second}, places, grid_of(*HALL))


def test_parts_of_one_kind_that_nothing_divides_are_one_room_unless_texts_tell_them_apart() -> None:
    assert len(hall("living room", "living room with open kitchen").rooms) == 1
    assert len(hall("living room", "kitchen").rooms) == 2
    assert len(hall("blue living room", "second living room").rooms) == 2


@pytest.mark.parametrize(("num_crossing", "num_rooms"), [(4, 2), (5, 1)])
def test_lines_of_sight_that_cross_from_part_to_part_join_rooms_whatever_texts_say(
    num_crossing: int, num_rooms: int
) -> None:
    labels = np.zeros((30, 40), np.int64)
    labels[:, 20:] = 1
    names = [RoomName("living room", text, text) for text in ("blue living room", "second living room")]
    places = [(0.5, 0.0, 0.5)] * 9 + [(1.5, 0.0, 0.5)] * num_crossing
    new = joined(labels, [*names, None], [recorded_goal("sofa_1", (0.8, 0.4, 0.5), places)], HALL_GRID)
    assert len(set(new.tolist()[:2])) == num_rooms
    assert new[2] == 2, "the storey's rest stays what it is"


def test_floors_and_walls_have_the_colours_that_texts_name() -> None:
    places = {"sink_1": ((1.0, 0.8, 1.0), (2.0, 0.0, 1.5)), "bed_2": ((7.0, 0.4, 1.0), (6.0, 0.0, 1.5))}
    texts = {"sink_1": "bathroom with blue floor", "bed_2": "bedroom with yellow walls"}
    rooms = {room.name: room for room in recovered(texts, places, grid_of(*TWO_ROOMS)).rooms}
    bathroom, bedroom = rooms["bathroom"], rooms["bedroom"]
    assert bathroom.floor.material == "tile"
    assert bathroom.floor.rgb[2] > 1.3 * bathroom.floor.rgb[0]
    assert bedroom.wall.rgb[0] > 1.3 * bedroom.wall.rgb[2]


def test_far_corners_and_storeys_without_objects_are_named_after_the_storey() -> None:
    storeys = (*GROUND, Storey(label="first floor", floor_y=3.0))
    below = grid_of((0.5, 0.5, 1.7, 5.5))
    above = grid_of((0.5, 0.5, 3.0, 3.0), y=3.0)
    grid = below.model_copy(update={"walkable": below.walkable + above.walkable})
    found = recovered({"bed_1": "bedroom"}, {"bed_1": ((1.0, 0.4, 0.8), (1.0, 0.0, 1.2))}, grid, storeys)
    assert [(room.name, room.storey) for room in found.rooms] == [("bedroom", 0), ("first floor", 1)]
    long = recovered({"bed_1": "bedroom"}, {"bed_1": ((0.8, 0.4, 0.8), (1.0, 0.0, 1.2))}, grid_of((0.5, 0.5, 7.9, 1.9)))
    assert [room.name for room in long.rooms] == ["bedroom", "ground floor"]


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param("mL8ThkuaVTM", marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.release) for name in ("XB4GS9ShBRE", "QaLdnwvtxbs")),
    ],
)
def test_the_rooms_of_a_released_home_cover_every_open_cell_once(dataset_root: Path, scene: str) -> None:
    plan = recover_plan(PersonalDataset(dataset_root), scene)
    assert plan.cells is not None
    count = np.zeros((len(plan.storeys), *plan.cells.shape), np.int64)
    for room in plan.rooms:
        for run in room.area:
            count[room.storey, run.row, run.col : run.col + run.length] += 1
    assert np.array_equal(count, open_cells(plan.cells, plan.storeys).astype(np.int64))
    names = [room.name for room in plan.rooms]
    assert len(set(names)) == len(names) >= 5
    assert {item.room for item in plan.furniture} <= set(names)
    assert all(len(name) <= 40 and " owns " not in name for name in names)
