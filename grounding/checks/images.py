"""The check that users run on their own image encoder; ours pass the same one."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sim.plugins import problems_of
from sim.types import Camera, Frame

from ..encoders.protocol import TextImageEncoder
from .answers import require, require_encoder, require_vectors

_TOLERANCE = 1e-3
"""Allowed difference of vectors that should be equal."""
_HEIGHT, _WIDTH = 96, 128


def check_image_encoder(encoder: TextImageEncoder | Callable[[], TextImageEncoder] | str) -> list[str]:
    """How an encoder breaks the contract of `TextImageEncoder`, and of `DenseEncoder` if it has `encode_patches`.

    Args:
        encoder: The object, a factory, or its name as package.module:factory. It gets pictures of two kinds of random
            pattern, with instance ids 1 and 2.

    Returns:
        The first breach, here or in a second process; empty = the contract is kept.
    """
    methods = ("encode_texts", "encode_images")
    return problems_of(encoder, _require_image_encoder, methods=methods, again=_picture_rows, kind="encoder")


def _picture_rows(encoder: TextImageEncoder) -> NDArray[np.float32]:
    return encoder.encode_images([_halves(across=True)])


def _require_image_encoder(encoder: TextImageEncoder) -> None:
    require_encoder(encoder)
    frames = [_halves(across=True), _halves(across=False), _halves(across=True, first=2)]
    before = [frame.rgb.copy() for frame in frames]
    _vectors_of(encoder, "encode_images", frames)
    if hasattr(encoder, "encode_patches"):
        _require_places(encoder, _vectors_of(encoder, "encode_patches", frames))
    same = all(np.array_equal(copy, frame.rgb) for copy, frame in zip(before, frames, strict=True))
    require(same, f"encoder {encoder.name!r}", "a picture after encoding", "changed", "unchanged")


def _vectors_of(encoder: TextImageEncoder, method: str, frames: Sequence[Frame]) -> NDArray[np.float32]:
    """The answer of `encode_images` (N, E) or `encode_patches` (N, h, w, E), the same alone and again."""
    where, encode = f"encoder {encoder.name!r}, {method}", getattr(encoder, method)
    vectors = encode(frames)
    axes = "(frames, dim)" if method == "encode_images" else "(frames, rows, columns, dim)"
    require(vectors.ndim == axes.count(",") + 1, where, "shape", vectors.shape, axes)
    require_vectors(vectors, (len(frames), *(max(1, side) for side in vectors.shape[1:-1]), encoder.dim), where)
    norms = np.linalg.norm(vectors, axis=-1)
    odd = norms[np.minimum(np.abs(norms), np.abs(norms - 1)) > _TOLERANCE]
    require(not len(odd), where, "length of a vector", round(float(odd.max(initial=0)), 4), "1, or 0 for no content")
    again = bool(np.array_equal(vectors, encode(frames)))
    require(again, where, "second answer", "another one", "the same vectors every time")
    alone = np.concatenate([encode([frame]) for frame in reversed(frames)])[::-1]
    worst = float(np.abs(vectors - alone).max())
    require(worst <= _TOLERANCE, where, "change when a picture is encoded alone", worst, f"at most {_TOLERANCE}")
    none = encode([])
    fits = none.ndim == vectors.ndim and len(none) == 0 and (none.ndim > 2 or none.shape[-1] == encoder.dim)
    require(fits, where, "shape for no frames", none.shape, f"{axes} with 0 frames")
    return vectors


def _require_places(encoder: TextImageEncoder, patches: NDArray[np.float32]) -> None:
    """Refuses patches (N, h, w, E) that are not where the check's pictures show their halves."""
    for name, halves in (("left and right", patches[0]), ("top and bottom", np.swapaxes(patches[1], 0, 1))):
        cut = halves.shape[1] // 2
        if cut == 0 or not halves.any():
            continue
        first, second = _mean(halves[:, :cut]), _mean(halves[:, -cut:])
        within = float((_flat(halves[:, :cut]) @ first).mean() + (_flat(halves[:, -cut:]) @ second).mean())
        across = float((_flat(halves[:, :cut]) @ second).mean() + (_flat(halves[:, -cut:]) @ first).mean())
        where, expected = f"encoder {encoder.name!r}, encode_patches", "patches like their own half of the picture"
        require(within > across + _TOLERANCE, where, f"a picture of {name} halves", "alike or turned", expected)


def _mean(patches: NDArray[np.float32]) -> NDArray[np.float32]:
    return _flat(patches).mean(axis=0)


def _flat(patches: NDArray[np.float32]) -> NDArray[np.float32]:
    return patches.reshape(-1, patches.shape[-1])


def _halves(*, across: bool, first: int = 1) -> Frame:
    """A picture of two patterns, side by side or one above the other."""
    rng = np.random.default_rng(first)
    is_second = np.zeros((_HEIGHT, _WIDTH), bool)
    if across:
        is_second[:, _WIDTH // 2 :] = True
    else:
        is_second[_HEIGHT // 2 :] = True
    ids = np.where(is_second, 3 - first, first).astype(np.int32)
    level = np.where(ids == 1, 40, 210)[..., None]
    rgb = (level + rng.integers(-30, 30, (_HEIGHT, _WIDTH, 3))).astype(np.uint8)
    camera = Camera.of_lens(_WIDTH, _HEIGHT, fx=100.0, fy=100.0, cx=_WIDTH / 2, cy=_HEIGHT / 2)
    return Frame(rgb, np.ones((_HEIGHT, _WIDTH), np.float32), np.eye(4), camera, ids)
