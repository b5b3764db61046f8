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

import torch

from sim.types import Frame

from .pretrained import PretrainedEncoder
from .protocol import ModelOptions

Blip2Space = Literal["itc256", "hidden768"]
DEFAULT_MODEL = "Salesforce/blip2-itm-vit-g"
_TILE = 4
"""Patches along a side of a tile: a picture of 16 x 16 patches has 4 x 4 tiles of 16 states each."""


class Blip2(PretrainedEncoder):
    """The adapter of BLIP-2; 4.7 GB of weights, so better on a GPU. Its patches are the tiles."""

    def __init__(
        self, source: str = DEFAULT_MODEL, *, space: Blip2Space = "itc256", options: ModelOptions | None = None
    ) -> None:
        """Loads a BLIP-2 retrieval model by id or folder; raises like PretrainedEncoder."""
        super().__init__(source, {"blip-2": "Blip2ForImageTextRetrieval"}, options)
        config = self._model.config
        self._size = config.vision_config.image_size
        self._side = self._size // config.vision_config.patch_size
        self._max_tokens = config.qformer_config.max_position_embeddings
        self._space: Blip2Space = space
        self.dim = config.image_text_hidden_size if space == "itc256" else config.qformer_config.hidden_size
        self.name = f"blip2-{space}-{self.dim}@{self._digest}"

    def _texts(self, texts: Sequence[str]) -> Any:
        model, tokens = self._model, self._tokens(texts, max_length=self._max_tokens)
        embedded = model.embeddings(input_ids=tokens["input_ids"])
        states = model.qformer(query_embeds=embedded, query_length=0, attention_mask=tokens["attention_mask"])
        first = states.last_hidden_state[:, 0]
        return first if self._space == "hidden768" else model.text_projection(first)

    def _images(self, frames: Sequence[Frame]) -> Any:
        return self._answers(self._states(frames))

    def _patches(self, frames: Sequence[Frame]) -> Any:
        states = self._states(frames)[:, 1:]
        tiles, (batch, _, width) = self._side // _TILE, states.shape
        square = states.reshape(batch, self._side, self._side, width)[:, : tiles * _TILE, : tiles * _TILE]
        split = square.reshape(batch, tiles, _TILE, tiles, _TILE, width).transpose(2, 3)
        answers = self._answers(split.reshape(batch * tiles * tiles, _TILE * _TILE, width))
        return answers.reshape(batch, tiles, tiles, self.dim)

    def _states(self, frames: Sequence[Frame]) -> Any:
        """(B, 1 + P, D) states of the vision model, the class token first."""
        return self._model.vision_model(self._squashed(frames, self._size)).last_hidden_state

    def _answers(self, states: Any) -> Any:
        """(B, E) answers of the Q-Former to states (B, S, D)."""
        model = self._model
        queries = model.query_tokens.expand(len(states), -1, -1)
        hidden = model.qformer(query_embeds=queries, encoder_hidden_states=states).last_hidden_state
        if self._space == "hidden768":
            return hidden[:, 0]
        return torch.nn.functional.normalize(model.vision_projection(hidden).float(), dim=-1).mean(dim=1)
