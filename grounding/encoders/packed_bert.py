"""The forward pass of BERT in torch alone: texts of any length follow each other in one matrix, without padding.

The products take the tokens of all texts at once; only attention works text by text, with texts of equal length
together. `transformers` pads texts or takes one at a time, and is slow to import.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

_EPS = 1e-12
"""Epsilon of the layer norms (config.json of BERT)."""


class _Affine(NamedTuple):
    weight: Tensor
    bias: Tensor


class _Layer(NamedTuple):
    qkv: _Affine
    """Query, key and value in one product."""
    out: _Affine
    out_norm: _Affine
    wide: _Affine
    narrow: _Affine
    norm: _Affine


class _Run(NamedTuple):
    """Consecutive texts of equal length."""

    rows: slice
    texts: int
    length: int


class PackedBert:
    """A BERT encoder that gives the mean of each text's last hidden states."""

    def __init__(self, weights: Mapping[str, Tensor], *, heads: int) -> None:
        """Takes the float32 weights by their names in a checkpoint of `BertModel`, and the number of heads."""
        self._words = weights["embeddings.word_embeddings.weight"]
        # all tokens of a single sentence have type 0
        token_type = weights["embeddings.token_type_embeddings.weight"][0]
        self._places = weights["embeddings.position_embeddings.weight"] + token_type
        self._norm = _affine(weights, "embeddings.LayerNorm")
        count = len({name.split(".")[2] for name in weights if name.startswith("encoder.layer.")})
        self._layers = [_layer(weights, f"encoder.layer.{index}") for index in range(count)]
        self._heads = heads

    def mean_vectors(self, tokens: Sequence[Sequence[int]]) -> Tensor:
        """(N, E) means of the last hidden states of N texts' tokens; fastest if equal lengths are neighbours."""
        runs = _runs(tokens)
        ids = torch.tensor([token for text in tokens for token in text])
        places = torch.cat([torch.arange(run.length).repeat(run.texts) for run in runs])
        states = _normed(self._words[ids] + self._places[places], self._norm)
        for layer in self._layers:
            states = self._after(layer, states, runs)
        return torch.cat([states[run.rows].unflatten(0, (run.texts, run.length)).mean(dim=1) for run in runs])

    def _after(self, layer: _Layer, states: Tensor, runs: Sequence[_Run]) -> Tensor:
        """(T, E) states after one layer."""
        qkv = functional.linear(states, *layer.qkv)
        mixed = torch.empty_like(states)
        for run in runs:
            # (texts, tokens, 3, heads, E / heads) -> 3 of (texts, heads, tokens, E / heads)
            parts = qkv[run.rows].view(run.texts, run.length, 3, self._heads, -1).permute(2, 0, 3, 1, 4)
            seen = functional.scaled_dot_product_attention(parts[0], parts[1], parts[2])
            mixed[run.rows] = seen.transpose(1, 2).flatten(0, 1).flatten(1)
        states = _normed(functional.linear(mixed, *layer.out).add_(states), layer.out_norm)
        wide = functional.gelu(functional.linear(states, *layer.wide))
        return _normed(functional.linear(wide, *layer.narrow).add_(states), layer.norm)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keeps torch to one thread.

    More threads wait for each other: they made small products 4 times slower, and texts 3 times beside busy processes.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _layer(weights: Mapping[str, Tensor], at: str) -> _Layer:
    parts = [_affine(weights, f"{at}.attention.self.{name}") for name in ("query", "key", "value")]
    return _Layer(
        _Affine(torch.cat([part.weight for part in parts]), torch.cat([part.bias for part in parts])),
        _affine(weights, f"{at}.attention.output.dense"),
        _affine(weights, f"{at}.attention.output.LayerNorm"),
        _affine(weights, f"{at}.intermediate.dense"),
        _affine(weights, f"{at}.output.dense"),
        _affine(weights, f"{at}.output.LayerNorm"),
    )


def _affine(weights: Mapping[str, Tensor], name: str) -> _Affine:
    return _Affine(weights[f"{name}.weight"], weights[f"{name}.bias"])


def _normed(states: Tensor, norm: _Affine) -> Tensor:
    return functional.layer_norm(states, states.shape[1:], norm.weight, norm.bias, _EPS)


def _runs(tokens: Sequence[Sequence[int]]) -> list[_Run]:
    """Neighbouring texts of equal length, with their rows in the matrix of all tokens."""
    found, start = [], 0
    for length, texts in groupby(map(len, tokens)):
        count = len(list(texts))
        found.append(_Run(slice(start, start + count * length), count, length))
        start += count * length
    return found
