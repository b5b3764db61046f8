"""CLIP: texts, pictures and patches in one space, without training; extra `models`.

Patches: in the last block each place attends only to itself and so keeps its own content (the value path of Zhou et
al., "Extract Free Dense Labels from CLIP", 2022); everything after that block is unchanged.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.types import Frame

from .pretrained import features, load_pretrained
from .protocol import ModelOptions

DEFAULT_MODEL = "openai/clip-vit-large-patch14"
"""768-d (GROUNDING.md, section 5)."""


class Clip:
    """A `DenseEncoder`."""

    def __init__(self, source: str = DEFAULT_MODEL, *, options: ModelOptions | None = None) -> None:
        """Loads a CLIP model by id or folder.

        Raises:
            MissingDependencyError: Extra `models` is not installed.
            AgentError: The model cannot be loaded.
        """
        self._parts = load_pretrained(source, {"clip": "CLIPModel"}, options or ModelOptions())
        config = self._parts.model.config
        self._size, self._patch = config.vision_config.image_size, config.vision_config.patch_size
        self._max_tokens = config.text_config.max_position_embeddings
        self.dim: int = config.projection_dim
        self.name = f"clip-{self.dim}-p{self._patch}-{self._size}px@{self._parts.digest}"

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows; texts are cut at the model's 77 tokens."""
        return self._parts.unit_rows(texts, self._texts, shape=(self.dim,))

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit rows of whole pictures, which are squeezed to a square instead of losing their sides."""
        return self._parts.unit_rows(frames, self._images, shape=(self.dim,))

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors; h = w = image size / patch size (16 for L/14 at 224)."""
        side = self._size // self._patch
        rows = self._parts.unit_rows(frames, self._patches, shape=(side * side, self.dim))
        return rows.reshape(len(frames), side, side, self.dim)

    def _texts(self, texts: Sequence[str]) -> Any:
        return features(self._parts.model.get_text_features(**self._parts.tokens(texts, max_length=self._max_tokens)))

    def _images(self, frames: Sequence[Frame]) -> Any:
        return features(self._parts.model.get_image_features(self._parts.squashed(frames, self._size)))

    def _patches(self, frames: Sequence[Frame]) -> Any:
        """(B, h * w, E) vectors of patches, row by row."""
        model = self._parts.model.vision_model
        pixels = self._parts.squashed(frames, self._size)
        before_last = model(pixels, output_hidden_states=True).hidden_states[-2][:, 1:]  # without the class token
        last = model.encoder.layers[-1]
        attention = last.self_attn
        places = before_last + attention.out_proj(attention.v_proj(last.layer_norm1(before_last)))
        places = places + last.mlp(last.layer_norm2(places))
        return self._parts.model.visual_projection(model.post_layernorm(places))
