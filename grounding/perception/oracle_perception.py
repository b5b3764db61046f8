"""Oracle perception: turns the instance ids of a picture into vectors of their captions, with adjustable errors.

With it, mapping and grounding run without a vision model. Maps made with it rank methods; they do not predict success
on pictures. Noise: v <- unit(v + c sqrt(E) n), n a random unit vector (GROUNDING.md, section 0), so c is the standard
deviation of a cosine's error.
"""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Frame

from ..encoders.protocol import ORACLE_SUFFIX, TextEncoder

CLUTTER_TEXTS = (
    "white wall", "brick wall", "wooden floor", "tiled floor", "plaster ceiling", "skirting board", "door frame",
    "light switch", "power socket", "ventilation grille", "cardboard box", "paper bag", "pile of laundry", "shoe rack",
    "umbrella stand", "waste bin", "extension cord", "cleaning bucket", "ironing board", "folded ladder", "coat hook",
    "newspaper stack", "spray bottle", "toolbox", "pet bowl", "yoga mat", "suitcase", "water pipe", "smoke detector",
    "window sill", "loose cables", "stair step", "door mat", "wall shelf with jars", "hanging jacket", "empty bottle",
)  # fmt: skip
"""Texts for places without a captioned object, with background `clutter`."""
_PLACE = 1.0
"""Background without an instance keeps its text within cubes of this size (metres)."""
_VIEW, _OBJECT, _CONFUSION, _BACKGROUND, MISS, FALSE, BOX, SCORE = range(8)
"""Streams of random numbers: raising one option does not change the draws of the others. The public ones are those of
the oracle detector."""


