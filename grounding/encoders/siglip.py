"""SigLIP and SigLIP 2 (fixed size and NaFlex): texts, pictures and patches in one space; extra `models`.

Patches: the pooling head, which makes the picture's vector from all patches, runs on each patch alone.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.types import Frame

from .pretrained import PretrainedEncoder, features
from .protocol import ModelOptions

DEFAULT_MODEL = "google/siglip2-base-patch16-224"
"""768-d (GROUNDING.md, section 5)."""
_CLASSES = {"siglip": "SiglipModel", "siglip2": "Siglip2Model"}
"""The fixed-size models of SigLIP 2 have type `siglip`; only NaFlex has type `siglip2`."""


class Siglip(PretrainedEncoder):
    """The adapter of SigLIP; NaFlex models keep the proportions of pictures."""

    def __init__(self, source: str = DEFAULT_MODEL, *, options: ModelOptions | None = None) -> None:
        """Loads a SigLIP model; raises like PretrainedEncoder, and AgentError where it has no pooling head."""
        super().__init__(source, _CLASSES, options)
        config = self._model.config
        vision = config.vision_config
        if not getattr(vision, "vision_use_head", True):
            raise AgentError(
                f"model {source!r}: has no pooling head; expected one, as texts match its output only. Name another."
            )
        self._is_naflex = config.model_type == "siglip2"
        self._patch = vision.patch_size
        self._size = 0 if self._is_naflex else vision.image_size
        self._max_tokens = config.text_config.max_position_embeddings
        self.dim = vision.hidden_size
        size = "naflex" if self._is_naflex else f"{self._size}px"
        self.name = f"siglip-{self.dim}-p{self._patch}-{size}@{self._digest}"

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
        return super().encode_patches(frames)

    def _texts(self, texts: Sequence[str]) -> Any:
        # as in training: lower case, full length, no mask; the answer is the state at the last place, mostly padding
        lower = [text.lower() for text in texts]
        tokens = self._tokens(lower, max_length=self._max_tokens, padding="max_length")
        return features(self._model.get_text_features(input_ids=tokens["input_ids"]))

    def _images(self, frames: Sequence[Frame]) -> Any:
        return features(self._model.get_image_features(**self._inputs(frames)))

    def _inputs(self, frames: Sequence[Frame]) -> dict[str, Any]:
        return self._pixels(frames) if self._is_naflex else {"pixel_values": self._squashed(frames, self._size)}

    def _patches(self, frames: Sequence[Frame]) -> Any:
        model, inputs = self._model.vision_model, self._inputs(frames)
        hidden = model(**inputs).last_hidden_state  # (B, P, E)
        side = self._size // self._patch
        rows, cols = inputs["spatial_shapes"][0].tolist() if self._is_naflex else (side, side)
        hidden = hidden[:, : rows * cols]
        return model.head(hidden.reshape(-1, 1, self.dim)).reshape(len(frames), rows, cols, self.dim)
