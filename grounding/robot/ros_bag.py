"""Reads a ROS bag: `.bag` of ROS 1, `.mcap` or `.db3` of ROS 2, or the folder of a ROS 2 bag.

Colour, depth and camera info by topic; poses of the camera from tf (map or odom -> base -> camera), or from odometry
and the camera's place on the robot. Needs the extra `robot`; no ROS.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.extras import require
from sim.types import Camera

from .intrinsics import Size, camera_of
from .pictures import DAMAGED
from .poses import MAX_APART
from .recording import Entry, FrameCounts, ReadingOptions, Recording, Unusable, metres, units_of
from .ros_images import COMPRESSED, IMAGE, colours_of, depth_of, is_float_depth, size_of
from .ros_poses import Track, TransformTree

ROLES = ("colour", "depth", "info", "odom")
"""What `--topics` can name."""
_INFO, _TF = "sensor_msgs/msg/CameraInfo", ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_ODOMETRY = "nav_msgs/msg/Odometry"
_POSES = (_ODOMETRY, "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
"""Poses of a topic that `--topics odom=` names; only odometry is taken unasked, as a goal is a PoseStamped too."""
_TYPES = {"colour": (IMAGE, COMPRESSED), "depth": (IMAGE, COMPRESSED), "info": (_INFO,), "odom": _POSES}
_BASES = ("base_link", "base_footprint")
"""Frames that move with the robot (REP 105): a tree of tf that ends there does not say where the robot was."""
_NO_COLOUR = ("depth", "infra", "/ir/", "confidence", "disparity", "mask", "theora")
_RECTIFIED = "rect"
"""In the name of a topic whose pictures have no distortion left, as image_proc and RealSense name them."""
_SUFFIXES = (".bag", ".mcap", ".db3")
_AGAIN = "Check it with: rosbag info, or ros2 bag info."


class _Topics(NamedTuple):
    colour: str
    depth: str
    info: str
    odom: str | None
    """None = there is none, or several of which none is named."""


class _Place(NamedTuple):
    """Where a picture is in the bag."""

    topic: str
    log_ns: int
    """When it was written."""
    stamp: float
    """When it was taken, seconds."""
    frame: str
    """Its `frame_id`."""


class _Bag:
    """An open bag; it stays open as long as its pictures may be read."""

    def __init__(self, path: Path) -> None:
        highlevel = require("rosbags.highlevel", extra="robot")
        typesys = require("rosbags.typesys", extra="robot")
        self.path = path
        # what rosbags raises for damaged files: its own errors, and those of unpacking
        self._errors = (highlevel.AnyReaderError, *highlevel.anyreader.ReaderErrors, *DAMAGED, AssertionError, KeyError)
        store = typesys.get_typestore(typesys.Stores.LATEST)
        try:
            self._reader = highlevel.AnyReader([path], default_typestore=store)
            self._reader.open()
        except self._errors as error:
            raise self.damaged(error) from None
        self.types: dict[str, str] = {name: info.msgtype or "" for name, info in self._reader.topics.items()}
        """The message type of each topic."""

    def damaged(self, error: BaseException) -> SceneError:
        """The error of a bag that cannot be read."""
        return SceneError(
            f"{self.path}: cannot be read ({str(error)[:120]}); expected a whole .bag, .mcap or .db3 file, or a folder "
            f"with metadata.yaml. {_AGAIN}"
        )

    def messages(self, topics: Sequence[str], *, at_ns: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Yields (topic, when written, message) of these topics, in order; `at_ns` = only those written then."""
        connections = [item for item in self._reader.connections if item.topic in topics]
        if not connections:
            return
        end = None if at_ns is None else at_ns + 1
        try:
            for connection, log_ns, data in self._reader.messages(connections, start=at_ns, stop=end):
                yield connection.topic, log_ns, self._reader.deserialize(data, connection.msgtype)
        except self._errors as error:
            raise self.damaged(error) from None

    def picture(self, place: _Place) -> Any:
        """The message of a picture."""
        for _, _, message in self.messages([place.topic], at_ns=place.log_ns):
            if _stamp(message.header) == place.stamp:
                return message
        raise Unusable("picture not readable")

    def listed(self) -> str:
        """All topics with their types, for errors."""
        return ", ".join(f"{name} ({kind.rsplit('/', 1)[-1]})" for name, kind in sorted(self.types.items()))


def is_ros_bag(path: Path) -> bool:
    """Whether this is a bag file, or the folder of a ROS 2 bag."""
    return path.suffix in _SUFFIXES or (path / "metadata.yaml").is_file()


