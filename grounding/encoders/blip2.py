"""BLIP-2 for image-text retrieval: texts, pictures and tiles of pictures in one of two spaces; extra `models`.

`itc256` is the contrastive space, in which BLIP-2 takes the largest cosine of a text with the picture's 32 query
tokens. A map cell holds one vector, so a picture is stored as the unit mean of its 32 unit tokens: the cosine with it
is the mean cosine over the tokens, times a factor of the picture, never the largest. `hidden768` holds the Q-Former's
states before the projection (query token 0 of pictures, the class token of texts), which the authors of PersONAL
stored; no training has aligned them.

Tiles: the Q-Former reads only the patch states of the tile, so its vector describes the tile; the states themselves
depend on the whole picture.
"""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from sim.types import Frame

from .pretrained import load_pretrained
from .protocol import ModelOptions

Blip2Space = Literal["itc256", "hidden768"]
DEFAULT_MODEL = "Salesforce/blip2-itm-vit-g"
_TILE = 4
"""Patches along a side of a tile: a picture of 16 x 16 patches has 4 x 4 tiles of 16 states each."""


class Blip2:
    """A `DenseEncoder`; 4.7 GB of weights, so better on a GPU."""

    def __init__(
        self, source: str = DEFAULT_MODEL, *, space: Blip2Space = "itc256", options: ModelOptions | None = None
    ) -> None:
        """Loads a BLIP-2 retrieval model by id or folder.

        Raises:
            MissingDependencyError: Extra `models` is not installed.
            AgentError: The model cannot be loaded.
        """
        self._parts = load_pretrained(source, {"blip-2": "Blip2ForImageTextRetrieval"}, options or ModelOptions())
        config = self._parts.model.config
        self._size = config.vision_config.image_size
        self._side = self._size // config.vision_config.patch_size
        self._max_tokens = config.qformer_config.max_position_embeddings
        self._space: Blip2Space = space
        self.dim: int = config.image_text_hidden_size if space == "itc256" else config.qformer_config.hidden_size
        self.name = f"blip2-{space}-{self.dim}@{self._parts.digest}"

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows."""
        return self._parts.unit_rows(texts, self._texts, shape=(self.dim,))

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit rows of whole pictures, squeezed to the model's square."""
        return self._parts.unit_rows(frames, lambda batch: self._answers(self._states(batch)), shape=(self.dim,))

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors of tiles of 4 x 4 patches (h = w = 4 for 224 pixels and patches of 14)."""
        tiles = self._side // _TILE
        return self._parts.unit_rows(frames, self._tiles, shape=(tiles, tiles, self.dim))

    def _texts(self, texts: Sequence[str]) -> Any:
        model, tokens = self._parts.model, self._parts.tokens(texts, max_length=self._max_tokens)
        embedded = model.embeddings(input_ids=tokens["input_ids"])
        states = model.qformer(query_embeds=embedded, query_length=0, attention_mask=tokens["attention_mask"])
        first = states.last_hidden_state[:, 0]
        return first if self._space == "hidden768" else model.text_projection(first)

    def _states(self, frames: Sequence[Frame]) -> Any:
        """(B, 1 + P, D) states of the vision model, the class token first."""
        return self._parts.model.vision_model(self._parts.squashed(frames, self._size)).last_hidden_state

    def _tiles(self, frames: Sequence[Frame]) -> Any:
        """(B, h, w, E) vectors of tiles."""
        states = self._states(frames)[:, 1:]
        tiles, (batch, _, width) = self._side // _TILE, states.shape
        square = states.reshape(batch, self._side, self._side, width)[:, : tiles * _TILE, : tiles * _TILE]
        split = square.reshape(batch, tiles, _TILE, tiles, _TILE, width).transpose(2, 3)
        answers = self._answers(split.reshape(batch * tiles * tiles, _TILE * _TILE, width))
        return answers.reshape(batch, tiles, tiles, self.dim)

    def _answers(self, states: Any) -> Any:
        """(B, E) answers of the Q-Former to states (B, S, D)."""
        model = self._parts.model
        queries = model.query_tokens.expand(len(states), -1, -1)
        hidden = model.qformer(query_embeds=queries, encoder_hidden_states=states).last_hidden_state
        if self._space == "hidden768":
            return hidden[:, 0]
        return torch.nn.functional.normalize(model.vision_projection(hidden).float(), dim=-1).mean(dim=1)
