"""Floor plans of invented homes: rectangles that tile a storey, and the walls, doors and windows between them."""

import itertools

import numpy as np
import pytest

from sim.homes.invented.layouts import Home, Layout, draw_home, landings, turned
from sim.homes.invented.partitions import DOOR_WIDTH, borders_of, build_partition, draw_doors, railings
from sim.homes.invented.room_kinds import draw_names
from sim.homes.plan import Rect, Stair, Wall

HOMES = [(num, seed) for num in (1, 2) for seed in range(25)]
STAIR = Stair(storey=0, rect=Rect(2.0, 0.06, 6.0, 1.06), towards="+x", num_steps=16)


def area(rect: Rect) -> float:
    return (rect.x1 - rect.x0) * (rect.z1 - rect.z0)


@pytest.mark.parametrize(("num", "seed"), HOMES)
def test_rooms_tile_their_storey(num: int, seed: int) -> None:
    home = draw_home(num, np.random.default_rng(seed))
    assert len(home.storeys) == num
    assert (home.stair is None) == (num == 1)
    outlines = []
    for layout in home.storeys:
        x0, z0, x1, z1 = zip(*layout.rects, strict=True)
        outlines.append(Rect(min(x0), min(z0), max(x1), max(z1)))
        assert sum(map(area, layout.rects)) == pytest.approx(area(outlines[-1]))
        assert not any(a.grown(-1e-6).overlaps(b) for a, b in itertools.combinations(layout.rects, 2))
        assert len(layout.names) == len(layout.rects)
    assert len(set(outlines)) == 1  # the outer walls of both storeys stand above each other


@pytest.mark.parametrize("seed", range(25))
def test_a_stair_lies_in_one_room_of_each_storey_with_floor_at_both_ends(seed: int) -> None:
    home = draw_home(2, np.random.default_rng(seed))
    assert home.stair is not None
    low, high = landings(home.stair)
    for layout in home.storeys:
        around = [rect for rect in layout.rects if rect.holds_rect(home.stair.rect)]
        assert len(around) == 1
        assert around[0].grown(1e-6).holds_rect(low)
        assert around[0].grown(1e-6).holds_rect(high)


def test_homes_have_different_kinds_of_layouts() -> None:
    seen = set()
    for seed in range(40):
        for layout in draw_home(1 + seed % 2, np.random.default_rng(seed)).storeys:
            seen.add(("corridor" in layout.names, bool(layout.open_pairs), layout.is_winding, "hall" in layout.names))
    assert len(seen) >= 4


def test_turning_a_home_turns_the_stair_and_its_direction_with_the_rooms() -> None:
    home = Home((Layout((Rect(0, 0, 8, 3),), (0,), ("hall",)),), STAIR)
    mirrored = turned(home, mirror_x=True, mirror_z=False, swap=False)
    assert mirrored.stair is not None
    assert (mirrored.storeys[0].rects[0], mirrored.stair.rect) == (Rect(-8, 0, 0, 3), Rect(-6, 0.06, -2, 1.06))
    assert mirrored.stair.towards == "-x"
    swapped = turned(home, mirror_x=False, mirror_z=True, swap=True)
    assert swapped.stair is not None
    assert (swapped.storeys[0].rects[0], swapped.stair.rect) == (Rect(-3, 0, 0, 8), Rect(-1.06, 2, -0.06, 6))
    assert swapped.stair.towards == "+z"


@pytest.mark.parametrize("towards", ["+x", "-x", "+z", "-z"])
def test_landings_lie_before_the_first_and_after_the_last_step(towards) -> None:
    stair = Stair(storey=0, rect=Rect(0, 0, 2, 2), towards=towards, num_steps=4)
    low, high = landings(stair)
    ends = {
        "+x": ((-0.5, 1), (2.5, 1)),
        "-x": ((2.5, 1), (-0.5, 1)),
        "+z": ((1, -0.5), (1, 2.5)),
        "-z": ((1, 2.5), (1, -0.5)),
    }
    assert (low.centre, high.centre) == ends[towards]


