"""Occupancy from depth: floor, walls, holes and objects that move away, in handmade pictures with known answers."""

import numpy as np
import pytest

from grounding.maps.occupancy import OccupancyMapper, measured
from sim.frames import T_world_camera
from sim.tasks.observers import FREE, OCCUPIED, UNKNOWN
from sim.types import Camera, Pose

CAMERA = Camera(160, 120)
INTRINSICS = CAMERA
T = T_world_camera(Pose((0.0, 0.0, 0.0), yaw=0.0), CAMERA)  # looks along -z from a height of 0.88 m


def room(wall_z: float, *, floor_y: float = 0.0, hole: tuple[float, float] | None = None) -> np.ndarray:
    """Depth (H, W) of a floor and a wall at z = -wall_z; the floor is 1 m lower from `hole[0]` to `hole[1]` m ahead."""
    down = (np.arange(CAMERA.height) + 0.5 - CAMERA.height / 2) / CAMERA.focal
    depth = np.full(CAMERA.height, wall_z)
    for r, slope in enumerate(down):
        if slope <= 0:
            continue
        at = (CAMERA.mount_height - floor_y) / slope
        if hole is not None and hole[0] < at < hole[1]:
            at = (CAMERA.mount_height - floor_y + 1.0) / slope
        depth[r] = min(at, wall_z)
    return np.repeat(depth[:, None], CAMERA.width, axis=1).astype(np.float32)


def test_floor_is_free_without_gaps_but_holes_walls_and_cells_behind_them_are_not() -> None:
    mapper = OccupancyMapper()
    mapper.add(room(3.0), T, INTRINSICS)
    assert mapper.cell_at((0.02, -2.0)) == FREE
    assert mapper.cell_at((0.02, -2.98)) in (FREE, OCCUPIED)
    assert OCCUPIED in {mapper.cell_at((0.02, -3.01)), mapper.cell_at((0.02, -2.99))}
    assert mapper.cell_at((0.02, -3.3)) == UNKNOWN
    assert mapper.cell_at((0.02, -0.5)) == UNKNOWN, "below the field of view"
    mapper = OccupancyMapper()
    mapper.add(room(20.0), T, INTRINSICS)
    cells = [mapper.cell_at((0.02, -z)) for z in np.arange(1.5, 4.4, 0.05)]
    assert set(cells) == {FREE}
    assert mapper.cell_at((0.02, -5.5)) == UNKNOWN, "beyond the range of the sensor"
    mapper = OccupancyMapper()
    mapper.add(room(5.0, hole=(2.0, 3.5)), T, INTRINSICS)
    cells = [mapper.cell_at((0.02, -z)) for z in np.arange(2.1, 2.9, 0.05)]
    assert FREE not in cells
    assert OCCUPIED in cells
    assert mapper.cell_at((0.02, -1.7)) == FREE


def test_a_cell_becomes_free_after_several_clear_views_and_occupied_at_once() -> None:
    mapper = OccupancyMapper()
    mapper.add(room(2.0), T, INTRINSICS)
    (gone,) = {z for z in (-1.99, -2.01) if mapper.cell_at((0.02, z)) == OCCUPIED}
    states = []
    for _ in range(6):
        mapper.add(room(4.0), T, INTRINSICS)
        states.append(mapper.cell_at((0.02, gone)))
    assert states[0] == OCCUPIED, "a single view may be wrong"
    assert states[-1] == FREE
    mapper.add(room(2.0), T, INTRINSICS)
    assert mapper.cell_at((0.02, gone)) == OCCUPIED


@pytest.mark.parametrize(("rise", "state"), [(0.1, FREE), (0.5, OCCUPIED)])
def test_steps_that_the_robot_can_climb_are_floor_and_higher_ones_are_not(rise: float, state: int) -> None:
    mapper = OccupancyMapper()
    mapper.add(room(4.0, floor_y=rise), T, INTRINSICS)
    assert mapper.cell_at((0.02, -2.0)) == state


def test_the_robots_own_footprint_is_free_and_known_cells_stay_known() -> None:
    mapper = OccupancyMapper(centre_xz=(10.0, -3.0))
    mapper.stand((10.0, -3.0))
    assert mapper.cell_at((10.1, -3.1)) == FREE
    assert mapper.cell_at((10.3, -3.0)) == UNKNOWN
    assert mapper.cell_at((100.0, 0.0)) == UNKNOWN, "off the map"
    known = mapper.num_known
    mapper.add(room(3.0), T, INTRINSICS)
    assert mapper.num_known >= known
    assert mapper.cells.shape == mapper.grid.shape == (1000, 1000)


def test_pixels_between_a_near_and_a_far_surface_block_nothing() -> None:
    depth = room(4.0)
    depth[:70, :80] = np.minimum(depth[:70, :80], 1.5)  # a thing in front, on the left
    for col, share in ((79, 1 / 3), (80, 2 / 3)):
        depth[:70, col] = (1 - share) * 1.5 + share * room(4.0)[:70, col]
    raw, careful = OccupancyMapper(), OccupancyMapper()
    raw.add(depth, T, INTRINSICS)
    careful.add(measured(depth), T, INTRINSICS)
    between = [(x, -z) for x in np.arange(-0.1, 0.11, 0.02) for z in np.arange(1.7, 3.8, 0.05)]
    assert OCCUPIED in {raw.cell_at(place) for place in between}
    assert OCCUPIED not in {careful.cell_at(place) for place in between}
    assert careful.cell_at((-0.4, -1.52)) == OCCUPIED or careful.cell_at((-0.4, -1.48)) == OCCUPIED
    assert np.isnan(measured(np.zeros((120, 160), np.float32))).all()


def test_a_floor_at_a_flat_angle_stays_measured() -> None:
    depth = room(20.0)
    floor = (depth > 0) & (depth < 5.0)
    assert np.abs(measured(depth)[floor]) == pytest.approx(depth[floor])