def read_ros_bag(path: Path, options: ReadingOptions, counts: FrameCounts) -> Recording:
    """The recording in a ROS bag.

    Raises:
        SceneError: The bag is damaged, topics are missing or ambiguous, or no frame can be used.
        MissingDependencyError: The extra `robot` is not installed.
    """
    bag = _Bag(path)
    topics = _topics(bag, options.topics)
    colours, depths = _pictures(bag, topics)
    counts.num_found = len(colours)
    pairs = _pairs(colours, depths, counts)
    stamps = np.array([colour.stamp for colour, _ in pairs])
    # geometry is the depth's; where colours are not registered to it, only they are off
    Ts, are_known = (
        _poses(bag, topics, options, [pairs[0][1].frame, pairs[0][0].frame], stamps)
        if pairs
        else (np.empty((0, 4, 4)), np.empty(0, bool))
    )
    for (colour, _), is_known in zip(pairs, are_known, strict=True):
        if not is_known:
            counts.skip("no pose", _name(colour))
    usable = [(pair, T) for pair, T, is_known in zip(pairs, Ts, are_known, strict=True) if is_known]
    if not usable:
        raise SceneError(
            f"{path}: none of {counts.num_found} pictures of {topics.colour} can be used: {dict(counts.by_reason)}; "
            f"expected depth ({topics.depth}) within {MAX_APART:g} s and a pose at their stamps. Name other topics "
            "with --topics."
        )
    first = bag.picture(usable[0][0][1])
    kind = bag.types[topics.depth]
    try:
        camera, distorted = _camera(bag, topics, depth_size=size_of(first, kind))
    except DAMAGED as error:
        raise bag.damaged(error) from None
    per_metre = options.depth_per_metre
    entries = tuple(
        Entry(_name(colour), T, camera, partial(_depth, bag, depth, per_metre), partial(_colour, bag, colour))
        for (colour, depth), T in usable
    )
    units = units_of(np.dtype(np.float32 if is_float_depth(first, kind) else np.uint16), given=per_metre)
    return Recording(entries, units, (*_unregistered(usable[0][0]), *distorted))


def _topics(bag: _Bag, named: Mapping[str, str]) -> _Topics:
    """The topics that are named, and the others by type and name."""
    for role, topic in named.items():
        if role not in ROLES or bag.types.get(topic) not in _TYPES[role]:
            wanted = f"one of {', '.join(ROLES)}" if role not in ROLES else " or ".join(_TYPES[role])
            raise SceneError(
                f"{bag.path}: --topics {role}={topic} is {bag.types.get(topic, 'not in the bag')}; expected {wanted}. "
                f"Found {bag.listed()}."
            )
    pictures = [name for name, kind in bag.types.items() if kind in (IMAGE, COMPRESSED)]
    depth = named.get("depth") or _one(
        bag, "depth", [name for name in pictures if "depth" in name], ("aligned", "registered")
    )
    colour = named.get("colour") or _one(
        bag, "colour", [name for name in pictures if not any(word in name for word in _NO_COLOUR)], ("color", "rgb")
    )
    infos = [name for name, kind in bag.types.items() if kind == _INFO]
    beside = [_beside(topic) for topic in (depth, colour) if _beside(topic) in infos]
    info = named.get("info") or (beside[0] if beside else _one(bag, "info", infos, ()))
    odometries = [name for name, kind in bag.types.items() if kind == _ODOMETRY]
    return _Topics(colour, depth, info, named.get("odom") or (odometries[0] if len(odometries) == 1 else None))


def _one(bag: _Bag, role: str, found: list[str], words: tuple[str, ...]) -> str:
    """The only topic, after those with a word are preferred, and pictures as they were to compressed ones."""
    preferred = [name for name in found if any(word in name for word in words)] or found
    plain = [name for name in preferred if not any(name.startswith(other + "/") for other in preferred)]
    if len(plain) == 1:
        return plain[0]
    raise SceneError(
        f"{bag.path}: found {len(plain)} topics for {role} ({', '.join(sorted(plain)) or 'none'}); expected one. Name "
        f"it with --topics {role}=TOPIC. Found {bag.listed()}."
    )


def _beside(topic: str) -> str:
    """The camera info of a picture's topic, by ROS's rule for names."""
    return topic.removesuffix("/compressed").removesuffix("/compressedDepth").rsplit("/", 1)[0] + "/camera_info"


def _pictures(bag: _Bag, topics: _Topics) -> tuple[list[_Place], list[_Place]]:
    """Where the colour and the depth pictures are, in the order in which they were taken."""
    places: dict[str, list[_Place]] = {topics.colour: [], topics.depth: []}
    for topic, log_ns, message in bag.messages([topics.colour, topics.depth]):
        header = message.header
        places[topic].append(_Place(topic, log_ns, _stamp(header), header.frame_id.lstrip("/")))
    colours, depths = (sorted(places[topic], key=lambda place: place.stamp) for topic in (topics.colour, topics.depth))
    return colours, depths


def _pairs(colours: list[_Place], depths: list[_Place], counts: FrameCounts) -> list[tuple[_Place, _Place]]:
    """Each colour picture with the depth picture that was taken nearest to it."""
    stamps = np.array([depth.stamp for depth in depths])
    pairs = []
    for colour in colours:
        index = int(np.abs(stamps - colour.stamp).argmin()) if len(stamps) else -1
        if index < 0 or abs(stamps[index] - colour.stamp) > MAX_APART:
            counts.skip("no depth picture", _name(colour))
        else:
            pairs.append((colour, depths[index]))
    return pairs


