"""Any encoder that sees as an `ImageTextScorer`: CLIP, SigLIP, BLIP-2, oracle perception, or a user's own."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

from ..encoders.protocol import DenseEncoder, TextImageEncoder


class EncoderScorer:
    """Scores a picture with the cosine of its vector and the text's.

    With BLIP-2 that is the mean cosine over its query tokens up to a factor of the picture, where VLFM's own server
    takes the largest one: the order of pictures is close, the values differ (encoders/blip2.py).
    """

    def __init__(self, encoder: TextImageEncoder | DenseEncoder) -> None:
        """Takes an encoder with `encode_images`, or with `encode_patches` alone: then the mean of the unit patches."""
        self._encoder = encoder
        self._has_pictures = callable(getattr(encoder, "encode_images", None))
        self._rows: dict[str, NDArray[np.float32]] = {}

    @property
    def name(self) -> str:
        """The encoder's name."""
        return self._encoder.name

    def score(self, frame: Frame, texts: Sequence[str]) -> NDArray[np.float32]:
        """(K,) cosine of the picture with each text; 0 for a picture or a text without content."""
        new = [text for text in dict.fromkeys(texts) if text not in self._rows]
        if new:
            self._rows |= dict(zip(new, self._encoder.encode_texts(new), strict=True))
        rows = np.array([self._rows[text] for text in texts], np.float32).reshape(len(texts), self._encoder.dim)
        return np.clip(rows @ self._vector(frame), -1, 1).astype(np.float32)

    def _vector(self, frame: Frame) -> NDArray[np.float32]:
        """(E,) the unit vector of a picture, or the mean of its patches' unit vectors."""
        if self._has_pictures:
            return self._encoder.encode_images([frame])[0]
        patches = self._encoder.encode_patches([frame])[0]  # type: ignore[union-attr]  # the only other way to see
        return patches.reshape(-1, self._encoder.dim).mean(axis=0)
