"""ROS bags give the views that they were made of, with poses from tf or from odometry; what is missing is named."""

from pathlib import Path

import numpy as np
import pytest

from grounding.checks.room import check_views
from grounding.robot.frames import read_robot_frames
from grounding.robot.ros_poses import Track
from sim.errors import MissingDependencyError, SceneError

from .bags import COLOUR, DEPTH, INFO, OPTICAL, START, STEP, BagWriter, compressed_depth_of, png_of
from .mapped_views import poses_of
from .test_robot_frames import assert_same_map, built

FRAMES = [view.frame for view in check_views()][::3]
Ts_MAP_CAMERA = poses_of(FRAMES, up="z")
TIMES = [START + STEP * index for index in range(len(FRAMES))]


def pose(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    """(4, 4) of something turned about z."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = x, y, z
    return T


T_base_link = pose(0.1, 0.0, 0.5)
"""The camera's housing on the robot."""
T_link_optical = np.array([[0.0, 0, 1, 0.02], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
T_base_camera = T_base_link @ T_link_optical
Ts_MAP_BASE = [T @ np.linalg.inv(T_base_camera) for T in Ts_MAP_CAMERA]
T_map_odom = pose(3.0, -1.0, 0.0, 0.4)


def write_pictures(bag: BagWriter, *, colour: str = "rgb8", depth: str = "16UC1", depth_frame: str = OPTICAL) -> None:
    """Writes colour, depth 8 ms later, and camera info."""
    for frame, time in zip(FRAMES, TIMES, strict=True):
        bag.info(INFO, frame, time, OPTICAL)
        orders = {"rgb8": [0, 1, 2], "bgr8": [2, 1, 0], "rgba8": [0, 1, 2, 0], "bgra8": [2, 1, 0, 0]}
        if colour == "png":
            bag.compressed(f"{COLOUR}/compressed", png_of(frame.rgb), "rgb8; png compressed bgr8", time, OPTICAL)
        else:
            bag.image(COLOUR, frame.rgb[..., orders[colour]], colour, time, OPTICAL, padding=8)
        mm, later = (frame.depth_m * 1000).round().astype(np.uint16), time + 0.008
        metres = np.where(frame.depth_m > 0, frame.depth_m, np.nan).astype(np.float32)
        if depth.startswith("compressed"):
            floats = depth == "compressed 32FC1"
            kind = f"{'32FC1' if floats else '16UC1'}; compressedDepth png"
            data = compressed_depth_of(frame.depth_m, floats=floats)
            bag.compressed(f"{DEPTH}/compressedDepth", data, kind, later, depth_frame)
        else:
            array = {"16UC1": mm, "mono16": mm.astype(">u2"), "32FC1": metres}[depth]
            bag.image(DEPTH, array, depth, later, depth_frame, padding=4)


def write_tf(bag: BagWriter) -> None:
    """map -> odom (corrected every 0.5 s) -> base (at 50 Hz, half way between pictures too) -> housing -> camera."""
    bag.transforms("/tf_static", [("base_link", "/camera_link", T_base_link)], START - 1)
    bag.transforms("/tf_static", [("camera_link", OPTICAL, T_link_optical)], START - 1)
    for index in range(5):
        bag.transforms("/tf", [("map", "odom", T_map_odom)], START - 0.1 + 0.5 * index)
    for T, time in zip(Ts_MAP_BASE, TIMES, strict=True):
        T_odom_base = np.linalg.inv(T_map_odom) @ T
        for shift in (-0.01, 0.01):
            bag.transforms("/tf", [("odom", "base_link", T_odom_base)], time + shift)


def write_odometry(bag: BagWriter, topic: str = "/odom") -> None:
    """The base at 100 Hz around each picture."""
    for T, time in zip(Ts_MAP_BASE, TIMES, strict=True):
        for shift in (-0.005, 0.005):
            bag.odometry(topic, T, time + shift)


def assert_same_views(path: Path, *, depth_error: float = 0.00051, **options) -> str:
    """Fails if the views differ; returns the warning."""
    frames, counts = read_robot_frames(path, up="z", **options)
    loaded = list(frames)
    assert (len(loaded), counts.num_found, counts.by_reason) == (8, 8, {})
    for found, frame in zip(loaded, FRAMES, strict=True):
        assert np.allclose(found.T_world_camera, frame.T_world_camera, atol=1e-5)
        assert np.abs(found.depth_m - frame.depth_m).max() < depth_error
        assert (found.rgb == frame.rgb).all()
        assert found.camera.lens == pytest.approx(frame.camera.lens)
    return counts.warning


@pytest.mark.parametrize(
    ("name", "inside"),
    [("run.bag", ""), ("ros2", ""), ("ros2", "ros2.mcap"), ("old", ""), ("old", "old.db3")],
)
def test_a_bag_of_each_kind_gives_its_views_with_poses_from_tf(name: str, inside: str, tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / name, db3=name == "old")
    write_pictures(bag)
    write_tf(bag)
    bag.close()
    path = tmp_path / name / inside if inside else tmp_path / name
    assert assert_same_views(path) == ""
    assert_same_map(built(read_robot_frames(path, up="z")[0]), cells=0.97)


@pytest.mark.parametrize(
    ("colour", "depth", "error"),
    [
        ("bgr8", "mono16", 0.00051),
        ("rgba8", "32FC1", 1e-6),
        ("bgra8", "16UC1", 0.00051),
        ("png", "compressed 16UC1", 0.00051),
        ("png", "compressed 32FC1", 0.03),  # coarser the farther it is
    ],
)
def test_pictures_of_every_encoding_are_read(colour: str, depth: str, error: float, tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_pictures(bag, colour=colour, depth=depth)
    write_tf(bag)
    bag.close()
    assert_same_views(tmp_path / "run", depth_error=error)


def test_odometry_and_the_camera_s_place_on_the_robot_give_its_poses(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "static")
    write_pictures(bag)
    write_odometry(bag)
    bag.transforms("/tf_static", [("base_link", "camera_link", T_base_link)], START - 1)
    bag.transforms("/tf_static", [("camera_link", OPTICAL, T_link_optical)], START - 1)
    bag.close()
    assert_same_views(tmp_path / "static")
    bag = BagWriter(tmp_path / "bare.bag")
    write_pictures(bag)
    write_odometry(bag)
    bag.close()
    with pytest.raises(SceneError, match=rf"tf has {OPTICAL}, and odometry is of 'base_link'; .* --base-to-camera x,y"):
        read_robot_frames(tmp_path / "bare.bag", up="z")
    assert_same_views(tmp_path / "bare.bag", T_base_camera=T_base_camera)


def test_a_topic_of_poses_is_taken_when_it_is_named(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_pictures(bag)
    for T, time in zip(Ts_MAP_BASE, TIMES, strict=True):
        bag.pose_stamped("/slam/pose", T, time)
    bag.close()
    with pytest.raises(SceneError, match="--base-to-camera is given and no topic of odometry is known; expected"):
        read_robot_frames(tmp_path / "run", up="z", T_base_camera=T_base_camera)
    assert_same_views(tmp_path / "run", T_base_camera=T_base_camera, topics={"odom": "/slam/pose"})


def test_ambiguous_missing_and_wrong_topics_are_named_with_those_that_there_are(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_pictures(bag)
    write_tf(bag)
    bag.image("/rear/color/image_raw", FRAMES[0].rgb, "rgb8", START, OPTICAL)
    write_odometry(bag, "/odom")
    write_odometry(bag, "/odom_raw")
    bag.announce("/rear/camera_info", "sensor_msgs/msg/CameraInfo")
    bag.close()
    path, listed = (
        tmp_path / "run",
        r"Found /camera/aligned_depth_to_color/image_raw \(Image\), /camera/color/camera_info",
    )
    with pytest.raises(
        SceneError, match=rf"found 2 topics for colour \({COLOUR}, /rear.*--topics colour=TOPIC. {listed}"
    ):
        read_robot_frames(path, up="z")
    assert_same_views(path, topics={"colour": COLOUR})
    with pytest.raises(
        SceneError, match=rf"--topics depth=/d is not in the bag; expected sensor_msgs/msg/Im.*{listed}"
    ):
        read_robot_frames(path, up="z", topics={"depth": "/d"})
    with pytest.raises(SceneError, match=rf"--topics depth={INFO} is sensor_msgs/msg/CameraInfo; expected sensor_msgs"):
        read_robot_frames(path, up="z", topics={"depth": INFO})
    with pytest.raises(
        SceneError, match=r"--topics color=/x is not in the bag; expected one of colour, depth, info, od"
    ):
        read_robot_frames(path, up="z", topics={"color": "/x"})
    assert_same_views(path, topics={"colour": COLOUR, "odom": "/odom_raw"})
    with pytest.raises(SceneError, match=r"run: /rear/camera_info holds no message; expected the camera's intrinsics."):
        read_robot_frames(path, up="z", topics={"colour": COLOUR, "info": "/rear/camera_info"})
    only = BagWriter(tmp_path / "only")
    only.image(COLOUR, FRAMES[0].rgb, "rgb8", START, OPTICAL)
    only.close()
    with pytest.raises(
        SceneError, match=r"found 0 topics for depth \(none\); expected one. Name it with --topics depth"
    ):
        read_robot_frames(tmp_path / "only", up="z")


def test_poses_that_are_not_known_are_counted_or_named(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_pictures(bag)
    bag.transforms("/tf_static", [("base_link", OPTICAL, T_base_camera)], START - 1)
    bag.close()
    with pytest.raises(
        SceneError, match=rf"where the camera was is not known: tf has {OPTICAL} in base_link, and there"
    ):
        read_robot_frames(tmp_path / "run", up="z")
    bag = BagWriter(tmp_path / "nods")
    write_pictures(bag)
    for time in TIMES:  # a head that moves on a robot of which nothing says where it was
        bag.transforms("/tf", [("base_link", OPTICAL, T_base_camera)], time)
    bag.close()
    with pytest.raises(
        SceneError, match=rf"where the camera was is not known: tf has {OPTICAL} in base_link, and there"
    ):
        read_robot_frames(tmp_path / "nods", up="z")
    bag = BagWriter(tmp_path / "part")
    write_pictures(bag)
    bag.transforms("/tf_static", [("base_link", OPTICAL, T_base_camera)], START - 1)
    for T, time in zip(Ts_MAP_BASE[:3], TIMES[:3], strict=True):
        bag.transforms("/tf", [("map", "base_link", T)], time)
    bag.close()
    _, counts = read_robot_frames(tmp_path / "part", up="z")
    assert counts.by_reason == {"no pose": 5}
    bag = BagWriter(tmp_path / "late")
    write_pictures(bag)
    bag.transforms("/tf_static", [("base_link", OPTICAL, T_base_camera)], START - 1)
    bag.transforms("/tf", [("map", "base_link", Ts_MAP_BASE[0])], START + 60)
    bag.close()
    with pytest.raises(
        SceneError, match=rf"none of 8 pictures of {COLOUR} can be used: {{'no pose': 8}}; expected dep"
    ):
        read_robot_frames(tmp_path / "late", up="z")


def test_depth_in_another_frame_than_colour_is_told(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_pictures(bag, depth_frame="camera_depth_optical_frame")
    write_tf(bag)
    bag.close()
    warning = assert_same_views(tmp_path / "run")
    assert "depth is in the frame 'camera_depth_optical_frame' and colour in 'camera_color_optical_frame'" in warning


DEPTH_OPTICAL = "camera_depth_optical_frame"
T_colour_depth = pose(0.1, 0.0, 0.0)


def write_two_cameras(bag: BagWriter, *, topic: str = "/camera/depth/image_raw", late: float = 0.008) -> None:
    """Depth of a camera 10 cm beside the colour camera, whose pictures are black and twice as large."""
    for frame, time in zip(FRAMES, TIMES, strict=True):
        bag.image(COLOUR, np.zeros((240, 320, 3), np.uint8), "rgb8", time, OPTICAL)
        bag.info(INFO, frame, time, OPTICAL, factor=3.0)
        bag.image(topic, frame.depth_m.astype(np.float32), "32FC1", time + late, DEPTH_OPTICAL)
        bag.info("/camera/depth/camera_info", frame, time, DEPTH_OPTICAL, distortion=(0.1, -0.25, 0.0, 0.0, 0.0))
    bag.transforms("/tf_static", [(OPTICAL, DEPTH_OPTICAL, T_colour_depth)], START - 1)
    write_tf(bag)


def test_geometry_is_the_depth_camera_s_where_there_are_two_cameras(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_two_cameras(bag)
    bag.close()
    frames, counts = read_robot_frames(tmp_path / "run", up="z")
    loaded = list(frames)
    assert len(loaded) == 8
    for found, frame in zip(loaded, FRAMES, strict=True):
        assert np.allclose(found.T_world_camera, frame.T_world_camera @ T_colour_depth, atol=1e-5)
        assert found.camera.lens == pytest.approx(frame.camera.lens)  # not three times as long
        assert np.abs(found.depth_m - frame.depth_m).max() < 1e-6
    assert f"depth is in the frame {DEPTH_OPTICAL!r} and colour in {OPTICAL!r}" in counts.warning


def test_pairs_that_are_too_far_apart_in_time_are_named_with_their_topics(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run")
    write_two_cameras(bag, late=0.05)
    bag.close()
    line = (
        rf"run: none of 8 pictures of {COLOUR} can be used: {{'no depth picture': 8}}; expected depth "
        r"\(/camera/depth/image_raw\) within 0.02 s and a pose at their stamps. Name other topics with --topics."
    )
    with pytest.raises(SceneError, match=line):
        read_robot_frames(tmp_path / "run", up="z")


@pytest.mark.parametrize(
    ("topic", "is_told"), [("/camera/depth/image_raw", True), ("/camera/depth/image_rect_raw", False)]
)
def test_a_lens_that_distorts_is_told_unless_pictures_are_rectified(topic: str, is_told: bool, tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run.bag")
    write_two_cameras(bag, topic=topic)
    bag.close()
    _, counts = read_robot_frames(tmp_path / "run.bag", up="z")
    line = "/camera/depth/camera_info says that the lens distorts (plumb_bob: 0.1 -0.25 0 0 0), and distortion is not"
    assert (line in counts.warning) == is_told


def test_a_damaged_picture_is_counted_and_a_damaged_bag_is_named(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run.bag")
    write_pictures(bag, colour="rgb8")
    write_tf(bag)
    late = TIMES[-1] + 0.01
    bag.image(COLOUR, FRAMES[-1].rgb, "bayer_rggb8", late, OPTICAL)
    bag.image(DEPTH, np.zeros((120, 160), np.uint16), "16UC1", TIMES[0] - 0.015, OPTICAL)
    bag.image(COLOUR, FRAMES[0].rgb, "rgb8", TIMES[0] - 0.01, OPTICAL)
    bag.close()
    frames, counts = read_robot_frames(tmp_path / "run.bag", up="z")
    assert (len(list(frames)), counts.num_found) == (8, 10)
    assert counts.by_reason == {"empty depth": 1, "picture not readable": 1}
    data = (tmp_path / "run.bag").read_bytes()
    for name, damaged in (("short.bag", data[: len(data) // 2]), ("none.mcap", b"nothing"), ("none.db3", b"nothing")):
        (tmp_path / name).write_bytes(damaged)
        with pytest.raises(SceneError, match=rf"{name}: cannot be read \(.*\); expected a whole .bag, .mcap or .db3"):
            read_robot_frames(tmp_path / name, up="z")


def test_a_bag_without_the_extra_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.bag").write_bytes(b"")
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(MissingDependencyError, match=r"rosbags.highlevel: .*pip install 'personal-viz\[robot\]'"):
        read_robot_frames(tmp_path / "run.bag", up="z")


def test_a_pose_between_two_is_half_way_and_none_is_made_up_in_a_gap() -> None:
    track = Track("odom", is_static=False)
    half = np.sqrt(0.5)
    for time, x, quat in ((2.0, 2.0, (0, 0, half, half)), (1.0, 0.0, (0, 0, 0, 1)), (5.0, 8.0, (0, 0, 0, 1))):
        track.add(time, ((x, 0.0, 0.0), quat))
    track.add(1.5, ((np.nan, 0.0, 0.0), (0, 0, 0, 1)))
    track.add(9.0, ((8.0, 0.0, 0.0), (0, 0, 0, -1)))  # it stood still
    Ts, are_known = track.at(np.array([1.5, 0.95, 0.5, 2.05, 3.0, 5.05, 7.0]))
    assert are_known.tolist() == [True, True, False, True, False, True, True]
    assert Ts[0, :3, 3].tolist() == [1.0, 0.0, 0.0]
    assert np.arctan2(Ts[0, 1, 0], Ts[0, 0, 0]) == pytest.approx(np.pi / 4)
    assert Ts[[1, 3, 5], 0, 3].tolist() == [0.0, 2.0, 8.0]
