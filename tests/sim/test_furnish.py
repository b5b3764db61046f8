"""Plans become triangles: their places, number, objects and colours."""

import numpy as np
import pytest

from sim.copies.cut import CUT_BELOW, cut_storey
from sim.frames import T_world_camera, forward_from_yaw
from sim.homes.building.house import mesh_from_plan
from sim.homes.building.walls import SKIRTING
from sim.homes.invented.plans import invent_plan
from sim.homes.open_home import scene_from_plan
from sim.homes.plan import Finish, HomePlan, Opening, Rect, Stair, Storey, Wall
from sim.mesh import TriangleMesh
from sim.render.raycast import Raycaster
from sim.types import CUT_HEIGHT, Camera, Pose

from .cell_plans import block, plan_of_cells
from .plans import piece, room, walls_around

GROUND = Storey(label="ground floor", floor_y=0.0, ceiling=2.6)
RED_CHAIR = piece("chair_7", (2.0, 0.45, 1.5), (0.5, 0.9, 0.5), finish=Finish(rgb=(178, 44, 40)))
DOOR = Opening(kind="door", offset=1.5, width=1.0)


def two_rooms(*, floor: Finish | None = None, door: Opening = DOOR) -> HomePlan:
    """Two rooms of 3 m by 3 m side by side, a wall with a door between them, a red chair in the left one."""
    outer = walls_around(Rect(0, 0, 6, 3), height=2.6)
    left, right = Finish(rgb=(240, 200, 200)), Finish(rgb=(200, 200, 240))
    return HomePlan(
        name="Two",
        kind="invented",
        storeys=(GROUND,),
        rooms=(
            room("left", Rect(0, 0, 3, 3), floor=floor or Finish(rgb=(150, 100, 60)), wall=left),
            room("right", Rect(3, 0, 6, 3), floor=floor or Finish(rgb=(90, 90, 90)), wall=right),
        ),
        walls=(*outer, Wall(storey=0, start=(3, 0), end=(3, 3), height=2.6, openings=(door,))),
        furniture=(RED_CHAIR,),
    )


def hit_distance(
    mesh: TriangleMesh, origin: tuple[float, float, float], direction: tuple[float, float, float]
) -> float:
    """Distance to the first face along the ray, metres."""
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
    cut = cut_storey(mesh, bottom_y=-CUT_BELOW, top_y=CUT_HEIGHT)
    tops = cut.vertices[cut.faces][..., 1].max(axis=1)
    furniture_or_frame = 2.06  # the frame of a window or door may reach above the cut
    assert tops.max() <= furniture_or_frame
    assert (tops > CUT_HEIGHT + 1e-4).mean() < 0.02
    assert hit_distance(cut, (1, 5, 0.5), (0, -1, 0)) == pytest.approx(5, abs=1e-5)


def test_a_stair_has_steps_of_its_rise_and_a_hole_above() -> None:
    upper = Storey(label="first floor", floor_y=2.8, ceiling=2.6)
    rooms = tuple(room(f"r{k}", Rect(0, 0, 8, 3), storey=k) for k in (0, 1))
    stair = Stair(storey=0, rect=Rect(1, 1, 5.48, 2), towards="+x", num_steps=16)
    plan = HomePlan(name="Up", kind="invented", storeys=(GROUND, upper), rooms=rooms, stairs=(stair,))
    mesh, _ = mesh_from_plan(plan)
    caster = Raycaster(mesh)
    xs = 1 + 0.28 * (np.arange(16) + 0.5)
    origins = np.stack([xs, np.full(16, 5.0), np.full(16, 1.5)], axis=1)
    heights = caster.cast(origins, np.tile([0.0, -1.0, 0.0], (16, 1))).positions[:, 1]
    np.testing.assert_allclose(heights, 0.175 * (np.arange(16) + 1), atol=1e-5)
    beside = caster.cast(np.array([[3.0, 5.0, 2.5]]), np.array([[0.0, -1.0, 0.0]])).positions[0, 1]
    assert beside == pytest.approx(2.8, abs=1e-5)


def test_cells_become_a_room_with_plinths_as_floor() -> None:
    plan = plan_of_cells(block(20, 20, 20, 20), plinth=block(20, 44, 20, 4, y_cm=25))
    mesh, _ = mesh_from_plan(plan)
    # cells begin at x = 1.0 and the floor a robot's radius before them; the wall stands at most 0.3 m behind its edge
    assert 0.65 <= hit_distance(mesh, (1.5, 1, 1.5), (-1, 0, 0)) < 1.0
    assert hit_distance(mesh, (1.5, 1, 1.5), (0, -1, 0)) == pytest.approx(1.0, abs=1e-4)
    # cells towards +x were seen but never walked: the room continues there
    assert 0.9 <= hit_distance(mesh, (1.5, 1, 1.5), (1, 0, 0)) < 1.3


def test_a_piece_shows_its_front_in_the_direction_of_its_yaw() -> None:
    armchair = piece("armchair_1", (0, 0.45, 0), (0.8, 0.9, 0.8), yaw=np.pi / 2)
    plan = two_rooms().model_copy(update={"furniture": (armchair,), "rooms": (), "walls": ()})
    mesh, objects = mesh_from_plan(plan)
    assert objects[0].size == pytest.approx((0.8, 0.9, 0.8))
    assert forward_from_yaw(np.pi / 2) == pytest.approx([-1, 0, 0], abs=1e-9)
    y = np.array([0.75, 0.75])
    hits = Raycaster(mesh).cast(np.array([[2.0, y[0], 0.0], [-2.0, y[1], 0.0]]), np.array([[-1.0, 0, 0], [1, 0, 0]]))
    front, back = hits.positions[:, 0]
    assert back == pytest.approx(-0.4, abs=0.12), "the backrest stands at the back"
    assert front < 0.1, "the backrest is seen over the seat from the front"


