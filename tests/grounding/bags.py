"""Writes ROS bags of both kinds, for tests of their reader."""

import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sim.types import Frame

from .test_robot_frames import quat_xyzw_of

START = 1_700_000_000.0
"""Seconds of the first picture."""
STEP = 0.2
"""Seconds between pictures."""
COLOUR, DEPTH, INFO = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw", "/camera/color/camera_info"
OPTICAL = "camera_color_optical_frame"


class BagWriter:
    """Writes messages into a bag: `.bag`, or the folder of a ROS 2 bag (`.mcap` inside, or `.db3` with `db3`)."""

    def __init__(self, path: Path, *, db3: bool = False) -> None:
        """Opens a new bag."""
        self.ros1 = path.suffix == ".bag"
        self._store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:  # the store has the messages of ROS itself only
            tf = get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            self._store.register(tf)
        storage = StoragePlugin.SQLITE3 if db3 else StoragePlugin.MCAP
        self._writer: Any = Writer1(path) if self.ros1 else Writer2(path, version=9, storage_plugin=storage)
        self._writer.open()
        self._connections: dict[str, Any] = {}

    def close(self) -> None:
        """Ends the bag."""
        self._writer.close()

    def make(self, kind: str, **fields: Any) -> Any:
        """A message; sequence numbers of ROS 1 are 0."""
        if self.ros1 and kind == "std_msgs/msg/Header":
            fields["seq"] = 0
        return self._store.types[kind](**fields)

    def header(self, time: float, frame: str) -> Any:
        """A header."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(time), nanosec=round((time - int(time)) * 1e6) * 1000)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def write(self, topic: str, message: Any, time: float) -> None:
        """Writes a message 5 ms after its stamp."""
        kind = message.__msgtype__
        if topic not in self._connections:
            self.announce(topic, kind)
        serialize = self._store.serialize_ros1 if self.ros1 else self._store.serialize_cdr
        self._writer.write(self._connections[topic], round((time + 0.005) * 1e6) * 1000, serialize(message, kind))

    def announce(self, topic: str, kind: str) -> None:
        """Adds a topic without messages."""
        self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)

    def image(self, topic: str, array: np.ndarray, encoding: str, time: float, frame: str, *, padding: int = 0) -> None:
        """Writes an uncompressed picture, each row followed by `padding` bytes."""
        rows = np.ascontiguousarray(array).view(np.uint8).reshape(len(array), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        message = self.make(
            "sensor_msgs/msg/Image",
            header=self.header(time, frame),
            height=array.shape[0],
            width=array.shape[1],
            encoding=encoding,
            is_bigendian=int(array.dtype.byteorder == ">"),
            step=rows.shape[1],
            data=rows.ravel(),
        )
        self.write(topic, message, time)

    def compressed(self, topic: str, data: bytes, format: str, time: float, frame: str) -> None:
        """Writes a compressed picture."""
        message = self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(time, frame),
            format=format,
            data=np.frombuffer(data, np.uint8),
        )
        self.write(topic, message, time)

    def info(
        self,
        topic: str,
        frame: Frame,
        time: float,
        frame_id: str,
        *,
        factor: float = 1.0,
        distortion: Sequence[float] = (0.0,) * 5,
    ) -> None:
        """Writes the camera's intrinsics, for pictures `factor` times as large as the frame's."""
        fx, fy, cx, cy = (factor * value for value in frame.camera.lens)
        K = np.array([fx, 0, cx - 0.5, 0, fy, cy - 0.5, 0, 0, 1])
        letter = str if self.ros1 else str.lower
        matrices = {
            letter("D"): np.array(distortion),
            letter("K"): K,
            letter("R"): np.eye(3).ravel(),
            letter("P"): np.zeros(12),
        }
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        message = self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(time, frame_id),
            height=round(frame.camera.height * factor),
            width=round(frame.camera.width * factor),
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **matrices,
        )
        self.write(topic, message, time)

    def transforms(self, topic: str, edges: Sequence[tuple[str, str, np.ndarray]], time: float) -> None:
        """Writes (parent, child, T_parent_child) to tf."""
        items = []
        for parent, child, T in edges:
            x, y, z, w = quat_xyzw_of(T[:3, :3]).tolist()
            place = self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", T[:3, 3].tolist(), strict=True)))
            turn = self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
            transform = self.make("geometry_msgs/msg/Transform", translation=place, rotation=turn)
            header = self.header(time, parent)
            items.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=transform
                )
            )
        self.write(topic, self.make("tf2_msgs/msg/TFMessage", transforms=items), time)

    def pose(self, T: np.ndarray) -> Any:
        """A pose message."""
        x, y, z, w = quat_xyzw_of(T[:3, :3]).tolist()
        point = self.make("geometry_msgs/msg/Point", **dict(zip("xyz", T[:3, 3].tolist(), strict=True)))
        turn = self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        return self.make("geometry_msgs/msg/Pose", position=point, orientation=turn)

    def odometry(
        self, topic: str, T: np.ndarray, time: float, *, parent: str = "odom", child: str = "base_link"
    ) -> None:
        """Writes odometry."""
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        pose = self.make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(T), covariance=np.zeros(36))
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        message = self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(time, parent),
            child_frame_id=child,
            pose=pose,
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        self.write(topic, message, time)

    def pose_stamped(self, topic: str, T: np.ndarray, time: float) -> None:
        """Writes a pose."""
        self.write(
            topic,
            self.make("geometry_msgs/msg/PoseStamped", header=self.header(time, "map"), pose=self.pose(T)),
            time,
        )


def png_of(array: np.ndarray) -> bytes:
    """A PNG file."""
    stream = BytesIO()
    Image.fromarray(array).save(stream, "png")
    return stream.getvalue()


def compressed_depth_of(depth_m: np.ndarray, *, floats: bool) -> bytes:
    """Depth as compressed_depth_image_transport writes it: a header of 12 bytes, then a PNG."""
    if not floats:
        return struct.pack("<iff", 0, 0, 0) + png_of((depth_m * 1000).round().astype(np.uint16))
    a, b = 2000.0, -100.0  # value = a / depth + b
    values = np.where(depth_m > 0, a / np.maximum(depth_m, 0.1) + b + 200, 0).round().astype(np.uint16)
    return struct.pack("<iff", 0, a, b + 200) + png_of(values)