def test_borders_end_where_another_room_begins_and_no_door_leads_onto_a_stair() -> None:
    borders = borders_of((Rect(0, 0, 4, 2), Rect(0, 2, 1.5, 5), Rect(1.5, 2, 4, 5)))
    inner = [(b.is_along_x, b.at, b.span, b.rooms) for b in borders if len(b.rooms) == 2]
    assert inner == [(True, 2, (0, 1.5), (0, 1)), (True, 2, (1.5, 4), (0, 2)), (False, 1.5, (2, 5), (1, 2))]
    assert sum(b.span[1] - b.span[0] for b in borders if len(b.rooms) == 1) == 2 * (4 + 5)
    layout = Layout((Rect(0, 0, 4.6, 3), Rect(0, -3, 4.6, 0)), (0,), ("hall", ""))
    stair = Stair(storey=0, rect=Rect(0.3, 0.06, 4.3, 1.06), towards="+x", num_steps=16)
    assert draw_doors(layout, stair, np.random.default_rng(0)) is None
    assert draw_doors(layout, None, np.random.default_rng(0)) == [(0, 1)]


def joined_rooms(num: int, pairs) -> set[int]:
    reached = {0}
    for _ in range(num):
        reached |= {b for pair in pairs for a, b in (pair, pair[::-1]) if a in reached}
    return reached


@pytest.mark.parametrize(("num", "seed"), HOMES)
def test_every_room_has_an_entrance_and_doors_keep_clear_of_the_stair(num: int, seed: int) -> None:
    rng = np.random.default_rng([seed, 1])
    home = draw_home(num, np.random.default_rng(seed))
    for storey, layout in enumerate(home.storeys):
        doors = draw_doors(layout, home.stair, rng)
        if doors is None:
            continue
        assert joined_rooms(len(layout.rects), [*doors, *layout.open_pairs]) == set(range(len(layout.rects)))
        partition = build_partition(layout, [""] * len(layout.rects), doors, storey=storey, stair=home.stair, rng=rng)
        found = [(w, o) for w in partition.walls for o in w.openings if o.kind == "door"]
        assert len(found) == len(doors)
        assert len(partition.gaps) == len(layout.open_pairs)
        for wall, opening in found:
            assert opening.width == DOOR_WIDTH
            assert opening.width / 2 < opening.offset < wall.length - opening.width / 2
            assert home.stair is None or not middle(wall, opening.offset).grown(0.4).overlaps(home.stair.rect)


def middle(wall: Wall, offset: float) -> Rect:
    share = offset / wall.length
    x = wall.start[0] + (wall.end[0] - wall.start[0]) * share
    z = wall.start[1] + (wall.end[1] - wall.start[1]) * share
    return Rect(x, z, x, z)


def test_railings_stand_at_the_open_sides_of_the_stairwell_but_not_at_its_landing() -> None:
    wall = Wall(storey=1, start=(0.0, 0.0), end=(8.0, 0.0), height=2.6)
    found = {(rail.start, rail.end) for rail in railings(STAIR, [wall])}
    assert found == {((1.97, 0.06), (1.97, 1.06)), ((2.0, 1.09), (6.0, 1.09))}
    assert all(rail.storey == 1 and rail.height < 1 for rail in railings(STAIR, [wall]))


def test_a_bathroom_is_a_small_room_with_one_door() -> None:
    rects = (Rect(0, 0, 8, 2), Rect(0, 2, 3, 5), Rect(3, 2, 8, 5), Rect(0, -4, 8, 0))
    for seed in range(10):
        names = draw_names(["hall", "", "", ""], rects, [3, 1, 1, 2], storey=(2, 1), rng=np.random.default_rng(seed))
        assert names is not None
        assert names[0] == "upper hall"
        assert names[1] == "bathroom"
        assert "main bedroom" in names
    assert draw_names(["hall", "", ""], rects[:3], [2, 2, 2], storey=(2, 1), rng=np.random.default_rng(0)) is None
