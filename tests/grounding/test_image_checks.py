"""The check of image encoders names each breach of the contract."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from grounding.checks import check_image_encoder
from grounding.encoders.hashed import HashedWords
from grounding.perception.oracle_perception import OraclePerception


class Seeing(OraclePerception):
    """Oracle perception of the pictures that the check draws; the cases below break it."""

    def __init__(self) -> None:
        super().__init__(HashedWords(), {1: "red wooden chair", 2: "large white sofa"})


class Forgetful(Seeing):
    calls = 0

    def encode_images(self, frames):
        self.calls += 1
        return np.roll(super().encode_images(frames), self.calls, axis=1)


class MeanOfBatch(Seeing):
    def encode_patches(self, frames):
        rows = super().encode_patches(frames)
        if len(frames) > 1:
            rows = rows + rows[::-1]
            rows /= np.linalg.norm(rows, axis=-1, keepdims=True)
        return rows


class Same(Seeing):
    """Gives every patch the vector of the whole picture."""

    def encode_patches(self, frames):
        patches = super().encode_patches(frames)
        return np.broadcast_to(super().encode_images(frames)[:, None, None], patches.shape).copy()


class Painter(Seeing):
    def encode_images(self, frames):
        for frame in frames:
            frame.rgb[0, 0] += 1
        return super().encode_images(frames)


def test_the_unbroken_encoder_passes() -> None:
    assert check_image_encoder(Seeing()) == []


def changed(method: str, change: Callable[[np.ndarray], np.ndarray]) -> Seeing:
    """An encoder whose answers in one method are changed."""
    plain = Seeing()
    return type("Changed", (Seeing,), {method: lambda self, frames: change(getattr(plain, method)(frames))})()


@pytest.mark.parametrize(
    ("encoder", "message"),
    [
        (
            changed("encode_images", lambda vectors: 2 * vectors),
            "encode_images: length of a vector is 2.0; expected 1, or 0 for no content",
        ),
        (
            changed("encode_images", lambda vectors: vectors.astype(float)),
            "encode_images: dtype is 'float64'; expected float32",
        ),
        (Forgetful(), "encode_images: second answer is 'another one'; expected the same vectors every time"),
        (MeanOfBatch(), "encode_patches: change when a picture is encoded alone is"),
        (
            changed("encode_patches", lambda rows: rows.swapaxes(1, 2)),
            "encode_patches: a picture of left and right halves is 'alike or turned'",
        ),
        (
            changed("encode_patches", lambda rows: rows.reshape(len(rows), -1, rows.shape[-1])),
            r"encode_patches: shape is \(3, .*; expected \(frames, rows, columns, dim\)",
        ),
        (Same(), "encode_patches: a picture of left and right halves is 'alike or turned'"),
        (Painter(), "a picture after encoding is 'changed'; expected unchanged"),
    ],
)
def test_a_broken_image_encoder_is_named(encoder: Seeing, message: str) -> None:
    (problem,) = check_image_encoder(encoder)
    assert re.search(message, problem)
