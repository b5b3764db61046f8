"""What an encoder must offer, a cache by text, and the encoders known by name."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.errors import AgentError

from .posed_frames import PosedFrame

EncoderName = str
"""`hashed`, `minilm`, or `clip:`, `siglip:`, `blip2-itc256:`, `blip2-hidden768:` and a model id or a folder; with the
suffix `+oracle-perception` it encodes the queries to maps that oracle perception made in that space."""
TEXT_ENCODERS = ("hashed", "minilm")
MODEL_FAMILIES = ("clip", "siglip", "blip2-itc256", "blip2-hidden768")
ORACLE_SUFFIX = "+oracle-perception"
_MAX_CACHED_TEXTS = 50_000
_MAX_SLUG = 40


class TextEncoder(Protocol):
    """Texts to unit vectors. `grounding.checks.check_encoder` tests a plug-in."""

    @property
    def name(self) -> str:
        """Names the vector space: maps and queries match only when their encoders' names are equal."""
        ...

    @property
    def dim(self) -> int:
        """E, the length of a vector."""
        ...

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows, one per text whatever the others are; a zero row for a text without content."""
        ...


class TextImageEncoder(TextEncoder, Protocol):
    """Whole pictures and texts to unit vectors of one space. `grounding.checks.check_image_encoder` tests a plug-in."""

    def encode_images(self, frames: Sequence[PosedFrame]) -> NDArray[np.float32]:
        """(N, E) unit rows, one per picture; zero for one that says nothing. Real models read `rgb` only."""
        ...


class DenseEncoder(TextImageEncoder, Protocol):
    """A vector for each patch of a picture too."""

    def encode_patches(self, frames: Sequence[PosedFrame]) -> NDArray[np.float32]:
        """(N, h, w, E) unit vectors of patches that tile each picture evenly; zero where a patch says nothing."""
        ...


Device = Literal["cpu", "cuda"]
Autocast = Literal["off", "bfloat16", "float16"]


@dataclass(frozen=True, slots=True)
class ModelOptions:
    """How a real model runs; the vectors depend on `autocast` a little (about 1e-2), on nothing else."""

    device: Device = "cpu"
    batch_size: int = 8
    """Texts or pictures at a time."""
    autocast: Autocast = "off"
    """Arithmetic of the large products; float16 on cuda only."""
    download: bool = True
    """Whether a model id may be fetched; False = the local cache only."""


class CachedTextEncoder:
    """An encoder that encodes each text once; forgets everything when it holds `max_texts`."""

    def __init__(self, encoder: TextEncoder, *, max_texts: int = _MAX_CACHED_TEXTS) -> None:
        """Wraps `encoder`."""
        self._encoder = encoder
        self._max_texts = max_texts
        self._rows: dict[str, NDArray[np.float32]] = {}

    @property
    def name(self) -> str:
        """The wrapped encoder's."""
        return self._encoder.name

    @property
    def dim(self) -> int:
        """The wrapped encoder's."""
        return self._encoder.dim

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, E) unit rows; only texts not met before are encoded, in one call."""
        unknown = [text for text in dict.fromkeys(texts) if text not in self._rows]
        if len(self._rows) + len(unknown) > self._max_texts:
            self._rows.clear()
            unknown = list(dict.fromkeys(texts))
        if unknown:
            self._rows.update(zip(unknown, self._encoder.encode_texts(unknown), strict=True))
        return np.array([self._rows[text] for text in texts], np.float32).reshape(len(texts), self.dim)


def make_encoder(name: EncoderName, *, options: ModelOptions | None = None) -> TextEncoder:
    """The text encoder of this name, with a cache by text.

    Args:
        name: As `EncoderName` says.
        options: Of a real model; `hashed` and `minilm` have none.

    Raises:
        AgentError: The name is not one, or the model cannot be loaded.
        MissingDependencyError: Its extra is not installed.
    """
    space, source = parse_encoder_name(name)
    if name.endswith(ORACLE_SUFFIX):
        from .encoding.oracle_perception import OraclePerception

        return OraclePerception(make_encoder(name.removesuffix(ORACLE_SUFFIX), options=options), {})
    if space == "hashed":
        from .encoding.hashed import HashedWords

        return CachedTextEncoder(HashedWords())
    if space == "minilm":
        from .encoding.minilm import stored_minilm  # torch, transformers

        return CachedTextEncoder(stored_minilm())
    return CachedTextEncoder(_model(space, source, options or ModelOptions()))


def make_image_encoder(name: EncoderName, *, options: ModelOptions | None = None) -> DenseEncoder:
    """The real model of this name, for building maps from pictures.

    Raises:
        AgentError: The name is not a model's, or the model cannot be loaded.
        MissingDependencyError: Extra `models` is not installed.
    """
    space, source = parse_encoder_name(name)
    if space in TEXT_ENCODERS or name.endswith(ORACLE_SUFFIX):
        raise AgentError(
            f"encoder {name!r}: cannot see; expected {_families()}. Name a model, or use "
            "grounding.encoding.oracle_perception.OraclePerception, which needs the home's captions."
        )
    return _model(space, source, options or ModelOptions())


def parse_encoder_name(name: EncoderName) -> tuple[str, str]:
    """The text encoder or family, and the model id or folder ("" for text encoders); loads nothing.

    Raises:
        AgentError: It is none.
    """
    space, colon, source = name.removesuffix(ORACLE_SUFFIX).partition(":")
    if (space in TEXT_ENCODERS and not colon) or (space in MODEL_FAMILIES and source):
        return space, source
    raise AgentError(
        f"encoder {name!r}: is not known; expected {', '.join(TEXT_ENCODERS)}, or {_families()}. "
        "Example: clip:openai/clip-vit-large-patch14."
    )


def is_model(name: EncoderName) -> bool:
    """Whether the name is of a real model, which sees and which `ModelOptions` are for.

    Raises:
        AgentError: It is no encoder's.
    """
    return parse_encoder_name(name)[0] in MODEL_FAMILIES and not name.endswith(ORACLE_SUFFIX)


def require_no_model_options(where: str, options: ModelOptions) -> None:
    """Refuses options of a real model for an encoder without one, which would ignore them.

    Args:
        where: The option that names the encoder, with its value.
        options: All must be the defaults.

    Raises:
        AgentError: One is not.
    """
    for option, name in (("--device", "device"), ("--autocast", "autocast"), ("--batch", "batch_size")):
        value = getattr(options, name)
        if value != getattr(ModelOptions(), name):
            raise AgentError(
                f"{option} is {value!r} with {where}, which runs no model of ours; expected {_families()}. Leave it "
                "out, or name a model."
            )


def encoder_slug(name: EncoderName) -> str:
    """The name as file and run names can carry it: `clip-clip-vit-large-patch14`.

    Raises:
        AgentError: It is not an encoder's name.
    """
    space, source = parse_encoder_name(name)
    suffix = ORACLE_SUFFIX.replace("+", "-") if name.endswith(ORACLE_SUFFIX) else ""
    last = re.sub(r"[^A-Za-z0-9_.-]", "-", source.rstrip("/").rsplit("/", 1)[-1])
    return f"{space}{'-' if last else ''}{last[:_MAX_SLUG]}{suffix}"


def _families() -> str:
    return f"one of {', '.join(f'{family}:' for family in MODEL_FAMILIES)} and a model id or a folder"


@lru_cache(maxsize=1)
def _model(family: str, source: str, options: ModelOptions) -> DenseEncoder:
    """Keeps the last model: queries, pictures and the next scenes of a process are encoded by the same."""
    match family:  # torch, transformers
        case "clip":
            from .encoding.clip import Clip

            return Clip(source, options=options)
        case "siglip":
            from .encoding.siglip import Siglip

            return Siglip(source, options=options)
        case _:
            from .encoding.blip2 import Blip2

            return Blip2(source, space="itc256" if family == "blip2-itc256" else "hidden768", options=options)