def test_a_storey_has_lamps_skirting_boards_and_a_ceiling() -> None:
    mesh, _ = mesh_from_plan(two_rooms())
    assert hit_distance(mesh, (0.5, 1, 0.5), (0, 1, 0)) == pytest.approx(1.6, abs=1e-4)
    assert hit_distance(mesh, (1.5, 1, 1.5), (0, 1, 0)) < 1.6, "a lamp hangs in the middle"
    low = hit_distance(mesh, (1.0, SKIRTING / 2, 0.7), (-1, 0, 0))
    high = hit_distance(mesh, (1.0, 1.0, 0.7), (-1, 0, 0))
    assert low < high == pytest.approx(1 - 0.06, abs=1e-5)


def test_a_window_shows_sky_and_grass_in_a_frame_that_stands_out_into_the_room() -> None:
    plan = two_rooms()
    pane = Opening(kind="window", offset=1.0, width=1.2, sill=0.9, top=2.1)
    outer = plan.walls[0].model_copy(update={"openings": (pane,)})
    mesh, _ = mesh_from_plan(plan.model_copy(update={"walls": (outer, *plan.walls[1:])}))
    at = [[0.75, 2.0, 1.5], [0.75, 1.0, 1.5], [0.36, 1.7, 1.5], [0.2, 1.7, 1.5]]
    hits = Raycaster(mesh).cast(np.array(at), np.tile([0.0, 0, -1], (4, 1)))
    sky, grass, frame, wall = mesh.face_rgb[hits.face_ids].astype(int)
    assert sky[2] > sky[0] + 20
    assert grass[1] > grass[2] + 10
    assert frame[0] > frame[2] + 20
    assert wall[0] > wall[2]
    assert hits.positions[3, 2] == pytest.approx(0.06, abs=1e-5)
    assert hits.positions[0, 2] < 0.06, "the pane lies inside the wall"
    assert hits.positions[2, 2] > 0.06, "the frame stands out"


def test_an_open_door_leaf_lies_against_a_free_wall_and_blocks_no_path() -> None:
    door = Opening(kind="door", offset=1.2, width=0.9)
    plan = two_rooms(door=door)
    scene = scene_from_plan(plan)
    walked = scene.navigation.distances(np.array([[1.2, 0.0, 0.6]]), np.array([[5.0, 0.0, 2.4]]))[0]
    assert walked < np.hypot(3.8, 1.8) * 1.12
    beside = (2.0, 0.9, 2.2), (4.0, 0.9, 2.2)
    free = [hit_distance(scene.mesh, at, (side, 0, 0)) for at, side in zip(beside, (1, -1), strict=True)]
    assert sorted(free) == pytest.approx([0.94 - 0.065, 0.94], abs=1e-3), "a leaf of 4 cm on one side"
    boxes = tuple(piece(f"box_{k}", (x, 0.2, 2.3), (0.3, 0.4, 0.3)) for k, x in enumerate((2.75, 3.25)))
    full, _ = mesh_from_plan(plan.model_copy(update={"furniture": boxes}))
    found = [hit_distance(full, at, (side, 0, 0)) for at, side in zip(beside, (1, -1), strict=True)]
    assert found == pytest.approx([0.94, 0.94], abs=1e-3), "no leaf, because furniture stands on both sides"


def test_every_wall_and_floor_faces_the_side_from_which_it_is_seen() -> None:
    scene = scene_from_plan(invent_plan("Demo", seed=1))
    rng = np.random.default_rng(0)
    eyes = np.array([scene.navigation.random_point(rng) for _ in range(40)]) + np.array([0, 0.88, 0])
    to = rng.normal(size=(40 * 80, 3))
    hits = Raycaster(scene.mesh).cast(np.repeat(eyes, 80, axis=0), to)
    is_house = (hits.face_ids >= 0) & (scene.mesh.face_instance[hits.face_ids] == 0)
    a, b, c = np.moveaxis(scene.mesh.vertices[scene.mesh.faces[hits.face_ids[is_house]]].astype(float), 1, 0)
    towards = np.einsum("ij,ij->i", np.cross(b - a, c - a), to[is_house])
    assert (hits.face_ids >= 0).mean() > 0.995, "closed on all sides"
    assert (towards < 1e-9).mean() > 0.995


def test_floors_have_one_texture_per_finish_that_continues_across_their_pieces() -> None:
    mesh, _ = mesh_from_plan(two_rooms(floor=Finish(material="wood", rgb=(150, 100, 60))))
    assert mesh.textures
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    normal = np.cross(b - a, c - a)
    is_floor = (normal[:, 1] > 1e-6) & (np.abs(a[:, 1]) < 1e-4) & (mesh.face_texture >= 0) & (mesh.face_instance == 0)
    (texture,) = set(mesh.face_texture[is_floor].tolist())
    left = is_floor & (a[:, 0] < 2.9)
    uv, points = mesh.face_uv[left].reshape(-1, 2), mesh.vertices[mesh.faces[left]].reshape(-1, 3)
    fit = np.linalg.lstsq(np.column_stack([points[:, [0, 2]], np.ones(len(points))]), uv, rcond=None)
    assert np.abs(fit[0][:2]).max() < 3, mesh.textures[texture].shape
    residual = uv - np.column_stack([points[:, [0, 2]], np.ones(len(points))]) @ fit[0]
    assert np.abs(residual).max() < 1e-3, "one plane of texture over the whole room"
