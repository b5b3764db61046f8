"""Robot recordings in several layouts give the same map as their views do directly; unusable frames are counted."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grounding.checks.room import check_views
from grounding.maps.grid_map import GridMapBuilder
from grounding.maps.home_map import HomeMemory
from grounding.maps.storeys import ViewOptions, floors_of_frames
from grounding.robot.frames import read_robot_frames
from sim.errors import SceneError
from sim.frames import R_agent_axes, R_agent_camera
from sim.types import Frame

from .mapped_views import ColourEncoder, matrix_of_intrinsics, poses_of, write_pictures, write_recording

FRAMES = [view.frame for view in check_views()][::3]


def built(frames) -> HomeMemory:
    builder = GridMapBuilder(ColourEncoder(), cell=0.25, views=ViewOptions(floors=(0.0,)))
    for frame in frames:
        builder.add(frame)
    return builder.finish()


def plain(frame: Frame) -> Frame:
    return Frame(frame.rgb, frame.depth_m, frame.T_world_camera, frame.camera)


DIRECT = built([plain(frame) for frame in FRAMES])


def assert_same_map(found: HomeMemory, *, cells: float = 0.98, cosine: float = 0.99) -> None:
    """Fails if many cells differ; rounding of depth to mm and of colours in JPEG moves a few patches to other cells."""
    first, second = DIRECT.storeys[0].memory, found.storeys[0].memory
    assert second.grid == first.grid
    one, other = ({tuple(rc): row for rc, row in zip(m.rc.tolist(), m.rows, strict=True)} for m in (first, second))
    both = one.keys() & other.keys()
    assert len(both) >= cells * len(one.keys() | other.keys())
    assert np.mean([one[rc] @ other[rc] for rc in both]) >= cosine
    same = DIRECT.storeys[0].occupancy.cells == found.storeys[0].occupancy.cells
    assert same.mean() > 0.9995


@pytest.mark.parametrize(("up", "colour"), [("z", "jpg"), ("z", "png"), ("y", "png")])
def test_a_recording_of_simulated_views_gives_the_same_map(up, colour: str, tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up=up, colour=colour)
    frames, counts = read_robot_frames(tmp_path / "run", up=up)
    loaded = list(frames)
    assert [frame.depth_m.shape for frame in loaded] == [(120, 160)] * len(FRAMES)
    assert np.abs(loaded[0].depth_m - FRAMES[0].depth_m).max() <= 0.00051
    assert np.allclose(loaded[3].T_world_camera, FRAMES[3].T_world_camera, atol=1e-6)
    assert loaded[0].camera.lens == FRAMES[0].camera.lens
    assert (counts.num_found, counts.by_reason, counts.warning) == (8, {}, "")
    assert_same_map(built(frames))


def test_a_wrong_up_axis_gives_a_warning_and_other_heights(tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="z")
    frames, counts = read_robot_frames(tmp_path / "run", up="y")
    assert "0, 1.00) on average, in a frame whose y should point up" in counts.warning
    assert abs(float(np.mean([frame.T_world_camera[1, 3] for frame in frames])) - 0.88) > 1


@pytest.mark.parametrize("axes", ["opengl", "flu"])
def test_other_camera_axes_are_converted(axes, tmp_path: Path) -> None:
    write_recording(tmp_path / "run", FRAMES, up="y")
    for path in (tmp_path / "run/poses").iterdir():
        T = np.loadtxt(path)
        T[:3, :3] = T[:3, :3] @ R_agent_camera.T @ R_agent_axes(axes)
        np.savetxt(path, T)
    frames, _ = read_robot_frames(tmp_path / "run", up="y", camera_axes=axes)
    assert_same_map(built(frames))
    wrong, counts = read_robot_frames(tmp_path / "run", up="y")
    assert not np.allclose(wrong.some(1)[0].T_world_camera, FRAMES[0].T_world_camera, atol=0.1)
    assert counts.warning


def quat_xyzw_of(R: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation (3, 3), as the eigenvector of the largest eigenvalue; right for any trace."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
            [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
            [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], 0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R.trace()],
        ]
    )
    return np.linalg.eigh(K, UPLO="L")[1][:, -1]


def write_tum(folder: Path) -> None:
    """TUM RGB-D: pictures by time stamp, depth a little later, 5000 units per metre, poses at other times."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    lines = ["# ground truth trajectory", "# timestamp tx ty tz qx qy qz qw"]
    for index, (frame, T) in enumerate(zip(FRAMES, poses_of(FRAMES, up="z"), strict=True)):
        time = 1305031102.175304 + index / 7
        write_pictures(frame, folder / f"rgb/{time:.6f}.png", folder / f"depth/{time + 0.011:.6f}.png", per_metre=5000)
        for shift, wrong in ((-0.06, 5.0), (0.004, 0.0), (0.05, -5.0)):
            numbers = [time + shift, *(T[:3, 3] + wrong), *quat_xyzw_of(T[:3, :3])]
            lines.append(" ".join(f"{number:.7f}" for number in numbers))
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    np.savetxt(folder / "intrinsics.txt", matrix_of_intrinsics(FRAMES[0], size=3))


