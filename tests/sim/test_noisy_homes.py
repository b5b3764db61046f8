"""The floor grid on realistic scans and houses: noise, holes, thin walls, mixed winding, unusual storeys."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from sim.errors import SceneError
from sim.mesh import TriangleMesh
from sim.walk.floor_grid import FloorGrid, floor_grid_from_mesh
from tests.sim.grids import at, height_at
from tests.sim.meshes import Quad, box, floor, mesh_of, triangles

EDGE = 0.04
"""Longest side of the triangles of a scan, metres."""


def sheet(a, b, height: float, *, y: float = 0.0) -> Quad:
    """A one-sided upright rectangle from (x, z) = a to b, without thickness."""
    (x0, z0), (x1, z1) = a, b
    corners = [[x0, y, z0], [x1, y, z1], [x1, y + height, z1], [x0, y + height, z0]]
    return np.array(corners), (200, 200, 200), 0


def scanned(*quads: Quad, seed: int = 0, noise: float = 0.0, holes: float = 0.0, flipped: float = 0.0) -> TriangleMesh:
    """Rectangles as a scanner would record them.

    Args:
        quads: Rectangles that are cut into triangles of EDGE; corners at one place stay together.
        seed: Seed of noise, holes and flips.
        noise: Every corner moves by up to this along each axis, metres.
        holes: Share of triangles that are missing.
        flipped: Share of triangles that are wound the other way.
    """
    rng = np.random.default_rng(seed)
    vertices, faces, count = [], [], 0
    for (a, b, c, d), _, _ in quads:
        n, m = (max(1, math.ceil(np.linalg.norm(side - a) / EDGE)) for side in (b, d))
        s, t = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
        s, t = s[..., None], t[..., None]
        vertices.append(((1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d).reshape(-1, 3))
        index = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1) + count
        one, two, three, four = (
            part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
        )
        faces += [np.stack([one, two, three], axis=1), np.stack([one, three, four], axis=1)]
        count += (n + 1) * (m + 1)
    corners, index = np.concatenate(vertices), np.concatenate(faces)
    _, place = np.unique(np.round(corners, 4), axis=0, return_inverse=True)
    corners = corners + rng.uniform(-noise, noise, (place.max() + 1, 3))[place.ravel()]
    index = index[rng.random(len(index)) >= holes]
    turned = rng.random(len(index)) < flipped
    index[turned] = index[turned][:, ::-1]
    return replace(triangles(corners[index]), vertices=corners.astype(np.float32), faces=index.astype(np.int32))


def stair(x: float, z: float, *, rise: float, risers: int, going: float = 0.28, width: float = 1.0) -> list[Quad]:
    """Treads and risers without thickness that climb along +x from y = 0."""
    quads: list[Quad] = []
    for k in range(risers):
        x0, y0, y1 = x + k * going, k * rise, (k + 1) * rise
        front = [[x0, y0, z], [x0, y0, z + width], [x0, y1, z + width], [x0, y1, z]]
        quads += [(np.array(front), (200, 200, 200), 0), floor(x0, z, x0 + going, z + width, y=y1)]
    return quads


def distance(grid: FloorGrid, a: np.ndarray, b: np.ndarray) -> float:
    return float(grid.distances(a[None], b[None])[0])


@pytest.mark.parametrize("seed", range(3))
def test_a_floor_with_3_cm_of_noise_and_holes_stays_one_level_floor(seed):
    # Without noise, 120 x 80 cells less 5 at each side are 110 x 70 cells = 19.25 m2.
    found = floor_grid_from_mesh(scanned(floor(0, 0, 6, 4), noise=0.03, holes=0.05, seed=seed))
    assert found.area == pytest.approx(19.25, rel=0.04)
    assert len(np.unique(found.islands)) == 1
    assert found.storey_heights == pytest.approx((0.0,), abs=0.03)
    assert distance(found, at(0.5, 0.5), at(5.5, 3.5)) == pytest.approx(math.hypot(5, 3), rel=0.002)


@pytest.mark.parametrize("width", [0.7, 0.8])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_doors_of_70_and_80_cm_between_thin_walls_can_be_passed_and_the_walls_cannot(width, noise):
    edge = 2 - width / 2
    walls = [sheet((3, 0), (3, edge), 2.5), sheet((3, 4 - edge), (3, 4), 2.5)]
    lintel = sheet((3, edge), (3, 4 - edge), 0.4, y=2.1)
    found = floor_grid_from_mesh(scanned(floor(0, 0, 6, 4), *walls, lintel, noise=noise, holes=0.02))
    assert distance(found, at(1, 2), at(5, 2)) == pytest.approx(4.0, abs=0.02)
    assert distance(found, at(2.7, 0.5), at(3.3, 0.5)) > 2 * (edge - 0.5)
    assert not found.is_navigable(at(3.1, 0.5))


@pytest.mark.parametrize("side", [1, -1])
def test_a_wall_of_one_sided_faces_blocks_with_either_winding(side):
    a, b = ((3, 0), (3, 4))[::side]
    found = floor_grid_from_mesh(mesh_of(floor(0, 0, 6, 4), sheet(a, b, 2.5)))
    assert distance(found, at(1, 2), at(5, 2)) == np.inf


def test_a_dense_scan_keeps_its_floor_with_a_third_of_the_triangles_wound_the_wrong_way():
    found = floor_grid_from_mesh(scanned(floor(0, 0, 6, 4), flipped=0.33))
    assert found.area == pytest.approx(19.25, rel=0.03)


def test_a_floor_wound_downwards_is_refused_unless_both_sides_count():
    down = (floor(0, 0, 6, 4)[0][::-1], (90, 90, 90), 0)
    with pytest.raises(SceneError, match="both_sides=True counts them as floor"):
        floor_grid_from_mesh(mesh_of(down))
    assert floor_grid_from_mesh(mesh_of(down), both_sides=True).area == pytest.approx(19.25)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.02])
@pytest.mark.parametrize("lift", [0.0, 0.07, 0.13])
def test_a_noisy_stair_of_18_cm_joins_two_storeys(noise, lift):
    top = 15 * 0.18
    upper = floor(7.2, 0, 10.2, 3, y=top)
    home = [floor(0, 0, 3, 3), *stair(3, 0, rise=0.18, risers=15), upper, floor(-1, 0, -0.7, 0.3, y=-lift)]
    found = floor_grid_from_mesh(scanned(*home, noise=noise, holes=0.01))
    assert found.storey_heights == pytest.approx((0.0, top), abs=0.03)
    walked = distance(found, at(1, 0.5), at(8.2, 0.5, top))
    assert walked == pytest.approx(math.hypot(7.2, top), rel=0.01), "a straight line over the stair, in 3-D"
    path = found.shortest_path(at(1, 0.5), at(8.2, 0.5, top)[None])
    assert path is not None
    assert path[[0, -1], 1] == pytest.approx((0.0, top), abs=0.05)


def test_steps_up_a_noisy_stair_end_upstairs():
    top = 15 * 0.18
    home = scanned(
        floor(0, 0, 3, 3), *stair(3, 0, rise=0.18, risers=15), floor(7.2, 0, 10.2, 3, y=top), noise=0.01, holes=0.01
    )
    found = floor_grid_from_mesh(home)
    here = at(2.5, 0.5)
    heights = [0.0]
    for _ in range(24):
        here = np.array(found.step(here, here + at(0.25, 0.0)).position)
        heights.append(float(here[1]))
    assert here == pytest.approx(at(8.5, 0.5, top), abs=0.05)
    assert np.diff(heights).max() <= 2 * 0.2, "a step of 0.25 m climbs at most two risers"


def test_overlapping_storeys_are_not_joined_and_each_point_snaps_to_its_own():
    upper, roof = box((2, 2.6, 0), (8, 2.8, 5)), box((2, 5.4, 0), (8, 5.6, 5))
    found = floor_grid_from_mesh(scanned(floor(0, 0, 6, 5), *upper, *roof, noise=0.01))
    assert found.storey_heights == pytest.approx((0.0, 2.8), abs=0.02)
    assert height_at(found, at(4, 2.5, 0.6)) == pytest.approx(0.0, abs=0.02)
    assert height_at(found, at(4, 2.5, 2.5)) == pytest.approx(2.8, abs=0.02)
    assert distance(found, at(4, 2.5), at(4, 2.5, 2.8)) == np.inf
    rng = np.random.default_rng(0)
    for storey in found.storey_heights:
        points = [found.random_point(rng, storey_y=storey) for _ in range(20)]
        assert all(abs(point[1] - storey) < 0.05 for point in points)


def test_a_sunken_living_room_belongs_to_the_storey_around_it():
    steps = [
        floor(0, 0, 4, 6),
        sheet((4, 0), (4, 6), 0.2, y=-0.2),
        floor(4, 0, 4.4, 6, y=-0.2),
        sheet((4.4, 0), (4.4, 6), 0.2, y=-0.4),
        floor(4.4, 0, 8, 6, y=-0.4),
    ]
    found = floor_grid_from_mesh(scanned(*steps, noise=0.005))
    assert len(found.storey_heights) == 1
    assert height_at(found, at(6, 3, -0.3)) == pytest.approx(-0.4, abs=0.02)
    assert distance(found, at(1, 3), at(7, 3, -0.4)) == pytest.approx(math.hypot(6, 0.4), rel=0.01)
    lower = found.points_within(at(6, 3, -0.4)[None], 1.0, max_dy=0.1)
    assert len(lower) > 1000


def test_a_gallery_is_joined_to_the_floor_by_its_stair_and_not_over_its_edge():
    top = 15 * 0.18
    gallery = box((7.2, top - 0.2, 0), (9.2, top, 6))
    found = floor_grid_from_mesh(mesh_of(floor(0, 0, 12, 6), *stair(3, 0, rise=0.18, risers=15), *gallery))
    assert found.storey_heights == pytest.approx((0.0, top), abs=1e-3)
    down = distance(found, at(8.2, 5, top), at(10, 5))
    assert down > math.hypot(5.2, top) + 5, "back along the gallery, down the stair, and forward again below"
    position, collided = found.step(at(8.9, 3, top), at(9.15, 3, top))
    assert collided
    assert position[1] == pytest.approx(top)


def spiral(turns: float, rise: float, steps: int, inner: float, outer: float) -> list[Quad]:
    """Wedge-shaped treads around the y axis."""
    quads: list[Quad] = []
    angles = np.linspace(0, 2 * math.pi * turns, steps + 1)
    for k, (a, b) in enumerate(itertools.pairwise(angles)):
        ring = [(inner, a), (inner, b), (outer, b), (outer, a)]
        y = (k + 1) * rise
        quads.append((np.array([[r * math.cos(t), y, r * math.sin(t)] for r, t in ring]), (90, 90, 90), 0))
    return quads


def test_a_spiral_stair_whose_turns_overlap_still_leads_up():
    top = 18 * 0.17
    upper = floor(-3.0, 2.0, 3.0, 5.0, y=top)
    # 18 treads make one and a quarter turns, from the +x axis to the +z axis, where the upper floor begins.
    home = mesh_of(floor(-3, -3, 3, 3), *spiral(1.25, 0.17, 18, 0.25, 1.5), floor(-0.6, 0.3, 0.6, 2.0, y=top), upper)
    found = floor_grid_from_mesh(home)
    assert found.storey_heights == pytest.approx((0.0, top), abs=1e-3)
    up = distance(found, at(2.5, -1), at(0, 4, top))
    assert np.isfinite(up)
    assert up > 2 * math.pi * 0.45, "around the newel, not through it"
