"""Encoders with known answers, and writers of recordings, for tests of maps."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from sim.frames import T_world_glb_zup
from sim.types import Frame

PATCH = 10
"""Side of the encoders' patches in pixels."""


class IdEncoder:
    """Encodes the instance that fills most of each patch: one axis per id, a zero vector for id 0 and mixed patches."""

    name = "ids+oracle-perception"

    def __init__(self, num_ids: int) -> None:
        self.dim = num_ids + 1

    def encode_texts(self, texts: Sequence[str]) -> np.ndarray:
        """Encodes ids that are written in digits."""
        return np.eye(self.dim, dtype=np.float32)[[int(text) for text in texts]]

    def encode_patches(self, frames: Sequence[Frame]) -> np.ndarray:
        ids = np.array([self._ids(frame.instance_ids) for frame in frames])
        return np.where(ids[..., None] > 0, np.eye(self.dim, dtype=np.float32)[ids], 0)

    def _ids(self, ids: np.ndarray) -> np.ndarray:
        middle = ids[PATCH // 2 :: PATCH, PATCH // 2 :: PATCH]
        tiles = ids.reshape(middle.shape[0], PATCH, middle.shape[1], PATCH)
        return np.where((tiles == middle[:, None, :, None]).mean(axis=(1, 3)) > 0.6, middle, 0)

    def encode_images(self, frames: Sequence[Frame]) -> np.ndarray:
        sums = self.encode_patches(frames).sum(axis=(1, 2))
        return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)


class ColourEncoder:
    """Encodes the colour of each patch; like a real model, it reads only the picture."""

    name, dim = "colours", 4

    def encode_texts(self, texts: Sequence[str]) -> np.ndarray:
        """Encodes colours that are written as `r g b` in digits."""
        return self._unit(np.array([[int(word) for word in text.split()] for text in texts], float))

    def encode_patches(self, frames: Sequence[Frame]) -> np.ndarray:
        return self._unit(np.array([frame.rgb[PATCH // 2 :: PATCH, PATCH // 2 :: PATCH] for frame in frames], float))

    def encode_images(self, frames: Sequence[Frame]) -> np.ndarray:
        return self._unit(np.array([frame.rgb.mean(axis=(0, 1)) for frame in frames]))

    def _unit(self, rgb: np.ndarray) -> np.ndarray:
        vectors = np.concatenate([rgb - 128, np.full((*rgb.shape[:-1], 1), 20.0)], axis=-1)
        return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def colours() -> ColourEncoder:
    """A factory, as a plug-in has it."""
    return ColourEncoder()


def poses_of(frames: Sequence[Frame], *, up: str) -> list[np.ndarray]:
    """The pose (4, 4) of each camera in a frame whose z or y is up."""
    T_recording_map = np.linalg.inv(T_world_glb_zup) if up == "z" else np.eye(4)
    return [T_recording_map @ frame.T_world_camera for frame in frames]


def write_recording(folder: Path, frames: Sequence[Frame], *, up: str, colour: str = "png") -> None:
    """Writes our own layout: color/, depth/ in mm, poses/ with one matrix per file, intrinsics.json."""
    for name in ("color", "depth", "poses"):
        (folder / name).mkdir(parents=True)
    for index, (frame, pose) in enumerate(zip(frames, poses_of(frames, up=up), strict=True)):
        write_pictures(frame, folder / f"color/{index:04}.{colour}", folder / f"depth/{index:04}.png")
        np.savetxt(folder / f"poses/{index:04}.txt", pose)
    write_intrinsics(folder / "intrinsics.json", frames[0])


def write_pictures(frame: Frame, colour: Path, depth: Path, *, per_metre: float = 1000.0) -> None:
    """Writes one picture and its 16-bit depth."""
    Image.fromarray(frame.rgb).save(colour, **({"quality": 95} if colour.suffix == ".jpg" else {}))
    Image.fromarray((frame.depth_m * per_metre).round().astype(np.uint16)).save(depth)


def write_intrinsics(path: Path, frame: Frame) -> None:
    """Writes the intrinsics in OpenCV's pixel coordinates: the centre of the first pixel is 0."""
    fx, fy, cx, cy = frame.camera.lens
    content = {"fx": fx, "fy": fy, "cx": cx - 0.5, "cy": cy - 0.5}
    path.write_text(json.dumps({**content, "width": frame.camera.width, "height": frame.camera.height}))


def matrix_of_intrinsics(frame: Frame, *, size: int) -> np.ndarray:
    """The intrinsic matrix, 3 x 3 or 4 x 4, in OpenCV's pixel coordinates."""
    (fx, fy, cx, cy), K = frame.camera.lens, np.eye(size)
    K[0, 0], K[1, 1], K[0, 2], K[1, 2] = fx, fy, cx - 0.5, cy - 0.5
    return K
