"""Reads a folder that the app Stray Scanner (iPhone, iPad with LiDAR) exported.

`rgb.mp4`, `odometry.csv`, `camera_matrix.csv`, `depth/000000.png` (16 bit, mm; `.npy` in old exports) and
`confidence/000000.png`. The poses are ARKit's in a frame whose y points up; the app turns the camera's axes to
OpenCV's before it writes them (strayrobots/scanner, docs/format.md and OdometryEncoder.swift).
"""

import csv
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.extras import require

from .intrinsics import Lens, Size, camera_of, lens_of_matrix
from .pictures import DAMAGED, read_depth, size_of_depth
from .poses import pose_of_quat
from .recording import Entry, FrameCounts, ReadingOptions, Recording, Unusable, metres, units_of

SURE = 1
"""Depth of a lower confidence is left out (0 low, 1 medium, 2 high): the default of the app's own viewer."""
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_LENS = ("fx", "fy", "cx", "cy")
_FILES = ("odometry.csv", "rgb.mp4", "camera_matrix.csv", "depth")


def is_stray(path: Path) -> bool:
    """Whether this is a folder with `odometry.csv`, which no other layout has."""
    return (path / "odometry.csv").is_file()


def read_stray(folder: Path, options: ReadingOptions, counts: FrameCounts) -> Recording:
    """The recording in a folder of Stray Scanner.

    Raises:
        SceneError: Files are missing or damaged, or no frame can be used.
        MissingDependencyError: The extra `robot` is not installed.
    """
    for name in _FILES:
        if not (folder / name).exists():
            raise SceneError(
                f"{folder}: holds odometry.csv and no {name}; expected {', '.join(_FILES)} as Stray Scanner exports "
                "them. Export the recording again."
            )
    video, shared = Video(folder / "rgb.mp4"), lens_of_matrix(folder / "camera_matrix.csv")
    rows = _rows(folder / "odometry.csv")
    counts.num_found = len(rows)
    entries: list[Entry] = []
    kind: tuple[Size, np.dtype] | None = None
    for row in rows:
        name = row["frame"]
        pose = pose_of_quat([_number(row.get(key)) for key in _POSE])
        depth = next(filter(Path.is_file, (folder / f"depth/{name}{suffix}" for suffix in (".png", ".npy"))), None)
        if depth is None or isinstance(pose, str):
            counts.skip(pose if isinstance(pose, str) else "no depth picture", name)
            continue
        try:
            kind = kind or size_of_depth(depth)
        except (Unusable, *DAMAGED):
            counts.skip("picture not readable", name)
            continue
        camera = camera_of(folder / "camera_matrix.csv", _lens(row, shared), of_size=video.size, to_size=kind[0])
        load_depth = partial(_depth, depth, folder / f"confidence/{name}.png", options.depth_per_metre)
        entries.append(Entry(name, pose, camera, load_depth, partial(video.frame, int(name))))
    if kind is None:
        raise SceneError(
            f"{folder}: none of {counts.num_found} frames can be used: {dict(counts.by_reason)}; expected a depth "
            "picture and a pose for each. Export the recording again."
        )
    return Recording(tuple(entries), units_of(kind[1], given=options.depth_per_metre), up="y")


class Video:
    """The pictures of a video by their number; reads on from the last one, or from the beginning."""

    def __init__(self, path: Path) -> None:
        """Opens the file; SceneError if it is no video."""
        self._path = path
        self._av = require("av", extra="robot")
        self._pictures: Iterator[tuple[int, Any]] = iter(())
        self._last = -1
        try:
            with self._av.open(str(path)) as container:
                stream = container.streams.video[0]
                self.size: Size = (stream.width, stream.height)
                """(width, height) in pixels."""
        except (self._av.FFmpegError, IndexError) as error:
            raise SceneError(
                f"{path}: cannot be read ({error}); expected a video. Export the recording again."
            ) from None

    def frame(self, index: int) -> NDArray[np.uint8]:
        """(H, W, 3) colours of a picture; cheap for a later one than the last.

        Raises:
            Unusable: The video ends before it, or is damaged there.
        """
        if index <= self._last or self._last < 0:
            self._pictures = self._decoded()
        for number, picture in self._pictures:
            self._last = number
            if number == index:
                return picture.to_ndarray(format="rgb24")
        self._last = -1
        raise Unusable("no colour picture")

    def _decoded(self) -> Iterator[tuple[int, Any]]:
        try:
            with self._av.open(str(self._path)) as container:
                container.streams.video[0].thread_type = "AUTO"
                yield from enumerate(container.decode(video=0))
        except self._av.FFmpegError:
            raise Unusable("picture not readable") from None


def _rows(path: Path) -> list[dict[str, str]]:
    """The rows of `odometry.csv` by the names in its first line."""
    lines = list(csv.reader(path.read_text(errors="replace").splitlines(), skipinitialspace=True))
    head = [cell.strip() for cell in lines[0]] if lines else []
    if not {"frame", *_POSE} <= set(head):
        found = ", ".join(head)[:80]
        raise SceneError(
            f"{path}:1: names the columns {found!r}; expected timestamp, frame, {', '.join(_POSE)}. Export the "
            "recording with a newer Stray Scanner."
        )
    rows = [dict(zip(head, map(str.strip, cells), strict=False)) for cells in lines[1:] if cells]
    for number, row in enumerate(rows, start=2):
        if not row.get("frame", "").isdigit():
            raise SceneError(
                f"{path}:{number}: frame is {row.get('frame')!r}; expected a number such as 000005. Export the "
                "recording again."
            )
    return rows


def _lens(row: dict[str, str], shared: Lens) -> Lens:
    """The intrinsics in a row of a newer export, or else those of all pictures."""
    fx, fy, cx, cy = (_number(row.get(key)) for key in _LENS)
    return (fx, fy, cx, cy) if np.isfinite((fx, fy, cx, cy)).all() else shared


def _number(text: str | None) -> float:
    """The number in a cell; nan for anything else."""
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _depth(path: Path, confidence: Path, per_metre: float | None) -> NDArray[np.float32]:
    depth = read_depth(path)
    if confidence.is_file():
        sure = read_depth(confidence)
        if sure.shape == depth.shape:
            depth = np.where(sure.astype(np.int64) >= SURE, depth, 0).astype(depth.dtype)
    return metres(depth, per_metre=per_metre)