def write_scannet(folder: Path) -> None:
    """ScanNet's exporter: plain numbers as names, larger colour pictures, lost poses as -inf, intrinsics per size."""
    for name in ("color", "depth", "pose", "intrinsic"):
        (folder / name).mkdir(parents=True)
    for index, (frame, T) in enumerate(zip(FRAMES, poses_of(FRAMES, up="z"), strict=True)):
        write_pictures(frame, folder / f"color/{index}.jpg", folder / f"depth/{index}.png")
        large = Image.fromarray(frame.rgb).resize((320, 240), Image.Resampling.NEAREST)
        large.save(folder / f"color/{index}.jpg", quality=95)
        np.savetxt(folder / f"pose/{index}.txt", T, fmt="%.6f")
    lost = len(FRAMES)
    write_pictures(FRAMES[0], folder / f"color/{lost}.jpg", folder / f"depth/{lost}.png")
    (folder / f"pose/{lost}.txt").write_text("\n".join(["-inf -inf -inf -inf"] * 4) + "\n")
    np.savetxt(folder / "intrinsic/intrinsic_depth.txt", matrix_of_intrinsics(FRAMES[0], size=4))
    np.savetxt(folder / "intrinsic/intrinsic_color.txt", 2 * matrix_of_intrinsics(FRAMES[0], size=4))


