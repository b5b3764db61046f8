"""Merging of masks without ids: views of one thing become one thing, and neighbours stay apart."""

from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from grounding.maps.thing_merging import MergeRule, UnknownThings
from grounding.maps.tracked_things import Thing
from grounding.perception.segments import Segments
from sim.types import Camera, Frame

CAMERA = Camera(160, 120, 62.7)
RULE = MergeRule(merge_m=0.05, min_share=0.3, min_cosine=0.7)
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
FLOOR: Box = ((-5.0, -0.1, -5.0), (5.0, 0.0, 5.0))
TABLE: Box = ((-0.6, 0.0, -0.4), (0.6, 0.7, 0.4))
CUP: Box = ((0.1, 0.7, 0.0), (0.22, 0.85, 0.12))
CHEST: Box = ((-0.4, 0.0, -0.4), (0.4, 0.8, 0.4))
SHELF: Box = ((1.5, 0.0, -0.3), (2.0, 1.0, 0.3))


def view(angle: float, *boxes: Box, distance: float = 2.2, height: float = 1.6) -> tuple[Frame, NDArray[np.int32]]:
    """A view of the boxes on a floor from this bearing (radians), and the number of the box (from 1) of each pixel."""
    eye = np.array([distance * np.sin(angle), height, distance * np.cos(angle)])
    ahead = np.array([0.0, 0.4, 0.0]) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    T_world_camera = np.eye(4)
    T_world_camera[:3] = np.column_stack([right, np.cross(ahead, right), ahead, eye])
    fx, fy, cx, cy = CAMERA.lens
    v, u = np.indices((CAMERA.height, CAMERA.width)) + 0.5
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], axis=-1) @ T_world_camera[:3, :3].T
    depths = np.full((len(boxes) + 1, *u.shape), np.inf)
    for index, (low, high) in enumerate((FLOOR, *boxes)):
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.sort((np.array([low, high])[:, None, None] - eye) / rays, axis=0)
        near, far = sides[0].max(axis=-1), sides[1].min(axis=-1)
        depths[index][(near <= far) & (near > 0)] = near[(near <= far) & (near > 0)]
    depth = depths.min(axis=0)
    depth_m = np.where(depth < 5, depth, 0).astype(np.float32)
    frame = Frame(np.zeros((*u.shape, 3), np.uint8), depth_m, T_world_camera, CAMERA)
    return frame, np.where(depth < 5, depths.argmin(axis=0), 0).astype(np.int32)


def around(*boxes: Box, count: int = 12) -> list[tuple[Frame, NDArray[np.int32]]]:
    """Views from all sides."""
    return [view(2 * np.pi * index / count, *boxes) for index in range(count)]


def vectors(numbers: Sequence[int]) -> NDArray[np.float64]:
    """One axis for each number."""
    return np.eye(8)[list(numbers)].reshape(-1, 8)


def masks_of(ids: NDArray[np.int32]) -> dict[int, NDArray[np.bool_]]:
    return {int(number): ids == number for number in np.unique(ids) if number}


def merged(views: Iterable[tuple[Frame, Sequence[NDArray[np.bool_]], NDArray[np.float64]]]) -> list[Thing]:
    things = UnknownThings(RULE, max_depth=5.0)
    for frame, masks, features in views:
        things.add(frame, Segments(np.array(masks, bool).reshape(-1, *frame.depth_m.shape)), features)
    return things.things()


def exact(views: Iterable[tuple[Frame, NDArray[np.int32]]]) -> list[Thing]:
    return merged((frame, list(masks_of(ids).values()), vectors(list(masks_of(ids)))) for frame, ids in views)


def share_on(thing: Thing, box: Box) -> float:
    """Share of the points that are at most 6 cm outside of the box."""
    is_on = (thing.points >= np.array(box[0]) - 0.06) & (thing.points <= np.array(box[1]) + 0.06)
    return float(is_on.all(axis=1).mean())


def lies_on(thing: Thing, box: Box) -> bool:
    return share_on(thing, box) == 1


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_two_views_of_opposite_sides_of_a_box_become_one_thing(turn: float) -> None:
    things = exact([view(turn, CHEST), view(turn + np.pi, CHEST)])
    assert [thing.views for thing in things] == [2]
    assert lies_on(things[0], CHEST)
    assert np.ptp(things[0].points, axis=0) == pytest.approx([0.8, 0.8, 0.8], abs=0.12)


