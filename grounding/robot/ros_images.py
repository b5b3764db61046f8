"""Pictures of ROS messages: `sensor_msgs/Image`, and `CompressedImage` as jpeg, png or compressedDepth."""

import struct
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .recording import Unusable

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_COLOURS: dict[str, tuple[int, ...]] = {
    "rgb8": (0, 1, 2),
    "bgr8": (2, 1, 0),
    "rgba8": (0, 1, 2),
    "bgra8": (2, 1, 0),
    "8UC3": (2, 1, 0),
    "mono8": (0, 0, 0),
    "8UC1": (0, 0, 0),
}
"""The channels that are red, green and blue; OpenCV's unnamed 8UC3 is blue first."""
_CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1}
_DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
"""numpy's types of depth; 16 bit are millimetres, floats are metres (ROS REP 118)."""
_DEPTH_HEADER = struct.Struct("<iff")
"""Before the PNG of compressedDepth: format, and two numbers a and b with depth = a / (value - b) for floats
(compressed_depth_image_transport)."""


def colours_of(message: Any, msgtype: str) -> NDArray[np.uint8]:
    """(H, W, 3) colours of a message.

    Raises:
        Unusable: Its encoding is not known, or the data do not fit its size.
        OSError: The compressed picture is damaged; or what else PIL raises.
    """
    if msgtype == COMPRESSED:
        with Image.open(BytesIO(message.data.tobytes())) as image:
            return np.asarray(image.convert("RGB"))
    if message.encoding not in _COLOURS:
        raise Unusable("picture not readable")
    pixels = _pixels(message, np.dtype("u1"), _CHANNELS[message.encoding])
    return np.ascontiguousarray(pixels[..., list(_COLOURS[message.encoding])])


def depth_of(message: Any, msgtype: str) -> NDArray[np.generic]:
    """(H, W) depth of a message in its own units: integers in millimetres or floats in metres.

    Raises:
        Unusable: Its encoding is not one of depth, or the data do not fit its size.
        OSError: The compressed picture is damaged; or what else PIL raises.
    """
    if msgtype == COMPRESSED:
        return _compressed_depth(message)
    if message.encoding not in _DEPTHS:
        raise Unusable("depth not 16 bit or float")
    order = ">" if message.is_bigendian else "<"
    return _pixels(message, np.dtype(order + _DEPTHS[message.encoding]), 1)[..., 0]


def is_float_depth(message: Any, msgtype: str) -> bool:
    """Whether a depth message holds floats, in metres."""
    return (message.format if msgtype == COMPRESSED else message.encoding).startswith("32FC1")


def size_of(message: Any, msgtype: str) -> tuple[int, int]:
    """(width, height) of a message's picture; raises what PIL raises for a damaged compressed one."""
    if msgtype != COMPRESSED:
        return message.width, message.height
    data = message.data.tobytes()
    if "compressedDepth" in message.format:
        data = data[_DEPTH_HEADER.size :]
    with Image.open(BytesIO(data)) as image:
        return image.size


def _pixels(message: Any, dtype: np.dtype, channels: int) -> NDArray[Any]:
    """(H, W, channels) of an uncompressed message, whose rows may be longer than their pixels."""
    used = message.width * channels * dtype.itemsize
    if message.step < used or len(message.data) < message.step * message.height:
        raise Unusable("picture not readable")
    rows = np.asarray(message.data, np.uint8)[: message.step * message.height].reshape(message.height, message.step)
    pixels = np.ascontiguousarray(rows[:, :used]).view(dtype).reshape(message.height, message.width, channels)
    return pixels.astype(dtype.newbyteorder("="))


def _compressed_depth(message: Any) -> NDArray[np.generic]:
    data = message.data.tobytes()
    is_quantised = False
    a = b = 0.0
    if "compressedDepth" in message.format:
        if len(data) <= _DEPTH_HEADER.size or "rvl" in message.format:
            raise Unusable("picture not readable")
        _, a, b = _DEPTH_HEADER.unpack_from(data)
        data, is_quantised = data[_DEPTH_HEADER.size :], message.format.startswith("32FC1")
    with Image.open(BytesIO(data)) as image:
        values = np.asarray(image)
    if not is_quantised:
        return values
    with np.errstate(divide="ignore"):
        return np.where(values > 0, a / (values.astype(np.float32) - b), 0).astype(np.float32)
