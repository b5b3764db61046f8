"""Which way is up: in turned frames of simulated walks, and in handmade rooms where the answer is known or in doubt."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grounding.robot.upright import T_map_recording, find_up, up_from_text, up_readings
from personal_viz.bench.robot.walks import WAYS, handheld_walk
from sim.errors import SceneError
from sim.frames import R_agent_camera, T_world_glb_zup
from sim.types import Camera, Frame

CAMERA = Camera(160, 120, 62.7)
RGB = np.zeros((120, 160, 3), np.uint8)


def moved(frames: list[Frame], R: NDArray[np.float64]) -> list[Frame]:
    """The frames in a frame of poses that R (3, 3) turns theirs into."""
    T = np.eye(4)
    T[:3, :3] = R
    return [replace(frame, T_world_camera=T @ frame.T_world_camera) for frame in frames]


def in_a_box(
    size: tuple[float, float, float], place: tuple[float, float, float], angles_deg: list[tuple[float, float, float]]
) -> list[Frame]:
    """Views from a place in an empty room from (0, 0, 0) to `size`; yaw, tilt and roll of each."""
    frames = []
    fx, fy, cx, cy = CAMERA.lens
    cols, rows = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    rays_camera = np.stack([(cols - cx) / fx, (rows - cy) / fy, np.ones_like(cols)], axis=-1)
    for angles in angles_deg:
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("YXZ", angles, degrees=True).as_matrix() @ R_agent_camera
        T[:3, 3] = place
        rays = rays_camera @ T[:3, :3].T
        with np.errstate(divide="ignore"):
            depth = np.where(rays > 0, (np.array(size) - place) / rays, -np.array(place) / rays).min(axis=-1)
        frames.append(Frame(RGB, depth.astype(np.float32), T, CAMERA))
    return frames


LOOKING_ROUND = [(yaw, -15.0, 3.0) for yaw in np.arange(0.0, 360.0, 30.0).tolist()]


def off_deg(found: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    return float(np.degrees(np.arccos(np.clip(found @ true, -1, 1))))


@pytest.mark.parametrize(
    ("text", "up"),
    [("x", (1, 0, 0)), ("-y", (0, -1, 0)), ("z", (0, 0, 1)), ("0,-3,4", (0, -0.6, 0.8)), ("0, 0, -2", (0, 0, -1))],
)
def test_an_axis_or_three_numbers_name_a_direction(text: str, up: tuple[float, float, float]) -> None:
    found = up_from_text(text)
    assert found is not None
    assert found.tolist() == pytest.approx(up)


@pytest.mark.parametrize("text", ["", "up", "+y", "1,2", "0,0,0", "nan,0,1", "inf,0,0", "1,2,3,4"])
def test_other_texts_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(SceneError) as caught:
        up_from_text(text)
    assert str(caught.value) == (
        f"--up is {text!r}; expected auto, one of x, -x, y, -y, z, -z, or three numbers such as 0,-0.98,0.17. "
        "Correct it, or leave it out to find the axis from the depth."
    )


def test_auto_names_no_direction() -> None:
    assert up_from_text("auto") is None


def test_the_smallest_turn_brings_up_to_y() -> None:
    assert T_map_recording(np.array([0.0, 0, 1])) == pytest.approx(T_world_glb_zup)
    assert T_map_recording(np.array([0.0, 1, 0])) == pytest.approx(np.eye(4))
    assert T_map_recording(np.array([0.0, -1, 0])) == pytest.approx(np.diag([1.0, -1, -1, 1]))
    for up in Rotation.random(20, rng=np.random.default_rng(0)).as_matrix()[:, 0]:
        T = T_map_recording(up)
        assert T[:3, :3] @ up == pytest.approx([0, 1, 0])
        assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3))
        assert np.linalg.det(T) == pytest.approx(1)
        assert (np.trace(T[:3, :3]) - 1) / 2 == pytest.approx(up[1])  # the angle between up and +y, no more


@pytest.mark.parametrize(("seed", "way"), [(200, "handheld"), (201, "portrait"), (202, "robot")])
def test_up_is_found_in_turned_frames_of_a_walk(seed: int, way: str) -> None:
    walk = handheld_walk(seed, carrying=WAYS[way])
    frames = list(replace(walk, Ts_world_camera=walk.Ts_world_camera[::10]).frames())
    for R in Rotation.random(2, rng=np.random.default_rng(seed)).as_matrix():
        found = find_up(moved(frames, R))
        assert off_deg(found.up, R[:, 1]) < 0.5
        assert found.confidence > 0.95


def test_a_frame_whose_y_points_down_is_not_taken_for_upright() -> None:
    room = in_a_box((5.0, 2.6, 4.0), (2.0, 1.5, 2.2), LOOKING_ROUND)
    assert off_deg(find_up(room).up, np.array([0.0, 1, 0])) < 0.1
    upside_down = moved(room, np.diag([1.0, -1, -1]))  # as SLAM programs write it: the first camera's own axes
    assert off_deg(find_up(upside_down).up, np.array([0.0, -1, 0])) < 0.1


def test_an_empty_cube_seen_from_its_middle_is_refused_with_the_two_likeliest_readings() -> None:
    angles = Rotation.random(24, rng=np.random.default_rng(3)).as_euler("YXZ", degrees=True)
    cube = in_a_box((2.6, 2.6, 2.6), (1.3, 1.3, 1.3), [(yaw, tilt, roll) for yaw, tilt, roll in angles.tolist()])
    readings = up_readings(cube)
    assert len(readings) == 6
    assert sum(reading.confidence for reading in readings) <= 1
    with pytest.raises(SceneError) as caught:
        find_up(cube)
    message = str(caught.value)
    assert message.startswith("--up auto: 24 views show ")
    assert message.count("(confidence 0.") == 2
    assert (
        "expected one direction with a confidence of 0.95 or more. Name the axis that points up, e.g. --up " in message
    )
    assert "\n" not in message


def test_a_telephone_that_sees_only_a_wall_is_refused() -> None:
    wall = in_a_box((9.0, 9.0, 4.0), (4.5, 4.5, 2.0), [(yaw, 0.0, 90.0) for yaw in (-8.0, -4.0, 0.0, 4.0, 8.0)])
    with pytest.raises(SceneError, match="--up auto: 5 views"):
        find_up(wall)


def test_views_without_depth_show_no_direction() -> None:
    empty = Frame(RGB, np.zeros((120, 160), np.float32), np.eye(4), CAMERA)
    with pytest.raises(SceneError, match=r"1 views show no flat surface; .* e\.g\. --up z"):
        find_up([empty])