def write_replica(folder: Path) -> None:
    """Replica as NICE-SLAM renders it: one folder, poses in one file in order, the camera file beside the scenes."""
    (folder / "results").mkdir(parents=True)
    rows = []
    for index, (frame, T) in enumerate(zip(FRAMES, poses_of(FRAMES, up="z"), strict=True)):
        names = f"results/frame{index:06}.jpg", f"results/depth{index:06}.png"
        write_pictures(frame, folder / names[0], folder / names[1], per_metre=6553.5)
        rows.append(" ".join(f"{number:.9e}" for number in T.ravel()))
    (folder / "traj.txt").write_text("\n".join(rows) + "\n")
    K = matrix_of_intrinsics(FRAMES[0], size=3)
    camera = {"w": 160, "h": 120, "fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "scale": 6553.5}
    (folder.parent / "cam_params.json").write_text(json.dumps({"camera": camera}))


def write_seven_scenes(folder: Path) -> None:
    """7-Scenes: all files of a sequence in one folder, depth 65535 where nothing was measured."""
    folder.mkdir(parents=True)
    for index, (frame, T) in enumerate(zip(FRAMES, poses_of(FRAMES, up="y"), strict=True)):
        stem = folder / f"frame-{index:06}"
        write_pictures(frame, Path(f"{stem}.color.png"), Path(f"{stem}.depth.png"))
        depth = np.array(Image.open(f"{stem}.depth.png"))
        depth[:2, :10] = 65535
        Image.fromarray(depth).save(f"{stem}.depth.png")
        np.savetxt(f"{stem}.pose.txt", T, fmt="%.8f", delimiter="\t")
    np.savetxt(folder / "camera-intrinsics.txt", matrix_of_intrinsics(FRAMES[0], size=3))


@pytest.mark.parametrize(
    ("write", "options", "skipped"),
    [
        (write_tum, {"up": "z"}, {}),
        (write_scannet, {"up": "z"}, {"pose not finite": 1}),
        (write_replica, {"up": "z"}, {}),
        (write_seven_scenes, {"up": "y"}, {}),
    ],
)
def test_known_layouts_are_read(write, options, skipped, tmp_path: Path) -> None:
    write(tmp_path / "set" / "scene")
    frames, counts = read_robot_frames(tmp_path / "set" / "scene", **options)
    memory = built(frames)
    assert dict(counts.by_reason) == skipped
    assert memory.num_frames == len(FRAMES)
    assert_same_map(memory, cells=0.95)


def test_frames_that_cannot_be_used_are_counted_by_reason(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    write_recording(folder, FRAMES + FRAMES[:3], up="y")
    T = np.loadtxt(folder / "poses/0000.txt")
    (folder / "poses/0000.txt").unlink()
    np.savetxt(folder / "poses/0001.txt", T * np.nan)
    np.savetxt(folder / "poses/0002.txt", T * 2)
    np.savetxt(folder / "poses/0003.txt", np.diag([-1.0, 1, 1, 1]) @ T)  # mirrored
    (folder / "poses/0004.txt").write_text("1 0 0 zero\n")
    (folder / "depth/0005.png").unlink()
    Image.open(folder / "depth/0006.png").convert("L").save(folder / "depth/0006.png")
    data = (folder / "color/0007.png").read_bytes()
    (folder / "color/0007.png").write_bytes(data[: len(data) // 2])
    Image.fromarray(np.zeros((120, 160), np.uint16)).save(folder / "depth/0008.png")
    Image.fromarray(np.ones((60, 80), np.uint16)).save(folder / "depth/0009.png")
    frames, counts = read_robot_frames(folder, up="y")
    assert len(list(frames)) == len(list(frames)) == 1  # a second pass does not count them again
    assert dict(counts.by_reason) == {
        "another size": 1,
        "depth not 16 bit or float": 1,
        "empty depth": 1,
        "no depth picture": 1,
        "no pose": 1,
        "picture not readable": 1,
        "pose not a rotation": 2,
        "pose not finite": 1,
        "pose not readable": 1,
    }
    assert counts.num_found == 11


def test_missing_wrong_and_ambiguous_files_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with pytest.raises(SceneError, match=r"run: is not there; expected a folder of pictures, .* Check the path."):
        read_robot_frames(folder, up="z")
    folder.mkdir()
    with pytest.raises(SceneError, match=r"run: found no colour picture; expected color/\*.jpg"):
        read_robot_frames(folder, up="z")
    folder.rmdir()
    (tmp_path / "run.zip").write_bytes(b"")
    with pytest.raises(SceneError, match=r"run.zip: is a file of an unknown kind; expected a folder, or a file that"):
        read_robot_frames(tmp_path / "run.zip", up="z")
    write_recording(folder, FRAMES, up="z")
    shutil.move(folder / "poses", folder / "elsewhere")
    with pytest.raises(SceneError, match=r"found no pose; expected poses/\*.txt, or one of poses.txt"):
        read_robot_frames(folder, up="z")
    (folder / "poses.txt").write_text("0.0 1 2 3\n")
    with pytest.raises(SceneError, match=r"poses.txt:1: found '0.0 1 2 3'; expected 8 numbers .* 7 without the time"):
        read_robot_frames(folder, up="z")
    (folder / "poses.txt").write_text("1305031102.1 0 0 0 0 0 0 1\n")
    with pytest.raises(SceneError, match=r"none of 8 colour pictures can be used: {'no pose': 8}"):
        read_robot_frames(folder, up="z")
    (folder / "poses.txt").write_text(" ".join(["1 0 0 0 0 1 0 0 0 0 1 0"]) + "\n")
    with pytest.raises(SceneError, match="holds 1 poses for 8 colour pictures"):
        read_robot_frames(folder, up="z")
    (folder / "poses.txt").unlink()
    shutil.move(folder / "elsewhere", folder / "poses")
    (folder / "intrinsics.json").unlink()
    np.savetxt(folder / "intrinsics.txt", matrix_of_intrinsics(FRAMES[0], size=3))
    for path in (folder / "color").iterdir():
        Image.open(path).resize((320, 240)).save(path)
    with pytest.raises(SceneError, match="colour is 320 x 240, depth 160 x 120; expected intrinsics that say which"):
        read_robot_frames(folder, up="z")
    (folder / "intrinsics.txt").rename(folder / "intrinsics_color.txt")
    kept = (folder / "intrinsics_color.txt").read_text()
    (folder / "intrinsics_color.txt").write_text("nan 0 1 0 1 1 0 0 1")
    with pytest.raises(SceneError, match=r"color.txt: number 1 of 9 is nan; expected finite numbers"):
        read_robot_frames(folder, up="z")
    (folder / "intrinsics_color.txt").write_text("1 2 3")
    with pytest.raises(SceneError, match=r"color.txt: holds 3 numbers; expected 9 or 16"):
        read_robot_frames(folder, up="z")
    (folder / "intrinsics_color.txt").write_text(kept)
    frames, _ = read_robot_frames(folder, up="z")
    assert frames.some(1)[0].camera.focal == pytest.approx(FRAMES[0].camera.focal / 2)
    (folder / "intrinsics.json").write_text('{"fx": 1, "fy": 1, "cx": 9000, "cy": 3, "width": 160, "height": 120}')
    with pytest.raises(SceneError, match="expected positive focal lengths and a principal point inside the picture"):
        read_robot_frames(folder, up="z")
    (folder / "intrinsics.json").write_text('{"fx": -1, "fy": 1, "cx": 80, "cy": 60, "width": 160, "height": 120}')
    with pytest.raises(SceneError, match=r"intrinsics.json: fx is -1; expected: Input should be greater than 0"):
        read_robot_frames(folder, up="z")
    shutil.copy(folder / "color/0000.png", folder / "color/00.png")
    with pytest.raises(SceneError, match=r"(00.png and 0000.png|0000.png and 00.png) have the same number"):
        read_robot_frames(folder, up="z")


def test_the_floor_below_a_camera_of_unknown_height_is_found_from_depth() -> None:
    up = np.eye(4)
    up[1, 3] = 2.9
    above = [view.frame for view in check_views(T_map_room=up)][::3]
    assert floors_of_frames(FRAMES) == pytest.approx((0.0,), abs=0.03)
    assert floors_of_frames(FRAMES + above) == pytest.approx((0.0, 2.9), abs=0.03)
    assert floors_of_frames(FRAMES + above, mount_height=0.5) == pytest.approx((0.38, 3.28))


def test_a_recording_without_any_depth_is_one_line_before_up_is_sought(tmp_path: Path) -> None:
    write_recording(tmp_path / "rec", FRAMES[:3], up="y")
    for path in (tmp_path / "rec/depth").iterdir():
        Image.fromarray(np.zeros((120, 160), np.uint16)).save(path)
    with pytest.raises(SceneError, match=r"rec: none of 3 depth pictures can be used; expected whole ones"):
        read_robot_frames(tmp_path / "rec")
