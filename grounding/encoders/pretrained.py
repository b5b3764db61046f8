"""Vision-language models of `transformers`: loading by id or folder, devices, batches; the adapters use it.

Extra `models`. Weights that do not fit the requested architecture are refused: `transformers` would fill the gaps with
random numbers and continue.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim.errors import AgentError
from sim.extras import require
from sim.types import Frame

from .protocol import ModelOptions

_DIGEST_VALUES = 64
"""Numbers of each weight tensor that go into a model's digest: enough to tell two trainings apart, and instant."""
_DTYPES = {"bfloat16": torch.bfloat16, "float16": torch.float16}


@dataclass(frozen=True, slots=True)
class Pretrained:
    """A loaded model with the parts that prepare its inputs."""

    model: Any
    """A `transformers` model in float32, in evaluation mode, on the device."""
    tokenizer: Any
    image_processor: Any
    options: ModelOptions
    digest: str
    """Eight hex digits of the weights; equal weights give equal digits, from any source."""

    def pixels(self, frames: Sequence[Frame], **how: object) -> dict[str, Any]:
        """The model's picture inputs on the device; `how` overrides the processor's own settings."""
        pictures = [np.asarray(frame.rgb) for frame in frames]
        inputs = self.image_processor(pictures, return_tensors="pt", input_data_format="channels_last", **how)
        return {key: value.to(self.options.device) for key, value in inputs.items()}

    def squashed(self, frames: Sequence[Frame], size: int) -> Any:
        """(N, 3, size, size) whole pictures, squeezed rather than cropped: maps place patches on the whole view."""
        return self.pixels(frames, size={"height": size, "width": size}, do_center_crop=False)["pixel_values"]

    def tokens(self, texts: Sequence[str], *, max_length: int, padding: bool | str = True) -> dict[str, Any]:
        """Token ids and mask on the device; always padded on the right, cut at `max_length`."""
        made = self.tokenizer(
            list(texts),
            padding=padding,
            padding_side="right",
            truncation=True,
            max_length=max_length,
            return_tensors="pt",
        )
        return {key: made[key].to(self.options.device) for key in ("input_ids", "attention_mask") if key in made}

    def unit_rows(
        self, items: Sequence, encode: Callable[[Sequence], Any], *, shape: tuple[int, ...]
    ) -> NDArray[np.float32]:
        """(N, ..., E) vectors of length 1 of all items, a batch at a time.

        Args:
            items: Texts or frames.
            encode: Turns a batch into a tensor (B, ..., E).
            shape: Shape (..., E) of the answer where there are no items.
        """
        autocast, parts = self.options.autocast, [np.empty((0, *shape), np.float32)] * (not items)
        mixed = torch.autocast(self.options.device, _DTYPES.get(autocast), enabled=autocast != "off")
        with torch.inference_mode(), mixed:
            for start in range(0, len(items), self.options.batch_size):
                batch = items[start : start + self.options.batch_size]
                parts.append(torch.nn.functional.normalize(encode(batch).float(), dim=-1).cpu().numpy())
        return np.concatenate(parts)


def load_pretrained(source: str, classes: Mapping[str, str], options: ModelOptions) -> Pretrained:
    """Loads model, tokenizer and image processor.

    Args:
        source: A model id, or a folder as `save_pretrained` writes it.
        classes: Which `transformers` class loads which `model_type`.

    Raises:
        MissingDependencyError: Extra `models` is not installed.
        AgentError: There is no such model, it has another type, weights are missing, or the device is absent.
    """
    transformers = require("transformers", extra="models")
    SafetensorError = require("safetensors", extra="models").SafetensorError
    _require_device(options)
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
            # gives the same pictures with and without torchvision
            processor = transformers.AutoImageProcessor.from_pretrained(source, backend="pil", **only_here)
        except (OSError, ValueError, RuntimeError, SafetensorError) as error:
            raise AgentError(_not_loaded(source, error, local=local, options=options)) from error
    others = [key for key, *_ in report["mismatched_keys"]]
    missing = sorted([*report["missing_keys"], *others])
    if missing:
        raise AgentError(
            f"model {source!r}: {len(missing)} weights are missing or of another shape, first {missing[0]}; expected "
            f"all of {classes[config.model_type]}. Download the model again, or name another."
        )
    return Pretrained(model.eval().to(options.device), tokenizer, processor, options, weights_digest(model))


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


def _require_device(options: ModelOptions) -> None:
    if options.device == "cuda" and not torch.cuda.is_available():
        raise AgentError("device 'cuda': torch sees no such device; expected one. Use cpu, or install torch for CUDA.")
    if options.device == "cpu" and options.autocast == "float16":
        raise AgentError(
            "autocast 'float16' on the cpu: found no fast kernels for it; expected off or bfloat16. Choose one of them."
        )


def _require_type(source: str, model_type: str, classes: Mapping[str, str]) -> None:
    if model_type not in classes:
        raise AgentError(
            f"model {source!r}: config.json says model_type {model_type!r}; expected {' or '.join(sorted(classes))}. "
            "Name the model with the prefix of its own family."
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
