"""CLIP: texts, pictures and patches in one space, without training; extra `models`.

Patches: in the last block each place attends only to itself and so keeps its own content (the value path of Zhou et
al., "Extract Free Dense Labels from CLIP", 2022); everything after that block is unchanged.
"""

from collections.abc import Sequence
from typing import Any

from sim.types import Frame

from .pretrained import PretrainedEncoder, features
from .protocol import ModelOptions

DEFAULT_MODEL = "openai/clip-vit-large-patch14"
"""768-d (GROUNDING.md, section 5)."""


class Clip(PretrainedEncoder):
    """The adapter of CLIP; h = w = image size / patch size (16 for L/14 at 224)."""

    def __init__(self, source: str = DEFAULT_MODEL, *, options: ModelOptions | None = None) -> None:
        """Loads a CLIP model by id or folder; raises like PretrainedEncoder."""
        super().__init__(source, {"clip": "CLIPModel"}, options)
        config = self._model.config
        self._size, patch = config.vision_config.image_size, config.vision_config.patch_size
        self._side = self._size // patch
        self._max_tokens = config.text_config.max_position_embeddings
        self.dim = config.projection_dim
        self.name = f"clip-{self.dim}-p{patch}-{self._size}px@{self._digest}"

    def _texts(self, texts: Sequence[str]) -> Any:
        return features(self._model.get_text_features(**self._tokens(texts, max_length=self._max_tokens)))

    def _images(self, frames: Sequence[Frame]) -> Any:
        return features(self._model.get_image_features(self._squashed(frames, self._size)))

    def _patches(self, frames: Sequence[Frame]) -> Any:
        model = self._model.vision_model
        pixels = self._squashed(frames, self._size)
        before_last = model(pixels, output_hidden_states=True).hidden_states[-2][:, 1:]  # without the class token
        last = model.encoder.layers[-1]
        attention = last.self_attn
        places = before_last + attention.out_proj(attention.v_proj(last.layer_norm1(before_last)))
        places = places + last.mlp(last.layer_norm2(places))
        vectors = self._model.visual_projection(model.post_layernorm(places))
        return vectors.reshape(len(frames), self._side, self._side, self.dim)