def test_a_cup_on_a_table_stays_apart_even_if_a_mask_covers_both() -> None:
    views = []
    for index, (frame, ids) in enumerate(around(TABLE, CUP)):
        masks = masks_of(ids)
        if index % 4 == 1:  # one mask for both, that looks like the table
            views.append((frame, [masks[1] | masks[2]], vectors([1])))
        else:
            views.append((frame, list(masks.values()), vectors([1, 2])))
    things = merged(views)
    assert len(things) == 2
    table, cup = sorted(things, key=lambda thing: -len(thing.points))
    assert lies_on(table, TABLE)
    assert lies_on(cup, CUP)
    assert cup.feature @ vectors([2])[0] > 0.9


def test_two_cups_of_the_same_kind_stay_two() -> None:
    other: Box = ((-0.4, 0.7, -0.1), (-0.28, 0.85, 0.02))
    views = [(frame, list(masks_of(ids).values()), vectors([1, 2, 2])) for frame, ids in around(TABLE, CUP, other)]
    assert len(merged(views)) == 3


def test_the_parts_of_split_masks_join() -> None:
    rng = np.random.default_rng(0)
    views = []
    for frame, ids in around(TABLE):
        rows, cols = np.indices(ids.shape)
        angle = rng.uniform(0, np.pi)
        side = (rows - 60) * np.sin(angle) + (cols - 80) * np.cos(angle) > 0
        parts = [part for part in ((ids == 1) & side, (ids == 1) & ~side) if part.any()]
        views.append((frame, parts, vectors([1] * len(parts))))
    things = merged(views)
    assert len(things) == 1
    assert lies_on(things[0], TABLE)


def test_a_ghost_that_one_view_shows_goes_and_what_every_view_shows_stays() -> None:
    views = []
    for index, (frame, ids) in enumerate(around(CHEST)):
        ghost = np.zeros_like(ids, bool)
        ghost[90:110, 20:50] = index == 3
        views.append((frame, [ids == 1, ghost], vectors([1, 5])))
    things = merged(views)
    assert len(things) == 1
    assert lies_on(things[0], CHEST)


def test_one_view_alone_keeps_its_things() -> None:
    assert len(exact([view(0.5, TABLE, CUP)])) == 2


def test_what_looks_different_in_one_view_is_still_the_same_thing() -> None:
    views = [(frame, [ids == 1], vectors([6 if k == 5 else 1])) for k, (frame, ids) in enumerate(around(CHEST))]
    things = merged(views)
    assert len(things) == 1


def test_the_floor_around_a_box_that_some_masks_cover_too_is_not_part_of_it() -> None:
    views = []
    for index, (frame, ids) in enumerate(around(CHEST)):
        mask = ndimage.binary_dilation(ids == 1, iterations=5) if index % 4 == 2 else ids == 1
        views.append((frame, [mask], vectors([1])))
    things = merged(views)
    assert len(things) == 1
    assert share_on(things[0], CHEST) >= 0.95


def test_the_order_of_views_matters_little() -> None:
    views = around(TABLE, CUP, SHELF)
    found = []
    for seed in range(4):
        order = np.random.default_rng(seed).permutation(len(views)) if seed else range(len(views))
        things = exact(views[index] for index in order)
        found.append(sorted(len(thing.points) for thing in things))
    assert {len(sizes) for sizes in found} == {3}
    sizes = np.array(found)
    assert (np.ptp(sizes, axis=0) <= 0.25 * sizes.max(axis=0) + 5).all()


def test_the_same_views_give_the_same_bytes() -> None:
    first, second = (exact(around(TABLE, CUP, SHELF)) for _ in range(2))
    assert [thing.points.tobytes() for thing in first] == [thing.points.tobytes() for thing in second]
    assert [thing.feature.tobytes() for thing in first] == [thing.feature.tobytes() for thing in second]


def test_asking_for_the_things_does_not_change_them() -> None:
    views = around(TABLE, CUP)
    asked, silent = (UnknownThings(RULE, max_depth=5.0) for _ in range(2))
    for frame, ids in views:
        for things in (asked, silent):
            things.add(frame, Segments(np.array(list(masks_of(ids).values()))), vectors(list(masks_of(ids))))
        asked.things()
    assert [thing.points.tobytes() for thing in asked.things()] == [t.points.tobytes() for t in silent.things()]


def test_views_without_masks_or_depth_add_nothing() -> None:
    frame, ids = view(0.0, CHEST)
    blind = Frame(frame.rgb, np.zeros_like(frame.depth_m), frame.T_world_camera, CAMERA)
    assert merged([(frame, [], vectors([])), (blind, [ids == 1], vectors([1]))]) == []
