"""The check that users run on their own image encoder; ours pass the same one."""

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.plugins import problems_of
from sim.types import Camera, Frame

from ..encoders.protocol import DenseEncoder, TextImageEncoder
from .answers import require_encoder

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
    vectors = _check_rows(encoder, "encode_images", frames, encoder.encode_images(frames), (len(frames), encoder.dim))
    alone = np.concatenate([encoder.encode_images([frame]) for frame in reversed(frames)])[::-1]
    _check_same(encoder, "encode_images", vectors, alone, encoder.encode_images(frames))
    none = encoder.encode_images([])
    _require(none.shape == (0, encoder.dim), encoder, "encode_images", f"shape {none.shape}", f"(0, {encoder.dim})")
    if hasattr(encoder, "encode_patches"):
        _check_patches(cast(DenseEncoder, encoder), frames)
    same = all(np.array_equal(copy, frame.rgb) for copy, frame in zip(before, frames, strict=True))
    _require(same, encoder, "encode_images or encode_patches", "changed pictures", "pictures as they were given")


def _check_patches(encoder: DenseEncoder, frames: Sequence[Frame]) -> None:
    where, found = "encode_patches", encoder.encode_patches(frames)
    _require(found.ndim == 4, encoder, where, f"{found.ndim} dimensions", "(frames, rows, columns, dim)")
    shape = (len(frames), max(1, found.shape[1]), max(1, found.shape[2]), encoder.dim)
    patches = _check_rows(encoder, where, frames, found, shape)
    alone = np.concatenate([encoder.encode_patches([frame]) for frame in reversed(frames)])[::-1]
    _check_same(encoder, where, patches, alone, encoder.encode_patches(frames))
    none = encoder.encode_patches([])
    _require(none.ndim == 4 and len(none) == 0, encoder, where, f"shape {none.shape} for no frames", "(0, ., ., dim)")
    for name, halves in (("left and right", patches[0]), ("top and bottom", np.swapaxes(patches[1], 0, 1))):
        cut = halves.shape[1] // 2
        if cut == 0 or not halves.any():
            continue
        first, second = _mean(halves[:, :cut]), _mean(halves[:, -cut:])
        within = float((_flat(halves[:, :cut]) @ first).mean() + (_flat(halves[:, -cut:]) @ second).mean())
        across = float((_flat(halves[:, :cut]) @ second).mean() + (_flat(halves[:, -cut:]) @ first).mean())
        expected = "patches that are more like their own half of the picture than like the other"
        _require(within > across + _TOLERANCE, encoder, where, f"{name} halves alike or turned", expected)


def _check_rows(
    encoder: TextImageEncoder, where: str, frames: Sequence[Frame], rows: NDArray, shape: tuple[int, ...]
) -> NDArray[np.float32]:
    _require(rows.dtype == np.float32, encoder, where, f"dtype {rows.dtype}", "float32")
    _require(rows.shape == shape, encoder, where, f"shape {rows.shape} for {len(frames)} frames", str(shape))
    _require(bool(np.isfinite(rows).all()), encoder, where, "values that are not finite", "finite numbers")
    norms = np.linalg.norm(rows, axis=-1)
    unit = np.minimum(np.abs(norms), np.abs(norms - 1)) <= _TOLERANCE
    worst = float(norms[~unit][0]) if not unit.all() else 1.0
    _require(bool(unit.all()), encoder, where, f"a vector of length {worst:.4g}", "1, or 0 where there is nothing")
    return rows


def _check_same(encoder: TextImageEncoder, where: str, first: NDArray, alone: NDArray, again: NDArray) -> None:
    _require(bool(np.array_equal(first, again)), encoder, where, "another second answer", "the same every time")
    worst = float(np.abs(first - alone).max())
    _require(worst <= _TOLERANCE, encoder, where, f"a change of {worst:.3g} for frames alone", f"<= {_TOLERANCE}")


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


def _require(holds: bool, encoder: TextImageEncoder, where: str, found: str, expected: str) -> None:
    if not holds:
        raise AgentError(f"encoder {encoder.name!r}: {where} gives {found}; expected {expected}. Correct the plug-in.")
