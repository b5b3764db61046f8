"""SigLIP and SigLIP 2 (fixed size and NaFlex): texts, pictures and patches in one space; extra `models`.

Patches: the pooling head, which makes the picture's vector from all patches, runs on each patch alone.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Frame

from .pretrained import features, load_pretrained
from .protocol import ModelOptions

DEFAULT_MODEL = "google/siglip2-base-patch16-224"
"""768-d (GROUNDING.md, section 5)."""
_CLASSES = {"siglip": "SiglipModel", "siglip2": "Siglip2Model"}
"""The fixed-size models of SigLIP 2 have type `siglip`; only NaFlex has type `siglip2`."""


class Siglip:
    """A `DenseEncoder`."""

    def __init__(self, source: str = DEFAULT_MODEL, *, options: ModelOptions | None = None) -> None:
        """Loads a SigLIP model by id or folder.

        Raises:
            MissingDependencyError: Extra `models` is not installed.
            AgentError: The model cannot be loaded or has no pooling head.
        """
        self._parts = load_pretrained(source, _CLASSES, options or ModelOptions())
        config = self._parts.model.config
        vision = config.vision_config
        if not getattr(vision, "vision_use_head", True):
            raise AgentError(
                f"model {source!r}: has no pooling head; expected one, as texts match its output only. Name another."
            )
        self._is_naflex = config.model_type == "siglip2"
        self._patch = vision.patch_size
        self._size = 0 if self._is_naflex else vision.image_size
        self._max_tokens = config.text_config.max_position_embeddings
        self.dim: int = vision.hidden_size
        size = "naflex" if self._is_naflex else f"{self._size}px"
        self.name = f"siglip-{self.dim}-p{self._patch}-{size}@{self._parts.digest}"

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows; texts are cut at the model's 64 tokens."""
        return self._parts.unit_rows(texts, self._texts, shape=(self.dim,))

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit rows of whole pictures, squeezed to the model's square (NaFlex keeps their proportions)."""
        return self._parts.unit_rows(frames, self._images, shape=(self.dim,))

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors of patches.

        Raises:
            AgentError: Frames of different proportions were given to a NaFlex model.
        """
        if len({frame.rgb.shape for frame in frames}) > 1 and self._is_naflex:
            raise AgentError(
                f"encoder {self.name!r}: found frames of several sizes; expected one, as each size has its own number "
                "of patches. Encode the frames of one camera at a time."
            )
        return self._parts.unit_rows(frames, self._patches, shape=(0, 0, self.dim))

    def _texts(self, texts: Sequence[str]) -> Any:
        # as in training: lower case, full length, no mask; the answer is the state at the last place, mostly padding
        lower = [text.lower() for text in texts]
        tokens = self._parts.tokens(lower, max_length=self._max_tokens, padding="max_length")
        return features(self._parts.model.get_text_features(input_ids=tokens["input_ids"]))

    def _images(self, frames: Sequence[Frame]) -> Any:
        return features(self._parts.model.get_image_features(**self._pixels(frames)))

    def _pixels(self, frames: Sequence[Frame]) -> dict[str, Any]:
        if self._is_naflex:
            return self._parts.pixels(frames)
        return {"pixel_values": self._parts.squashed(frames, self._size)}

    def _patches(self, frames: Sequence[Frame]) -> Any:
        """(B, h, w, E) vectors of patches."""
        model, pixels = self._parts.model.vision_model, self._pixels(frames)
        hidden = model(**pixels).last_hidden_state  # (B, P, E)
        side = self._size // self._patch
        rows, cols = pixels["spatial_shapes"][0].tolist() if self._is_naflex else (side, side)
        hidden = hidden[:, : rows * cols]
        return model.head(hidden.reshape(-1, 1, self.dim)).reshape(len(frames), rows, cols, self.dim)
