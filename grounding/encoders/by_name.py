"""The encoders known by name.

Every function that takes a name raises AgentError where no encoder has it, or a user's own cannot be built.
"""

import re
from functools import lru_cache
from typing import Any, NamedTuple

from sim.errors import AgentError, did_you_mean
from sim.plugins import build_plugin, is_plugin, own_name, require_methods

from .cached_texts import CachedTextEncoder
from .protocol import (
    MODEL_FAMILIES,
    ORACLE_SUFFIX,
    PLUGIN,
    SPACES,
    TEXT_ENCODERS,
    DenseEncoder,
    EncoderName,
    ModelOptions,
    TextEncoder,
)

_MAX_SLUG = 40


class EncoderParts(NamedTuple):
    """The parts of an encoder's name."""

    family: str
    """The text encoder, the family of models, or `PLUGIN`."""
    source: str
    """Model id, folder or plug-in; "" for text encoders."""
    is_oracle: bool
    """Whether the name ends with `ORACLE_SUFFIX`."""


def make_encoder(name: EncoderName, *, options: ModelOptions | None = None) -> TextEncoder:
    """The text encoder of this name, with a cache by text.

    Args:
        name: A name as described at `EncoderName`.
        options: Options of a real model; `hashed` and `minilm` have none.

    Raises:
        AgentError: The name is unknown, or the model cannot be loaded.
        MissingDependencyError: The encoder's extra is not installed.
    """
    family, source, is_oracle = parse_encoder_name(name)
    if is_oracle:
        from ..perception.oracle_perception import OraclePerception

        return OraclePerception(make_encoder(name.removesuffix(ORACLE_SUFFIX), options=options), {})
    match family:
        case "hashed":
            from .hashed import HashedWords

            return CachedTextEncoder(HashedWords())
        case "minilm":
            from .minilm import MiniLM, vectors_file  # torch

            return CachedTextEncoder(MiniLM(), file=vectors_file())
        case _:
            return CachedTextEncoder(_seeing(family, source, options))


def make_image_encoder(name: EncoderName, *, options: ModelOptions | None = None) -> DenseEncoder:
    """The real model of this name, or a user's own, for building maps from pictures.

    Raises:
        AgentError: The encoder does not see, or cannot be loaded.
        MissingDependencyError: Extra `models` is not installed.
    """
    family, source, is_oracle = parse_encoder_name(name)
    if family in TEXT_ENCODERS or is_oracle:
        raise AgentError(
            f"encoder {name!r}: cannot see; expected {_families()}. Name a model, or use "
            "grounding.perception.oracle_perception.OraclePerception, which needs the home's captions."
        )
    return require_methods(_seeing(family, source, options), ("encode_images",), where=name, need="a map of pictures")


def parse_encoder_name(name: EncoderName) -> EncoderParts:
    """The parts of the name; loads nothing."""
    is_oracle = name.endswith(ORACLE_SUFFIX)
    plain = plain_name(name).removesuffix(ORACLE_SUFFIX)
    family, colon, source = plain.partition(":")
    if family not in (*MODEL_FAMILIES, *TEXT_ENCODERS) and is_plugin(plain):
        return EncoderParts(PLUGIN, plain, is_oracle)
    if (family in TEXT_ENCODERS and not colon) or (family in MODEL_FAMILIES and source):
        return EncoderParts(family, source, is_oracle)
    raise AgentError(
        f"encoder {name!r}: is not known; expected {', '.join(TEXT_ENCODERS)}, or {_families()}, or your own as "
        f"package.module:factory.{did_you_mean(family, (*TEXT_ENCODERS, *MODEL_FAMILIES))} "
        "Example: clip:openai/clip-vit-large-patch14."
    )


def is_model(name: EncoderName) -> bool:
    """Whether the name is that of a real model, which encodes pictures and takes `ModelOptions`."""
    parts = parse_encoder_name(name)
    return parts.family in MODEL_FAMILIES and not parts.is_oracle


def sees(name: EncoderName) -> bool:
    """Whether an encoder also encodes pictures: real models do, a user's own does if it has `encode_images`."""
    family, source, is_oracle = parse_encoder_name(name)
    if family == PLUGIN and not is_oracle:
        return hasattr(_plugin(source), "encode_images")
    return is_model(name)


def plain_name(name: EncoderName) -> EncoderName:
    """The name as an option gives it: `hashed` or `minilm` in place of a space's name from a map file."""
    suffix = ORACLE_SUFFIX if name.endswith(ORACLE_SUFFIX) else ""
    plain = name.removesuffix(ORACLE_SUFFIX)
    return SPACES.get(plain, plain) + suffix


def encoder_called(name: EncoderName) -> str:
    """The encoder's name in runs and tables: that of the option, or the `name` of a user's own encoder."""
    family, source, is_oracle = parse_encoder_name(name)
    called = own_name(_plugin(source), source) if family == PLUGIN else ":".join(filter(None, (family, source)))
    return called + ORACLE_SUFFIX * is_oracle


def encoder_slug(name: EncoderName) -> str:
    """The name in a form for file and run names: `clip-clip-vit-large-patch14`."""
    family, source, is_oracle = parse_encoder_name(name)
    last = own_name(_plugin(source), source) if family == PLUGIN else source.rstrip("/").rsplit("/", 1)[-1]
    short = re.sub(r"[^A-Za-z0-9_.-]", "-", last)[:_MAX_SLUG]
    words = (short,) if family == PLUGIN else filter(None, (family, short))
    return "-".join(words) + ORACLE_SUFFIX.replace("+", "-") * is_oracle


def require_no_model_options(where: str, options: ModelOptions) -> None:
    """Refuses model options for an encoder without a model, which would ignore them.

    Args:
        where: The option that names the encoder, with its value.
        options: All must be the defaults.

    Raises:
        AgentError: An option is not the default.
    """
    for option, name in (("--device", "device"), ("--autocast", "autocast"), ("--batch", "batch_size")):
        value = getattr(options, name)
        if value != getattr(ModelOptions(), name):
            raise AgentError(
                f"{option} is {value!r} with {where}, which runs no model of ours; expected {_families()}. Leave it "
                "out, or name a model."
            )


def _families() -> str:
    return f"one of {', '.join(f'{family}:' for family in MODEL_FAMILIES)} and a model id or a folder"


def _seeing(family: str, source: str, options: ModelOptions | None) -> Any:
    """A user's own encoder, or a model."""
    return _plugin(source) if family == PLUGIN else _model(family, source, options or ModelOptions())


@lru_cache(maxsize=1)
def _plugin(name: str) -> Any:
    """The user's encoder; the last one is kept, as in `_model`."""
    return build_plugin(name, option="--encoder", methods=("encode_texts",))


@lru_cache(maxsize=1)
def _model(family: str, source: str, options: ModelOptions) -> DenseEncoder:
    """The model; the last one is kept, because a process uses it for queries, pictures and its next scenes."""
    match family:  # torch, transformers
        case "clip":
            from .clip import Clip

            return Clip(source, options=options)
        case "siglip":
            from .siglip import Siglip

            return Siglip(source, options=options)
        case _:
            from .blip2 import Blip2

            return Blip2(source, space="itc256" if family == "blip2-itc256" else "hidden768", options=options)
