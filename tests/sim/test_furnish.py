"""Plans become triangles: where, how many, which object, which colour."""

import numpy as np
import pytest

from sim.frames import T_world_camera, forward_from_yaw
from sim.scenes.arrange import GROUPS
from sim.scenes.cells import CellGrid, CellRun
from sim.scenes.cut import CUT_HEIGHT, cut_storey
from sim.scenes.furnish import mesh_from_plan
from sim.scenes.furniture.appearance import rgb_from_text
from sim.scenes.furniture.families import look_of
from sim.scenes.furniture.parts import parts_of
from sim.scenes.plan import (
    Finish,
    Furniture,
    HomePlan,
    Opening,
    Rect,
    Rgb,
    Room,
    Stair,
    Storey,
    Wall,
)
from sim.scenes.quads import QuadBuilder
from sim.scenes.scene import TriangleMesh
from sim.types import Camera, Pose
from sim.world.raycast import Raycaster

GROUND = Storey(label="ground floor", floor_y=0.0, ceiling=2.6)
RED_CHAIR = Furniture(
    name="chair_7", category="chair", centre=(2.0, 0.45, 1.5), size=(0.5, 0.9, 0.5), finish=Finish(rgb=(178, 44, 40))
)


def _room(name: str, rect: Rect, floor: Rgb, wall: Rgb) -> Room:
    return Room(name=name, storey=0, rect=rect, floor=Finish(rgb=floor), wall=Finish(rgb=wall))


def two_rooms() -> HomePlan:
    """Two rooms of 3 m by 3 m side by side, a wall with a door between them, a red chair in the left one."""
    walls = tuple(
        Wall(storey=0, start=start, end=end, height=2.6)
        for start, end in (((0, 0), (6, 0)), ((0, 3), (6, 3)), ((0, 0), (0, 3)), ((6, 0), (6, 3)))
    )
    door = Opening(kind="door", offset=1.5, width=1.0)
    return HomePlan(
        name="Two",
        kind="invented",
        storeys=(GROUND,),
        rooms=(
            Room(
                name="left",
                storey=0,
                rect=Rect(0, 0, 3, 3),
                floor=Finish(rgb=(150, 100, 60)),
                wall=Finish(rgb=(240, 200, 200)),
            ),
            Room(
                name="right",
                storey=0,
                rect=Rect(3, 0, 6, 3),
                floor=Finish(rgb=(90, 90, 90)),
                wall=Finish(rgb=(200, 200, 240)),
            ),
        ),
        walls=(*walls, Wall(storey=0, start=(3, 0), end=(3, 3), height=2.6, openings=(door,))),
        furniture=(RED_CHAIR,),
    )


def hit_distance(
    mesh: TriangleMesh, origin: tuple[float, float, float], direction: tuple[float, float, float]
) -> float:
    """Metres to the first face."""
    return float(Raycaster(mesh).cast(np.array([origin]), np.array([direction])).range_m[0])


def test_rays_meet_walls_floor_and_ceiling_where_the_plan_has_them() -> None:
    mesh, _ = mesh_from_plan(two_rooms())
    assert hit_distance(mesh, (1, 1, 0.5), (1, 0, 0)) == pytest.approx(3 - 0.06 - 1, abs=1e-5)
    assert hit_distance(mesh, (1, 1, 1.5), (0, -1, 0)) == pytest.approx(1, abs=1e-5)
    assert hit_distance(mesh, (1, 1, 1.5), (0, 1, 0)) == pytest.approx(1.6, abs=1e-5)
    through_the_door = hit_distance(mesh, (2.6, 1.2, 1.5), (1, 0, 0))
    assert through_the_door == pytest.approx(6 - 0.06 - 2.6, abs=1e-5)
    above_the_door = hit_distance(mesh, (2.6, 2.3, 1.5), (1, 0, 0))
    assert above_the_door == pytest.approx(3 - 0.06 - 2.6, abs=1e-5)


def test_the_two_sides_of_a_wall_have_their_rooms_colours() -> None:
    mesh, _ = mesh_from_plan(two_rooms())
    hits = Raycaster(mesh).cast(np.array([[1, 1, 0.4], [5, 1, 0.4]]), np.array([[1.0, 0, 0], [-1, 0, 0]]))
    left, right = mesh.face_rgb[hits.face_ids].astype(int)
    assert left[0] > left[2] + 20
    assert right[2] > right[0] + 20


def test_a_chair_is_seen_with_its_instance_and_colour() -> None:
    mesh, objects = mesh_from_plan(two_rooms())
    assert [(item.instance_id, item.name, item.category) for item in objects] == [(1, "chair_7", "chair")]
    camera = Camera(64, 48)
    frame = Raycaster(mesh).render(T_world_camera(Pose((0.6, 0.0, 1.5), -np.pi / 2), camera), camera)
    seen = frame.rgb[frame.instance_ids == 1].astype(int)
    assert len(seen) > 50
    assert (seen[:, 0] > 2 * seen[:, 1]).all()


def test_a_storey_cut_leaves_no_wall_above_the_cut_and_no_ceiling() -> None:
    mesh, _ = mesh_from_plan(two_rooms())
    cut = cut_storey(mesh, 0.0)
    tops = cut.vertices[cut.faces][..., 1].max(axis=1)
    furniture_or_frame = 2.06  # a window's or door's frame may reach over the cut
    assert tops.max() <= furniture_or_frame
    assert (tops > CUT_HEIGHT + 1e-4).mean() < 0.02
    assert hit_distance(cut, (1, 5, 0.5), (0, -1, 0)) == pytest.approx(5, abs=1e-5)


