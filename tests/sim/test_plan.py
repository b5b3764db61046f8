"""HomePlan on disk, and cells stored as runs."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.errors import SceneError
from sim.homes.cells import CellGrid, CellRun, Cells, cells_from_runs, runs_from_cells
from sim.homes.plan import Finish, Furniture, HomePlan, Rect, Room, Stair, Storey, Wall, load_plan, save_plan
from sim.types import GridSpec

CHAIR = Furniture(
    name="chair_1", category="chair", centre=(1.0, 0.45, 2.0), size=(0.5, 0.9, 0.4), finish=Finish(rgb=(200, 30, 30))
)
WOOD = Finish(material="wood", rgb=(150, 120, 90))
PLASTER = Finish(material="plaster", rgb=(220, 220, 210))
PLAN = HomePlan(
    name="Tiny",
    kind="schematic",
    storeys=(Storey(label="ground floor", floor_y=0.0),),
    rooms=(Room(name="all", storey=0, floor=WOOD, wall=PLASTER),),
    furniture=(CHAIR,),
    cells=CellGrid(
        origin_xz=(0.0, 0.0),
        shape=(4, 10),
        walkable=(CellRun(1, 2, 3, 0), CellRun(1, 5, 2, 10, True), CellRun(2, 0, 1, 0)),
    ),
)


def test_a_saved_plan_always_has_the_same_bytes_and_loads_equal_and_a_missing_one_is_refused(tmp_path: Path) -> None:
    save_plan(PLAN, tmp_path / "a" / "Tiny.plan.json")
    save_plan(PLAN, tmp_path / "b.plan.json")
    assert load_plan(tmp_path / "a" / "Tiny.plan.json") == PLAN
    assert (tmp_path / "a" / "Tiny.plan.json").read_bytes() == (tmp_path / "b.plan.json").read_bytes()
    assert [path.name for path in tmp_path.rglob("*.part")] == []
    with pytest.raises(SceneError, match=r"no.plan.json: cannot be read"):
        load_plan(tmp_path / "no.plan.json")


@pytest.mark.parametrize(
    ("labels", "missing"),
    [
        (("ground floor", "first floor"), ()),
        (("first floor", "second floor"), ("ground floor",)),
        (("basement", "first floor at 2.9 m", "first floor at 3.4 m", "floor 3"), ("ground floor", "second floor")),
        (("floor X",), ()),
    ],
)
def test_a_schematic_home_misses_the_storeys_that_its_names_skip(
    labels: tuple[str, ...], missing: tuple[str, ...]
) -> None:
    storeys = tuple(Storey(label=label, floor_y=3.0 * k) for k, label in enumerate(labels))
    assert PLAN.model_copy(update={"storeys": storeys}).missing_storeys == missing
    assert PLAN.model_copy(update={"storeys": storeys, "kind": "invented"}).missing_storeys == ()


def test_runs_expand_to_cells_and_a_rectangle_gives_the_cells_it_touches() -> None:
    assert PLAN.cells is not None
    cells = cells_from_runs(PLAN.cells.walkable)
    assert cells.rc.tolist() == [[1, 2], [1, 3], [1, 4], [1, 5], [1, 6], [2, 0]]
    assert cells.y.tolist() == [0, 0, 0, 0.1, 0.1, 0]
    assert cells.guessed.tolist() == [False, False, False, True, True, False]
    grid = GridSpec((0.0, 0.0), 0.5, (4, 6))
    assert Rect(0.6, 0.1, 1.4, 0.9).cells(grid) == (slice(0, 2), slice(1, 3))
    assert Rect(0.5, 0.0, 1.0, 0.5).cells(grid, slack=1e-6) == (slice(0, 1), slice(1, 2))
    assert Rect(-3.0, -3.0, -2.0, 9.0).cells(grid) == (slice(0, 4), slice(0, 1))


@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(-300, 300), st.booleans()), max_size=60, unique=True
    )
)
def test_cells_are_the_same_after_being_stored_as_runs(cells: list[tuple[int, int, int, bool]]) -> None:
    table = np.array(cells, np.int64).reshape(-1, 4)
    runs = runs_from_cells(Cells(table[:, :2], table[:, 2] / 100, table[:, 3].astype(bool)))
    back = cells_from_runs(runs)
    found = np.column_stack([back.rc, np.round(back.y * 100), back.guessed]).astype(int)
    assert sorted(map(tuple, found.tolist())) == sorted((r, c, y, int(g)) for r, c, y, g in cells)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("not json", "text that is not JSON"),
        ('{"schema_version": 4}', "schema_version is 4"),
        (PLAN.model_dump_json().replace('"chair_1"', '"chair"'), "furniture.0.name is 'chair'"),
        (PLAN.model_dump_json().replace("[200,30,30]", "[200,30,300]"), "furniture.0.finish.rgb.2 is 300"),
        (PLAN.model_dump_json().replace('"kind":"schematic"', '"kind":"scan"'), "kind is 'scan'"),
        (
            PLAN.model_dump_json().replace('"storey":0', '"storey":7'),
            "rooms.0.storey is 7; expected: one of the plan's",
        ),
        (PLAN.model_dump_json().replace('"floor_y":0.0', '"floor_y":1e300'), "storeys.0.floor_y is 1e+300"),
        (PLAN.model_dump_json().replace("[1,2,3,0,false]", "[1,2,-3,0,false]"), "cells.walkable.0.2 is -3"),
    ],
)
def test_a_damaged_plan_is_refused_in_one_line_that_says_where(tmp_path: Path, text: str, wanted: str) -> None:
    path = tmp_path / "Tiny.plan.json"
    path.write_text(text)
    with pytest.raises(SceneError) as error:
        load_plan(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert wanted in message
    assert "\n" not in message


def test_walls_and_both_ends_of_stairs_stand_on_storeys_of_the_plan(tmp_path: Path) -> None:
    wall = Wall(storey=1, start=(0.0, 0.0), end=(1.0, 0.0), height=2.5)
    stair = Stair(storey=0, rect=Rect(0, 0, 1, 3), towards="+z", num_steps=12)
    path = tmp_path / "Tiny.plan.json"
    path.write_text(PLAN.model_copy(update={"walls": (wall,), "stairs": (stair,)}).model_dump_json())
    with pytest.raises(SceneError, match=r"walls\.0\.storey is 1; expected: .* 0 to 0 \(and 1 more problems\)\. Make"):
        load_plan(path)
    path.write_text(PLAN.model_copy(update={"stairs": (stair,)}).model_dump_json())
    with pytest.raises(SceneError, match=r"stairs\.0\.storey is 0; expected: .* 0 to 0, with a storey above it\. Make"):
        load_plan(path)
    above = Storey(label="first floor", floor_y=2.8)
    plan = PLAN.model_copy(update={"storeys": (*PLAN.storeys, above), "walls": (wall,), "stairs": (stair,)})
    path.write_text(plan.model_dump_json())
    assert load_plan(path) == plan


def test_a_turned_piece_swaps_width_and_depth_and_a_shared_border_is_not_an_overlap() -> None:
    turned = CHAIR.model_copy(update={"yaw": np.pi / 2})
    np.testing.assert_allclose(CHAIR.rect, (0.75, 1.8, 1.25, 2.2))
    np.testing.assert_allclose(turned.rect, (0.8, 1.75, 1.2, 2.25))
    np.testing.assert_allclose(turned.world_size, (0.4, 0.9, 0.5))
    assert not Rect(0, 0, 1, 1).overlaps(Rect(1, 0, 2, 1))
    assert Rect(0, 0, 1, 1).overlaps(Rect(0.99, 0, 2, 1))


VERSION_1 = (
    '{"schema_version":1,"name":"Tiny","kind":"schematic","storeys":[{"label":"ground floor","floor_y":0.0,'
    '"ceiling":2.5}],"rooms":[{"name":"all","storey":0,"rect":null,"floor_rgb":[150,120,90],"wall_rgb":[220,220,210]}],'
    '"walls":[],"stairs":[],"furniture":[{"name":"chair_1","category":"chair","centre":[1.0,0.45,2.0],'
    '"size":[0.5,0.9,0.4],"yaw":0.0,"rgb":[200,30,30],"material":"","caption":"","room":""}],'
    '"cells":{"origin_xz":[0.0,0.0],"shape":[4,10],"cell":0.05,'
    '"walkable":[[1,2,3,0,false],[1,5,2,10,true],[2,0,1,0,false]],"plinth":[]}}'
)


VERSION_2 = (
    '{"schema_version":2,"name":"Tiny","kind":"schematic","storeys":[{"label":"ground floor","floor_y":0.0,'
    '"ceiling":2.5}],"rooms":[{"name":"all","storey":0,"rect":null,"area":[],"floor":{"material":"wood","pattern":'
    '"plain","rgb":[150,120,90],"rgb2":null},"wall":{"material":"plaster","pattern":"plain","rgb":[220,220,210],"rgb2":'
    'null}}],"walls":[],"stairs":[],"furniture":[{"name":"chair_1","category":"chair","centre":[1.0,0.45,2.0],"size":'
    '[0.5,0.9,0.4],"yaw":0.0,"finish":{"material":"plastic","pattern":"plain","rgb":[200,30,30],"rgb2":null},"caption":'
    '"","room":"","role":"captioned"}],"cells":{"origin_xz":[0.0,0.0],"shape":[4,10],"cell":0.05,'
    '"walkable":[[1,2,3,0,false],[1,5,2,10,true],[2,0,1,0,false]],"plinth":[]},"clutter":0}'
)


@pytest.mark.parametrize("text", [VERSION_1, VERSION_2])
def test_a_plan_of_an_earlier_version_can_still_be_read_and_a_newer_one_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "Tiny.plan.json"
    path.write_text(text)
    assert load_plan(path) == PLAN
    path.write_text(text.replace('"schema_version":', '"schema_version":3'))
    with pytest.raises(SceneError, match=r"Tiny\.plan\.json: schema_version is 3\d; expected"):
        load_plan(path)


@pytest.mark.parametrize(
    ("yaw", "strip"),
    [
        (0.0, Rect(0.0, 2.0, 1.0, 2.5)),
        (math.pi / 2, Rect(1.0, 0.0, 1.5, 2.0)),
        (math.pi, Rect(0.0, -0.5, 1.0, 0.0)),
        (-math.pi / 2, Rect(-0.5, 0.0, 0.0, 2.0)),
    ],
)
def test_the_strip_beside_a_rectangle_lies_in_the_direction_of_the_yaw(yaw: float, strip: Rect) -> None:
    assert Rect(0.0, 0.0, 1.0, 2.0).beside(yaw, 0.5) == strip
