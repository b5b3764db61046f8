"""Vision-language models of `transformers`: loading by id or folder, devices, batches; the adapters use it.

Extra `models`. Weights that do not fit the requested architecture are refused: `transformers` would fill the gaps with
random numbers and continue.
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, get_args

import numpy as np
import torch
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.extras import require
from sim.types import Frame

from .protocol import Autocast, Device, ModelOptions

_DIGEST_VALUES = 64
"""Numbers of each weight tensor that go into a model's digest: enough to tell two trainings apart, and instant."""
_DTYPES = {"bfloat16": torch.bfloat16, "float16": torch.float16}


class PretrainedEncoder(ABC):
    """A `DenseEncoder` of a model in float32; an adapter says how texts, pictures and patches go through its model."""

    name: str
    """Says the model's kind, sizes and digest."""
    dim: int
    """E, the length of the vectors."""

    def __init__(self, source: str, classes: Mapping[str, str], options: ModelOptions | None) -> None:
        """Loads the model as `load_model` does, and raises like it."""
        self._options = options or ModelOptions()
        self._model, self._tokenizer, self._processor = load_model(source, classes, self._options)
        self._digest = weights_digest(self._model)

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows; texts are cut at the model's longest."""
        return self._unit_rows(texts, self._texts, shape=(self.dim,))

    def encode_images(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, E) unit rows of whole pictures, which are squeezed to the model's square and lose no sides."""
        return self._unit_rows(frames, self._images, shape=(self.dim,))

    def encode_patches(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors; h and w are the model's."""
        return self._unit_rows(frames, self._patches, shape=(0, 0, self.dim))

    @abstractmethod
    def _texts(self, texts: Sequence[str]) -> Any:
        """(B, E) vectors of texts."""

    @abstractmethod
    def _images(self, frames: Sequence[Frame]) -> Any:
        """(B, E) vectors of whole pictures."""

    @abstractmethod
    def _patches(self, frames: Sequence[Frame]) -> Any:
        """(B, h, w, E) vectors of patches."""

    def _pixels(self, frames: Sequence[Frame], **how: object) -> dict[str, Any]:
        """The model's picture inputs on the device; `how` overrides the processor's own settings."""
        pictures = [np.asarray(frame.rgb) for frame in frames]
        inputs = self._processor(pictures, return_tensors="pt", input_data_format="channels_last", **how)
        return {key: value.to(self._options.device) for key, value in inputs.items()}

    def _squashed(self, frames: Sequence[Frame], size: int) -> Any:
        """(N, 3, size, size) whole pictures, squeezed rather than cropped: maps place patches on the whole view."""
        return self._pixels(frames, size={"height": size, "width": size}, do_center_crop=False)["pixel_values"]

    def _tokens(self, texts: Sequence[str], *, max_length: int, padding: bool | str = True) -> dict[str, Any]:
        """Token ids and mask on the device; always padded on the right, cut at `max_length`."""
        made = self._tokenizer(
            list(texts),
            padding=padding,
            padding_side="right",
            truncation=True,
            max_length=max_length,
            return_tensors="pt",
        )
        return {key: made[key].to(self._options.device) for key in ("input_ids", "attention_mask") if key in made}

    def _unit_rows(
        self, items: Sequence, encode: Callable[[Sequence], Any], *, shape: tuple[int, ...]
    ) -> NDArray[np.float32]:
        """(N, ..., E) vectors of length 1 of all items, a batch at a time; without items (0, *shape)."""
        parts = [np.empty((0, *shape), np.float32)] * (not items)
        with inference(self._options):
            for start in range(0, len(items), self._options.batch_size):
                batch = items[start : start + self._options.batch_size]
                parts.append(torch.nn.functional.normalize(encode(batch).float(), dim=-1).cpu().numpy())
        return np.concatenate(parts)


class LoadedModel(NamedTuple):
    """A model of `transformers` on its device, and the makers of its inputs."""

    model: Any
    tokenizer: Any
    processor: Any
    """Gives the same pictures with and without torchvision."""


def load_model(source: str, classes: Mapping[str, str], options: ModelOptions) -> LoadedModel:
    """A model in float32 with its tokenizer and image processor.

    Args:
        source: A model id, or a folder as `save_pretrained` writes it.
        classes: Which `transformers` class loads which `model_type`.

    Raises:
        MissingDependencyError: Extra `models` is not installed.
        AgentError: There is no such model, it has another type, weights are missing, an option's value is not known, or
            the device is absent or full.
    """
    transformers = require("transformers", extra="models")
    SafetensorError = require("safetensors", extra="models").SafetensorError
    _require_options(options)
    local = _is_folder(source)
    only_here = {"local_files_only": local or not options.download}
    with quiet(transformers):
        try:
            config = transformers.AutoConfig.from_pretrained(source, **only_here)
            _require_type(source, config.model_type, classes)
            model, report = getattr(transformers, classes[config.model_type]).from_pretrained(
                source,
                config=config,
                dtype=torch.float32,
                output_loading_info=True,
                ignore_mismatched_sizes=True,  # reported with the missing ones, below
                **only_here,
            )
            tokenizer = transformers.AutoTokenizer.from_pretrained(source, **only_here)
            processor = transformers.AutoImageProcessor.from_pretrained(source, backend="pil", **only_here)
        except (OSError, ValueError, RuntimeError, SafetensorError) as error:
            raise AgentError(_not_loaded(source, error, local=local, options=options)) from error
    _require_whole(source, classes[config.model_type], report)
    with _enough_memory(options):
        return LoadedModel(model.eval().to(options.device), tokenizer, processor)


@contextmanager
def inference(options: ModelOptions) -> Iterator[None]:
    """Runs a model without gradients, in the arithmetic of `options`; raises AgentError where the GPU is full."""
    mixed = torch.autocast(options.device, _DTYPES.get(options.autocast), enabled=options.autocast != "off")
    with _enough_memory(options), torch.inference_mode(), mixed:
        yield


def features(output: Any) -> Any:
    """The pooled tensor of `get_text_features` and the like: transformers 5 wraps it, 4 returned it bare."""
    return output if isinstance(output, torch.Tensor) else output.pooler_output


def weights_digest(model: Any) -> str:
    """Eight hex digits computed from the first numbers of all parameters as float32."""
    total = hashlib.sha256()
    for name, values in sorted(model.named_parameters()):
        head = values.detach().flatten()[:_DIGEST_VALUES].to("cpu", torch.float32)
        total.update(f"{name} {tuple(values.shape)}\n".encode())
        total.update(head.numpy().tobytes())
    return total.hexdigest()[:8]


@contextmanager
def quiet(transformers: ModuleType) -> Iterator[None]:
    """Keeps the library's loading bars and reports off the terminal; real problems are raised as errors."""
    log = transformers.utils.logging
    level, has_bars = log.get_verbosity(), log.is_progress_bar_enabled()
    log.set_verbosity_error()
    log.disable_progress_bar()
    try:
        yield
    finally:
        log.set_verbosity(level)
        if has_bars:
            log.enable_progress_bar()


def _is_folder(source: str) -> bool:
    path = Path(source).expanduser()
    if path.is_dir():
        return True
    if source.startswith((".", "/", "~")) or source.count("/") > 1:
        raise AgentError(
            f"model {source!r}: found no such folder; expected one with config.json, weights, tokenizer and "
            "preprocessor_config.json. Give its path, or a model id such as openai/clip-vit-large-patch14."
        )
    return False


def _require_options(options: ModelOptions) -> None:
    for name, found, known in (
        ("device", options.device, get_args(Device)),
        ("autocast", options.autocast, get_args(Autocast)),  # torch takes its own default for None
    ):
        if found not in known:
            raise AgentError(f"{name} {found!r}: is not known; expected {' or '.join(known)}. Choose one of them.")
    if options.batch_size < 1:
        raise AgentError(f"batch_size {options.batch_size!r}: is too small; expected 1 or more. Choose such a number.")
    if options.device == "cuda" and not torch.cuda.is_available():
        raise AgentError("device 'cuda': torch sees no such device; expected one. Use cpu, or install torch for CUDA.")
    if options.device == "cpu" and options.autocast == "float16":
        raise AgentError(
            "autocast 'float16' on the cpu: found no fast kernels for it; expected off or bfloat16. Choose one of them."
        )


@contextmanager
def _enough_memory(options: ModelOptions) -> Iterator[None]:
    """Says what to do where the GPU has too little free memory, which torch reports with its allocator's statistics."""
    try:
        yield
    except torch.cuda.OutOfMemoryError as error:
        raise AgentError(
            f"device {options.device!r}: has too little free memory; expected enough for the model and batches of "
            f"{options.batch_size}. Use a smaller batch, end other programs that use the GPU, or use cpu."
        ) from error


def _require_type(source: str, model_type: str, classes: Mapping[str, str]) -> None:
    if model_type not in classes:
        raise AgentError(
            f"model {source!r}: config.json says model_type {model_type!r}; expected {' or '.join(sorted(classes))}. "
            "Name the model with the prefix of its own family."
        )


def _require_whole(source: str, wanted: str, report: Mapping[str, Any]) -> None:
    missing = sorted([*report["missing_keys"], *(key for key, *_ in report["mismatched_keys"])])
    if missing:
        raise AgentError(
            f"model {source!r}: {len(missing)} weights are missing or of another shape, first {missing[0]}; expected "
            f"all of {wanted}. Download the model again, or name another."
        )


def _not_loaded(source: str, error: Exception, *, local: bool, options: ModelOptions) -> str:
    first = (str(error).strip().splitlines() or [type(error).__name__])[0]
    if local:
        return (
            f"model {source!r}: cannot be loaded ({first}); expected config.json, weights, tokenizer and "
            "preprocessor_config.json in this folder. Download the model again."
        )
    where = "online or in the local cache" if options.download else "in the local cache (downloads are off)"
    return (
        f"model {source!r}: cannot be loaded ({first}); expected to find it {where}. Check the id and the connection, "
        "or download it elsewhere and give the folder."
    )
