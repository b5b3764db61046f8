"""Public layouts with known cameras, depth as floats, units that cannot be right, and every n-th frame."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.checks.room import check_views
from grounding.maps.storeys import points_at
from grounding.robot.frames import read_robot_frames
from sim.errors import SceneError
from sim.types import Frame

from .mapped_views import write_recording
from .test_robot_frames import quat_xyzw_of

FRAMES = [view.frame for view in check_views()][::6]
REAL = Path(__file__).parents[3] / "shared/robot/slambook2-ch12"


def write_kinect_like(folder: Path, *, tum: bool, per_metre: float, size: tuple[int, int] = (640, 480)) -> None:
    """One frame of a wall 2 m ahead, without intrinsics, in the names of TUM or 7-Scenes."""
    folder.mkdir(parents=True)
    colour = Image.new("RGB", size, (200, 30, 30))
    depth = Image.fromarray(np.full(size[::-1], 2 * per_metre, np.uint16))
    if tum:
        for name, picture in (("rgb", colour), ("depth", depth)):
            (folder / name).mkdir()
            picture.save(folder / name / "1305031102.175304.png")
        (folder / "groundtruth.txt").write_text("1305031102.175304 1 2 3 0 0 0 1\n")
    else:
        colour.save(folder / "frame-000000.color.png")
        depth.save(folder / "frame-000000.depth.png")
        np.savetxt(folder / "frame-000000.pose.txt", np.eye(4))


@pytest.mark.parametrize(
    ("name", "lens", "warning"),
    [
        ("rgbd_dataset_freiburg1_desk", (517.3, 516.5, 319.1, 255.8), ""),
        ("rgbd_dataset_freiburg2_xyz", (520.9, 521.0, 325.6, 250.2), ""),
        ("rgbd_dataset_freiburg3_long_office_household", (535.4, 539.2, 320.6, 248.1), ""),
        ("office", (525.0, 525.0, 320.0, 240.0), "took a Kinect's default, fx fy cx cy = 525 525 319.5 239.5"),
    ],
)
def test_each_camera_of_tum_is_known(name: str, lens, warning: str, tmp_path: Path) -> None:
    write_kinect_like(tmp_path / name, tum=True, per_metre=5000)
    frames, counts = read_robot_frames(tmp_path / name, up="y")
    (frame,) = frames
    assert frame.camera.lens == pytest.approx(lens)
    assert frame.depth_m[100, 100] == 2.0
    assert warning in counts.warning
    assert bool(warning) == ("Kinect" in counts.warning)


def test_lists_of_pictures_say_their_times(tmp_path: Path) -> None:
    write_kinect_like(tmp_path / "office", tum=True, per_metre=5000)
    for name in ("rgb", "depth"):
        (picture,) = (tmp_path / "office" / name).iterdir()
        picture.rename(picture.with_name("first.png"))
    colours, depths = tmp_path / "office/rgb.txt", tmp_path / "office/depth.txt"
    colours.write_text("# timestamp filename\n1305031102.175304 rgb/first.png\n1305031103.0 rgb/lost.png\n")
    depths.write_text("# timestamp filename\n1305031102.160738 depth/first.png\n")
    frames, counts = read_robot_frames(tmp_path / "office", up="y")
    assert [entry.T_world_camera[:3, 3].tolist() for entry in frames] == [[1.0, 2.0, 3.0]]
    assert (counts.num_found, counts.by_reason) == (2, {"no depth picture": 1})
    depths.write_text("1305031102.150000 depth/first.png\n")  # 25 ms from the colours
    with pytest.raises(SceneError, match=r"none of 2 colour pictures can be used: {'no depth picture': 2}"):
        read_robot_frames(tmp_path / "office", up="y")
    for line in ("soon depth/first.png", "1305031102.15", "nan depth/first.png"):
        depths.write_text(f"1305031102.0 depth/first.png\n{line}\n")
        with pytest.raises(SceneError, match=rf"depth.txt:2: found '{line}'; expected a time in seconds and a file"):
            read_robot_frames(tmp_path / "office", up="y")


def test_the_camera_of_seven_scenes_is_known_and_its_offset_is_told(tmp_path: Path) -> None:
    write_kinect_like(tmp_path / "seq-01", tum=False, per_metre=1000)
    frames, counts = read_robot_frames(tmp_path / "seq-01", up="y")
    (frame,) = frames
    assert frame.camera.lens == (585.0, 585.0, 320.0, 240.0)
    assert frame.depth_m.max() == 2.0
    assert "7-Scenes' depth is not registered to its colours" in counts.warning


def test_a_known_camera_is_not_taken_for_pictures_of_another_size(tmp_path: Path) -> None:
    write_kinect_like(tmp_path / "small", tum=True, per_metre=5000, size=(320, 240))
    with pytest.raises(SceneError, match="depth is 320 x 240 without intrinsics; expected 640 x 480, as TUM has it"):
        read_robot_frames(tmp_path / "small", up="y")


@pytest.mark.parametrize("kind", ["npy", "npy of mm", "tiff", "tif of uint16"])
def test_depth_may_be_floats_in_metres(kind: str, tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    for index, frame in enumerate(FRAMES):
        (tmp_path / f"run/depth/{index:04}.png").unlink()
        stem = tmp_path / f"run/depth/{index:04}"
        depth = frame.depth_m.copy()
        depth[0, 0], depth[0, 1] = np.nan, -1
        match kind:
            case "npy":
                np.save(f"{stem}.npy", depth)
            case "npy of mm":
                np.save(f"{stem}.npy", np.nan_to_num(depth.clip(0) * 1000).astype(np.uint16)[..., None])
            case "tiff":
                Image.fromarray(depth).save(f"{stem}.tiff")
            case _:
                Image.fromarray(np.nan_to_num(depth.clip(0) * 1000).astype(np.uint16)).save(f"{stem}.tif")
    frames, counts = read_robot_frames(tmp_path / "run", up="y")
    loaded = list(frames)
    assert (len(loaded), counts.by_reason) == (len(FRAMES), {})
    assert loaded[0].depth_m[0, :2].tolist() == [0, 0]
    tolerance = 1e-6 if kind in ("npy", "tiff") else 0.0011
    assert np.abs(loaded[1].depth_m[1:] - FRAMES[1].depth_m[1:]).max() < tolerance


def test_depth_that_is_a_picture_of_eight_bits_or_a_stack_is_counted(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    for index in range(3):
        (tmp_path / f"run/depth/000{index}.png").unlink()
    np.save(tmp_path / "run/depth/0000.npy", np.ones((2, 120, 160), np.float32))
    np.save(tmp_path / "run/depth/0001.npy", np.ones((120, 160), np.uint8))
    (tmp_path / "run/depth/0002.npy").write_bytes(b"\x93NUMPY")
    _, counts = read_robot_frames(tmp_path / "run", up="y")
    assert counts.by_reason == {"depth not 16 bit or float": 2, "picture not readable": 1}


def test_a_median_depth_that_cannot_be_right_names_the_unit_that_fits(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    line = (
        r"run: the median depth of 4 frames is 0.48 m at 5000 units per metre; expected 0.5 to 12 m. Give "
        r"--depth-per-metre 1000, with which it is 2.40 m."
    )
    with pytest.raises(SceneError, match=line):
        read_robot_frames(tmp_path / "run", up="y", depth_per_metre=5000)
    with pytest.raises(SceneError, match=r"is 2.4e\+03 m at 1 units per metre; .* Give --depth-per-metre 1000, with"):
        read_robot_frames(tmp_path / "run", up="y", depth_per_metre=1)
    for path in (tmp_path / "run/depth").iterdir():
        Image.fromarray(np.full((120, 160), 3, np.uint16)).save(path)
    with pytest.raises(SceneError, match=r"is 0.0006 m at 5000 units .* Give --depth-per-metre 1, with which it is 3"):
        read_robot_frames(tmp_path / "run", up="y", depth_per_metre=5000)
    with pytest.raises(SceneError, match=r"is 3e-06 m at 1e\+06 units per metre; .* Give --depth-per-metre 1, with"):
        read_robot_frames(tmp_path / "run", up="y", depth_per_metre=1e6)


def test_every_nth_usable_frame_is_read(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    (tmp_path / "run/poses/0001.txt").unlink()
    frames, counts = read_robot_frames(tmp_path / "run", up="y", every=2)
    assert len(FRAMES) == 4
    places = [frame.T_world_camera[:3, 3].tolist() for frame in frames]
    assert places == [pytest.approx(FRAMES[index].T_world_camera[:3, 3], abs=1e-6) for index in (0, 3)]
    assert (counts.num_found, counts.by_reason) == (4, {"no pose": 1})


def test_geometry_alone_reads_no_colours(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    frames, _ = read_robot_frames(tmp_path / "run", up="y", colour=False)
    for path in (tmp_path / "run/color").iterdir():
        path.write_bytes(b"")  # sizes were read from it before
    assert [frame.rgb.any() for frame in frames] == [False] * 4


def test_options_of_another_layout_are_refused(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    with pytest.raises(SceneError, match=r"--topics is given for a folder of pictures, which does not need it"):
        read_robot_frames(tmp_path / "run", up="y", topics={"depth": "/d"})
    with pytest.raises(SceneError, match=r"--base-to-camera is given for a folder of pictures, .* a ROS bag only"):
        read_robot_frames(tmp_path / "run", up="y", T_base_camera=np.eye(4))


def test_poses_without_times_are_in_the_order_of_the_pictures(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    shutil.rmtree(tmp_path / "run/poses")
    rows = [[*frame.T_world_camera[:3, 3], *quat_xyzw_of(frame.T_world_camera[:3, :3])] for frame in FRAMES]
    np.savetxt(tmp_path / "run/pose.txt", rows)
    frames, _ = read_robot_frames(tmp_path / "run", up="y")
    assert [np.allclose(a.T_world_camera, b.T_world_camera) for a, b in zip(frames, FRAMES, strict=True)] == [True] * 4


@pytest.mark.skipif(not REAL.is_dir(), reason="needs ../shared/robot")
def test_frames_of_another_program_agree_with_each_other(tmp_path: Path) -> None:
    """Five frames of slambook2, chapter 12: its program reads them with fy = -480 and 5000 units per metre."""
    for name in ("color", "depth"):
        (tmp_path / name).symlink_to(REAL / name)
    x, y, z, qx, qy, qz, qw = np.loadtxt(REAL / "pose.txt").T
    np.savetxt(tmp_path / "pose.txt", np.column_stack([x, -y, z, -qx, qy, -qz, qw]))  # fy > 0 mirrors y
    (tmp_path / "intrinsics.txt").write_text("481.2 0 319.5 0 480 239.5 0 0 1")
    frames, counts = read_robot_frames(tmp_path, up="y", depth_per_metre=5000)
    loaded = list(frames)
    assert (len(loaded), counts.num_found, counts.by_reason) == (5, 5, {})
    assert _median_apart(loaded[3], loaded[4]) < 0.03
    assert _median_apart(loaded[0], loaded[1]) < 0.06
    wrong, _ = read_robot_frames(tmp_path, up="y")  # 9 m on average, which could be
    assert _median_apart(*list(wrong)[3:5]) > 0.2


def _median_apart(first: Frame, second: Frame) -> float:
    """How far the points of one view are from the other view's surfaces, where it sees them; metres along z."""
    fx, fy, cx, cy = first.camera.lens
    rc = np.mgrid[8:480:16, 8:640:16].reshape(2, -1).T
    points = np.column_stack([points_at(first, rc), np.ones(len(rc))])
    x, y, z, _ = np.linalg.inv(second.T_world_camera) @ points[~np.isnan(points[:, 0])].T
    col, row = np.floor(x / z * fx + cx).astype(int), np.floor(y / z * fy + cy).astype(int)
    inside = (z > 0) & (col >= 0) & (col < 640) & (row >= 0) & (row < 480)
    assert inside.sum() > 300
    there = second.depth_m[row[inside], col[inside]]
    return float(np.median(np.abs(there - z[inside])[there > 0]))
