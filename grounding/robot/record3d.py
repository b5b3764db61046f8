"""Reads a `.r3d` file that the app Record3D (iPhone, iPad with LiDAR) shares, or the folder unpacked from it.

A zip archive: `metadata` (JSON: w, h, dw, dh, fps, K, poses, perFrameIntrinsicCoeffs) and `rgbd/0.jpg`, `0.depth`
(LZFSE, float32 metres, row by row) and `0.conf` (LZFSE, uint8). Poses are camera to world as qx qy qz qw px py pz, with
OpenGL's camera axes (-z forward), in a frame that the first camera may define; K lists the matrix column by column
(github.com/marek-simonik/record3d, issues 33, 36 and 93).
"""

import json
import zipfile
import zlib
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim.errors import SceneError, line_from_validation_error

from .intrinsics import Lens, Size, camera_of
from .poses import T_body_camera, pose_of_quat
from .recording import Entry, FrameCounts, ReadingOptions, Recording, Unusable, metres, units_of
from .stray import SURE

_MOST_BYTES = 64 << 20
"""Largest unpacked file of one picture or of the metadata."""
_AGAIN = "Share the recording from Record3D as .r3d again."


class Metadata(BaseModel):
    """The JSON file in the archive; other fields are not read."""

    model_config = ConfigDict(frozen=True)

    w: int = Field(gt=0)
    h: int = Field(gt=0)
    """Size of the colour pictures."""
    dw: int | None = Field(default=None, gt=0)
    dh: int | None = Field(default=None, gt=0)
    """Size of the depth pictures; older files lack it."""
    K: tuple[float, float, float, float, float, float, float, float, float]
    """The intrinsic matrix, column by column, for the colour pictures."""
    poses: tuple[tuple[float, float, float, float, float, float, float], ...]
    """qx qy qz qw px py pz of each picture."""
    perFrameIntrinsicCoeffs: tuple[tuple[float, float, float, float], ...] = ()
    """fx fy cx cy of each picture, which move with the focus; older files lack them."""


class _Archive:
    """The files of a recording, packed or unpacked."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._zip = None if path.is_dir() else zipfile.ZipFile(path)
        except (OSError, zipfile.BadZipFile) as error:
            raise SceneError(f"{path}: is no zip archive ({error}); expected a .r3d file. {_AGAIN}") from None

    def read(self, name: str) -> bytes:
        """The bytes of a file; KeyError, OSError or ValueError if it is missing, damaged or too large."""
        if self._zip is None:
            return (self.path / name).read_bytes()
        if self._zip.getinfo(name).file_size > _MOST_BYTES:
            raise ValueError(f"{name} is too large")
        try:
            return self._zip.read(name)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
            raise ValueError(f"{name} is damaged ({error})") from None

    def holds(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return (self.path / name).is_file() if self._zip is None else name in self._zip.NameToInfo


def is_record3d(path: Path) -> bool:
    """Whether this is a `.r3d` file, its unpacked folder, or Record3D's export as EXR pictures (refused in reading)."""
    return path.suffix == ".r3d" or (path / "metadata").is_file() or _exr_folder(path) is not None


