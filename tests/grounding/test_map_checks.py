"""The check for map builders: our own pass, and each breach of the contract is named."""

import re
from dataclasses import replace

import numpy as np
import pytest

from grounding.checks import check_map_builder
from grounding.checks.room import BOXES, check_views
from grounding.maps.grid_map import GridMapBuilder
from grounding.maps.home_map import HomeMemory, OccupancyGrid
from grounding.maps.object_map import ObjectMapBuilder
from grounding.maps.storeys import ViewOptions
from grounding.perception.segment_depth import DepthRegions
from grounding.perception.segments import InstanceIds
from sim.types import Frame, GridSpec

from .mapped_views import ColourEncoder, IdEncoder

IDS = IdEncoder(2)


@pytest.mark.parametrize(
    "builder",
    [
        GridMapBuilder(IDS),
        GridMapBuilder(IDS, cell=0.25),
        GridMapBuilder(IDS, features="images"),
        ObjectMapBuilder(IDS, InstanceIds()),
    ],
    ids=lambda builder: builder.name,
)
def test_our_builders_keep_the_contract(builder) -> None:
    assert check_map_builder(builder, IDS) == []


@pytest.mark.slow
def test_builders_that_read_only_colours_keep_the_contract_too() -> None:
    assert check_map_builder(GridMapBuilder(ColourEncoder(), cell=0.5), ColourEncoder()) == []
    assert check_map_builder(ObjectMapBuilder(ColourEncoder(), DepthRegions(floors=(0.0,))), ColourEncoder()) == []


def test_the_boxes_of_the_check_room_are_seen_at_their_stated_places() -> None:
    views = check_views()
    for number, (low, high) in BOXES.items():
        points = np.concatenate([view.points[view.frame.instance_ids == number] for view in views])
        assert len(points) > 500
        assert (points >= np.array(low) - 1e-6).all()
        assert (points <= np.array(high) + 1e-6).all()


class Changed:
    """Our grid builder; each subclass breaks one thing."""

    name = "changed"

    def __init__(self, **options) -> None:
        self._inner = GridMapBuilder(IDS, views=ViewOptions(**options))

    def reset(self) -> None:
        self._inner.reset()

    def add(self, frame: Frame) -> None:
        self._inner.add(frame)

    def finish(self) -> HomeMemory:
        return self._inner.finish()


class OpenGl(Changed):
    def add(self, frame: Frame) -> None:
        super().add(replace(frame, T_world_camera=frame.T_world_camera @ np.diag([1.0, -1, -1, 1])))


class LeftIsRight(Changed):
    def add(self, frame: Frame) -> None:
        T = frame.T_world_camera.copy()
        flip = np.diag([-1.0, 1, 1])
        T[:3, :3] = flip @ T[:3, :3] @ flip
        super().add(replace(frame, T_world_camera=T))


class Swapped(Changed):
    """Swaps rows and columns of the features; the occupancy is right."""

    def finish(self) -> HomeMemory:
        memory = super().finish()
        swapped = []
        for storey in memory.storeys:
            found = storey.memory
            order = np.lexsort((found.rc[:, 0], found.rc[:, 1]))
            changed = replace(found, rc=found.rc[order][:, ::-1].copy(), rows=found.rows[order])
            swapped.append(replace(storey, memory=changed))
        return replace(memory, storeys=tuple(swapped))


class Mirrored(Changed):
    """Mirrors only the occupancy, left to right."""

    def finish(self) -> HomeMemory:
        memory = super().finish()
        storeys = []
        for storey in memory.storeys:
            (x, z), cells = storey.occupancy.grid.origin_xz, storey.occupancy.cells
            grid = GridSpec((-x - cells.shape[1] * 0.05, z), 0.05, cells.shape)
            storeys.append(replace(storey, occupancy=OccupancyGrid(cells[:, ::-1].copy(), grid)))
        return replace(memory, storeys=tuple(storeys))


class KeepsAll(Changed):
    def reset(self) -> None:
        pass


class Scribbler(Changed):
    def add(self, frame: Frame) -> None:
        super().add(frame)
        frame.depth_m[frame.depth_m > 3] = 0


class Blind(Changed):
    def add(self, frame: Frame) -> None:
        super().add(replace(frame, ids=np.zeros_like(frame.instance_ids)))


@pytest.mark.parametrize(
    ("builder", "message"),
    [
        (OpenGl(), "number of free cells is"),
        (LeftIsRight(), "check yaw and axes"),
        (Swapped(), "content around .* is 'the same'; expected other content"),
        (Mirrored(), "share of free cells that are free is"),
        (KeepsAll(), "frames is 48; expected 24"),
        (Scribbler(), "a view's arrays after add is 'changed'"),
        (Blind(), "number of cells is 0"),
        (Changed(mount_height=1.5), "height of the floor is -0.62"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Changed) else "",
)
def test_a_broken_builder_is_named(builder: Changed, message: str) -> None:
    (problem,) = check_map_builder(builder, IDS)
    assert re.search(message, problem)