def _poses(
    bag: _Bag, topics: _Topics, options: ReadingOptions, frames: Sequence[str], stamps: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(N, 4, 4) poses of the camera at these times (N,), and (N,) whether each is known.

    The camera's frame is the first of `frames` that tf knows: depth that was registered to colours may name no other.
    """
    tree, odometry, base = _transforms(bag, topics.odom)
    camera_frame = next((frame for frame in frames if len(tree.chain(frame)) > 1), frames[-1])
    chain = tree.chain(camera_frame)
    if options.T_base_camera is not None:
        if odometry is None:
            raise SceneError(
                f"{bag.path}: --base-to-camera is given and no topic of odometry is known; expected exactly one, or "
                f"--topics odom=TOPIC. Found {bag.listed()}."
            )
        Ts, are_known = odometry.at(stamps)
        return Ts @ options.T_base_camera, are_known
    is_better = odometry is not None and ("odom" in options.topics or odometry.parent not in chain)
    if odometry is not None and is_better and base in chain:
        Ts, are_known = odometry.at(stamps)
        on_robot, are_on_robot = tree.Ts(camera_frame, base, stamps)
        return Ts @ on_robot, are_known & are_on_robot
    if tree.moves(camera_frame) and chain[-1] not in _BASES and "odom" not in options.topics:
        return tree.Ts(camera_frame, chain[-1], stamps)
    of = f"odometry is of {base!r}" if odometry is not None else "there is not exactly one topic of odometry"
    raise SceneError(
        f"{bag.path}: where the camera was is not known: tf has {' in '.join(chain) or 'nothing'}, and {of}; expected "
        "tf from the camera to a frame that it moves in, or to the odometry's frame. Give --base-to-camera "
        f"x,y,z,qx,qy,qz,qw, or --topics odom=TOPIC. Found {bag.listed()}."
    )


def _transforms(bag: _Bag, odom: str | None) -> tuple[TransformTree, Track | None, str]:
    """The tree of tf, the track of the odometry if there is one, and the frame whose track it is."""
    tree, odometry, base = TransformTree(), None, ""
    names = [name for name, kind in bag.types.items() if kind in _TF]
    for topic, _, message in bag.messages([*names, *([odom] if odom else [])]):
        if topic != odom:
            for item in message.transforms:
                place, turn = item.transform.translation, item.transform.rotation
                tree.add(
                    item.header.frame_id,
                    item.child_frame_id,
                    _stamp(item.header),
                    ((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)),
                    is_static=topic.endswith("tf_static"),
                )
            continue
        base = getattr(message, "child_frame_id", "").lstrip("/")
        pose = getattr(message.pose, "pose", message.pose)  # with or without covariance
        place, turn = pose.position, pose.orientation
        odometry = odometry or Track(message.header.frame_id.lstrip("/"), is_static=False)
        odometry.add(_stamp(message.header), ((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)))
    return tree, odometry, base


def _camera(bag: _Bag, topics: _Topics, *, depth_size: Size) -> tuple[Camera, tuple[str, ...]]:
    """The camera of the first camera info, for pictures of the depth's size, and a warning if its lens distorts."""
    where = f"{bag.path}: {topics.info}"
    for _, _, message in bag.messages([topics.info]):
        K, D = (
            np.asarray(getattr(message, name if hasattr(message, name) else name.lower()), np.float64)
            for name in ("K", "D")  # ROS 1; lower case in ROS 2
        )
        of_size = (message.width, message.height) if message.width and message.height else depth_size
        lens = (float(K[0]), float(K[4]), float(K[2]), float(K[5]))
        warnings = () if _RECTIFIED in topics.depth else _distorted(topics.info, message.distortion_model, D)
        return camera_of(where, lens, of_size=of_size, to_size=depth_size), warnings
    raise SceneError(f"{where} holds no message; expected the camera's intrinsics. Name another with --topics info=.")


def _distorted(topic: str, model: str, D: NDArray[np.float64]) -> tuple[str, ...]:
    """A warning if a camera info says that its lens distorts, by coefficients (N,) of a model."""
    if not D.any():
        return ()
    found = " ".join(f"{number:.3g}" for number in D)
    return (
        f"{topic} says that the lens distorts ({model}: {found}), and distortion is not removed, so that places near "
        "the pictures' edges are off: record rectified pictures (image_rect)",
    )


def _unregistered(pair: tuple[_Place, _Place]) -> tuple[str, ...]:
    colour, depth = pair
    if colour.frame == depth.frame:
        return ()
    return (
        f"depth is in the frame {depth.frame!r} and colour in {colour.frame!r}, so colours are off where depth is not "
        "registered to colour: record aligned or registered depth",
    )


def _stamp(header: Any) -> float:
    return header.stamp.sec + header.stamp.nanosec * 1e-9


def _name(place: _Place) -> str:
    return f"{place.stamp:.6f}"


def _depth(bag: _Bag, place: _Place, per_metre: float | None) -> NDArray[np.float32]:
    return metres(depth_of(bag.picture(place), bag.types[place.topic]), per_metre=per_metre)


def _colour(bag: _Bag, place: _Place) -> NDArray[np.uint8]:
    return colours_of(bag.picture(place), bag.types[place.topic])