def read_record3d(path: Path, options: ReadingOptions, counts: FrameCounts) -> Recording:
    """The recording in a `.r3d` file or its folder.

    Raises:
        SceneError: The file is damaged, or no frame can be used.
    """
    if (exr := _exr_folder(path)) is not None:
        raise SceneError(
            f"{exr}: holds Record3D's export as EXR pictures, which are not read; expected a .r3d file. In Record3D, "
            "share the recording as .r3d."
        )
    archive = _Archive(path)
    metadata = _metadata(archive)
    counts.num_found = len(metadata.poses)
    depth_size = _depth_size(archive, metadata)
    T = T_body_camera("opengl")
    entries: list[Entry] = []
    for index, numbers in enumerate(metadata.poses):
        pose = pose_of_quat([*numbers[4:], *numbers[:4]])
        if isinstance(pose, str) or not archive.holds(f"rgbd/{index}.depth"):
            counts.skip(pose if isinstance(pose, str) else "no depth picture", f"{index}.jpg")
            continue
        camera = camera_of(path, _lens(metadata, index), of_size=(metadata.w, metadata.h), to_size=depth_size)
        load_depth = partial(_depth, archive, index, depth_size, options.depth_per_metre)
        entries.append(Entry(f"{index}.jpg", pose @ T, camera, load_depth, partial(_colour, archive, index)))
    if not entries:
        raise SceneError(
            f"{path}: none of {counts.num_found} frames can be used: {dict(counts.by_reason)}; expected a depth "
            f"picture and a pose for each. {_AGAIN}"
        )
    return Recording(tuple(entries), units_of(np.dtype(np.float32), given=options.depth_per_metre))


def _exr_folder(path: Path) -> Path | None:
    """The folder of an export as EXR pictures, at or below this path."""
    for folder in (path, path / "EXR_RGBD"):
        if (folder / "metadata.json").is_file() and next(folder.glob("depth/*.exr"), None) is not None:
            return folder
    return None


def _metadata(archive: _Archive) -> Metadata:
    try:
        return Metadata.model_validate(json.loads(archive.read("metadata")))
    except ValidationError as error:
        raise SceneError(line_from_validation_error(f"{archive.path}: metadata", error, advice=_AGAIN)) from None
    except (KeyError, OSError, ValueError, RecursionError) as error:
        raise SceneError(
            f"{archive.path}: metadata cannot be read ({error}); expected the JSON file of a recording. {_AGAIN}"
        ) from None


def _depth_size(archive: _Archive, metadata: Metadata) -> Size:
    """(width, height) of depth pictures: the metadata's, or from the number of values and the colours' shape."""
    if metadata.dw is not None and metadata.dh is not None:
        return metadata.dw, metadata.dh
    for index in range(len(metadata.poses)):
        try:
            count = len(_unpacked(archive, f"rgbd/{index}.depth")) // 4
        except (KeyError, OSError, ValueError):
            continue
        height = round((count * metadata.h / metadata.w) ** 0.5)
        if height and height * (count // height) == count:
            return count // height, height
    raise SceneError(
        f"{archive.path}: no depth picture fits colours of {metadata.w} x {metadata.h}; expected rgbd/0.depth and so "
        f"on, of the same shape. {_AGAIN}"
    )


def _lens(metadata: Metadata, index: int) -> Lens:
    """The intrinsics of a picture; those of all pictures where it has none of its own."""
    if index < len(metadata.perFrameIntrinsicCoeffs):
        return metadata.perFrameIntrinsicCoeffs[index]
    K = metadata.K
    return K[0], K[4], K[6], K[7]


def _unpacked(archive: _Archive, name: str) -> bytes:
    import imagecodecs  # takes 0.2 s

    try:
        return bytes(imagecodecs.lzfse_decode(archive.read(name)))
    except imagecodecs.LzfseError as error:
        raise ValueError(f"{name} is damaged ({error})") from None


def _depth(archive: _Archive, index: int, size: Size, per_metre: float | None) -> NDArray[np.float32]:
    depth = np.frombuffer(_unpacked(archive, f"rgbd/{index}.depth"), "<f4")
    if len(depth) != size[0] * size[1]:
        raise Unusable("another size")
    if archive.holds(name := f"rgbd/{index}.conf"):
        sure = np.frombuffer(_unpacked(archive, name), np.uint8)
        if sure.shape == depth.shape:
            depth = np.where(sure >= SURE, depth, np.float32(0))
    return metres(depth.reshape(size[::-1]), per_metre=per_metre)


def _colour(archive: _Archive, index: int) -> NDArray[np.uint8]:
    try:
        data = archive.read(f"rgbd/{index}.jpg")
    except (KeyError, FileNotFoundError):
        raise Unusable("no colour picture") from None
    with Image.open(BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))
