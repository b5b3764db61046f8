"""Recordings of Stray Scanner and Record3D give the views that they were made of; damaged ones are named."""

import io
import json
import zipfile
from fractions import Fraction
from pathlib import Path

import av
import imagecodecs
import numpy as np
import pytest
from PIL import Image

from grounding.checks.room import check_views
from grounding.robot.frames import read_robot_frames
from sim.errors import MissingDependencyError, SceneError
from sim.frames import R_agent_camera
from sim.types import Frame

from .test_robot_frames import assert_same_map, built, quat_xyzw_of

FRAMES = [view.frame for view in check_views()][::3]


def large(frame: Frame) -> Image.Image:
    """The colours at twice the depth's size, as phones have them."""
    return Image.fromarray(frame.rgb).resize((320, 240), Image.Resampling.NEAREST)


def write_stray(folder: Path, *, own_lens: bool = False) -> None:
    """Stray Scanner's export: OpenCV's camera axes in ARKit's frame with y up; newer versions add fx fy cx cy."""
    for name in ("depth", "confidence"):
        (folder / name).mkdir(parents=True)
    fx, fy, cx, cy = (2 * value for value in FRAMES[0].camera.lens)
    columns = "timestamp, frame, x, y, z, qx, qy, qz, qw" + ", fx, fy, cx, cy" * own_lens
    rows = [columns]
    with av.open(str(folder / "rgb.mp4"), "w") as container:
        stream = container.add_stream("libx264rgb", rate=Fraction(30), options={"crf": "0"})
        stream.width, stream.height, stream.pix_fmt = 320, 240, "rgb24"
        for index, frame in enumerate(FRAMES):
            container.mux(stream.encode(av.VideoFrame.from_image(large(frame))))
            depth = (frame.depth_m * 1000).round().astype(np.uint16)
            Image.fromarray(depth).save(folder / f"depth/{index:06}.png")
            sure = np.full(depth.shape, 2, np.uint8)
            sure[:2, :2] = 0
            Image.fromarray(sure).save(folder / f"confidence/{index:06}.png")
            T = frame.T_world_camera
            numbers = [*T[:3, 3], *quat_xyzw_of(T[:3, :3]), *([fx, fy, cx - 0.5, cy - 0.5] * own_lens)]
            rows.append(", ".join([str(1.5 + index / 30), f"{index:06}", *map(str, numbers)]))
        container.mux(stream.encode())
    (folder / "odometry.csv").write_text("\n".join(rows) + "\n")
    K = np.array([[1 if own_lens else fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    np.savetxt(folder / "camera_matrix.csv", K, delimiter=",")


def write_record3d(path: Path, *, sized: bool = True, per_frame: bool = False, packed: bool = True, **changes) -> None:
    """A .r3d file, or its unpacked folder: OpenGL's camera axes, the intrinsic matrix column by column, LZFSE."""
    fx, fy, cx, cy = (2 * value for value in FRAMES[0].camera.lens)
    lens = [fx, fy, cx - 0.5, cy - 0.5]
    poses = [
        [*quat_xyzw_of(frame.T_world_camera[:3, :3] @ R_agent_camera.T), *frame.T_world_camera[:3, 3]]
        for frame in FRAMES
    ]
    metadata = {"w": 320, "h": 240, "fps": 30, "poses": poses, "initPose": [0, 0, 0, 1, 0, 0, 0]}
    metadata["K"] = [1 if per_frame else fx, 0, 0, 0, fy, 0, cx - 0.5, cy - 0.5, 1]
    metadata |= {"dw": 160, "dh": 120} if sized else {}
    metadata |= {"perFrameIntrinsicCoeffs": [lens] * len(FRAMES)} if per_frame else {}
    files = {"metadata": json.dumps(metadata | changes).encode()}
    for index, frame in enumerate(FRAMES):
        jpeg = io.BytesIO()
        large(frame).save(jpeg, "jpeg", quality=98)
        depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan).astype("<f4")
        sure = np.full(depth.shape, 2, np.uint8)
        sure[:2, :2] = 0
        files[f"rgbd/{index}.jpg"] = jpeg.getvalue()
        files[f"rgbd/{index}.depth"] = imagecodecs.lzfse_encode(depth.tobytes())
        files[f"rgbd/{index}.conf"] = imagecodecs.lzfse_encode(sure.tobytes())
    if packed:
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in files.items():
                archive.writestr(name, data)
    else:
        (path / "rgbd").mkdir(parents=True)
        for name, data in files.items():
            (path / name).write_bytes(data)


def assert_same_views(path: Path) -> None:
    frames, counts = read_robot_frames(path, up="y")
    loaded = list(frames)
    assert (len(loaded), counts.num_found, counts.by_reason, counts.warning) == (8, 8, {}, "")
    for found, frame in zip(loaded, FRAMES, strict=True):
        assert np.allclose(found.T_world_camera, frame.T_world_camera, atol=1e-6)
        assert found.camera.lens == pytest.approx(frame.camera.lens)
        assert not found.depth_m[:2, :2].any()  # of low confidence
        assert np.abs(found.depth_m[2:] - frame.depth_m[2:]).max() < 0.00051
    assert_same_map(built(frames), cells=0.95)


@pytest.mark.parametrize("own_lens", [False, True])
def test_a_stray_scanner_recording_gives_its_views(own_lens: bool, tmp_path: Path) -> None:
    write_stray(tmp_path / "71de12f9", own_lens=own_lens)
    assert_same_views(tmp_path / "71de12f9")
    every = list(read_robot_frames(tmp_path / "71de12f9", up="y", every=3)[0])
    assert [np.abs(found.rgb.astype(int) - FRAMES[3 * i].rgb).mean() < 3 for i, found in enumerate(every)] == [True] * 3


@pytest.mark.parametrize("case", [{}, {"sized": False}, {"per_frame": True}, {"packed": False}])
def test_a_record3d_recording_gives_its_views(case, tmp_path: Path) -> None:
    write_record3d(tmp_path / "room.r3d", **case)
    assert_same_views(tmp_path / "room.r3d")


def test_frames_of_stray_scanner_that_cannot_be_used_are_counted(tmp_path: Path) -> None:
    write_stray(tmp_path)
    lines = (tmp_path / "odometry.csv").read_text().splitlines()
    lines[1] = "1.5, 000000, nan, 0, 0, 0, 0, 0, 1"
    lines[2] = "1.5, 000001, one, 0, 0, 0, 0, 0, 1"
    lines.append("9, 000099" + lines[-1][lines[-1].index(", ", 20) :])
    (tmp_path / "odometry.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "depth/000002.png").unlink()
    (tmp_path / "depth/000003.png").write_bytes(b"no picture")
    (tmp_path / "depth/000099.png").write_bytes((tmp_path / "depth/000004.png").read_bytes())
    frames, counts = read_robot_frames(tmp_path, up="y")
    assert len(list(frames)) == 4
    assert counts.num_found == 9
    assert counts.by_reason == {
        "no colour picture": 1,
        "no depth picture": 1,
        "picture not readable": 1,
        "pose not finite": 2,
    }


def test_damaged_stray_scanner_recordings_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_stray(tmp_path)
    with pytest.raises(
        SceneError, match=r"--up is 'z' for a recording in which y points up; expected 'y'. Give --up y"
    ):
        read_robot_frames(tmp_path, up="z")
    with pytest.raises(SceneError, match=r"--camera-axes is given for a Stray Scanner recording, which does not need"):
        read_robot_frames(tmp_path, up="y", camera_axes="opengl")
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(MissingDependencyError, match=r"av: cannot be imported .*pip install 'personal-viz\[robot\]'"):
        read_robot_frames(tmp_path, up="y")
    monkeypatch.undo()
    odometry = (tmp_path / "odometry.csv").read_text()
    (tmp_path / "odometry.csv").write_text("0, 0, 0, 0, 0, 0, 1\n")
    with pytest.raises(SceneError, match=r"odometry.csv:1: names the columns '0, 0, 0.*; expected timestamp, frame, x"):
        read_robot_frames(tmp_path, up="y")
    (tmp_path / "odometry.csv").write_text(odometry.replace("000003", "third"))
    with pytest.raises(SceneError, match=r"odometry.csv:5: frame is 'third'; expected a number such as 000005"):
        read_robot_frames(tmp_path, up="y")
    (tmp_path / "odometry.csv").write_text(odometry.splitlines()[0] + "\n1, 000100, 0, 0, 0, 0, 0, 0, 1\n")
    with pytest.raises(SceneError, match=r"none of 1 frames can be used: {'no depth picture': 1}; expected a depth"):
        read_robot_frames(tmp_path, up="y")
    (tmp_path / "rgb.mp4").write_bytes(b"no video")
    with pytest.raises(SceneError, match=r"rgb.mp4: cannot be read \(.*\); expected a video. Export the recording"):
        read_robot_frames(tmp_path, up="y")
    (tmp_path / "rgb.mp4").unlink()
    with pytest.raises(SceneError, match=r"holds odometry.csv and no rgb.mp4; expected odometry.csv, rgb.mp4, camera_"):
        read_robot_frames(tmp_path, up="y")


def test_damaged_record3d_recordings_are_named(tmp_path: Path) -> None:
    path = tmp_path / "room.r3d"
    path.write_bytes(b"no archive")
    with pytest.raises(
        SceneError, match=r"room.r3d: is no zip archive \(File is not a zip file\); expected a .r3d file"
    ):
        read_robot_frames(path, up="y")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("rgbd/0.jpg", b"")
    with pytest.raises(SceneError, match=r"room.r3d: metadata cannot be read \(.*\); expected the JSON file of a rec"):
        read_robot_frames(path, up="y")
    write_record3d(path, w=0)
    with pytest.raises(SceneError, match=r"room.r3d: metadata: w is 0; expected: Input should be greater than 0"):
        read_robot_frames(path, up="y")
    write_record3d(path, poses=[[0, 0, 0, 5, 0, 0, 0]])
    with pytest.raises(SceneError, match=r"none of 1 frames can be used: {'pose not a rotation': 1}; expected a depth"):
        read_robot_frames(path, up="y")
    write_record3d(path, sized=False, w=1000, h=999)
    with pytest.raises(
        SceneError, match=r"no depth picture fits colours of 1000 x 999; expected rgbd/0.depth and so on"
    ):
        read_robot_frames(path, up="y")


def test_frames_of_record3d_that_cannot_be_used_are_counted(tmp_path: Path) -> None:
    write_record3d(tmp_path / "room", packed=False)
    (tmp_path / "room/rgbd/0.depth").write_bytes(b"not lzfse")
    (tmp_path / "room/rgbd/1.depth").unlink()
    (tmp_path / "room/rgbd/2.depth").write_bytes(imagecodecs.lzfse_encode(bytes(400)))
    (tmp_path / "room/rgbd/3.jpg").unlink()
    (tmp_path / "room/rgbd/4.jpg").write_bytes(b"no picture")
    frames, counts = read_robot_frames(tmp_path / "room", up="y")
    assert len(list(frames)) == 3
    assert counts.by_reason == {
        "another size": 1,
        "no colour picture": 1,
        "no depth picture": 1,
        "picture not readable": 2,
    }


def test_record3ds_export_as_exr_says_how_to_share(tmp_path: Path) -> None:
    (tmp_path / "EXR_RGBD/depth").mkdir(parents=True)
    (tmp_path / "EXR_RGBD/metadata.json").write_text("{}")
    (tmp_path / "EXR_RGBD/depth/0.exr").write_bytes(b"")
    with pytest.raises(SceneError, match=r"EXR_RGBD: holds Record3D's export as EXR pictures, .* share .* as .r3d."):
        read_robot_frames(tmp_path, up="y")