def test_a_stair_has_steps_of_its_rise_and_a_hole_above() -> None:
    upper = Storey(label="first floor", floor_y=2.8, ceiling=2.6)
    colours = {"floor": Finish(rgb=(100, 100, 100)), "wall": Finish(rgb=(200, 200, 200))}
    plan = HomePlan(
        name="Up",
        kind="invented",
        storeys=(GROUND, upper),
        rooms=tuple(Room(name=f"r{k}", storey=k, rect=Rect(0, 0, 8, 3), **colours) for k in (0, 1)),
        stairs=(Stair(storey=0, rect=Rect(1, 1, 5.48, 2), towards="+x", num_steps=16),),
    )
    mesh, _ = mesh_from_plan(plan)
    caster = Raycaster(mesh)
    xs = 1 + 0.28 * (np.arange(16) + 0.5)
    origins = np.stack([xs, np.full(16, 5.0), np.full(16, 1.5)], axis=1)
    heights = caster.cast(origins, np.tile([0.0, -1.0, 0.0], (16, 1))).positions[:, 1]
    np.testing.assert_allclose(heights, 0.175 * (np.arange(16) + 1), atol=1e-5)
    beside = caster.cast(np.array([[3.0, 5.0, 2.5]]), np.array([[0.0, -1.0, 0.0]])).positions[0, 1]
    assert beside == pytest.approx(2.8, abs=1e-5)


def test_cells_become_floor_walls_and_plinths() -> None:
    plan = HomePlan(
        name="Cells",
        kind="schematic",
        storeys=(Storey(label="ground floor", floor_y=0.0, ceiling=2.5),),
        rooms=(Room(name="all", storey=0, floor=Finish(rgb=(100, 100, 100)), wall=Finish(rgb=(200, 200, 200))),),
        cells=CellGrid(
            origin_xz=(0.0, 0.0),
            shape=(60, 60),
            walkable=tuple(CellRun(row, 20, 20, 0) for row in range(20, 40)),
            plinth=tuple(CellRun(row, 44, 4, 25) for row in range(20, 40)),
        ),
    )
    mesh, _ = mesh_from_plan(plan)
    # centres may be up to x = 1.0; the floor goes on for the robot's radius (3 whole cells), then the wall stands
    assert hit_distance(mesh, (1.5, 1, 1.5), (-1, 0, 0)) == pytest.approx(1.5 - 0.85, abs=1e-4)
    assert hit_distance(mesh, (1.5, 1, 1.5), (0, -1, 0)) == pytest.approx(1.0, abs=1e-4)
    # towards +x a plinth: the eye looks over it to the wall behind, a foot meets its side
    assert hit_distance(mesh, (1.5, 1, 1.5), (1, 0, 0)) > 0.65
    assert len(mesh.faces) < 400


@pytest.mark.parametrize(
    "category", sorted({m.category for group in GROUPS.values() for m in group} | {"strange thing"})
)
def test_every_piece_stays_inside_its_box(category: str) -> None:
    _, size = look_of(category)
    finish = Finish(rgb=(120, 80, 40))
    piece = Furniture(name="x_1", category=category, centre=(0, 0, 0), size=size, finish=finish)
    for part in parts_of(piece):
        low = np.array(part.centre) - np.array(part.size) / 2
        high = np.array(part.centre) + np.array(part.size) / 2
        assert (low >= [-size[0] / 2 - 0.021, -0.021, -size[2] / 2 - 0.021]).all(), part
        assert (high <= [size[0] / 2 + 0.021, size[1] + 0.021, size[2] / 2 + 0.021]).all(), part


def test_solids_are_closed_and_face_outwards() -> None:
    for is_round, volume in ((False, 2 * 3 * 4.0), (True, 3 * 5 * np.sin(2 * np.pi / 10) * 2)):
        builder = QuadBuilder()
        builder.add_box((1, 2, 3), (2, 3, 4), finish=Finish(rgb=(9, 9, 9)), yaw=0.4, is_round=is_round)
        mesh = builder.mesh()
        a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(volume, rel=1e-5)


def test_a_piece_turned_by_its_yaw_shows_its_front_there() -> None:
    cabinet = Furniture(
        name="tv_1", category="tv", centre=(0, 0.3, 0), size=(1, 0.6, 0.1), finish=Finish(rgb=(9, 9, 9)), yaw=np.pi / 2
    )
    plan = two_rooms().model_copy(update={"furniture": (cabinet,), "rooms": (), "walls": ()})
    mesh, objects = mesh_from_plan(plan)
    assert objects[0].size == pytest.approx((0.1, 0.6, 1.0))
    hits = Raycaster(mesh).cast(np.array([[1.0, 0.3, 0.2], [-1.0, 0.3, 0.2]]), np.array([[-1.0, 0, 0], [1, 0, 0]]))
    front, back = mesh.face_rgb[hits.face_ids].astype(int)
    assert front[2] > back[2] + 30  # the screen is bluish, the back is the frame
    assert forward_from_yaw(np.pi / 2) == pytest.approx([-1, 0, 0], abs=1e-9)


def test_colour_words_are_found_as_whole_words() -> None:
    assert rgb_from_text("A big Blue-white sofa") == (52, 92, 164)
    assert rgb_from_text("the covered bed in the corner") is None
    assert look_of("dining table")[1] == (1.5, 0.75, 0.9)
    assert look_of("never seen")[0] == "box"