@dataclass(frozen=True, slots=True)
class PerceptionOptions:
    """Errors of the perception. Draws depend on `seed`, the home and their purpose, never on the order of calls."""

    view_noise: float = 0.0
    """c for the error of each patch in each view; averaging views of one place reduces it. The same picture from the
    same pose gets the same error, as with a real model."""
    object_noise: float = 0.0
    """c for the error that an instance keeps in all views; averaging does not reduce it."""
    confusion: float = 0.0
    """Probability that an instance is mistaken, in all views, for another object of the home with another text. An
    instance confused at a lower probability stays confused at a higher one."""
    background: Literal["empty", "clutter"] = "empty"
    """Patches without a captioned object: zero vectors, or a clutter text that each instance or cubic metre keeps."""
    patch: int = 16
    """Pixels along a patch's side, rounded so that patches tile the picture evenly."""
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("view_noise", "object_noise"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise AgentError(f"perception: {name} is {value!r}; expected 0 or more. Try 0.1.")
        if not 0 <= self.confusion <= 1:
            raise AgentError(f"perception: confusion is {self.confusion!r}; expected 0 to 1. Try 0.1.")
        if self.patch < 1:
            raise AgentError(f"perception: patch is {self.patch!r}; expected at least 1 pixel. Try 16.")


class OraclePerception:
    """A `DenseEncoder` for the simulator's frames in the space of a text encoder.

    Its name is the text space's name with a suffix, which tells its maps from maps of real pictures. Query such a map
    with this object, or with `make_encoder("hashed+oracle-perception")`. Frames without instance ids raise AgentError.
    """

    def __init__(
        self,
        text_encoder: TextEncoder,
        captions: Mapping[int, str],
        *,
        options: PerceptionOptions | None = None,
        home: str = "",
    ) -> None:
        """Encodes the captions.

        Args:
            text_encoder: Encodes the captions and the queries.
            captions: Instance id to text, as `object_texts` gives them; empty if only queries will be encoded.
            options: Errors, background, patches; none by default.
            home: Name of the home, so that homes with the same ids get different draws.
        """
        self.text_encoder = text_encoder
        self.options = options or PerceptionOptions()
        self._home = zlib.crc32(home.encode())
        self._clutter = text_encoder.encode_texts(CLUTTER_TEXTS if self.options.background == "clutter" else [])
        self._places: dict[tuple[int, ...], int] = {}
        self.captions = dict(sorted(captions.items()))
        """Instance id to its true text."""
        self._texts = self._confused(self.captions)
        vectors = text_encoder.encode_texts(list(self._texts.values()))
        self._rows = {
            instance: _disturbed(row[None], self.options.object_noise, self.rng(_OBJECT, instance))[0]
            for instance, row in zip(self._texts, vectors, strict=True)
        }

    @property
    def name(self) -> str:
        """The text space's name with `+oracle-perception`."""
        return self.text_encoder.name + ORACLE_SUFFIX

    @property
    def dim(self) -> int:
        """The text encoder's dimension."""
        return self.text_encoder.dim

    @property
    def perceived(self) -> dict[int, str]:
        """Instance id to the text that perception gives it, confusions included; for labels and failure analysis."""
        return dict(self._texts)

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows from the text encoder."""
        return self.text_encoder.encode_texts(texts)

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit mean of the visible captioned objects, weighted by pixels; zero where none is in view."""
        rows = np.zeros((len(frames), self.dim), np.float32)
        for row, frame in zip(rows, frames, strict=True):
            ids, counts = np.unique(ids_of(frame), return_counts=True)
            seen = [(self._row(int(i)), n) for i, n in zip(ids, counts, strict=True) if i > 0]
            total = np.sum([vector * n for vector, n in seen], axis=0) if seen else np.zeros(self.dim)
            row[:] = _disturbed(_unit(total[None]), self.options.view_noise, self._view_rng(frame, 0))[0]
        return rows

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors of the instance with the most pixels in each patch.

        Raises:
            AgentError: The frames are of several sizes.
        """
        sizes = {frame.depth_m.shape for frame in frames}
        if len(sizes) > 1:
            raise AgentError(
                f"encoder {self.name!r}: frames are of sizes {sorted(sizes)}; expected one. "
                "Encode one camera at a time."
            )
        if not frames:
            return np.zeros((0, 0, 0, self.dim), np.float32)
        return np.stack([self._patches(frame) for frame in frames])

    def _patches(self, frame: Frame) -> NDArray[np.float32]:
        winners = winning_ids(ids_of(frame), patch=self.options.patch)
        ids, where = np.unique(winners, return_inverse=True)
        rows = np.array([self._row(int(instance)) for instance in ids])[where.reshape(winners.shape)]
        if self.options.background == "clutter":
            empty = winners == 0
            rows[empty] = self._background(frame, empty)
        flat = _disturbed(rows.reshape(-1, self.dim), self.options.view_noise, self._view_rng(frame, 1))
        return flat.reshape(rows.shape)

    def _row(self, instance: int) -> NDArray[np.float32]:
        known = self._rows.get(instance)
        if known is None:  # 0 means no instance; other ids are things without a caption
            known = np.zeros(self.dim, np.float32)
            if instance > 0 and self.options.background == "clutter":
                known = self._clutter[self.rng(_BACKGROUND, instance).integers(len(self._clutter))]
            self._rows[instance] = known
        return known

    def _background(self, frame: Frame, empty: NDArray[np.bool_]) -> NDArray[np.float32]:
        """(M, E) clutter vectors for the places that patches without an instance show; zero where depth is unknown."""
        rows, cols = np.nonzero(empty)
        v = ((rows + 0.5) * frame.depth_m.shape[0] / empty.shape[0]).astype(int)
        u = ((cols + 0.5) * frame.depth_m.shape[1] / empty.shape[1]).astype(int)
        depth, (fx, fy, cx, cy) = frame.depth_m[v, u].astype(float), frame.camera.lens
        x, y = (u + 0.5 - cx) / fx * depth, (v + 0.5 - cy) / fy * depth
        points = np.column_stack([x, y, depth, np.ones(len(depth))]) @ frame.T_world_camera.T
        places = np.floor(points[:, :3] / _PLACE).astype(int).tolist()
        found = self._clutter[[self._clutter_at(tuple(place)) for place in places]]
        return np.where((depth > 0)[:, None], found, 0)

    def _clutter_at(self, place: tuple[int, ...]) -> int:
        if place not in self._places:
            rng = self.rng(_BACKGROUND, 0, *(value % 2**32 for value in place))
            self._places[place] = int(rng.integers(len(self._clutter)))
        return self._places[place]

    def _confused(self, captions: dict[int, str]) -> dict[int, str]:
        texts = {}
        for instance, text in captions.items():
            rng = self.rng(_CONFUSION, instance)
            others = [other for other in captions.values() if other != text]
            is_confused = rng.random() < self.options.confusion and others
            texts[instance] = others[int(rng.integers(len(others)))] if is_confused else text
        return texts

    def rng(self, stream: int, *what: int) -> np.random.Generator:
        """Random numbers that depend on the seed, the home, the stream and `what` they are for, and on nothing else."""
        return np.random.default_rng([self.options.seed, self._home, stream, *what])

    def _view_rng(self, frame: Frame, kind: int) -> np.random.Generator:
        return self.rng(_VIEW, kind, *view_key(frame))


def view_key(frame: Frame) -> tuple[int, int]:
    """Two numbers that stand for a picture's pose and instance ids in the seeds of random numbers.

    Raises:
        AgentError: The frame has no instance ids.
    """
    pose = np.ascontiguousarray(frame.T_world_camera, np.float64).tobytes()
    return zlib.crc32(pose), zlib.crc32(np.ascontiguousarray(ids_of(frame)).tobytes())


def winning_ids(ids: NDArray[np.integer], *, patch: int) -> NDArray[np.int64]:
    """(h, w) id with the most pixels in each patch; ties go to the lowest id.

    Args:
        ids: (H, W), 0 or more.
        patch: Wanted side in pixels; h = H / patch, rounded, at least 1, and likewise w.
    """
    (height, width), present = ids.shape, np.flatnonzero(np.bincount(ids.ravel()))
    position = np.zeros(int(present[-1]) + 1, np.int64)  # of each id in `present`
    position[present] = np.arange(len(present))
    rows, cols = max(1, round(height / patch)), max(1, round(width / patch))
    of_patch = (np.arange(height) * rows // height)[:, None] * cols + np.arange(width) * cols // width
    counts = np.bincount((of_patch * len(present) + position[ids]).ravel(), minlength=rows * cols * len(present))
    return present[counts.reshape(rows, cols, len(present)).argmax(axis=2)].astype(np.int64)


def ids_of(frame: Frame) -> NDArray[np.int32]:
    """(H, W) the simulator's instance ids.

    Raises:
        AgentError: The frame has none.
    """
    if frame.ids is None:
        raise AgentError(
            "oracle perception: a frame has no instance ids; expected those of the simulator. Use a real encoder "
            "(clip:, siglip:, blip2-itc256:) for pictures of a robot."
        )
    return frame.ids


def _unit(rows: NDArray[np.floating]) -> NDArray[np.float32]:
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    return (rows / np.where(norms > 0, norms, 1)).astype(np.float32)


def _disturbed(rows: NDArray[np.floating], noise: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """(N, E) unit rows with noise; zero rows stay zero."""
    if not noise:
        return np.asarray(rows, np.float32)
    spoiled = rng.standard_normal(rows.shape, dtype=np.float32)
    spoiled *= (noise * math.sqrt(rows.shape[1]) / _lengths(spoiled))[:, None].astype(np.float32)
    spoiled += rows
    spoiled /= _lengths(spoiled)[:, None]
    spoiled[~rows.any(axis=1)] = 0
    return spoiled


def _lengths(rows: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.sqrt(np.einsum("ne,ne->n", rows, rows))
